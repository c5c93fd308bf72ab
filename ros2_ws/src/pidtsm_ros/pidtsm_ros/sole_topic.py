"""Topics that one node alone should publish: who does, and who else publishes them."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from pidtsm_ros.qos import READER

if TYPE_CHECKING:
    from pidtsm_ros.managed_node import ManagedNode

CHECK = 0.4
"""Time between two checks for other publishers, s."""
_QUIET = 0.3
"""s; a publisher from which nothing arrived for so long publishes nothing."""
_EVEN = 50
"""Messages; of two publishers that differ by fewer, none was first."""
CURE = "end one of them, or give each arm a namespace of its own"


def with_number(read: Callable[[bytes, int | None], None]) -> Callable[..., None]:
    """A callback for raw messages that also receives their number, counted for each publisher; None: unknown.

    The events executor of rclpy 7.1 passes message and information as one tuple, other executors as two arguments.
    """

    def callback(*given: Any) -> None:
        data, info = given[0] if len(given) == 1 else given
        read(data, info["publication_sequence_number"])

    callback.__signature__ = _SIGNATURE  # type: ignore[attr-defined]
    return callback


def _example(data: bytes, info: dict[str, Any]) -> None:
    """What rclpy should take `with_number` for."""


_SIGNATURE = inspect.signature(_example)


def known(publishers: Sequence[TopicEndpointInfo]) -> bool:
    """Whether the names of all nodes have been discovered; this takes a moment longer than their publishers."""
    return not any("UNKNOWN_" in p.node_name for p in publishers)


def named(publishers: Sequence[TopicEndpointInfo]) -> str:
    """Names of the nodes of these publishers."""
    names = {f"{p.node_namespace.rstrip('/')}/{p.node_name}" for p in publishers if known([p])}
    return ", ".join([*sorted(names), *([] if known(publishers) else ["a node of unknown name"])])


class SoleTopic:
    """Publishes a topic that no other node should publish, and finds out whether one does.

    The node that published first stays. A node that is not active yet listens before it becomes active: not at all if
    nobody else has a publisher, else until those have been silent for a moment, one after the other in the order of
    their identifiers. Silence counts only while the node itself would publish: before, the others cannot, either, as
    when no arm is there yet. Two nodes that became active before they knew of each other compare how many messages
    they have published; if they have published equally many, the larger identifier yields.

    Attributes:
        publisher: of rclpy.
        lost: the node must not become active by itself any more, because another is.
        trouble: who else publishes the topic, and the cure; empty if nobody.
        received_another: messages of another node arrived while this one is active.
    """

    def __init__(self, node: ManagedNode, topic: str, create: Callable[[], Publisher]) -> None:
        """Create the publisher; args: node: its node; topic: its name; create: creates it."""
        self._node = node
        self.lost = self.received_another = self._rivalled = False
        self.trouble = ""
        self._published = 0
        self._topic = node.resolve_topic_name(topic)
        self._own = b""
        while not self._own:
            before = self._of_this_name()
            self.publisher = create()
            new = self._of_this_name() - before
            if len(new) == 1:
                (self._own,) = new
            else:  # At this moment another node of this name was discovered.
                node.destroy_publisher(self.publisher)
        self._subscription: Subscription | None = None
        self._since = self._received = 0.0  # s
        self._last = 0  # number of the last message received
        self._older = self._even = self._yielded = False

    def _of_this_name(self) -> set[bytes]:
        """Identifiers of the publishers of nodes with the name of this one."""
        name = self._node.get_name(), self._node.get_namespace()
        infos = self._node.get_publishers_info_by_topic(self._topic)
        return {bytes(i.endpoint_gid) for i in infos if (i.node_name, i.node_namespace) == name}

    def publish(self, data: bytes) -> None:
        """Publish a serialized message."""
        self._published += 1
        self.publisher.publish(data)

    def destroy(self) -> None:
        """Stop listening; the node destroys its publisher."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    @property
    def listens(self) -> bool:
        """Whether the node subscribes to the topic itself."""
        return self._subscription is not None

    def _others(self) -> list[TopicEndpointInfo]:
        topic = self._topic
        if self._node.count_publishers(topic) < 2:
            return []
        infos = self._node.get_publishers_info_by_topic(topic)
        return [info for info in infos if bytes(info.endpoint_gid) != self._own]

    def refusal(self) -> str:
        """Why the node must not become active, because of another publisher; empty if it may."""
        others = self._others()
        if not others:
            self.destroy()
            self.lost = False
            return ""
        self._listen()
        topic, names, now = self._topic, named(others), time.monotonic()
        if self._received and now - self._received < _QUIET and known(others):
            self.lost = True
            return f"{topic} is published by {names} already; {CURE}"
        before = sum(bytes(info.endpoint_gid) < self._own for info in others)
        if now - self._since < _QUIET * (1 + before) or not known(others):
            return f"{names} may publish {topic}: listening first"
        return ""

    def listen_again(self) -> None:
        """Disregard the silence so far: nobody could have published."""
        self._since = time.monotonic()

    def _listen(self) -> None:
        if self._subscription is None:
            self._since, self._received, self._last = time.monotonic(), 0.0, 0
            self._subscription = self._node.create_subscription(
                self.publisher.msg_type, self._topic, with_number(self._receive), READER, raw=True
            )

    def _receive(self, _data: bytes, number: int | None) -> None:
        """Find out whether a message is of another node: its number does not continue those of this node."""
        self._received = time.monotonic()
        if not self._node.active or number is None:
            return
        if number > self._published or number <= self._last:
            self._rivalled = True
            self._older |= number > self._published + _EVEN
            self._even |= abs(number - self._published) <= _EVEN
        self._last = max(self._last, min(number, self._published))

    def check(self) -> bool:
        """Look for other publishers, and log them; returns whether this node must yield to one."""
        others = self._others()
        self._name_the_first(others)
        if not others:
            self.destroy()
            self.trouble, self.received_another = "", False
            return False
        topic, names = self._topic, named(others)
        self.received_another |= self._rivalled
        text = f"{names} {'publishes' if self.received_another else 'has a publisher of'} {topic}, too; {CURE}"
        if text != self.trouble and known(others):
            self.trouble = text
            if self.received_another:
                self._node.get_logger().error(text)
            else:
                self._node.get_logger().warning(text)
        if not self._node.active:
            return False
        self._listen()
        smaller = any(bytes(info.endpoint_gid) < self._own for info in others)
        yields = self.lost or self._older or (self._even and smaller)
        self._older = self._even = self._rivalled = False
        if yields:
            self.lost = self._yielded = True
            self._name_the_first(others)
        return yields

    def _name_the_first(self, others: list[TopicEndpointInfo]) -> None:
        """Log why this node has yielded, once, as soon as the names of the others are known or they have ended."""
        if self._yielded and known(others):
            names = named(others) or "a node that has ended"
            self._node.get_logger().error(f"deactivated: {names} publishes {self._topic} and was first; {CURE}")
            self._yielded = False


def troubles(sole: SoleTopic | None, sources: Sequence[SourceWatch]) -> tuple[bool, str]:
    """Whether another node publishes on a node's own topic, and who publishes its topics, too."""
    found = [*([sole.trouble] if sole else []), *(source.trouble for source in sources)]
    return bool(sole and sole.received_another), "; ".join(filter(None, found))


class SourceWatch:
    """Names the publishers of a topic that only one should publish, if there are several."""

    def __init__(self, node: ManagedNode, topic: str) -> None:
        """Args: node: the node; topic: its name."""
        self._node, self._topic = node, topic
        self.trouble = ""

    def check(self) -> None:
        """Log a change, once."""
        if self._node.count_publishers(self._topic) < 2:
            self.trouble = ""
            return
        infos = self._node.get_publishers_info_by_topic(self._topic)
        text = f"{self._topic} has {len(infos)} publishers, of {named(infos)}; {CURE}"
        if text != self.trouble and known(infos):
            self.trouble = text
            self._node.get_logger().warning(text)
