"""Actuator: the torque that a motor delivers for a commanded torque."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import PartOf
from pidtsm_core.parameters import Parameter, Value, as_float, joint_array
from pidtsm_core.timing import period_nanoseconds, seconds

PARAMETERS = (
    Parameter(
        "actuator.dead_zone",
        0.0,
        "dead zone of the drives: up to this command there is no torque",
        "N m",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "actuator.lag", 0.0, "time constant of the first-order lag of the drives", "s", minimum=0.0, per_joint=True
    ),
    Parameter(
        "actuator.torque_constant_error",
        0.0,
        "relative error of the torque; 0.05: 5 % too much",
        minimum=-1.0,
        maximum=1.0,
        per_joint=True,
    ),
    Parameter(
        "actuator.ripple",
        0.0,
        "amplitude of the torque ripple, as a share of the torque",
        minimum=0.0,
        maximum=1.0,
        per_joint=True,
    ),
    Parameter("actuator.ripple_periods", 12, "periods of the ripple per revolution", minimum=1, per_joint=True),
    Parameter(
        "actuator.noise",
        0.0,
        "standard deviation of the Gaussian noise of the torque, constant over a sample",
        "N m",
        minimum=0.0,
        per_joint=True,
    ),
)


class ActuatorConfig(NamedTuple):
    """Parameters of the actuators, arrays of shape (joints,)."""

    dead_zone: Array  # N m
    decay: Array  # exp(-dt / lag): remaining fraction of a difference after one sample, 0 without lag
    mean: Array  # mean fraction of the difference over the sample
    gain: Array  # actual torque per nominal torque
    ripple: Array  # fraction of the torque
    periods: Array  # ripple periods per revolution
    noise: Array  # standard deviation, N m
    ideal: bool


def actuator_config(values: Mapping[str, Value], joints: int) -> ActuatorConfig:
    """Args: values: `PARAMETERS` and ``rate``, as returned by `resolve`."""
    dt = seconds(period_nanoseconds(int(as_float(values["rate"]))))
    dead_zone, lag, error, ripple, periods, noise = (joint_array(values[p.name], joints) for p in PARAMETERS)
    ratio = np.divide(dt, lag, out=np.full(joints, math.inf), where=lag > 0.0)
    return ActuatorConfig(
        dead_zone=dead_zone,
        decay=np.exp(-ratio),
        mean=-np.expm1(-ratio) / ratio,
        gain=1.0 + error,
        ripple=ripple,
        periods=periods,
        noise=noise,
        ideal=not any(each.any() for each in (dead_zone, lag, error, ripple, noise)),
    )


def _example() -> ActuatorConfig:
    none = np.zeros(1)
    return ActuatorConfig(none, none, none, none, none, none, none, ideal=True)


part = PartOf(_example)


@part
def drive(config: ActuatorConfig, lagging: Array, command: Array, q: Array, draws: Array, effort: Array) -> None:
    """Write the torque over one sample to `effort`, N m, shape (joints,); `draws` is a row of `Randomness`.

    Dead zone: u = sign(c) max(|c| - width, 0) (Tao and Kokotovic 1994). Lag: T x' = u - x, solved exactly for a
    constant u; `lagging` is x at the end of the sample. The torque is (1 + error) (1 + ripple sin(n q)) times the mean
    of x over the sample, so that the angular impulse on the joint is exact despite the lag. Noise is added last.
    """
    first = draws.size - 2 * command.size  # of the columns of `Column.EFFORT_NOISE`
    for j in range(command.size):
        target = math.copysign(max(abs(command[j]) - config.dead_zone[j], 0.0), command[j])
        difference = lagging[j] - target
        effort[j] = target + config.mean[j] * difference
        lagging[j] = target + config.decay[j] * difference
        effort[j] *= config.gain[j] * (1.0 + config.ripple[j] * math.sin(config.periods[j] * q[j]))
        if config.noise[j] > 0.0:
            effort[j] += config.noise[j] * draws[first + j]
