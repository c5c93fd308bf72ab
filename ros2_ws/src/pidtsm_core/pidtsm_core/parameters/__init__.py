"""The single description of every parameter: default, unit, range and meaning.

Nodes declare their ROS parameters from it, the rollout checks its settings with it, and the command line parses
``--set`` with it. A parameter group (a law, a surface, a robot ...) is a tuple of `Parameter`. Which groups apply may
depend on values (`law.name` decides the gains), so a schema is a function of the settings.
"""

import difflib
import functools
import math
from array import array
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError

Scalar: TypeAlias = bool | int | float | str
Value: TypeAlias = Scalar | Sequence[Scalar]

_LARGEST = 2.0**62
"""Upper bound of every parameter, in any SI unit: products of two do not overflow, and integers fit into 64 bits."""


class ParameterError(UsageError):
    """A parameter is unknown, or its value has the wrong type, length or range; the message contains name and reason.

    Attributes:
        parameter: its name, preceded by that of the node if several nodes are checked together; empty if the error
            concerns no parameter.
    """

    def __init__(self, message: str, parameter: str = "") -> None:
        super().__init__(message)
        self.parameter = parameter


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    Attributes:
        name: full dotted name, such as ``law.k1``.
        default: its type (float, int, bool, str, or tuple of str) is the type of the parameter; with `per_joint` or
            `length` also a tuple of floats.
        description: one sentence.
        unit: SI unit, empty if dimensionless.
        minimum, maximum: inclusive range of a number; None: unbounded.
        exclusive: exclude the ends of the range.
        choices: allowed values of a string.
        per_joint: one number for all joints, or a sequence of one number per joint; for texts, one name per joint.
        length: number of values of a sequence that does not depend on the joints; 0: it is none.
        read_only: can only be set before the node is configured, not while it runs.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    exclusive: bool = False
    choices: Collection[str] = ()
    per_joint: bool = False
    length: int = 0
    read_only: bool = False

    def range_text(self) -> str:
        """The allowed values as text, empty if unrestricted."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        low = "" if self.minimum is None else f"{'>' if self.exclusive else '>='} {self.minimum:g}"
        high = "" if self.maximum is None else f"{'<' if self.exclusive else '<='} {self.maximum:g}"
        return " and ".join(part for part in (low, high) if part)

    def check(self, value: object, joints: int) -> Value:
        """Return `value` in the type of the parameter.

        Args:
            value: the user's value. An int is accepted for a float, and with `per_joint` a sequence of length `joints`
                for a number (a sequence of length one counts as its only element).
            joints: number of joints of the robot.

        Raises:
            ParameterError: wrong type, length or range, or a number that is not finite.
        """
        if isinstance(self.default, tuple) and isinstance(self.default[0], str):
            return self._check_texts(value, joints)
        if isinstance(value, (list, tuple, array, np.ndarray)):
            return self._check_sequence(list(value), joints)
        if self.length:
            raise self._error(value, f"must be {self.length} numbers")
        return self._check_scalar(value)

    def _check_texts(self, value: object, joints: int) -> Value:
        if not isinstance(value, (list, tuple)) or not value or not all(isinstance(v, str) and v for v in value):
            raise self._error(value, "must be a non-empty list of names")
        if len(set(value)) != len(value):
            raise self._error(value, "must not contain a name twice")
        if self.per_joint and len(value) != joints:
            raise self._error(value, f"must contain {joints} joint names")
        return tuple(value)

    def _check_sequence(self, value: list[object], joints: int) -> Value:
        if not self.per_joint and not self.length:
            raise self._error(value, "must be a single value")
        checked = [self._check_scalar(v) for v in value]
        if self.length:
            if len(checked) != self.length:
                raise self._error(value, f"must be {self.length} numbers")
            return tuple(checked)
        if len(checked) == 1:
            return checked[0]
        if len(checked) != joints:
            raise self._error(value, f"must be one number, or one for each of the {joints} joints")
        return tuple(checked)

    def _check_scalar(self, value: object) -> Scalar:
        if isinstance(self.default, bool):
            if not isinstance(value, (bool, np.bool_)):
                raise self._error(value, "must be true or false")
            return bool(value)
        if isinstance(self.default, str):
            if not isinstance(value, str):
                raise self._error(value, f"must be text, {self.range_text()}".rstrip(", "))
            if self.choices and value not in self.choices:
                raise self._error(value, f"must be {self.range_text()}{did_you_mean(value, self.choices)}")
            return value
        if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
            raise self._error(value, "must be a number")
        if not abs(value) < math.inf:  # isfinite does not accept integers larger than any float.
            raise self._error(value, "must be finite")
        if abs(value) > _LARGEST:
            raise self._error(value, f"is absurd: its magnitude exceeds {_LARGEST:.0e}")
        if isinstance(self.default, int) and int(value) != value:
            raise self._error(value, "must be an integer")
        if not self._in_range(float(value)):
            raise self._error(value, f"must be {self.range_text()}")
        return int(value) if isinstance(self.default, int) else float(value)

    def _in_range(self, value: float) -> bool:
        low, high = self.minimum, self.maximum
        if self.exclusive:
            return (low is None or value > low) and (high is None or value < high)
        return (low is None or value >= low) and (high is None or value <= high)

    def _error(self, value: object, reason: str) -> ParameterError:
        unit = f" ({self.unit})" if self.unit else ""
        return ParameterError(f"{self.name}{unit}: {value!r} {reason}", self.name)


Schema: TypeAlias = Callable[[Mapping[str, object]], Sequence[Parameter]]
_Made: TypeAlias = dict[frozenset[tuple[str, object]], Sequence[Parameter] | None]


def prefixed(group: str, parameters: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """The same parameters with the prefix ``group.``."""
    return tuple(_renamed(p, f"{group}.{p.name}") for p in parameters)


@functools.cache
def _renamed(parameter: Parameter, name: str) -> Parameter:
    """Cached, since every rollout of a batch needs it again."""
    return replace(parameter, name=name)


def chosen(settings: Mapping[str, object], parameter: Parameter) -> str:
    """Value of a text parameter that decides which others exist; its default if not set.

    Raises:
        ParameterError: the value is not one of its choices.
    """
    return str(parameter.check(settings.get(parameter.name, parameter.default), 1))


def resolve(schema: Schema, settings: Mapping[str, object], joints: int) -> dict[str, Value]:
    """Check settings against a schema and fill in the defaults.

    Returns:
        Every parameter of the schema by its full name.

    Raises:
        ParameterError: a name is unknown or a value is invalid.
    """
    parameters = {p.name: p for p in schema(settings)}
    for name in settings:
        if name not in parameters:
            elsewhere = _where_it_belongs(name, schema, settings)
            raise ParameterError(
                f"unknown parameter {name}: {elsewhere}" if elsewhere else unknown_parameter(name, parameters), name
            )
    return {name: p.check(settings.get(name, p.default), joints) for name, p in parameters.items()}


def _where_it_belongs(name: str, schema: Schema, settings: Mapping[str, object]) -> str:
    """The other choices with which the parameter would exist; empty if there are none."""
    made: _Made = {}
    for steps in (1, 2):  # Two, since for example a surface can only be chosen after its law.
        found: dict[str, list[str]] = {}
        for changed, parameters in _other_choices(schema, settings, steps, {}, made):
            if any(p.name == name for p in parameters):
                *first, last = (key for key, value in changed.items() if settings.get(key) != value)
                chosen_first = "".join(f"{key} {changed[key]} and " for key in first)
                found.setdefault(f"{chosen_first}{last}", []).append(str(changed[last]))
        if found:
            places = "; or ".join(f"{key} {_either(values)}" for key, values in found.items())
            return f"{name.rpartition('.')[2]} belongs to {places}"
    return ""


def _other_choices(
    schema: Schema,
    settings: Mapping[str, object],
    steps: int,
    changes: Mapping[str, object],
    made: _Made,
    before: Collection[Parameter] = (),
) -> Iterator[tuple[dict[str, object], Sequence[Parameter]]]:
    """The settings with `steps` choices changed, each of which makes the next one available, and their parameters.

    Args:
        schema: of the parameters.
        settings: already with `changes`.
        steps: how many choices to change.
        changes: choices that were changed.
        made: parameters by changes, filled: making them takes long, and the next call meets the same changes again.
        before: parameters that were there without the last of `changes`, which did not make their choices available.
    """

    def parameters(changes: Mapping[str, object], changed: Mapping[str, object]) -> Sequence[Parameter] | None:
        key = frozenset(changes.items())
        if key not in made:
            try:
                made[key] = schema(changed)
            except UsageError:  # Nodes reject choices that work in rollouts only; members from outside may not compile.
                made[key] = None
        return made[key]

    known = parameters(changes, settings) or ()
    names = {p.name for p in known}
    for parameter in [p for p in known if p.choices and p not in before]:
        for choice in parameter.choices:
            if choice == settings.get(parameter.name, parameter.default):
                continue
            more, changed = {**changes, parameter.name: choice}, {**settings, parameter.name: choice}
            after = parameters(more, changed)
            if after is None:
                continue
            if steps == 1:
                yield changed, after
            elif {p.name for p in after} != names:
                yield from _other_choices(schema, changed, steps - 1, more, made, known)


def _either(values: Sequence[str]) -> str:
    return " or ".join(filter(None, (", ".join(values[:-1]), values[-1])))


def unknown_parameter(name: str, known: Iterable[str]) -> str:
    """Error text for a parameter that does not exist."""
    known = sorted(known)
    hint = did_you_mean(name, known)
    return f"unknown parameter {name}{hint or '; known: ' + ', '.join(known)}"


def as_float(value: Value) -> float:
    """The checked value of a numeric parameter."""
    assert isinstance(value, (int, float))
    return float(value)


def names(value: Value) -> tuple[str, ...]:
    """The checked value of a parameter that is a list of names."""
    assert isinstance(value, tuple)
    return value


def joint_array(value: Value, joints: int) -> Array:
    """One float per joint, shape (joints,), from a number or a sequence."""
    array = np.empty(joints)
    array[:] = value
    return array


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A hint at the known word next to an unknown one; empty if none is close."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.7)
    return f"; did you mean {close[0]}?" if close else ""
