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
    principal = np.linalg.eigvalsh(inertia)
    if principal[0] < -_ROUNDING * principal[2] or principal[2] > (1.0 + _ROUNDING) * (principal[0] + principal[1]):
        raise ParameterError(
            f"{_INERTIA.name}: no body has the principal inertias {', '.join(f'{p:.3g}' for p in principal)} kg m^2: "
            "none may be negative, or larger than the sum of the others",
            _INERTIA.name,
        )


def _matrix(values: object) -> Array:
    """The symmetric matrix of the entries of `_INERTIA`."""
    xx, yy, zz, xy, xz, yz = np.asarray(values, dtype=np.float64)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
