"""The main loop of a node's process."""

import gc
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType

import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from pidtsm_core.parameters import ParameterError
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.scheduling import run_in_real_time

_LONGEST_WAIT = 0.1
"""s; Python runs signal handlers only between two waits of the executor."""


_NEVER: Future = Future()


class _Stop:
    """Set by SIGINT and SIGTERM, so that the loop ends where it is safe to."""

    def __init__(self) -> None:
        self.requested = False
        signal.signal(signal.SIGINT, self._request)
        signal.signal(signal.SIGTERM, self._request)

    def _request(self, number: int, frame: FrameType | None) -> None:
        self.requested = True


def spin_for(executor: Executor, duration: float) -> None:
    """Execute what is ready, and what becomes ready within `duration` s.

    The events executor's ``spin_once`` handles one event and costs more than most of them; its ``spin`` never
    looks at signals. Waiting for a future that never comes does what is needed.
    """
    executor.spin_until_future_complete(_NEVER, timeout_sec=duration)


def run(make_nodes: Sequence[Callable[[], ManagedNode]], args: Sequence[str] | None = None) -> int:
    """Run nodes in this process until one has finished, or SIGINT or SIGTERM ends it.

    Args:
        make_nodes: each called once ROS is initialised.
        args: command line; the process's own where None.

    Returns:
        Exit code: 0 ended as asked, 1 the work failed, 2 bad parameters (said in one line on standard error).

    The events executor wakes for what arrived, instead of rebuilding a wait set for every message.
    """
    stop = _Stop()
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        print(f"cannot start: {_one_line(error)}", file=sys.stderr)
        return 2
    nodes: list[ManagedNode] = []
    try:
        try:
            for make_node in make_nodes:
                nodes.append(make_node())
        except ParameterError as error:
            print(f"cannot start: {error}", file=sys.stderr)
            return 2
        return _spin(nodes, stop)
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def _spin(nodes: Sequence[ManagedNode], stop: _Stop) -> int:
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        if not all(_start(node) for node in nodes if node.values["autostart"]):
            return 1
        _settle(nodes)
        polls = [node.poll for node in nodes]
        while not (stop.requested or any(node.finished for node in nodes)):
            spin_for(executor, min(_LONGEST_WAIT, *[poll() for poll in polls]))
        for node in nodes:
            node.flush()
            if node.active:
                node.trigger_deactivate()
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


def _start(node: ManagedNode) -> bool:
    success = TransitionCallbackReturn.SUCCESS
    return bool(node.trigger_configure() == success and node.trigger_activate() == success)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
