"""What an arm carries at its tool."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, ParameterError, Value, as_float

MASS = "payload.mass"
"""Name of the parameter of the mass."""
CENTER = Parameter(
    "payload.center_of_mass",
    (0.0, 0.0, 0.0),
    "centre of mass of the payload in the tool frame: x, y, z",
    "m",
    length=3,
)
_INERTIA = Parameter(
    "payload.inertia",
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "inertia of the payload about its centre of mass, in the axes of the tool frame: xx, yy, zz, xy, xz, yz",
    "kg m^2",
    length=6,
)
_ROUNDING = 1e-9
"""Relative amount by which rounding may violate the triangle inequality."""


class Payload(NamedTuple):
    """A rigid body at the tool.

    Attributes:
        mass: kg.
        center_of_mass: in the tool frame, shape (3,), m.
        inertia: about the centre of mass in the axes of the tool frame, shape (3, 3), kg m^2.
    """

    mass: float
    center_of_mass: Array = np.zeros(3)
    inertia: Array = np.zeros((3, 3))


def payload_parameters(description: str, has_shape: bool) -> tuple[Parameter, ...]:
    """Parameters of a payload.

    Args:
        description: of ``payload.mass``.
        has_shape: whether the robot takes a centre of mass and an inertia; if not, the payload is a point mass.
    """
    mass = Parameter(MASS, 0.0, description, "kg", minimum=0.0)
    return (mass, *((CENTER, _INERTIA) if has_shape else ()))


def payload_of(values: Mapping[str, Value]) -> Payload:
    """The payload that checked values of `payload_parameters` describe."""
    center = np.array(values.get(CENTER.name, CENTER.default))
    return Payload(as_float(values[MASS]), center, _matrix(values.get(_INERTIA.name, _INERTIA.default)))


def payload_settings(payload: Payload, has_shape: bool) -> dict[str, Value]:
    """Values of `payload_parameters` that describe a payload; `has_shape` as there."""
    mass: dict[str, Value] = {MASS: float(payload.mass)}
    if not has_shape:
        return mass
    entries = [float(payload.inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return {**mass, CENTER.name: [float(each) for each in payload.center_of_mass], _INERTIA.name: entries}


def together(one: Payload, other: Payload) -> Payload:
    """Two payloads as one rigid body."""
    mass = one.mass + other.mass
    if mass == 0.0:
        return Payload(0.0)
    center = (one.mass * one.center_of_mass + other.mass * other.center_of_mass) / mass
    inertia = np.zeros((3, 3))
    for each in (one, other):
        away = each.center_of_mass - center
        inertia += each.inertia + each.mass * (away @ away * np.eye(3) - np.outer(away, away))
    return Payload(mass, center, inertia)


def check_payload(settings: Mapping[str, object]) -> None:
    """Check that a rigid body can have the payload's inertia; values of a wrong type are not judged here.

    Raises:
        ParameterError: it cannot.
    """
    try:
        inertia = _matrix(settings.get(_INERTIA.name, _INERTIA.default))
    except (TypeError, ValueError):
        return
    if not np.isfinite(inertia).all():
        return
    if not possible_inertia(inertia):
        principal = np.linalg.eigvalsh(inertia)
        raise ParameterError(
            f"{_INERTIA.name}: no body has the principal inertias {', '.join(f'{p:.3g}' for p in principal)} kg m^2: "
            "none may be negative, or larger than the sum of the others",
            _INERTIA.name,
        )


def possible_inertia(inertia: Array) -> bool:
    """Whether a body can have this inertia, shape (3, 3), kg m^2, symmetric and finite."""
    least, middle, largest = np.linalg.eigvalsh(inertia).tolist()
    return bool(least >= -_ROUNDING * largest and largest <= (1.0 + _ROUNDING) * (least + middle))


def _matrix(values: object) -> Array:
    """The symmetric matrix of the entries of `_INERTIA`."""
    xx, yy, zz, xy, xz, yz = np.asarray(values, dtype=np.float64)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
