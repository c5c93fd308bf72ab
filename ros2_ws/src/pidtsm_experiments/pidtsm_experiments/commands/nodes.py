"""``./pidtsm nodes``: start a system in your ROS domain, and operate it."""

import argparse
import importlib
from collections.abc import Callable
from typing import Any

_EPILOG = """examples:
  ./pidtsm nodes start --robot my_arm.urdf              controller and trajectory node; the arm is on your topics
  ./pidtsm nodes start --robot my_arm.urdf --plant      the same with a simulated arm
  ./pidtsm nodes list
  ./pidtsm nodes param get controller law.k1
  ./pidtsm nodes param set controller law.k1=4.0 law.k2=2.0
  ./pidtsm nodes freedrive on
  ./pidtsm nodes record --output first_motion

All act in the ROS domain of ROS_DOMAIN_ID (default: 0), and in the namespace of --namespace.

exit codes: 0 success, 1 no such nodes, or a node refuses, with its reason, 2 bad usage or input, 130 interrupted
"""
_ACTIONS = {
    "start": "start controller and trajectory node, and with --plant a simulated arm; watch them until Ctrl-C",
    "list": "show which nodes run, and what each does",
    "param": "list, get and set parameters of a node",
    "reset": "let the controller follow again after a fault",
    "freedrive": "let a person move the arm by hand, or hold it where it is",
    "hold": "bring the arm to rest and hold it, or follow the reference again",
    "record": "record every topic of the system to a bag, until Ctrl-C",
    "stop": "end what `nodes start` has started; deactivate nodes that others have started",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True, parser_class=type(parser))
    for name, text in _ACTIONS.items():
        sub = actions.add_parser(
            name, help=text, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        # Starting needs everything that defines an experiment; the others are quick.
        module = importlib.import_module(
            f"pidtsm_experiments.commands.nodes_{'start' if name == 'start' else 'operate'}"
        )
        add: Callable[[argparse.ArgumentParser, str], None] = module.add_arguments_of
        add(sub, name)
        sub.set_defaults(act=module.execute_action)


def execute(options: argparse.Namespace) -> int:
    act: Callable[[Any], int] = options.act
    return act(options)
