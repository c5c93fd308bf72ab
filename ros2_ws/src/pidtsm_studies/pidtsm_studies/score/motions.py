"""The motions of the second edition of the score: sines, work with rests, slow reversals, and haste."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import Experiment
from pidtsm_core.experiment.default_motion import default_motion
from pidtsm_core.parameters import Value, names, resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.robots import Robot, find_robot
from pidtsm_studies.score.tasks import effort_limits

_SLOW, _SLOW_FREQUENCY = math.radians(3.0), 0.125
"""Largest velocity (rad/s or m/s) and frequency (Hz) of the slow reversals."""
_MOVE, _REST = 2.0, 1.0
"""Time of a move and of a rest of pick and place, s."""
_SHORT_REST = 0.5
"""Rest between fast moves, s."""
_HASTE = 0.8
"""Speed of the fast moves, relative to the fastest that the arm can make."""
_VELOCITY = 0.9
"""Share of the velocity limits that the fastest motion uses; a controller stops beyond them."""
_SAMPLES = 200
"""Samples of a motion in which its limits are judged."""
_LONGEST = 1e3
"""Largest factor by which a motion becomes faster."""


@dataclass(frozen=True)
class Motion:
    """A motion of an arm.

    Attributes:
        name: of the motion.
        trajectory: parameters of the trajectory.
        start: positions at which it begins, shape (joints,), rad or m.
        fastest: factor of its speed at which it reaches the limits of velocity or effort.
    """

    name: str
    trajectory: Mapping[str, Any]
    start: tuple[float, ...]
    fastest: float = 1.0

    def at(self, speed: float) -> "Motion":
        """The same motion with this speed, relative to the fastest."""
        return replace(self, trajectory=_faster(self.trajectory, speed * self.fastest))

    def of(self, experiment: Experiment) -> Experiment:
        """An experiment with this motion."""
        joints = {name: value for name, value in experiment.settings["trajectory"].items() if name == "joints"}
        simulator = {**experiment.settings["simulator"], "initial_position": list(self.start)}
        settings = {**experiment.settings, "simulator": simulator, "trajectory": {**joints, **self.trajectory}}
        return replace(experiment, settings=settings)


def motions(experiment: Experiment) -> tuple[Motion, ...]:
    """The motions of an arm: ``sines``, ``pick_and_place``, ``reversals`` and ``fast``.

    Args:
        experiment: of the arm; only its robot and its limits matter.
    """
    values = experiment.values["simulator"]
    robot, joints = find_robot(values), names(values["joints"])
    usual = default_motion(robot)["trajectory"]
    middle, amplitude = (np.array(usual[f"reference.{name}"]) for name in ("offset", "amplitude"))
    slow = np.minimum(_SLOW / (2.0 * math.pi * _SLOW_FREQUENCY), amplitude)
    reversals = {**usual, "reference.amplitude": slow.tolist(), "reference.frequency": _SLOW_FREQUENCY}
    moves = {
        "reference.name": "pick_and_place",
        "reference.from": (middle - amplitude).tolist(),
        "reference.to": (middle + amplitude).tolist(),
        "reference.duration": _MOVE,
        "reference.rest": _REST,
    }
    begin = tuple((middle - amplitude).tolist())
    blank = (
        Motion("sines", usual, begin),
        Motion("pick_and_place", moves, begin),
        Motion("reversals", reversals, tuple((middle - slow).tolist())),
        Motion("fast", {**moves, "reference.rest": _SHORT_REST}, begin),
    )
    limits = effort_limits(values)
    known = [replace(each, fastest=_fastest(each, robot, values, limits, joints)) for each in blank]
    return tuple(each.at(_HASTE) if each.name == "fast" else each for each in known)


def _faster(trajectory: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Parameters of the same motion, faster by a factor; rests are as long as before."""
    changed = dict(trajectory)
    for name, power in (("reference.frequency", 1.0), ("reference.duration", -1.0)):
        if name in changed:
            changed[name] = (np.asarray(changed[name]) * factor**power).tolist()
    return changed


def _fastest(
    motion: Motion, robot: Robot, values: Mapping[str, Value], limits: Array, joints: tuple[str, ...]
) -> float:
    """The factor at which a motion reaches a limit, by bisection to 1 %."""
    trajectory = resolve(reference_schema, {"joints": list(joints), **motion.trajectory}, len(joints))
    evaluated, model = ReferenceMotion(trajectory), robot.pack_model(values)
    desired = np.zeros((_SAMPLES, 3, len(joints)))
    period = 2.0 * (_MOVE + _REST) if "reference.duration" in motion.trajectory else _slowest_period(motion)
    for k, time in enumerate(np.linspace(0.0, period, _SAMPLES)):
        evaluated.evaluate(time, desired[k])
    velocity = _VELOCITY * np.array(robot.velocity_limit) if robot.velocity_limit else np.full(len(joints), np.inf)
    effort = np.zeros((1, len(joints)))

    def possible(factor: float) -> bool:
        for q, dq, ddq in desired:
            robot.dynamics.inverse_dynamics(q, factor * dq, factor**2 * ddq[np.newaxis], model, effort)
            if (np.abs(effort[0]) > limits).any() or (factor * np.abs(dq) > velocity).any():
                return False
        return True

    slow, fast = 1.0 / _LONGEST, _LONGEST
    while fast / slow > 1.01:
        middle = math.sqrt(slow * fast)
        slow, fast = (middle, fast) if possible(middle) else (slow, middle)
    return slow


def _slowest_period(motion: Motion) -> float:
    """Period of the slowest joint of a sine, s."""
    return 1.0 / float(np.min(motion.trajectory["reference.frequency"]))
