"""The environment variables that the workspace needs: what sourcing the environment and install/setup.bash would give.

They are computed once, after the build (install.py), as entries to put before the caller's own; here they are applied.
"""

from __future__ import annotations

import os
import shlex
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from launcher.console import say
from launcher.state import WHEELS, Layout

# What another ROS installation or Python environment leaves in a shell, and the wheels must not see.
_OF_OTHERS = ("PYTHONPATH", "PYTHONHOME", "ROS_DISTRO", "ROS_VERSION", "ROS_PYTHON_VERSION")


def clean(caller: Mapping[str, str], ros: str) -> dict[str, str]:
    """The caller's variables without what would leak into the wheels: another ROS installation, other packages."""
    env = dict(caller)
    if ros != WHEELS:
        return env
    for name in _OF_OTHERS:
        env.pop(name, None)
    prefixes = _entries(caller.get("AMENT_PREFIX_PATH")) + _entries(caller.get("COLCON_PREFIX_PATH"))
    if prefixes:
        for name in [name for name in env if name.endswith("PATH")]:
            kept = [entry for entry in _entries(env[name]) if not _below(entry, prefixes)]
            _set_list(env, name, kept)
    if env.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp") != "rmw_fastrtps_cpp":
        say(f"RMW_IMPLEMENTATION={env.pop('RMW_IMPLEMENTATION')} is not in the wheels, rmw_fastrtps_cpp is used.")
    env["PYTHONNOUSERSITE"] = "1"
    return env


def apply(caller: Mapping[str, str], reached: Mapping[str, Any], layout: Layout) -> dict[str, str]:
    """The caller's variables with the workspace's before them."""
    env = clean(caller, reached["environment"]["ros"])
    variables = reached["variables"]
    for name, first in variables["prepend"].items():
        _set_list(env, name, first + [entry for entry in _entries(env.get(name)) if entry not in first])
    env.update(variables["set"])
    env["PIDTSM_ROOT"] = str(layout.root)
    return with_home(env, layout)


def bash_start_file(env: Mapping[str, str], reached: Mapping[str, Any]) -> str:
    """A start-up file for an interactive bash: the user's own, then this environment again, which it may have covered.

    (Many a .bashrc sources another ROS distribution or puts another Python first.) It lives in memory only.
    """
    ours = [name for names in reached["variables"].values() for name in names]
    others = _OF_OTHERS if reached["environment"]["ros"] == WHEELS else ()
    lines = ["[ -f ~/.bashrc ] && . ~/.bashrc"]
    lines += [f"unset {name}" for name in others if name not in ours]
    lines += [f"export {name}={shlex.quote(env[name])}" for name in ours]
    lines += ['PS1="(pidtsm) $PS1"', ""]
    file = os.memfd_create("pidtsm-bashrc", 0)  # 0: stays open in the shell
    os.write(file, "\n".join(lines).encode())
    os.lseek(file, 0, os.SEEK_SET)
    return f"/dev/fd/{file}"


def with_home(env: dict[str, str], layout: Layout) -> dict[str, str]:
    """Give logs and caches a place where there is no home directory to write to."""
    home = env.get("HOME", "")
    if home and os.access(home, os.W_OK | os.X_OK):
        return env
    place = _private_folder(layout)
    if not home:
        env["HOME"] = str(place)
    defaults = {
        "ROS_LOG_DIR": place / "ros_log",
        "COLCON_HOME": place / "colcon",
        "XDG_CACHE_HOME": place / "cache",
        "MPLCONFIGDIR": place / "matplotlib",
    }
    for name, value in defaults.items():
        env.setdefault(name, str(value))
    return env


def _private_folder(layout: Layout) -> Path:
    """A folder of this user's that can be written to, inside the environment if possible."""
    if os.access(layout.venv, os.W_OK):
        place = layout.venv / "home"
        place.mkdir(exist_ok=True)
        return place
    place = Path(tempfile.gettempdir()) / f"pidtsm-{os.getuid()}"
    place.mkdir(mode=0o700, exist_ok=True)
    return place if place.stat().st_uid == os.getuid() else Path(tempfile.mkdtemp(prefix="pidtsm-"))


def _entries(value: str | None) -> list[str]:
    return [entry for entry in (value or "").split(os.pathsep) if entry]


def _set_list(env: dict[str, str], name: str, entries: list[str]) -> None:
    if entries:
        env[name] = os.pathsep.join(entries)
    else:
        env.pop(name, None)


def _below(entry: str, prefixes: list[str]) -> bool:
    return any(entry == prefix or entry.startswith(prefix.rstrip("/") + "/") for prefix in prefixes)
