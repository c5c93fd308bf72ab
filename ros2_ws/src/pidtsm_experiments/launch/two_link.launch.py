"""The whole system: simulator, trajectory and controller, on request with a recorder and a view.

Arguments mean what the options of ``./pidtsm run`` mean. ``ros2 launch`` ends when the simulator has done the scenario.
"""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch_ros.actions import LifecycleNode, Node

from pidtsm_core.laws import LAWS
from pidtsm_core.robots import ROBOTS
from pidtsm_experiments.experiment import make_experiment, scenario_names
from pidtsm_experiments.runner import EXECUTABLES, bag_metadata, node_parameters

_VIEWED = ("/tf", "/robot_description", "/visualization/markers")
"""Topics of the RViz configuration, which in a namespace are those of the namespace."""

_OUTPUT = {"stdout": "log", "stderr": "screen"}  # Nodes log to the latter; the former has the recorder's progress.

_ARGUMENTS = (
    DeclareLaunchArgument(
        "scenario", default_value="case1", description=f"one of {', '.join(scenario_names())}, or a scenario file"
    ),
    DeclareLaunchArgument("law", default_value="", description=f"one of {', '.join(LAWS.names)}"),
    DeclareLaunchArgument("robot", default_value="", description=f"robot model: one of {', '.join(ROBOTS.names)}"),
    DeclareLaunchArgument("duration", default_value="", description="seconds, instead of the scenario's"),
    DeclareLaunchArgument(
        "clock",
        default_value="realtime",
        choices=["realtime", "lockstep"],
        description="realtime: at the wall clock's pace; lockstep: deterministic, as fast as possible",
    ),
    DeclareLaunchArgument(
        "params",
        default_value="",
        description="article, practical, or parameter files for any of the nodes, separated by spaces",
    ),
    DeclareLaunchArgument(
        "set", default_value="", description="parameters NODE.PARAM=VALUE, separated by spaces, quoted as in a shell"
    ),
    DeclareLaunchArgument("namespace", default_value="", description="namespace of all nodes and topics"),
    DeclareLaunchArgument("record", default_value="", description="folder to make for the bag; without it no recorder"),
    DeclareLaunchArgument("viewer", default_value="none", choices=["none", "rviz"], description="what to look with"),
    DeclareLaunchArgument(
        "autostart",
        default_value="true",
        choices=["true", "false"],
        description="false: the nodes wait, unconfigured, for a lifecycle manager",
    ),
)


def _end_all(event: ProcessExited, context: LaunchContext) -> list[Shutdown]:
    """Without one of the three nodes the others have nothing to do."""
    return [] if context.is_shutdown else [Shutdown(reason=f"{event.process_name} has ended")]


def _actions(context: LaunchContext) -> list[Node]:
    given = context.launch_configurations
    clock, namespace = given["clock"], given["namespace"]
    overrides = [f"{node}.robot.name={given['robot']}" for node in ("simulator", "controller") if given["robot"]]
    nodes = ("simulator", "controller", "trajectory")
    overrides += [f"{node}.autostart={given['autostart']}" for node in nodes]
    experiment = make_experiment(
        given["scenario"],
        given["law"] or None,
        float(given["duration"]) if given["duration"] else None,
        shlex.split(given["params"]),
        [*overrides, *shlex.split(given["set"])],
    )
    viewed, recorded = given["viewer"] == "rviz", given["record"]
    listening = 2 + viewed + bool(recorded)
    simulator = {"start.subscribers": listening, **experiment.settings["simulator"]}
    experiment = replace(experiment, settings={**experiment.settings, "simulator": simulator})

    def node(name: str, parameters: dict[str, Any], kind: type[Node] = Node, **options: Any) -> Node:
        package, executable = EXECUTABLES[name]
        return kind(
            package=package,
            executable=executable,
            name=name,
            namespace=namespace,
            parameters=[parameters],
            output=_OUTPUT,
            **options,
        )

    parameters = node_parameters(experiment, clock)
    actions: list[Node] = []
    if viewed:
        configuration = Path(get_package_share_directory("pidtsm_experiments"), "rviz", "two_link.rviz")
        # First, so that nothing is left running where RViz is not installed.
        actions.append(
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=namespace,
                arguments=["-d", str(configuration)],
                parameters=[{"use_sim_time": clock == "lockstep"}],
                remappings=[(topic, topic.lstrip("/")) for topic in _VIEWED],
            )
        )
        actions.append(node("visualization", {}))
    actions += [node(name, values, LifecycleNode, on_exit=_end_all) for name, values in parameters.items()]
    if recorded:
        bag = str(Path(recorded).absolute())
        actions.append(node("recorder", {"output": bag, "metadata": bag_metadata(experiment, clock)}))
    return actions


def generate_launch_description() -> LaunchDescription:
    """What ``ros2 launch pidtsm_experiments two_link.launch.py`` starts."""
    return LaunchDescription([*_ARGUMENTS, OpaqueFunction(function=_actions)])
