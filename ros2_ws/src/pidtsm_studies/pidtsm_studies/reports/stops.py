"""Why a controller has stopped, with the value and the limit that it exceeded."""

from collections.abc import Mapping, Sequence
from typing import Any, SupportsFloat, cast

import numpy as np

from pidtsm_core.control.report import cause
from pidtsm_core.recording import Recording
from pidtsm_core.signals import Fault, Signal
from pidtsm_core.written import DIGITS, quantity

_MOST_DIGITS = 7


def why(recording: Recording, fault: Mapping[str, Any], controller: Mapping[str, Any]) -> str:
    """Why the controller has stopped, in a few words.

    Args:
        recording: the run.
        fault: an element of ``faults`` of its metrics.
        controller: parameters of the controller, with its limits; empty if they are not known.
    """
    kind = next((each for each in Fault if each.name.lower() == fault["fault"]), None)
    if kind is None:
        return str(fault["fault"])
    name = fault["joint"]
    if name in recording.joints:
        joint = recording.joints.index(name)
        sample = min(int(np.searchsorted(recording.time, fault["time"])), recording.time.size - 1)
        if (found := _exceeded(recording, kind, joint, sample, controller)) is not None:
            return found
    return cause(kind, 1, [name or "a joint"])


def _exceeded(recording: Recording, kind: Fault, joint: int, sample: int, controller: Mapping[str, Any]) -> str | None:
    """What a joint exceeded; None if it is not known, or the recorded values do not show it."""
    name, unit = recording.joints[joint], recording.units[joint].position
    position = float(recording.position[sample, joint])
    low, high = (_limit(controller, f"limits.{end}_position", joint, recording.joints) for end in ("min", "max"))
    if kind is Fault.POSITION_LIMIT and low is not None and high is not None and not low <= position <= high:
        end = low if position < low else high
        value, bound = _apart(position, end, unit)
        return f"{name} is at {value}, limit {bound}"
    size, limit, text = {
        Fault.VELOCITY_LIMIT: (
            float(recording.signals[sample, Signal.VELOCITY, joint]),
            _limit(controller, "limits.velocity", joint, recording.joints),
            f"{name} moves at {{value}}/s, limit {{limit}}/s",
        ),
        Fault.TRACKING_LIMIT: (
            float(recording.error[sample, joint]),
            _limit(controller, "limits.tracking_error", joint, recording.joints),
            f"{name} is {{value}} from its reference, limit {{limit}}",
        ),
    }.get(kind, (0.0, None, ""))
    if not limit or abs(size) <= limit:
        return None
    value, bound = _apart(abs(size), limit, unit)
    return text.format(value=value, limit=bound)


def _apart(value: float, limit: float, unit: str) -> tuple[str, str]:
    """A value and its limit with so many digits that they differ."""
    for digits in range(DIGITS, _MOST_DIGITS):
        texts = quantity(value, unit, digits), quantity(limit, unit, digits)
        if texts[0] != texts[1]:
            return texts
    return quantity(value, unit, _MOST_DIGITS), quantity(limit, unit, _MOST_DIGITS)


def _limit(controller: Mapping[str, Any], name: str, joint: int, joints: Sequence[str]) -> float | None:
    """A limit of a joint, which a parameter has for all joints or for each in the controller's order."""
    if name not in controller:
        return None
    values = np.atleast_1d(np.asarray(controller[name], dtype=np.float64))
    order = list(cast(Sequence[str], controller.get("joints", joints)))
    place = order.index(joints[joint]) if joints[joint] in order else joint
    return float(cast(SupportsFloat, values[place if values.size > 1 else 0]))
