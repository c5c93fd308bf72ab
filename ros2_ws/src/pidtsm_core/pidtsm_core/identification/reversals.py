"""Above which velocity the friction of a joint follows from its velocity, as far as the data tell."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.identification.base_parameters import BaseParameters
from pidtsm_core.identification.least_squares import motion_regressor
from pidtsm_core.identification.measurement import FAST, Measurement, Piece, filtered
from pidtsm_core.robots import Description

_STEPS = 5
"""Velocities that are tried: `FAST` and its doubles."""
_WORSE = 2.0
"""Ratio of residuals with slow motion and without, above which slow motion does not follow the model of friction."""
_NEGLIGIBLE = 1e-4
"""Residual that does not matter, as a share of the effort."""
_KEPT = 0.25
"""Least share of the usable samples that must remain, so that those that remain still show the parameters."""
_SAMPLES = 5.0
"""Likewise, least number of samples for each parameter."""


def without_slow_motion(
    tree: Array, base: BaseParameters, measurements: Sequence[Measurement], cutoff: float
) -> list[Measurement]:
    """The measurements with `Measurement.slowest` raised where slow motion does not follow the model of friction.

    Around standstill, friction depends on more than the velocity: joints creep before they slide (Armstrong-Helouvry,
    Dupont and Canudas de Wit, Automatica 30, 1994, sections 2.2 and 2.3), and with the low inertia of a wrist, this
    reaches far. Each joint alone is fitted by ordinary least squares with more and more of its slow motion left out;
    as long as that halves a residual that matters, it is.

    Args:
        tree: geometry, see `tree.layout`, shape (size(joints),).
        base: base parameters of the arm.
        measurements: with the joints of the arm in its order.
        cutoff: bandwidth, Hz.
    """
    pieces = [piece for each in measurements for piece in filtered(each, cutoff)]
    if not pieces:
        return list(measurements)
    joints = pieces[0].usable.shape[1]
    rows = np.concatenate([motion_regressor(tree, piece.motion)[..., base.columns] for piece in pieces])
    rates, efforts = (
        np.concatenate([getattr(piece.motion, name) for piece in pieces]) for name in ("effort_rate", "effort")
    )
    speeds = FAST * 2.0 ** np.arange(_STEPS)
    usable = np.stack([_usable(measurements, pieces, speed, cutoff) for speed in speeds])
    slowest = np.full(joints, FAST)
    for j in range(joints):
        system = np.column_stack([rows[:, j], rates[:, j]])
        errors = _residuals(system, efforts[:, j], usable[..., j])
        enough = _WORSE * errors.min() + _NEGLIGIBLE * np.sqrt(np.mean(efforts[:, j] ** 2))
        slowest[j] = speeds[np.flatnonzero(errors <= enough)[0]]
    return [replace(each, slowest=slowest) for each in measurements]


def left_out(arm: Description, measurements: Sequence[Measurement]) -> tuple[str, ...]:
    """A sentence for each joint of which `without_slow_motion` has left out more than `FAST` does.

    Args:
        arm: its description.
        measurements: as returned; there is at least one.
    """
    slowest = np.broadcast_to(measurements[0].slowest, len(arm.joints))
    return tuple(
        f"{joint}: below {speed:.2g} {'m' if slides else 'rad'}/s, its friction does not follow the model of Coulomb "
        "and viscous friction; slower motion is not used"
        for joint, speed, slides in zip(arm.joints, slowest, arm.slides, strict=True)
        if speed > FAST
    )


def _usable(
    measurements: Sequence[Measurement], pieces: Sequence[Piece], speed: float, cutoff: float
) -> NDArray[np.bool_]:
    """Usable samples of all pieces without motion that is slower, shape (samples, joints)."""
    if speed == FAST:
        return np.concatenate([piece.usable for piece in pieces])
    slower = [replace(each, slowest=np.full(len(each.joints), speed)) for each in measurements]
    return np.concatenate([piece.usable for each in slower for piece in filtered(each, cutoff)])


def _residuals(system: Array, targets: Array, usable: NDArray[np.bool_]) -> Array:
    """Root mean square of what the samples of each row of `usable` leave; infinite where too few remain."""
    active = system[:, np.abs(system).max(axis=0) > 0.0]
    size = np.linalg.norm(active, axis=0)
    errors = np.full(len(usable), np.inf)
    least = max(_KEPT * np.count_nonzero(usable[0]), _SAMPLES * active.shape[1])
    for i, used in enumerate(usable):
        if np.count_nonzero(used) >= least or i == 0:
            chosen = active[used] / size
            solution = np.linalg.lstsq(chosen, targets[used], rcond=None)[0]
            freedom = max(1, len(chosen) - active.shape[1])
            errors[i] = np.sqrt(np.sum((chosen @ solution - targets[used]) ** 2) / freedom)
    return errors
