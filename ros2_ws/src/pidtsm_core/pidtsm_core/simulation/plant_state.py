"""What a step of the simulated arm reads and changes."""

from typing import NamedTuple

from pidtsm_core.arrays import Array
from pidtsm_core.robots import Model, Tool
from pidtsm_core.simulation.disturbances import DisturbanceConfig
from pidtsm_core.simulation.drivetrain import Drivetrain, DrivetrainState
from pidtsm_core.simulation.friction import FrictionConfig
from pidtsm_core.simulation.mujoco_plant import MujocoConfig, MujocoState


class PlantConfig(NamedTuple):
    """Parameters of a step."""

    model: Model
    loaded_model: Model  # the same with payload
    payload_begin: float  # s
    payload_end: float  # s
    disturbance: DisturbanceConfig
    effort_limit: Array  # shape (joints,), N m
    push: Array  # on the joints, shape (joints,), N m
    wrench: Array  # of a push on the tool: force and torque in the axes of the base, shape (6,), N and N m
    tool: Tool
    push_begin: float  # s
    push_end: float  # s
    friction: FrictionConfig
    accelerations: bool  # compute q'' at the samples
    drivetrain: Drivetrain
    mujoco: MujocoConfig


class PlantState(NamedTuple):
    """State changed by a step."""

    position: Array  # q, shape (joints,), rad
    derivatives: Array  # q', q'', shape (2, joints); q'' under the torque held before the sample, 0 at the start
    effort: Array  # torque applied over the last step, within the limits, shape (joints,), N m
    work: Array  # scratch, shape (8, joints)
    wrench: Array  # on the tool from outside, as that of a push, shape (6,); and scratch; shape (2, 6)
    placements: Array  # scratch, shape (joints, 3, 4)
    drivetrain: DrivetrainState
    mujoco: MujocoState
