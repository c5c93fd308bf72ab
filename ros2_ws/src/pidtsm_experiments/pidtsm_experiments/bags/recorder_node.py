"""Recorder node: writes the messages of the experiment's topics to a rosbag2 bag (MCAP) as they arrive."""

import contextlib
import gc
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from pidtsm_experiments.bags.writer import BagWriter, free_space
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.middleware import RECEIVERS, set_defaults
from pidtsm_ros.qos import RECORDER, RELIABLE_READER
from pidtsm_ros.scheduling import run_in_real_time
from pidtsm_ros.startup import refuse, start_ros
from pidtsm_ros.stop import Stop

TOPICS = {
    "simulator/ground_truth": JointState,
    "controller/state": ControllerState,
    "joint_commands": JointState,
    "reference": JointReference,
    "joint_states": JointState,
}
"""Relative topic names in the order of the subscriptions. Nodes discover the subscriptions in the same order: once a
node has enough subscribers on its topic in the loop (``start.subscribers``), its other topic has them too."""
DIAGNOSTICS = "/diagnostics"
"""Recorded from every publisher, even of other systems; the recorder neither waits for them nor counts losses."""
PUSHES = "simulator/push"
CONTACTS = "simulator/contact/"
"""What precedes the names of the topics with contacts. The simulator creates them before its ground truth, so the
recorder knows them all when it knows that."""
TRUTH = "simulator/ground_truth"
BARRIER = "joint_states"
"""Subscribed to last: the simulator waits for this subscription to start, and until then, every other topic shall have
a publisher. A real arm waits for nobody, and some of the other topics do not exist; see `RecorderNode.connect`."""

MAX_BAG_SIZE = 1_000_000_000
"""Bytes."""
MAX_BAG_DURATION = 300.0
"""s. A file's index grows in memory until the file is finished, by 1.3 MB in this time."""
FLUSH_PERIOD = 0.2
"""Time between two writes to the file, s."""
_WRENCH = "geometry_msgs/msg/WrenchStamped"
_BATCH = 0.02  # s
_STATUS_PERIOD = 0.2  # s between two lines on standard output
_WARNING_PERIOD = 1.0  # s between two lines about lost messages
_ALONE = 2.0
"""s after which joint states without ground truth are those of a real arm: the simulator creates both together."""
_PATIENCE = 10.0  # s of waiting for publishers before a log line about it, and recording without them
_SILENCE = 0.3  # s without a message after which everything is considered received
_REST = 2.0  # s from the request to stop to the end of the recording, if publishers continue
_PRIORITY = 20
"""Priority of the receiving threads, below that of the loop. Their socket buffers hold 50 ms; if they overflow, the
nodes must resend messages and have little time for it."""
_NO_SERVICE = Parameter("start_type_description_service", value=False)


class _RecordedTopic:
    """A recorded topic.

    Attributes:
        subscription: queues the messages until they are taken.
        index: index of the topic in the bag.
        received: number of messages taken.
        lost: number of messages that did not arrive, according to the publisher's sequence numbers.
    """

    def __init__(self, subscription: Subscription, index: int) -> None:
        self.subscription = subscription
        self.index = index
        self.received = 0
        self.lost = 0
        self._sequence: int | None = None
        self._handle, self._type = subscription.handle, subscription.msg_type

    def take(self) -> bytes | None:
        """The next waiting message, serialized; None if there is none."""
        # Executors do not pass the sequence number of serialized messages to callbacks.
        taken = self._handle.take_message(self._type, True)
        if taken is None:
            return None
        data, information = taken
        self.received += 1
        sequence: int | None = information["publication_sequence_number"]
        if sequence is not None and self._sequence is not None:
            gap = sequence - self._sequence - 1
            # A restarted publisher begins at 1; the sequences of several publishers cannot be distinguished.
            if gap > 0 and self.subscription.get_publisher_count() <= 1:
                self.lost += gap
        self._sequence = sequence
        return bytes(data)


