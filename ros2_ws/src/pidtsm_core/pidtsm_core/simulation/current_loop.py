"""Current loop of a drive: when it takes a command, in which steps, and how fast its torque follows."""

from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import PartOf
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.parameters import Parameter, ParameterError, Value, as_float, joint_array
from pidtsm_core.timing import period_nanoseconds, seconds

_RATE = Parameter(
    "actuator.rate",
    0.0,
    "rate at which the drives take commands, at most that of the simulator; 0: that of the simulator",
    "Hz",
    minimum=0.0,
)
PARAMETERS = (
    _RATE,
    Parameter(
        "actuator.resolution",
        0.0,
        "step of the commands of the drives, which round to it; 0: none",
        "N m",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "actuator.frequency",
        0.0,
        "natural frequency of a second-order current loop; 0: the torque is the command at once, but for actuator.lag",
        "rad/s",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "actuator.damping",
        0.7,
        "damping ratio of that loop",
        minimum=0.0,
        exclusive=True,
        per_joint=True,
    ),
)


class By(IntEnum):
    """Columns of `CurrentLoopConfig.transition`: what a state at the start of a sample contributes.

    The states are the difference of torque and command, and its rate.
    """

    DIFFERENCE = 0  # the difference to the difference at the end
    RATE = 1  # the rate to the difference
    DIFFERENCE_TO_RATE = 2
    RATE_TO_RATE = 3
    DIFFERENCE_TO_MEAN = 4
    RATE_TO_MEAN = 5


class CurrentLoopConfig(NamedTuple):
    """Parameters of the current loops."""

    ticks: float  # of the drives in a sample, at most 1
    resolution: Array  # shape (joints,), N m
    transition: Array  # over a sample, see `By`, shape (joints, len(By))
    ideal: bool


class CurrentLoopState(NamedTuple):
    """State changed by `follow`."""

    phase: Array  # ticks of the drives until now, modulo 1, shape (1,); it takes a command where this reaches 1
    taken: Array  # command, shape (joints,), N m
    torque: Array  # of the motors at the end of the sample, shape (joints,), N m
    rate: Array  # its rate, shape (joints,), N m/s
    mean: Array  # mean torque over the sample, shape (joints,), N m


def current_loop_config(values: Mapping[str, Value], joints: int) -> CurrentLoopConfig:
    """Prepare the current loops; `values`: `PARAMETERS` and ``rate``, as returned by `resolve`.

    Raises:
        ParameterError: the drives are faster than the simulator.
    """
    rate = as_float(values["rate"])
    of_drives = as_float(values[_RATE.name])
    if of_drives > rate:
        raise ParameterError(
            f"{_RATE.name}: {of_drives:g} Hz is more than the {rate:g} Hz of the simulator; lower it, or raise rate",
            _RATE.name,
        )
    resolution, frequency, damping = (joint_array(values[p.name], joints) for p in PARAMETERS[1:])
    dt = seconds(period_nanoseconds(int(rate)))
    return CurrentLoopConfig(
        ticks=of_drives / rate if of_drives else 1.0,
        resolution=resolution,
        transition=np.array([_transition(w, d, dt) for w, d in zip(frequency, damping, strict=True)]),
        ideal=not (of_drives or resolution.any() or frequency.any()),
    )


def _transition(frequency: float, damping: float, dt: float) -> Array:
    """Row of `CurrentLoopConfig.transition`: exact for a command that does not change within the sample."""
    if frequency == 0.0:
        return np.zeros(len(By))
    from scipy.linalg import expm  # This import takes a seventh of the time of a short process.

    # The integral of the difference is a third state.
    rates = np.array([[0.0, 1.0, 0.0], [-(frequency**2), -2.0 * damping * frequency, 0.0], [1.0 / dt, 0.0, 0.0]])
    over = np.asarray(expm(rates * dt))
    return over[:, :2].ravel()  # In the order of `By`.


def current_loop_state(joints: int) -> CurrentLoopState:
    """The state of drives without torque, which take the next command."""
    return CurrentLoopState(np.ones(1), np.zeros(joints), np.zeros(joints), np.zeros(joints), np.zeros(joints))


def _example() -> tuple[CurrentLoopConfig, CurrentLoopState]:
    return CurrentLoopConfig(1.0, np.zeros(1), np.zeros((1, len(By))), ideal=True), current_loop_state(1)


part = PartOf(lambda: _example()[0], lambda: _example()[1])


@inlined
def rest(state: CurrentLoopState) -> None:
    """Take the torque from the motors; the drives take the next command."""
    state.phase[0] = 1.0
    for j in range(state.taken.size):
        state.taken[j] = state.torque[j] = state.rate[j] = state.mean[j] = 0.0


@part
def follow(config: CurrentLoopConfig, state: CurrentLoopState, command: Array) -> None:
    """Advance by a sample in which there is a command, shape (joints,), N m; the torque is in ``state.mean``.

    x'' + 2 d w x' + w^2 (x - u) = 0, solved exactly, of the command u that was taken last, rounded to its steps.
    """
    takes = state.phase[0] > 1.0 - 1e-9
    if takes:
        state.phase[0] -= 1.0
    state.phase[0] += config.ticks
    for j in range(command.size):
        if takes:
            step = config.resolution[j]
            state.taken[j] = step * round(command[j] / step) if step > 0.0 else command[j]
        over, target = config.transition[j], state.taken[j]
        difference, rate = state.torque[j] - target, state.rate[j]
        state.torque[j] = target + over[By.DIFFERENCE] * difference + over[By.RATE] * rate
        state.rate[j] = over[By.DIFFERENCE_TO_RATE] * difference + over[By.RATE_TO_RATE] * rate
        state.mean[j] = target + over[By.DIFFERENCE_TO_MEAN] * difference + over[By.RATE_TO_MEAN] * rate
