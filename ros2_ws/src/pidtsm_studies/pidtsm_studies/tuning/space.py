"""Which gains of a law are tuned, from where, and within which bounds."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.experiment import practical_settings
from pidtsm_core.experiment.law_gains import RULED
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Parameter, joint_array
from pidtsm_core.robots import find_robot
from pidtsm_studies.score.tasks import Task, effort_limits
from pidtsm_studies.tuning.definitions import BOUNDS, FIXED

_FACTOR = 100.0
"""Largest factor between a gain and its start, if theory gives no bound."""
_SEPARATE = 2
"""Largest number of joints whose gains are tuned separately; more have one factor for each gain."""
_GROUPS = ("law.", "estimator.")
_OF_OBSERVER = ("estimator.", "compensation.", "drive.")
"""What every law has of a rule."""
_CHOICES = ("law.surface", "law.reaching", "law.manifold", "law.disturbance_rejection")
"""What a rule chooses beside numbers."""
_NO_GAINS = ("controller.law.name=piddtsm",)


@dataclass(frozen=True)
class Variable:
    """One number that is tuned.

    Attributes:
        name: full name of the parameter.
        start: values of all joints, shape (joints,), or of the parameter, shape (1,).
        joint: joint whose value it is; None: the value of a parameter without joints, or the factor of all joints.
        low, high: bounds of the first value it changes; of the same ratio for the others.
        per_joint: whether the parameter has a value for each joint.
    """

    name: str
    start: tuple[float, ...]
    joint: int | None
    low: float
    high: float
    per_joint: bool

    @property
    def label(self) -> str:
        """Name, with the number of the joint, from 1."""
        return self.name if self.joint is None else f"{self.name}, joint {self.joint + 1}"

    @property
    def value(self) -> float:
        """The value at the start."""
        return self.start[self.joint or 0]

    def value_at(self, x: float) -> float:
        """The value at x, which is from 0 (low) to 1 (high) on a logarithmic scale."""
        return self.low * (self.high / self.low) ** x

    def place(self, value: float) -> float:
        """Inverse of `value_at`."""
        return math.log(value / self.low) / math.log(self.high / self.low)


@dataclass(frozen=True)
class Space:
    """What is tuned.

    Attributes:
        fixed: parameters of the controller that are not tuned.
        variables: what is, in the order of x.
    """

    fixed: Mapping[str, Any]
    variables: tuple[Variable, ...]

    @property
    def start(self) -> Array:
        """x of the start, shape (variables,)."""
        return np.array([each.place(each.value) for each in self.variables])

    def controller(self, x: Array) -> dict[str, Any]:
        """Parameters of the controller at x, four significant digits, as in the parameter file.

        Args:
            x: shape (variables,), from 0 to 1.
        """
        values: dict[str, Any] = {}
        for variable, place in zip(self.variables, x.tolist(), strict=True):
            value = variable.value_at(place)
            if not variable.per_joint:
                values[variable.name] = _rounded(value)
            elif variable.joint is None:
                values[variable.name] = [_rounded(value / variable.value * each) for each in variable.start]
            else:
                values.setdefault(variable.name, list(variable.start))[variable.joint] = _rounded(value)
        return {**self.fixed, **values}


def make_space(task: Task, law: str) -> Space:
    """What is tuned of a law on an arm; the start is its rule-based set.

    A law without a rule starts with its defaults, and with what of the rule for the proposed law it has.

    Raises:
        UsageError: the law or the arm is not known.
    """
    nominal = task.experiment(law).settings["controller"]
    own = law if law in RULED else None
    rule = practical_settings(own, task.experiment(None, (), _NO_GAINS).settings, task.hardware)["controller"]
    estimator = {name: value for name, value in rule.items() if name.startswith(_OF_OBSERVER)}
    if own is not None:
        estimator |= {name: value for name, value in rule.items() if name in _CHOICES}
    chosen = {**nominal, **estimator, "law.name": law}
    if LAWS[law].uses_model and find_robot(nominal).disturbance == "none":
        chosen["law.disturbance_rejection"] = True
    same = {(p.name, p.description) for p in controller_schema({**nominal, **estimator, "law.name": own or "piddtsm"})}
    schema = controller_schema(chosen)
    values = {**{p.name: p.default for p in schema}, **nominal, **estimator}
    values |= {p.name: rule[p.name] for p in schema if p.name in rule and (p.name, p.description) in same}
    values["law.name"] = law
    tuned = [p for p in schema if _is_tuned(p)]
    joints = len(find_robot(nominal).joints)
    limits = effort_limits({**nominal, **{p.name: values[p.name] for p in schema}})
    torque = np.ones(joints) if LAWS[law].uses_model or own else limits / limits.max()
    variables = [each for p in tuned for each in _variables(p, values[p.name], torque)]
    fixed = {n: v for n, v in chosen.items() if n not in {p.name for p in tuned}}
    return Space(fixed, tuple(variables))


def _is_tuned(parameter: Parameter) -> bool:
    number = isinstance(parameter.default, float) or (
        isinstance(parameter.default, tuple) and isinstance(parameter.default[0], float)
    )
    return number and parameter.name.startswith(_GROUPS) and parameter.name not in FIXED


def _variables(parameter: Parameter, start: Any, torque: Array) -> Iterator[Variable]:
    """Variables of a parameter; `torque` scales gains that are torques, shape (joints,)."""
    bounds = BOUNDS.get(parameter.name, {})
    joints = torque.size
    scale = torque if parameter.name.startswith("law.") and "N m" in parameter.unit else np.ones(joints)
    given = np.asarray(start, dtype=np.float64)
    values = joint_array(start, joints) * scale if parameter.per_joint else given.reshape(-1)
    if not values.all():
        if "start" not in bounds:
            return
        values = np.full(values.size, bounds["start"])
    for joint in range(joints) if parameter.per_joint and joints <= _SEPARATE else [None]:
        value = float(values[joint or 0])
        low, high = (float(each) for each in _bounds(parameter, value))
        yield Variable(parameter.name, tuple(values.tolist()), joint, low, high, parameter.per_joint)


def _bounds(parameter: Parameter, value: float) -> tuple[float, float]:
    bounds = BOUNDS.get(parameter.name, {})
    low, high = value / _FACTOR, value * _FACTOR
    if parameter.minimum is not None:
        low = max(low, parameter.minimum)
    if parameter.maximum is not None:
        high = min(high, parameter.maximum)
    low, high = bounds.get("low", low), bounds.get("high", high)
    return min(low, value), max(high, value)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
