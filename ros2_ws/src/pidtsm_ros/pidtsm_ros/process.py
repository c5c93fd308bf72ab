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


def run(make_node: Callable[[], ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run a node until it has finished, or SIGINT or SIGTERM ends it.

    Args:
        make_node: called once ROS is initialised.
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
    try:
        try:
            node = make_node()
        except ParameterError as error:
            print(f"cannot start: {error}", file=sys.stderr)
            return 2
        return _spin(node, stop)
    finally:
        rclpy.try_shutdown()


def _spin(node: ManagedNode, stop: _Stop) -> int:
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        if node.values["autostart"] and not _start(node):
            return 1
        # What is there by now stays: the collector need not walk it again in the loop.
        gc.collect()
        gc.freeze()
        while not (stop.requested or node.finished):
            spin_for(executor, min(node.poll(), _LONGEST_WAIT))
        node.flush()
        if node.active:
            node.trigger_deactivate()
        return 1 if node.failed else 0
    finally:
        executor.remove_node(node)
        executor.shutdown()
        node.destroy_node()


def _start(node: ManagedNode) -> bool:
    success = TransitionCallbackReturn.SUCCESS
    return bool(node.trigger_configure() == success and node.trigger_activate() == success)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
