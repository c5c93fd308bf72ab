"""What a machine must have before anything is created: each check raises one sentence that says what to install."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

from launcher.console import SetupError
from launcher.state import WHEELS

_DISK_BYTES = 2_000_000_000
_COMPILERS = {
    "C": ("CC", ("cc", "gcc", "clang"), ".c", '#include <stdio.h>\nint main(void) { return puts("") < 0; }\n'),
    "C++": (
        "CXX",
        ("c++", "g++", "clang++"),
        ".cpp",
        "#include <string>\nint main() { return std::string().size(); }\n",
    ),
}


def check_machine(ros: str, root: Path, *, create: bool) -> None:
    """Everything that building the workspace needs; with `create` also what a new environment needs."""
    if not os.access(root, os.W_OK):
        raise SetupError(f"{root} has to be set up, and this user cannot write there.")
    if create:
        _check_platform(ros)
        _check_venv()
    _check_headers()
    for language in _COMPILERS:
        _check_compiler(language)
    if create:
        _check_disk(root)


def _check_platform(ros: str) -> None:
    if ros != WHEELS:
        return
    if sys.platform != "linux" or platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc":
        raise SetupError(
            f"ROS 2 Jazzy's wheels need Linux on x86_64 with glibc, this is {sys.platform} on {platform.machine()}:"
            " source a ROS 2 Jazzy installation (. /opt/ros/jazzy/setup.sh) and call ./pidtsm again."
        )


def _check_venv() -> None:
    for module in ("venv", "ensurepip"):
        if importlib.util.find_spec(module) is None:
            raise SetupError(
                f"Python's {module} module is missing in {sys.executable}: install Python's venv support"
                " (Debian, Ubuntu: sudo apt install python3-venv)."
            )


def _check_headers() -> None:
    header = Path(sysconfig.get_path("include")) / "Python.h"
    if not header.exists():
        raise SetupError(
            f"Python's C headers are missing ({header}): install Python's development files"
            " (Debian, Ubuntu: sudo apt install python3-dev; Fedora: python3-devel)."
        )


def _check_compiler(language: str) -> None:
    variable, usual, suffix, program = _COMPILERS[language]
    named = os.environ.get(variable)
    candidates = (named.split()[0],) if named else usual
    compiler = next(filter(None, map(shutil.which, candidates)), None)
    advice = (
        f"install a {language} compiler (Debian, Ubuntu: sudo apt install build-essential; elsewhere: gcc and g++)."
    )
    if compiler is None:
        raise SetupError(f"no {language} compiler found ({', '.join(candidates)}): {advice}")
    with tempfile.TemporaryDirectory(prefix="pidtsm-") as folder:
        source = Path(folder) / f"program{suffix}"
        source.write_text(program)
        command = [compiler, str(source), "-o", str(source.with_suffix(".out"))]
        done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, errors="replace")
    if done.returncode != 0:
        cause = next((line.strip() for line in done.stderr.splitlines() if "error" in line.lower()), "no reason given")
        raise SetupError(f"the {language} compiler {compiler} cannot build a trivial program ({cause}): {advice}")


def _check_disk(root: Path) -> None:
    free = shutil.disk_usage(root).free
    if free < _DISK_BYTES:
        raise SetupError(
            f"the set-up needs about {_DISK_BYTES / 1e9:.0f} GB of disk, and {root} has {free / 1e9:.1f} GB left."
        )
