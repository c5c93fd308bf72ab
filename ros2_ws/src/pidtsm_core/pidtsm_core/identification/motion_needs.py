"""Which motion a measurement lacks: of which joints, of which kind, and for how long."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.identification.measurement import FAST, SETTLING, SLOW, Measurement, Piece, joined
from pidtsm_core.identification.regressor import regressor
from pidtsm_core.robots import Description
from pidtsm_core.robots.tree.unit_forces import LINK

LEAST_MOTION = 0.05
"""rad or m; a joint that moves less counts as standing still."""
_POSTURES = 0.3
"""rad; over less, the torque of gravity is nearly a constant and a slope."""
_SPEEDS = 2.0
"""Ratio of fast and slow velocities below which viscous and Coulomb friction look alike."""
_SLOWEST = 3.0 * FAST
"""rad/s or m/s; a joint that is never faster shows little of its viscous friction."""
_GENTLEST = 0.2
"""rad/s^2 or m/s^2; a joint that never accelerates more shows little of its inertia."""
_MOVING = 3.0
"""s; a joint that moves for less time shows too little of everything."""
_SHORT, _ENOUGH = 8.0, 20.0
"""s of usable data that need mention; s that are recommended."""
_KEPT = 0.8
"""Share of a measurement that is fitted."""


def cure(robot: str, duration: float = 60.0) -> str:
    """The command that makes a motion that lacks nothing; `robot` is what ``--robot`` names."""
    return f"./pidtsm excite --robot {robot} --duration {duration:.0f} --out motion.yaml makes such a motion"


def too_short(measured: Sequence[Measurement], cutoff: float) -> str:
    """Why nothing remains of the measurements after the filter with this bandwidth (Hz)."""
    settling = SETTLING / (SLOW * cutoff)
    longest = max(float(each.time[-1] - each.time[0]) for each in measured)
    enough = max(_ENOUGH, 5.0 * math.ceil(4.0 * settling / _KEPT / 5.0))
    return (
        f"{longest:.1f} s of motion are too short: the filter of a motion this slow ({cutoff:.2g} Hz) needs "
        f"{settling:.1f} s to settle at either end, and the last fifth judges the result; record {enough:.0f} s or more"
    )


def motion_needs(arm: Description, pieces: Sequence[Piece]) -> list[str]:
    """A sentence for the joints that stand still, for each whose motion does not show everything, and if it is short.

    Args:
        arm: its description.
        pieces: of all measurements, filtered; there is at least one, with samples.
    """
    motion = joined([piece.motion for piece in pieces])
    periods = [piece.time[1] - piece.time[0] for piece in pieces if piece.time.size > 1]
    period = float(np.median(periods)) if periods else 0.0
    usable = period * len(motion.position)
    if usable < _SHORT:
        return [f"only {usable:.1f} s of motion remain after the filter; record at least {_ENOUGH:.0f} s"]
    turns, moving = _postures_matter(arm, motion.position), moves_enough(motion.position)
    still = ", ".join(joint for joint, moves in zip(arm.joints, moving, strict=True) if not moves)
    needs = [f"these joints do not move enough (less than {LEAST_MOTION:g} rad or m): {still}"] if still else []
    for j, joint in enumerate(arm.joints):
        unit = "m" if arm.slides[j] else "rad"
        q, speed = motion.position[:, j], np.abs(motion.velocity[:, j])
        moves = float(np.ptp(np.percentile(q, (1.0, 99.0))))
        if not moving[j]:
            continue
        lacks = list(_lacks(speed, np.abs(motion.acceleration[:, j]), period, unit))
        if turns[j] and moves < _POSTURES:
            lacks.append(
                f"different postures for gravity (it covers {moves:.2g} rad of the {_POSTURES:g} rad that show it)"
            )
        if lacks:
            needs.append(f"the motion of {joint} lacks {'; '.join(lacks)}")
    return needs


def moves_enough(positions: Array) -> NDArray[np.bool_]:
    """Whether joints count as moving; positions have shape (samples, joints), rad or m."""
    low, high = np.percentile(positions, (1.0, 99.0), axis=0)
    return np.asarray(high - low >= LEAST_MOTION)


def _lacks(speed: Array, acceleration: Array, period: float, unit: str) -> list[str]:
    """What the motion of a joint that moves does not show of friction and inertia."""
    lacks, fast = [], speed[speed > FAST]
    if fast.size * period < _MOVING:
        lacks.append(
            f"time in motion ({fast.size * period:.1f} s faster than {FAST:g} {unit}/s; {_MOVING:g} s or more)"
        )
    else:
        slow, quick = np.percentile(fast, (10.0, 90.0))
        if quick < _SLOWEST or quick < _SPEEDS * slow:
            lacks.append(
                f"a range of velocities for friction ({slow:.2g} to {quick:.2g} {unit}/s; slow motion, and "
                f"{max(_SLOWEST, _SPEEDS * slow):.2g} {unit}/s or more)"
            )
    if (most := float(np.percentile(acceleration, 99.0))) < _GENTLEST:
        lacks.append(f"acceleration for inertia ({most:.2g} {unit}/s^2 at most; {_GENTLEST:g} or more)")
    return lacks


def _postures_matter(arm: Description, positions: Array) -> list[bool]:
    """Whether gravity turns a joint about its axis by a torque that depends on its own position."""
    few = positions[np.linspace(0, len(positions) - 1, min(20, len(positions))).astype(int)]
    still, joints = 0.0 * few, few.shape[1]
    matters = []
    for j in range(joints):
        turned = few.copy()
        turned[:, j] += 1.0
        columns = [regressor(arm.tree, q, still, still)[:, j, : LINK * joints] for q in (few, turned)]
        matters.append(bool(np.abs(columns[1] - columns[0]).max() > LEAST_MOTION and not arm.slides[j]))
    return matters
