"""Step 8: gains by the rule, raised until the torque is as rough as allowed, then back by 30 %."""

from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.arm import CommissionError
from pidtsm_studies.commissioning.bench import FIRMEST, Bench, Outcome, Plan
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.motions import Motion, periodic

LEVELS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
"""Bandwidths that are tried, relative to that of the rule."""
BACK = 0.7
"""Share of the bandwidth that stays when the torque has become too rough."""
_ROUGH_SHARE, _ROUGH = 0.002, 0.2
"""Mean change of the torque from sample to sample that is allowed: share of the limit, and at most, N m or N."""
_ROUGHER = 4.0
"""Factor of both where springs are known: what damps them is rougher, and the rule has margins for them."""
_UNSTABLE = 3.0
"""Times the allowed roughness from which on the loop is taken for unstable."""
_WORSE, _OFTEN = 1.4, 2
"""So many bandwidths in a row whose error is this many times that of the best so far are too high."""
_REACH, _FREQUENCY, _DURATION = 0.25, 0.25, 5.0
"""rad, Hz and s of the motion on which they are judged."""


def _motion(bench: Bench) -> Motion:
    reach = bench.reach(bench.model(), _REACH)
    spread = np.cos(np.arange(reach.size))
    return periodic(bench.home, np.array([0.6 * reach, 0.25 * reach * spread]), _FREQUENCY, _DURATION)


def plan(bench: Bench) -> Plan:
    """See `session.STEPS`."""
    text = (
        f"All joints swing up to {1 + len(LEVELS)} times, each time with a faster controller, until its torque becomes "
        "rough: expect to hear it"
    )
    motion = _motion(bench)
    one = bench.plan(text, motion, bench.model())
    return Plan(one.text, one.travel, one.effort, (1 + len(LEVELS)) * one.duration)


def run(bench: Bench) -> Outcome:
    """See `session.STEPS`.

    Raises:
        CommissionError: no controller follows.
    """
    model, motion, rule = bench.model(), _motion(bench), bench.bandwidth()
    allowed = np.minimum(_ROUGH_SHARE * model.effort, _ROUGH) * (_ROUGHER if bench.knows_springs else 1.0)
    levels: list[dict[str, Any]] = []
    recorded: dict[str, Samples] = {}
    stopped, bound, grown, too_soft = "", np.inf, 0, False
    bench.follow(motion)  # The first motion differs: the observer learns.
    for level in LEVELS:
        try:
            samples = bench.loop.follow(bench.controller(level * rule), motion)
        except CommissionError as reason:
            if not levels and level < FIRMEST:  # Too slow for friction.
                too_soft = True
                continue
            good = level if bench.knows_springs else levels[-1]["level"] if levels else 0.0
            stopped, bound = str(reason), BACK * good
            break
        recorded[f"bandwidth-{level:g}"] = samples
        error, rough = errors(samples.motion), roughness(samples.motion) / allowed
        mean = float(np.exp(np.mean(np.log(np.maximum(error, 1e-9)))))
        levels.append({"level": level, "error": error.tolist(), "rough": rough.tolist(), "mean_error": mean})
        if rough.max() > 1.0:
            joint = model.joints[int(np.argmax(rough))]
            stopped = f"the torque of {joint} was {rough.max():.1f} times as rough as allowed"
            # Far too rough means unstable: go back from the last good one, unless the rule has margins for springs.
            unstable = rough.max() > _UNSTABLE and len(levels) > 1 and not bench.knows_springs
            good = levels[-2]["level"] if unstable else level
            bound = BACK * good
            break
        grown = grown + 1 if mean > _WORSE * min(each["mean_error"] for each in levels) else 0
        if grown == _OFTEN:
            stopped, bound = "the error grew again", BACK * level
            break
    if not levels:
        raise CommissionError(f"neither slow nor fast controllers follow: {stopped}")
    # A faster one that follows no better only costs.
    best = min(levels, key=lambda each: float(each["mean_error"]))["level"]
    chosen = float(max(min(bound, best), levels[0]["level"] if too_soft else 0.0))
    gains = bench.gains(chosen * rule)
    why = f"{chosen:.2g} times the rule's" + (f": above, {stopped}" if stopped else ", which followed best")
    parameters = {
        gain.name: (gain.value, f"{gain.reason}; {why}" if gain.name == "estimator.bandwidth" else gain.reason)
        for gain in gains
    }
    parameters |= {name: (value, "the arm stops there") for name, value in bench.limits(1.0).items()}
    parameters |= bench.rotors_by_reason()
    figures = {"levels": levels, "chosen": chosen, "stopped": stopped, "bandwidth": (chosen * rule).tolist()}
    verdict = f"observers with {min(chosen * rule):.0f} to {max(chosen * rule):.0f} rad/s ({why})"
    return Outcome(verdict, figures, (), parameters, recorded)


def errors(moved: Samples) -> Array:
    """RMS of the tracking error of each joint, shape (joints,)."""
    return np.asarray(np.sqrt(np.mean((moved.position - moved.desired[:, 0]) ** 2, axis=0)))


def roughness(moved: Samples) -> Array:
    """Mean change of the torque of each joint from sample to sample, shape (joints,)."""
    return np.asarray(np.abs(np.diff(moved.effort, axis=0)).mean(axis=0))
