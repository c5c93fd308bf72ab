"""A joint whose effort limit is too low for what it should do."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording.metrics import STEADY_SHARE
from pidtsm_core.robots import find_robot, inverse_dynamics, make_model
from pidtsm_core.signals import Limited, Signal

if TYPE_CHECKING:
    from pidtsm_core.recording import Recording

TIME, ERROR = 0.5, 0.02
"""A joint is overloaded if it ends the run by more than this share of its range away from its reference, and at its
effort limit for more than this share of the last part, or at times if the limit does not carry the arm."""

_SHORTEST = 2.0
"""A shorter run may still be on its way to its reference, s."""


def overload(recording: "Recording", ranges: Array) -> dict[str, Any] | None:
    """The overloaded joint that is farthest from its reference in the last part of the run; None: there is none.

    Args:
        recording: the run.
        ranges: of the joints, shape (joints,), rad or m.

    Returns:
        Joint, share of the time at the limit, largest error, effort that carries the arm at rest (None: unknown), limit
        and units.
    """
    begin, end = recording.time[[0, -1]]
    if end - begin < _SHORTEST:
        return None
    late = recording.time >= end - STEADY_SHARE * (end - begin)
    limited = recording.signals[late, Signal.SATURATED].astype(np.int64) & Limited.EFFORT != 0
    shares, errors = limited.mean(axis=0), np.abs(recording.error[late]).max(axis=0)
    limits = np.abs(recording.commanded_effort[late]).max(axis=0, where=limited, initial=0.0)
    if not (limited.any(axis=0) & (errors > ERROR * ranges)).any():
        return None
    at_rest = _effort_at_rest(recording)
    weak = limited.any(axis=0)
    weak &= False if at_rest is None else np.abs(at_rest) > limits
    # Of a joint that cannot carry the arm, even if another one is farther away.
    far = np.where(weak if weak.any() else shares > TIME, errors / ranges, 0.0)
    if far.max() <= ERROR:
        return None
    joint = int(np.argmax(far))
    return {
        "joint": recording.joints[joint],
        "share": float(shares[joint]),
        "error": float(errors[joint]),
        "at_rest": None if at_rest is None else float(abs(at_rest[joint])),
        "limit": float(limits[joint]),
        "unit": recording.units[joint].position,
        "effort_unit": recording.units[joint].effort,
    }


def _effort_at_rest(recording: "Recording") -> Array | None:
    """Effort that carries the arm at its last reference, shape (joints,), N m or N; None if its model is not known."""
    try:
        robot = find_robot(recording.robot) if recording.robot else None
    except ParameterError:  # The description may be gone.
        return None
    if robot is None or robot.joints != recording.joints:
        return None
    values: dict[str, Any] = {f"robot.{parameter.name}": parameter.default for parameter in robot.parameters}
    values.update(recording.robot)
    model = make_model(robot, robot.pack_model(values))
    zero, effort = np.zeros(len(robot.joints)), np.zeros((1, len(robot.joints)))
    inverse_dynamics(model, recording.reference[-1, 0].copy(), zero, zero[np.newaxis], effort)
    return effort[0]


def overload_text(found: Mapping[str, Any]) -> str:
    """What `overload` found, in one sentence."""
    joint, limit, unit = found["joint"], found["limit"], found["effort_unit"]
    where = f"{found['error']:.3g} {found['unit']} from its reference"
    if found["at_rest"] is not None and found["at_rest"] > limit:
        return f"{joint} cannot carry the arm: {found['at_rest']:.3g} of {limit:.3g} {unit} at rest; it was {where}"
    share = f"{100.0 * found['share']:.0f} % of the last part of the run"
    return f"{joint} was at its effort limit of {limit:.3g} {unit} for {share}, and {where}"
