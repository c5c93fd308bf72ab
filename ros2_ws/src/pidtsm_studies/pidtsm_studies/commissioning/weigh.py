"""Inertias that joints show in the first step: the description often lacks the rotors of motors.

What friction does not hold is shaken by a sine. What it holds is tapped: a torque a little above the one at which the
joint broke away acts for a sample, then for longer, until the joint visibly moves; then it ceases at once, and friction
stops the joint. A light joint moves before it could become fast, whatever the delay is.
"""

from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.catch import FARTHEST, Catch

_SHAKEN, _PERIODS, _SHAKE, _CLEAR = 4.0, 3.0, 0.3, 2.0
"""Hz, periods, largest share of the effort limit, and way in multiples of what is visible, of shaking a joint."""
_EXPLAINED, _STICKY = 0.1, 0.8
"""Share of the shaking that may stay unexplained, and share of the torque that friction may take."""
_QUICK = 300.0
"""rad/s^2; joints are tapped that the torque limit accelerates by more by the description: rotors that others lack make
them twice as heavy at most."""
_TAP, _HARDER, _HARDEST = 1.4, 1.25, 0.5
"""Torque of a tap as a share of the one at which the joint broke away, factor if it is not enough, and largest share of
the effort limit."""
_LONGER, _LONGEST, _REST = 1.5, 0.06, 0.06
"""Factor of the duration of a tap if it moves the joint too little, longest one, and time after it, s."""
_CLEARLY, _NEAR = 3.5, 0.6
"""Way that taps shall move a joint, in multiples of what is visible, and share of `FARTHEST` from which on a joint is
tapped no more."""
_TAPS, _TAPPING = 5, 4.0
"""Taps that move a joint so far, and longest time for all of them, s."""
_BEFORE = 0.01
"""s before a tap, in which the joint rests."""
_LATEST = 0.02
"""Largest delay that is sought, s."""
_FRICTIONS = np.linspace(0.02, 0.98, 33)
"""Friction that is sought, as a share of the torque of the hardest tap."""
_UNEXPLAINED, _AS_GOOD = 0.15, 1.3
"""Share of the way that taps may leave unexplained, and ratio of what is left by inertias that explain them as well."""
_FAIR = 0.02
"""Share of the way below which what is left makes no difference."""


def weighed(catch: Catch, j: int) -> float:
    """The inertia that a joint shows when it is shaken a little, kg m^2 or kg; nan: it does not move."""
    dt, rate = catch.port.period, 2.0 * np.pi * _SHAKEN
    # The others get what keeps them where they are: a light one would be thrown.
    pattern = catch.inertia[:, j] / catch.inertia[j, j]
    push = 2.0 * float(catch.inertia[j, j]) * rate**2 * catch.visible[j]
    bound = _SHAKE * float((catch.model.effort / np.maximum(np.abs(pattern), 1e-9)).min())
    while True:
        push = min(push, bound)
        first = len(catch.rows)
        for k in range(round(_PERIODS / (_SHAKEN * dt))):
            catch.step(push * np.sin(rate * dt * k) * pattern)
        q = np.array([row[1][j] for row in catch.rows[first:]])
        if np.ptp(q) > _CLEAR * catch.visible[j]:
            break
        if push == bound:
            return np.nan
        push *= 2.0
    torque = np.array([row[2][j] for row in catch.rows[first:]]) - catch.carried[j]
    speed = np.gradient(q, dt)
    sliding = np.tanh(speed / max(0.1 * float(np.abs(speed).max()), 1e-9))
    time = dt * np.arange(q.size)
    # Twice integrated, because the positions are too coarse to be differentiated twice.
    columns = np.column_stack(
        [np.ones_like(time), time, time**2, *(dt**2 * np.cumsum(np.cumsum(each)) for each in (torque, sliding))]
    )
    size = np.abs(columns).max(axis=0) + 1e-12
    fit = np.linalg.lstsq(columns / size, q, rcond=None)[0]
    left = float(np.std(q - columns / size @ fit) / np.std(q))
    mobility, stopped = (fit / size)[3:]
    # What sticks is not explained, or mostly by friction.
    sticks = abs(stopped) > _STICKY * mobility * float(np.std(torque))
    return 1.0 / float(mobility) if mobility > 0.0 and left < _EXPLAINED and not sticks else np.nan


