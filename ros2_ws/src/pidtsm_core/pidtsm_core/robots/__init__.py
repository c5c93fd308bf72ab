"""Robot models: from acceleration to torque and back. One per file; `ROBOTS` contains the ones imported here."""

from collections.abc import Mapping

from pidtsm_core.compiled import njit
from pidtsm_core.family import Family, dispatch
from pidtsm_core.parameters import Array, Parameter, chosen, prefixed
from pidtsm_core.robots.base import Robot
from pidtsm_core.robots.two_link import TWO_LINK

__all__ = ["ROBOTS", "Robot", "add_payload", "forward_dynamics", "inverse_dynamics", "robot_joints", "robot_schema"]

ROBOTS: Family[Robot] = Family.of(Robot, globals())

ROBOT_NAME = Parameter("robot.name", "two_link", "robot model", choices=ROBOTS.names, read_only=True)


def robot_joints(settings: Mapping[str, object]) -> int:
    """Number of joints of the robot ``robot.name``."""
    return len(ROBOTS[chosen(settings, ROBOT_NAME)].joints)


def robot_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters of the group ``robot``, and those that depend on the robot: ``joints`` and ``limits.effort``."""
    robot = ROBOTS[chosen(settings, ROBOT_NAME)]
    return (
        Parameter(
            "joints",
            robot.joints,
            "names of the joints, in the order of the robot model",
            per_joint=True,
            read_only=True,
        ),
        ROBOT_NAME,
        *prefixed("robot", robot.parameters),
        Parameter(
            "limits.effort",
            robot.effort_limit,
            "largest torque in either direction (Remark 8)",
            "N m",
            minimum=0.0,
            exclusive=True,
            per_joint=True,
        ),
    )


_inverse = dispatch(robot.inverse_dynamics for robot in ROBOTS.members)
_forward = dispatch(robot.forward_dynamics for robot in ROBOTS.members)
_add_payload = dispatch(robot.add_payload for robot in ROBOTS.members)


@njit
def inverse_dynamics(index: int, q: Array, dq: Array, ddq: Array, p: Array, effort: Array) -> None:
    """Efforts (N m) for each row of ddq: see `Robot.inverse_dynamics`; `index` is the robot's place in `ROBOTS`."""
    _inverse(index, q, dq, ddq, p, effort)


@njit
def forward_dynamics(index: int, q: Array, dq: Array, effort: Array, p: Array, ddq: Array) -> None:
    """ddq (rad/s^2) under effort: see `Robot.forward_dynamics`; `index` is the robot's place in `ROBOTS`."""
    _forward(index, q, dq, effort, p, ddq)


@njit
def add_payload(index: int, p: Array, mass: float, loaded: Array) -> None:
    """Parameters with a payload: see `Robot.add_payload`; `index` is the robot's place in `ROBOTS`."""
    _add_payload(index, p, mass, loaded)
