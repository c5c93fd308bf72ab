"""Inertias that joints show in the first step: the description often lacks the rotors of motors.

What friction does not hold is shaken by a sine. What it holds is tapped: a torque a little above the one at which the
joint moved acts for a sample, then for longer, until the joint goes a few thousandths of a rad; friction stops it. A
light joint moves before it could become fast, however late the torque acts. How the end of a tap bends the way tells
the inertia, without a model of friction.
"""

from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.catch import FARTHEST, Catch
from pidtsm_studies.commissioning.nudge import brake, speed_of

_SHAKEN, _PERIODS, _SHAKE, _CLEAR = 4.0, 3.0, 0.3, 2.0
"""Hz, periods, largest share of the effort limit, and way in multiples of what is visible, of shaking a joint."""
_EXPLAINED, _STICKY, _STANDS, _WIDE = 0.1, 0.8, 0.2, 0.3
"""Share of the shaking that may stay unexplained, of the torque that friction may take, and of the time for which the
joint may stand: a joint that sticks more is shaken more, unless it goes as far as this share of `FARTHEST`."""
_ENOUGH = 0.5
"""Share of `FARTHEST` that a joint may go until shaking ends at once."""
SHORTEST = 10
"""Samples of shaking that tell something."""
_SMOOTH, _STILL = 5, 0.1
"""Samples over which a velocity is taken, and share of the largest one below which a joint stands."""
_QUICK = 300.0
"""rad/s^2; joints are tapped that the torque limit accelerates by more by the description: rotors that others lack make
them twice as heavy at most."""
_TAP, _HARDER, _HARDEST = 1.4, 1.25, 0.5
"""Torque of a tap as a share of the one at which the joint broke away, factor if it is not enough, and largest share of
the effort limit."""
_LONGER, _LONGEST, _AHEAD = 1.5, 0.06, 0.015
"""Factor of the duration of a tap if it moves the joint too little, longest one, s, and time for which the speed counts
in the way after which it ends, s."""
_REST, _CALMS = 0.06, 0.4
"""Shortest and longest time after a tap, until the joint rests, s."""
_RESISTS, _BRAKED = 0.35, 0.5
"""Largest torque that slows a tapped joint, as a share of the one that moved it: friction that held the joint exceeds
it; and share of what is visible from which on a joint is slowed."""
_CLEARLY, _TOO_FAR, _NEAR = 3.5, 5.0, 0.8
"""Way that taps shall move a joint, and the one from which on they are made weaker, as multiples of what is visible;
and share of `FARTHEST` that a joint may go by a tap, or is tapped no more."""
_BRIEF, _HARDLY = 4.0, 1.5
"""Samples of a tap that is not made longer, if it moves a joint by this multiple of what is visible."""
_TAPS, _TAPPING = 5, 4.0
"""Taps that move a joint so far, and longest time for all of them, s."""
_BEFORE = 0.01
"""s before a tap, in which the joint rests."""
_LATEST = 0.02
"""Largest delay that is sought, s."""
_SLIDES, _SOON, _FEWEST = 0.2, 6, 5
"""A joint surely slides with this share of its largest speed; so many samples after that at least, and in all at least,
show how it slows down."""
_UNEXPLAINED, _AS_GOOD, _FAIR, _SPREAD = 0.3, 1.3, 0.05, 2.5
"""Share of the bend of the way that taps may leave unexplained, ratio of what is left by inertias that fit as well, and
share below which it makes no difference; ratio of the largest and smallest of these inertias."""


def is_quick(catch: Catch, j: int) -> bool:
    """Whether a joint may lack a rotor that matters; `_QUICK`."""
    return bool(catch.model.effort[j] > _QUICK * catch.model.inertia(catch.start)[j, j])


