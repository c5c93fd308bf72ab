"""Joint friction: Stribeck curve, and a constant effort."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import PartOf
from pidtsm_core.parameters import Parameter, ParameterError, Value, joint_array, names
from pidtsm_core.robots import Robot

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
    Parameter("friction.offset", 0.0, "constant effort that a joint needs beside friction", "N m", per_joint=True),
)

_SHARPNESS = 10.0  # vs / v0, see `add_friction`.
_STEEPEST = 1.0
"""Largest rate at which friction may stop a joint, as a multiple of 1 / dt; Runge-Kutta becomes unstable at 2.8."""


def parameters(robot: Robot) -> tuple[Parameter, ...]:
    """`PARAMETERS`, with the friction of the robot's description as defaults."""
    defaults = {"friction.coulomb": robot.friction, "friction.viscous": robot.damping}
    return tuple(replace(p, default=defaults.get(p.name) or p.default) for p in PARAMETERS)


class FrictionConfig(NamedTuple):
    """Parameters of friction, arrays of shape (joints,)."""

    coulomb: Array  # N m
    excess: Array  # static minus Coulomb friction, N m
    stribeck_velocity: Array  # rad/s
    viscous: Array  # N m s/rad
    offset: Array  # N m
    none: bool


def friction_config(values: Mapping[str, Value], inertia: Array, dt: float) -> FrictionConfig:
    """Prepare the friction.

    Where a joint has little inertia, Coulomb friction rises less steeply around standstill than by `PARAMETERS`, and
    viscous friction is smaller, so that Runge-Kutta can solve the equation.

    Args:
        values: `PARAMETERS`, as returned by `resolve`.
        inertia: that the effort of each joint accelerates, shape (joints,), kg m^2.
        dt: step of the integration, s.
    """
    coulomb, static, velocity, viscous, offset = (joint_array(values[p.name], inertia.size) for p in PARAMETERS)
    steepest = _STEEPEST * inertia / dt
    velocity = np.maximum(velocity, _SHARPNESS * np.maximum(coulomb, static) / steepest)
    none = not (coulomb.any() or static.any() or viscous.any() or offset.any())
    excess, viscous = np.maximum(static - coulomb, 0.0), np.minimum(viscous, steepest)
    return FrictionConfig(coulomb, excess, velocity, viscous, offset, none)


def without_viscous(config: FrictionConfig) -> FrictionConfig:
    """The same friction without its viscous part, for an engine that has its own."""
    none = not (config.coulomb.any() or config.excess.any() or config.offset.any())
    return config._replace(viscous=np.zeros_like(config.viscous), none=none)


def check_friction(values: Mapping[str, Value], inertia: Array, dt: float) -> None:
    """Check that the simulation can follow the viscous friction; arguments as those of `friction_config`.

    Raises:
        ParameterError: it stops a joint too fast.
    """
    viscous = joint_array(values["friction.viscous"], inertia.size)
    for j in np.flatnonzero(viscous * dt > _STEEPEST * inertia):
        raise ParameterError(
            f"friction.viscous: {viscous[j]:g} N m s/rad stop {names(values['joints'])[j]}, whose inertia is "
            f"{inertia[j]:.2g} kg m^2, faster than the simulation can follow; set robot.armature of controller and "
            "simulator, the inertia of its rotor, or raise the rate",
            "friction.viscous",
        )


part = PartOf(lambda: FrictionConfig(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), none=True))


@part
def add_friction(config: FrictionConfig, dq: Array, effort: Array) -> None:
    """Subtract (Fc + (Fs - Fc) exp(-(v / vs)^2)) tanh(v / v0) + Fv v + F0 from effort, N m; v0 = vs / 10.

    F0 is the offset; effort has shape (joints,).

    The curve is that of Armstrong-Helouvry, Dupont and Canudas de Wit (Automatica 30, 1994). With tanh instead of the
    sign (Makkar et al., AIM 2005), Runge-Kutta can solve the equation, and nothing chatters at rest. The drawback: a
    joint that should stick creeps, slower than v0.
    """
    for j in range(effort.size):
        ratio = dq[j] / config.stribeck_velocity[j]
        level = config.coulomb[j] + config.excess[j] * math.exp(-ratio * ratio)
        effort[j] -= level * math.tanh(_SHARPNESS * ratio) + config.viscous[j] * dq[j]
        if config.offset[j] != 0.0:
            effort[j] -= config.offset[j]