class RecorderNode(Node):
    """Subscribes to `TOPICS` as raw bytes and writes them to a bag.

    A received message is in the file after `FLUSH_PERIOD`, and readable however the recorder ends. If writing fails, or
    less than ``min_free_space`` is left on the disk, the bag ends. The node continues to receive, so as not to disturb
    a loop that waits for its subscribers.

    Every topic of `TOPICS` is recorded whenever somebody publishes it; that some never do is normal on a real arm.

    The node polls its subscriptions without an executor and offers no services.

    Parameters, all read at the start: ``output``, the folder of the bag, which must not exist; ``metadata``, a text
    stored in the bag under the key ``pidtsm``; ``max_bag_size`` (bytes) and ``max_bag_duration`` (s), after which a new
    file is started, 0: never; ``min_free_space``, the bytes that recording leaves free; ``plain_names``, whether topic
    names are written without the node's namespace.

    Attributes:
        last: time of the last message, s of the monotonic clock.
        failure: why the bag ended early; empty if it did not.
        connected: whether every topic is subscribed to.
        without: topics that nobody published when the recording of the joint states began.
    """

    def __init__(self) -> None:
        """Create the bag.

        Raises:
            OSError: the bag cannot be created.
        """
        super().__init__("recorder", start_parameter_services=False, parameter_overrides=[_NO_SERVICE])
        output = Path(self._parameter("output", "bag", "new folder for the bag"))
        metadata = self._parameter("metadata", "", "text stored in the bag")
        size = self._parameter("max_bag_size", MAX_BAG_SIZE, "bytes after which a new file is started; 0: never")
        duration = self._parameter(
            "max_bag_duration", MAX_BAG_DURATION, "seconds after which a new file is started; 0: never"
        )
        self._reserve: int = self._parameter("min_free_space", 200_000_000, "bytes that recording leaves free")
        if shortage := self._shortage(output):
            raise OSError(f"{shortage}; free some space, record elsewhere, or lower min_free_space")
        plain: bool = self._parameter("plain_names", False, "write topic names without the node's namespace")
        self._left_out = self.get_namespace().rstrip("/") if plain else ""
        self.last = time.monotonic()
        self.failure = ""
        self._unwritten = 0
        self._output = output
        # Message times do not jump if the system clock is set.
        self._epoch = time.time_ns() - time.monotonic_ns()
        self._writer = BagWriter(output, metadata, size, duration)
        self.connected = False
        self.without: list[str] = []
        self._joined = 0.0  # when somebody was first seen to publish the joint states; 0: not yet
        self._contacts: list[_RecordedTopic] | None = None  # None: not known yet
        self._topics = {topic: self._record(topic) for topic in TOPICS if topic != BARRIER}
        self._others = [
            self._subscribe(DIAGNOSTICS, DiagnosticArray, RELIABLE_READER),
            self._subscribe(PUSHES, WrenchStamped, RELIABLE_READER),
        ]
        self._reported = 0

    def _parameter(self, name: str, default: Any, description: str) -> Any:
        described = ParameterDescriptor(description=description, read_only=True)
        if isinstance(default, float):
            described.floating_point_range = [FloatingPointRange(from_value=0.0, to_value=1e9)]
        elif isinstance(default, int) and not isinstance(default, bool):
            described.integer_range = [IntegerRange(from_value=0, to_value=2**62, step=1)]
        return self.declare_parameter(name, default, described).value

    def _record(self, topic: str) -> _RecordedTopic:
        return self._subscribe(topic, TOPICS[topic], RECORDER)

    def _subscribe(self, topic: str, message_type: Any, qos: QoSProfile) -> _RecordedTopic:
        subscription = self.create_subscription(message_type, topic, _never_called, qos, raw=True)
        type_name = f"{message_type.__module__.split('.')[0]}/msg/{message_type.__name__}"
        name = subscription.topic_name.removeprefix(self._left_out)
        return _RecordedTopic(subscription, self._writer.add_topic(name, type_name))

    @property
    def samples(self) -> int:
        """Number of ground truth samples received; without ground truth, that of joint states; 0 before there are both.

        So nobody ends a recording that counts samples and still lacks the joint states.
        """
        joint_states = self._topics[BARRIER].received if self.connected else 0
        return min(joint_states, self._topics[TRUTH].received or joint_states)

    def connect(self) -> None:
        """Subscribe to `BARRIER` once all other topics have a publisher, or are not to be expected any more.

        They are not if there are joint states, but after `_ALONE` no ground truth, or after `_PATIENCE` not the others.
        """
        truth = self._topics[TRUTH].subscription.get_publisher_count() > 0
        if truth and self._contacts is None:
            self._contacts = self._record_contacts()
        if self.connected:
            return
        without = self.missing()
        if without and not self._stays_alone(truth):
            return
        self._topics[BARRIER] = self._record(BARRIER)
        self.connected, self.without = True, without
        if without:
            self.get_logger().info(
                f"recording without {', '.join(without)}, which nobody publishes; from the first message on, they are "
                "recorded too"
            )

    def _stays_alone(self, truth: bool) -> bool:
        """Whether there have been joint states for so long that no other publisher is to be expected."""
        now = time.monotonic()
        if not self._joined and self.count_publishers(self.resolve_topic_name(BARRIER)):
            self._joined = now
        return self._joined > 0.0 and now - self._joined > (_PATIENCE if truth else _ALONE)

    def _record_contacts(self) -> list[_RecordedTopic]:
        """Subscribe to the contact forces of the simulated arm."""
        folder = f"{self.get_namespace().rstrip('/')}/{CONTACTS}"
        found = self.get_topic_names_and_types()
        names = sorted(name for name, types in found if name.startswith(folder) and _WRENCH in types)
        return [self._subscribe(name, WrenchStamped, RECORDER) for name in names]

    def missing(self) -> list[str]:
        """Topics without a publisher."""
        subscriptions = [topic.subscription for topic in self._topics.values()]
        return [s.topic_name for s in subscriptions if s.get_publisher_count() == 0]

    def counts(self) -> str:
        """How many messages each topic has, and which topics have none."""
        received = {name: self._topics[name].received if name in self._topics else 0 for name in TOPICS}
        beside = (*(self._contacts or ()), *self._others)
        others = {self._name_of(topic): topic.received for topic in beside}
        there = _counts({name: count for name, count in (received | others).items() if count})
        nothing = [name for name, count in received.items() if not count]
        return "; ".join([*([there] if there else []), *([f"nothing of {', '.join(nothing)}"] if nothing else [])])

    def has_publishers(self) -> bool:
        """Whether any of the topics still has a publisher."""
        return any(topic.subscription.get_publisher_count() for topic in self._topics.values())

    def take(self) -> None:
        """Write all messages that have arrived to the bag."""
        with self._writing():
            received = self._received()
            for topic in (*self._topics.values(), *(self._contacts or ()), *self._others):
                while (data := topic.take()) is not None:
                    if self.failure:
                        self._unwritten += 1
                    else:
                        self._writer.write(topic.index, self._epoch + time.monotonic_ns(), data)
            if self._received() > received:
                self.last = time.monotonic()

    def _received(self) -> int:
        return sum(topic.received for topic in self._topics.values())

    def flush(self) -> None:
        """Flush the messages to the file; end the bag if the disk is full."""
        if self.failure:
            return
        with self._writing():
            self._writer.flush()
            if shortage := self._shortage(self._output):
                self._writer.close()
                self._fail(shortage)

    def warn_of_lost(self) -> None:
        """Warn about messages lost since the last warning."""
        lost = self._lost()
        if sum(lost.values()) > self._reported:
            self._reported = sum(lost.values())
            self.get_logger().warning(f"lost so far: {_counts(lost)}; the machine is too busy to record everything")

    def close(self) -> None:
        """Finish the bag and log its content."""
        if not self.failure:
            with self._writing():
                self._writer.close()
        log = self.get_logger()
        log.info(f"received {self.counts()}")
        if lost := self._lost():
            log.warning(f"lost {_counts(lost)}")
        if self.failure:
            log.error(f"{self._output} is incomplete: {self.failure}; {self._unwritten} later messages are missing")

    @contextlib.contextmanager
    def _writing(self) -> Any:
        """A context in which a write error ends only the bag."""
        try:
            yield
        except OSError as error:
            self._writer.abort()
            self._fail(f"cannot write: {error.strerror or error}")

    def _fail(self, reason: str) -> None:
        self.failure = reason
        self.get_logger().error(f"recording ended: {reason}; earlier messages are in {self._output}")

    def _shortage(self, path: Path) -> str:
        free = free_space(path)
        if free >= self._reserve:
            return ""
        return f"{path} is on a disk with {free / 1e6:.1f} MB free, min_free_space is {self._reserve / 1e6:.1f} MB"

    def _lost(self) -> dict[str, int]:
        topics = (*self._topics.values(), *(self._contacts or ()))
        return {self._name_of(topic): topic.lost for topic in topics if topic.lost}

    def _name_of(self, topic: _RecordedTopic) -> str:
        return topic.subscription.topic_name.removeprefix(self.get_namespace().rstrip("/") + "/")


