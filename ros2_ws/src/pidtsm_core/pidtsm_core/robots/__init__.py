"""Robot models: from acceleration to torque and back. One closed form per file; any other arm is read from a file."""

import shlex
from collections.abc import Mapping
from contextlib import suppress

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import dispatch, njit
from pidtsm_core.parameters import Parameter, ParameterError, Value, prefixed
from pidtsm_core.parameters.family import Family
from pidtsm_core.robots.base import NO_TOOL, Dynamics, Model, Robot, Tool
from pidtsm_core.robots.calls import dynamics_addresses, forward_at, inverse_at, spread_address, spread_at
from pidtsm_core.robots.description import Description, read_description
from pidtsm_core.robots.effort_differences import spread_of_differences
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.payload import check_payload, payload_of, payload_parameters
from pidtsm_core.robots.source import ARMS, read_source
from pidtsm_core.robots.tree import effort_spread as tree_effort_spread
from pidtsm_core.robots.tree_robot import TREE, TreeRobot, tree_robot
from pidtsm_core.robots.two_link import TWO_LINK

__all__ = [
    "DESCRIPTION",
    "FROM_TOPIC",
    "GRAVITY",
    "LOCKED",
    "NAMES",
    "NO_TOOL",
    "OF_ARM",
    "ROBOTS",
    "XACRO",
    "Description",
    "DescriptionError",
    "Dynamics",
    "Model",
    "Robot",
    "Tool",
    "TreeRobot",
    "description_schema",
    "effort_spread",
    "find_description",
    "find_robot",
    "forward_dynamics",
    "has_name",
    "inverse_dynamics",
    "make_model",
    "payload_of",
    "payload_schema",
    "robot_joints",
    "robot_parameters",
    "robot_schema",
    "xacro_arguments",
]

ROBOTS: Family[Robot] = Family.of(Robot, "robots", globals(), "pidtsm_core.robots.trial")
"""Robots with a closed form."""

NAMES = (*(robot.name for robot in ROBOTS.own), *ARMS)
"""Names of the arms that come with the package."""

FROM_TOPIC = "topic"
"""Value of ``robot.description``: a node takes the description from the topic ``robot_description``."""

DESCRIPTION = Parameter(
    "robot.description",
    "two_link",
    f"the arm: {', '.join(NAMES)}, or a URDF, xacro or MJCF: its path, its package:// URI or its text; {FROM_TOPIC}: "
    "the node waits for robot_description (std_msgs/String, latched)",
    read_only=True,
)
LOCKED = Parameter(
    "robot.locked",
    "",
    "positions of joints of the description that do not move, such as those of a gripper: finger1=0.02 finger2=0.02; "
    "the others are locked at zero, or at the limit next to it",
    read_only=True,
)
XACRO = Parameter(
    "robot.xacro",
    "",
    "arguments of a xacro file: mass:=5 tool:=false; the others have their defaults",
    read_only=True,
)
OF_ARM = (DESCRIPTION.name, LOCKED.name, XACRO.name, "joints")
"""Names of the parameters that decide which robot `find_robot` finds."""

GRAVITY = Parameter(
    "output.gravity",
    "commanded",
    "who holds the arm against gravity. commanded: the command contains the torque; added_by_robot: the robot's "
    "firmware adds it to the command, as libfranka does, so the command is without it",
    choices=("commanded", "added_by_robot"),
    read_only=True,
)


def has_name(source: str) -> bool:
    """Whether a description is the name of an arm that comes with the package, or of a closed form from outside."""
    return source in NAMES or source in ROBOTS


def find_robot(settings: Mapping[str, object]) -> Robot:
    """The robot ``robot.description``, with the joints ``joints``.

    Raises:
        ParameterError: the description cannot be used; the message contains the link or joint.
    """
    source = str(DESCRIPTION.check(settings.get(DESCRIPTION.name, DESCRIPTION.default), 1))
    if source in ROBOTS:
        return ROBOTS[source]
    if source == FROM_TOPIC:
        raise ParameterError(f"{DESCRIPTION.name}: {FROM_TOPIC} works in nodes only", DESCRIPTION.name)
    joints, locked = settings.get("joints"), str(settings.get(LOCKED.name, ""))
    chosen = tuple(str(joint) for joint in joints) if isinstance(joints, (list, tuple)) else None
    try:
        name, text = read_source(source, xacro_arguments(settings))
    except DescriptionError as error:
        raise ParameterError(f"{DESCRIPTION.name}: {error}", DESCRIPTION.name) from None
    file = "" if "<" in source else f"{source}: "
    try:
        return tree_robot(name, text, chosen, _positions(locked))
    except DescriptionError as error:
        raise ParameterError(f"{DESCRIPTION.name}: {file}{error}", DESCRIPTION.name) from None


def find_description(settings: Mapping[str, object]) -> Description:
    """A description of the robot of `find_robot`, for viewers.

    Its joints are in the robot's order; those of a closed form may have other names than in `settings`.

    Raises:
        ParameterError: see `find_robot`, or the robot is a closed form without a URDF.
    """
    robot = find_robot(settings)
    if isinstance(robot, TreeRobot):
        return robot.description
    if not robot.urdf:
        reason = f"{robot.name} is a closed form without a URDF, so there is nothing to show"
        raise ParameterError(f"{DESCRIPTION.name}: {reason}", DESCRIPTION.name)
    try:
        return read_description(read_source(robot.urdf)[1], robot.joints)
    except DescriptionError as error:
        raise ParameterError(f"{DESCRIPTION.name}: {error}", DESCRIPTION.name) from None