def inertias(catch: Catch, loose: Array) -> Array:
    """The inertias that joints show, shape (joints,), kg m^2 or kg; nan: what a joint does is not explained.

    Args:
        catch: what holds the arm; it does not judge signs. It takes over what was found by taps.
        loose: torque at which a joint moves that friction holds, else nan, shape (joints,), N m or N.

    Raises:
        AwayError: a joint moves too far; commands have ceased.
    """
    quick = [is_quick(catch, j) for j in range(loose.size)]
    found = np.full(loose.size, np.nan)
    for j in np.flatnonzero(np.isfinite(loose) & quick).tolist():
        found[j] = _tapped(catch, j, float(loose[j]))
        if found[j] > catch.inertia[j, j]:
            catch.weigh(j, float(found[j]))
    for j in np.flatnonzero(np.isnan(loose)).tolist():  # What sticks would be taken for heavy.
        found[j] = _weighed(catch, j)
    return found


def _weighed(catch: Catch, j: int) -> float:
    """The inertia that a joint shows when it is shaken a little, kg m^2 or kg; nan: it does not move."""
    dt = catch.port.period
    # The others get what keeps them where they are: a light one would be thrown.
    pattern = catch.inertia[:, j] / catch.inertia[j, j]
    coupled = np.where(np.arange(pattern.size) == j, 0.0, catch.inertia[j])
    push, bound = first_push(catch, j), hardest_push(catch, pattern)
    while True:
        push = min(push, bound)
        positions, torques = shake(catch, push * pattern)
        if len(positions) < SHORTEST:
            return np.nan
        q, torque = positions[:, j], torques[:, j] - catch.carried[j]
        wide = float(np.ptp(q))
        mobility, friction, left = _mobility(q, torque, (positions - positions[0]) @ coupled, dt)
        sticks = friction > _STICKY * float(np.std(torque)) or _stands(q) > _STANDS
        if wide > _CLEAR * catch.visible[j] and (not sticks or wide > _WIDE * FARTHEST):
            break
        if push == bound:
            return np.nan
        push *= 2.0
    # What sticks is not explained, or mostly by friction.
    return 1.0 / mobility if mobility > 0.0 and left < _EXPLAINED and not sticks else np.nan


def first_push(catch: Catch, j: int) -> float:
    """Amplitude that shakes joint j twice as far as is visible if nothing resists, N m or N."""
    return 2.0 * float(catch.inertia[j, j]) * (2.0 * np.pi * _SHAKEN) ** 2 * float(catch.visible[j])


def hardest_push(catch: Catch, pattern: Array) -> float:
    """Largest amplitude, for torques that are so many times as large, shape (joints,)."""
    return _SHAKE * float((catch.model.effort / np.maximum(np.abs(pattern), 1e-9)).min())


def shake(catch: Catch, amplitude: Array) -> tuple[Array, Array]:
    """Shake the arm with sines of some periods; `amplitude`: of the torques, shape (joints,), N m or N.

    It ends early if a joint goes far: friction that no longer holds it.

    Returns:
        Positions and torques meanwhile, shape (samples, joints) each.

    Raises:
        AwayError: a joint moves too far; commands have ceased.
    """
    dt, first = catch.port.period, len(catch.rows)
    begin = catch.rows[-1][1]
    for k in range(round(_PERIODS / (_SHAKEN * dt))):
        catch.step(amplitude * np.sin(2.0 * np.pi * _SHAKEN * dt * k))
        if np.abs(catch.rows[-1][1] - begin).max() > _ENOUGH * FARTHEST:
            break
    positions, torques = (np.array([row[k] for row in catch.rows[first:]]) for k in (1, 2))
    return positions, torques


def _stands(q: Array) -> float:
    """Share of the time for which a shaken joint stands; `q`: positions, shape (samples,), rad or m."""
    speed = np.abs(q[_SMOOTH:] - q[:-_SMOOTH])
    return float(np.mean(speed < _STILL * speed.max()))