def tapped(catch: Catch, j: int, breakaway: float) -> float:
    """The inertia that a joint shows that friction holds, kg m^2 or kg; nan: what it does is not explained.

    Args:
        catch: what holds the arm; it does not judge signs.
        j: the joint.
        breakaway: torque at which it moved, N m or N.

    Raises:
        AwayError: a joint moves too far; commands have ceased.
    """
    if catch.model.effort[j] < _QUICK * float(catch.inertia[j, j]):
        return np.nan
    dt, visible, hardest = catch.port.period, float(catch.visible[j]), _HARDEST * float(catch.model.effort[j])
    taps: list[_Tap] = []
    strength, length = dict.fromkeys((1.0, -1.0), _TAP * breakaway), dict.fromkeys((1.0, -1.0), 1.0)
    direction, away, cut, enough, end = 1.0, 0.0, visible, 0, len(catch.rows) + round(_TAPPING / dt)
    while enough < _TAPS and len(catch.rows) < end and abs(away) < _NEAR * FARTHEST:
        if strength[direction] > hardest:
            break
        tap = _tap(catch, j, direction * strength[direction], round(length[direction]), cut)
        farthest, away = float(tap.way.max()), tap.away
        if farthest > visible:
            taps.append(tap)
            cut = visible if farthest > 0.7 * _CLEARLY * visible else 2.0 * visible  # A light one goes on by itself.
        if farthest > _CLEARLY * visible:
            enough += 1
        else:
            length[direction] = np.ceil(_LONGER * length[direction])
            if length[direction] * dt > _LONGEST:
                length[direction], strength[direction] = 1.0, _HARDER * strength[direction]
        if max(farthest, abs(away)) > visible:
            direction = -float(np.sign(away)) if abs(away) > visible else -direction
    most = max((float(tap.way.max()) for tap in taps), default=0.0)
    return _inertia([tap for tap in taps if tap.way.max() > 0.5 * most], dt)


@dataclass(frozen=True)
class _Tap:
    """What a joint did when it was tapped, until it rested again.

    Attributes:
        direction: 1 or -1.
        time: s, shape (samples,).
        way: from where the joint was, in this direction, shape (samples,), rad or m.
        push: torque beyond the one before, likewise, N m or N.
        away: where the joint rests now, from where the arm began, rad or m.
    """

    direction: float
    time: Array
    way: Array
    push: Array
    away: float


def _tap(catch: Catch, j: int, push: float, length: int, cut: float) -> _Tap:
    """Tap a joint, and wait.

    Args:
        catch: what holds the arm.
        j: the joint.
        push: torque, N m or N.
        length: samples at most.
        cut: way after which the torque ceases, rad or m.
    """
    dt, first, direction = catch.port.period, len(catch.rows), float(np.sign(push))
    before = catch.rows[-max(3, round(_BEFORE / dt)) :]
    rest, torque = float(np.mean([q[j] for _, q, _ in before])), float(np.mean([each[j] for _, _, each in before]))
    extra = np.zeros(catch.start.size)
    extra[j] = push
    for _ in range(length):
        if direction * (catch.step(extra)[j] + catch.start[j] - rest) > cut:
            break
    for _ in range(max(6, round(_REST / dt))):
        away = float(catch.step()[j])
    time, q, pushed = np.array([(stamp, q[j], each[j]) for stamp, q, each in catch.rows[first:]]).T
    # Some joint states may be lost.
    return _Tap(direction, time - time[0], direction * (q - rest), direction * (pushed - torque), away)


def _inertia(taps: list[_Tap], dt: float) -> float:
    """The inertia that explains taps by a delay and a friction of each direction, kg m^2 or kg; nan: none does.

    What the torque of the model lacks to carry the joint counts as friction. When a joint stops does not depend on its
    inertia: for each delay and friction, its way is that of a unit mass, divided by the inertia. The delay and the
    friction leave room; the result is between the best inertia and the smallest of those that are as good.
    """
    if not taps:
        return np.nan
    sides = [each for side in (1.0, -1.0) if (each := [tap for tap in taps if tap.direction == side])]
    whole = sum(float(tap.way @ tap.way) for tap in taps)
    found = []
    for late in np.arange(0.0, _LATEST, min(0.5 * dt, 0.001)):
        same, unit = _overlaps(sides[0], late)
        for side in sides[1:]:
            same, unit = (np.add.outer(a, b) for a, b in zip((same, unit), _overlaps(side, late), strict=True))
        moves = same > 0.0
        found.append(np.stack([whole - same[moves] ** 2 / unit[moves], unit[moves] / same[moves]]))
    left, inertia = np.concatenate(found, axis=1)
    if not left.size:
        return np.nan
    left = np.sqrt(np.maximum(left, 0.0) / whole)
    best = float(left.min())
    least = float(inertia[left <= max(_AS_GOOD * best, _FAIR)].min())
    return float(np.sqrt(least * inertia[left.argmin()])) if best < _UNEXPLAINED else np.nan


def _overlaps(taps: list[_Tap], late: float) -> tuple[Array, Array]:
    """Of taps in one direction for a delay, s: sums of way times unit way, and of its square, shape (frictions,) each.

    The unit way is that of a unit mass.
    """
    friction = _FRICTIONS * max(float(tap.push.max()) for tap in taps)
    same, unit = np.zeros(friction.size), np.zeros(friction.size)
    for tap in taps:
        # The torque of a sample acts from then on until the next one.
        steps = np.diff(tap.time)
        given = np.concatenate([[0.0], np.cumsum(steps * tap.push[:-1])])
        gains = np.diff(np.interp(tap.time - late, tap.time, given, left=0.0))
        way, speed = np.zeros(friction.size), np.zeros(friction.size)
        for dt, gained, measured in zip(steps, gains, tap.way[1:], strict=True):
            faster = np.maximum(speed + gained - dt * friction, 0.0)
            way += 0.5 * dt * (speed + faster)
            speed = faster
            same += measured * way
            unit += way**2
    return same, unit
