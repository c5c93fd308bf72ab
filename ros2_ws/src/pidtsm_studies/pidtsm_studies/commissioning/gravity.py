"""Step 6: the torque that carries the arm in some postures, against that of the description.

Friction holds an arm in any posture with any torque within its limits. So the arm passes each posture slowly in both
directions, and the mean of the two torques counts.
"""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.bench import Bench, Outcome, Plan
from pidtsm_studies.commissioning.motions import Motion, joined, straight, sweeps

_POSTURES = 6
_REACH, _SIDE = 0.5, 0.08
"""rad; how far the postures are from home, and how far to either side of each the arm passes it."""
_PASSING, _STEADY = 0.15, 0.9
"""Velocity at which postures are passed, rad/s, and the share of it above which the torque counts."""
_SLOW, _GENTLE = 0.5, 1.5
"""Velocity and acceleration between the postures, rad/s and rad/s^2."""
_STILL = 0.5
"""rad/s^2; below, the passing velocity counts as constant."""
_MASSES, _ZERO, _OFFSET = 0.4, 0.05, 0.03
"""Standard deviations expected of: share of gravity, zero offset (rad), constant torque (share of the limit)."""
_DOUBT = 0.005
"""Share of the effort limit by which a held torque may be wrong."""
_WRONG, _WRONG_ZERO, _SURE = 0.1, 0.02, 3.0
"""Share of gravity and zero offset (rad) that need mention, if they are this many standard deviations away from 0."""


def _postures(bench: Bench) -> Array:
    """Shape (postures, joints); the first is home."""
    model = bench.model()
    reach = np.maximum(bench.reach(model, _REACH) - bench.reach(model, _SIDE), 0.0)
    random = np.random.default_rng(0)
    # Extremes tell more of gravity than postures near home.
    spread = random.choice([-1.0, 1.0], size=(_POSTURES - 1, reach.size)) * random.uniform(
        0.5, 0.9, (_POSTURES - 1, reach.size)
    )
    return np.vstack([bench.home, bench.home + spread * reach])


def _motion(bench: Bench) -> Motion:
    model = bench.model()
    fast = (np.minimum(_SLOW, model.velocity), np.full(len(model.joints), _GENTLE))
    parts, at = [], bench.home
    for posture in _postures(bench):
        passes = sweeps(posture, bench.reach(model, _SIDE), (_PASSING,), _GENTLE)
        parts += [straight(at, passes.begin, *fast), passes]
        at = passes.end
    return joined(*parts, straight(at, bench.home, *fast))


def plan(bench: Bench) -> Plan:
    """See `session.STEPS`."""
    text = f"All joints move slowly to {_POSTURES} postures, and pass each in both directions."
    return bench.plan(text, _motion(bench), bench.model())


def run(bench: Bench) -> Outcome:
    """See `session.STEPS`."""
    samples = bench.follow(_motion(bench))
    model, moved = bench.model(), samples.motion
    postures, torques = _passed(moved.position, moved.effort, moved.desired, _postures(bench))
    share, zero, deviations = _explained(bench, postures, torques)
    described = model.gravity(postures)
    problems = []
    for j, joint in enumerate(model.joints):
        loaded = np.abs(described[:, j]).max() > 3.0 * _DOUBT * model.effort[j]
        if loaded and abs(share[j]) > max(_WRONG, _SURE * deviations[0][j]):
            problems.append(
                f"{joint} needs {100.0 * abs(share[j]):.0f} % {'more' if share[j] > 0.0 else 'less'} torque against "
                "gravity than described: a mass or a centre of mass is wrong, or the arm carries something"
            )
        if abs(zero[j]) > max(_WRONG_ZERO, _SURE * deviations[1][j]):
            problems.append(
                f"the zero of {joint} is off by {zero[j]:.3f} rad, or a centre of mass beyond it is elsewhere"
            )
    figures = {
        "postures": postures.tolist(),
        "torques": torques.tolist(),
        "described": described.tolist(),
        "share": share.tolist(),
        "share_deviation": deviations[0].tolist(),
        "zero": zero.tolist(),
        "zero_deviation": deviations[1].tolist(),
    }
    worst = int(np.argmax(np.abs(share)))
    verdict = (
        f"gravity differs from the description by up to {100.0 * abs(share[worst]):.0f} % ({model.joints[worst]})"
        if problems
        else "gravity is as described"
    )
    return Outcome(verdict, figures, problems, samples={"gravity": samples})


def _passed(position: Array, effort: Array, desired: Array, postures: Array) -> tuple[Array, Array]:
    """Postures and the torques that carry them, the mean of both directions, shape (postures, joints) each."""
    q, torque = [], []
    lead = int(np.argmax(np.ptp(desired[:, 0], axis=0)))
    speed = desired[:, 1, lead]
    for posture in postures:
        near = np.abs(desired[:, 0] - posture).max(axis=1) < _SIDE
        steady = near & (np.abs(desired[:, 2]).max(axis=1) < _STILL) & (np.abs(speed) > _STEADY * _PASSING)
        ways = [steady & (np.sign(speed) == way) for way in (1.0, -1.0)]
        q.append(np.mean([position[each].mean(axis=0) for each in ways], axis=0))
        torque.append(np.mean([effort[each].mean(axis=0) for each in ways], axis=0))
    return np.array(q), np.array(torque)


def _explained(bench: Bench, postures: Array, torques: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    """Share by which each joint needs more, zero offsets, and their standard deviations, shape (joints,) each.

    The most likely ones, if all of them are normally distributed about 0 beforehand.
    """
    model = bench.model()
    joints, described = postures.shape[1], model.gravity(postures)
    small = 1e-4
    slopes = np.stack(
        [(model.gravity(postures + small * each) - described) / small for each in np.eye(joints)], axis=-1
    )
    rows, values = [], []
    for p in range(len(postures)):
        for j in range(joints):
            row = np.zeros(3 * joints)
            row[j] = described[p, j]
            row[joints : 2 * joints] = slopes[p, j]
            row[2 * joints + j] = 1.0
            doubt = _DOUBT * model.effort[j]
            rows.append(row / doubt)
            values.append((torques[p, j] - described[p, j]) / doubt)
    prior = np.concatenate([np.full(joints, _MASSES), np.full(joints, _ZERO), _OFFSET * model.effort])
    matrix = np.vstack([*rows, np.diag(1.0 / prior)])
    solved = np.linalg.lstsq(matrix, np.concatenate([values, np.zeros(prior.size)]), rcond=None)[0]
    deviation = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    return solved[:joints], solved[joints : 2 * joints], (deviation[:joints], deviation[joints : 2 * joints])
