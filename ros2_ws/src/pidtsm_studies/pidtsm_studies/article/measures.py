"""Quantities of the article's claims, each for one joint of one run."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from pidtsm_core.recording import Recording
from pidtsm_core.recording.metrics import STEADY_SHARE
from pidtsm_studies.article.printed import PRINTED

Measure: TypeAlias = Callable[[Recording, Mapping[str, Any], int], float | None]
"""Computes one value of one joint of a run: None if it does not exist, inf for a time that was not reached.

Arguments: the run, its metrics (`Recording.metrics`), and the index of the joint.
"""

_TIMES = ("settling_time", "recovery_time")
"""Metrics that are None if the run ends too early, and missing if there is no event to recover from."""


def measure(name: str) -> Measure:
    """The function that computes a claim's metric.

    Args:
        name: one of `MEASURES`, or a metric of `Recording.metrics`; the function raises KeyError if a run lacks it.
    """
    return MEASURES.get(name) or partial(_metric, name)


def _metric(name: str, recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    if name in _TIMES and name not in metrics:
        return None
    value: float | None = metrics[name][joint]
    return math.inf if value is None and name in _TIMES else value


def _steady_state_time(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Time from the first sample until |e| stays below the article's steady-state error, s."""
    above = np.flatnonzero(np.abs(recording.error[:, joint]) >= PRINTED["steady_state_error"][joint])
    first = above[-1] + 1 if above.size else 0
    return float(recording.time[first] - recording.time[0]) if first < recording.time.size else math.inf


def _largest_torque(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Largest |tau| of the run, N m."""
    return float(np.abs(recording.effort[:, joint]).max())


def _largest_error_time(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Time from the first sample until the largest |e| of the run, s."""
    return float(recording.time[np.abs(recording.error[:, joint]).argmax()] - recording.time[0])


def _overshoot(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Largest error with the opposite sign of the initial error, within the article's 6 s of transient, rad."""
    error = recording.error[recording.time - recording.time[0] <= PRINTED["transient"], joint]
    return float(max(0.0, (-np.sign(error[0]) * error).max()))


def _error_variation(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Mean change of the error from sample to sample over the last 40 % of the run, rad."""
    return float(np.abs(np.diff(recording.error[_steady(recording), joint])).mean())


def _steady_torque(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Median |tau| over the last 40 % of the run, N m; not affected by spikes."""
    return float(np.median(np.abs(recording.effort[_steady(recording), joint])))


def _error_after_event(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Largest |e| from the event on, rad."""
    if recording.event_time is None:
        return None
    return float(np.abs(recording.error[recording.time >= recording.event_time, joint]).max(initial=0.0))


def _steady(recording: Recording) -> slice:
    """Samples of the steady state."""
    return slice(int(recording.time.size * (1.0 - STEADY_SHARE)), None)


MEASURES: Mapping[str, Measure] = {
    "steady_state_time": _steady_state_time,
    "largest_torque": _largest_torque,
    "largest_error_time": _largest_error_time,
    "overshoot": _overshoot,
    "error_variation": _error_variation,
    "steady_torque": _steady_torque,
    "error_after_event": _error_after_event,
}
"""Quantities of the claims that are not among the metrics of a run, by name."""
