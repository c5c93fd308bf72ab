"""The brakes of the drives: they stop the arm if no command arrives for too long, and hold it until the next one."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.parameters import Parameter, Value, as_float
from pidtsm_core.simulation.drivetrain_step import BRAKING
from pidtsm_core.simulation.plant import carry, stop_motors
from pidtsm_core.simulation.plant_state import PlantConfig, PlantState

COMMAND_TIMEOUT = Parameter(
    "command.timeout",
    0.02,
    "how long the last torque is held without a new command; then brakes stop the arm until the next command; "
    "0: the last torque is held without limit",
    "s",
    minimum=0.0,
)


class BrakesState(NamedTuple):
    """State changed by `release` and `watch`."""

    released: NDArray[np.bool_]  # shape (1,): a command has arrived
    silence: NDArray[np.int64]  # shape (1,): samples since the last one with a command, inclusive; 0: none yet


def brakes_state() -> BrakesState:
    """The state before the first command: engaged."""
    return BrakesState(np.zeros(1, dtype=np.bool_), np.zeros(1, dtype=np.int64))


def patience_of(values: Mapping[str, Value], period: int) -> int:
    """Samples without a new command after which the brakes engage, for a period in ns."""
    timeout = as_float(values[COMMAND_TIMEOUT.name])
    return min(round(timeout * 1e9) // period if timeout else 2**62, 2**62)


@inlined
def watch(patience: int, state: BrakesState, arrives: bool) -> None:
    """Engage the brakes if no command has reached the drives for too long."""
    if arrives:
        state.silence[0] = 1
    elif state.silence[0] > 0:
        state.silence[0] += 1
        if state.silence[0] > patience:
            state.released[0] = False


@inlined
def brake(config: PlantConfig, arm: PlantState, t: float, dt: float) -> None:
    """Move the arm from t to t + dt (s) with engaged brakes, which no force moves.

    Velocities decay exponentially, the motors deliver no torque. The brakes of elastic joints stop their motors; forces
    move the links.
    """
    if config.drivetrain.elastic:
        stop_motors(config, arm, t, dt)
        return
    left = math.exp(-dt / BRAKING)
    for j in range(arm.position.size):
        velocity = arm.derivatives[0, j]
        arm.position[j] += BRAKING * (1.0 - left) * velocity
        arm.derivatives[0, j] = left * velocity
        arm.derivatives[1, j] = -left * velocity / BRAKING
        arm.effort[j] = 0.0
    if config.mujoco.steps > 0:
        carry(config, arm, t)
