"""Step 4: friction of each joint, from slow sweeps in both directions."""

import numpy as np
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
_STICKS, _STICKS_SHARE = 1.8, 0.03
"""A joint sticks if it takes so many times its Coulomb friction, and so much of its limit, to break away. Gears take
1.2 times, and the controller goes beyond that before the motion shows.
"""
_BEGINS, _MOVED = 0.5, 0.0005
"""s from the begin of a sweep in which the joint breaks away, and the way after which it has, rad or m."""


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
    problems = [
        f"{model.joints[j]} needs {breakaway[j]:.3g} to break away and {coulomb[j]:.3g} to slide: expect it to stick"
        for j in range(joints)
        if breakaway[j] > _STICKS * coulomb[j] and breakaway[j] > _STICKS_SHARE * model.effort[j]
    ]
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


def _breakaway(rest: Array, swept: Samples, j: int, place: Array, sliding: NDArray[np.bool_], rate: float) -> float:
    """Median of the torques at which joint j begins to move in each sweep, beyond what gravity leaves unexplained."""
    q, dq = swept.position[:, j], swept.desired[:, 1, j]
    fit = _fit(rest[sliding], dq[sliding], place[sliding])
    beyond = rest - np.vander(place, _DEGREE + 1) @ fit[2:]
    moving = np.abs(dq) > 0.0
    begins = np.flatnonzero(moving[1:] & ~moving[:-1]) + 1
    count, visible = round(_BEGINS * rate), max(_MOVED, 4.0 * float(np.std(np.diff(q))))
    peaks = []
    for k in begins:
        away = np.flatnonzero(np.abs(q[k : k + count] - q[k]) > visible)
        if away.size:
            peaks.append(float((np.sign(dq[k + 1]) * beyond[k : k + away[0] + 1]).max()))
    return max(float(np.median(peaks)), 0.0) if peaks else 0.0
