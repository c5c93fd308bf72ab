"""Friction of gears that sticks, depends on load, direction and temperature, and the cogging of drives."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, Value, joint_array

PARAMETERS = (
    Parameter(
        "friction.bristle_stiffness",
        0.0,
        "stiffness of a joint that sticks, until its static friction is exceeded; 0: friction is a smooth curve, and "
        "a joint that should stick creeps",
        "N m/rad",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "friction.bristle_damping",
        0.0,
        "damping of a joint that sticks; 0: as much as lets it come to rest without vibrating",
        "N m s/rad",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "friction.load",
        0.0,
        "Coulomb friction that the transmitted torque adds, as a share of it",
        minimum=0.0,
        maximum=1.0,
        per_joint=True,
    ),
    Parameter(
        "friction.asymmetry",
        0.0,
        "relative difference of dry friction in positive direction from the mean of both directions; 0.1: 10 % more, "
        "and 10 % less in negative direction",
        minimum=-1.0,
        maximum=1.0,
        per_joint=True,
    ),
    Parameter(
        "friction.cold",
        0.0,
        "relative excess of friction at the start, when the gears are cold; 0.5: 50 % more",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "friction.warm_up",
        600.0,
        "time constant with which that excess vanishes",
        "s",
        minimum=0.0,
        exclusive=True,
        per_joint=True,
    ),
    Parameter(
        "friction.cogging",
        0.0,
        "amplitude of a torque that depends on the position of the motor alone",
        "N m",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "friction.cogging_periods",
        100,
        "periods of that torque per revolution of the joint, or per 2 pi metres",
        minimum=1,
        per_joint=True,
    ),
)


class GearFriction(NamedTuple):
    """Parameters of the friction of gears, arrays of shape (joints,)."""

    coulomb: Array  # N m
    excess: Array  # static minus Coulomb friction, N m
    stribeck_velocity: Array  # rad/s
    viscous: Array  # N m s/rad
    offset: Array  # N m
    stiffness: Array  # of the bristles, N m/rad; 0: a smooth curve
    damping: Array  # of the bristles, N m s/rad
    load: Array  # share of the transmitted torque
    asymmetry: Array  # share
    cold: Array  # share
    warm_up: Array  # s
    cogging: Array  # N m
    periods: Array  # per revolution


_SWITCHES = ("bristle_stiffness", "load", "asymmetry", "cold", "cogging")


def is_active(values: Mapping[str, Value]) -> bool:
    """Whether there is more than the smooth curve of `friction`."""
    return any(np.any(values[f"friction.{name}"]) for name in _SWITCHES)


def gear_friction(values: Mapping[str, Value], moved: Array) -> GearFriction:
    """Prepare the friction.

    Args:
        values: `PARAMETERS` and those of `friction`, as returned by `resolve`.
        moved: inertia on which it acts, shape (joints,), kg m^2.
    """
    joints = moved.size
    smooth = ("coulomb", "static", "stribeck_velocity", "viscous", "offset")
    coulomb, static, velocity, viscous, offset = (joint_array(values[f"friction.{name}"], joints) for name in smooth)
    stiffness, damping, load, asymmetry, cold, warm_up, cogging, periods = (
        joint_array(values[p.name], joints) for p in PARAMETERS
    )
    critical = 2.0 * np.sqrt(stiffness * np.where(stiffness > 0.0, moved, 0.0))
    return GearFriction(
        coulomb=coulomb,
        excess=np.maximum(static - coulomb, 0.0),
        stribeck_velocity=velocity,
        viscous=viscous,
        offset=offset,
        stiffness=stiffness,
        damping=np.where(damping > 0.0, damping, critical),
        load=load,
        asymmetry=asymmetry,
        cold=cold,
        warm_up=warm_up,
        cogging=cogging,
        periods=periods,
    )
