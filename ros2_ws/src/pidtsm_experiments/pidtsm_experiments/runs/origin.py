"""Where a result comes from: version, commit, command, seed, parameters, and the runs that it was made of."""

import hashlib
import json
import os
import shlex
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pidtsm_core import __version__
from pidtsm_core.experiment.node_parameters import LEARNT_FILE
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_core.recording.provenance import commit, environment

ORIGIN = "run.json"
"""File in every result folder."""
_LONGEST_PATH = 4096
_MAKING = ("version", "commit", "command")
"""Keys that describe how something was made."""


@dataclass(frozen=True)
class MadeOf:
    """What a result is made of, apart from the parameters in its folder ``params/``.

    Attributes:
        parameters: of the nodes, by node; empty: those in ``params/``, or those of the only one of `runs`.
        seed: of the command; None: that of the simulator.
        runs: result folders, and bags, that the command has read.
    """

    parameters: Mapping[str, Mapping[str, Value]] | None = None
    seed: int | None = None
    runs: tuple[Path, ...] = ()


NOTHING = MadeOf()


def making() -> dict[str, Any]:
    """Version, commit and command of this process."""
    return dict(zip(_MAKING, (__version__, commit(), sys.argv), strict=True))


def write_origin(folder: Path, made_of: MadeOf = NOTHING, before: Path | None = None) -> None:
    """Write run.json to a result folder.

    ``environment`` has what the last bits depend on, ``files`` the digest of each file that a parameter names. Seed and
    parameters are null if there are none. ``runs`` has, by its path, the content of run.json of each run that was read;
    null if it has none. ``renewed`` names the commands that have made parts of the folder anew since.

    Args:
        folder: of the result.
        made_of: see `MadeOf`.
        before: the folder of which parts are made anew; its run.json stays true, and this command is added to it.

    Raises:
        UsageError: a parameter file cannot be read.
    """
    runs = {str(path): origin_of(path) for path in made_of.runs}
    only = next(iter(runs.values())) if len(runs) == 1 else None
    parameters: Mapping[str, Any] = made_of.parameters or _parameters(folder) or (only or {}).get("parameters") or {}
    seed = parameters.get("simulator", {}).get("seed") if made_of.seed is None else made_of.seed
    about = {"environment": environment(), "seed": seed, "parameters": parameters or None}
    if files := digests(parameters):
        about["files"] = files
    origin = making() | about | ({"runs": runs} if runs else {})
    if before is not None:
        origin = _added(origin_of(before), origin, _parameters(before))
    (folder / ORIGIN).write_text(json.dumps(origin, indent=2) + "\n", encoding="utf-8")


def digests(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """SHA-256 of each file that a parameter of a node names, such as the description of the arm, by its path."""
    named = (each for values in parameters.values() for each in values.items())
    # What the controller has learnt is another file after each run.
    texts = {value for name, value in named if isinstance(value, str) and name != LEARNT_FILE.name}
    found = {}
    for text in sorted(text for text in texts if os.sep in text and len(text) < _LONGEST_PATH):
        with suppress(OSError, ValueError):
            found[text] = hashlib.sha256(Path(text).read_bytes()).hexdigest()
    return found


def origin_of(run: Path) -> dict[str, Any] | None:
    """Content of run.json of a result folder, given it, its bag, or a file of its bag; None if there is none."""
    folders = (run, *run.absolute().parents[: 2 if run.is_file() else 1 if (run / "metadata.yaml").exists() else 0])
    for folder in folders:
        try:
            content = json.loads((folder / ORIGIN).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(content, dict) and content.keys() >= {*_MAKING}:
            return content
    return None


def comment() -> str:
    """Lines at the start of a YAML file about where it comes from."""
    version, revision, command = making().values()
    words = " ".join(shlex.quote(word) for word in [Path(command[0]).name, *command[1:]])
    return f"# pidtsm {version}, commit {revision or 'unknown'}\n# {' '.join(words.split())}\n"


def _added(earlier: dict[str, Any] | None, now: dict[str, Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The origin of a folder of which parts are made anew."""
    if earlier is None:
        seed = now["seed"] if now["seed"] is not None else parameters.get("simulator", {}).get("seed")
        return now | {"seed": seed, "parameters": now["parameters"] or parameters or None}
    how = {key: now[key] for key in _MAKING}
    known = earlier.get("renewed", [])
    if any({key: each.get(key) for key in _MAKING} == how for each in [earlier, *known]):
        return earlier
    return earlier | {"renewed": [*known, how]}


def _parameters(folder: Path) -> dict[str, Any]:
    """Parameters by node, of the files in a folder's ``params/``."""
    parameters: dict[str, Any] = {}
    for file in sorted((folder / "params").glob("*.yaml")):
        parameters.update(load_ros_parameters(file))
    return parameters
