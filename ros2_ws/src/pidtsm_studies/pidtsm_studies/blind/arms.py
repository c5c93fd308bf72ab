"""Blind arms: from a seed, an arm, its hardware, a motion, and none, one or two faults."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter, periodogram, sosfiltfilt

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import PRACTICAL, Experiment, make_experiment
from pidtsm_core.experiment.hardware_classes import hardware_names
from pidtsm_core.experiment.hardware_gains import hardware_gains
from pidtsm_core.parameters import as_float, joint_array
from pidtsm_core.robots import DESCRIPTION, NAMES, ROBOTS, Description, find_description
from pidtsm_core.robots.definition import ArmDefinition, find_arm
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_studies.blind.draft import Draft
from pidtsm_studies.blind.faults import FAULTS, NoEffectError, Planted, compatible
from pidtsm_studies.diagnosis.causes import Cause

ARMS = tuple(name for name in NAMES if name not in ROBOTS)
"""Arms from which a seed chooses: those with a description."""
DURATION = 20.0
"""s."""
POINTS = "targets.csv"
_LARGEST, _SHARE, _SPEED, _EFFORT = 0.5, 0.3, 0.4, 0.6
"""Largest amplitude (rad or m), and largest shares of half the range, of the velocity limit, of the effort limit."""
_SLOWEST, _FASTEST = 0.1, 0.3
"""Hz, of the motion."""
_MODEL_ERROR = 0.04
"""Largest error of masses and inertias of an arm that counts as described right."""
_ORDER = (
    Cause.STICK_SLIP,
    Cause.WRONG_SIGN,
    Cause.WRONG_ORDER,
    Cause.OTHER_ARM,
    Cause.WRONG_GRAVITY,
    Cause.UNKNOWN_PAYLOAD,
)
"""Faults that come before all others, because these depend on motion and plant."""
_HARDER, _STEPS = 1.35, 14
"""Factor by which gains are raised until the loop rings, and how often."""
_TRIAL = 5.0
"""s of each of these trials."""
_RINGS, _AT_ONE = 0.08, 0.6
"""rad/s or m/s RMS above `_ABOVE` at which a joint rings, and share of the power that is near one frequency then."""
_ABOVE = 3.0
"""Hz."""
_SEEDS = 20


@dataclass(frozen=True)
class BlindArm:
    """An arm of which nobody but its maker knows what is wrong with it.

    Attributes:
        seed: from which it was made.
        arm: what the controller believes.
        hardware: class of hardware; empty: ideal sensors and drives.
        experiment: parameters of all nodes, and the duration.
        truth: its faults, in no order; empty: it has none.
    """

    seed: int
    arm: ArmDefinition
    hardware: str
    experiment: Experiment
    truth: tuple[Planted, ...]


def blind_arm(
    seed: int,
    folder: Path,
    robot: str | ArmDefinition | None = None,
    causes: Sequence[Cause] | None = None,
    hardware: str | None = None,
    duration: float = DURATION,
) -> BlindArm:
    """Make an arm; the same arguments make the same arm.

    Args:
        seed: from which everything follows that is not given.
        folder: exists; a motion that needs a file gets it there.
        robot: the arm, with a URDF; None: one of `ARMS`.
        causes: its faults; None: none, one or two, by the seed.
        hardware: class of hardware; empty: ideal sensors and drives; None: by the seed.
        duration: s.

    Raises:
        UsageError: the arm has no URDF, or a given fault would not matter for it.
    """
    random = np.random.default_rng([seed, 41])
    chosen = find_arm(robot or str(random.choice(ARMS)))
    if chosen.description in ROBOTS or not (arm := find_description(chosen.settings())).is_urdf:
        raise UsageError(f"{chosen.label} has no URDF, which blind arms are made of; choose one of {', '.join(ARMS)}")
    classes = ["", *hardware_names()]
    known = str(random.choice(classes)) if hardware is None else hardware
    failure = ""
    for attempt in range(_SEEDS):
        again = np.random.default_rng([seed, attempt])
        wanted = _causes(again) if causes is None else list(causes)
        draft = _draft(arm, known, duration, again)
        try:
            truth = tuple(FAULTS[cause](draft, again) for cause in sorted(wanted, key=_rank))
            made = _experiment(draft, chosen, seed, folder / POINTS)
            return BlindArm(seed, chosen, known, _ringing(made, draft), truth)
        except NoEffectError as error:
            failure = str(error)
    raise UsageError(f"{chosen.label}: {failure}; choose another fault or seed")


def _causes(random: np.random.Generator) -> list[Cause]:
    """None in one of three cases, else one or two that can come together."""
    count = int(random.choice([0, 1, 1, 2]))
    while True:
        chosen = [Cause(name) for name in random.choice([cause.value for cause in Cause], count, replace=False)]
        if compatible(chosen):
            return chosen


def _rank(cause: Cause) -> int:
    return _ORDER.index(cause) if cause in _ORDER else len(_ORDER)


def _draft(arm: Description, hardware: str, duration: float, random: np.random.Generator) -> Draft:
    """An arm without faults, and a motion that its drives can make."""
    count = len(arm.joints)
    frequency = random.permutation(np.linspace(_SLOWEST, _FASTEST, count)) * random.uniform(0.8, 1.2)
    bounded = np.isfinite(arm.lower) & np.isfinite(arm.upper)
    lower, upper = np.where(bounded, arm.lower, -np.pi), np.where(bounded, arm.upper, np.pi)
    amplitude = np.minimum(_LARGEST * random.uniform(0.6, 1.0, count), _SHARE * 0.5 * (upper - lower))
    speed = np.where(np.isfinite(arm.velocity), arm.velocity, 2.0)
    frequency = np.minimum(frequency, _SPEED * speed / (2.0 * np.pi * amplitude))
    middle = 0.5 * (lower + upper) + 0.15 * random.uniform(-1.0, 1.0, count) * (upper - lower)
    draft = Draft(arm, hardware, duration, amplitude, frequency, np.full(count, -0.5 * np.pi), middle, arm.urdf)
    for _ in range(20):
        if np.all(np.abs(draft.efforts()).max(axis=0) < _EFFORT * arm.effort):
            break
        draft.middle = 0.7 * draft.middle + 0.3 * 0.5 * (lower + upper)
        draft.amplitude = 0.9 * draft.amplitude
    error = random.uniform(-_MODEL_ERROR, _MODEL_ERROR)
    draft.simulator |= {"model_error.mass": error, "model_error.inertia": error, "seed": int(random.integers(1000))}
    if hardware:
        # Without a peak of static friction: arms of a class stick here and there, and that is a fault of its own.
        draft.simulator["friction.static"] = (draft.friction * arm.effort).tolist()
    return draft


def _experiment(draft: Draft, arm: ArmDefinition, seed: int, points: Path) -> Experiment:
    """The experiment of a draft, with gains of the rule for the arm that the controller believes in."""
    joints = list(draft.arm.joints)
    begin = draft.motion(np.zeros(1))[0][0]
    trajectory: dict[str, Any] = {
        "reference.name": "sines",
        "reference.amplitude": draft.amplitude.tolist(),
        "reference.frequency": draft.frequency.tolist(),
        "reference.phase": draft.phase.tolist(),
        "reference.offset": draft.middle.tolist(),
    }
    if draft.points.size:
        header = ",".join(["time", *(f"q_{joint}" for joint in joints)])
        np.savetxt(points, draft.points, delimiter=",", header=header, comments="", fmt="%.9g")
        trajectory = {"reference.name": "csv", "reference.file": str(points)}
    believed = {
        "simulator": {"disturbance.name": "none", "initial_position": begin.tolist(), "joints": joints},
        "controller": {"limits.effort": draft.limit.tolist(), "joints": joints},
        "trajectory": {"joints": joints, **trajectory},
    }
    # A scenario of its own, because a file has no room for parameters of the default motion.
    nominal = Experiment(f"blind {seed}", "", draft.duration, believed)
    parameters = () if draft.hardware else PRACTICAL
    made = make_experiment(nominal, None, None, parameters, (), arm.with_joints(), draft.hardware or None)
    if draft.hardware:
        # Who practises does not know the springs.
        gains = hardware_gains(made.settings["controller"], made.settings["simulator"], knows_springs=False)
        rigid = {"controller": {gain.name: gain.value for gain in gains} | {"drive.delay": 0.0}}
        made = make_experiment(nominal, None, None, parameters, rigid, arm.with_joints(), draft.hardware)
    actual = dict(draft.simulator)
    if draft.plant != draft.arm.urdf:
        actual = {DESCRIPTION.name: draft.plant, "limits.effort": draft.limit.tolist(), **actual}
    # Afterwards, because the gains follow from what the controller believes.
    return make_experiment(made, overrides={"simulator": actual, "controller": draft.controller})


def _ringing(experiment: Experiment, draft: Draft) -> Experiment:
    """The experiment with the gains of one joint so high that it rings without being stopped.

    Raises:
        NoEffectError: no such gain was found.
    """
    if draft.rings is None:
        return experiment
    j, count = draft.rings, len(draft.arm.joints)
    bandwidth = joint_array(experiment.values["controller"]["estimator.bandwidth"], count)
    rate = as_float(experiment.values["simulator"]["rate"])
    for step in range(1, _STEPS + 1):
        raised = bandwidth.copy()
        raised[j] *= _HARDER**step
        found = make_experiment(experiment, overrides={"controller": {"estimator.bandwidth": raised.tolist()}})
        try:
            trial = rollout(found, duration=min(_TRIAL, experiment.duration))
        except DivergedError:
            break
        sections = butter(4, _ABOVE, "highpass", fs=rate, output="sos")
        fast = sosfiltfilt(sections, trial.velocity[:, j])[trial.time.size // 3 :]
        if trial.status[:, 1].any():
            break
        if np.sqrt(np.mean(fast**2)) > _RINGS and _near_its_peak(fast, rate) > _AT_ONE:
            return found
    raise NoEffectError("no gain makes this joint ring")


def _near_its_peak(values: Array, rate: float) -> float:
    """Share of the power of a signal, shape (samples,), that is within a quarter of its strongest frequency."""
    frequency, power = periodogram(values, rate)
    peak = frequency[np.argmax(power)]
    return float(power[np.abs(frequency - peak) < 0.25 * peak].sum() / power.sum())
