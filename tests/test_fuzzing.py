"""A running loop takes whatever is sent to it: nothing breaks, nothing absurd comes out, and it tracks afterwards."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from random import Random
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from support.testbed import DEADLINE, Testbed
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_core.experiment import PRACTICAL_FILE
from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS
from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.stamps import nanoseconds

ATTEMPTS = 3
"""How often a loop is begun again that the machine may have stopped."""
MESSAGES = 1_400
"""Of each kind."""
VARIANTS = 10
"""Messages that differ in their stamps and in the damage they take."""
BATCH = 200
"""Messages that are sent before somebody looks whether they were taken."""
QUEUE = 1000
"""Messages that a reader keeps, so that none is dropped."""
PRACTICAL = load_ros_parameters(PRACTICAL_FILE)
"""With the article's own, what a stranger brings about stays in the adaptive gain."""
LIMITS = (100.0, 50.0)
NODES = ("simulator", "controller", "trajectory")
STRIKING = (math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, 1.8e308, -1e300, 999_999.0, 1e6, 1e-9)


def fuzzed(examples: int) -> settings:
    return settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )


# Messages: stamps in ns after the newest joint state, or as sec and nanosec.

names = st.sampled_from(
    [["joint1", "joint2"]] * 8
    + [["joint2", "joint1"]] * 3
    + [[], ["joint1"], ["joint1", "joint1"], ["joint1", "elbow"], ["joint1", "joint2", "joint3"], ["j\n\x00ö%s", ""]]
    + [[f"joint{i}" for i in range(1, 300)], ["x" * 10_000, "joint1"]]
)
numbers = st.floats(-3.0, 3.0) | st.sampled_from(STRIKING) | st.floats()
arrays = (
    st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
    | st.tuples(numbers, numbers)
    | st.lists(numbers, max_size=4)
    | st.lists(numbers, max_size=4)
    | st.sampled_from([()] * 5 + [(0.0,) * 10_000, (math.nan,) * 1000])
)
STAMPS = (0, 0, 0, 1, -1, 10**6, -4 * 10**6, 5 * 10**8, -5 * 10**8, 3 * 10**9, -3 * 10**9)
PAIRS = [(sec, ns) for sec in (0, 1, -1, 2**31 - 1, -(2**31)) for ns in (0, 1, 999_999_999, 10**9, 2**32 - 1)]
durations = st.sampled_from([0, 1, 10**9, -(10**9), 4 * 10**18]) | st.integers(0, 3 * 10**9)


def joint_state(name: list[str], values: Any, others: Any) -> Any:
    return JointState(name=name, position=values, velocity=others)


def joint_command(name: list[str], values: Any, others: Any) -> Any:
    return JointState(name=name, effort=values, position=others)


def reference(name: list[str], position: Any, velocity: Any, acceleration: Any, effort: Any) -> Any:
    return JointReference(name=name, position=position, velocity=velocity, acceleration=acceleration, effort=effort)


def trajectory(name: list[str], points: Any) -> Any:
    message = JointTrajectory(joint_names=name)
    for time, *fields in points:
        point = JointTrajectoryPoint(**dict(zip(("positions", "velocities", "accelerations"), fields, strict=False)))
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(min(time, 2**61), 10**9)
        message.points.append(point)
    return message


def torques(values: Any) -> Any:
    return Float64MultiArray(data=values)


def stamp(message: Any, now: int, random: Random) -> None:
    """Give it the time of the newest joint state, one near it, or one that nobody can use."""
    pair = random.choice([*PAIRS, *[divmod(now + random.choice(STAMPS), 10**9)] * len(PAIRS)])
    message.header.stamp.sec, message.header.stamp.nanosec = pair


def damaged(data: bytes, random: Random) -> bytes:
    """The message, cut somewhere, or with some bytes changed, or as it was."""
    match random.randrange(5):
        case 0:
            # Fast DDS never delivers a message of no bytes, nor what the same publisher sends after it.
            return data[: random.randrange(1, min(len(data), 300))]
        case 1:
            changed = bytearray(data)
            for _ in range(random.randint(1, 3)):
                changed[random.randrange(min(len(data), 300))] ^= random.randint(1, 255)
            return bytes(changed)
    return data


