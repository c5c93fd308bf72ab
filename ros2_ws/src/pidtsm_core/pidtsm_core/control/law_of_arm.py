"""A law of the whole arm within a tick; compiled only if such a law was chosen."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.contact import in_contact
from pidtsm_core.control.effort import held_back
from pidtsm_core.control.state import Condition, ControllerState, part
from pidtsm_core.laws import ArmSample, Demand, advance_arm, command_arm
from pidtsm_core.signals import Signal, Status


@part
def advance_law_of_arm(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Advance the memory of the law over dt (s) with the values of the last tick."""
    stopped = state.status[Status.FAULT] != 0 or in_contact(config, state)
    for j in range(state.frozen.size):
        state.frozen[j] = 1.0 if stopped or (config.freezes and held_back(config, state, j)) else 0.0
    advance_arm(config.law, state.law_memory, state.frozen, dt, state.conditions[Condition.ADAPTATION])


@inlined
def write_demand(config: ControllerConfig, state: ControllerState, motion: Array, desired: Array, dt: float) -> None:
    """Write what the law demands for a motion and a desired one, both of shape (3, joints), to ``state.demand``."""
    law = config.law
    arm = ArmSample(
        motion,
        desired,
        state.net,
        state.rejected,
        config.limits.effort,
        config.model,
        law.tree,
        law.tool_row,
        law.tool_point,
        dt,
    )
    command_arm(law, arm, state.law_memory, state.demand)


@part
def command_law_of_arm(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Write the law's signals and accelerations, with dt as in `tick`; what it demands of efforts is added later."""
    y, demand = state.signals, state.demand
    motion, desired = y[: Signal.POSITION_ERROR], state.desired
    if config.drive.late:
        motion, desired = state.predicted, state.ahead
    write_demand(config, state, motion, desired, dt)
    for j in range(y.shape[1]):
        y[Signal.POSITION_ERROR, j] = motion[0, j] - desired[0, j]
        y[Signal.VELOCITY_ERROR, j] = motion[1, j] - desired[1, j]
        y[Signal.SLIDING_VARIABLE, j] = demand[Demand.SLIDING_VARIABLE, j]
        y[Signal.MANIFOLD_VARIABLE, j] = demand[Demand.MANIFOLD_VARIABLE, j]
        y[Signal.ADAPTIVE_GAIN, j] = demand[Demand.ADAPTIVE_GAIN, j]
        y[Signal.SWITCHING_TERM, j] = demand[Demand.SWITCHING_TERM, j]
        state.accelerations[0, j] = demand[Demand.EQUIVALENT_ACCELERATION, j] - state.rejected[j]
        state.accelerations[1, j] = demand[Demand.ACCELERATION, j] - state.rejected[j]
