"""Nudges of the first step: a torque that grows until a joint moves, and what slows the joint then."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.arm import CommissionError
from pidtsm_studies.commissioning.catch import Catch

_NUDGE, _NUDGE_TIME = 0.5, 1.0
"""Largest share of the effort limit of a nudge, and time in which it grows to that, s."""
_BRAKES, _BRAKE, _SLOWED = 0.04, 100.0, 0.2
"""A joint is slowed for so many s at most, at this rate in 1/s, until it has this share of its speed."""
_SLOPE = 4
"""Samples from which a speed is taken."""
_QUIET, _FAST, _BRAKING = 0.15, 0.2, 0.75
"""Time between nudges, s; a nudged joint that is faster, in rad/s or m/s, is slowed by this share of its nudge at most.
"""
_ODD, _ODD_SHARE, _MUCH = 2.0, 0.06, 0.25
"""A joint sticks that takes so many times the others' share of its limit to break away, and so much; or this much."""


def nudge(catch: Catch, breakaway: Array) -> list[str]:
    """Nudge each joint that does not move by itself; returns problems.

    Args:
        catch: the arm.
        breakaway: gets the torques at which these joints moved, shape (joints,), N m or N.

    Raises:
        CommissionError: a joint does not move.
        AwayError: a joint moves too far; commands have ceased.
    """
    problems = []
    for j in range(breakaway.size):
        for _ in range(max(1, round(_QUIET / catch.port.period))):
            catch.step()
        if not catch.caught[j]:
            problem = _nudge(catch, j, breakaway)
            problems += [problem] if problem else []
    return problems


def _nudge(catch: Catch, j: int, breakaway: Array) -> str:
    """Push joint j until it moves; returns a problem or an empty text.

    Args:
        catch: the arm.
        j: the joint.
        breakaway: gets the torque at which it moved, shape (joints,), N m or N.

    Raises:
        CommissionError: it does not move.
    """
    name = catch.model.joints[j]
    torque, moved = loosen(catch, j, 1.0)
    if moved is None:
        raise CommissionError(
            f"{name} does not move with {torque:.3g} beside what carries it: is its drive on, its brake open, and "
            "does anything block it?"
        )
    if moved[j] < 0.0:
        catch.tell(f"the sign of {name} is inverted (it moved against its nudge)")
        catch.invert(j, carried=True)
    catch.sure[j] = True
    # The way to where it shows takes torque, too, which grows steadily: way = slope t^3 / (6 inertia).
    slope, inertia = _NUDGE * catch.model.effort[j] / _NUDGE_TIME, float(catch.inertia[j, j])
    breakaway[j] = max(torque - (6.0 * inertia * slope**2 * float(catch.visible[j])) ** (1.0 / 3.0), 0.0)
    slow(catch, j, torque, float(moved[j]))
    others = np.abs(moved / catch.visible)
    others[j] = 0.0
    catch.catch(j)
    if others.max() <= 3.0:
        return ""
    return f"a nudge of {name} moves {catch.model.joints[int(others.argmax())]} more: is the order of the joints right?"


def sticking(catch: Catch, breakaway: Array) -> list[str]:
    """Sentences about nudged joints that take much of their limit to break away, or much more than the others.

    Args:
        catch: the arm.
        breakaway: torque at which each joint moved, NaN where none was needed, shape (joints,), N m or N.
    """
    share, problems = breakaway / catch.model.effort, []
    for j in np.flatnonzero(share > _ODD_SHARE):
        others = np.delete(share, j)
        others = others[np.isfinite(others)]
        usual = float(np.median(others)) if others.size else np.inf
        if share[j] > min(_ODD * usual, _MUCH):
            known = 0.0 < usual < np.inf
            against = f", {share[j] / usual:.1f} times as much of its limit as the others" if known else ""
            problems.append(
                f"{catch.model.joints[j]} needs {breakaway[j]:.3g} to break away{against}: expect it to stick"
            )
    return problems


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
    bound = _NUDGE * float(catch.model.effort[j])
    begin = np.mean([catch.step() for _ in range(5)], axis=0)
    count, extra, moved = max(2, round(_NUDGE_TIME / catch.port.period)), np.zeros(begin.size), np.zeros(begin.size)
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


def slow(catch: Catch, j: int, torque: float, way: float) -> None:
    """Slow a joint that a nudge has moved, if it is fast.

    Args:
        catch: the arm; the sign of the joint is known.
        j: the joint.
        torque: that moved it, N m or N.
        way: of the joint until now, rad or m.
    """
    if abs(speed_of(catch, j)) > _FAST:
        brake(catch, j, torque, way, _BRAKING * torque)


def speed_of(catch: Catch, j: int) -> float:
    """Velocity of a joint in the last few samples, rad/s or m/s."""
    (before, earlier, _), (now, q, _) = catch.rows[-_SLOPE], catch.rows[-1]
    return float(q[j] - earlier[j]) / (now - before)
