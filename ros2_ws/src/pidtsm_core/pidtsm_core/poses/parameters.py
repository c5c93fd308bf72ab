"""Parameters of motions of the tool, for the trajectory node."""

from pidtsm_core.parameters import Parameter

TOOL_FRAME = Parameter(
    "poses.tool",
    "",
    "link whose frame the poses are of; empty: the tool of robot.description",
    read_only=True,
)
VELOCITY = Parameter(
    "poses.velocity",
    1.0,
    "largest velocity of the tool on its way to a streamed pose",
    "m/s",
    minimum=0.0,
    exclusive=True,
    read_only=True,
)
ANGULAR_VELOCITY = Parameter(
    "poses.angular_velocity",
    2.5,
    "largest angular velocity of the tool on its way to a streamed pose",
    "rad/s",
    minimum=0.0,
    exclusive=True,
    read_only=True,
)
TWIST_TIMEOUT = Parameter(
    "poses.twist_timeout",
    0.25,
    "the arm comes to rest if no twist, or no jog of joints, has come for this time",
    "s",
    minimum=0.0,
    exclusive=True,
    read_only=True,
)
PARAMETERS = (TOOL_FRAME, VELOCITY, ANGULAR_VELOCITY, TWIST_TIMEOUT)
