"""What an arm can do: the limits of its motions."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, ParameterError, joint_array
from pidtsm_core.robots import (
    DESCRIPTION,
    LOCKED,
    OF_ARM,
    XACRO,
    Model,
    Robot,
    find_robot,
    inverse_dynamics,
    make_model,
)
from pidtsm_core.robots.base import unit_accelerations
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.robots.payload import CENTER, MASS, Payload, payload_of
from pidtsm_core.trajectories.margins import PLANNED_EFFORT, PLANNED_SHARE
from pidtsm_core.units import TURNS, JointUnits

_OF_DESCRIPTION = "; 0: that of robot.description"

PARAMETERS = (
    replace(
        DESCRIPTION,
        default="",
        description=f"{DESCRIPTION.description}; empty: no arm, so that only limits set here apply",
    ),
    LOCKED,
    XACRO,
    Parameter(
        "limits.min_position",
        0.0,
        "smallest position of a trajectory; if it equals limits.max_position, both are those of robot.description",
        "rad",
        per_joint=True,
        read_only=True,
    ),
    Parameter(
        "limits.max_position",
        0.0,
        "largest position of a trajectory",
        "rad",
        per_joint=True,
        read_only=True,
    ),
    Parameter(
        "limits.velocity",
        0.0,
        "velocity beyond which the controller stops; a trajectory may use "
        f"{100.0 * PLANNED_SHARE:g} % of it{_OF_DESCRIPTION}",
        "rad/s",
        minimum=0.0,
        per_joint=True,
        read_only=True,
    ),
    Parameter(
        "limits.acceleration",
        0.0,
        "largest acceleration of a trajectory. 0: no limit for a trajectory that is sent; stops and motions planned "
        "here keep within what half the torque beyond gravity can accelerate (5 rad/s^2 without robot.description)",
        "rad/s^2",
        minimum=0.0,
        per_joint=True,
        read_only=True,
    ),
    Parameter(
        "limits.jerk",
        0.0,
        "largest jerk of stops and of motions planned here; 0: the largest acceleration is reached in 0.1 s",
        "rad/s^3",
        minimum=0.0,
        per_joint=True,
        read_only=True,
    ),
    Parameter(
        "limits.effort",
        0.0,
        f"largest torque that a trajectory may need{_OF_DESCRIPTION}",
        "N m",
        minimum=0.0,
        per_joint=True,
        read_only=True,
    ),
)
"""Parameters of `motion_limits`, for a node."""

_SHARE = 0.5
"""Share of the torque beyond gravity that the default acceleration may need."""
_LEAST = 0.1
"""Least share of the effort limit that counts as beyond gravity, where gravity takes nearly all of it."""
_WITHOUT_MODEL = 5.0
"""Default acceleration where no model or no effort limit is known, rad/s^2 or m/s^2."""
_RUN_UP = 0.2
"""Time in which the default acceleration reaches the largest velocity at the soonest, s."""
_RAMP = 0.1
"""Time in which the default jerk reaches the largest acceleration, s."""
_POSTURES = 200
"""Number of postures in which the default acceleration is possible."""


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of motions, each an array of shape (joints,); infinite: there is none.

    Attributes:
        joints: names of the joints, in the order of all arrays.
        lower, upper: position, rad or m.
        velocity: rad/s or m/s, beyond which the controller stops; see `planned_velocity`.
        acceleration: of stops and of motions planned by `timing`, rad/s^2 or m/s^2; finite.
        jerk: likewise, rad/s^3 or m/s^3; finite.
        effort: N m or N.
        given_acceleration: largest acceleration of trajectories that are sent, see `checking.check`.
        continuous: whether a joint turns without end, so that positions a turn apart are the same.
        model: of the arm, with which `checking` computes efforts; None: efforts are not checked.
        places: index in `joints` of each joint of the model.
        units: of each joint.
        friction: Coulomb and viscous friction, shape (2, joints), N m and N m s/rad, or N and N s/m; None: none.
    """

    joints: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    effort: Array
    given_acceleration: Array
    continuous: NDArray[np.bool_]
    model: Model | None
    places: NDArray[np.int_]
    units: tuple[JointUnits, ...]
    friction: Array | None = None

    def planned_effort(self, velocity: Array) -> Array:
        """Largest effort of a motion that is planned here, without friction, see `margins`, shape (joints,), N m or N.

        Args:
            velocity: largest one of each joint, shape (joints,), rad/s or m/s.
        """
        coulomb, viscous = np.zeros((2, velocity.size)) if self.friction is None else self.friction
        return PLANNED_EFFORT * np.maximum(self.effort - coulomb - viscous * velocity, 0.0)

    @property
    def planned_velocity(self) -> Array:
        """Largest velocity of a motion, see `margins`, shape (joints,), rad/s or m/s."""
        return PLANNED_SHARE * self.velocity


