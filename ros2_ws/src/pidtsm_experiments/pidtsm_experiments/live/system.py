"""A running system as a page or a command sees it: its nodes' services, parameters, diagnostics and log, over ROS."""

import asyncio
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Log, ParameterEvent
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from pidtsm_core.arrays import Array
from pidtsm_core.control.findings import Finding, from_readings
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.lives import REPORTS_WITHIN, SAMPLES_WITHIN, Condition, Lives, Source, time_of_day
from pidtsm_experiments.live.messages import one_point
from pidtsm_experiments.live.parameters import Described, plain, read_parameters
from pidtsm_experiments.live.stream import Batch, StateStream, by_name
from pidtsm_experiments.live.words import Known
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.process import spin_for
from pidtsm_ros.qos import READER, RELIABLE_READER
from pidtsm_ros.serialization import ExactPublisher

_ANSWER_WITHIN = 5.0  # s
_SILENT_WITHIN = 2.0  # s; the same for a node that is silent already
_CONFIGURE_WITHIN = 120.0  # s; the first controller of an arm compiles
_THERE_WITHIN = 2.0  # s; discovery of a service that exists
_AGAIN = 1.0
"""s without an answer after which a request is repeated: a service is there before its answers find the way."""
_REPEATABLE = (ListParameters, DescribeParameters, GetParameters, SetParametersAtomically, GetState, SetBool)
"""Services that do the same when they are called twice."""
_POLL = 0.01  # s
_SPIN = 0.002  # s
_EVENTS = 8
PUSH_EVERY = 0.05
"""s between two messages of a push; each acts for 0.1 s."""
_ABOVE_INFO = 20
_HELD = "call ~/hold with false"
"""What the controller reports that holds the arm on request."""
NODE_NAME_UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""Stands for the name of a node whose topics are discovered before it is."""


class System:
    """The nodes of one namespace.

    Attributes:
        node: on the graph, spun by `spin`.
        events: what the nodes warned of, and what the page did, the newest first: time of day and text.
        lives: what is known of each node.
        source: where the joint states come from.
        found: what the controller states on /diagnostics to have found out about its arm.
        changed: the parameters that have changed since the page last looked: node and values of each change.
    """

    def __init__(self, namespace: str | None = None, name: str = "live") -> None:
        """Create two nodes named like `name`, after `rclpy.init`; no `namespace`: that of the command line."""
        # The listener is in no executor: its messages are taken in batches.
        self.node = Node(name, namespace=namespace)
        self._listener = Node(f"{name}_listener", namespace=namespace)
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)
        self.namespace = self.node.get_namespace()
        self.events: deque[tuple[str, str]] = deque(maxlen=_EVENTS)
        self.lives, self.source = Lives(), Source(self.namespace)
        self.lives.of("controller")
        self._reports: dict[str, str] = {}
        self._mode = -1
        self._held: bool | None = None
        self.found: tuple[Finding, ...] = ()
        self.changed: list[tuple[str, dict[str, Any]]] = []
        self._clients: dict[str, Client] = {}
        self._states = StateStream(self._listener)
        self._received = time.monotonic()
        self._joint_states: Subscription | None = None
        exact = ExactPublisher
        self._pushes = self.node.create_publisher(WrenchStamped, "simulator/push", 10, publisher_class=exact)
        self._trajectories = self.node.create_publisher(JointTrajectory, "joint_trajectory", 10, publisher_class=exact)
        listen = self.node.create_subscription
        listen(DiagnosticArray, "/diagnostics", self._on_diagnostics, RELIABLE_READER)
        listen(ParameterEvent, "/parameter_events", self._on_parameters, RELIABLE_READER)
        listen(Log, "/rosout", self._on_log, READER)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self._listener.destroy_node()
        self.node.destroy_node()

    def spin(self) -> None:
        """Handle what has arrived, for at most a few milliseconds."""
        spin_for(self._executor, _SPIN)

    def note(self, text: str) -> None:
        """Add an event."""
        self.events.appendleft((time.strftime("%H:%M:%S"), text))

    @property
    def simulated(self) -> bool:
        """Whether the arm is simulated, see `Source`."""
        return self.source.simulated

    def look(self) -> None:
        """See who is in the graph."""
        found = self.graph()
        here = {name for name, space in found if space == self.namespace}
        sources = self.node.get_publishers_info_by_topic("joint_states")
        named = [f"{i.node_namespace.rstrip('/')}/{i.node_name}" for i in sources if i.node_name != NODE_NAME_UNKNOWN]
        self.source.see("simulator" in here, named)
        for node in ("trajectory", "simulator"):
            if node in here:
                self.lives.of(node)
        if self.source.driver:
            self.lives.of(self.source.driver)
        self.lives.see(here | {f"{space.rstrip('/')}/{name}" for name, space in found})

    def require(self, node: str) -> None:
        """Refuse what needs a node that is known to be away.

        Raises:
            RefusedError: it is dead or silent.
        """
        if trouble := self.lives.trouble(node):
            raise RefusedError(trouble)

    def topic(self, name: str) -> str:
        """Full name of a topic."""
        return str(self.node.resolve_topic_name(name))

    def graph(self) -> list[tuple[str, str]]:
        """Name and namespace of every node of the domain."""
        return list(self.node.get_node_names_and_namespaces())

    def publishers(self, topic: str) -> int:
        """How many nodes publish a topic."""
        return int(self.node.count_publishers(topic))

    def has(self, node: str) -> bool:
        """Whether the namespace has a node of this name."""
        return (node, self.namespace) in self.graph()

    # Samples.

    @property
    def silence(self) -> float:
        """Time since the last state of the controller, s."""
        return time.monotonic() - self._received

    @property
    def since(self) -> str:
        """Time of day of the last state of the controller."""
        return time_of_day(self._received)

    def states(self) -> Batch | None:
        """The states of the controller since the last call."""
        batch = self._states.take()
        if batch is not None:
            self._received = time.monotonic()
            if batch.newest.mode != self._mode:
                self._mode, self._held = batch.newest.mode, None
            self._reports.pop("controller", None)  # It is active: what it reported before no longer holds.
            self.lives.note_message("controller", SAMPLES_WITHIN)
            self._note_source()  # Each state answers a joint state.
            self._ignore_joint_states()
        return batch

    def position(self, joints: Sequence[str]) -> Array | None:
        """Measured positions while the controller is silent, shape (joints,), rad or m; None: nothing has arrived."""
        if self._joint_states is None:
            self._joint_states = self._listener.create_subscription(
                JointState, "joint_states", lambda _message: None, READER
            )
        newest = None
        while (taken := self._joint_states.handle.take_message(JointState, False)) is not None:
            newest = taken[0]
        if newest is not None:
            self._note_source()
        found = None if newest is None else by_name(newest.name, newest.position, joints)
        return found if found is not None and np.isfinite(found).all() else None

    def _note_source(self) -> None:
        if self.source.node:
            self.lives.note_message(self.source.node, SAMPLES_WITHIN)

    def _ignore_joint_states(self) -> None:
        """The controller runs: publishing the joint states to one more reader would delay its commands."""
        if self._joint_states is not None:
            self._listener.destroy_subscription(self._joint_states)
            self._joint_states = None

    # Reports.

    def report(self, node: str) -> str:
        """What a node has reported on /diagnostics lately; empty: nothing."""
        return self._reports.get(node, "") if self.lives.condition(node) is Condition.ALIVE else ""

    @property
    def held(self) -> bool | None:
        """Whether the controller holds the arm on request; None: it has not reported since its mode has changed."""
        return self._held

    def known(self, newest: ControllerState | None, ended: str = "") -> Known:
        """What is known of the controller.

        Args:
            newest: its last state; None: none has arrived.
            ended: how its process has ended; empty: it runs, or is not known.
        """
        alive = self.lives.condition("controller") is Condition.ALIVE
        missing = self.lives.trouble(self.source.node)
        report = self.report("controller")
        return Known(newest, self.silence, self.since, report, alive, ended, missing, self._held)

    def _own(self, full_name: str) -> str | None:
        """The name of a node of the namespace; None: the node is another."""
        space, _, name = f"/{full_name.lstrip('/')}".rpartition("/")
        return name if (space or "/") == self.namespace else None

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if name := self._own(status.name.partition(":")[0]):
                self._reports[name] = status.message
                if name == "controller":
                    self._held = _HELD in status.message
                    self.found = from_readings((pair.key, pair.value) for pair in status.values)
                self.lives.note_message(name, REPORTS_WITHIN)

    def _on_log(self, message: Log) -> None:
        name = self._own(message.name.replace(".", "/"))
        if name and message.level > _ABOVE_INFO and name not in (self.node.get_name(), self._listener.get_name()):
            self.note(f"{name}: {message.msg}")

    def _on_parameters(self, message: ParameterEvent) -> None:
        if name := self._own(message.node):
            values = {p.name: plain(p.value) for p in message.changed_parameters}
            self.changed.append((name, values))

    # Services.

    async def call(self, kind: Any, name: str, request: Any, within: float = _ANSWER_WITHIN) -> Any:
        """Call a service of a node of the namespace.

        Raises:
            RefusedError: there is no such service, or no answer in time.
        """
        node = name.partition("/")[0]
        if self.lives.condition(node) is Condition.DEAD:
            self.require(node)
        within = min(within, _SILENT_WITHIN) if self.lives.trouble(node) else within
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client, end = self._clients[name], time.monotonic() + _THERE_WITHIN
        while not client.service_is_ready():
            if time.monotonic() > end:
                known = self.lives.trouble(node) or f"{node} does not run, or is not configured"
                raise RefusedError(f"no {name}: {known}")
            await asyncio.sleep(_POLL)
        futures, sent = [client.call_async(request)], time.monotonic()
        end = sent + within
        while not any(future.done() for future in futures):
            if time.monotonic() > end:
                for future in futures:
                    client.remove_pending_request(future)
                known = self.lives.trouble(node)
                raise RefusedError(f"{node} did not answer {name} within {within:g} s{known and f': {known}'}")
            if kind in _REPEATABLE and time.monotonic() > sent + _AGAIN:
                futures.append(client.call_async(request))
                sent = time.monotonic()
            await asyncio.sleep(_POLL)
        return next(future.result() for future in futures if future.done())

    async def trigger(self, service: str) -> None:
        """Call a service of type std_srvs/Trigger.

        Raises:
            RefusedError: the node refuses, or see `call`.
        """
        answer = await self.call(Trigger, service, Trigger.Request())
        if not answer.success:
            raise RefusedError(answer.message)

    async def switch(self, service: str, on: bool) -> None:
        """Call a service of type std_srvs/SetBool.

        Raises:
            RefusedError: the node refuses, or see `call`.
        """
        answer = await self.call(SetBool, service, SetBool.Request(data=on))
        if not answer.success:
            raise RefusedError(answer.message)

    async def described(self, node: str) -> list[Described]:
        """Every parameter of a node.

        Raises:
            RefusedError: see `call` and `read_parameters`.
        """
        return await read_parameters(self.call, node)

    async def set(self, node: str, values: Mapping[str, Any]) -> None:
        """Set parameters of a node together, or none of them.

        Raises:
            RefusedError: the node refuses one, or see `call`.
        """
        try:
            messages = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
            request = SetParametersAtomically.Request(parameters=messages)
        except (AssertionError, OverflowError, TypeError, ValueError) as error:
            raise RefusedError(f"{', '.join(values)}: not a value that ROS can send: {error}") from None
        answer = await self.call(SetParametersAtomically, f"{node}/set_parameters_atomically", request)
        if not answer.result.successful:
            raise RefusedError(answer.result.reason)

    async def activate(self, node: str) -> None:
        """Configure a node if it is not, and activate it.

        Raises:
            RefusedError: it cannot become active, or is active already, or see `call`.
        """
        state = (await self.call(GetState, f"{node}/get_state", GetState.Request())).current_state.id
        if state == State.PRIMARY_STATE_ACTIVE:
            lost = self.lives.trouble(self.source.node)
            raise RefusedError(f"{node} answers that it is active; nothing was changed{lost and f'. But {lost}'}")
        if state == State.PRIMARY_STATE_UNCONFIGURED:
            await self._change(node, Transition.TRANSITION_CONFIGURE, "configured")
        await self._change(node, Transition.TRANSITION_ACTIVATE, "activated")

    async def deactivate(self, node: str) -> None:
        """Deactivate a node.

        Raises:
            RefusedError: it is not active, or see `call`.
        """
        state = (await self.call(GetState, f"{node}/get_state", GetState.Request())).current_state.id
        if state != State.PRIMARY_STATE_ACTIVE:
            raise RefusedError(f"{node} is not active")
        await self._change(node, Transition.TRANSITION_DEACTIVATE, "deactivated")

    async def _change(self, node: str, transition: int, done: str) -> None:
        request = ChangeState.Request(transition=Transition(id=transition))
        answer = await self.call(ChangeState, f"{node}/change_state", request, _CONFIGURE_WITHIN)
        if not answer.success:
            raise RefusedError(f"{node} cannot be {done} now{self._reason(node)}")

    def _reason(self, node: str) -> str:
        """What the node reports, and what is known of the source of its joint states, as the end of a sentence."""
        report, lost = self.report(node), self.lives.trouble(self.source.node)
        return (f" ({report})" if report else "") + (f". {lost}" if lost else "")

    # Topics.

    async def push(self, force: Sequence[float], torque: Sequence[float], duration: float) -> None:
        """Push the tool of the simulated arm: force (N) and torque (N m) in the axes of the base, for `duration` s.

        Raises:
            RefusedError: the simulator is known to be away.
        """
        self.require("simulator")
        message = WrenchStamped()
        message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = force
        message.wrench.torque.x, message.wrench.torque.y, message.wrench.torque.z = torque
        end = time.monotonic() + duration
        while time.monotonic() < end:
            self._pushes.publish(message)
            await asyncio.sleep(PUSH_EVERY)

    def move(self, joints: Sequence[str], target: Sequence[float], duration: float) -> None:
        """Command a motion from the present reference to `target` (rad or m), at rest there after `duration` s.

        Raises:
            RefusedError: the trajectory node is known to be away.
        """
        self.require("trajectory")
        self._trajectories.publish(one_point(joints, target, duration))

    def rest(self) -> None:
        """Bring the reference to rest.

        Raises:
            RefusedError: the trajectory node is known to be away.
        """
        self.require("trajectory")
        self._trajectories.publish(JointTrajectory())
