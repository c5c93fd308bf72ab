"""Where a result comes from: version, commit, command, seed and parameters."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pidtsm_core
from pidtsm_core.parameter_files import Settings, load_ros_parameters
from pidtsm_core.version import __version__

ORIGIN = "run.json"
"""File in every result folder."""
_SOURCE = Path(pidtsm_core.__file__).resolve().parent
_ANSWER_WITHIN = 5.0  # s


def write_origin(folder: Path) -> None:
    """Write run.json to a result folder; seed and parameters are those in its ``params/``, null if it has none.

    Raises:
        UsageError: a parameter file cannot be read.
    """
    parameters: Settings = {}
    for file in sorted((folder / "params").glob("*.yaml")):
        parameters.update(load_ros_parameters(file))
    origin: dict[str, Any] = {
        "version": __version__,
        "commit": commit(),
        "command": sys.argv,
        "seed": parameters.get("simulator", {}).get("seed"),
        "parameters": parameters or None,
    }
    (folder / ORIGIN).write_text(json.dumps(origin, indent=2) + "\n", encoding="utf-8")


def commit() -> str | None:
    """The commit of the source, with ``+changes`` if files differ from it; None if it is not in a git repository."""
    if not _git("ls-files", "--error-unmatch", "version.py"):
        return None  # Installed, perhaps in the repository of somebody else.
    head = _git("rev-parse", "HEAD")
    return head + "+changes" if head and _git("status", "--porcelain", "--untracked-files=no") else head or None


def _git(*words: str) -> str:
    """What git prints about the source; empty if it fails."""
    try:
        done = subprocess.run(
            ["git", "-C", str(_SOURCE), *words], capture_output=True, text=True, timeout=_ANSWER_WITHIN, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
