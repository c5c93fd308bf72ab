"""Step 1: release the arm gently, and find which directions of positions and torques are inverted.

No controller may run before the signs are known: with a wrong one it pushes the arm away. So first only the torque that
carries the arm by its model acts. Each of the ways in which torques may be inverted predicts where the arm begins to
move then; as soon as a joint has moved by a few times its noise, the likeliest one is taken, and a spring, a damper and
an integral catch the joint. If that pushes it farther away, its torque is inverted. Joints that stay where they are,
such as those that friction holds, get a nudge each: a torque that grows from zero until the joint moves. If nothing
fits, commands cease, and the brakes close.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.arm import Port, Wired, Wiring
from pidtsm_studies.commissioning.catch import AwayError, Catch
from pidtsm_studies.commissioning.mirrored import is_mirrored
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.nudge import loosen, nudge, slow, sticking
from pidtsm_studies.commissioning.weigh import inertias, is_quick

_FREE = 0.25
"""s in which the arm is carried by the model alone."""
_STIFF, _SOFT = 15.0, 6.0
"""Triple poles of what catches the arm, rad/s; the second one if the arm rings with the first."""
_MASSES = (0.7, 0.85, 1.0, 1.2, 1.4)
"""Ratios of true and described gravity that are thought possible here."""
_LATE = (0.0, 0.004, 0.008, 0.014, 0.02)
"""Delays that are thought possible, s."""
_MOST = 8
"""Inverted torques are sought among all combinations for arms of up to this many joints, else among single ones."""
_RESISTED = (0.4, 0.7, 1.0)
"""Shares of the acceleration that friction may leave."""
_PREFERS = 2.0
"""How much better an explanation with inverted torques must fit than one with none."""
_MOST_TRIES = 5
"""How often a joint may get away until a session gives up."""
_POSTURES, _DIFFERS = 3, 0.03
"""How often another position may be taken for inverted, and share of the effort limit by which this must matter."""
_SURELY = 0.1
"""Share of the effort limit above which what carries the arm cannot be friction."""
_SHOWS = 3.0
"""A wrong sign shows when the arm is released if the joint falls this many times as far as is visible."""


@dataclass(frozen=True)
class Signs:
    """What the step has found.

    Attributes:
        wiring: the directions.
        moved: farthest way of each joint, shape (joints,), rad or m.
        known_by: for each joint: ``release`` or ``nudge``.
        hold: mean torque that held the arm, shape (joints,), N m or N.
        breakaway: of nudged joints the torque at which they moved, else nan, shape (joints,).
        inertia: what a joint has shown that was shaken or tapped, shape (joints,), kg m^2 or kg; nan: nothing.
        problems: sentences.
        time: s, shape (samples,); position and effort: shape (samples, joints).
    """

    wiring: Wiring
    moved: Array
    known_by: tuple[str, ...]
    hold: Array
    breakaway: Array
    inertia: Array
    problems: tuple[str, ...]
    time: Array
    position: Array
    effort: Array


def find_signs(port: Port, model: ArmModel, tell: Callable[[str], None]) -> tuple[Signs, Callable[[], object]]:
    """Find the wiring of an arm that is at rest and carried by something else.

    Args:
        port: the arm as its messages have it.
        model: its description.
        tell: called with each finding at once, before the arm moves on.

    Returns:
        The finding, and what answers one more joint state so that the arm stays.

    Raises:
        CommissionError: nothing fits; commands have ceased.
    """
    ones = np.ones(len(model.joints))
    tries, failed, postures = [_Try(_possible(port, model, tell), ones, _STIFF)], list[_Try](), 0
    while True:
        guess = tries.pop(0)
        catch = Catch(Wired(port, Wiring(guess.position, ones)), model, guess.stiff, guess.sign.copy(), tell)
        try:
            return _found(catch, guess.position, postures < _POSTURES)
        except _OtherPostureError as error:
            tries.insert(0, _Try(guess.position * error.position, error.sign, _STIFF))
            postures += 1
        except AwayError as error:
            failed.append(guess)
            others = _other_tries(guess, catch, error.joint)
            tries += [each for each in others if not each.is_among((*tries, *failed))]
            if not tries or len(failed) == _MOST_TRIES:
                raise
            tell(f"{error}; once more, with what seems to be inverted")


def _possible(port: Port, model: ArmModel, tell: Callable[[str], None]) -> Array:
    """Signs of the positions, shape (joints,): -1 where only that is within the limits of the description."""
    while (measured := port.sense()) is None:
        port.act(None)
    port.act(None)
    turned = ~model.may_be(measured.position) & model.may_be(-measured.position)
    for j in np.flatnonzero(turned):
        tell(f"the position of {model.joints[j]} is inverted: as it is, it is beyond the limits of the description")
    return np.where(turned, -1.0, 1.0)


@dataclass(frozen=True)
class _Try:
    """What is assumed: signs of positions and torques, shape (joints,) each; and the pole of the catch, rad/s."""

    position: Array
    sign: Array
    stiff: float

    def is_among(self, others: Sequence["_Try"]) -> bool:
        """Whether one of them assumes the same."""
        return any(
            np.array_equal(self.position, each.position)
            and np.array_equal(self.sign, each.sign)
            and self.stiff == each.stiff
            for each in others
        )


def _other_tries(guess: _Try, catch: Catch, away: int) -> list[_Try]:
    """What to try when joint `away` got away: what seems inverted is the torque, or the position; or the arm rang."""
    result = []
    if catch.inverted:
        result.append(_Try(guess.position, catch.sign, _STIFF))
        if catch.model.may_be(-catch.start)[catch.inverted[0]]:
            position = guess.position.copy()
            position[catch.inverted[0]] *= -1.0
            result.append(_Try(position, guess.sign, _STIFF))
    result.append(_Try(guess.position, catch.sign, _SOFT))
    if not catch.sure[away]:  # It was too fast to be judged.
        sign = catch.sign.copy()
        sign[away] *= -1.0
        result.append(_Try(guess.position, sign, _STIFF))
    return result


class _OtherPostureError(Exception):
    """The arm fell as if the position of a joint were inverted; commands have ceased.

    Attributes:
        position: -1 for that joint, else 1, shape (joints,).
        sign: of the torques, likewise.
    """

    def __init__(self, position: Array, sign: Array) -> None:
        super().__init__()
        self.position, self.sign = position, sign


def _found(catch: Catch, of_position: Array, may_turn: bool) -> tuple[Signs, Callable[[], object]]:
    """One try; see `find_signs`.

    Args:
        catch: the arm.
        of_position: signs of the positions that the catch gets, shape (joints,).
        may_turn: whether other positions may be inverted.

    Raises:
        _OtherPostureError: they are.
    """
    breakaway = np.full(catch.start.size, np.nan)
    try:
        _release(catch, may_turn)
        problems = nudge(catch, breakaway)
        catch.judges = False  # What is shaken shall not be judged by that.
        problems += sticking(catch, breakaway)
        loose = np.array([_loosened(catch, j) if np.isnan(each) else each for j, each in enumerate(breakaway)])
        inertia = inertias(catch, loose)
        hold = _held(catch)
        wiring = _which(catch, hold)
    except AwayError as error:  # What sticks leaps.
        raise AwayError("; ".join([str(error), *sticking(catch, breakaway)]), error.joint) from None
    wiring = Wiring(of_position * wiring.position, wiring.effort)
    time, position, effort = (np.array(each) for each in zip(*catch.rows, strict=True))
    known_by = tuple("release" if np.isnan(each) else "nudge" for each in breakaway)
    signs = Signs(
        wiring,
        catch.farthest,
        known_by,
        hold,
        breakaway,
        inertia,
        tuple(problems),
        time,
        of_position * position,
        catch.sign * effort,
    )
    return signs, catch.step


def _release(catch: Catch, may_turn: bool) -> None:
    """Carry the arm by its model until a joint moves; judge by how it moves which torques are inverted.

    Raises:
        _OtherPostureError: it moves as if a position were, if that may be.
    """
    ways: list[Array] = []
    while len(ways) * catch.port.period < _FREE and not (ways and np.any(np.abs(ways[-1]) > catch.visible)):
        ways.append(catch.step())
    if np.any(np.abs(ways[-1]) > catch.visible):
        fall = np.abs(catch.carried) / np.diag(catch.inertia) * (_FREE / 2.0) ** 2
        position, signs = _explanation(catch, np.array(ways), fall > _SHOWS * catch.visible, may_turn)
        if np.any(position < 0.0):
            catch.port.act(None)
            name = catch.model.joints[int(np.argmin(position))]
            catch.tell(f"the position of {name} seems to be inverted (the arm fell so when it was released); once more")
            raise _OtherPostureError(position, signs * catch.sign)
        for j in np.flatnonzero(signs < 0.0):
            catch.invert(int(j), carried=False)
            catch.sure[j] = True
            catch.tell(f"the sign of {catch.model.joints[j]} is inverted (it fell when the arm was released)")
    catch.judges = True


def _explanation(catch: Catch, ways: Array, loaded: Array, may_turn: bool) -> tuple[Array, Array]:
    """Signs of positions and torques that explain best how the arm began to move, shape (joints,) each."""
    joints = catch.start.size
    time = np.asarray(catch.port.period * np.arange(len(ways)), dtype=np.float64)
    candidates = [j for j in range(joints) if loaded[j]]
    most = len(candidates) if len(candidates) <= _MOST else 1
    best, chosen = np.inf, (np.ones(joints), np.ones(joints))
    for turned in (-1, *(np.flatnonzero(catch.model.may_be(-catch.start)) if may_turn else ())):
        position = np.where(np.arange(joints) == turned, -1.0, 1.0)
        weight = catch.model.gravity((position * catch.start)[np.newaxis])[0]
        if turned >= 0 and np.all(np.abs(weight - catch.carried) < _DIFFERS * catch.model.effort):
            continue
        inertia = catch.model.inertia(position * catch.start)
        mobility = position[:, np.newaxis] * np.asarray(np.linalg.inv(inertia), dtype=np.float64)
        for count in range(most + 1 if turned < 0 else min(most, 1) + 1):
            for inverted in itertools.combinations(candidates, count):
                signs = np.ones(joints)
                signs[list(inverted)] = -1.0
                wrong = min(count + 2 * (turned >= 0), 2)
                misfit = _misfit(catch, ways, time, mobility, signs, weight) * _PREFERS**wrong
                if misfit < best:
                    best, chosen = misfit, (position, signs)
    return chosen


def _misfit(catch: Catch, ways: Array, time: Array, mobility: Array, signs: Array, weight: Array) -> float:
    """How badly signs of the torques explain ways, shape (samples, joints), with the likeliest mass and delay.

    `mobility`: accelerations per torque, shape (joints, joints); `weight`: torque that would carry the arm, (joints,).
    """
    least = np.inf
    for ratio in _MASSES:
        acceleration = mobility @ (signs * catch.carried - ratio * weight)
        for late, share in itertools.product(_LATE, _RESISTED):
            grown = 0.5 * share * np.maximum(time - late, 0.0) ** 2
            apart = (ways - np.outer(grown, acceleration)) / catch.visible
            least = min(least, float(np.mean(apart**2)))
    return least


def _loosened(catch: Catch, j: int) -> float:
    """Torque at which a caught joint moves that friction holds now, and that taps shall weigh; else nan."""
    if catch.moves[j] or not is_quick(catch, j):
        return np.nan
    side = -1.0 if catch.rows[-1][1][j] > catch.start[j] else 1.0
    torque, moved = loosen(catch, j, side)
    if moved is None:
        return np.nan
    if side * moved[j] < 0.0 and not catch.sure[j]:  # Friction has held it, before the catch could judge.
        catch.tell(f"the sign of {catch.model.joints[j]} is inverted (it moved against its nudge)")
        catch.invert(j, carried=not catch.fell[j])
    catch.sure[j] = True
    slow(catch, j, torque, float(moved[j]))
    catch.catch(j)
    return torque


def _held(catch: Catch) -> Array:
    """Mean torque of the arm held by the catch, in the directions of its messages, shape (joints,)."""
    count = max(20, round(0.6 / catch.port.period))
    for _ in range(count):
        catch.step()
    return catch.sign * np.mean([row[2] for row in catch.rows[-count // 2 :]], axis=0)


def _which(catch: Catch, hold: Array) -> Wiring:
    """Whether the position or the torque is inverted: only one of them fits what carries the arm, and how it reacts.

    Where the weight could as well be friction, how the other joints react counts more. Of joints that only tell of each
    other, one whose limits are alike on both sides counts as turned.
    """
    position, may_turn = np.ones(hold.size), catch.model.may_be(-catch.start)
    undecided, likely = [], dict[int, float]()
    for j in np.flatnonzero(catch.sign < 0.0).tolist():
        as_is, turned = (_apart(catch, hold, j, of_position) for of_position in (1.0, -1.0))
        if not may_turn[j] or min(as_is, turned) < 0.5 * max(as_is, turned):
            likely[j] = -1.0 if may_turn[j] and turned < as_is else 1.0
        if j in likely and (not may_turn[j] or abs(as_is - turned) > _SURELY * catch.model.effort[j]):
            position[j] = likely[j]
            _tell_which(catch, j, position[j])
        else:
            undecided.append(j)
    told_apart = []
    for j in sorted(undecided, key=lambda j: abs(catch.model.lower[j] + catch.model.upper[j])):
        mirrored = is_mirrored(catch, j, position)
        if mirrored is None and j not in likely:
            name = catch.model.joints[j]
            catch.tell(f"{name}: position or torque; turn it by hand and look at which way its position counts")
            continue
        if mirrored is not None:
            told_apart.append(catch.model.joints[j])
        position[j] = likely[j] if mirrored is None else -1.0 if mirrored else 1.0
        _tell_which(catch, j, position[j])
    if len(told_apart) > 1:
        both = ", ".join(told_apart)
        catch.tell(f"{both}: or all of them the other way, which moves alike; turn one by hand and look")
    return Wiring(position, position * catch.sign)


def _apart(catch: Catch, hold: Array, j: int, of_position: float) -> float:
    """How far the torque that holds the arm is from its weight, N m, if the position of joint j is inverted, or not."""
    q, sign = catch.start.copy(), catch.sign.copy()
    q[j] *= of_position
    sign[j] *= of_position
    return float(np.linalg.norm(sign * hold - catch.model.gravity(q[np.newaxis])[0]))


def _tell_which(catch: Catch, j: int, of_position: float) -> None:
    what = "position that counts" if of_position < 0.0 else "torque that acts"
    catch.tell(f"{catch.model.joints[j]}: it is the {what} in the other direction")
