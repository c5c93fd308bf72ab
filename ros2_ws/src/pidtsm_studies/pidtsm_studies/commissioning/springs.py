"""Step 5: springs of the gears and rotors of the motors, from shaking one joint after the other."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.arm import CommissionError
from pidtsm_studies.commissioning.bench import ARMATURE, Bench, Outcome, Plan
from pidtsm_studies.commissioning.elastic_joints import Answer, Believed, Side, answer
from pidtsm_studies.commissioning.elasticity import Explanation, explain
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.motions import Motion, joined, rest, shaken, straight

_BANDS = (11.0, 17.0, 25.0, 37.0, 56.0, 85.0)
"""Hz; the joint is shaken in each of the bands between these while it moves from one end of its reach to the other."""
_OF_RATE = 0.35
"""Largest share of the rate of the joint states that a band may reach."""
_REACH, _LEAST, _SPEED, _STROKE = 0.5, 0.03, 0.7, 1.4
"""rad, rad, rad/s and s: how far a joint moves, how far it must be able to, how fast, and how long at least. Slower,
joints stick and slip."""
_LOOSE = 0.6
"""rad; tracking error at which the arm is stopped: joints that stick follow badly."""
_PAUSE, _GENTLE = 0.2, 1.5
"""s between two bands, and rad/s^2 on the way to the next joint."""
_SHARE, _FALLS = 0.05, 30.0
"""Share of the effort limit that shakes the joint; above this frequency, Hz, it falls like 1 / f."""
_STANDS, _RARELY, _FEWEST = 0.05, 0.1, 3
"""rad/s; a joint that is slower for more than this share of a band is held by friction. Fewer bands tell nothing."""
_SEEN = 0.7
"""Share of the joint states of a band that must have arrived."""
_ELASTIC = 0.75
"""Springs count if with them the answers are explained at this share of the cost without."""
_UNEXPLAINED = 6.0
"""Cost of each answer above which nothing is concluded: 0.5 to 3.3 on blind arms."""
_STIFF = 100.0
"""Hz; a rotor that would swing faster on its spring than this is taken for rigidly joined to its link."""
_STAY = "springs and rotors stay as described"
_ALIKE = 2.0
"""Factor to which the stiffness of a joint that cannot be shaken is known from the others, and its rotor."""


class _Stroke(NamedTuple):
    """A joint that is shaken in one band, between two times from the begin of the motion, s; Hz."""

    joint: int
    begin: float
    end: float
    low: float
    high: float


def _motion(bench: Bench) -> tuple[Motion | None, list[_Stroke]]:
    """What shakes all joints that turn and have room, and when it does; None: there are none."""
    model, reach = bench.model(), bench.reach(bench.model(), _REACH)
    bands = [band for band in pairwise(_BANDS) if band[1] <= _OF_RATE * bench.rate]
    quick, gentle = np.full(reach.size, _SPEED), np.full(reach.size, _GENTLE)
    parts, strokes, time = [rest(bench.home, _PAUSE)], [], _PAUSE
    for j in np.flatnonzero(~model.slides & (reach > _LEAST)).tolist():
        speed, torque = min(_SPEED, 2.0 * reach[j] / _STROKE, model.velocity[j]), _SHARE * float(model.effort[j])
        side = np.where(np.arange(reach.size) == j, reach, 0.0)
        begin, end = bench.home - side, bench.home + side
        for low, high in bands:
            stroke, (first, last) = shaken(begin, end, speed, torque, (low, high), _FALLS)
            way = straight(parts[-1].end, begin, quick, gentle)
            pause = rest(end, _PAUSE)
            time += way.duration
            strokes.append(_Stroke(j, time + first, time + last, low, high))
            parts += [way, stroke, pause]
            time += stroke.duration + pause.duration
            begin, end = end, begin
    parts.append(straight(parts[-1].end, bench.home, quick, gentle))
    return (joined(*parts) if strokes else None), strokes


def plan(bench: Bench) -> Plan:
    """See `session.STEPS`."""
    motion, _ = _motion(bench)
    text = (
        f"One joint after the other moves slowly, and is shaken with up to {100.0 * _SHARE:g} % of its torque limit at "
        f"{_BANDS[0]:g} to {_BANDS[-1]:g} Hz: expect to hear it."
    )
    return bench.plan(text, motion or rest(bench.home, _PAUSE), bench.model())


def run(bench: Bench) -> Outcome:
    """See `session.STEPS`; without an arm that can be followed, the session goes on without springs."""
    motion, strokes = _motion(bench)
    if motion is None:
        return Outcome(f"{_STAY}: no joint turns, has room, and is sampled fast enough", {})
    try:
        samples = bench.follow(motion, error=_LOOSE, again=_LOOSE)
    except CommissionError as reason:
        return Outcome(_STAY, {}, [f"the springs are not found: {reason}"])
    kept = {"springs": samples}
    answers = _answers(bench, samples.motion, strokes)
    if not answers:
        return Outcome(_STAY, {}, ["the springs are not found: friction holds the joints"], samples=kept)
    model, rest_of = bench.model(), bench.found["rest"]
    noise = np.maximum(rest_of["noise"], np.array(rest_of["step"]) / np.sqrt(12.0))
    # The matrices are small: several threads of BLAS would wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        found = explain(answers, Believed(bench.rotors, model.effort, noise, 1.0 / bench.rate))
    best = min(found.values(), key=lambda each: each.cost)
    if best.cost > _UNEXPLAINED * best.rate.size:
        return Outcome(
            _STAY, _curves(best), ["neither rigid nor elastic joints explain how the arm moves"], samples=kept
        )
    springs = min((found[side] for side in (Side.MOTOR, Side.LINK)), key=lambda each: each.cost)
    rigid = found[Side.RIGID]
    if springs.cost > _ELASTIC * rigid.cost or not _soft(springs).any():
        figures = {"delay": rigid.delay, **_curves(rigid)}
        return Outcome(f"the joints are rigid as far as they can be shaken; {_STAY}", figures, samples=kept)
    held = sorted({stroke.joint for stroke in strokes} - {each.joint for each in answers})
    outcome = _concluded(model, _with_held(springs, held, bench.rotors, model.effort), held)
    return replace(outcome, samples=kept, parameters=outcome.parameters if bench.takes_rotors else {})


def _answers(bench: Bench, moved: Samples, strokes: Sequence[_Stroke]) -> list[Answer]:
    """What tells something: bands in which the joint is seen to slide, of joints that do in several."""
    model, rotors, period = bench.model(), np.diag(bench.rotors), 1.0 / bench.rate
    found = []
    for stroke in strokes:
        rows = (moved.time >= stroke.begin) & (moved.time < stroke.end + 0.5 * _PAUSE)
        if np.count_nonzero(rows) > _SEEN * (stroke.end - stroke.begin) / period and _slides(moved, rows, stroke.joint):
            time, position, effort = (each[rows] for each in (moved.time, moved.position, moved.effort))
            links = model.inertia(position.mean(axis=0)) - rotors
            band = (stroke.low, stroke.high)
            found.append(answer(time, position, effort[:, stroke.joint], stroke.joint, band, period, links))
    counts = np.bincount([each.joint for each in found], minlength=len(model.joints))
    return [each for each in found if counts[each.joint] >= _FEWEST]


def _slides(moved: Samples, rows: NDArray[np.bool_], j: int) -> bool:
    """Whether joint j goes on all the time; friction that holds it would be taken for springs."""
    velocity = np.gradient(moved.position[rows, j], moved.time[rows])
    demanded = moved.desired[rows, 1, j]
    fast = np.abs(demanded) > 0.5 * np.abs(demanded).max()
    return bool(np.mean((velocity * np.sign(demanded))[fast] < _STANDS) < _RARELY)


def _with_held(found: Explanation, held: Sequence[int], rotors: Array, effort: Array) -> Explanation:
    """With springs of the joints that friction holds, as stiff as those of the others; gears of one arm are alike."""
    alike = np.isin(np.arange(effort.size), held) & (rotors > 0.0)
    per_effort = np.exp(np.mean(np.log(found.stiffness[found.rotor > 0.0] / effort[found.rotor > 0.0])))
    stiffness = np.where(alike, per_effort * effort, found.stiffness)
    damping = np.where(alike, found.relaxation * stiffness, found.damping)
    uncertainty = np.where(alike, np.log(_ALIKE), found.uncertainty)
    return replace(
        found,
        rotor=np.where(found.rotor > 0.0, found.rotor, rotors),
        stiffness=stiffness,
        damping=damping,
        uncertainty=uncertainty,
    )


def _resonance(found: Explanation) -> Array:
    """At what each rotor swings on its spring while the links stand, shape (joints,), Hz; nan: it was not shaken."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(found.stiffness / found.rotor) / (2.0 * np.pi))


