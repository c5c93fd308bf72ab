"""What is set up, what should be, and what is missing between the two.

The state is one file inside the environment, replaced atomically and only after a step has fully succeeded. Whatever
interrupts a step, the next call therefore finds the state of before it and does the step again.
"""

from __future__ import annotations

import hashlib
import importlib.machinery
import importlib.util
import json
import os
import sys
from pathlib import Path
from typing import Any, NamedTuple

WHEELS = "wheels"

# Raised when set-up itself changes so that older environments have to be made anew.
SETUP_VERSION = 1

# A symlink install shows changed modules at once; these files it only reads while building.
_BUILD_INPUTS = {"package.xml", "setup.py", "setup.cfg", "CMakeLists.txt"}
_BUILD_SUFFIXES = (".msg", ".srv", ".action")


class Layout(NamedTuple):
    """Where things are in one checkout."""

    root: Path

    @property
    def venv(self) -> Path:
        return self.root / ".venv"

    @property
    def python(self) -> Path:
        return self.venv / "bin" / "python"

    @property
    def state(self) -> Path:
        return self.venv / "pidtsm.json"

    @property
    def log(self) -> Path:
        return self.root / ".venv.log"

    @property
    def workspace(self) -> Path:
        return self.root / "ros2_ws"

    def lock(self, ros: str) -> Path:
        return self.root / "requirements" / ("wheels.lock" if ros == WHEELS else "jazzy.lock")


class Wanted(NamedTuple):
    """The environment that this call asks for."""

    root: str
    ros: str  # WHEELS, or the folder of the sourced installation's rclpy
    python: str  # the base interpreter, links resolved
    lock: str  # digest of the lock file
    version: int = SETUP_VERSION


class Work(NamedTuple):
    """What set-up has to do; `reason` is for the user and empty on a first call."""

    create: bool = False  # the environment, from nothing
    update: bool = False  # its packages, in place
    build: bool = False  # the workspace
    reason: str = ""


def base_python() -> str:
    """This interpreter, or the one it was made from if it belongs to a virtual environment."""
    base = getattr(sys, "_base_executable", "")
    return os.path.realpath(base if base and Path(base).exists() else sys.executable)


def sourced_jazzy(layout: Layout) -> str | None:
    """The rclpy folder of a sourced ROS 2 Jazzy, if this interpreter can import it (without importing it)."""
    if os.environ.get("ROS_DISTRO") != "jazzy" or not os.environ.get("AMENT_PREFIX_PATH"):
        return None
    spec = importlib.util.find_spec("rclpy")
    for folder in (spec and spec.submodule_search_locations) or []:
        if Path(folder).is_relative_to(layout.venv):
            continue
        extension = Path(folder) / "_rclpy_pybind11"
        if any(Path(f"{extension}{suffix}").exists() for suffix in importlib.machinery.EXTENSION_SUFFIXES):
            return folder
    return None


def wanted(layout: Layout) -> Wanted:
    """The environment that this interpreter, this shell and this checkout's lock file ask for."""
    ros = sourced_jazzy(layout) or WHEELS
    return Wanted(root=str(layout.root), ros=ros, python=base_python(), lock=lock_digest(layout.lock(ros)))


def lock_digest(lock: Path) -> str:
    """What a lock file is recognized by."""
    return hashlib.sha256(lock.read_bytes()).hexdigest()


def workspace_digest(source: Path) -> str:
    """Digest of everything below `source` that makes a new build necessary: build inputs and the list of file names."""
    digest = hashlib.sha256()

    def visit(folder: str) -> None:
        with os.scandir(folder) as found:
            entries = sorted(found, key=lambda entry: entry.name)
        for entry in entries:
            name = entry.name
            if name.startswith((".", "#", "__pycache__")) or name.endswith(("~", ".pyc", ".egg-info")):
                continue
            if entry.is_dir():
                visit(entry.path)
                continue
            digest.update(os.fsencode(os.path.relpath(entry.path, source)) + b"\0")
            if name in _BUILD_INPUTS or name.endswith(_BUILD_SUFFIXES):
                digest.update(Path(entry.path).read_bytes())

    if source.is_dir():
        visit(str(source))
    return digest.hexdigest()


def read(layout: Layout) -> dict[str, Any]:
    """The recorded state; empty when there is none that can be read."""
    try:
        state = json.loads(layout.state.read_text())
    except (OSError, ValueError):
        return {}
    return state if isinstance(state, dict) else {}


def write(layout: Layout, environment: Wanted, **built: Any) -> None:
    """Record `environment` as complete, and what was `built` in it (digest of the workspace, variables)."""
    draft = layout.state.with_suffix(".new")
    with draft.open("w") as file:
        json.dump({"environment": environment._asdict(), **built}, file, indent=1)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(layout.state)


def missing(layout: Layout, want: Wanted, state: dict[str, Any]) -> Work | None:
    """The work between the recorded state and the wanted one, or None if they agree."""
    have = state.get("environment")
    if not isinstance(have, dict):
        interrupted = layout.venv.exists()
        return Work(create=True, build=True, reason="the set-up was not finished" if interrupted else "")
    reason = _why_create(layout, want, have)
    if reason:
        return Work(create=True, build=True, reason=reason)
    if have.get("lock") != want.lock:
        return Work(update=True, build=True, reason=f"{layout.lock(want.ros).name} has changed")
    if state.get("workspace") != workspace_digest(layout.workspace / "src"):
        return Work(build=True, reason="the workspace has changed" if "workspace" in state else "")
    return None


def _why_create(layout: Layout, want: Wanted, have: dict[str, Any]) -> str:
    """Why the environment cannot be kept, or nothing."""
    if have.get("root") != want.root:
        return "the checkout was moved"
    if have.get("version") != want.version:
        return "the set-up itself has changed"
    if have.get("ros") != want.ros:
        return "ROS 2 now comes from " + ("its wheels" if want.ros == WHEELS else "the sourced installation")
    if os.path.realpath(layout.python) != have.get("python") or not layout.python.exists():
        return "the Python it was made with is gone"
    # Any fitting interpreter may start an existing environment, unless the user asks for this one.
    asked = want.ros != WHEELS or bool(os.environ.get("PIDTSM_PYTHON"))
    if asked and have.get("python") != want.python:
        return f"it was made with another Python than {want.python}"
    return ""
