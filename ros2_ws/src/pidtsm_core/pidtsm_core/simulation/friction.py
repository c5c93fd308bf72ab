"""Friction of the joints: Stribeck's curve."""

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
    """What friction reads, arrays of shape (joints,)."""

    coulomb: Array  # N m
    excess: Array  # of static over Coulomb friction, N m
    stribeck_velocity: Array  # rad/s
    viscous: Array  # N m s/rad
    none: bool


def friction_config(values: Mapping[str, Value], joints: int) -> FrictionConfig:
    """Args: values: `PARAMETERS`, as `resolve` returns them."""
    coulomb, static, velocity, viscous = (joint_array(values[p.name], joints) for p in PARAMETERS)
    none = not (coulomb.any() or static.any() or viscous.any())
    return FrictionConfig(coulomb, np.maximum(static - coulomb, 0.0), velocity, viscous, none)


@njit
def add_friction(config: FrictionConfig, dq: Array, effort: Array) -> None:
    """Take (Fc + (Fs - Fc) exp(-(v / vs)^2)) tanh(v / v0) + Fv v from effort, N m, shape (joints,); v0 = vs / 10.

    The curve is that of Armstrong-Helouvry, Dupont and Canudas de Wit (Automatica 30, 1994). tanh instead of the sign
    (Makkar et al., AIM 2005) leaves an equation that Runge-Kutta solves and nothing that chatters at rest. The price:
    a joint that should stick creeps, slower than v0.
    """
    for j in range(effort.size):
        ratio = dq[j] / config.stribeck_velocity[j]
        level = config.coulomb[j] + config.excess[j] * math.exp(-ratio * ratio)
        effort[j] -= level * math.tanh(_SHARPNESS * ratio) + config.viscous[j] * dq[j]
