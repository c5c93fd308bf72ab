"""Run several nodes in one process for the lowest latency, with the same parameters and results."""

import argparse
import sys
from importlib.metadata import EntryPoint, entry_points

from pidtsm_ros.process import MakeNode, run_nodes
from pidtsm_ros.stop import Stop

GROUP = "pidtsm_ros.nodes"
"""Entry point group of nodes that can be composed, in a package's setup.py: NAME = MODULE:CLASS."""
_DEFAULT = "simulator,trajectory,controller"
_ROS_ARGUMENTS = "--ros-args"


def run(stop: Stop) -> int:
    """Run the nodes named on the command line; returns the exit code of `run_nodes`."""
    words = sys.argv[1:]
    own, ros = (words[: words.index(_ROS_ARGUMENTS)], words) if _ROS_ARGUMENTS in words else (words, [])
    known = {point.name: point for point in entry_points(group=GROUP)}
    parser = argparse.ArgumentParser(description=__doc__, epilog="Parameter files have one section per node.")
    parser.add_argument(
        "--nodes",
        default=_DEFAULT,
        metavar="NAME,...",
        help=f"nodes in the order they are run (known: {', '.join(sorted(known))}; default: {_DEFAULT})",
    )
    chosen = [name for name in parser.parse_args(own).nodes.split(",") if name]
    unknown = [name for name in chosen if name not in known]
    if unknown or not chosen:
        parser.error(f"unknown nodes {', '.join(unknown)}; known: {', '.join(sorted(known))}")
    return run_nodes([_maker(known[name]) for name in chosen], stop, [sys.argv[0], *ros])


def _maker(point: EntryPoint) -> MakeNode:
    return lambda stop: point.load()(stop)  # noqa: PLW0108  Loads the class when called.