def sliding(q: Array, dt: float) -> Array:
    """Friction of a joint relative to the largest one, shape (samples,); `q`: its positions, likewise; `dt`: s."""
    speed = np.gradient(q, dt)
    return np.asarray(np.tanh(speed / max(0.1 * float(np.abs(speed).max()), 1e-9)))


def _mobility(q: Array, torque: Array, others: Array, dt: float) -> tuple[float, float, float]:
    """What a torque accelerates a shaken joint by, the friction that resists, and the share of the way left over.

    Args:
        q: positions, shape (samples,), rad or m.
        torque: likewise, N m or N.
        others: ways of the other joints times their couplings, likewise, kg m^2 or kg m.
        dt: s.
    """
    time = dt * np.arange(q.size)
    # Twice integrated, because the positions are too coarse to be differentiated twice.
    pushed, resisted = (dt**2 * np.cumsum(np.cumsum(each)) for each in (torque, sliding(q, dt)))
    columns = np.column_stack([np.ones_like(time), time, time**2, pushed - others, resisted])
    size = np.abs(columns).max(axis=0) + 1e-12
    fit = np.linalg.lstsq(columns / size, q, rcond=None)[0]
    left = float(np.std(q - columns / size @ fit) / max(float(np.std(q)), 1e-12))
    mobility, stopped = (float(each) for each in (fit / size)[3:])
    return mobility, abs(stopped) / max(abs(mobility), 1e-12), left


