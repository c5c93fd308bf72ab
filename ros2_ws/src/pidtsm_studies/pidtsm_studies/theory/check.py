"""`check_gains`: the conditions of a set of gains, and the bounds along a run with it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import Experiment, make_experiment
from pidtsm_core.parameters import Value, names
from pidtsm_core.parameters.joints import JointOrder
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot, payload_of
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_studies.theory.bounds import Bounds, evaluate
from pidtsm_studies.theory.condition import Condition, Verdict
from pidtsm_studies.theory.conditions import conditions

_POSTURES = 100
"""In which the largest inertia of a joint is looked for, beside the middle of its range."""


@dataclass(frozen=True, repr=False)
class GainCheck:
    """What theory says of a set of gains.

    Attributes:
        law: name of the law.
        joints: names of the joints, in the order of all values.
        conditions: of the gains alone.
        bounds: along a run; None if there is none.
        reason: why there are no bounds; empty if there are.
        recording: of the run; None if there is none.
    """

    law: str
    joints: tuple[str, ...]
    conditions: tuple[Condition, ...]
    bounds: Bounds | None
    reason: str = ""
    recording: Recording | None = None

    @property
    def violated(self) -> tuple[Condition, ...]:
        """The conditions that are violated."""
        return self._of(Verdict.VIOLATED)

    @property
    def not_covered(self) -> tuple[Condition, ...]:
        """What the set has and the proof does not."""
        return self._of(Verdict.NOT_COVERED)

    def _of(self, verdict: Verdict) -> tuple[Condition, ...]:
        return tuple(each for each in self.conditions if each.verdict is verdict)

    def to_json(self) -> dict[str, Any]:
        """Everything as plain dictionaries, lists, texts and numbers; None for what does not exist."""
        return {
            "law": self.law,
            "joints": list(self.joints),
            "holds": not self.violated,
            "violated": [each.name for each in self.violated],
            "conditions": [each.to_json() for each in self.conditions],
            "bounds": None if self.bounds is None else self.bounds.to_json(),
            "reason": self.reason,
        }

    def __repr__(self) -> str:
        found = [f"<GainCheck of {self.law}: {len(self._of(Verdict.HOLDS))} conditions hold"]
        for text, group in (("violated", self.violated), ("not covered", self.not_covered)):
            if group:
                found.append(f"{len(group)} {text} ({', '.join(each.name for each in group)})")
        return ", ".join(found) + ">"


def check_gains(
    scenario: str | Experiment | None = None,
    law: str | None = None,
    params: str | Sequence[str] = (),
    robot: str | ArmDefinition | None = None,
    *,
    duration: float | None = None,
    controller: Mapping[str, Any] | None = None,
    simulator: Mapping[str, Any] | None = None,
    run: Recording | bool = True,
) -> GainCheck:
    """Check a set of gains against the conditions of its law, and what theory says of a run with it.

    Args:
        scenario: as for `rollout`; an `Experiment` may have parameters of the trajectory too.
        law: likewise.
        params: likewise.
        robot: likewise.
        duration: likewise.
        controller: likewise.
        simulator: likewise.
        run: what the bounds are evaluated along: True: a rollout of the experiment, False: nothing, or the recording of
            a run with these gains, which needs the true motion.

    Raises:
        UsageError: see `rollout`, or the recording is of other joints or has no ground truth.
    """
    given = {"controller": controller or {}, "simulator": simulator or {}}
    experiment = make_experiment(scenario, law, duration, params, given, robot)
    values, reason = experiment.values, ""
    recording = run if isinstance(run, Recording) else None
    if recording is None and run:
        try:
            recording = rollout(experiment)
        except DivergedError as error:
            reason = f"no bounds: {error}"
    return checked(values["controller"], recording, reason)


def checked(controller: Mapping[str, Value], recording: Recording | None, reason: str = "") -> GainCheck:
    """The conditions of a controller, and the bounds along its run.

    Args:
        controller: every parameter of the controller, checked.
        recording: of the run; None: there is none.
        reason: why there is none.

    Raises:
        UsageError: see `check_gains`.
    """
    own = names(controller["joints"])
    joints = own if recording is None else recording.joints
    order = JointOrder(joints).match(own)
    values = _in_order(controller, order.tolist()) if joints != own else controller
    bounds = None if recording is None else evaluate(recording, values)
    if recording is not None and bounds is None:
        reason = f"no bounds: {controller['law.name']} has no sliding variable"
    inertia = _inertia(controller)[order]
    found = conditions(values, len(joints), inertia)
    return GainCheck(str(controller["law.name"]), joints, found, bounds, reason, recording)


def _in_order(values: Mapping[str, Value], places: Sequence[int]) -> dict[str, Value]:
    """Parameters with the values of the law's joints in another order."""
    return {
        name: tuple(value[place] for place in places)
        if name.startswith("law.") and isinstance(value, tuple) and len(value) == len(places)
        else value
        for name, value in values.items()
    }


def _inertia(controller: Mapping[str, Value]) -> Array:
    """Largest diagonal elements of the inertia matrix over the range of the arm, shape (joints,), kg m^2."""
    robot = find_robot(controller)
    model = robot.with_payload(robot.pack_model(controller), payload_of(controller))
    middle = np.array(robot.initial_position)
    limits = np.array(robot.position_limits or [(-math.inf, math.inf)] * middle.size)
    lower = np.where(np.isfinite(limits[:, 0]), limits[:, 0], middle - math.pi)
    upper = np.where(np.isfinite(limits[:, 1]), limits[:, 1], middle + math.pi)
    spread = np.random.default_rng(0).uniform(lower, upper, size=(_POSTURES, middle.size))
    return np.max([np.diag(robot.inertia_matrix(model, q)) for q in (middle, *spread)], axis=0)