def limits_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """The parameters of `motion_limits`.

    Raises:
        ParameterError: the description cannot be used, see `find_robot`, or has another number of joints.
    """
    if settings.get(DESCRIPTION.name):
        _robot(settings)
    return PARAMETERS


def motion_limits(settings: Mapping[str, object]) -> MotionLimits:
    """The limits that parameters set, completed from the description of the arm.

    Args:
        settings: parameters in `PARAMETERS` that differ from their defaults, and ``joints``; by default those of the
            description. With ``payload.mass`` and ``payload.center_of_mass``, the arm carries a payload. Other
            parameters do not matter.

    Raises:
        ParameterError: see `limits_schema`, or a value is invalid, or a joint has a smallest position above its largest
            one, or neither joints nor an arm are given.
    """
    robot = _robot(settings) if settings.get(DESCRIPTION.name) else None
    given_joints = settings.get("joints", robot.joints if robot else ())
    joints = tuple(map(str, given_joints)) if isinstance(given_joints, (list, tuple)) else ()
    if not joints:
        raise ParameterError(f"neither joints nor {DESCRIPTION.name} are given", "joints")
    count = len(joints)
    given = {
        p.name: joint_array(p.check(settings.get(p.name, p.default), count), count) for p in PARAMETERS if p.per_joint
    }
    lower, upper = given["limits.min_position"], given["limits.max_position"]
    if np.any(lower > upper):
        raise ParameterError(
            f"limits.min_position: {lower.tolist()} exceeds limits.max_position, {upper.tolist()}",
            "limits.min_position",
        )
    places = _places(robot, joints) if robot else np.arange(count)
    described = _described(robot, places, count)
    open_ = lower == upper
    effort = _or(given["limits.effort"], described["effort"])
    velocity = _or(given["limits.velocity"], described["velocity"])
    chosen = _or(given["limits.acceleration"], np.full(count, math.inf))
    defaults = {f"robot.{p.name}": p.default for p in robot.parameters} if robot else {}
    model = make_model(robot, robot.with_payload(robot.pack_model(defaults), _payload(settings))) if robot else None
    acceleration = np.where(np.isinf(chosen), _accelerations(robot, model, effort, velocity, places), chosen)
    return MotionLimits(
        joints=joints,
        lower=np.where(open_, described["lower"], lower),
        upper=np.where(open_, described["upper"], upper),
        velocity=velocity,
        acceleration=acceleration,
        jerk=_or(given["limits.jerk"], acceleration / _RAMP),
        effort=effort,
        given_acceleration=chosen,
        continuous=described["continuous"] > 0.0,
        model=model,
        places=places,
        units=_units(robot, places, count),
        friction=_friction(robot, places, count),
    )


def with_arm(settings: Mapping[str, Any], arm: ArmDefinition) -> dict[str, Any]:
    """Settings without an arm, completed by those of an arm, in the order of their joints; limits that are set stay.

    Args:
        settings: ``joints``, and all `PARAMETERS`; None: not set.
        arm: the arm, with these joints.

    Raises:
        UsageError: see `ArmDefinition.settings`.
    """
    defaults = {parameter.name: parameter.default for parameter in PARAMETERS}
    unset = {
        name
        for name, value in settings.items()
        if value is None or np.all(np.asarray(value) == defaults.get(name, value))
    }
    of_arm = arm.in_order(settings["joints"]).settings()
    return {**settings, **{name: value for name, value in of_arm.items() if name not in settings or name in unset}}


