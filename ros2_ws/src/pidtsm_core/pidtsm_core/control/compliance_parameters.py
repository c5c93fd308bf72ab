"""Parameters of the compliance, and how a step reads and remembers them, see compliance.py."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.laws.tool_spring import POSE, spring_size
from pidtsm_core.parameters import Parameter, ParameterError, Value, as_float, joint_array
from pidtsm_core.robots import NO_TOOL, Robot

SPACE = Parameter(
    "compliance.space",
    "none",
    "where the reference yields to what acts on the arm from outside. tool: as a tool on springs; joint: each joint "
    "on a spring; none: it does not yield. Needs law.disturbance_rejection",
    choices=("none", "tool", "joint"),
)
_DEAD_ZONE = Parameter(
    "compliance.dead_zone",
    0.0,
    "torque from outside up to which nothing yields, and by which every larger one counts less: what acts on all "
    "joints is judged together. Larger than noise, friction and what the model lacks",
    "N m",
    minimum=0.0,
    per_joint=True,
)
_NOTICED = 0.02
"""The default of the dead zone, as a share of limits.effort."""
STIFFNESS_OF = {
    "tool": Parameter(
        "compliance.stiffness",
        (1000.0, 1000.0, 1000.0, 50.0, 50.0, 50.0),
        "of the tool along x, y, z of the base (N/m) and about them (N m/rad)",
        minimum=0.0,
        length=POSE,
    ),
    "joint": Parameter("compliance.joint_stiffness", 100.0, "of each joint", "N m/rad", minimum=0.0, per_joint=True),
}
"""The parameter of the stiffness, by what is on springs."""
_COMPLIANCE = (
    SPACE,
    STIFFNESS_OF["tool"],
    Parameter(
        "compliance.limit",
        (0.0,) * POSE,
        "of the springs, along x, y, z of the base (N) and about them (N m): beyond it the tool goes on yielding; "
        "0: none",
        minimum=0.0,
        length=POSE,
    ),
    STIFFNESS_OF["joint"],
    Parameter(
        "compliance.joint_limit", 0.0, "of the spring of each joint; 0: none", "N m", minimum=0.0, per_joint=True
    ),
    Parameter("compliance.damping", 1.0, "damping ratio of every mode of the arm", minimum=0.1, maximum=10.0),
    Parameter(
        "compliance.inertia",
        1.0,
        "by how many times the arm feels heavier than it is; less than 1 would be unstable at a stiff wall, because "
        "the torque from outside is known with a delay",
        minimum=1.0,
        maximum=20.0,
    ),
    Parameter("compliance.null_space", 5.0, "frequency of what moves the arm and not its tool", "rad/s", minimum=0.0),
)


class ComplianceConfig(NamedTuple):
    """How the reference yields."""

    active: bool
    of_tool: bool  # the tool is on springs, not the joints
    tree: Array  # the arm as a tree, see `robots.Tool`; shape (0,) if it is not known
    row: int  # likewise
    point: Array  # likewise
    gains: Array  # see `Gains`, shape (gain_count(joints),)
    damping: float
    inertia: float
    dead_zone: Array  # shape (joints,), N m


class Gains(NamedTuple):
    """Places of the gains that change slowly."""

    STIFFNESS: int = 0
    LIMIT: int = POSE  # 0: none
    NULL_SPACE: int = 2 * POSE
    JOINTS: int = 2 * POSE + 1  # stiffness of each, then limit of each


GAINS = Gains()


def gain_count(joints: int) -> int:
    """How many gains change slowly."""
    return GAINS.JOINTS + 2 * joints


class Compliance(NamedTuple):
    """What the controller remembers of it; initially all zero."""

    offset: Array  # by which the reference has yielded, and its derivatives, shape (3, joints), rad, rad/s, rad/s^2
    age: Array  # for how long it has been active, shape (1,), s
    usual: Array  # torque from outside that counts as none, shape (joints,), N m
    gains: Array  # the present ones, shape (gain_count(joints),)
    force: Array  # scratch, shape (joints,)
    rates: Array  # scratch, shape (3, joints)
    spring: Array  # scratch, see `spring_of`


def new_compliance(joints: int) -> Compliance:
    """Of a controller that has not begun."""
    return Compliance(
        offset=np.zeros((3, joints)),
        age=np.zeros(1),
        usual=np.zeros(joints),
        gains=np.zeros(gain_count(joints)),
        force=np.zeros(joints),
        rates=np.zeros((3, joints)),
        spring=np.zeros(spring_size(joints)),
    )


def compliance_parameters(effort_limit: Array) -> tuple[Parameter, ...]:
    """The parameters; the default of the dead zone follows from the limits of the efforts, shape (joints,), N m."""
    share = tuple(np.where(np.isfinite(effort_limit), _NOTICED * effort_limit, 0.0).tolist())
    return (*_COMPLIANCE, replace(_DEAD_ZONE, default=share))


def check_compliance(settings: Mapping[str, object], rejection: str) -> None:
    """Check that what acts from outside is known and subtracted, see compliance.py.

    Args:
        settings: the parameters that differ from their defaults.
        rejection: name of the parameter that subtracts it.

    Raises:
        ParameterError: it is not.
    """
    if settings.get(SPACE.name, "none") != "none" and settings.get(rejection) is not True:
        reason = f"{SPACE.name}: set {rejection} to true, or else the law does not resist what the reference yields to"
        raise ParameterError(reason, SPACE.name)


def write_stiffness(config: ComplianceConfig, space: str, stiffness: Sequence[float]) -> Value:
    """Write another stiffness in place, to which the gains move slowly, see compliance.py.

    Args:
        config: of the controller.
        space: what is on springs, tool or joint.
        stiffness: of the tool along and about x, y, z, shape (6,), N/m and N m/rad; or of the joints, shape (joints,)
            or (1,), N m/rad.

    Returns:
        The value as the parameter has it.

    Raises:
        ParameterError: its number is wrong, or one is negative, not finite or absurd; nothing changes.
    """
    joints = config.dead_zone.size
    value = STIFFNESS_OF[space].check(list(stiffness), joints)
    first, size = (GAINS.STIFFNESS, POSE) if space == "tool" else (GAINS.JOINTS, joints)
    config.gains[first : first + size] = value
    return value


def make_compliance(values: Mapping[str, Value], robot: Robot) -> ComplianceConfig:
    """How the reference yields, with these parameters; it does not if the law has no model.

    Raises:
        ParameterError: the tool is to yield, but it is not known where it is.
    """
    joints, space = len(robot.joints), values.get(SPACE.name, "none")
    tool = NO_TOOL if robot.tool is None or space != "tool" else robot.tool(robot.pack_model(values))
    if space == "tool" and tool.row < 0:
        reason = f"{SPACE.name}: it is not known where the tool of {robot.name} is; use joint"
        raise ParameterError(reason, SPACE.name)

    def of(name: str, size: int) -> Array:
        return np.broadcast_to(np.asarray(values.get(f"compliance.{name}", 0.0), dtype=np.float64), size)

    return ComplianceConfig(
        active=space != "none",
        of_tool=space == "tool",
        tree=tool.tree,
        row=tool.row,
        point=tool.point,
        gains=np.concatenate(
            [
                of("stiffness", POSE),
                of("limit", POSE),
                of("null_space", 1),
                of("joint_stiffness", joints),
                of("joint_limit", joints),
            ]
        ),
        damping=as_float(values.get("compliance.damping", 1.0)),
        inertia=as_float(values.get("compliance.inertia", 1.0)),
        dead_zone=joint_array(values.get(_DEAD_ZONE.name, 0.0), joints),
    )
