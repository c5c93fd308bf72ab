"""The studies need neither ROS nor nodes: they import only pidtsm_core and libraries."""

import ast
import sys
from pathlib import Path

import pytest

import pidtsm_core
import pidtsm_studies

PACKAGES = [Path(package.__path__[0]) for package in (pidtsm_core, pidtsm_studies)]
FILES = [file for package in PACKAGES for file in sorted(package.rglob("*.py"))]
LIBRARIES = {
    "OpenGL",
    "av",
    "casadi",
    "cma",
    "glfw",
    "jinja2",
    "cloudpickle",
    "joblib",
    "llvmlite",
    "matplotlib",
    "mink",
    "mujoco",
    "numba",
    "numpy",
    "pandas",
    "ruckig",
    "scipy",
    "threadpoolctl",
    "trimesh",
    "xacro",
    "xarray",
    "yaml",
}


def imported(file: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module)
    return {name.partition(".")[0] for name in names} - sys.stdlib_module_names


def test_both_packages_are_found() -> None:
    assert {file.name for file in FILES} >= {"closed_loop.py", "claims.py", "measure.py", "page.py"}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_only_the_core_and_libraries_are_imported(package: Path) -> None:
    of_pidtsm = {"pidtsm_core", package.name}
    others = {str(file): imported(file) - of_pidtsm - LIBRARIES for file in FILES if package in file.parents}
    assert others
    assert {file: names for file, names in others.items() if names} == {}
