"""Position sensor: the encoder reading for a true position."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.parameters import Parameter, Value, as_float, joint_array
from pidtsm_core.robots import find_robot
from pidtsm_core.simulation.randomness import Column

PARAMETERS = (
    Parameter(
        "encoder.bits",
        0,
        "resolution of the encoders, 2^bits steps per revolution, or per metre of a joint that slides; 0: ideal",
        minimum=0,
        maximum=40,
        per_joint=True,
    ),
    Parameter("encoder.bias", 0.0, "error of the encoders' zero", "rad", per_joint=True),
    Parameter("noise.std", 0.0, "standard deviation of the Gaussian noise of the position", "rad", 0.0, per_joint=True),
    Parameter(
        "backlash.gap",
        0.0,
        "play between joint and motor, from one flank to the other; the encoder is on the motor",
        "rad",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter("effort_sensor.offset", 0.0, "error of the zero of the reported effort", "N m", per_joint=True),
    Parameter(
        "effort_sensor.noise",
        0.0,
        "standard deviation of the Gaussian noise of the reported effort",
        "N m",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "effort_sensor.side",
        "motor",
        "where the reported effort is measured: the torque of the motor, or of an elastic joint what reaches its link",
        choices=("motor", "link"),
    ),
    Parameter("jitter.std", 0.0, "standard deviation of the sampling time from its stamp (Gaussian)", "s", minimum=0.0),
)


class SensorConfig(NamedTuple):
    """Parameters of a measurement."""

    step: Array  # shape (joints,), rad or m, 0 for ideal encoders
    bias: Array  # shape (joints,), rad
    noise: Array  # shape (joints,), rad
    backlash: Array  # shape (joints,), rad
    jitter: float  # s
    effort_offset: Array  # shape (joints,), N m
    effort_noise: Array  # shape (joints,), N m
    effort_of_link: bool  # the effort is what reaches the link
    ideal: bool  # none of the above


def sensor_config(values: Mapping[str, Value], joints: int) -> SensorConfig:
    """Args: values: `PARAMETERS` and those of the robot, as returned by `resolve`."""
    bits = joint_array(values["encoder.bits"], joints)
    span = np.where(find_robot(values).slides or False, 1.0, 2.0 * math.pi)
    step = np.where(bits > 0, span / 2.0**bits, 0.0)
    bias, noise, backlash = (
        joint_array(values[name], joints) for name in ("encoder.bias", "noise.std", "backlash.gap")
    )
    jitter = as_float(values["jitter.std"])
    offset, effort_noise = (joint_array(values[f"effort_sensor.{name}"], joints) for name in ("offset", "noise"))
    of_link = values["effort_sensor.side"] == "link"
    disturbed = any(each.any() for each in (step, bias, noise, backlash, offset, effort_noise))
    ideal = not (disturbed or jitter or of_link)
    return SensorConfig(step, bias, noise, backlash, jitter, offset, effort_noise, of_link, ideal)


@inlined
def measure(config: SensorConfig, motor: Array, q: Array, dq: Array, draws: Array, measured: Array) -> None:
    """measured = step round((m + bias + noise) / step), rad, shape (joints,), with the motor position m.

    Backlash is a play operator: a motor stays within half the gap around its joint and moves only when a flank drags it
    along; `motor` stores m. The joint is sampled at q(t + jitter) = q + q' jitter, exact to (q'' / 2) jitter^2, all
    joints at the same time. `draws` is a row of `Randomness`.
    """
    if config.ideal:
        for j in range(q.size):
            measured[j] = q[j]
        return
    for j in range(q.size):
        joint = q[j] + dq[j] * (config.jitter * draws[Column.JITTER])
        half = 0.5 * config.backlash[j]
        motor[j] = min(max(motor[j], joint - half), joint + half)
        x = motor[j] + config.bias[j] + config.noise[j] * draws[Column.NOISE + j]
        step = config.step[j]
        measured[j] = step * math.floor(x / step + 0.5) if step > 0.0 else x


@inlined
def measure_effort(config: SensorConfig, applied: Array, transmitted: Array, draws: Array, measured: Array) -> None:
    """Write the effort that the drives report: of the motors or what reaches the links, plus offset and noise, N m.

    Arrays of shape (joints,), but for `draws`, a row of `Randomness`.
    """
    first = draws.size - applied.size  # of the columns of `Column.EFFORT_SENSOR`
    for j in range(applied.size):
        effort = transmitted[j] if config.effort_of_link else applied[j]
        measured[j] = effort + config.effort_offset[j] + config.effort_noise[j] * draws[first + j]
