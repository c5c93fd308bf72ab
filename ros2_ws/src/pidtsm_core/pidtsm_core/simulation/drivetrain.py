"""Drive trains: between each motor and its link a gear that is elastic, with friction on the side of the motor.

Parameters, configuration and state; `pidtsm_core.simulation.drivetrain_step` computes the motion.
"""

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, ParameterError, Value, as_float, joint_array, names
from pidtsm_core.robots import Model, Robot, inverse_dynamics
from pidtsm_core.robots.base import unit_accelerations
from pidtsm_core.simulation.disturbances import DISTURBANCES, DisturbanceConfig, make_disturbance
from pidtsm_core.simulation.gear_friction import GearFriction, gear_friction, is_active

MOTOR, LINK = "motor", "link"
"""The sides of a drive train."""
STIFFNESS = Parameter(
    "elasticity.stiffness",
    0.0,
    "stiffness of the drive trains between motor and link; 0: rigid",
    "N m/rad",
    minimum=0.0,
    per_joint=True,
    read_only=True,
)
_DAMPING = Parameter(
    "elasticity.damping",
    0.0,
    "damping of the drive trains between motor and link",
    "N m s/rad",
    minimum=0.0,
    per_joint=True,
    read_only=True,
)
ENCODER = Parameter(
    "elasticity.encoder",
    MOTOR,
    "the side of an elastic drive train on which the encoder is",
    choices=(MOTOR, LINK),
    read_only=True,
)
PARAMETERS = (STIFFNESS, _DAMPING, ENCODER)

_ANGLE = 0.7
"""rad; largest angle by which a joint may vibrate in a substep: its frequency is then exact to angle^4 / 720."""
_SUBSTEPS = 2
"""Smallest number of substeps."""
MOST_SUBSTEPS = 8
"""A faster vibration is stable, but its frequency is not exact."""


class Kept(IntEnum):
    """Rows of `DrivetrainState.start`."""

    LINK = 0
    LINK_VELOCITY = 1
    MOTOR = 2
    MOTOR_VELOCITY = 3
    BRISTLE = 4
    SLIDING = 5
    TRANSMITTED = 6


class Middle(IntEnum):
    """Rows of `DrivetrainState.middle`."""

    POSITION = 0  # of the links, rad
    VELOCITY = 1  # rad/s
    NET = 2  # torque on the links from outside, without c(q, q'), N m


class Rub(IntEnum):
    """Rows of `DrivetrainState.friction`: what resists a motor."""

    LEVEL = 0  # of the dry friction, without asymmetry, N m
    DRY = 1  # what depends on neither velocity nor direction, N m
    DRAG = 2  # what is proportional to the velocity, N m s/rad


class Term(IntEnum):
    """Rows of `DrivetrainState.terms`, with the complex velocities W of a motor, V of its link, and the torque S.

    W = FREE + FOLLOWS V, and S = CARRIED - IMPEDANCE (V - q').
    """

    FREE = 0
    FOLLOWS = 1
    CARRIED = 2
    CHANGE = 3  # V - q', of which the equations are solved
    IMPEDANCE = 4


class Drivetrain(NamedTuple):
    """Parameters of the drive trains, arrays of shape (joints,)."""

    substeps: int  # in a step; 0: all joints are rigid and have smooth friction only, which Runge-Kutta integrates
    elastic: bool  # at least one joint is
    on_motor: bool  # the encoders measure the motors of elastic joints
    fastest: float  # vibration of a spring, or decay of friction, rad/s
    moved: Array  # inertia that the motors move themselves: rotors of elastic joints, or that of the joint, kg m^2
    rotor: Array  # inertia of the rotors of elastic joints as the joints see it, kg m^2
    stiffness: Array  # N m/rad, 0: rigid
    damping: Array  # N m s/rad
    friction: GearFriction
    disturbance: DisturbanceConfig  # it acts on the links


class DrivetrainState(NamedTuple):
    """State changed by a step."""

    torque: Array  # of the motors over the step, shape (joints,), N m
    external: Array  # what else acts on the links, shape (joints,), N m
    motor: Array  # position of the motors behind their gears, shape (joints,), rad; that of the link if it is rigid
    motor_velocity: Array  # shape (joints,), rad/s
    bristle: Array  # deflection of the friction, shape (joints,), rad
    sliding: Array  # its direction, 0: sticks, shape (joints,)
    transmitted: Array  # torque from motor to link, mean of the last substep, shape (joints,), N m
    start: Array  # scratch: the motion at the start of the step, see `Kept`, shape (len(Kept), joints)
    middle: Array  # scratch: what holds in the middle of the step, see `Middle`, shape (len(Middle), joints)
    rows: Array  # accelerations of which the efforts are computed: 0, and the unit vectors, shape (joints + 1, joints)
    efforts: Array  # their efforts, shape (joints + 1, joints), N m
    inertia: Array  # of the links, shape (joints, joints), kg m^2
    friction: Array  # scratch, see `Rub`, shape (len(Rub), joints)
    matrix: Array  # scratch, complex, shape (joints, joints)
    terms: Array  # scratch, complex, see `Term`, shape (len(Term), joints)


