"""The largest excess of effort along a motion, found so that none slips between samples.

In an interval of time, a polynomial differs from its value in the middle by at most the sum of its other Taylor terms
at the ends. That puts q, q' and q'' of all joints into a box around the sampled state, and `effort_spread` bounds how
far the efforts in this box are from the sampled ones. An interval is done when samples plus bound are within the limits
and their tolerance; otherwise it is halved, and the bound falls at least in proportion. So it does not matter how short
a segment is, or where in it the effort is largest: a motion is accepted only if the bound proves it for every moment of
it, and rejected only if a sample exceeds its limit.

Where the velocity has a step, as between straight lines, the effort is that which makes the step in `STEP_TIME`.
"""

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, subroutine
from pidtsm_core.robots import Model, effort_spread, inverse_dynamics

TOLERANCE = 0.01
"""An effort may exceed its limit by up to this share between the samples."""
_EXACT = 1e-5
"""Largest error of the excess that is reported, as a share of the limit."""
STEP_TIME = 0.2
"""Time in which the effort limit must allow a step of the velocity, s."""
_DEPTH = 48
_MOMENT = 2.0 ** (1 - _DEPTH)
"""Half the width of an interval that is a moment, as a share of its segment."""
_STEP = 1e-6
"""Smaller steps of the velocity do not matter, rad/s or m/s."""
_ENOUGH = 4000
"""Number of samples after which the largest excess of a motion that is rejected anyway is exact enough."""


@inlined
def _taylor(c: Array, interval: Array, duration: float, middle: Array, box: Array, j: int) -> None:
    """Write q, q', q'' of a joint in the middle of an interval, and how far they are from that within it.

    `c` has the coefficients of the powers 0 to 5 of the share of a segment that has passed, `interval` the share in the
    middle and half the width; `middle` and `box` have the shape (3, joints).
    """
    x, half = interval[0], interval[1]
    power, r, dr, ddr = 1.0, 0.0, 0.0, 0.0
    for k in range(6):
        # The derivative of order k divided by k!, by Horner's scheme with binomials.
        value = 0.0
        for i in range(5, k - 1, -1):
            binomial = 1.0
            for m in range(k):
                binomial *= (i - m) / (m + 1.0)
            value = value * x + binomial * c[i]
        if k == 0:
            middle[0, j] = value
        else:
            r += abs(value) * power * half
            if k == 1:
                middle[1, j] = value / duration
            else:
                dr += k * abs(value) * power
                if k == 2:
                    middle[2, j] = 2.0 * value / (duration * duration)
                elif half > 0.0:
                    ddr += k * (k - 1) * abs(value) * power / half
            power *= half
    box[0, j], box[1, j], box[2, j] = r, dr / duration, ddr / (duration * duration)


@inlined
def _measure(model: Model, states: Array, limit: Array, places: NDArray[np.int_], time: float, worst: Array) -> bool:
    """Compute efforts and their spread, keep the largest excess, and return whether the interval is to be halved.

    `states` has middle and box of the state, then rows for efforts and spread, shape (10, joints). All are in the order
    of the joints of the model, `limit` is in that of `places`. `worst` is that of `largest_excess`.
    """
    q, dq, ddq, efforts, spread = states[0], states[1], states[2:3], states[6:7], states[7:10]
    inverse_dynamics(model, q, dq, ddq, efforts)
    effort_spread(model, q, dq, states[2], states[3:6], spread)
    for i in range(q.size):
        excess = abs(efforts[0, i]) - limit[places[i]]
        if excess > worst[0]:
            worst[0], worst[1], worst[2], worst[3] = excess, places[i], efforts[0, i], time
    for i in range(q.size):
        most = limit[places[i]] * (1.0 + (TOLERANCE if worst[0] == 0.0 else _EXACT))
        # Written so that numbers that are not finite count as too large.
        if not abs(efforts[0, i]) + spread[0, i] <= most + worst[0]:
            return True
    return False


@inlined
def _step(c: Array, at_end: Array, rest: bool, duration: tuple[float, float], states: Array, i: int) -> float:
    """Write the state of joint i at the end of a segment; returns the step of the velocity there.

    `at_end` and `c` have the coefficients before and after, `rest` is whether the motion ends there instead.
    """
    total = slope = 0.0
    for k in range(6):
        total += at_end[k]
        slope += k * at_end[k]
    before, after = slope / duration[0], 0.0 if rest else c[1] / duration[1]
    states[0, i], states[1, i], states[2, i] = total, before, (after - before) / STEP_TIME
    states[3, i] = states[4, i] = states[5, i] = 0.0
    return abs(after - before)


@subroutine
def largest_excess(
    p: Array, model: Model, places: NDArray[np.int_], limit: Array, states: Array, intervals: Array, worst: Array
) -> None:
    """Write the largest excess of effort beyond its limit: excess, joint, value and time (s); zeros: there is none.

    Args:
        p: the motion, as `PiecewiseMotion.parameters`.
        model: of the arm; its parameters are overwritten.
        places: index in the motion of each joint of the model.
        limit: of the efforts, shape (joints,), N m or N.
        states: scratch, shape (10, joints).
        intervals: scratch, shape (50, 2).
        worst: result, shape (4,), which begins with zeros.
    """
    n, samples = (p.shape[1] - 1) // 7, 0
    for k in range(n):
        start, duration, first = p[0, k], p[0, k + 1] - p[0, k], n + 1 + 6 * k
        intervals[0, 0] = intervals[0, 1] = 0.5
        waiting = 1
        while waiting > 0:
            waiting -= 1
            x, half = intervals[waiting, 0], intervals[waiting, 1]
            for i in range(places.size):
                c = p[places[i], first : first + 6]
                _taylor(c, intervals[waiting], duration, states[:3], states[3:6], i)
            samples += 1
            halved = _measure(model, states, limit, places, start + x * duration, worst)
            if halved and half > _MOMENT and (worst[0] == 0.0 or samples < _ENOUGH):
                intervals[waiting, 0], intervals[waiting + 1, 0] = x + 0.5 * half, x - 0.5 * half
                intervals[waiting, 1] = intervals[waiting + 1, 1] = 0.5 * half
                waiting += 2
        last, step = k == n - 1, 0.0
        following = first if last else first + 6
        durations = (duration, duration if last else p[0, k + 2] - p[0, k + 1])
        for i in range(places.size):
            c, before = p[places[i], following : following + 6], p[places[i], first : first + 6]
            step = max(step, _step(c, before, last, durations, states, i))
        if step > _STEP:
            _measure(model, states, limit, places, p[0, k + 1], worst)
