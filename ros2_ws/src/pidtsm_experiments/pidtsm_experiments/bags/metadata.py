"""Metadata of a run, as stored in its bag by the recorder."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.recovery import Readable, stored_metadata

METADATA_KEY = "pidtsm"
"""Key of the recorder's JSON text in the bag's custom data."""


@dataclass(frozen=True)
class RunMetadata:
    """Metadata of a run; None for values that the bag does not contain.

    Attributes:
        scenario, law, clock: names.
        event_time: time of an event that changes the arm, s.
        trajectory: parameters of the trajectory node by name; not validated.
        namespace: namespace of the nodes if the topic names omit it, else empty.
        robot: parameters of the simulated arm by name, not validated; empty if the bag does not contain them.
        sliding, continuous: names of the joints that slide, and of those that turn without end.
    """

    scenario: str | None
    law: str | None
    clock: str | None
    event_time: float | None
    trajectory: object
    namespace: str
    robot: Mapping[str, object]
    sliding: tuple[str, ...]
    continuous: tuple[str, ...]


def run_metadata(path: Path, bag: Readable) -> RunMetadata:
    """Read the metadata of a bag.

    Args:
        path: path of the bag, or of one of its files.
        bag: the same bag in a form that rosbags can read.

    Raises:
        RecordingError: the metadata does not have the recorder's form.
    """
    text = stored_text(path, bag)
    try:
        values = json.loads(text or "{}")
        event_time = values.get("event_time")
        return RunMetadata(
            scenario=values.get("scenario"),
            law=values.get("law"),
            clock=values.get("clock"),
            event_time=None if event_time is None else float(event_time),
            trajectory=values.get("trajectory"),
            namespace=str(values.get("namespace", "")),
            robot=dict(values.get("robot", {})),
            sliding=tuple(values.get("sliding", ())),
            continuous=tuple(values.get("continuous", ())),
        )
    except (AttributeError, TypeError, ValueError) as error:
        raise RecordingError(f"custom data {METADATA_KEY} does not have the recorder's form: {error}") from None


def stored_text(path: Path, bag: Readable) -> str:
    """The recorder's JSON text in a bag, empty if there is none; arguments as for `run_metadata`."""
    return _custom_data(path, bag).get(METADATA_KEY, "")


def _custom_data(path: Path, bag: Readable) -> Mapping[str, str]:
    file = (path if path.is_dir() else path.parent) / "metadata.yaml"
    if file.exists() and not bag.flaws:
        information = yaml.safe_load(file.read_text("utf-8"))["rosbag2_bagfile_information"]
        return information.get("custom_data") or {}
    if bag.files[0].suffix == ".mcap":
        return stored_metadata(bag.files[0], METADATA_KEY)
    return {}