def _soft(found: Explanation) -> NDArray[np.bool_]:
    """Which joints are elastic, shape (joints,)."""
    return np.asarray((found.stiffness > 0.0) & (_resonance(found) < _STIFF))


def _concluded(model: ArmModel, found: Explanation, held: Sequence[int]) -> Outcome:
    """What is concluded from springs; `held`: joints that friction held."""
    resonance, soft = _resonance(found), _soft(found)
    figures = {
        "encoder": found.side.value,
        "rotor": found.rotor.tolist(),
        "stiffness": np.where(soft, found.stiffness, 0.0).tolist(),
        "damping": np.where(soft, found.damping, 0.0).tolist(),
        "uncertainty": found.uncertainty.tolist(),
        "resonance": [float(each) if is_soft else None for each, is_soft in zip(resonance, soft, strict=True)],
        "delay": found.delay,
        **_curves(found),
    }
    half = ", ".join(f"{100.0 * each:.0f}" for each in found.uncertainty[0])
    reason = f"rotors that show when the joints are shaken, ± {half} % (95 %)"
    softest = int(np.argmin(np.where(soft, resonance, np.inf)))
    verdict = (
        f"{np.count_nonzero(soft)} of {soft.size} joints are elastic, with encoders at the {found.side.value}s: rotors "
        f"swing on their springs at {resonance[softest]:.0f} Hz ({model.joints[softest]}) and more; torques act "
        f"{1e3 * found.delay:.1f} ms after the position that they answer"
    )
    problems = [
        f"{model.joints[j]} cannot be shaken, because friction holds it; its gear is taken for as stiff as the others"
        for j in held
    ]
    return Outcome(verdict, figures, problems, {ARMATURE: (found.rotor.tolist(), reason)})


def _curves(found: Explanation) -> dict[str, Any]:
    """Frequencies (Hz) of the answers, the joints that were shaken, and accelerations per torque, 1/(kg m^2)."""
    return {
        "frequency": (found.rate / (2.0 * np.pi)).tolist(),
        "joint": found.joint.tolist(),
        "measured": found.measured.tolist(),
        "explained": found.explained.tolist(),
    }
