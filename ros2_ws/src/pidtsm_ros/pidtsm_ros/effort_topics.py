"""Effort command topics between controller and arm, by the value of ``output.type`` and ``input.type``."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray


class EffortTopic(NamedTuple):
    """Topic and message type of effort commands.

    Attributes:
        name: name of the topic.
        message_type: type of its messages.
        field: float64[] field with the torques, N m.
        blank: creates a message without torques for the given joints.
    """

    name: str
    message_type: type
    field: str
    blank: Callable[[Sequence[str]], Any]


EFFORT_TOPICS = {
    "joint_state": EffortTopic("joint_commands", JointState, "effort", lambda joints: JointState(name=list(joints))),
    # For ros2_control's forward_command_controller: no stamp, no joint names.
    "float64_multi_array": EffortTopic(
        "effort_controller/commands", Float64MultiArray, "data", lambda _joints: Float64MultiArray()
    ),
}
