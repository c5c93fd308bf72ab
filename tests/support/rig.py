"""Rigs: a real node on the testbed, and the test in the place of everything around it, its time included."""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import simulator_node_schema
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.qos import RECORDER
from pidtsm_ros.stamps import nanoseconds, set_stamp
from support.testarms import TWO_LINK, UNLIMITED, Arm
from support.testbed import Testbed, open_testbed

DAMPING = 20.0
"""Of the safe torque, N m s/rad."""
MS = 1_000_000
SECOND = 1000 * MS
"""ns."""

_UNDISTURBED = 100  # ticks


def gravity(position: Sequence[float] | Array, arm: Arm = TWO_LINK) -> Array:
    """Torque that carries the arm at rest, N m, shape (joints,)."""
    return arm.effort(np.array(position))


def safe_effort(state: ControllerState, arm: Arm = TWO_LINK) -> Array:
    """The torque of a controller that has stopped, N m, shape (joints,)."""
    return np.clip(gravity(state.position, arm) - DAMPING * np.array(state.velocity), -arm.limits, arm.limits)


def document_rows(page: Path, section: str) -> list[str]:
    """The first column of the table in a section of a page."""
    text = page.read_text(encoding="utf-8").partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    rows = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("|")]
    return rows[2:]


STALL = 0.005  # s; from there on torques step because samples came late
Judged = str | None
"""Why a row could not be judged, with its figures."""


def judge(states: list[ControllerState], check: Callable[[list[ControllerState]], None]) -> Judged:
    """Check torques and errors of these states; where they are wrong and the machine stood still, nothing follows.

    It stood still where samples are missing, or one was answered late all of a sudden. What waits when a controller
    begins is answered late, but ever less.
    """
    gap = np.diff([nanoseconds(state.header.stamp) for state in states]).max() / SECOND
    delay = np.diff([state.state_age for state in states]).max()
    try:
        check(states)
    except AssertionError:
        if max(gap, delay) <= STALL:
            raise
        step = np.abs(np.diff([state.effort for state in states], axis=0)).max()
        error = np.abs([state.position_error for state in states]).max()
        return (
            f"the machine stood still: {gap * 1e3:.0f} ms between samples, {delay * 1e3:.0f} ms late; torque steps up "
            f"to {step:.1f} N m, errors up to {error:.3f} rad"
        )
    return None


class Watch:
    """Keeps every message of some topics, and finds what must never be in one."""

    def __init__(self, node: Node, topics: Mapping[str, type], arm: Arm = TWO_LINK) -> None:
        """Listen; messages are heard as the node's executor spins, and where it has none, when they are taken.

        A node learns of the subscriptions in the order of the topics: that of its first message (`start.subscribers`)
        comes last, so that nothing is missed.
        """
        self._types, self._arm = dict(topics), arm
        self.heard: dict[str, list[bytes]] = {topic: [] for topic in topics}
        self._subscriptions = {
            topic: node.create_subscription(
                kind,
                topic,
                self.heard[topic].append,
                QoSProfile(depth=10) if topic == "/diagnostics" else RECORDER,
                raw=True,
            )
            for topic, kind in topics.items()
        }

    def take(self) -> None:
        """Take all that has come, at a fraction of what an executor costs: a test must not keep the nodes waiting."""
        for topic, subscription in self._subscriptions.items():
            while (taken := subscription.handle.take_message(self._types[topic], True)) is not None:
                self.heard[topic].append(taken[0])

    def last(self, topic: str) -> Any:
        return deserialize_message(self.heard[topic][-1], self._types[topic])

    def messages(self, topic: str, since: int = 0) -> list[Any]:
        """Those from a place in `heard` on."""
        return [deserialize_message(data, self._types[topic]) for data in self.heard[topic][since:]]

    def check(self) -> None:
        """No torque beyond a limit, and nothing that is not finite, in any message so far, which are then forgotten."""
        for topic, heard in self.heard.items():
            assert heard, f"nothing came on {topic}"
            for message in self.messages(topic):
                assert all(map(math.isfinite, _numbers(message))), f"not finite: {message}"
                if getattr(message, "effort", ()):
                    assert list(message.name) == self._arm.names
                    assert (np.abs(message.effort) <= self._arm.limits).all(), f"beyond a limit: {message}"
            heard.clear()


def _numbers(message: Any) -> Iterator[float]:
    if isinstance(message, DiagnosticArray):
        for status in message.status:
            yield from (float(pair.value) for pair in status.values)
        return
    for field, kind in message.get_fields_and_field_types().items():
        if kind == "double":
            yield getattr(message, field)
        elif kind == "sequence<double>":
            yield from getattr(message, field)


