"""Parameters that only the nodes have, and the complete schema of each node.

This module needs no ROS, so that programs that start nodes can check and complete their parameters beforehand.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from pidtsm_core.control import ESTIMATOR_NAME, controller_schema
from pidtsm_core.control.parameters import CONTACT
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.parameters import Parameter, ParameterError, Schema, chosen
from pidtsm_core.poses.parameters import PARAMETERS as OF_POSES
from pidtsm_core.references import reference_schema
from pidtsm_core.robots import TreeRobot, description_schema, find_robot
from pidtsm_core.simulation import gripper
from pidtsm_core.simulation.simulator import simulator_schema
from pidtsm_core.trajectories import limits

AUTOSTART = Parameter("autostart", True, "configure and activate on start, without a lifecycle manager", read_only=True)

PRIORITY = Parameter(
    "realtime.priority",
    40,
    "SCHED_FIFO priority of the node's threads in real time, if the system permits it; 0: no real-time priority",
    minimum=0,
    maximum=99,
    read_only=True,
)

_TRAJECTORY_PRIORITY = replace(PRIORITY, default=10)
"""Higher than other processes: the start of one could delay the node for longer than the controller waits for a
reference. Lower than the loop and the threads that receive messages for the recorder: on an overloaded machine, they
come first."""


FRAME_PREFIX = Parameter(
    "frame_prefix",
    "",
    "prefix of the arm's frames on tf and in messages, as that of robot_state_publisher: left/",
    read_only=True,
)
_BASE_PARENT = Parameter(
    "base.parent",
    "",
    "frame in which tf_static has the base of the arm, at base.pose; empty: the base is the root",
    read_only=True,
)
_BASE_POSE = Parameter(
    "base.pose",
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "place of the base in base.parent: x, y, z (m), and roll, pitch, yaw (rad)",
    length=6,
    read_only=True,
)


def visualization_schema(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    """Parameters of the node visualization; raises as `description_schema`."""
    return (*description_schema(settings), FRAME_PREFIX, _BASE_PARENT, _BASE_POSE)


def _thresholds(name: str, warn: float, error: float, description: str, unit: str = "") -> tuple[Parameter, ...]:
    """Parameters for the values from which /diagnostics reports a warning and an error."""
    return tuple(
        Parameter(f"diagnostics.{name}.{level}", value, f"{description}: {level} from this value on", unit, minimum=0.0)
        for level, value in (("warn", warn), ("error", error))
    )


def _form_of_commands(name: str, description: str) -> Parameter:
    return Parameter(
        name,
        "joint_state",
        f"{description}; joint_state: on joint_commands, matched by name, with the stamp of the joint state answered; "
        "float64_multi_array: on effort_controller/commands, in the order of the parameter joints (ros2_control)",
        choices=("joint_state", "float64_multi_array"),
        read_only=True,
    )


def _start(topic: str, default: int, listeners: str) -> Parameter:
    """Parameter for the number of subscribers that a node waits for, so that its first message reaches all of them."""
    return Parameter(
        "start.subscribers",
        default,
        f"number of subscribers of {topic} to wait for before the first message ({listeners}; a recorder is one more); "
        "0: start at once",
        minimum=0,
        read_only=True,
    )


_LOOP = (
    AUTOSTART,
    PRIORITY,
    FRAME_PREFIX,
    Parameter(
        "diagnostics.deadline",
        0.002,
        "a longer period is a missed deadline; value for 1 kHz, which grows with the nominal period at lower rates",
        "s",
        minimum=0.0,
        exclusive=True,
    ),
    *_thresholds("missed", 0.001, 0.05, "share of the periods in one second that missed their deadline, in real time"),
    *_thresholds(
        "jitter",
        0.0005,
        0.005,
        "standard deviation of the period, in real time, for 1 kHz (at lower rates the value grows like the deadline)",
        "s",
    ),
)

VELOCITY_REPORTED = Parameter(
    "joint_states.velocity",
    True,
    "whether joint_states have velocities, which the drives estimate from the measured positions",
    read_only=True,
)
VELOCITY_CUTOFF = Parameter(
    "joint_states.velocity_cutoff",
    600.0,
    "cutoff of the drives' low-pass filter of the differences of the measured positions",
    "rad/s",
    minimum=0.0,
    exclusive=True,
    read_only=True,
)
EFFORT_REPORTED = Parameter(
    "joint_states.effort",
    True,
    "whether joint_states have the efforts that the drives applied before the measurement",
    read_only=True,
)

_SIMULATOR = (
    *_LOOP,
    *gripper.PARAMETERS,
    VELOCITY_REPORTED,
    VELOCITY_CUTOFF,
    EFFORT_REPORTED,
    Parameter(
        "clock",
        "realtime",
        "realtime: samples at the rate of the wall clock, with the system time as stamp; "
        "lockstep: every sample waits for its command, stamps start at 0, and the node publishes /clock",
        choices=("realtime", "lockstep"),
        read_only=True,
    ),
    _form_of_commands("input.type", "message type of the commands received"),
    Parameter("duration", 0.0, "the node ends after this time; 0: never", "s", minimum=0.0, read_only=True),
    _start("joint_states", 2, "controller, trajectory"),
    Parameter(
        "lockstep.timeout",
        5.0,
        "longest wall time to wait for a command, from the first command on",
        "s",
        minimum=0.0,
        exclusive=True,
        read_only=True,
    ),
)

PAYLOAD_OBSERVED = Parameter(
    "payload.observe",
    False,
    "estimate what the arm carries while it moves, and publish it on ~/payload; for arms that are read from a file",
    read_only=True,
)

HELD_OBJECT = "gripper/object"
"""Name of the topic on which a gripper publishes what it holds."""

HELD_KNOWN = Parameter(
    "payload.from_gripper",
    False,
    f"add what the gripper holds ({HELD_OBJECT}, geometry_msgs/InertiaStamped in the tool frame) to the payload, "
    "within 1 s",
    read_only=True,
)

WRENCH_PUBLISHED = Parameter(
    "external_wrench.publish",
    False,
    "publish the estimated wrench on the tool on ~/external_wrench; it needs limits.external_effort",
    read_only=True,
)

LEARNT_FILE = Parameter(
    "adaptation.file",
    "",
    "file that keeps what was learnt (adaptation.friction, adaptation.lateness) when the node is deactivated, and from "
    "which it goes on when it is activated again; empty: it begins anew",
    read_only=True,
)

_CONTROLLER = (
    *_LOOP,
    *_thresholds(
        "age",
        0.005,
        0.05,
        "longest time from the stamp of a joint state to its command, in real time, for 1 kHz (at lower rates the "
        "value grows like the deadline)",
        "s",
    ),
    *_thresholds("saturation", 0.5, 1.0, "share of the samples in one second with a joint at its torque limit"),
    Parameter(
        "reference.match",
        "latest",
        "latest: the newest reference, extrapolated to the stamp of the joint state; "
        "stamp: wait for the reference with the stamp of the joint state (lockstep)",
        choices=("latest", "stamp"),
        read_only=True,
    ),
    _form_of_commands("output.type", "message type of the commands published"),
    _start("the commands", 1, "simulator"),
    Parameter("state.decimation", 1, "number of ticks per message on ~/state", minimum=1),
    LEARNT_FILE,
    PAYLOAD_OBSERVED,
    HELD_KNOWN,
    WRENCH_PUBLISHED,
    Parameter(
        "payload.largest",
        0.0,
        "largest estimated mass that ~/take_payload takes over; 0: none",
        "kg",
        minimum=0.0,
    ),
)

_ACTION = (
    Parameter(
        "interpolation",
        "spline",
        "what joins the points of a goal of follow_joint_trajectory that are positions only: spline: a curve with "
        "continuous acceleration; linear: straight lines",
        choices=("spline", "linear"),
    ),
    Parameter(
        "allow_partial_joints_goal",
        False,
        "whether a goal of follow_joint_trajectory may leave joints out, which then hold their position",
    ),
    Parameter(
        "action_monitor_rate",
        20.0,
        "number of feedback messages per second for a goal of follow_joint_trajectory, and of ~/controller_state",
        "1/s",
        minimum=0.0,
        exclusive=True,
    ),
    Parameter(
        "constraints.trajectory",
        0.05,
        "path tolerance of the position for goals that set none; 0: no limit",
        "rad",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "constraints.goal",
        0.03,
        "goal tolerance of the position for goals that set none; 0: no limit",
        "rad",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "constraints.stopped_velocity_tolerance",
        0.01,
        "goal tolerance of the velocity for goals that set none; 0: no limit",
        "rad/s",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter(
        "constraints.goal_time",
        1.0,
        "goal_time_tolerance for goals that set none: how long after its last point a goal may be reached; 0: no limit",
        "s",
        minimum=0.0,
    ),
)
"""Parameters of the action follow_joint_trajectory, with the names that joint_trajectory_controller has."""

_TRAJECTORY = (
    AUTOSTART,
    _TRAJECTORY_PRIORITY,
    FRAME_PREFIX,
    Parameter(
        "clock",
        "realtime",
        "realtime: a node that falls behind skips joint states; "
        "lockstep: it answers every joint state, because the simulator waits for the answer",
        choices=("realtime", "lockstep"),
        read_only=True,
    ),
    _start("reference", 1, "controller"),
    Parameter(
        "start_tolerance",
        0.05,
        "a commanded trajectory is rejected if its last point that is already due is farther than this from the "
        "current reference; if the clock of the joint states is set, and the arm is farther than this from the "
        "reference, the node holds the arm where it is",
        "rad",
        minimum=0.0,
    ),
    *limits.PARAMETERS,
    *OF_POSES,
    *_ACTION,
)


SCHEMAS: dict[str, Schema] = {
    "simulator": simulator_schema,
    "controller": controller_schema,
    "trajectory": reference_schema,
}
"""The parameters that affect a torque, by node: all that a rollout has."""

NODE_ONLY = {"simulator": _SIMULATOR, "controller": _CONTROLLER, "trajectory": _TRAJECTORY}
"""Parameters that affect no torque, and therefore do not exist in a rollout, by node."""


def check_node(node: str, settings: Mapping[str, object]) -> None:
    """Check that a node can have parameters that a rollout may have.

    Raises:
        ParameterError: the estimator works only in a rollout, or the payload of a closed form is to be observed, or see
            `limits.limits_schema` and `gripper.gripper_joints`.
    """
    if node == "trajectory":
        limits.limits_schema(settings)
    if node == "simulator":
        gripper.gripper_joints(settings)
    if node != "controller":
        return
    estimator = ESTIMATORS[chosen(settings, ESTIMATOR_NAME)]
    if estimator.needs_truth:
        raise ParameterError(
            f"{ESTIMATOR_NAME.name}: {estimator.name} needs the true derivatives, which no sensor delivers; "
            "it works in a rollout only"
        )
    if settings.get(WRENCH_PUBLISHED.name) is True and not np.any(np.asarray(settings.get(CONTACT[0].name, 1.0))):
        raise ParameterError(
            f"{WRENCH_PUBLISHED.name} needs {CONTACT[0].name}, which is 0: without it, nothing is estimated",
            WRENCH_PUBLISHED.name,
        )
    if settings.get(PAYLOAD_OBSERVED.name) is True and not isinstance(robot := find_robot(settings), TreeRobot):
        raise ParameterError(
            f"{PAYLOAD_OBSERVED.name}: {robot.name} is a closed form; name the URDF of the arm", PAYLOAD_OBSERVED.name
        )


def _complete(node: str, settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    return (*SCHEMAS[node](settings), *NODE_ONLY[node])


def _of_node(node: str, settings: Mapping[str, object]) -> tuple[Parameter, ...]:
    check_node(node, settings)
    return _complete(node, settings)


COMPLETE_SCHEMAS: dict[str, Schema] = {node: partial(_complete, node) for node in SCHEMAS}
"""Every parameter, by node."""
NODE_SCHEMAS: dict[str, Schema] = {node: partial(_of_node, node) for node in SCHEMAS}
"""The same, with `check_node`: what the nodes declare."""
simulator_node_schema, controller_node_schema, trajectory_node_schema = NODE_SCHEMAS.values()
