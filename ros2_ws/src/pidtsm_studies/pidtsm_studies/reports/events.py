"""What happened during a run, as marks on its time line."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pidtsm_core.recording import Recording
from pidtsm_core.signals import Mode, Status
from pidtsm_core.written import MINUS, number, quantity
from pidtsm_studies.reports.stops import why

SYMBOLS = {"payload": "▼", "push": "◆", "contact": "●", "limit": "■", "mode": "▬", "fault": "✕", "learnt": "▲"}
"""Mark of each kind of event."""
_MODES = {Mode.HOLDING: "holds its position", Mode.FREEDRIVE: "is in freedrive", Mode.STOPPED: "is stopped"}
STOPS = "stops: "
"""How the text of a fault begins."""
_CONTACT = "external_effort"
_ON_JOINTS = " on the joints"
_OWN = " its position"
_LEARNT = 0.9
"""A gain counts as learnt when it has reached this share of its last value."""
_BACK = 1.0
"""Time that an arm has to come back after a push or a load, s."""
_SHORTEST_MODE = 0.01
"""Other modes that last less are not shown, s."""


@dataclass(frozen=True)
class Event:
    """Something that happened.

    Attributes:
        kind: key of `SYMBOLS`.
        time: s, on the axis of the recording.
        until: when it ended, s; None: it has no duration.
        text: a short sentence without its time.
        label: a few words, for a mark.
        joint: index of the joint concerned; None: no single one.
        effect: what came of it, in a few words; empty: nothing that is told.
    """

    kind: str
    time: float
    until: float | None
    text: str
    label: str
    joint: int | None = None
    effect: str = ""

    def data(self) -> dict[str, Any]:
        """Plain data for the script, with the symbol."""
        return {**asdict(self), "symbol": SYMBOLS[self.kind]}


def events(
    recording: Recording,
    metrics: Mapping[str, Any],
    simulator: Mapping[str, Any],
    controller: Mapping[str, Any] | None = None,
) -> list[Event]:
    """Everything that happened, by time.

    Args:
        recording: the run.
        metrics: see `Recording.metrics`.
        simulator: parameters of the simulated arm, with the times of pushes and loads; empty if not known.
        controller: parameters of the controller, with its limits; None if they are not known.
    """
    found = [
        *_disturbances(recording, simulator),
        *_faults(recording, metrics, controller or {}),
        *_limits(metrics, simulator),
        *_modes(recording),
        *_learnt(recording),
    ]
    return sorted(found, key=lambda event: (event.time, event.kind))


def _disturbances(recording: Recording, simulator: Mapping[str, Any]) -> Iterator[Event]:
    last = float(recording.time[-1])
    time, mass = float(simulator.get("payload.time", 0.0)), float(simulator.get("payload.mass", 0.0))
    if mass and 0.0 < time < last:
        text, label = f"picks up {quantity(mass, 'kg')}", f"+{quantity(mass, 'kg')}"
        yield Event("payload", time, None, text, label, effect=_effect(recording, time))
    elif (event := recording.event_time) is not None:
        text = "the load of the arm changes"
        yield Event("payload", event, None, text, "load changes", effect=_effect(recording, event))
    carried = float(simulator.get("payload.duration", 0.0))
    if mass and carried and time + carried < last:
        text, label = f"drops {quantity(mass, 'kg')}", f"{MINUS}{quantity(mass, 'kg')}"
        yield Event("payload", time + carried, None, text, label, effect=_effect(recording, time + carried))
    time, lasts = float(simulator.get("push.time", 0.0)), float(simulator.get("push.duration", 0.0))
    if lasts and time < last and (strength := _strength(simulator)):
        text = f"is pushed with {strength} for {quantity(lasts, 's')}"
        label = f"push {strength.removesuffix(_ON_JOINTS)}"
        yield Event("push", time, time + lasts, text, label, effect=_effect(recording, time, lasts))


def _effect(recording: Recording, time: float, lasts: float = 0.0) -> str:
    """How far a joint is pushed away, and how far it is when it had time to come back."""
    begin, back = (int(np.searchsorted(recording.time, each)) for each in (time, time + lasts + _BACK))
    moved = np.abs(recording.error[begin : back + 1])
    if not len(moved) or back >= len(recording.time):
        return ""
    joint = int(np.argmax(moved.max(axis=0)))
    unit = recording.units[joint].position
    far, left = (quantity(float(value), unit) for value in (moved[:, joint].max(), moved[-1, joint]))
    return f"{recording.joints[joint]} is up to {far} away, and {left} after {quantity(_BACK, 's')}"


def _strength(simulator: Mapping[str, Any]) -> str:
    """The largest values of a push."""
    parts = {"push.effort": "N m", "push.force": "N", "push.torque": "N m"}
    largest = {name: float(np.abs(np.atleast_1d(simulator.get(name, 0.0))).max()) for name in parts}
    where = {"push.effort": _ON_JOINTS}
    return " and ".join(
        f"{quantity(value, parts[name])}{where.get(name, '')}" for name, value in largest.items() if value
    )


def _faults(recording: Recording, metrics: Mapping[str, Any], controller: Mapping[str, Any]) -> Iterator[Event]:
    for fault in metrics["faults"]:
        text = why(recording, fault, controller)
        joint = recording.joints.index(fault["joint"]) if fault["joint"] in recording.joints else None
        label = f"stop: {fault['joint']}" if fault["joint"] else "stop"
        yield Event("fault", fault["time"], None, f"{STOPS}{text}", label, joint)
        if fault["reset"] is not None:
            yield Event("mode", fault["reset"], None, "is reset", "reset")


def _limits(metrics: Mapping[str, Any], simulator: Mapping[str, Any]) -> Iterator[Event]:
    faults = metrics["faults"]
    free = bool(simulator) and not simulator.get("scene")  # Nothing is there that a simulated arm could touch.
    for violation in metrics["violations"]:
        limit, lasts = violation["limit"], quantity(violation["duration"], "s")
        if any(f["time"] == violation["time"] and f["fault"].startswith(limit.partition("_")[0]) for f in faults):
            continue  # The mark of the stop is there.
        if limit == _CONTACT and not free:
            yield Event("contact", violation["time"], None, f"touches something ({lasts} in all)", "contact")
        else:
            text = f"a joint is beyond limits.{limit} ({lasts} in all)"
            yield Event("limit", violation["time"], None, text, f"{limit.replace('_', ' ')} limit")


def _modes(recording: Recording) -> Iterator[Event]:
    """Times in other modes than following."""
    modes = recording.status[:, Status.MODE]
    begins = np.flatnonzero(np.diff(modes, prepend=modes[0])).tolist()
    for begin, end in zip([0, *begins], [*begins, modes.size], strict=True):
        text = _MODES.get(int(modes[begin])) if begin < modes.size else None  # type: ignore[call-overload]
        since, until = float(recording.time[begin]), float(recording.time[end - 1])
        if text and until - since >= _SHORTEST_MODE:
            whole = f"{text} for {quantity(until - since, 's')}"
            yield Event("mode", since, until, whole, text.removeprefix("is ").removeprefix("in ").removesuffix(_OWN))


def _learnt(recording: Recording) -> Iterator[Event]:
    """When the adaptive gain that grew most had nearly grown."""
    gains = recording.adaptive_gain
    joint = int(np.argmax(gains[-1] - gains[0]))
    grown = gains[:, joint] - gains[0, joint]
    if grown[-1] > 0.0:
        sample = int(np.argmax(grown >= _LEARNT * grown[-1]))
        text = f"{recording.joints[joint]}: the adaptive gain Υ settles at {number(float(gains[sample, joint]))}"
        label = f"{recording.joints[joint]}: gain settled"
        yield Event("learnt", float(recording.time[sample]), None, text, label, joint)
