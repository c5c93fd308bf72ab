"""Runs on the disk: saving the recording of a rollout, and reading any run again."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.control.findings import as_json, from_json
from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.files import NODES, Settings, load_ros_parameters, ros_parameters
from pidtsm_core.recording import Recording
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.runs.origin import origin_of

RECORDING = "recording.npz"
"""File in the result folder of a rollout."""
_BAG, _PARAMETERS, _TEXT = "bag", "params", "text"
_BAG_FILES = (".mcap", ".db3")
_TUPLES = ("joints", "slides", "continuous", "lacking")


def save_recording(recording: Recording, file: Path) -> None:
    """Write a recording; its arrays have their names in the file, everything else is JSON under ``text``."""
    values = {each.name: getattr(recording, each.name) for each in fields(recording)}
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    found = None if recording.found is None else [as_json(each) for each in recording.found]
    others = {name: value for name, value in values.items() if name not in arrays}
    text = json.dumps({**others, "found": found, "recorded_commit": recording.commit or ""})
    np.savez(file, allow_pickle=False, **arrays, **{_TEXT: np.array(text)})


def load_recording(file: Path) -> Recording:
    """Read what `save_recording` has written.

    Raises:
        UsageError: the file cannot be read.
    """
    try:
        with np.load(file, allow_pickle=False) as content:
            arrays: dict[str, Any] = {name: content[name] for name in content.files if name != _TEXT}
            values: dict[str, Any] = json.loads(str(content[_TEXT]))
        values.update((name, tuple(values[name])) for name in _TUPLES if name in values)
        if found := values.get("found"):
            values["found"] = tuple(from_json(each) for each in found)
        values["parameters"] = _with_tuples(values.get("parameters", {}))
        recording = Recording(**arrays, **values)
    except Exception as error:  # A damaged file causes many kinds of exceptions.
        raise UsageError(f"{file}: not the recording of a rollout: {error}") from None
    return recording if recording.parameters else _with_origin(recording, file.parent)


def _with_origin(recording: Recording, path: Path) -> Recording:
    """The recording with what its result folder knows of what made it."""
    origin, parameters = origin_of(path) or {}, {}
    with suppress(UsageError):  # The run itself can be read.
        parameters = _with_tuples(read_parameters(path) or origin.get("parameters") or {})
    version, commit = origin.get("version"), origin.get("commit") or ""
    return replace(recording, parameters=parameters, version=version, recorded_commit=commit)


def _with_tuples(parameters: Mapping[str, Mapping[str, Any]]) -> Settings:
    """Parameters by node, with the sequences of a file as those of a rollout."""
    return {
        node: {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
        for node, values in parameters.items()
    }


def is_result_folder(path: Path) -> bool:
    """Whether a folder contains what a run or a rollout has recorded."""
    return (path / RECORDING).is_file() or (path / _BAG).is_dir()


def read_run(path: Path) -> Recording:
    """Read a run, with what made it, from its result folder or bag; warns with `UnfinishedBag` like `read_recording`.

    Args:
        path: a result folder, or a bag as for `read_recording`.

    Raises:
        UsageError: there is no run, or it cannot be read.
    """
    if not path.exists():
        raise UsageError(f"{path}: no such file or folder")
    if (path / RECORDING).is_file():
        return load_recording(path / RECORDING)
    bag = bag_of(path)
    if bag.is_dir() and not any(file.suffix in _BAG_FILES or file.name == "metadata.yaml" for file in bag.iterdir()):
        raise UsageError(f"{path} is neither a result folder, which has {_BAG}/ or {RECORDING}, nor a bag")
    try:
        return _with_origin(read_recording(bag), path)
    except RecordingError as error:
        raise UsageError(str(error)) from None


def bag_of(path: Path) -> Path:
    """The bag of a result folder, or what is a bag itself."""
    return path / _BAG if (path / _BAG).is_dir() else path


def write_parameters(parameters: Mapping[str, Mapping[str, Value]], folder: Path) -> None:
    """Write the parameters of each node to ``params/NODE.yaml`` in a result folder."""
    (folder / _PARAMETERS).mkdir()
    for node, values in parameters.items():
        (folder / _PARAMETERS / f"{node}.yaml").write_text(ros_parameters(node, values), encoding="utf-8")


def read_parameters(path: Path) -> Settings:
    """The parameters of a run by node; those that are not in its result folder are missing.

    Args:
        path: a result folder, or a bag in one.

    Raises:
        UsageError: a parameter file cannot be read.
    """
    folders = (path / _PARAMETERS, path.absolute().parent / _PARAMETERS)
    folder = next((each for each in folders if each.is_dir()), folders[0])
    found: Settings = {}
    for file in (folder / f"{node}.yaml" for node in NODES):
        if file.is_file():
            found.update(load_ros_parameters(file))
    return found
