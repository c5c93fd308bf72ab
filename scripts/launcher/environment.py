"""The environment of a checkout: its required and its current state, the difference, and its variables."""

import hashlib
import json
import os
import re
import sys
import tempfile
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any

WHEELS = "wheels"
STEPS = ("environment", "packages", "workspace")
ON_DEMAND = ("control_msgs",)
"""Interfaces that take a minute to build; they are built when a command first needs them."""

# With a symlink install, changed modules take effect at once; these files are only read during the build.
_BUILD_INPUTS = ("package.xml", "setup.py", "setup.cfg", "CMakeLists.txt", ".msg", ".srv", ".action")
_NO_SOURCE = re.compile(r"(^|/)(\.|#|__pycache__)|(~|\.pyc)$|\.egg-info(/|$)")

# Variables of other ROS installations and Python environments, which must not affect the wheels.
_OF_OTHERS = ("PYTHONPATH", "PYTHONHOME", "ROS_DISTRO", "ROS_VERSION", "ROS_PYTHON_VERSION", "RMW_IMPLEMENTATION")


class SetupError(Exception):
    """Set-up cannot continue; the text is one sentence for the user."""


class Layout:
    """Paths in the checkout at `root`."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.log = root / ".venv.log"
        self.workspace = root / "ros2_ws"
        self.venv = root / ".venv"
        self.python = self.venv / "bin" / "python"
        self.state = self.venv / "pidtsm.json"
        self.actions = self.venv / "actions"  # exists once a command has needed the interfaces ON_DEMAND

    def lock(self, ros: str) -> Path:
        """Lock file of the packages for ROS 2 from `ros`."""
        return self.root / "requirements" / ("wheels.lock" if ros == WHEELS else "jazzy.lock")


def sourced_jazzy(layout: Layout) -> str | None:
    """The rclpy folder of a sourced ROS 2 Jazzy, if this interpreter can import it (without importing it)."""
    sourced = os.environ.get("ROS_DISTRO") == "jazzy" and os.environ.get("AMENT_PREFIX_PATH")
    rclpy = find_spec("rclpy") if sourced else None
    folders = (rclpy and rclpy.submodule_search_locations) or []
    outside = [folder for folder in folders if not Path(folder).is_relative_to(layout.venv)]
    return next((folder for folder in outside if PathFinder.find_spec("_rclpy_pybind11", [folder])), None)


def wanted(layout: Layout) -> dict[str, Any]:
    """The environment required by this interpreter, shell and checkout; the keys appear in messages to the user."""
    ros = sourced_jazzy(layout) or WHEELS
    python = getattr(sys, "_base_executable", "") or sys.executable  # not that of another environment
    # Any suitable interpreter can start an existing environment, unless the user has chosen this one.
    if ros == WHEELS and not os.environ.get("PIDTSM_PYTHON") and layout.state.exists() and layout.python.exists():
        python = layout.python
    return {
        "version of the set-up": 2,  # increment it if older environments must be recreated
        "place of the checkout": str(layout.root),
        "ROS 2": ros,
        "Python": os.path.realpath(python),
        "lock file": hashlib.sha256(layout.lock(ros).read_bytes()).hexdigest(),
    }


def packages(layout: Layout, ros: str) -> list[Path]:
    """Folders of the packages to build: those of the workspace, and needed interfaces that ROS 2 from `ros` lacks."""
    prefixes = [str(layout.venv)] if ros == WHEELS else entries(dict(os.environ), "AMENT_PREFIX_PATH")
    shares = [Path(prefix, "share") for prefix in prefixes if not Path(prefix).is_relative_to(layout.workspace)]
    own, interfaces = (
        [file.parent for file in sorted(layout.workspace.glob(f"{folder}/*/package.xml"))]
        for folder in ("src", "interfaces")
    )
    needed = [folder for folder in interfaces if folder.name not in ON_DEMAND or layout.actions.exists()]
    return own + [folder for folder in needed if not any((share / folder.name).is_dir() for share in shares)]


def workspace_digest(layout: Layout, ros: str) -> str:
    """Digest of all that requires a new build of `packages`: build inputs and the list of file names."""
    digest = hashlib.sha256()
    for path in sorted(path for package in packages(layout, ros) for path in package.rglob("*")):
        name = str(path.relative_to(layout.workspace))
        if not _NO_SOURCE.search(name) and path.is_file():
            digest.update(os.fsencode(name) + b"\0" + (path.read_bytes() if name.endswith(_BUILD_INPUTS) else b""))
    return digest.hexdigest()


def read(layout: Layout) -> dict[str, Any]:
    """The recorded state; empty if it is missing or unreadable."""
    try:
        return dict(json.loads(layout.state.read_text()))
    except (OSError, ValueError, TypeError):
        return {}


def write(layout: Layout, environment: dict[str, Any], **built: Any) -> None:
    """Record `environment` and what was `built` in it after a completed step; the next call repeats the others."""
    draft = layout.state.with_suffix(".new")
    draft.write_text(json.dumps({**environment, **built}, indent=1))
    draft.replace(layout.state)


def missing(layout: Layout, want: dict[str, Any], have: dict[str, Any]) -> tuple[str, str] | None:
    """The first of STEPS that must be done (and all after it), and the reason; None if nothing is missing."""
    if not have:
        return "environment", "the set-up was not finished" if layout.venv.exists() else "this is the first call"
    if changed := [name for name in want if have.get(name) != want[name]]:
        return "packages" if changed == ["lock file"] else "environment", f"the {changed[0]} has changed"
    if have.get("workspace") != workspace_digest(layout, want["ROS 2"]):
        return "workspace", "the workspace is new or has changed"
    return None


def variables(layout: Layout, ros: str, paths: dict[str, list[str]]) -> dict[str, str]:
    """The caller's variables, with `paths` first and without variables that would affect the wheels."""
    env = dict(os.environ)
    if ros == WHEELS:
        foreign = entries(env, "AMENT_PREFIX_PATH") + entries(env, "COLCON_PREFIX_PATH")
        # package:// and $(find) need the user's packages; those of another ROS 2 are where its share/rcl is.
        users = [e for e in foreign if Path(e, "share").is_dir() and not Path(e, "share", "rcl").is_dir()]
        for name in [name for name in env if name.endswith("PATH")]:
            kept = [e for e in entries(env, name) if not any(Path(e).is_relative_to(folder) for folder in foreign)]
            env[name] = os.pathsep.join(kept if name != "AMENT_PREFIX_PATH" else users)
        env = {name: value for name, value in env.items() if name not in _OF_OTHERS}
        # The start-up hook of the wheels would only set LD_LIBRARY_PATH and restart Python.
        env |= {"PYTHONNOUSERSITE": "1", "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"}
    for name, first in paths.items():
        env[name] = os.pathsep.join(first + [entry for entry in entries(env, name) if entry not in first])
    if not os.access(env.get("HOME", ""), os.W_OK | os.X_OK):  # used for logs and caches
        home = Path(tempfile.gettempdir(), f"pidtsm-{os.getuid()}")
        home.mkdir(mode=0o700, exist_ok=True)
        env["HOME"] = str(home) if home.stat().st_uid == os.getuid() else tempfile.mkdtemp(prefix="pidtsm-")
    return env | {"VIRTUAL_ENV": str(layout.venv)}


def interactive(shell: str) -> list[str]:
    """Command of an interactive shell; bash gets these variables again after .bashrc, which may overwrite them."""
    if Path(shell).name != "bash":
        return [shell, "-i"]
    start = f"echo '[ -f ~/.bashrc ] && . ~/.bashrc; unset {' '.join(_OF_OTHERS)}'; export -p"
    return [shell, "-c", f'exec "$0" --rcfile <({start}; echo \'PS1="(pidtsm) $PS1"\') -i', shell]


def entries(env: dict[str, str], name: str) -> list[str]:
    """Entries of the search path `name` in `env`."""
    return [entry for entry in env.get(name, "").split(os.pathsep) if entry]


def report(message: str, end: str = "\n") -> None:
    """Print a message on standard error; standard output is for the command."""
    print(f"pidtsm: {message}", end=end, file=sys.stderr, flush=True)
