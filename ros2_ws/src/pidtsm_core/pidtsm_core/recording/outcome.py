"""Events of a run, as numbers and as text: faults, violations, time spent holding, stopped or at a limit."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.control.configuration import LIMITS
from pidtsm_core.control.findings import from_json, statements
from pidtsm_core.control.report import cause
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording.metrics import STEADY_SHARE
from pidtsm_core.recording.overload import overload, overload_text
from pidtsm_core.robots import find_robot
from pidtsm_core.signals import Fault, Limited, Mode, Signal, Status
from pidtsm_core.units import either, joint_units
from pidtsm_core.written import THIN, enumeration, quantity

if TYPE_CHECKING:
    from pidtsm_core.recording import Recording

FOLLOWED, STRAYED, OVERLOADED = "followed", "strayed", "overloaded"
HELD, FREED, STOPPED, RAN_AWAY = "held", "freedrive", "stopped", "ran away"
"""Possible outcomes of a run."""

GROUND_TRUTH = "ground truth"
"""Value of `Recording.truth` for a simulated arm, whose true state is known."""

ASTRAY = np.pi
"""With a larger error, the arm no longer tracks its reference, rad or m."""

SHARE_OF_RANGE = 0.15
"""A run in which an error exceeds this share of the joint's range, at most of a turn, is not `FOLLOWED`."""

NOTABLE_SATURATION = 0.1
"""Share of the samples at an effort limit that the verdict of a run names."""

BEFORE_FAULT, LIMITED_BEFORE = 0.5, 0.2
"""A fault of an arm that has left its way names the joints whose effort was limited before: the time that counts, s,
and the share of its samples."""
_LEFT_ITS_WAY = (Fault.POSITION_LIMIT, Fault.VELOCITY_LIMIT, Fault.TRACKING_LIMIT)

IN_THE_END = f"over the last {100.0 * STEADY_SHARE:.0f}{THIN}%"
"""The part of a run that its steady-state error is of, in words."""

ROUGH = 0.05
"""A run whose error ends beyond this has followed roughly, rad or m."""

OF_TRACKING = ("max_error", "rmse", "eci", "steady_state_error")
"""Metrics that are meaningless if the arm ran away."""


def outcome(recording: "Recording") -> str:
    """Outcome of a run: ran away if the error ever exceeded `ASTRAY`, else according to the final mode.

    A run that follows at the end has strayed if an error exceeded `SHARE_OF_RANGE` while it followed, after it had once
    been less: an arm may begin far from its reference, or be led away from it by hand. It was overloaded if a joint
    ends at its effort limit and away from the reference, see `overload`.
    """
    if np.abs(recording.error).max() > ASTRAY:
        return RAN_AWAY
    if _stopped(recording)[-1]:
        return STOPPED
    follows = OVERLOADED if overload(recording, _ranges(recording)) else STRAYED if _strayed(recording) else FOLLOWED
    return {Mode.HOLDING: HELD, Mode.FREEDRIVE: FREED}.get(Mode(recording.status[-1, Status.MODE]), follows)


def _strayed(recording: "Recording") -> dict[str, Any] | None:
    """The largest error beyond `SHARE_OF_RANGE`: joint, time, error and its share of the range; None: there is none."""
    share = np.abs(recording.error) / _ranges(recording)
    follows = ~_stopped(recording) & (recording.status[:, Status.MODE] == Mode.FOLLOWING)
    for part in np.split(np.arange(follows.size), np.flatnonzero(np.diff(follows)) + 1):
        arrived = np.logical_or.accumulate(share[part] <= SHARE_OF_RANGE)
        share[part] = np.where(arrived & follows[part, np.newaxis], share[part], 0.0)
    sample, joint = (int(i) for i in np.unravel_index(np.argmax(share), share.shape))
    if share[sample, joint] <= SHARE_OF_RANGE:
        return None
    return {
        "joint": recording.joints[joint],
        "time": float(recording.time[sample]),
        "error": float(abs(recording.error[sample, joint])),
        "share": float(share[sample, joint]),
        "unit": recording.units[joint].position,
    }


def _ranges(recording: "Recording") -> NDArray[np.float64]:
    """Range of each joint, at most a turn, shape (joints,), rad or m; infinite where a joint slides without limits."""
    slides = np.array(recording.slides or (False,) * len(recording.joints))
    ranges = np.where(slides, np.inf, 2.0 * np.pi)
    with suppress(ParameterError):  # The description may be gone.
        robot = find_robot(recording.robot) if recording.robot else None
        if robot and robot.position_limits and set(robot.joints) == set(recording.joints):
            widths = dict(zip(robot.joints, np.diff(robot.position_limits)[:, 0], strict=True))
            ranges = np.minimum(ranges, [widths[joint] for joint in recording.joints])
    return ranges