def _tapped(catch: Catch, j: int, loose: float) -> float:
    """The inertia that a joint shows when it is tapped, see `inertias`; `loose`: of this joint."""
    dt, visible, hardest = catch.port.period, float(catch.visible[j]), _HARDEST * float(catch.model.effort[j])
    taps: list[_Tap] = []
    strength, length = dict.fromkeys((1.0, -1.0), _TAP * loose), dict.fromkeys((1.0, -1.0), 1.0)
    _calm(catch, j)
    away = float(catch.rows[-1][1][j] - catch.start[j])
    direction = -1.0 if away > visible else 1.0
    farthest, enough, end = 0.0, 0, len(catch.rows) + round(_TAPPING / dt)
    while enough < _TAPS and len(catch.rows) < end and farthest < _NEAR * FARTHEST:
        if strength[direction] > hardest or catch.moves[j]:
            break
        tap = _tap(catch, j, direction * strength[direction], round(length[direction]))
        farthest, away = float(tap.way.max()), float(catch.rows[-1][1][j] - catch.start[j])
        if farthest > visible:
            taps.append(tap)
        brief = length[direction] <= _BRIEF  # A light one would go too far by a longer one.
        if farthest > (_HARDLY if brief else _CLEARLY) * visible:
            enough += 1
            if farthest > _TOO_FAR * visible:
                length[direction] = np.ceil(length[direction] / _LONGER)
                strength[direction] /= _HARDER
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
    """

    direction: float
    time: Array
    way: Array
    push: Array

    @property
    def speed(self) -> Array:
        """Velocity in this direction, shape (samples,), rad/s or m/s."""
        smooth = np.convolve(np.pad(self.way, 1, mode="edge"), [0.25, 0.5, 0.25], "valid")
        return np.asarray(np.gradient(smooth, self.time))

    @property
    def impulse(self) -> float:
        """What the torque alone would give the joint, N m s or N s."""
        return float(np.diff(self.time) @ np.maximum(self.push[:-1], 0.0))


def _tap(catch: Catch, j: int, push: float, length: int) -> _Tap:
    """Tap a joint, and wait.

    Args:
        catch: what holds the arm.
        j: the joint.
        push: torque, N m or N.
        length: samples at most.
    """
    dt, first, direction = catch.port.period, len(catch.rows), float(np.sign(push))
    before = catch.rows[-max(3, round(_BEFORE / dt)) :]
    rest, torque = float(np.mean([q[j] for _, q, _ in before])), float(np.mean([each[j] for _, _, each in before]))
    extra = np.zeros(catch.start.size)
    extra[j] = push
    way, visible, end = 0.0, float(catch.visible[j]), catch.rows[-1][0] + (length + 0.5) * dt
    while catch.rows[-1][0] + dt < end:  # Some joint states may be lost.
        way = float(catch.step(extra)[j] + catch.start[j]) - rest
        if way * direction > visible and direction * (way + _AHEAD * speed_of(catch, j)) > _CLEARLY * visible:
            break
    if abs(way) > _BRAKED * visible:
        brake(catch, j, abs(push), way, _RESISTS * abs(push))
    _calm(catch, j)
    time, q, pushed = np.array([(stamp, q[j], each[j]) for stamp, q, each in catch.rows[first:]]).T
    # Some joint states may be lost.
    return _Tap(direction, time - time[0], direction * (q - rest), direction * (pushed - torque))


def _calm(catch: Catch, j: int) -> None:
    """Wait until a joint rests, or for `_CALMS`."""
    for k in range(round(_CALMS / catch.port.period)):
        catch.step()
        if k * catch.port.period > _REST and not catch.moves[j]:
            return


def _inertia(taps: list[_Tap], dt: float) -> float:
    """The inertia that explains how taps end, kg m^2 or kg; nan: none does; `dt`: s between samples.

    A joint that slides is accelerated by friction, and by its weight as far as the model lacks it, by about the same
    amount before and after; it is the end of the tap that bends its way: way = a + b t + c t^2 + (double integral of
    the torque) / inertia, with an inertia and a delay for all taps. The smallest inertia of those that fit as well as
    the best counts, if the torque alone can have moved it as fast as it was.
    """
    windows = [(tap, window) for tap in taps if (window := _sliding(tap)).stop - window.start >= _FEWEST]
    if not windows:
        return np.nan
    fits = []
    for late in np.arange(0.0, _LATEST, min(0.25 * dt, 0.0005)):
        same, pushes, bends = np.sum([_bend(tap, window, late) for tap, window in windows], axis=0)
        if same > 0.0:
            fits.append((np.sqrt(max(1.0 - same**2 / (pushes * bends), 0.0)), pushes / same))
    if not fits:
        return np.nan
    left, inertia = np.array(fits).T
    as_good = inertia[left <= max(_AS_GOOD * left.min(), _FAIR)]
    sure = left.min() < _UNEXPLAINED and as_good.max() < _SPREAD * as_good.min()
    heaviest = min(tap.impulse / tap.speed.max() for tap, _ in windows)
    return min(float(as_good.min()), heaviest) if sure else np.nan


def _sliding(tap: _Tap) -> slice:
    """Samples around the largest speed in which a joint surely slides."""
    speed = tap.speed
    peak = int(speed.argmax())
    slow = np.flatnonzero(speed <= _SLIDES * speed[peak])
    first = int(slow[slow < peak].max(initial=-1)) + 1
    end = int(slow[slow > peak].min(initial=speed.size))
    return slice(first, min(end, peak + 1 + max(2 * (peak - first), _SOON)))


def _bend(tap: _Tap, window: slice, late: float) -> Array:
    """Sums of way times push, of pushes squared, and of ways squared, shape (3,), for a delay, s.

    The push is the double integral of the torque; of both, what a parabola explains is taken away.
    """
    steps = np.diff(tap.time)
    # The torque of a sample acts from then on until the next one.
    impulse = np.concatenate([[0.0], np.cumsum(steps * tap.push[:-1])])
    impulse = np.interp(tap.time - late, tap.time, impulse, left=0.0)
    push = np.concatenate([[0.0], np.cumsum(0.5 * steps * (impulse[1:] + impulse[:-1]))])
    time = tap.time[window] - tap.time[window].mean()
    parabola = np.linalg.qr(np.stack([np.ones_like(time), time, time**2], axis=1))[0]
    both = np.stack([tap.way[window], push[window]])
    way, push = both - both @ parabola @ parabola.T
    return np.array([way @ push, push @ push, way @ way])
