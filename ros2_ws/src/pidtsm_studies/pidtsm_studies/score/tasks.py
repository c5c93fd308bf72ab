"""What an arm is scored on: its motion, and when a run has succeeded (``arms.yaml``)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import DEFAULT_ROBOT, Experiment, make_experiment
from pidtsm_core.parameters import Value, joint_array
from pidtsm_core.robots import Robot, find_robot, payload_of
from pidtsm_core.robots.definition import ArmDefinition, find_arm
from pidtsm_core.robots.source import ARMS, rated_payload

_FILE = Path(__file__).with_name("arms.yaml")
IDEAL, ON_HARDWARE = "ideal", "hardware"
BASES = (IDEAL, ON_HARDWARE)
"""What the ranges of the score are varied around: ideal hardware, or a class of hardware (second edition)."""
_COARSEST = 0.05
"""Largest error of a run that counts at all on hardware, rad or m: the last of the levels."""
_DEFAULT_PAYLOAD = 1.0
"""kg, for an arm whose middle posture needs no effort to hold a payload."""


@dataclass(frozen=True)
class Task:
    """What an arm is scored on.

    Attributes:
        robot: name or path of the arm, for results.
        duration: of a run, s.
        event: time at which a payload is picked up, and from which on a push begins within a second, s.
        after: time from which on a run is judged, s.
        error: largest error of a successful run, rad or m.
        payload: largest payload, kg.
        scenario: name of its scenario; None: the default motion of the arm.
        arm: the arm, if more than `robot` is specified.
        hardware: its class of hardware; None: what is not varied is ideal.
        base: one of `BASES`.
    """

    robot: str
    duration: float
    event: float
    after: float
    error: float
    payload: float
    scenario: str | None = None
    arm: ArmDefinition | None = None
    hardware: str | None = None
    base: str = IDEAL

    def experiment(self, law: str | None, params: Sequence[str] = (), overrides: Sequence[str] = ()) -> Experiment:
        """The nominal run of a controller; see `make_experiment`.

        Raises:
            UsageError: something unknown or malformed, or (`ParameterError`) a refused value.
        """
        robot = self.arm or self.robot
        return make_experiment(self.scenario, law, self.duration, params, overrides, robot, self.hardware)


def find_task(robot: str | ArmDefinition = DEFAULT_ROBOT, hardware: str | None = None, base: str = IDEAL) -> Task:
    """The task of an arm.

    Args:
        robot: a name, the path of a URDF, xacro or MJCF file, or a definition.
        hardware: see `Task`; None with the base ``hardware``: the class of the arm.
        base: see `Task`; on hardware, all arms make the `motions`, and no scenario.

    Raises:
        UsageError: the arm cannot be used.
    """
    tasks: dict[str, dict[str, Any]] = yaml.safe_load(_FILE.read_text(encoding="utf-8"))
    arm = find_arm(robot)
    known = arm == ArmDefinition(arm.description)
    row = tasks.get(arm.description if known else "", tasks["other"])
    if "payload" not in row:
        row["payload"] = rated_payload(arm.description) if known and arm.description in ARMS else _largest_payload(arm)
    own = row.pop("hardware")
    if base == ON_HARDWARE:
        common = {name: tasks["other"][name] for name in ("duration", "event", "after")}
        row = {**row, **common, "error": _COARSEST, "scenario": None}
        hardware = hardware or own
    return Task(arm.label, **row, arm=None if known else arm, hardware=hardware, base=base)


def effort_limits(values: Mapping[str, Value]) -> Array:
    """Effort limits of a node with these checked parameters, N m or N, shape (joints,)."""
    return joint_array(values["limits.effort"], len(find_robot(values).joints))


def _largest_payload(definition: ArmDefinition) -> float:
    """The mass (kg, two digits) that the joints can just hold in their middle."""
    values = make_experiment(None, robot=definition).values["simulator"]
    arm, limits = find_robot(values), effort_limits(values)
    model, q = arm.pack_model(values), np.array(arm.initial_position)
    kilogram = payload_of({**values, "payload.mass": 1.0})
    own, loaded = (_holding(arm, each, q) for each in (model, arm.with_payload(model, kilogram)))
    with np.errstate(divide="ignore"):
        largest = float(np.min((limits - np.abs(own)) / np.abs(loaded - own)))
    return float(f"{largest:.2g}") if 0.0 < largest < math.inf else _DEFAULT_PAYLOAD


def _holding(arm: Robot, model: Array, q: Array) -> Array:
    """Effort that holds the arm at q, N m, shape (joints,)."""
    rest, effort = np.zeros(q.size), np.zeros((1, q.size))
    arm.dynamics.inverse_dynamics(q, rest, rest[np.newaxis], model, effort)
    return np.asarray(effort[0])