def _positions(text: str) -> tuple[tuple[str, float], ...]:
    """The positions in the text of `LOCKED`."""
    try:
        pairs = [entry.split("=") for entry in text.replace(",", " ").split()]
        return tuple((name, float(value)) for name, value in pairs)
    except ValueError:
        raise ParameterError(f"{LOCKED.name}: {text!r} is not of the form JOINT=POSITION ...", LOCKED.name) from None


def xacro_arguments(settings: Mapping[str, object]) -> tuple[tuple[str, str], ...]:
    """The arguments of a xacro file in the parameter `XACRO`, as pairs of name and value.

    Raises:
        ParameterError: its text has another form.
    """
    text = str(settings.get(XACRO.name, ""))
    with suppress(ValueError):  # A quotation that does not end.
        pairs = [word.partition(":=") for word in shlex.split(text)]
        if all(name and separator for name, separator, _ in pairs):
            return tuple((name, value) for name, _, value in pairs)
    raise ParameterError(f"{XACRO.name}: {text!r} is not of the form NAME:=VALUE ...", XACRO.name)


_CLOSED_FORMS = tuple(dict.fromkeys(robot.dynamics for robot in ROBOTS.own))
"""Compiled code contains them: called by address, they make a rollout of two joints 11 % slower."""
_BY_ADDRESS = len(_CLOSED_FORMS)
"""`Model.kind` of all others."""


def make_model(robot: Robot, parameters: Array) -> Model:
    """The model of a robot as compiled code reads it; `parameters` as `Robot.pack_model` returns them, shape (n,)."""
    if robot.dynamics in _CLOSED_FORMS:
        return Model(_CLOSED_FORMS.index(robot.dynamics), 0, 0, 0, parameters)
    spread = 0 if robot.dynamics is TREE else spread_address(robot.dynamics)
    return Model(_BY_ADDRESS, *dynamics_addresses(robot.dynamics), spread, parameters)


def robot_joints(settings: Mapping[str, object]) -> int:
    """Number of joints of the robot."""
    return len(find_robot(settings).joints)


def robot_parameters(values: Mapping[str, Value]) -> dict[str, Value]:
    """Those of a node's parameters that define its robot: ``joints``, the group ``robot``, and its elastic joints."""
    groups = ("robot.", "elasticity.")
    return {name: value for name, value in values.items() if name == "joints" or name.startswith(groups)}


def description_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters that choose the robot and its joints.

    Raises:
        ParameterError: see `find_robot`.
    """
    return _description_of(find_robot(settings))


def _description_of(robot: Robot) -> tuple[Parameter, ...]:
    joints = Parameter(
        "joints", robot.joints, "names of the joints, in the order of the robot model", per_joint=True, read_only=True
    )
    return joints, DESCRIPTION, *((LOCKED, XACRO) if isinstance(robot, TreeRobot) else ())


def robot_schema(settings: Mapping[str, object], robot: Robot | None = None) -> tuple[Parameter, ...]:
    """Parameters of the group ``robot``, and those that depend on the robot: ``joints`` and ``limits.effort``.

    `robot` is that of the settings, if it has been found.

    Raises:
        ParameterError: see `find_robot`, or the description has no effort limit and `settings` have none either.
    """
    robot = robot or find_robot(settings)
    unlimited = [joint for joint, limit in zip(robot.joints, robot.effort_limit, strict=True) if limit == float("inf")]
    if unlimited and "limits.effort" not in settings:
        raise ParameterError(
            f"limits.effort: the description has no effort limit of {', '.join(unlimited)}; set limits.effort, or give "
            f"--effort {','.join(f'{joint}=LIMIT' for joint in unlimited)}",
            "limits.effort",
        )
    return (
        *_description_of(robot),
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


def payload_schema(settings: Mapping[str, object], description: str, robot: Robot) -> tuple[Parameter, ...]:
    """Parameters of the group ``payload``; they depend on the robot. `description` is that of ``payload.mass``.

    Raises:
        ParameterError: no body has the payload's inertia.
    """
    check_payload(settings)
    return payload_parameters(description, isinstance(robot, TreeRobot))


_inverse = dispatch(kind.inverse_dynamics for kind in _CLOSED_FORMS)
_forward = dispatch(kind.forward_dynamics for kind in _CLOSED_FORMS)
_spread = dispatch(kind.effort_spread or spread_of_differences(kind.inverse_dynamics) for kind in _CLOSED_FORMS)


@njit
def inverse_dynamics(model: Model, q: Array, dq: Array, ddq: Array, effort: Array) -> None:
    """Efforts (N m) for each row of ddq: see `Dynamics.inverse_dynamics`."""
    p = model.parameters
    if model.kind == _BY_ADDRESS:
        inverse_at(model.inverse, q, dq, ddq, ddq.shape[0], q.size, p, p.size, effort)
    else:
        _inverse(model.kind, q, dq, ddq, p, effort)


@njit
def forward_dynamics(model: Model, q: Array, dq: Array, effort: Array, ddq: Array) -> None:
    """ddq (rad/s^2) under effort: see `Dynamics.forward_dynamics`."""
    p = model.parameters
    if model.kind == _BY_ADDRESS:
        forward_at(model.forward, q, dq, effort, q.size, p, p.size, ddq)
    else:
        _forward(model.kind, q, dq, effort, p, ddq)


@njit
def effort_spread(model: Model, q: Array, dq: Array, ddq: Array, box: Array, spread: Array) -> None:
    """How far the efforts (N m) are from those of q, q', q'' within a box: see `Dynamics.effort_spread`."""
    if model.kind != _BY_ADDRESS:
        _spread(model.kind, q, dq, ddq, box, model.parameters, spread)
    elif model.spread == 0:
        tree_effort_spread(q, dq, ddq, box, model.parameters, spread)
    else:
        spread_at(model.spread, q, dq, ddq, box, model.parameters, spread)