def _never_called(message: bytes) -> None:
    """The node has no executor."""


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} of {name}" for name, count in counts.items())


def _print_progress(recorder: RecorderNode) -> None:
    """Print a progress line: for the program that started the recorder, the samples; for people, all topics."""
    with contextlib.suppress(BrokenPipeError):
        print(f"recorded {recorder.samples} samples: {recorder.counts()}", flush=True)


def _record(recorder: RecorderNode, stop: Stop) -> None:
    """Record until a stop is requested, and then until messages stop arriving; at most `_REST` if they do not."""
    flush = _Every(FLUSH_PERIOD, recorder.flush)
    rest = [_Every(_STATUS_PERIOD, lambda: _print_progress(recorder)), _Every(_WARNING_PERIOD, recorder.warn_of_lost)]
    now = time.monotonic()
    patience, end = now + _PATIENCE, math.inf
    while now < end and not (stop.requested and now - recorder.last > _SILENCE):
        # Waking up per batch costs a fraction of waking up per message; the queues hold far more than a batch.
        time.sleep(_BATCH)
        recorder.connect()
        recorder.take()
        now = time.monotonic()
        for task in (flush, *rest):
            task.poll(now)
        if now >= patience and not recorder.connected:
            recorder.get_logger().warning(f"waiting for a publisher of {', '.join(recorder.missing())}")
            patience = now + _PATIENCE
        if not stop.requested or not recorder.has_publishers():
            end = math.inf
        elif end == math.inf:
            end = now + _REST


class _Every:
    """Periodic work, period in s."""

    def __init__(self, period: float, work: Callable[[], None]) -> None:
        self._period, self._work, self._next = period, work, 0.0

    def poll(self, now: float) -> None:
        if now >= self._next:
            self._next = now + self._period
            self._work()


def run(stop: Stop) -> int:
    """``ros2 run pidtsm_experiments recorder``: record until a signal.

    Returns:
        The exit code: 1 if the bag could not be created or is incomplete, else 0.

    Raises:
        SystemExit: invalid parameters, see `refuse`.
    """
    set_defaults("fastdds_recorder.xml")
    start_ros(stop)
    try:
        recorder = RecorderNode()
    except ParameterException as error:
        refuse(error)
    except Exception as error:
        print(f"cannot record: {error}", file=sys.stderr)
        return 1
    gc.freeze()
    if refused := run_in_real_time(_PRIORITY, RECEIVERS):
        recorder.get_logger().info(refused)
    try:
        _record(recorder, stop)
    finally:
        recorder.close()
        _print_progress(recorder)
        recorder.destroy_node()
        rclpy.try_shutdown()
    return 1 if recorder.failure else 0
