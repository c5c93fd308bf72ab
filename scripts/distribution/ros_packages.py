"""The ROS packages as a source archive, which is built as its user would build it."""

import os
import sys
import tempfile
from pathlib import Path

from distribution.tools import DistributionError, call, outside

_CONTENT = ("LICENSE", "README.md", "CHANGELOG.md", "ros2_ws/src")
_OF_THE_WHEEL = "pyproject.toml"
_IMPORT = """
import importlib, pathlib, sys
for name in sys.argv[1:]:
    found = pathlib.Path(importlib.import_module(name).__file__)
    assert pathlib.Path.cwd() in found.parents, f"{name} is {found}"
"""
"""Imports packages, which must come from the current folder."""


def archive(file: Path) -> str:
    """Write the packages of the last commit to NAME.tar.gz, and build them; returns a sentence.

    Raises:
        DistributionError: this is no checkout, there is no git, or a package cannot be built or imported.
    """
    changed = call("git", "status", "--porcelain", "--", *_CONTENT, _OF_THE_WHEEL, environment=outside())
    prefix = f"--prefix={file.name.removesuffix('.tar.gz')}/"
    call("git", "archive", prefix, "-o", file, "HEAD", *_CONTENT, environment=outside())
    count = build_packages(file)
    differs = "; the wheel has changes that are not committed" if changed else ""
    return f"{file.name}: the {count} ROS packages of the last commit, built by colcon and imported{differs}"


def build_packages(file: Path) -> int:
    """Build the packages of NAME.tar.gz in an empty folder, with the ROS of this environment; returns their number.

    Raises:
        DistributionError: a package cannot be built or imported.
    """
    # Without an explicit number of jobs, colcon makes ninja wait for a load below the number of cores.
    environment = {**os.environ, "MAKEFLAGS": f"-j{os.cpu_count()}"}
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text).resolve()
        call("tar", "-xzf", file, environment=environment, cwd=folder)
        workspace = folder / file.name.removesuffix(".tar.gz") / "ros2_ws"
        packages = sorted(found.parent.name for found in workspace.glob("src/*/package.xml"))
        if not packages:
            raise DistributionError(f"{file.name} has no package in ros2_ws/src")
        cmake = ("--cmake-args", "-G", "Ninja", f"-DPython3_EXECUTABLE={sys.executable}")
        call("colcon", "build", "--executor", "sequential", *cmake, environment=environment, cwd=workspace)
        # The packages of this checkout come after them.
        words = ["-c", '. install/local_setup.sh && exec "$0" "$@"', sys.executable, "-c", _IMPORT]
        call("sh", *words, *packages, environment=environment, cwd=workspace)
    return len(packages)