def happenings(recording: "Recording") -> dict[str, Any]:
    """The part of metrics.json about events, without the values per joint."""
    lasts = _lasts(recording)
    stopped = _stopped(recording)
    mode = recording.status[:, Status.MODE]
    return {
        "outcome": (result := outcome(recording)),
        "strayed": _strayed(recording) if result == STRAYED else None,
        "overloaded": overload(recording, _ranges(recording)) if result in (OVERLOADED, RAN_AWAY) else None,
        "faults": list(_faults(recording)),
        "violations": list(_violations(recording, lasts)),
        "time_holding": _sum(lasts, ~stopped & (mode == Mode.HOLDING)),
        "time_freedrive": _sum(lasts, ~stopped & (mode == Mode.FREEDRIVE)),
        "time_stopped": _sum(lasts, stopped),
    }


def time_at_limits(recording: "Recording") -> dict[str, list[float]]:
    """The part of metrics.json about the time that each joint's effort was limited, s."""
    lasts = _lasts(recording)
    limited = recording.signals[:, Signal.SATURATED].astype(np.int64)
    return {
        f"time_at_{limit.name.lower()}_limit": [_sum(lasts, column & limit != 0) for column in limited.T]
        for limit in Limited
    }


def _stopped(recording: "Recording") -> NDArray[np.bool_]:
    """Samples with the safe effort, shape (samples,); at the sample of a fault, the mode is not STOPPED yet."""
    mode, fault = recording.status[:, Status.MODE], recording.status[:, Status.FAULT]
    return np.asarray((mode == Mode.STOPPED) | (fault != Fault.NO_FAULT))


def _lasts(recording: "Recording") -> NDArray[np.int64]:
    """Duration of each sample, ns, shape (samples,); for the last one, the median of the others."""
    periods = np.diff(recording.stamps_ns)
    return np.append(periods, round(float(np.median(periods))) if periods.size else 0)


def _sum(lasts: NDArray[np.int64], where: NDArray[np.bool_]) -> float:
    return int(lasts[where].sum()) / 1e9


def _faults(recording: "Recording") -> Iterator[dict[str, Any]]:
    faults = recording.status[:, Status.FAULT]
    for k in np.flatnonzero(np.diff(faults, prepend=0)):
        if not faults[k]:
            continue
        after = np.flatnonzero(faults[k:] == Fault.NO_FAULT)
        joint = int(recording.status[k, Status.FAULT_JOINT])
        yield {
            "fault": _name(int(faults[k])),
            "time": float(recording.time[k]),
            "joint": recording.joints[joint - 1] if 0 < joint <= len(recording.joints) else None,
            "reset": float(recording.time[k + after[0]]) if after.size else None,
            "limited": _limited_before(recording, int(k)) if faults[k] in _LEFT_ITS_WAY else [],
        }


def _limited_before(recording: "Recording", sample: int) -> list[str]:
    """Joints whose effort was at its limit for long before a sample: often why another joint has left its way."""
    before = slice(int(np.searchsorted(recording.time, recording.time[sample] - BEFORE_FAULT)), sample)
    limited = recording.signals[before, Signal.SATURATED].astype(np.int64) & Limited.EFFORT != 0
    shares = limited.mean(axis=0) if len(limited) else np.zeros(len(recording.joints))
    return [joint for joint, share in zip(recording.joints, shares, strict=True) if share > LIMITED_BEFORE]


def _name(fault: int) -> str:
    try:
        return Fault(fault).name.lower()
    except ValueError:  # recorded with another version
        return f"fault_{fault}"


def _violations(recording: "Recording", lasts: NDArray[np.int64]) -> Iterator[dict[str, Any]]:
    for violation, limit in LIMITS.items():
        exceeded = recording.status[:, Status.VIOLATIONS] & violation != 0
        if exceeded.any():
            first = float(recording.time[exceeded.argmax()])
            yield {"limit": limit, "time": first, "duration": _sum(lasts, exceeded)}


# As text.


def what_happened(metrics: Mapping[str, Any]) -> list[str]:
    """Everything unusual in a run, one sentence each.

    Args:
        metrics: as in metrics.json.
    """
    events = list(sources(metrics))
    events += [] if metrics["outcome"] == FOLLOWED else [_outcome(metrics)]
    events += [_fault(fault) for fault in metrics["faults"]]
    found = map(from_json, metrics.get("found") or ())  # Metrics of older versions lack it.
    events += [each.text for each in statements(found)]
    for violation in metrics["violations"]:
        limit, time, duration = (violation[key] for key in ("limit", "time", "duration"))
        events.append(f"a joint was beyond limits.{limit} for {duration:.4g} s, first at {time:.4g} s")
    for state, text in (("holding", "holding"), ("freedrive", "in freedrive"), ("stopped", "stopped")):
        if time := metrics.get(f"time_{state}"):  # Metrics of older versions lack freedrive.
            events.append(f"{text} for {time:.4g} s of {metrics['duration']:.4g} s")
    if rejected := [f"{node} {count}" for node, count in (metrics["rejected"] or {}).items() if count]:
        events.append(f"messages rejected: {', '.join(rejected)}")
    if lost := [f"{topic} {count}" for topic, count in metrics["lost"].items() if count]:
        events.append(f"incomplete recording, missing messages: {', '.join(lost)}")
    return events


