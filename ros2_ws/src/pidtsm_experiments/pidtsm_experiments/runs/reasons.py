"""Why a result may not have the same bits here: what has made it, and what is different."""

from collections.abc import Iterator, Mapping
from typing import Any

from pidtsm_core import __version__
from pidtsm_core.experiment.node_parameters import LEARNT_FILE
from pidtsm_core.recording.provenance import LIBRARIES, commit, environment
from pidtsm_core.simulation.mujoco_model import ENGINE
from pidtsm_experiments.runs.origin import digests

_MUJOCO = "mujoco"
_CHANGED = "+changes"
NOT_RECORDED = "the result does not say with which libraries and processor it was made"
NOTHING_KNOWN = (
    "nothing that is known differs from when it was made; its files or the source may have been changed since, by hand"
)
REALTIME = (
    "a run in real time depends on when its messages arrived, so it cannot be made again; "
    "rollouts and runs in lockstep can"
)


def reasons(origin: Mapping[str, Any], robot: str | None = None) -> list[str]:
    """What differs here from what has made a result, the likeliest reason for other bits first.

    Args:
        origin: content of its run.json.
        robot: description of the arm that is used instead of the recorded one; None: that one is used.
    """
    return [*_of_files(origin, robot), *_of_source(origin), *_of_environment(origin)]


def _of_source(origin: Mapping[str, Any]) -> Iterator[str]:
    here, there = commit(), origin["commit"]
    if origin["version"] != __version__:
        yield f"it was made by pidtsm {origin['version']}; this is {__version__}"
    if there and here and there.removesuffix(_CHANGED) != here.removesuffix(_CHANGED):
        yield f"it was made by commit {there[:12]}; this is {here[:12]}"
    if there and _CHANGED in there:
        yield "its source had changes that no commit has"
    if here and _CHANGED in here:
        yield "the source here has changes that no commit has"
    if (there is None) != (here is None):
        yield f"the commit of {'the result' if there is None else 'this installation'} is not known"


def _of_files(origin: Mapping[str, Any], robot: str | None) -> Iterator[str]:
    if learnt := (origin.get("parameters") or {}).get("controller", {}).get(LEARNT_FILE.name):
        yield f"its controller continued from what {learnt} contained then ({LEARNT_FILE.name}), if it existed"
    recorded = origin.get("files", {})
    here = digests({"recorded": {file: file for file in recorded}})
    for file, digest in recorded.items():
        if file not in here:
            yield f"{file}: is not on this machine" + (
                f"; {robot} was used" if robot else "; name it with --description"
            )
        elif here[file] != digest:
            yield f"{file}: has changed since"


def _of_environment(origin: Mapping[str, Any]) -> Iterator[str]:
    there, here = origin.get("environment"), environment()
    if not isinstance(there, dict):
        yield NOT_RECORDED
        return
    engine = (origin.get("parameters") or {}).get("simulator", {}).get(ENGINE.name)
    for name in LIBRARIES:
        if there.get(name) != here[name] and (name != _MUJOCO or engine == _MUJOCO):
            yield f"it was made with {name} {there.get(name) or 'that is not known'}; here is {here[name] or 'none'}"
    mathematics = there.get("mathematics", {})
    if differ := [name for name, digest in here["mathematics"].items() if mathematics.get(name) != digest]:
        same = there.get("libc") == here["libc"]
        place = f"both {here['libc']}, which chooses by the processor" if same else _pair(there, here, "libc")
        yield f"the C library here gives other bits of {', '.join(differ)} ({place})"
    theirs, ours = set(there.get("features", [])), set(here["features"])
    if theirs != ours:
        lacks = [("this processor has", theirs - ours), ("its processor had", ours - theirs)]
        text = ", ".join(f"{whose} no {', '.join(sorted(names))}" for whose, names in lacks if names)
        yield f"{text}, so compiled code may compute otherwise ({_pair(there, here, 'processor')})"
    elif there.get("target") != here["target"]:
        yield f"it was compiled for another processor ({_pair(there, here, 'target')})"
    if there.get("python") != here["python"]:
        yield f"it was made with another Python ({_pair(there, here, 'python')})"


def _pair(there: Mapping[str, Any], here: Mapping[str, Any], key: str) -> str:
    return f"there {there.get(key)}, here {here[key]}"