class Rig:
    """A node on the testbed for many tests in turn.

    Attributes:
        arm: the arm of the node.
        watch: what the node publishes.
        sound: no test has failed on it.
        rejected: number of messages that the node should have rejected so far.
    """

    node: str

    def __init__(self, testbed: Testbed, arm: Arm, topics: Mapping[str, type], *parameters: str) -> None:
        self.testbed, self.arm = testbed, arm
        self.sound = True
        self.rejected = 0
        self.watch = Watch(testbed.node, {**topics, "/diagnostics": DiagnosticArray}, arm)
        self.process = testbed.start(self.node, f"robot.description:={arm.description}", *parameters)
        self._said = 0

    def step(self) -> Any:
        """One sample in which nothing is wrong."""
        raise NotImplementedError

    @contextmanager
    def row(self) -> Iterator[None]:
        """A row of a table: the node lives, and has published nothing that it must not."""
        self.sound = False
        yield
        assert self.process.process.poll() is None, self.process.tail()
        self.watch.check()
        self.sound = True

    def says(self) -> list[str]:
        """What the node's log got since the last call."""
        text = self.process.log.read_text()
        new, self._said = text[self._said :], len(text)
        assert "Traceback" not in new, new
        return [line.partition(f"[{self.node}]: ")[2] for line in new.splitlines()]

    def check_log(self, expected: Sequence[str]) -> None:
        """The log got lines that begin like these, each once, and no other, since the last look."""
        said = self.says()
        assert len(said) == len(expected), said
        for line, begin in zip(said, expected, strict=True):
            assert line.startswith(begin)

    def reports(self) -> DiagnosticStatus:
        """What the node says of itself on /diagnostics, in a second that ends after now, while samples go on."""
        now, heard = time.time_ns(), self.watch.heard["/diagnostics"]
        while not heard or nanoseconds(self.watch.last("/diagnostics").header.stamp) < now:
            self.step()
        return self.watch.last("/diagnostics").status[0]


class ControllerRig(Rig):
    """A controller, and the test as its arm, its reference and its clock.

    Attributes:
        stamp: of the last joint state, ns.
        referred: joint states come with a reference of the same stamp.
        late: number of joint states that were late so far.
    """

    node = "controller"
    # An arm that may jump, and a safe torque that can be told.
    settings = (
        "plausibility.velocity:=0.0",
        "stop.effort:=gravity_damping",
        *(f"{name}:={value}" for name, value in UNLIMITED.items()),
    )

    def __init__(self, testbed: Testbed, *parameters: str, arm: Arm = TWO_LINK) -> None:
        self.start = arm.start
        # Every message counts, also where the controller, by its parameters, runs in realtime.
        asked_for = [f"qos_overrides./{t}.subscription.reliability:=reliable" for t in ("joint_states", "reference")]
        topics = {"controller/state": ControllerState, "joint_commands": JointState}
        super().__init__(testbed, arm, topics, *self.settings, *parameters, *asked_for)
        self.joint_states = testbed.node.create_publisher(JointState, "joint_states", 10)
        self.references = testbed.node.create_publisher(JointReference, "reference", 10)
        testbed.spin_until(
            lambda: self.joint_states.get_subscription_count() and self.references.get_subscription_count(),
            "the controller",
        )
        self.stamp = 1_000_000 * SECOND
        self.tick = 0
        self.referred = True
        self.late = 0

    @cached_property
    def undisturbed(self) -> Array:
        """Torques at the first ticks after `begin`, where nothing goes wrong, shape (ticks, joints), N m."""
        self.begin()
        efforts = self.drive(_UNDISTURBED)
        assert (np.abs(efforts) < self.arm.limits).all()
        return efforts

    def joint_state(self, position: Sequence[float], names: Sequence[str] | None = None, dt: int = MS) -> JointState:
        """A joint state dt (ns) after the last."""
        message = JointState(name=self.arm.names if names is None else list(names), position=list(position))
        set_stamp(message.header.stamp, self.stamp + dt)
        return message

    def reference(
        self, position: Sequence[float] = (), names: Sequence[str] | None = None, dt: int = MS
    ) -> JointReference:
        """A reference for a joint state dt (ns) after the last; by default to the start."""
        position = position or self.start
        rest, named = [0.0] * len(position), self.arm.names if names is None else list(names)
        message = JointReference(name=named, position=list(position), velocity=rest, acceleration=rest)
        set_stamp(message.header.stamp, self.stamp + dt)
        return message

    def measured(self) -> list[float]:
        """Where the arm is at this tick: it swings, gently, beside its reference."""
        return [q + 0.005 * (1.0 - math.cos(0.02 * self.tick)) for q in self.start]

    def step(self, position: Sequence[float] = (), dt: int = MS, desired: Sequence[float] = ()) -> ControllerState:
        """A joint state dt (ns) after the last, and what the controller makes of it."""
        message = self.joint_state(position or self.measured(), dt=dt)
        if self.referred:
            self.references.publish(self.reference(desired, dt=dt))
        self.joint_states.publish(message)
        self.stamp += dt
        self.tick += 1
        heard = [self.watch.heard[topic] for topic in ("joint_commands", "controller/state")]

        def answered() -> bool:
            return all(h and serialized_nanoseconds(h[-1]) == self.stamp for h in heard)

        self.testbed.spin_until(answered, f"an answer to {self.stamp}")
        return self.watch.last("controller/state")

    def drive(self, ticks: int) -> Array:
        """The torques of so many ticks."""
        return np.array([self.step().effort for _ in range(ticks)])

    def follow(self, *position: float) -> ControllerState:
        """Go on until the reference is followed."""
        for _ in range(100):
            state = self.step(position)
            if state.mode == ControllerState.FOLLOWING:
                return state
        pytest.fail("the reference is not followed")

    def begin(self) -> None:
        """The controller forgets what was: a fault is caused, and reset."""
        self.testbed.set("controller", {"limits.min_position": -1e-3, "limits.max_position": 1e-3})
        self.step()
        self.testbed.set("controller", {"limits.min_position": 0.0, "limits.max_position": 0.0})
        assert self.reset().success

    def reset(self) -> Trigger.Response:
        """Call ~/reset_fault."""
        self.tick = 0
        return self.testbed.call(Trigger, "controller/reset_fault", Trigger.Request())


