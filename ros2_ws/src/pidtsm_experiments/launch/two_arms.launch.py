"""Two arms beside each other: two complete loops, in the namespaces left and right, with one tree of frames on /tf.

Each has a simulator of its own, so the arms cannot touch each other.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription, OpaqueFunction
from launch_ros.actions import Node

_SIDES = {"left": "0 0.4 0 0 0 0", "right": "0 -0.4 0 0 0 0"}
"""Namespaces, and where the bases are by default, in the frame world."""
_SHARED = ("robot", "engine", "law", "params", "set", "duration")
"""Arguments of arm.launch.py that both arms get."""
_SHARE = Path(get_package_share_directory("pidtsm_experiments"))

_ARGUMENTS = (
    *(DeclareLaunchArgument(name, default_value="", description="as in arm.launch.py") for name in _SHARED),
    *(
        DeclareLaunchArgument(
            f"{side}_base", default_value=place, description="x y z roll pitch yaw in world, m and rad"
        )
        for side, place in _SIDES.items()
    ),
    *(
        DeclareLaunchArgument(f"{side}_set", default_value="", description=f"parameters of the {side} arm, as in set")
        for side in _SIDES
    ),
    DeclareLaunchArgument("viewer", default_value="none", description="none, or rviz: one for both arms"),
)


def _actions(context: LaunchContext) -> list[GroupAction | Node]:
    given = context.launch_configurations
    actions: list[GroupAction | Node] = []
    for side in _SIDES:
        arguments = {name: given[name] for name in _SHARED}
        arguments["set"] = f"{given['set']} {given[f'{side}_set']}"
        arguments.update(namespace=side, frame_prefix=f"{side}/", base=given[f"{side}_base"])
        arguments.update(clock="realtime", viewer="tf", record="", scenario="", autostart="true")
        included = IncludeLaunchDescription(
            str(_SHARE / "launch" / "arm.launch.py"), launch_arguments=arguments.items()
        )
        actions.append(GroupAction([included], scoped=True))
    if given["viewer"] == "rviz":
        configuration = str(_SHARE / "rviz" / "two_arms.rviz")
        actions.insert(0, Node(package="rviz2", executable="rviz2", arguments=["-d", configuration, "-f", "world"]))
    return actions


def generate_launch_description() -> LaunchDescription:
    """Description for ``ros2 launch pidtsm_experiments two_arms.launch.py``."""
    return LaunchDescription([*_ARGUMENTS, OpaqueFunction(function=_actions)])