points = st.lists(
    st.tuples(durations, arrays)
    | st.tuples(durations, arrays, arrays)
    | st.tuples(durations, arrays, st.just((0.0, 0.0)), st.just((0.0, 0.0))),
    max_size=3,
)
Kind = tuple[str, type, Callable[..., Any], st.SearchStrategy[Any], Sequence[str]]
STAMPED: list[Kind] = [
    ("joint_states", JointState, joint_state, st.tuples(names, arrays, arrays), ("controller", "trajectory")),
    ("reference", JointReference, reference, st.tuples(names, arrays, arrays, arrays, arrays), ("controller",)),
    ("joint_trajectory", JointTrajectory, trajectory, st.tuples(names, points), ("trajectory",)),
    ("joint_commands", JointState, joint_command, st.tuples(names, arrays, arrays), ("simulator",)),
]
KINDS: dict[str, list[Kind]] = {
    "joint_state": STAMPED,
    "float64_multi_array": [
        ("effort_controller/commands", Float64MultiArray, torques, st.tuples(arrays), ("simulator",))
    ],
}


class Loop:
    """Simulator, controller and trajectory in realtime, and a node that sends them things and judges their answers."""

    def __init__(self, testbed: Testbed, form: str) -> None:
        self.testbed = testbed
        self.sent: set[int] = set()
        self.now = 0
        self.states: list[ControllerState] = []
        self.references: dict[int, Any] = {}
        self.errors: deque[float] = deque(maxlen=50)
        self.absurd: list[str] = []
        node = testbed.node
        parameters = {
            # A busy machine is no fault.
            "simulator": ["rate:=250", "realtime.priority:=0", "command.timeout:=1.0", f"input.type:={form}"],
            "controller": [
                "watchdog.state_stop:=5.0",
                "watchdog.reference:=1.0",
                "realtime.priority:=0",
                f"output.type:={form}",
            ],
            "trajectory": [],
        }
        for topic, *_, readers in KINDS[form]:
            for name in readers:
                override = f"qos_overrides./{topic}.subscription"
                parameters[name] += [f"{override}.depth:={QUEUE}", f"{override}.reliability:=reliable"]
        for name, values in PRACTICAL.items():
            parameters[name] += [f"{key}:={value}" for key, value in values.items()]
        self.processes = {name: testbed.start(name, *parameters[name]) for name in NODES}
        listened = {
            "joint_states": (JointState, self._on_joint_state),
            "joint_commands": (JointState, lambda message: self._check_efforts(message.effort)),
            "effort_controller/commands": (Float64MultiArray, lambda message: self._check_efforts(message.data)),
            "reference": (JointReference, self._on_reference),
            "controller/state": (ControllerState, self._on_state),
            "simulator/ground_truth": (JointState, self._on_truth),
            "/diagnostics": (DiagnosticArray, self._on_diagnostics),
        }
        self.heard = set(listened)
        for topic, (message_type, callback) in listened.items():
            node.create_subscription(message_type, topic, self._judge(topic, message_type, callback), 1000, raw=True)
        self.asking = {name: node.create_client(GetState, f"{name}/get_state") for name in NODES}
        testbed.spin_until(lambda: all(c.service_is_ready() for c in self.asking.values()), "the nodes")

    # What they publish.

    def _judge(self, topic: str, message_type: type, callback: Callable[[Any], None]) -> Callable[[bytes], None]:
        def on_message(data: bytes) -> None:
            if hash(data) in self.sent:
                return
            message = deserialize_message(data, message_type)
            for name, kind in message.get_fields_and_field_types().items():
                if kind in ("sequence<double>", "double") and not np.isfinite(getattr(message, name)).all():
                    self.absurd.append(f"{topic}: {name} is {getattr(message, name)}")
            callback(message)

        return on_message

    def _on_joint_state(self, message: JointState) -> None:
        self.now = nanoseconds(message.header.stamp)

    def _check_efforts(self, efforts: Sequence[float]) -> None:
        if any(abs(effort) > limit for effort, limit in zip(efforts, LIMITS, strict=True)):
            self.absurd.append(f"a torque of {efforts}")

    def _on_state(self, message: ControllerState) -> None:
        self._check_efforts(message.effort)
        self.states = [message]

    def _on_reference(self, message: JointReference) -> None:
        self.references[nanoseconds(message.header.stamp)] = message.position

    def _on_truth(self, message: JointState) -> None:
        self._check_efforts(message.effort)
        wanted = self.references.pop(nanoseconds(message.header.stamp), None)
        if wanted is not None:
            self.errors.append(np.abs(np.subtract(message.position, wanted)).max())

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        values = [f"{v.key}: {v.value}" for status in message.status for v in status.values]
        self.absurd += [value for value in values if "nan" in value or "inf" in value]

    # What is sent.

    def _sync(self, publisher: Any, nodes: Sequence[str]) -> None:
        """Until these nodes have taken what was sent before: it has arrived, and they do one thing after the other."""
        assert publisher.wait_for_all_acked(Duration(seconds=DEADLINE)), f"{publisher.topic} does not arrive"
        self._answer(nodes)

    def _answer(self, nodes: Sequence[str]) -> None:
        futures = [self.asking[name].call_async(GetState.Request()) for name in nodes]
        self.testbed.spin_until(lambda: all(future.done() for future in futures), f"{', '.join(nodes)} answer")

    def fuzz(self, kind: Kind) -> None:
        """Send it."""
        topic, message_type, make, parts, readers = kind
        publisher = self.testbed.node.create_publisher(message_type, topic, QUEUE)
        wanted = len(readers) + (topic in self.heard)
        self.testbed.spin_until(lambda: publisher.get_subscription_count() == wanted, f"readers of {topic}")
        count = 0

        @fuzzed(MESSAGES // VARIANTS)
        @given(parts, st.integers(0, 2**32))
        def send(parts: Any, seed: int) -> None:
            nonlocal count
            message, random = make(*parts), Random(seed)
            for _ in range(VARIANTS):
                if hasattr(message, "header"):
                    stamp(message, self.now, random)
                data = damaged(serialize_message(message), random)
                self.sent.add(hash(data))
                publisher.publish(data)
                count += 1
            if count % BATCH == 0:
                self._sync(publisher, readers)
                assert not self.absurd, self.absurd

        send()
        assert count == MESSAGES
        self._sync(publisher, readers)
        self.testbed.node.destroy_publisher(publisher)

    # What follows.

    def tracks(self) -> bool:
        """The arm is where the reference is, and the controller reports it."""
        following = self.states and self.states[-1].mode == ControllerState.FOLLOWING
        return bool(following and len(self.errors) == self.errors.maxlen and max(self.errors) < 0.01)

    def stopped(self) -> bool:
        """The controller has a fault: also a machine that stands still for a while is one."""
        return bool(self.states and self.states[-1].fault)

    def recover(self) -> None:
        """What a user does where a stranger has moved things, or the machine has stopped the arm: begin again."""
        for _ in range(ATTEMPTS):
            self._begin_again()
            self.testbed.spin_until(lambda: self.tracks() or self.stopped(), "a loop that tracks")
            if self.tracks():
                return
        assert self.tracks()

    def _begin_again(self) -> None:
        """With the arm at its start."""
        for name in ("controller", "trajectory"):
            # One that heard the stranger on its own topic has yielded, and is inactive.
            self._change(name, Transition.TRANSITION_DEACTIVATE)
        assert self.testbed.call(Trigger, "simulator/reset", Trigger.Request()).success
        # To a controller that became active with a joint state of before, the arm would jump.
        before = self.now
        self.testbed.spin_until(lambda: self.now > before + 20_000_000, "joint states of the arm at its start")
        self._answer(["controller"])
        for name in ("trajectory", "controller"):
            # The controller wants to have heard of the arm and of a reference near it.
            self.testbed.spin_until(partial(self._change, name, Transition.TRANSITION_ACTIVATE), f"active {name}")
        self.errors.clear()
        self.states.clear()

    def end(self) -> None:
        """The nodes are all there, and end on request."""
        assert not self.absurd, self.absurd
        for process in self.processes.values():
            assert process.process.poll() is None
            process.interrupt()
        for process in self.processes.values():
            assert process.wait() == 0
            assert "Traceback" not in process.log.read_text()

    def _change(self, name: str, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self.testbed.call(ChangeState, f"{name}/change_state", request).success)


@pytest.mark.parametrize("form", KINDS)
def test_any_message_leaves_the_loop_running(testbed: Testbed, form: str) -> None:
    loop = Loop(testbed, form)
    testbed.spin_until(loop.tracks, "a loop that tracks")
    for kind in KINDS[form]:
        loop.fuzz(kind)
        loop.recover()
    loop.end()


# Parameters.

WORDS = ("article", "piddtsm", "conditional", "none", "stop", "warn", "gravity", "", "x" * 1000, "ö\n")
WHOLE = (0, 1, 2, -1, 1000, 2**63 - 1, -(2**63))
values = st.one_of(
    st.floats(0.0, 5.0).map(lambda v: ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=v)),
    numbers.map(lambda v: ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=v)),
    arrays.map(lambda v: ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=v)),
    st.sampled_from(WHOLE).map(lambda v: ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=v)),
    st.lists(st.sampled_from(WHOLE), max_size=3).map(
        lambda v: ParameterValue(type=ParameterType.PARAMETER_INTEGER_ARRAY, integer_array_value=v)
    ),
    st.sampled_from(WORDS).map(lambda v: ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=v)),
    st.lists(st.sampled_from(WORDS), max_size=3).map(
        lambda v: ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=v)
    ),
    st.booleans().map(lambda v: ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=v)),
    st.just(ParameterValue(type=ParameterType.PARAMETER_BYTE_ARRAY, byte_array_value=[b"a"])),
    st.just(ParameterValue(type=ParameterType.PARAMETER_NOT_SET)),
    st.just(ParameterValue(type=200)),
)
SETS = {"controller": 260, "simulator": 260, "trajectory": 40}
"""Number of sets of each node. Hypothesis generates others if other modules are loaded, so that it takes many."""


