"""Base of the nodes: a lifecycle node whose ROS parameters come from a schema of `pidtsm_core`."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy._rclpy_pybind11 import RCLError
from rclpy.action import ActionServer
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from std_srvs.srv import SetBool, Trigger

from pidtsm_core.experiment.node_parameters import PRIORITY
from pidtsm_core.messages.one_publisher import OnePublisher
from pidtsm_core.parameters import ParameterError, Schema, Value, as_float, resolve
from pidtsm_core.parameters.joints import MessageError
from pidtsm_ros.parameters import CheckedParameterService, declare
from pidtsm_ros.qos import LOCKSTEP_PUBLISHER, OVERRIDABLE, PUBLISHER, READER, RELIABLE_READER
from pidtsm_ros.serialization import ExactPublisher
from pidtsm_ros.sole_topic import SoleTopic, SourceWatch, troubles, with_number
from pidtsm_ros.stop import Stop
from pidtsm_ros.wire import deserialize

_REASONS_LOGGED = 100
_LONGEST_REASON = 200  # characters; a message can contain many long names


class ManagedNode(LifecycleNode):
    """A lifecycle node with checked parameters.

    Subclasses override `configure` (parameters, memory, compilation), `activate` and `deactivate` (the loop),
    `poll` (work that is due), `diagnose` and `parameters_changed`.

    Attributes:
        values: checked parameters by name.
        active: whether the lifecycle state is active.
        finished: a node sets this when its work is done; its process then ends.
        failed: set together with `finished` if the work failed.
        rejected: number of rejected messages.
        retry_activation: a node with automatic activation calls this when activation may have become possible.
    """

    def __init__(self, name: str, schema: Schema, joints: Callable[[Mapping[str, object]], int], stop: Stop) -> None:
        """Declare the parameters of `schema`.

        Args:
            name: name of the node.
            schema: returns all parameters of the node for given settings.
            joints: returns the number of joints for given settings.
            stop: ends the wait for a robot description.

        Raises:
            ParameterError: a parameter set at startup is unknown or has an invalid value.
            SystemExit: see `declare`.
        """
        super().__init__(name, start_parameter_services=False)
        self._schema = schema
        self._joint_count = joints
        self.finished = False
        self.failed = False
        self.active = False
        self.rejected = 0
        self.retry_activation: Callable[[], object] = lambda: None
        self._reasons: set[str] = set()
        self._awaited = True
        self._own_publishers: list[Publisher] = []
        self._own_subscriptions: list[Subscription] = []
        self._own_services: list[Service] = []
        self._own_actions: list[ActionServer] = []
        self._sole: SoleTopic | None = None
        self._sources: list[SourceWatch] = []
        self.values = declare(self, schema, joints, stop)
        self._parameter_services = CheckedParameterService(self)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._after_set_parameters)

    def check(self, settings: Mapping[str, Any]) -> dict[str, Value]:
        """All parameter values for these settings.

        Raises:
            ParameterError: a name is unknown or a value is invalid.
        """
        return resolve(self._schema, settings, self._joint_count(settings))

    def check_names(self, names: Iterable[str]) -> None:
        """Check that these are parameters of the node or of ROS.

        Raises:
            ParameterError: one is not; the first of them is reported.
        """
        for name in names:
            if not self.has_parameter(name):
                self.check({**self.values, name: None})

    # For subclasses.

    def refusal(self) -> str:
        """Why the node cannot become active now; empty if it can."""
        return ""

    def configure(self) -> None:
        """Create everything that the loop needs from `values`."""

    def activate(self) -> None:
        """Start the loop."""

    def deactivate(self) -> None:
        """Stop the loop."""

    def diagnose(self) -> None:
        """Publish on /diagnostics; also called before the node is deactivated."""

    def parameters_changed(self) -> None:
        """Apply changed `values` while configured."""

    def poll(self) -> float:
        """Do work that is due; returns the time until work is due again, s."""
        return 0.1

    @property
    def lockstep(self) -> bool:
        """Whether the loop waits for every sample, so that none may be lost."""
        return False

    @property
    def priority(self) -> int:
        """SCHED_FIFO priority of the loop; 0: normal scheduling, as in lockstep, where nothing can be late."""
        return 0 if self.lockstep else int(as_float(self.values[PRIORITY.name]))

    @property
    def outdone(self) -> bool:
        """Whether another node publishes what this one should: it must not become active by itself any more."""
        return self._sole is not None and self._sole.lost

    def rivalry(self) -> str:
        """Why the node cannot become active because of another that publishes the same; empty if it can."""
        return self._sole.refusal() if self._sole else ""

    def listen_again(self) -> None:
        """Disregard that no other node published so far: it could not, as this one cannot (or could not until now)."""
        if self._sole:
            self._sole.listen_again()

    def look_for_rivals(self) -> None:
        """Name other publishers of the node's topics; give way to one that was first."""
        for source in self._sources:
            source.check()
        if self._sole and self._sole.check():
            self.trigger_deactivate()

    @property
    def rivals(self) -> tuple[bool, str]:
        """Whether another node publishes on the topic of this one, and who publishes its topics, too."""
        return troubles(self._sole, self._sources)

    # Lifecycle.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        result = self._transition(self.configure)
        if result == TransitionCallbackReturn.SUCCESS:
            # The first log line takes 40 ms: write it here rather than when the loop starts.
            self.get_logger().info("configured")
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        if refusal := self.rivalry() or self.refusal():
            self.get_logger().error(f"not activated: {refusal}")
            return TransitionCallbackReturn.FAILURE
        result = self._transition(self.activate)
        self.active = result == TransitionCallbackReturn.SUCCESS
        if self.active:
            self.get_logger().info("active")
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.diagnose()
        self.active = False
        return self._transition(self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        if self._sole:
            self._sole.destroy()
        self._sole, self._sources = None, []
        for publisher in self._own_publishers:
            self.destroy_publisher(publisher)
        for subscription in self._own_subscriptions:
            self.destroy_subscription(subscription)
        for service in self._own_services:
            self.destroy_service(service)
        for action in self._own_actions:
            action.destroy()
        self._own_publishers.clear()
        self._awaited = True
        self._own_subscriptions.clear()
        self._own_services.clear()
        self._own_actions.clear()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        if self.active:
            self.on_deactivate(state)
        return self.on_cleanup(state)

    def _LifecycleNodeMixin__on_change_state(  # noqa: N802  The name of rclpy's private method.
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        """Refuse a transition that the present state does not have; in rclpy, the request ends the executor."""
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)
        except RCLError:
            response.success = False
            return response

    def _transition(self, work: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            work()
        except Exception as error:
            # rclpy swallows exceptions of transitions.
            self.get_logger().error(f"{work.__name__} failed: {error}")
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    # Topics.

    def advertise(self, message_type: type, topic: str, profile: QoSProfile | None = None) -> Publisher:
        """Create a publisher that exists until the node is cleaned up; `profile` replaces the default for streams."""
        qos = copy(profile or (LOCKSTEP_PUBLISHER if self.lockstep else PUBLISHER))  # Overrides modify the profile.
        publisher = self.create_publisher(
            message_type, topic, qos, qos_overriding_options=OVERRIDABLE, publisher_class=ExactPublisher
        )
        self._own_publishers.append(publisher)
        return publisher

    def advertise_alone(self, message_type: type, topic: str) -> SoleTopic:
        """The same for the topic that no other node should publish; a node has one at most."""
        self._sole = SoleTopic(self, topic, lambda: self.advertise(message_type, topic))
        return self._sole

    def watch_publishers(self, topic: str) -> None:
        """Name the publishers of a topic if there are several."""
        self._sources.append(SourceWatch(self, self.resolve_topic_name(topic)))

    def awaits(self, publisher: Publisher) -> bool:
        """Whether the first message must wait: there have never been `start.subscribers` subscribers at the same time.

        A publisher counts a reader from the moment it keeps samples for that reader.
        """
        if self._awaited:
            listening = bool(self._sole and self._sole.listens)
            self._awaited = publisher.get_subscription_count() - listening < as_float(self.values["start.subscribers"])
        return self._awaited

    def listen(
        self,
        message_type: type,
        topic: str,
        callback: Callable[[Any], None],
        raw: bool = False,
        while_inactive: bool = False,
        profile: QoSProfile | None = None,
        depth: int | None = None,
        one_publisher: bool = False,
    ) -> Subscription:
        """Create a subscription that exists until the node is cleaned up.

        It counts and logs messages that `callback` rejects with MessageError. All messages arrive serialized, because
        a message that rclpy cannot deserialize would end the executor.

        Args:
            message_type: type of the messages.
            topic: name of the topic.
            callback: called with each message.
            raw: pass the serialized message to the callback.
            while_inactive: also call it for messages that arrive while the node is inactive.
            profile: replaces the default for streams. `RELIABLE_READER`: lose no message in realtime either, for topics
                with less than one message per sample; `KEPT`: receive the last one from before, too.
            depth: maximum number of waiting messages; None: the same as for other topics.
            one_publisher: reject messages of a second, see `OnePublisher`.
        """
        one = OnePublisher() if one_publisher else None

        def read(data: bytes, number: int | None = None) -> None:
            if not (self.active or while_inactive):
                return
            now = time.monotonic_ns()
            try:
                if one and number is not None and not one.accepts(number, now, alone):
                    raise MessageError("another node publishes this, too")
                callback(data if raw else deserialize(data, message_type))
            except MessageError as error:
                self.reject(f"{topic}: {error}")
                return
            if one and number is not None:
                one.take(number, now)

        def alone() -> bool:
            return bool(subscription.get_publisher_count() < 2)

        qos = copy(profile or (RELIABLE_READER if self.lockstep else READER))
        qos.depth = depth or qos.depth
        subscription = self.create_subscription(
            message_type,
            topic,
            with_number(read) if one_publisher else read,
            qos,
            raw=True,
            qos_overriding_options=OVERRIDABLE,
        )
        self._own_subscriptions.append(subscription)
        if one_publisher:
            self.watch_publishers(topic)
        return subscription

    def offer(self, service: str, work: Callable[[], str]) -> None:
        """Create a std_srvs/Trigger service that exists until the node is cleaned up.

        `work` returns the reason if it refuses, else an empty text.
        """

        def respond(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.message = work()
            response.success = not response.message
            return response

        self._own_services.append(self.create_service(Trigger, service, respond))

    def offer_switch(self, service: str, work: Callable[[bool], str]) -> None:
        """Create a std_srvs/SetBool service, as `offer` does; `work` also receives the wanted value."""

        def respond(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            response.message = work(request.data)
            response.success = not response.message
            return response

        self._own_services.append(self.create_service(SetBool, service, respond))

    def own(self, action: ActionServer) -> None:
        """Destroy an action when the node is cleaned up."""
        self._own_actions.append(action)

    def reject(self, reason: str) -> None:
        """Count a rejected message; each reason is logged once."""
        self.rejected += 1
        if len(reason) > _LONGEST_REASON:
            reason = f"{reason[:_LONGEST_REASON]} ..."
        if reason not in self._reasons and len(self._reasons) < _REASONS_LOGGED:
            self._reasons.add(reason)
            self.get_logger().error(f"rejected {reason}")

    def flush(self, until: float) -> None:
        """Wait until every reader has received everything, but not longer than `until` (s, monotonic clock).

        Readers acknowledge within 0.1 s (see fastdds.xml) unless they lag behind, are suspended or were killed.
        """
        for publisher in self._own_publishers:
            if not publisher.wait_for_all_acked(Duration(seconds=max(until - time.monotonic(), 0.0))):
                self.get_logger().warning(f"a reader of {publisher.topic_name} has not received every message")
                break

    # Parameters while the node runs.

    def _settings(self, changes: Sequence[RosParameter]) -> dict[str, Any]:
        return {**self.values, **{p.name: p.value for p in changes if p.name in self.values}}

    def _own(self, changes: Sequence[RosParameter]) -> bool:
        """Whether any of them belongs to the schema; rclpy declares parameters for quality of service."""
        return any(p.name in self.values for p in changes)

    def _on_set_parameters(self, changes: Sequence[RosParameter]) -> SetParametersResult:
        if not self._own(changes):
            return SetParametersResult(successful=True)
        try:
            self.check(self._settings(changes))
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _after_set_parameters(self, changes: Sequence[RosParameter]) -> None:
        if not self._own(changes):
            return
        self.values = self.check(self._settings(changes))
        self.parameters_changed()