def _payload(settings: Mapping[str, object]) -> Payload:
    """What the arm carries, by default nothing."""
    mass, center = settings.get(MASS, 0.0), settings.get(CENTER.name, CENTER.default)
    return payload_of(
        {MASS: Parameter(MASS, 0.0, "", minimum=0.0).check(mass, 1), CENTER.name: CENTER.check(center, 1)}
    )


def _friction(robot: Robot | None, places: NDArray[np.int_], count: int) -> Array:
    """Coulomb and viscous friction of the description, shape (2, joints)."""
    found = np.zeros((2, count))
    for row, described in zip(found, (robot.friction, robot.damping) if robot else (), strict=False):
        if described:
            row[places] = described
    return found


def _robot(settings: Mapping[str, object]) -> Robot:
    """The arm of the description."""
    robot, joints = find_robot({key: settings[key] for key in OF_ARM if key in settings}), settings.get("joints")
    if isinstance(joints, (list, tuple)) and len(joints) != len(robot.joints):
        raise ParameterError(
            f"{DESCRIPTION.name}: {robot.name} has {len(robot.joints)} joints, and joints names {len(joints)}",
            DESCRIPTION.name,
        )
    return robot


def _places(robot: Robot, joints: tuple[str, ...]) -> NDArray[np.int_]:
    """Index in `joints` of each joint of the robot; those of a closed form may be renamed in the same order."""
    if set(robot.joints) != set(joints):
        return np.arange(len(joints))
    return np.array([joints.index(joint) for joint in robot.joints])


def _described(robot: Robot | None, places: NDArray[np.int_], count: int) -> dict[str, Array]:
    """Limits of the description in the order of the joints; infinite where it has none."""
    low, high = (tuple(zip(*robot.position_limits, strict=True)) or ((), ())) if robot else ((), ())
    found = {
        "lower": (low, -math.inf),
        "upper": (high, math.inf),
        "velocity": (robot.velocity_limit if robot else (), math.inf),
        "effort": (robot.effort_limit if robot else (), math.inf),
        "continuous": (robot.continuous if robot else (), 0.0),
    }
    result = {name: np.full(count, default) for name, (_, default) in found.items()}
    for name, (limits, _) in found.items():
        if limits:
            result[name][places] = limits
    return result


def _units(robot: Robot | None, places: NDArray[np.int_], count: int) -> tuple[JointUnits, ...]:
    """Units of the joints."""
    of_robot = dict(zip(places.tolist(), robot.units, strict=True)) if robot else {}
    return tuple(of_robot.get(i, TURNS) for i in range(count))


def _or(given: Array, otherwise: Array) -> Array:
    """What is given, and something else where zero is given."""
    return np.where(given > 0.0, given, otherwise)


def _accelerations(
    robot: Robot | None, model: Model | None, effort: Array, velocity: Array, places: NDArray[np.int_]
) -> Array:
    """Default accelerations, shape (joints,): what `_SHARE` of the torque beyond gravity gives a joint alone.

    It is the least of that in random postures, and less where the largest velocity would be reached within `_RUN_UP`.
    """
    fastest = velocity / _RUN_UP
    if robot is None or model is None:
        return np.minimum(fastest, _WITHOUT_MODEL)
    joints = effort.size
    middle = np.array(robot.initial_position)
    low, high = np.array(robot.position_limits).T if robot.position_limits else (middle - math.pi, middle + math.pi)
    low, high = np.maximum(low, middle - math.pi), np.minimum(high, middle + math.pi)
    rows, efforts = unit_accelerations(joints), np.empty((joints + 1, joints))
    least = np.full(joints, math.inf)
    for share in np.random.default_rng(0).random((_POSTURES, joints)):
        inverse_dynamics(model, low + share * (high - low), np.zeros(joints), rows, efforts)
        gravity, inertia = np.abs(efforts[0]), np.diag(efforts[1:] - efforts[0])
        beyond = np.maximum(effort[places] - gravity, _LEAST * effort[places])
        least = np.minimum(least, _SHARE * beyond / inertia)
    possible = np.empty(joints)
    possible[places] = np.where(np.isinf(least), _WITHOUT_MODEL, least)
    return np.minimum(fastest, possible)
