"""What the law has learnt of the disturbances: what it demands without any error."""

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.law_of_arm import write_demand
from pidtsm_core.control.state import ControllerState, part
from pidtsm_core.laws import Demand, command
from pidtsm_core.signals import Signal


@part
def demand_without_error(config: ControllerConfig, state: ControllerState) -> None:
    """Write what a law of the whole arm demands without any error, which is what it has learnt, to ``state.demand``."""
    motion = state.motion
    for j in range(motion.shape[1]):
        motion[0, j] = state.signals[Signal.POSITION, j]
        motion[1, j] = state.signals[Signal.VELOCITY, j]
        motion[2, j] = 0.0
    write_demand(config, state, motion, motion, 0.0)


@inlined
def learnt_effort(config: ControllerConfig, state: ControllerState, joint: int) -> float:
    """What a law of the whole arm adds to the effort of `learnt_acceleration`, N m; see `demand_without_error`."""
    return state.demand[Demand.EFFORT, joint] if config.law.of_arm else 0.0


@inlined
def learnt_acceleration(config: ControllerConfig, state: ControllerState, joint: int) -> float:
    """Output of the law without any error, minus the rejected disturbance: what was learnt of the disturbances.

    Its unit is rad/s^2, or N m for a law that does not use the model. Of a law of the whole arm, see
    `demand_without_error`.
    """
    if config.law.of_arm:
        return state.demand[Demand.ACCELERATION, joint] - state.rejected[joint]
    learnt = command(config.law, joint, 0.0, 0.0, 0.0, 0.0, state.law[joint], 0.0)[0]
    return learnt - state.rejected[joint]
