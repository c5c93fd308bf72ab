"""Step 2: what positions and stamps are like while the arm is held still."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.bench import Bench, Outcome, Plan
from pidtsm_studies.commissioning.motions import Motion, joined, periodic, rest

DURATION, _SWING = 4.0, 0.02
"""s at rest, and rad of the motion after it."""
_COARSEST, _FINEST = 8, 24
"""Bits that can be found."""
_LOST = 1.5
"""Periods; a longer time between stamps means lost joint states."""
_NORMAL = 1.96
"""Half of the interval of 95 % of a normal number, in standard deviations."""
_STAYS = 0.03
"""rad or m; an arm that is held moves less in the second half of the time, even if it sticks and slips."""
_JITTER = 0.1
"""Share of the period that needs mention."""
_LOSS = 0.001
"""Share of lost joint states that needs mention."""


def _motion(bench: Bench) -> Motion:
    """Rest, and then a little motion, because encoders that do not move show no steps."""
    swing = bench.reach(bench.model(), _SWING)
    return joined(rest(bench.home, DURATION), periodic(bench.home, swing[np.newaxis], 0.5, 2.0))


def plan(bench: Bench) -> Plan:
    """See `session.STEPS`."""
    return bench.plan("All joints are held still, and then swing very little.", _motion(bench), bench.model())


def run(bench: Bench) -> Outcome:
    """See `session.STEPS`."""
    samples = bench.follow(_motion(bench))
    whole = samples.motion
    at_rest = whole.time < DURATION
    still = whole.position[at_rest]
    gaps = np.diff(whole.stamps) * 1e-9
    period = float(np.median(gaps))
    lost = gaps > _LOST * period
    missing = float(np.sum(np.round(gaps[lost] / period) - 1.0) / (gaps.size + 1.0))
    jitter = float(np.std(gaps[~lost]))
    noise, step = _noise(still), _step(whole.position)
    model = bench.model()
    span = np.where(model.slides, 1.0, 2.0 * np.pi)
    coarse = np.maximum(step, np.sqrt(12.0) * noise) / span
    bits = int(np.clip(np.floor(-np.log2(max(float(coarse.max()), 2.0**-40)) + 0.25), _COARSEST, _FINEST))
    problems = []
    if missing > _LOSS:
        problems.append(f"{100.0 * missing:.2g} % of the joint states are lost")
    if jitter > _JITTER * period:
        problems.append(f"the period of the joint states varies by {1e3 * jitter:.2g} ms")
    late = still[len(still) // 2 :]
    drift = np.ptp(late, axis=0) > _STAYS + 8.0 * np.maximum(step, noise)
    problems += [f"{model.joints[j]} does not stay where it is held" for j in np.flatnonzero(drift)]
    figures = {
        "rate": 1.0 / period,
        "jitter": jitter,
        "missing": missing,
        "noise": noise.tolist(),
        "noise_half_interval": (_NORMAL * noise / np.sqrt(2.0 * len(still))).tolist(),
        "step": step.tolist(),
        "bits": bits,
    }
    verdict = (
        f"{1.0 / period:.0f} joint states per second, {100.0 * missing:.2g} % lost; positions are as good as those of "
        f"encoders with {bits} bits"
    )
    return Outcome(verdict, figures, problems, samples={"rest": samples})


def _noise(position: Array) -> Array:
    """Standard deviation of each joint beside its slow drift, shape (joints,)."""
    return np.asarray(np.std(np.diff(position, axis=0), axis=0) / np.sqrt(2.0))


def _step(position: Array) -> Array:
    """Smallest change of the positions of each joint, shape (joints,); 0: it never changes."""
    steps = [np.diff(np.unique(column)) for column in position.T]
    return np.array([float(np.percentile(each, 5.0)) if each.size else 0.0 for each in steps])
