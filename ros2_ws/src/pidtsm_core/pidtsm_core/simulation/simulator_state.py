"""What a sample of the simulated robot reads and changes."""

from typing import NamedTuple

from pidtsm_core.arrays import Array
from pidtsm_core.robots import Model
from pidtsm_core.simulation.actuator import ActuatorConfig
from pidtsm_core.simulation.brakes import BrakesState
from pidtsm_core.simulation.channel import ChannelConfig, ChannelState
from pidtsm_core.simulation.current_loop import CurrentLoopConfig, CurrentLoopState
from pidtsm_core.simulation.plant_state import PlantConfig, PlantState
from pidtsm_core.simulation.sensor import SensorConfig


class SimulatorConfig(NamedTuple):
    """Parameters of a sample."""

    sensor: SensorConfig
    measurements: ChannelConfig
    commands: ChannelConfig
    patience: int  # samples without a new command after which the brakes engage
    current: CurrentLoopConfig
    actuator: ActuatorConfig
    adds_gravity: bool  # the firmware adds the effort that carries the arm
    firmware: Model  # model of the arm that the firmware uses: without model errors and payload
    plant: PlantConfig


class SimulatorState(NamedTuple):
    """State changed by a sample."""

    measurements: ChannelState  # packets: measured q, true q', q'', applied effort; shape (4, joints)
    commands: ChannelState  # packets: effort, shape (1, joints)
    command: Array  # effort that arrived last, shape (joints,), N m
    brakes: BrakesState
    motor: Array  # position on the motor side of the backlash, shape (joints,), rad
    current: CurrentLoopState
    lagging: Array  # torque of the drives at the end of the sample, shape (joints,), N m
    effort: Array  # torque of the motors over the sample, before the limits, shape (joints,), N m
    gravity: Array  # scratch of the firmware, shape (2, joints), N m
    arm: PlantState
