"""Recorder node: writes what the experiment's topics carry to a rosbag2 bag (MCAP), message by message as it came."""

import contextlib
import gc
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys.store import Typestore
from sensor_msgs.msg import JointState

from pidtsm_experiments.recording import typestore
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.process import spin_for
from pidtsm_ros.qos import RECORDER

TOPICS = {
    "joint_states": JointState,
    "joint_commands": JointState,
    "reference": JointReference,
    "controller/state": ControllerState,
    "simulator/ground_truth": JointState,
}
"""Relative names, as the nodes publish them."""
BARRIER = "joint_states"
"""Subscribed to last, once every other topic has a publisher: a simulator that waits for its subscribers
(``start.subscribers``) then starts when nothing can be missed any more."""

_BATCH = 0.02  # s
_STATUS_PERIOD = 0.2  # s between two lines on standard output
_PATIENCE = 10.0  # s of waiting for publishers before the log says so
_SILENCE = 0.3  # s without a message after which everything sent has arrived


def _type_name(message_type: type) -> str:
    return f"{message_type.__module__.split('.')[0]}/msg/{message_type.__name__}"


class Recorder(Node):
    """Subscribes to `TOPICS` as raw bytes and writes them to a bag.

    Parameters: ``output``, the folder of the bag, which must not exist; ``metadata``, a text that is stored in
    the bag under the key ``pidtsm``.
    """

    def __init__(self) -> None:
        super().__init__("recorder")
        output = Path(self.declare_parameter("output", "bag").value)
        metadata = str(self.declare_parameter("metadata", "").value)
        self.counts = dict.fromkeys(TOPICS, 0)
        self.last = time.monotonic()
        types = typestore()
        self._writer = Writer(output, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        if metadata:
            self._writer.set_custom_data("pidtsm", metadata)
        self.connected = False
        self._before_barrier = [self._record(topic, types) for topic in TOPICS if topic != BARRIER]
        self._types = types

    def connect(self) -> None:
        """Subscribe to the last topic once all others have a publisher."""
        if not self.connected and all(s.get_publisher_count() > 0 for s in self._before_barrier):
            self._record(BARRIER, self._types)
            self.connected = True

    def missing(self) -> list[str]:
        """Topics without a publisher so far."""
        return [s.topic_name for s in self._before_barrier if s.get_publisher_count() == 0]

    def _record(self, topic: str, types: Typestore) -> Subscription:
        full_name, message_type = self.resolve_topic_name(topic), TOPICS[topic]
        connection = self._writer.add_connection(full_name, _type_name(message_type), typestore=types)
        write, counts = self._writer.write, self.counts

        def on_message(data: bytes) -> None:
            write(connection, time.time_ns(), data)
            counts[topic] += 1
            self.last = time.monotonic()

        return self.create_subscription(message_type, topic, on_message, RECORDER, raw=True)

    def close(self) -> None:
        """Finish the bag."""
        self._writer.close()


def _tell_progress(recorder: Recorder) -> None:
    """A line on standard output, for whoever reads it."""
    with contextlib.suppress(BrokenPipeError):
        print(f"recorded {recorder.counts['simulator/ground_truth']}", flush=True)


def _spin(recorder: Recorder, stopping: Callable[[], bool]) -> None:
    """Record until asked to stop, and then on until nothing arrives any more."""
    executor = EventsExecutor()
    executor.add_node(recorder)
    next_status, patience = 0.0, time.monotonic() + _PATIENCE
    while not (stopping() and time.monotonic() - recorder.last > _SILENCE):
        # Waking for batches costs a fraction of waking for every message; the queues hold far more than a batch.
        time.sleep(_BATCH)
        spin_for(executor, 0.0)
        recorder.connect()
        now = time.monotonic()
        if now >= patience and recorder.missing():
            recorder.get_logger().warning(f"waiting for a publisher of {', '.join(recorder.missing())}")
            patience = now + _PATIENCE
        if now >= next_status:
            _tell_progress(recorder)
            next_status = now + _STATUS_PERIOD
    executor.remove_node(recorder)
    executor.shutdown()


def main() -> None:
    """Entry point of ``ros2 run pidtsm_experiments recorder``."""
    stop = False

    def request(number: int, frame: FrameType | None) -> None:
        nonlocal stop
        stop = True

    signal.signal(signal.SIGINT, request)
    signal.signal(signal.SIGTERM, request)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        recorder = Recorder()
    except Exception as error:
        print(f"cannot record: {error}", file=sys.stderr)
        sys.exit(1)
    gc.freeze()
    try:
        _spin(recorder, lambda: stop)
    except ExternalShutdownException:
        pass
    finally:
        recorder.close()
        _tell_progress(recorder)
        recorder.destroy_node()
        rclpy.try_shutdown()
