"""The whole system: simulator, trajectory and controller, optionally with a recorder and a viewer.

The arguments correspond to the options of ``./pidtsm run``. ``ros2 launch`` ends when the simulator has finished.
"""

import math
import shlex
import sys
from argparse import ArgumentTypeError
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited, ShutdownProcess
from launch_ros.actions import LifecycleNode, Node
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import DEFAULT_SCENARIO, Experiment, make_experiment, scenario_names
from pidtsm_core.laws import LAWS
from pidtsm_core.robots import NAMES, description_schema, find_description
from pidtsm_core.simulation.mujoco_model import ENGINE
from pidtsm_experiments.commands.options import engine_overrides, seconds
from pidtsm_experiments.runs.runner import EXECUTABLES, bag_metadata, node_parameters

_VIEWED = ("/tf", "/robot_description", "/visualization/markers")
"""Topics of the RViz configuration, remapped into the namespace."""

_OF_POSE = 6
"""Numbers of a place: x, y, z, roll, pitch, yaw."""
_OUTPUT = {"stdout": "log", "stderr": "screen"}  # Nodes log to stderr; stdout has the recorder's progress.

_ARGUMENTS = (
    DeclareLaunchArgument(
        "scenario",
        default_value="",
        description=f"one of {', '.join(scenario_names())}, or a scenario file (default: {DEFAULT_SCENARIO}; for "
        "another robot, every joint swings about its middle)",
    ),
    DeclareLaunchArgument("law", default_value="", description=f"one of {', '.join(LAWS.names)}"),
    DeclareLaunchArgument("robot", default_value="", description=f"the arm: one of {', '.join(NAMES)}, or a URDF"),
    DeclareLaunchArgument("engine", default_value="", description=f"of the simulator: {', '.join(ENGINE.choices)}"),
    DeclareLaunchArgument("duration", default_value="", description="duration in seconds (default: the scenario's)"),
    DeclareLaunchArgument(
        "clock",
        default_value="realtime",
        description="realtime: in real time; lockstep: deterministic, as fast as possible",
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
    DeclareLaunchArgument("record", default_value="", description="new folder for the bag; empty: no recorder"),
    DeclareLaunchArgument(
        "viewer",
        default_value="none",
        description="viewer: none or rviz; tf: only the frames and markers, for a viewer of yours",
    ),
    DeclareLaunchArgument(
        "base", default_value="", description="place of the base in the frame world: x y z roll pitch yaw, m and rad"
    ),
    DeclareLaunchArgument(
        "frame_prefix",
        default_value="",
        description="prefix of the arm's frames, which are then on /tf: left/",
    ),
    DeclareLaunchArgument(
        "autostart",
        default_value="true",
        description="true; or false: the nodes stay unconfigured and wait for a lifecycle manager",
    ),
)
_CHOICES = {"clock": ("realtime", "lockstep"), "viewer": ("none", "rviz", "tf"), "autostart": ("true", "false")}
"""Allowed values. They are not passed to `DeclareLaunchArgument`, which would report an error twice."""
_OF_LAUNCH = ("launch-prefix", "launch-prefix-filter", "emulate_tty", "sigterm_timeout", "sigkill_timeout")
"""Arguments of launch itself, for every process."""


def _check(given: Mapping[str, str]) -> None:
    """Check arguments that are not checked by a node.

    Raises:
        UsageError: an argument is unknown, or a value is not allowed.
    """
    known = [argument.name for argument in _ARGUMENTS]
    unknown = [name for name in given if name not in (*known, *_OF_LAUNCH)]
    if unknown and _launched_alone():
        raise UsageError(f"unknown argument {unknown[0]}; known: {', '.join(known)}")
    for name, choices in _CHOICES.items():
        if given[name] not in choices:
            raise UsageError(f"{name}: {given[name]!r} must be one of {', '.join(choices)}")
    if given["record"] and Path(given["record"]).exists():
        raise UsageError(f"record: {given['record']} exists; specify a new folder")
    try:
        validate_namespace(f"/{given['namespace'].lstrip('/')}")
    except InvalidNamespaceException as error:
        raise UsageError(f"namespace: {given['namespace']!r}: {str(error).splitlines()[0].rstrip(':')}") from None


def _launched_alone() -> bool:
    """Whether the command line names this file; a launch file that includes it may have other arguments."""
    return any(":=" not in word and Path(word).name == Path(__file__).name for word in sys.argv)


def _duration(text: str) -> float | None:
    try:
        return seconds(text) if text else None
    except ArgumentTypeError as error:
        raise UsageError(f"duration: {error}") from None


def _words(name: str, text: str) -> list[str]:
    """The words of an argument, quoted as in a shell."""
    try:
        return shlex.split(text)
    except ValueError as error:
        raise UsageError(f"{name}: {text}: {error}") from None


def _numbers(name: str, text: str) -> list[float]:
    """The six numbers of an argument; none if it is empty."""
    words = text.split()
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = [math.nan]
    if words and (len(words) != _OF_POSE or not all(math.isfinite(number) for number in found)):
        raise UsageError(f"{name}: {text!r} must be six numbers: x y z roll pitch yaw")
    return found


class _End:
    """Ends all nodes when one has ended: first simulator, controller and trajectory, then the rest.

    `Shutdown` alone interrupts the processes up to a second later, after launch's own node has ended; meanwhile the
    controller would report missing joint states.

    Attributes:
        loop: those of the first three that are still running.
    """

    def __init__(self) -> None:
        self.loop: set[Node] = set()

    def __call__(self, event: ProcessExited, context: LaunchContext) -> list[Shutdown | EmitEvent]:
        self.loop.discard(event.action)
        if context.is_shutdown:
            return []
        if self.loop:
            return [EmitEvent(event=ShutdownProcess(process_matcher=self.loop.__contains__))]
        return [Shutdown(reason=f"{event.process_name} has ended")]


def _experiment(given: Mapping[str, str]) -> Experiment:
    """What is to run."""
    nodes = ("simulator", "controller", "trajectory")
    overrides = [f"{node}.autostart={given['autostart']}" for node in nodes]
    if given["frame_prefix"]:
        overrides += [f"{node}.frame_prefix={given['frame_prefix']}" for node in nodes]
    return make_experiment(
        given["scenario"] or None,
        given["law"] or None,
        _duration(given["duration"]),
        _words("params", given["params"]),
        [*overrides, *engine_overrides(given["engine"]), *_words("set", given["set"])],
        given["robot"] or None,
    )


def _actions(context: LaunchContext) -> list[Node]:
    given = context.launch_configurations
    _check(given)
    clock, namespace = given["clock"], given["namespace"]
    prefix, base = given["frame_prefix"], _numbers("base", given["base"])
    experiment = _experiment(given)
    viewed, recorded = given["viewer"] != "none", given["record"]
    shared = [(topic, f"/{topic}") for topic in ("tf", "tf_static")] if prefix or base else []
    others = viewed + bool(recorded)
    listening = {"simulator": 2 + others, "controller": 1 + others, "trajectory": 1 + others}

    def node(name: str, parameters: dict[str, Any], kind: type[Node] = Node, **options: Any) -> Node:
        package, executable = EXECUTABLES[name]
        return kind(
            package=package,
            executable=executable,
            name=name,
            namespace=namespace,
            parameters=[parameters],
            remappings=shared,
            output=_OUTPUT,
            **options,
        )

    parameters = node_parameters(experiment, clock, listening)
    actions: list[Node] = []
    if viewed:
        controlled = parameters["controller"]
        chosen = {parameter.name: controlled[parameter.name] for parameter in description_schema(controlled)}
    if given["viewer"] == "rviz":
        configuration = Path(get_package_share_directory("pidtsm_experiments"), "rviz", "arm.rviz")
        # First, so that nothing keeps running if RViz is not installed.
        actions.append(
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=namespace,
                arguments=["-d", str(configuration), "-f", find_description(chosen).links.names[0]],
                parameters=[{"use_sim_time": clock == "lockstep"}],
                remappings=[(topic, topic.lstrip("/")) for topic in _VIEWED],
            )
        )
    if viewed:
        if prefix:
            chosen["frame_prefix"] = prefix
        if base:
            chosen.update({"base.parent": "world", "base.pose": base})
        actions.append(node("visualization", chosen))
    end = _End()
    loop = [node(name, values, LifecycleNode, on_exit=end) for name, values in parameters.items()]
    end.loop.update(loop)
    actions += loop
    if recorded:
        bag = str(Path(recorded).absolute())
        metadata = bag_metadata(experiment, clock)
        actions.append(node("recorder", {"output": bag, "metadata": metadata}, on_exit=end))
    return actions


def generate_launch_description() -> LaunchDescription:
    """Description for ``ros2 launch pidtsm_experiments arm.launch.py``."""
    return LaunchDescription([*_ARGUMENTS, OpaqueFunction(function=_actions)])
