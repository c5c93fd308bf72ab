"""Topics on which torques travel from a controller to an arm, by the value of ``output.type`` and ``input.type``."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray


class EffortTopic(NamedTuple):
    """A form of command.

    Attributes:
        name: of the topic.
        message_type: of its messages.
        field: the float64[] field with the torques, N m.
        blank: a message without torques for these joints.
    """

    name: str
    message_type: type
    field: str
    blank: Callable[[Sequence[str]], Any]


EFFORT_TOPICS = {
    "joint_state": EffortTopic("joint_commands", JointState, "effort", lambda joints: JointState(name=list(joints))),
    # Of ros2_control's forward_command_controller: neither stamp nor names.
    "float64_multi_array": EffortTopic(
        "effort_controller/commands", Float64MultiArray, "data", lambda _joints: Float64MultiArray()
    ),
}
