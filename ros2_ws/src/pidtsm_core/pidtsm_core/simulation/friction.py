"""Joint friction: Stribeck curve."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.compiled import njit
from pidtsm_core.parameters import Array, Parameter, Value, joint_array

PARAMETERS = (
    Parameter("friction.coulomb", 0.0, "Coulomb friction Fc of the joints", "N m", minimum=0.0, per_joint=True),
    Parameter(
        "friction.static",
        0.0,
        "static friction Fs; it has an effect only if it exceeds friction.coulomb",
        "N m",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "friction.stribeck_velocity",
        0.05,
        "Stribeck velocity vs, at which static friction changes to Coulomb friction",
        "rad/s",
        minimum=0.0,
        exclusive=True,
        per_joint=True,
    ),
    Parameter("friction.viscous", 0.0, "viscous friction Fv", "N m s/rad", minimum=0.0, per_joint=True),
)

_SHARPNESS = 10.0  # vs / v0, see `add_friction`.


class FrictionConfig(NamedTuple):
    """Parameters of friction, arrays of shape (joints,)."""

    coulomb: Array  # N m
    excess: Array  # static minus Coulomb friction, N m
    stribeck_velocity: Array  # rad/s
    viscous: Array  # N m s/rad
    none: bool


def friction_config(values: Mapping[str, Value], joints: int) -> FrictionConfig:
    """Args: values: `PARAMETERS`, as returned by `resolve`."""
    coulomb, static, velocity, viscous = (joint_array(values[p.name], joints) for p in PARAMETERS)
    none = not (coulomb.any() or static.any() or viscous.any())
    return FrictionConfig(coulomb, np.maximum(static - coulomb, 0.0), velocity, viscous, none)


@njit
def add_friction(config: FrictionConfig, dq: Array, effort: Array) -> None:
    """Subtract (Fc + (Fs - Fc) exp(-(v / vs)^2)) tanh(v / v0) + Fv v from effort, N m, shape (joints,); v0 = vs / 10.

    The curve is that of Armstrong-Helouvry, Dupont and Canudas de Wit (Automatica 30, 1994). With tanh instead of the
    sign (Makkar et al., AIM 2005), Runge-Kutta can solve the equation, and nothing chatters at rest. The drawback: a
    joint that should stick creeps, slower than v0.
    """
    for j in range(effort.size):
        ratio = dq[j] / config.stribeck_velocity[j]
        level = config.coulomb[j] + config.excess[j] * math.exp(-ratio * ratio)
        effort[j] -= level * math.tanh(_SHARPNESS * ratio) + config.viscous[j] * dq[j]