def sources(metrics: Mapping[str, Any]) -> Iterator[str]:
    """What the metrics were computed from, if that is not the ground truth and all topics of a run.

    Args:
        metrics: as in metrics.json; those of older versions lack it.
    """
    if (truth := metrics.get("truth", GROUND_TRUTH)) != GROUND_TRUTH:
        yield f"truth: {truth}"
    if side := metrics.get("side"):
        yield f"the joints are elastic; positions and errors are those of the {side}s"
    if lacking := metrics.get("lacking"):
        unknown = "; faults, limits and gains are unknown" if "controller/state" in lacking else ""
        yield f"not in the bag: {', '.join(lacking)}{unknown}"


_OUTCOMES = {
    RAN_AWAY: f"ran away: a joint was more than {ASTRAY:.3g} {{unit}} from its reference",
    HELD: "does not follow at the end: holds its position, on request or because the reference is missing or too old",
    FREED: "does not follow at the end: is in freedrive",
    STOPPED: "does not follow at the end: stopped, with the safe torque",
}


def why_not_followed(metrics: Mapping[str, Any]) -> str:
    """Why the controller does not follow at the end, in one sentence; empty if it does.

    Args:
        metrics: as in metrics.json.
    """
    if metrics["outcome"] == FOLLOWED:
        return ""
    faults: Sequence[Mapping[str, Any]] = metrics["faults"]
    if metrics["outcome"] == STOPPED and faults:
        return _fault(faults[-1])
    return _outcome(metrics)


def _outcome(metrics: Mapping[str, Any]) -> str:
    if metrics["outcome"] == STRAYED:
        far = metrics["strayed"]
        return (
            f"strayed: {far['joint']} was {far['error']:.3g} {far['unit']} from its reference at {far['time']:.4g} s, "
            f"{100.0 * far['share']:.0f} % of its range; a run with more than {100.0 * SHARE_OF_RANGE:g} % has not "
            "followed"
        )
    if metrics["outcome"] == OVERLOADED:
        return f"does not follow: {overload_text(metrics['overloaded'])}"
    units = joint_units(metrics["slides"], len(metrics["joints"]))
    text = _OUTCOMES[metrics["outcome"]].format(unit=either(unit.position for unit in units))
    overloaded = metrics.get("overloaded")  # Metrics of older versions lack it.
    return f"{text}; {overload_text(overloaded)}" if overloaded else text


def is_rough(metrics: Mapping[str, Any]) -> bool:
    """Whether the largest error at the end is beyond `ROUGH`.

    Args:
        metrics: as in metrics.json.
    """
    return max((error or 0.0 for error in metrics["steady_state_error"]), default=0.0) > ROUGH


def verdict(metrics: Mapping[str, Any]) -> str:
    """The run in one sentence: whether it followed, how well, or why not.

    Args:
        metrics: as in metrics.json.
    """
    if reason := why_not_followed(metrics):
        return reason
    units = joint_units(metrics["slides"], len(metrics["joints"]))
    errors, saturation = metrics["steady_state_error"], metrics["saturation"]
    worst = max(range(len(errors)), key=lambda joint: errors[joint] or 0.0)
    most = max(range(len(saturation)), key=lambda joint: saturation[joint])
    joint = metrics["joints"][most]
    limited = f", but {joint} was at a limit of its effort {100.0 * saturation[most]:.0f} % of the time"
    roughly = " roughly" if is_rough(metrics) else ""
    text = FOLLOWED + roughly + (limited if saturation[most] >= NOTABLE_SATURATION else "")
    within = quantity(errors[worst], units[worst].position)
    return f"{text}; within {within} {IN_THE_END} ({metrics['joints'][worst]})"


def _fault(fault: Mapping[str, Any]) -> str:
    number = next((f for f in Fault if f.name.lower() == fault["fault"]), None)
    reason = cause(number, 1, [fault["joint"] or "a joint"]) if number else str(fault["fault"])
    limited = fault.get("limited")  # Metrics of older versions lack it.
    before = f", after {enumeration(limited)} had been at the effort limit" if limited else ""
    reset = "" if fault["reset"] is None else f"; reset at {fault['reset']:.4g} s"
    return f"stopped at {fault['time']:.4g} s: {reason}{before}{reset}"
