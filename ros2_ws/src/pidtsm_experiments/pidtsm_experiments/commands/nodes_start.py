"""``./pidtsm nodes start``: controller and trajectory node of an arm, in the user's ROS domain."""

import argparse
import asyncio
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from pidtsm_core.control import LAW_NAME
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import PRACTICAL
from pidtsm_experiments.commands.options import add_experiment_arguments, experiment_of, warn
from pidtsm_ros.stop import Stop

_EPILOG = f"""Without --plant the arm is yours: it publishes joint_states and applies the efforts of joint_commands, see
docs/own-robot.md. The reference begins where the arm is, at rest, unless --scenario or --set trajectory.reference...
says how it is to move. Ctrl-C brings the arm to rest; then the controller publishes a last torque that carries the arm,
and all nodes end.

With the law {LAW_NAME.default}, the parameters are those of --params {PRACTICAL}, unless others are given.

examples:
  ./pidtsm nodes start --robot my_arm.urdf --effort 20
  ./pidtsm nodes start --robot my_arm.urdf --remap joint_states:=/arm/joint_states --remap joint_commands:=/arm/effort
  ./pidtsm nodes start --robot panda --plant --engine mujoco --namespace left
"""


def add_arguments_of(parser: argparse.ArgumentParser, _action: str) -> None:
    """Add the options of the action."""
    parser.epilog = _EPILOG
    parser.add_argument("--plant", action="store_true", help="also start the simulated arm")
    parser.add_argument("--namespace", default="", metavar="NAME", help="namespace of all nodes and topics")
    parser.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="another name of a topic; can be repeated"
    )
    add_experiment_arguments(parser, duration=False)


def execute_action(options: argparse.Namespace) -> int:
    """Start the nodes, and watch them."""
    from pidtsm_experiments.live.nodes import Nodes
    from pidtsm_experiments.operate.attached import joined, place
    from pidtsm_experiments.operate.claim import claimed
    from pidtsm_experiments.operate.starting import (
        Watch,
        described,
        refuse_simulator,
        start_of,
        still_scenario,
        surroundings,
    )

    if not options.plant:
        refuse_simulator(options.set, options.engine)
    experiment = experiment_of(options, PRACTICAL, None if options.plant else still_scenario())
    start = start_of(experiment, options.plant)
    warn(start.parameters["controller"])
    words = [word for remap in _remaps(options.remap) for word in ("-r", remap)]
    namespace = options.namespace.strip("/")
    stop = Stop()
    stop.defer()
    with ExitStack() as stack:
        stack.enter_context(claimed(namespace))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pidtsm-nodes-")))
        system = stack.enter_context(joined(namespace, words))
        nodes = Nodes(start.parameters, folder, surroundings, [*words, "-r", f"__ns:={system.namespace}"])
        stack.enter_context(nodes)
        kind = "a simulated arm" if options.plant else "your arm"
        _say(f"starting nodes for {kind} {place(namespace)}")
        for node, text in described(start).items():
            _say(f"{node}: {text}")
        asyncio.run(Watch(system, nodes, start, _say).run(stop))
        _say("ending the nodes")
    _say("ended")
    return 0


def _say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)
    sys.stdout.flush()


def _remaps(given: list[str]) -> list[str]:
    for each in given:
        old, separator, new = each.partition(":=")
        if not (old and separator and new):
            raise UsageError(f"--remap {each}: must be of the form FROM:=TO, such as joint_states:=/arm/joint_states")
    return given
