"""What a package imports it declares, under keys that rosdep knows, so that an ordinary installation can build it."""

import ast
import re
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import pytest

SOURCE = Path(__file__).resolve().parents[1] / "ros2_ws" / "src"
PACKAGES = sorted(file.parent for file in SOURCE.glob("*/package.xml"))
ROSDEP_KEYS = {
    "hypothesis": "python3-hypothesis",
    "jinja2": "python3-jinja2",
    "joblib": "python3-joblib",
    "matplotlib": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
}
"""Of Python packages, as in rosdep/python.yaml of rosdistro; ROS packages are declared by their names."""
WITHOUT_KEY = {
    "axe_core_python",
    "cloudpickle",
    "cma",
    "llvmlite",
    "mcap",
    "mcap_ros2",
    "mujoco",
    "ruckig",
    "threadpoolctl",
    "trimesh",
    "viser",
}
"""llvmlite comes with numba, cloudpickle with joblib; the ROS package ruckig has no Python module. The key of trimesh
is one of pip."""
OPTIONAL = {"OpenGL", "av", "casadi", "dask", "distributed", "glfw", "mink", "pinocchio", "pyarrow", "rerun"}
"""Imported only where they are installed."""
HELPERS = {"support"}


def imported(files: Iterator[Path]) -> set[str]:
    """Names of the modules that the code imports when it runs."""
    names: set[str] = set()
    for file in files:
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        only_types = {
            each
            for node in nodes
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
            for each in ast.walk(node)
        }
        for node in nodes:
            if node in only_types:
                continue
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module)
    return {name.partition(".")[0] for name in names} - sys.stdlib_module_names - WITHOUT_KEY - OPTIONAL - HELPERS


def declared(package: Path, *kinds: str) -> set[str]:
    root = ElementTree.parse(package / "package.xml").getroot()
    return {str(element.text) for kind in kinds for element in root.findall(kind)}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.name)
def test_imports_are_declared(package: Path) -> None:
    code = (f for folder in (package.name, "launch") for f in (package / folder).rglob("*.py"))
    needed = {ROSDEP_KEYS.get(name, name) for name in imported(code)} - {package.name}
    of_tests = {ROSDEP_KEYS.get(name, name) for name in imported((package / "test").rglob("*.py"))} - {package.name}
    always = declared(package, "depend", "exec_depend")
    assert needed <= always
    assert of_tests <= always | declared(package, "test_depend")


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.name)
def test_python_dependencies_have_keys_that_rosdep_knows(package: Path) -> None:
    keys = declared(package, "depend", "exec_depend", "test_depend", "build_depend")
    assert {key for key in keys if key.startswith("python3-")} <= set(ROSDEP_KEYS.values())


@pytest.mark.parametrize("package", [p for p in PACKAGES if (p / "setup.py").is_file()], ids=lambda p: p.name)
def test_colcon_finds_the_tests(package: Path) -> None:
    """It looks for pytest in the extra requirements, and for nothing else."""
    assert '"test": ["pytest"]' in (package / "setup.py").read_text(encoding="utf-8")


def test_the_newest_numba_that_is_allowed_is_the_one_that_is_tested() -> None:
    """Its internals are used, which a new version may change."""
    project = (SOURCE.parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    bounds = re.findall(r'"numba>=([\d.]+),<([\d.]+)"', project)
    installed = [int(part) for part in version("numba").split(".")[:2]]
    oldest, beyond = ([int(part) for part in bound.split(".")] for bound in bounds[0])
    assert oldest <= installed
    assert beyond == [installed[0], installed[1] + 1]
