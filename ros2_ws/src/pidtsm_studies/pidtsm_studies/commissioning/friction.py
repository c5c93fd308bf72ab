"""Step 4: friction of each joint, from slow sweeps in both directions."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.bench import Bench, Outcome, Plan
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.motions import Motion, sweeps

_REACH = 0.25
"""rad."""
_SPEEDS, _ACCELERATION = (0.1, 0.4), 1.5
"""rad/s and rad/s^2, of the joint that moves farthest."""
_STEADY = 0.8
"""Share of the speed above which a sample counts as sliding."""
_DEGREE = 5
"""Of the polynomial along the sweep that stands for what gravity leaves unexplained."""
_PARTS = 5
"""Parts of the sweeps whose friction tells how sure it is."""
_LOOSE = 0.6
"""rad; tracking error at which an arm that friction has held is stopped."""
_STICKS_SHARE, _OF_OTHERS, _OF_SLIDING = 0.05, 1.6, 1.3
"""A joint sticks if it takes so much of its torque limit to break away, so many times the share of the other joints,
and so many times what it takes to slide slowly. Gears take 1.2 times, and the controller goes beyond that.
"""
_ALONE = 1.8
"""The last one, of an arm with one joint."""
_STAND, _MOVED, _LEAVES = 0.1, 0.0005, 3.0
"""s, in which a joint that stands moves less than this, rad or m, or than what noise moves it; and how many times as
far it moves in half that time when it breaks away.
"""


def _motion(bench: Bench) -> Motion:
    return sweeps(bench.home, bench.reach(bench.model(), _REACH), _SPEEDS, _ACCELERATION)


def plan(bench: Bench) -> Plan:
    """See `session.STEPS`."""
    return bench.plan("All joints together sweep slowly to both sides and back.", _motion(bench), bench.model())


def run(bench: Bench) -> Outcome:
    """See `session.STEPS`."""
    samples = bench.follow(_motion(bench), again=_LOOSE)
    model, swept = bench.model(), samples.motion
    q, dq, ddq = (swept.desired[:, i] for i in range(3))
    rest = swept.effort - model.torque(q, dq, ddq)
    lead = int(np.argmax(bench.reach(model, _REACH)))
    place = (q[:, lead] - bench.home[lead]) / max(float(np.ptp(q[:, lead])), 1e-9)
    speed = np.abs(dq[:, lead])
    target = np.where(speed > 1.5 * _SPEEDS[0], _SPEEDS[1], _SPEEDS[0])
    sliding = speed > _STEADY * target
    joints = len(model.joints)
    coulomb, viscous, half, breakaway = (np.zeros(joints) for _ in range(4))
    for j in range(joints):
        coulomb[j], viscous[j], half[j] = _friction(rest[sliding, j], dq[sliding, j], place[sliding])
        breakaway[j] = _breakaway(rest[:, j], swept, j, place, sliding, bench.rate)
    slides = coulomb + viscous * np.array([_slow(np.abs(dq[sliding, j])) for j in range(joints)])
    problems = [
        f"{model.joints[j]} needs {breakaway[j]:.3g} to break away and {slides[j]:.3g} to slide: expect it to stick"
        for j in sticking(breakaway / model.effort, slides / model.effort)
        if not moved_easily(bench.found.get("signs", {}).get("breakaway", []), model.effort, j)
    ]
    breakaway[np.isnan(breakaway)] = 0.0
    figures = {
        "coulomb": coulomb.tolist(),
        "half_interval": half.tolist(),
        "viscous": viscous.tolist(),
        "breakaway": breakaway.tolist(),
    }
    share = coulomb / model.effort
    worst = int(np.argmax(share))
    verdict = f"Coulomb friction takes up to {100.0 * share[worst]:.1f} % of the torque limit ({model.joints[worst]})"
    return Outcome(verdict, figures, problems, samples={"friction": samples})


def _fit(rest: Array, dq: Array, place: Array) -> Array:
    columns = np.column_stack([np.sign(dq), dq, np.vander(place, _DEGREE + 1)])
    return np.asarray(np.linalg.lstsq(columns, rest, rcond=None)[0])


def _friction(rest: Array, dq: Array, place: Array) -> tuple[float, float, float]:
    """Coulomb and viscous friction, not negative, and half of the interval of 95 % of the former."""
    coulomb, viscous = _fit(rest, dq, place)[:2]
    parts = np.array_split(np.argsort(place, kind="stable"), _PARTS)
    each = [_fit(np.delete(rest, part), np.delete(dq, part), np.delete(place, part))[0] for part in parts]
    spread = float(np.sqrt((_PARTS - 1.0) / _PARTS * np.sum((np.array(each) - np.mean(each)) ** 2)))
    return max(float(coulomb), 0.0), max(float(viscous), 0.0), 2.0 * spread


def _slow(speeds: Array) -> float:
    """Median of the speeds of the slow sweeps; 0 of a joint that has no room to move."""
    slow = speeds[speeds < 0.5 * speeds.max()]
    return float(np.median(slow)) if slow.size else 0.0


def sticking(breakaway: Array, slides: Array) -> list[int]:
    """Indices of the joints that stick.

    Args:
        breakaway: torque at which each joint breaks away, NaN where none was seen, as a share of its limit, shape
            (joints,).
        slides: torque that it takes to slide slowly, likewise.
    """
    found = []
    for j in np.flatnonzero(breakaway > _STICKS_SHARE):
        others = np.delete(breakaway, j)
        others = others[np.isfinite(others)]
        usual = float(np.median(others)) if others.size else 0.0
        times = _OF_SLIDING if others.size else _ALONE
        if breakaway[j] > max(_OF_OTHERS * usual, times * slides[j]):
            found.append(int(j))
    return found


def moved_easily(nudged: Sequence[float | None], effort: Array, j: int) -> bool:
    """Whether a nudge of the first step moved a joint as easily as others: then it does not stick, but follows badly.

    Args:
        nudged: torque at which each joint moved, N m or N, shape (joints,) or (0,); None: not known.
        effort: limits, shape (joints,), N m or N.
        j: index of the joint.
    """
    if not nudged or nudged[j] is None or all(each is None for k, each in enumerate(nudged) if k != j):
        return False
    share = np.array([np.nan if each is None else each for each in nudged]) / effort
    return bool(share[j] < _OF_OTHERS * np.nanmedian(np.delete(share, j)))


def _breakaway(rest: Array, swept: Samples, j: int, place: Array, sliding: NDArray[np.bool_], rate: float) -> float:
    """Torque at which joint j leaves a stand, beyond what gravity leaves unexplained; NaN if it does not, both ways.

    A joint that sticks stands and leaps again and again, wherever it is; so each stand counts, not only those at the
    begins of the sweeps. The mean over both directions does not contain what gravity is believed to be.
    """
    q = swept.position[:, j]
    fit = _fit(rest[sliding], swept.desired[sliding, 1, j], place[sliding])
    beyond = rest - np.vander(place, _DEGREE + 1) @ fit[2:]
    count, visible = max(round(_STAND * rate), 2), max(_MOVED, 4.0 * float(np.std(np.diff(q))))
    still = np.ptp(sliding_window_view(q, count), axis=1) < visible
    peaks: dict[float, list[float]] = {1.0: [], -1.0: []}
    for k in np.flatnonzero(still[:-1] & ~still[1:]) + count:
        away = q[min(k + count // 2, q.size - 1)] - np.median(q[k - count : k])
        if abs(away) > _LEAVES * visible:
            peaks[np.sign(away)].append(float((np.sign(away) * beyond[k - count : k]).max()))
    if not all(peaks.values()):
        return np.nan
    return max(0.5 * float(sum(np.median(each) for each in peaks.values())), 0.0)
