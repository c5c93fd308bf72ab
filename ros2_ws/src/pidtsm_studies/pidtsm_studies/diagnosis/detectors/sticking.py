"""Stick-slip, from a joint that stands still and leaps while it should move steadily.

Where static friction exceeds Coulomb friction, a joint that moves slowly sticks until its effort, which grows with the
error, exceeds static friction, and then moves faster than it should until it sticks again. A joint that only reverses
sticks once per reversal. So what counts is how often a joint changes from standing still to leaping between reversals.
What never moves, although it should, sticks as well. Where a drive is at its limit, joints stand still and run after
their reference for lack of effort; there, only what stands most of the time and leaps far counts. Where a loop rings
violently, no friction holds it.
"""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict

_STILL, _LEAPS = 0.2, 1.6
"""Shares of the desired velocity below which a joint stands still, and above which it leaps."""
_SLOWEST = 0.004
"""rad/s or m/s; desired velocities that count."""
_COARSE = 0.01
"""s between the velocities that are judged."""
_LARGEST = 0.12
"""Leaps per second of motion that need no mention."""
_SHARE, _SHARE_OF_SHORT = 0.4, 0.7
"""Share of the time in motion for which a joint must stand still; the same where a drive is short of effort."""
_ALWAYS = 0.95
"""The same share of a joint that sticks without a leap."""
_UNEVEN, _UNEVEN_OF_SHORT = 1.2, 4.0
"""Deviation of the velocity from the desired one, relative to that one's own: that of a joint which leaps far; the same
where a drive is short of effort."""
_CURE = (
    "let the controller learn the friction: --params adaptive; or compensate what ./pidtsm identify finds; grease and "
    "warm up the gear"
)
_CURE_OF_STANDING = f"look whether its brake is open and its drive is on; if so, {_CURE}"


def stick_slip(loop: Loop, saturated: bool, rings: bool) -> Verdict:
    """Count the leaps of each joint; `saturated`: a drive is at its limit; `rings`: the loop does, violently."""
    every = max(1, round(_COARSE / loop.period))
    wanted, velocity, time = loop.desired_velocity[::every], loop.velocity[::every], loop.time[::every]
    each = [leaps(w, v, every * loop.period) for w, v in zip(wanted.T, velocity.T, strict=True)]
    rate, share = np.array(each).T
    uneven = np.std(velocity - wanted, axis=0) / (np.std(wanted, axis=0) + 1e-9)
    least, farthest = (_SHARE_OF_SHORT, _UNEVEN_OF_SHORT) if saturated else (_SHARE, _UNEVEN)
    stands = (share > _ALWAYS) & (not saturated)
    is_one = ((rate > _LARGEST) & (share > least) & (uneven > farthest)) | stands
    is_one &= not rings
    sticks = [int(j) for j in np.lexsort((-rate, ~stands)) if is_one[j]]
    worst = sticks[0] if sticks else int(rate.argmax())
    unit = loop.observed.units[worst].position
    name = loop.joints[worst]
    text, cure = "no joint sticks while it should move", ""
    if sticks and stands[worst]:
        text, cure = f"{name} does not move although it should", _CURE_OF_STANDING
    elif sticks:
        text, cure = f"{name} sticks and leaps {rate[worst]:.2g} times a second", _CURE
    curves = (Curve("measured", time, velocity[:, worst]), Curve("desired", time, wanted[:, worst]))
    return Verdict(
        Cause.STICK_SLIP,
        State.FOUND if sticks else State.FINE,
        text,
        tuple(loop.joints[j] for j in sticks),
        float(rate[worst]),
        _LARGEST,
        "1/s",
        cure,
        (Plot(f"Velocity of {loop.joints[worst]}", "time [s]", f"{unit}/s", curves),),
    )


def leaps(wanted: Array, velocity: Array, period: float) -> tuple[float, float]:
    """Leaps per second of motion, and the share of that time in which the joint stands still.

    Args:
        wanted: desired velocity, shape (samples,), rad/s or m/s.
        velocity: measured one, likewise.
        period: s.
    """
    moving = np.abs(wanted) > max(_SLOWEST, 0.25 * float(np.abs(wanted).max(initial=0.0)))
    if np.count_nonzero(moving) * period < 1.0:
        return 0.0, 0.0
    ratio = np.where(moving, velocity / np.where(moving, wanted, 1.0), 1.0)
    state, count = 0, 0
    # -1: has stood still, 1: has leapt, 0: neither since it began to move.
    for still, leap, moves in zip(ratio < _STILL, ratio > _LEAPS, moving, strict=True):
        if not moves:
            state = 0
        elif still:
            state = -1
        elif leap and state == -1:
            state, count = 1, count + 1
    time = np.count_nonzero(moving) * period
    return count / time, float(np.mean(ratio[moving] < _STILL))
