"""What controller and simulator do with messages they cannot use: say why, and go on."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from bench import Bench
from sensor_msgs.msg import JointState

from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import nanoseconds, set_stamp

NAMES = ["joint1", "joint2"]
PERIOD = 1_000_000


def joint_state(sample: int, position: list[float], names: list[str] = NAMES) -> JointState:
    message = JointState(name=names, position=position)
    set_stamp(message.header.stamp, sample * PERIOD)
    return message


def reference(sample: int, values: list[float], names: list[str] = NAMES) -> JointReference:
    message = JointReference(name=names, position=values, velocity=[0.0, 0.0], acceleration=[0.0, 0.0])
    set_stamp(message.header.stamp, sample * PERIOD)
    return message


class ControllerBench:
    """The controller process, fed by the test."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.process = bench.start("controller", "reference.match:=stamp")
        self.commands: list[JointState] = []
        self.states = bench.node.create_publisher(JointState, "joint_states", 10)
        self.references = bench.node.create_publisher(JointReference, "reference", 10)
        bench.node.create_subscription(JointState, "joint_commands", self.commands.append, 10)
        bench.spin_until(
            lambda: self.states.get_subscription_count() and self.references.get_subscription_count(), "the controller"
        )

    def answer(self, sample: int, state: JointState, ref: JointReference) -> JointState:
        self.commands.clear()
        self.references.publish(ref)
        self.states.publish(state)
        self.bench.spin_until(lambda: self.commands, f"a command for sample {sample}")
        assert nanoseconds(self.commands[-1].header.stamp) == sample * PERIOD
        return self.commands[-1]

    def says(self, text: str) -> None:
        self.bench.spin_until(lambda: text in self.process.log.read_text(), f"{text!r} in the log")


@pytest.fixture
def controller(bench: Bench) -> ControllerBench:
    return ControllerBench(bench)


BAD_JOINT_STATES = {
    "too many values": (joint_state(1, [0.0, 0.0, 0.0]), "position has 3 values for 2 joints"),
    "too few values": (joint_state(1, [0.0]), "position has 1 values for 2 joints"),
    "unknown joint": (joint_state(1, [0.0, 0.0], ["joint1", "elbow"]), "unknown joints elbow, missing joint2"),
    "missing joint": (joint_state(1, [0.0], ["joint1"]), "joints joint2 are missing"),
    "joint twice": (joint_state(1, [0.0, 0.0], ["joint1", "joint1"]), "a joint is named twice"),
    "nan": (joint_state(1, [0.0, math.nan]), "position is not finite"),
    "inf": (joint_state(1, [math.inf, 0.0]), "position is not finite"),
    "no names": (joint_state(1, [0.0, 0.0], []), "joints joint1, joint2 are missing"),
    "stamp again": (joint_state(0, [0.0, 0.0]), "two joint states have the same stamp"),
}


def test_controller_refuses_bad_messages_and_goes_on(controller: ControllerBench) -> None:
    first = controller.answer(0, joint_state(0, [0.0, -0.1]), reference(0, [0.4, 0.0]))
    assert list(first.name) == NAMES
    for message, cause in BAD_JOINT_STATES.values():
        controller.states.publish(message)
        controller.says(f"rejected joint_states: {cause}")
    for values, cause in (([math.nan, 0.0], "position is not finite"), ([0.0], "position has 1 values for 2 joints")):
        controller.references.publish(reference(1, values))
        controller.says(f"rejected reference: {cause}")
    command = controller.answer(1, joint_state(1, [0.0, -0.1]), reference(1, [0.4, 0.0]))
    assert all(map(math.isfinite, command.effort))
    assert controller.process.process.poll() is None


def test_controller_matches_joints_by_name(controller: ControllerBench) -> None:
    def drive(order: Callable[[list[Any]], list[Any]], first: int) -> list[list[float]]:
        efforts = []
        for k in range(20):
            q, q_d = [0.01 * k, -0.1 + 0.02 * k], [0.4, 0.02 * k]
            command = controller.answer(
                first + k,
                joint_state(first + k, order(q), order(NAMES)),
                reference(first + k, order(q_d), order(NAMES)),
            )
            efforts.append(list(command.effort))
        return efforts

    plain = drive(list, 1000)
    # Time that goes back starts the controller afresh.
    permuted = drive(lambda values: values[::-1], 0)
    assert permuted == plain


class SimulatorBench:
    """The simulator process in lockstep, commanded by the test."""

    def __init__(self, bench: Bench, *parameters: str) -> None:
        self.bench = bench
        self.states: list[JointState] = []
        self.commands = bench.node.create_publisher(JointState, "joint_commands", 10)
        bench.node.create_subscription(JointState, "joint_states", self.states.append, 10)
        self.process = bench.start("simulator", "clock:=lockstep", "start.subscribers:=1", *parameters)

    def state(self, sample: int) -> JointState:
        self.bench.spin_until(lambda: len(self.states) > sample, f"joint state {sample}")
        assert nanoseconds(self.states[sample].header.stamp) == sample * PERIOD
        return self.states[sample]

    def command(self, sample: int, effort: list[float], names: list[str] = NAMES) -> None:
        message = JointState(name=names, effort=effort)
        set_stamp(message.header.stamp, sample * PERIOD)
        self.commands.publish(message)

    def says(self, text: str) -> None:
        self.bench.spin_until(lambda: text in self.process.log.read_text(), f"{text!r} in the log")


def test_simulator_refuses_bad_messages_and_goes_on(bench: Bench) -> None:
    simulator = SimulatorBench(bench)
    simulator.state(0)
    simulator.command(0, [1.0, 2.0, 3.0])
    simulator.says("rejected joint_commands: effort has 3 values for 2 joints")
    simulator.command(0, [1.0, math.nan])
    simulator.says("rejected joint_commands: effort is not finite")
    simulator.command(0, [1.0, -math.inf])
    simulator.command(0, [1.0, 1.0], ["joint1", "wrist"])
    simulator.says("rejected joint_commands: unknown joints wrist, missing joint2")
    simulator.command(7, [1.0, 1.0])
    simulator.says("is that of no joint state sent")
    assert len(simulator.states) == 1, "nothing of this moves the arm"
    simulator.command(0, [1.0, 1.0])
    assert all(map(math.isfinite, simulator.state(1).position))
    assert simulator.process.process.poll() is None


@pytest.mark.parametrize("names", [NAMES, NAMES[::-1]])
def test_simulator_matches_joints_by_name(bench: Bench, names: list[str]) -> None:
    from pidtsm_core.node_parameters import simulator_node_schema
    from pidtsm_core.parameters import resolve
    from pidtsm_core.plant import Plant

    simulator = SimulatorBench(bench)
    plant = Plant(resolve(simulator_node_schema, {}, 2))
    for k in range(20):
        assert list(simulator.state(k).position) == plant.state.position.tolist()
        effort = {"joint1": 30.0 + k, "joint2": -5.0 * k}
        simulator.command(k, [effort[name] for name in names], names)
        plant.state.work[0] = [effort[name] for name in NAMES]
        plant.step(plant.state.work[0].copy(), k * 1e-3, 1e-3)


def test_simulator_names_the_silent_node(bench: Bench) -> None:
    simulator = SimulatorBench(bench, "lockstep.timeout:=0.5")
    simulator.state(0)
    bench.spin_until(lambda: simulator.process.process.poll() is not None, "the end of the simulator")
    assert simulator.process.process.returncode == 1
    assert "no command for t = 0 s within 0.5 s: /stranger is silent" in simulator.process.log.read_text()
