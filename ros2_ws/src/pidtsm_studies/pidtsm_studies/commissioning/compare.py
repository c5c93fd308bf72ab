"""Step 9: the new parameters against those before, in turns, on the motion that the arm is for."""

from typing import Any

import numpy as np
from scipy.stats import t as student

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.arm import CommissionError
from pidtsm_studies.commissioning.bench import Bench, Outcome, Plan
from pidtsm_studies.commissioning.gains import errors, roughness
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.motions import Motion, periodic

TURNS, FIRST = 4, 1
"""How often each set has its turn, and the first turns that do not count: observers and friction settle."""
_REACH, _FREQUENCY, _DURATION = 0.3, 0.2, 8.0
"""rad, Hz and s of the motion if the user has given none."""
OLD, NEW = "before", "new"


def own_motion(bench: Bench) -> Motion:
    """The motion that the arm is for, or one about its home."""
    if bench.motion is not None:
        return bench.motion
    reach = bench.reach(bench.model(), _REACH)
    turned = np.array([0.5 * reach, 0.25 * reach * np.sin(1.0 + np.arange(reach.size))])
    return periodic(bench.home, turned, _FREQUENCY, _DURATION)


def plan(bench: Bench) -> Plan:
    """See `session.STEPS`."""
    one = bench.plan("", own_motion(bench), bench.model())
    text = f"The arm makes its motion {2 * TURNS} times, in turns with the parameters before and with the new ones."
    return Plan(text, one.travel, one.effort, 2 * TURNS * one.duration)


def run(bench: Bench) -> Outcome:
    """See `session.STEPS`."""
    motion = own_motion(bench)
    fast = float(np.abs(motion.states[1]).max())
    bandwidth = np.array(bench.found["gains"]["bandwidth"])
    new = bench.controller(bandwidth, max(fast, 1.0))
    guards = bench.safeguards(max(fast, 1.0))
    sets = {OLD: {**bench.before, **guards}, NEW: new}
    bench.room.check(bench.home, motion)
    error: dict[str, list[Array]] = {name: [] for name in sets}
    rough: dict[str, list[Array]] = {name: [] for name in sets}
    failed: dict[str, str] = {}
    recorded: dict[str, Samples] = {}
    for turn in range(TURNS):
        for name, settings in sets.items():
            if name in failed:
                continue
            try:
                samples = bench.loop.follow(settings, motion)
            except CommissionError as reason:
                failed[name] = str(reason)
                continue
            recorded[f"{name}-{turn + 1}"] = samples
            if turn >= FIRST:
                error[name].append(errors(samples.motion))
                rough[name].append(roughness(samples.motion))
    return _judged(error, rough, failed, recorded)


def _judged(
    error: dict[str, list[Array]], rough: dict[str, list[Array]], failed: dict[str, str], recorded: dict[str, Samples]
) -> Outcome:
    figures: dict[str, Any] = {
        "error": {name: np.array(each).tolist() for name, each in error.items()},
        "rough": {name: np.array(each).tolist() for name, each in rough.items()},
        "failed": failed,
        "ratio": None,
        "interval": None,
    }
    if NEW in failed:
        figures["better"] = False
        verdict = f"rolled back: with the new parameters {failed[NEW]}"
        return Outcome(verdict, figures, [failed[NEW]], samples=recorded)
    if OLD in failed:
        figures["better"] = True
        return Outcome(f"kept: with the parameters before, {failed[OLD]}", figures, (), samples=recorded)
    # Each joint counts alike, whatever its size.
    logs = np.mean(np.log(np.array(error[NEW]) / np.maximum(np.array(error[OLD]), 1e-12)), axis=1)
    middle = float(logs.mean())
    half = float(student.ppf(0.975, logs.size - 1) * logs.std(ddof=1) / np.sqrt(logs.size))
    low, ratio, high = (float(np.exp(each)) for each in (middle - half, middle, middle + half))
    figures |= {"ratio": ratio, "interval": [low, high], "better": high < 1.0}
    kept = "kept" if figures["better"] else "rolled back, because this is not surely better"
    verdict = f"the error is {ratio:.2f} times that before (95 %: {low:.2f} to {high:.2f}): {kept}"
    return Outcome(verdict, figures, (), samples=recorded)
