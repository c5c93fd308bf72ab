"""The main loop of a node's process."""

import gc
import math
import time
from collections.abc import Callable, Sequence
from functools import partial

import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.lifecycle import TransitionCallbackReturn

from pidtsm_core.parameters import ParameterError
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.scheduling import run_in_real_time
from pidtsm_ros.startup import refuse, start_ros
from pidtsm_ros.stop import Stop

_LONGEST_WAIT = 0.1
"""s; Python runs signal handlers only between two waits of the executor."""
_BETWEEN_ATTEMPTS = 0.005
"""s between two looks whether a node can become active."""
_PATIENCE = 2.0
"""s after which the log says why it cannot."""


def spin_for(executor: Executor, duration: float) -> None:
    """Execute what is ready, and what becomes ready within `duration` s.

    The events executor's ``spin`` never looks at signals, and each ``spin_until_future_complete`` loses 32 bytes
    (rclpy 7.1); ``spin_once`` handles one event a call.
    """
    end = time.monotonic() + duration
    while duration >= 0.0:
        executor.spin_once(timeout_sec=duration)
        duration = end - time.monotonic()


def run_nodes(make_nodes: Sequence[Callable[[], ManagedNode]], stop: Stop, args: Sequence[str] | None = None) -> int:
    """Run nodes in this process until one has finished, or SIGINT or SIGTERM ends it.

    Args:
        make_nodes: each called once ROS is initialised.
        stop: made at the beginning of the process.
        args: command line; the process's own where None.

    Returns:
        Exit code: 0 ended as asked, 1 the work failed.

    Raises:
        SystemExit: bad arguments or parameters, see `refuse`.

    The events executor wakes for what arrived, instead of rebuilding a wait set for every message.
    """
    start_ros(stop, args)
    nodes: list[ManagedNode] = []
    try:
        try:
            for make_node in make_nodes:
                nodes.append(make_node())
        except ParameterError as error:
            refuse(error)
        return _spin(nodes, stop)
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
        stop.finish()


def _spin(nodes: Sequence[ManagedNode], stop: Stop) -> int:
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        waiting = [node for node in nodes if node.values["autostart"]]
        if not all(node.trigger_configure() == TransitionCallbackReturn.SUCCESS for node in waiting):
            return 1
        for node in waiting:
            node.retry_activation = partial(_activate, waiting)
        _settle(nodes)
        polls = [node.poll for node in nodes]
        patience = time.monotonic() + _PATIENCE
        while not (stop.requested or any(node.finished for node in nodes)):
            if not _activate(waiting):
                return 1
            if waiting and time.monotonic() > patience:
                patience = math.inf
                for node in waiting:
                    node.get_logger().info(f"not active yet: {node.refusal()}")
            longest = _BETWEEN_ATTEMPTS if waiting else _LONGEST_WAIT
            spin_for(executor, min(longest, *[poll() for poll in polls]))
        for node in nodes:
            if node.active:
                node.trigger_deactivate()
            node.flush()
        return 1 if any(node.failed for node in nodes) else 0
    finally:
        for node in nodes:
            executor.remove_node(node)
        executor.shutdown()


def _settle(nodes: Sequence[ManagedNode]) -> None:
    """What is done once, between the start and the loop."""
    # What is there by now stays: the collector need not walk it again in the loop.
    gc.collect()
    gc.freeze()
    priority = max(node.priority for node in nodes)
    if priority:
        refused = run_in_real_time(priority)
        if refused:
            nodes[0].get_logger().info(refused)


def _activate(waiting: list[ManagedNode]) -> bool:
    """Activate those of the nodes that can be, and take them off the list; false where one fails."""
    for node in list(waiting):
        if not node.active:  # Somebody else may have seen to it.
            if node.refusal():
                continue
            if node.trigger_activate() != TransitionCallbackReturn.SUCCESS:
                return False
        waiting.remove(node)
    return True
