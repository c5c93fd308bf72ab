"""Main loop of a node's process."""

import gc
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.lifecycle import TransitionCallbackReturn

from pidtsm_core.parameters import ParameterError
from pidtsm_ros.leaving import PATIENCE, leaving_within
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.scheduling import run_at_normal_priority, run_in_real_time
from pidtsm_ros.sole_topic import CHECK
from pidtsm_ros.startup import INVALID, refuse, start_ros
from pidtsm_ros.stop import Stop

_LONGEST_WAIT = 0.1
"""Longest wait of the executor, s; Python runs signal handlers only between two waits."""
_BETWEEN_ATTEMPTS = 0.005
"""Time between two attempts to activate a node, s."""
_PATIENCE = 2.0
"""After this time, log why a node is not active yet, s."""


def spin_for(executor: Executor, duration: float) -> None:
    """Execute callbacks that are ready or become ready within `duration` s.

    The events executor's ``spin`` never checks for signals, and each ``spin_until_future_complete`` leaks 32 bytes
    (rclpy 7.1); ``spin_once`` handles one event per call.
    """
    end = time.monotonic() + duration
    while duration >= 0.0:
        executor.spin_once(timeout_sec=duration)
        duration = end - time.monotonic()


MakeNode: TypeAlias = Callable[[Stop], ManagedNode]
"""Creates a node."""


def run_nodes(make_nodes: Sequence[MakeNode], stop: Stop, args: Sequence[str] | None = None) -> int:
    """Run nodes in this process until one has finished, or until SIGINT or SIGTERM.

    The events executor wakes up for each event instead of rebuilding a wait set for every message.

    Args:
        make_nodes: create the nodes; called after ROS is initialised.
        stop: created at the start of the process.
        args: command line; None: that of the process.

    Returns:
        Exit code: 0 success or stopped by a signal, 1 the work failed.

    Raises:
        SystemExit: invalid arguments or parameters, see `refuse`.
    """
    start_ros(stop, args)
    nodes: list[ManagedNode] = []
    executor, code = EventsExecutor(), 1
    try:
        try:
            for make_node in make_nodes:
                nodes.append(make_node(stop))
        except ParameterError as error:
            code = INVALID
            refuse(error)
        for node in nodes:
            executor.add_node(node)
        code = _spin(executor, nodes, stop)
        _take_leave(nodes)
    finally:
        # A thread of the middleware that hangs at the priority of the loop would starve the machine.
        run_at_normal_priority()
        with leaving_within(code):
            for node in nodes:
                executor.remove_node(node)
            executor.shutdown()
            for node in nodes:
                node.destroy_node()
            rclpy.try_shutdown()
        stop.finish()
    return code


def _spin(executor: Executor, nodes: Sequence[ManagedNode], stop: Stop) -> int:
    """The life of the nodes; returns the exit code."""
    waiting = [node for node in nodes if node.values["autostart"]]
    if not all(node.trigger_configure() == TransitionCallbackReturn.SUCCESS for node in waiting):
        return 1
    for node in waiting:
        node.retry_activation = partial(_activate, waiting)
    _settle(nodes)
    polls = [node.poll for node in nodes]
    patience, look = time.monotonic() + _PATIENCE, 0.0
    while not (stop.requested or any(node.finished for node in nodes)):
        if not _activate(waiting):
            return 1
        if time.monotonic() > look:
            look = time.monotonic() + CHECK
            for node in nodes:
                node.look_for_rivals()
        if waiting and time.monotonic() > patience:
            patience = math.inf
            for node in waiting:
                node.get_logger().info(f"not active yet: {node.refusal() or node.rivalry()}")
        longest = _BETWEEN_ATTEMPTS if waiting else _LONGEST_WAIT
        spin_for(executor, min(longest, *[poll() for poll in polls]))
    return 1 if any(node.failed for node in nodes) else 0


def _take_leave(nodes: Sequence[ManagedNode]) -> None:
    """Publish what is last, and wait until it has arrived, at normal priority."""
    for node in nodes:
        if node.active:
            node.trigger_deactivate()
    run_at_normal_priority()
    until = time.monotonic() + PATIENCE
    for node in nodes:
        node.flush(until)


def _settle(nodes: Sequence[ManagedNode]) -> None:
    """Prepare the process once, after the start and before the loop."""
    # Existing objects stay alive; the garbage collector need not traverse them in the loop.
    gc.collect()
    gc.freeze()
    priority = max(node.priority for node in nodes)
    if priority:
        refused = run_in_real_time(priority)
        if refused:
            nodes[0].get_logger().info(refused)


def _activate(waiting: list[ManagedNode]) -> bool:
    """Activate the nodes that can be activated and remove them from the list; false if one fails."""
    for node in list(waiting):
        if not node.active:  # It may have been activated through its service.
            if node.refusal():
                node.listen_again()
                continue
            if rivalry := node.rivalry():
                if node.outdone:
                    # It must not take over by itself later, perhaps because somebody ends the other to stop the arm.
                    node.get_logger().error(f"not activated: {rivalry}; then start this node again")
                    waiting.remove(node)
                continue
            if node.trigger_activate() != TransitionCallbackReturn.SUCCESS:
                return False
        waiting.remove(node)
    return True