class SimulatorRig(Rig):
    """A simulator in lockstep, and the test as its controller; `twin` is the arm as it should move."""

    node = "simulator"

    def __init__(self, testbed: Testbed, arm: Arm = TWO_LINK) -> None:
        topics = {"simulator/ground_truth": JointState, "joint_states": JointState}
        super().__init__(testbed, arm, topics, "clock:=lockstep", "start.subscribers:=1", "lockstep.timeout:=60.0")
        self.commands = testbed.node.create_publisher(JointState, "joint_commands", 10)
        self.twin = SimulatedRobot(arm.values(simulator_node_schema, {}))
        self.effort = (arm.alternating(0.3) * arm.limits).tolist()
        self.sample = 0
        self._wait()

    def command(
        self, effort: Sequence[float] = (), names: Sequence[str] | None = None, sample: int | None = None
    ) -> JointState:
        """A command that answers this sample; by default the last."""
        named = self.arm.names if names is None else list(names)
        message = JointState(name=named, effort=list(effort or self.effort))
        set_stamp(message.header.stamp, (self.sample if sample is None else sample) * MS)
        return message

    def _wait(self) -> None:
        heard = self.watch.heard["joint_states"]
        self.testbed.spin_until(
            lambda: heard and serialized_nanoseconds(heard[-1]) == self.sample * MS, f"sample {self.sample}"
        )
        _, expected = self.twin.sense(self.sample)
        assert list(self.watch.last("joint_states").position) == list(expected)

    def step(self, effort: Sequence[float] = (), names: Sequence[str] | None = None) -> None:
        """Answer the last joint state; the arm moves as its twin does."""
        command = self.command(effort, names)
        self.commands.publish(command)
        by_name = dict(zip(command.name, command.effort, strict=True))
        self.twin.act(self.sample, True, np.array([by_name[name] for name in self.arm.names]))
        self.sample += 1
        self._wait()


class Rigs:
    """One rig of each kind for many tests, replaced when a test has failed on it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rigs: dict[Any, tuple[Rig, ExitStack]] = {}
        self._made = 0

    def get(self, kind: Any, settings: Mapping[str, Any] | None = None, **others: Any) -> Any:
        """A rig of this class, its node started with these parameters; `others`: further arguments of the class."""
        parameters = tuple(f"{name}:={value}" for name, value in (settings or {}).items())
        key = (kind, parameters, *others.items())
        rig, stack = self._rigs.get(key, (None, ExitStack()))
        if rig is None or not rig.sound:
            stack.close()
            folder = self._folder / str(self._made)
            folder.mkdir()
            self._made += 1
            rig = kind(stack.enter_context(open_testbed(folder)), *parameters, **others)
            self._rigs[key] = rig, stack
        return rig

    def close(self) -> None:
        for _, stack in self._rigs.values():
            stack.close()