def fuzz_parameters(testbed: Testbed, name: str) -> None:
    """Set those of a node, see that each set is taken whole or refused whole, and set them back."""
    own = [p.name for p in NODE_SCHEMAS[name](PRACTICAL.get(name, {}))]
    topics = {SetParametersAtomically: "set_parameters_atomically", GetParameters: "get_parameters"}

    def call(kind: Any, **request: Any) -> Any:
        return testbed.call(kind, f"{name}/{topics[kind]}", kind.Request(**request))

    def get() -> dict[str, Any]:
        return dict(zip(own, call(GetParameters, names=own).values, strict=True))

    before = start = get()
    taken = 0

    @fuzzed(SETS[name])
    @given(st.lists(st.tuples(st.sampled_from([*own, *own, "law.kk", "", "use_sim_time"]), values), max_size=4))
    def change(pairs: list[tuple[str, Any]]) -> None:
        nonlocal before, taken
        parameters = [Parameter(name=key, value=value) for key, value in pairs]
        result = call(SetParametersAtomically, parameters=parameters).result
        wanted = {key: value for key, value in pairs if key in before} if result.successful else {}
        assert result.successful or result.reason
        after = get()
        assert after == before | wanted, pairs
        taken += bool(wanted)
        before = after

    change()
    assert taken > 5 or name == "trajectory"
    back = [Parameter(name=key, value=start[key]) for key in own if before[key] != start[key]]
    assert call(SetParametersAtomically, parameters=back).result.successful
    assert get() == start


def test_any_parameter_set_is_taken_whole_or_refused_whole_and_the_loop_runs_on(testbed: Testbed) -> None:
    loop = Loop(testbed, "joint_state")
    testbed.spin_until(loop.tracks, "a loop that tracks")
    for name in SETS:
        fuzz_parameters(testbed, name)
        # Who changes the arm's masses and the torque limits gets what was requested.
        loop.absurd.clear()
        loop.recover()
    loop.end()
