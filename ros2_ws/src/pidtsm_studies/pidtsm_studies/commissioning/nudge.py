"""Nudges of the first step: a torque that grows until a joint moves, and what slows the joint then."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.catch import Catch

NUDGE, NUDGE_TIME = 0.5, 1.0
"""Largest share of the effort limit of a nudge, and time in which it grows to that, s."""
_BRAKES, _BRAKE, _SLOWED = 0.04, 100.0, 0.2
"""A joint is slowed for so many s at most, at this rate in 1/s, until it has this share of its speed."""
_SLOPE = 4
"""Samples from which a speed is taken."""


def loosen(catch: Catch, j: int, side: float) -> tuple[float, Array | None]:
    """Push one joint until it moves; it shall be caught, or slowed, at once.

    Args:
        catch: the arm.
        j: the joint.
        side: 1 or -1, the direction of the torque.

    Returns:
        The torque at that moment, N m or N, and the way of each joint since the begin, shape (joints,), rad or m; None:
        it does not move.

    Raises:
        AwayError: a joint moves too far; commands have ceased.
    """
    bound = NUDGE * float(catch.model.effort[j])
    begin = np.mean([catch.step() for _ in range(5)], axis=0)
    count, extra, moved = max(2, round(NUDGE_TIME / catch.port.period)), np.zeros(begin.size), np.zeros(begin.size)
    catch.nudged = j
    while abs(moved[j]) <= catch.visible[j]:
        extra[j] += side * bound / count
        if abs(extra[j]) > bound:
            return bound, None
        moved = catch.step(extra) - begin
    catch.nudged = -1
    return float(abs(extra[j])), moved


def brake(catch: Catch, j: int, torque: float, way: float, most: float) -> None:
    """Slow a joint that a torque has just moved: what stuck would go on, and be too fast and too heavy for the catch.

    What friction held is light or slow enough to need no brake, and then friction exceeds this one.

    Args:
        catch: the arm; the sign of the joint is known.
        j: the joint.
        torque: that moved it, N m or N; the joint is at most as heavy as if nothing had resisted that.
        way: of the joint until now, rad or m.
        most: torque that may slow it, N m or N.
    """
    fastest, heaviest, extra = 0.0, 0.0, np.zeros(catch.start.size)
    for _ in range(max(2, round(_BRAKES / catch.port.period))):
        speed = speed_of(catch, j)
        fastest = max(fastest, abs(speed))
        heaviest = heaviest or 2.0 * torque * abs(way) / max(speed**2, 1e-9)
        if abs(speed) <= _SLOWED * fastest:
            break
        extra[j] = np.clip(-_BRAKE * heaviest * speed, -most, most)
        catch.step(extra)


def speed_of(catch: Catch, j: int) -> float:
    """Velocity of a joint in the last few samples, rad/s or m/s."""
    (before, earlier, _), (now, q, _) = catch.rows[-_SLOPE], catch.rows[-1]
    return float(q[j] - earlier[j]) / (now - before)