def drivetrain(values: Mapping[str, Value], robot: Robot, model: Array) -> Drivetrain:
    """Prepare the drive trains.

    Args:
        values: `PARAMETERS` and the others of the plant, as returned by `resolve`.
        robot: the arm.
        model: its packed parameters, shape (n,).

    Raises:
        ParameterError: a joint that is elastic has no rotor, or nothing to move without its rotor.
    """
    joints = len(robot.joints)
    stiffness, damping = (joint_array(values[p.name], joints) for p in (STIFFNESS, _DAMPING))
    elastic, active = stiffness > 0.0, is_active(values) or bool(stiffness.any())
    rotor, moved, vibration = np.zeros(joints), np.ones(joints), 0.0
    if active:
        whole = robot.inertia_matrix(model.copy(), joint_array(values["initial_position"], joints))
        rotor = np.where(elastic, robot.rotors(model), 0.0)
        _check_rotors(values, rotor, stiffness)
        vibration = _vibration(values, whole, rotor, stiffness)
        moved = np.where(elastic, rotor, 1.0 / np.diag(np.linalg.inv(whole)))
    friction = gear_friction(values, moved)
    needed = math.ceil(vibration / as_float(values["rate"]) / _ANGLE)
    bristles = np.sqrt(friction.stiffness / moved).max()
    return Drivetrain(
        substeps=min(max(needed, _SUBSTEPS), MOST_SUBSTEPS) if active else 0,
        elastic=bool(elastic.any()),
        on_motor=bool(elastic.any()) and values[ENCODER.name] == MOTOR,
        fastest=max(vibration, float(bristles)),
        moved=moved,
        rotor=rotor,
        stiffness=stiffness,
        damping=np.where(elastic, damping, 0.0),
        friction=friction,
        disturbance=make_disturbance(DISTURBANCES[str(values["disturbance.name"])], values, joints),
    )


def _check_rotors(values: Mapping[str, Value], rotor: Array, stiffness: Array) -> None:
    """Check that elastic joints have rotors."""
    for j in np.flatnonzero((stiffness > 0.0) & (rotor <= 0.0)):
        raise ParameterError(
            f"{STIFFNESS.name}: {names(values['joints'])[j]} has no rotor, which an elastic joint needs; set "
            "robot.armature of controller and simulator, the inertia of its rotor as the joint sees it (rotor times "
            f"gear ratio squared), or make the joint rigid with a {STIFFNESS.name} of 0",
            STIFFNESS.name,
        )


def _vibration(values: Mapping[str, Value], whole: Array, rotor: Array, stiffness: Array) -> float:
    """Largest angular frequency of a joint whose other joints are rigid, rad/s; `whole`: inertia matrix with rotors.

    Raises:
        ParameterError: an elastic joint has nothing to move.
    """
    inertia = whole - np.diag(rotor)
    smallest, directions = np.linalg.eigh(inertia)
    if smallest[0] <= 1e-9 * np.trace(inertia) / rotor.size:
        j = int(np.abs(directions[:, 0]).argmax())
        raise ParameterError(
            f"{STIFFNESS.name}: {names(values['joints'])[j]} moves nothing but its rotor, so it cannot be elastic; "
            f"give its link an inertia, or make the joint rigid with a {STIFFNESS.name} of 0",
            STIFFNESS.name,
        )
    links, elastic = np.diag(np.linalg.inv(inertia)), stiffness > 0.0
    rotors = np.divide(1.0, rotor, out=np.zeros_like(rotor), where=elastic)
    return float(np.sqrt(np.max(np.where(elastic, stiffness * (rotors + links), 0.0))))


def drivetrain_state(joints: int) -> DrivetrainState:
    """The state of drive trains at rest, at position 0."""
    return DrivetrainState(
        torque=np.zeros(joints),
        external=np.zeros(joints),
        motor=np.zeros(joints),
        motor_velocity=np.zeros(joints),
        bristle=np.zeros(joints),
        sliding=np.zeros(joints),
        transmitted=np.zeros(joints),
        start=np.zeros((len(Kept), joints)),
        middle=np.zeros((len(Middle), joints)),
        rows=unit_accelerations(joints),
        efforts=np.zeros((joints + 1, joints)),
        inertia=np.zeros((joints, joints)),
        friction=np.zeros((len(Rub), joints)),
        matrix=np.zeros((joints, joints), dtype=np.complex128),
        terms=np.zeros((len(Term), joints), dtype=np.complex128),
    )


def rest_at(config: Drivetrain, state: DrivetrainState, model: Model, q: Array) -> None:
    """Put the drive trains at rest where the springs carry links at q, shape (joints,), against gravity."""
    effort, elastic = np.zeros((1, q.size)), config.stiffness > 0.0
    if elastic.any():
        inverse_dynamics(model, q, np.zeros(q.size), np.zeros((1, q.size)), effort)
    state.transmitted[:] = np.where(elastic, effort[0], 0.0)
    state.motor[:] = q + np.divide(effort[0], config.stiffness, out=np.zeros(q.size), where=elastic)
    state.motor_velocity[:] = state.bristle[:] = state.sliding[:] = 0.0


def example() -> tuple[Drivetrain, DrivetrainState, Model]:
    """Configuration, state and a model, for the compiler."""
    none = np.zeros(1)
    friction = GearFriction(*[none] * len(GearFriction._fields))
    drives = Drivetrain(0, False, False, 0.0, none, none, none, none, friction, DisturbanceConfig(0, np.zeros((1, 1))))
    return drives, drivetrain_state(1), Model(0, 0, 0, 0, none)
