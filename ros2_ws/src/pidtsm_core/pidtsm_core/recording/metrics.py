"""Metrics of a run: errors, effort, settling and chattering, each per joint."""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pidtsm_core.arrays import Array

STEADY_SHARE = 0.4
"""Share of the run, at its end, that counts as steady state."""

SETTLED_SHARE = 0.02
"""Share of the initial error below which a joint counts as settled."""

RECOVERED_ERROR = 1e-3
"""Error below which a joint counts as recovered from an event, rad or m."""

TORQUE_JUMP = 5.0
"""Change between consecutive samples above which the effort counts as jumping, N m or N."""

JointMetrics: TypeAlias = dict[str, list[float | None]]


def tracking_error(position: Array, desired: Array, continuous: Sequence[bool]) -> Array:
    """e = q - q_d, eq. (7), shape (samples, joints).

    That of a continuous joint begins with the shorter way, and the whole turns by which it jumps are removed, because
    an angle may be given within one turn.

    Args:
        position: q, shape (samples, joints), rad or m.
        desired: q_d, likewise.
        continuous: whether each joint is continuous; empty: none is.
    """
    error = position - desired
    for joint in np.flatnonzero(continuous):
        unwound = np.unwrap(error[:, joint])
        error[:, joint] = unwound - 2.0 * math.pi * np.round(unwound[0] / (2.0 * math.pi))
    return error


@np.errstate(over="ignore")
def metrics(
    time: ArrayLike, error: ArrayLike, effort: ArrayLike, saturated: ArrayLike, event_time: float | None = None
) -> JointMetrics:
    """Metrics of one run.

    Args:
        time: of the samples, s, shape (samples,), increasing.
        error: e = q - q_d, rad, shape (samples, joints).
        effort: applied effort, N m, shape (samples, joints).
        saturated: not 0 where the effort is at its limit, shape (samples, joints).
        event_time: time of an event that affects the arm, s, on the axis of `time`.

    Returns:
        One value per joint, None if it does not exist; for a joint that slides, rad is m, and N m is N:

        * max_error: max |e|, rad.
        * rmse: sqrt(mean(e^2)), rad, eq. (53).
        * eci: mean |tau|, N m, eq. (54).
        * steady_state_error: max |e| over the last 40 % of the run, rad.
        * settling_time: from the first sample until |e| stays below 2 % of its initial value, before the event, s.
        * recovery_time: from the event until |e| stays below 1e-3 rad, s; only with an event.
        * torque_variation: mean |tau_k - tau_(k-1)|, N m.
        * torque_variation_rate: the same divided by the mean period, N m/s, to compare runs at different rates.
        * torque_jumps: number of samples at which the effort changed by more than 5 N m.
        * saturation: share of the samples at a limit.

    Raises:
        ValueError: no samples, shapes that do not match, values that are not finite, or time that does not increase.
    """
    t, *tables = _checked(time, error, effort, saturated)
    since_start = t - t[0]
    late = int(np.searchsorted(since_start, (1.0 - STEADY_SHARE) * since_start[-1]))
    event = t.size if event_time is None else int(np.searchsorted(t, event_time))
    result: JointMetrics = {}
    # Joint by joint: sums over contiguous numbers take a third of the time, and an hour of samples needs little memory.
    for e, column, limited in zip(*(table.T for table in tables), strict=True):
        tau = np.ascontiguousarray(column)
        magnitude = np.abs(np.ascontiguousarray(e))
        steps = np.abs(np.diff(tau))
        of_joint: dict[str, float | None] = {
            "max_error": float(magnitude.max()),
            "rmse": float(np.sqrt(np.mean(magnitude**2))),
            "eci": float(np.mean(np.abs(tau))),
            "steady_state_error": float(magnitude[late:].max()),
            "settling_time": _stays_below(since_start[:event], magnitude[:event], SETTLED_SHARE * magnitude[0]),
        }
        if event_time is not None:
            of_joint["recovery_time"] = _stays_below(t[event:] - event_time, magnitude[event:], RECOVERED_ERROR)
        of_joint["torque_variation"] = float(steps.mean()) if steps.size else None
        of_joint["torque_variation_rate"] = float(steps.sum() / since_start[-1]) if steps.size else None
        of_joint["torque_jumps"] = int(np.count_nonzero(steps > TORQUE_JUMP))
        of_joint["saturation"] = float(np.mean(limited != 0.0))
        for name, value in of_joint.items():
            result.setdefault(name, []).append(value)
    return result


def finite(value: Any) -> Any:
    """A value of metrics.json, with None instead of numbers that are not finite, which JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: finite(each) for name, each in value.items()}
    return [finite(each) for each in value] if isinstance(value, list) else value


def _stays_below(time: Array, magnitude: Array, threshold: float) -> float | None:
    """First time from which `magnitude` stays below `threshold` to the end; None if there is no such time."""
    above = np.flatnonzero(magnitude >= threshold)
    first = above[-1] + 1 if above.size else 0
    return float(time[first]) if first < time.size else None


def _checked(*arrays: ArrayLike) -> tuple[Array, ...]:
    time, *tables = (np.asarray(array, dtype=np.float64) for array in arrays)
    if time.ndim != 1 or time.size == 0:
        raise ValueError(f"time must have shape (samples,) with at least one sample, not {time.shape}")
    for table in tables:
        if table.ndim != 2 or table.shape != (time.size, tables[0].shape[1]):
            raise ValueError(
                f"error, effort and saturated must have shape ({time.size}, joints), not "
                + ", ".join(str(t.shape) for t in tables)
            )
    if not all(np.isfinite(array).all() for array in (time, *tables)):
        raise ValueError("time, error, effort and saturated must be finite")
    if np.any(np.diff(time) <= 0.0):
        raise ValueError("time must increase from sample to sample")
    return time, *tables
