"""The simulator: whom it waits for, reset, payload and push while it runs, and commands that stay out or come late."""

import re
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from support.testbed import Testbed

from pidtsm_core.experiment.node_parameters import simulator_node_schema
from pidtsm_core.parameters import resolve
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_ros.stamps import nanoseconds

NAMES = ["joint1", "joint2"]
EFFORT = [40.0, 5.0]


class Arm:
    """The simulator process, with this torque commanded where the test requires it."""

    def __init__(self, testbed: Testbed, *parameters: str) -> None:
        self.testbed = testbed
        self.obedient = False
        self.effort = EFFORT
        self.answers: Callable[[list[JointState]], JointState] = lambda states: states[-1]
        self.states: list[JointState] = []
        self.commands = testbed.node.create_publisher(JointState, "joint_commands", 10)
        testbed.node.create_subscription(JointState, "joint_states", self._on_state, 10)
        self.process = testbed.start("simulator", "start.subscribers:=1", *parameters)

    def _on_state(self, message: JointState) -> None:
        if self.states and message.header.stamp == self.states[-1].header.stamp:
            return  # It is sent again.
        self.states.append(message)
        if self.obedient:
            self.command()

    def command(self) -> None:
        """Answer a joint state: the last one, unless `answers` returns another."""
        message = JointState(name=NAMES, effort=self.effort)
        message.header.stamp = self.answers(self.states).header.stamp
        self.commands.publish(message)

    def position(self, sample: int) -> list[float]:
        """In lockstep: of this sample, once it is there."""
        self.testbed.spin_until(
            lambda: len(self.states) > sample and self.commands.get_subscription_count(), f"joint state {sample}"
        )
        return list(self.states[sample].position)

    def reset(self) -> Trigger.Response:
        return self.testbed.call(Trigger, "simulator/reset", Trigger.Request())

    def logs(self, text: str) -> None:
        self.testbed.spin_until(lambda: text in self.process.log.read_text(), f"{text!r} in the log")


def changes(testbed: Testbed, node: str, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(testbed.call(ChangeState, f"{node}/change_state", request).success)


def change(testbed: Testbed, node: str, *transitions: int) -> None:
    for transition in transitions:
        assert changes(testbed, node, transition)


CHANGES: dict[str, dict[str, float | list[float]]] = {
    "payload": {"payload.mass": 0.5},
    "push": {"push.effort": [5.0, -3.0], "push.duration": 1e6},
}


@pytest.mark.parametrize("change", CHANGES)
def test_payload_and_push_come_and_go_as_parameters_while_it_runs(testbed: Testbed, change: str) -> None:
    arm = Arm(testbed, "clock:=lockstep")
    robot = SimulatedRobot(resolve(simulator_node_schema, {}, 2))
    on = CHANGES[change]
    off = {name: [0.0, 0.0] if isinstance(value, list) else 0.0 for name, value in on.items()}
    for k in range(30):
        assert arm.position(k) == robot.state.arm.position.tolist()
        if k in (10, 20):
            values = on if k == 10 else off
            testbed.set("simulator", values)
            robot.set_parameters(resolve(simulator_node_schema, values, 2))
        robot.sense(k)
        robot.act(k, True, np.array(EFFORT))
        arm.command()


def test_a_reset_brings_the_arm_back_while_time_goes_on(testbed: Testbed) -> None:
    arm = Arm(testbed, "clock:=lockstep")
    first = []
    for k in range(10):
        first.append(arm.position(k))
        arm.command()
    arm.position(10)
    assert arm.reset().success
    # The measurement of sample 10 was out already.
    arm.command()
    for k in range(1, 10):
        assert arm.position(10 + k) == first[k]
        arm.command()
    assert nanoseconds(arm.states[19].header.stamp) == 19_000_000
    testbed.set("simulator", {"initial_position": [0.5, 0.25]})
    assert arm.reset().success
    arm.position(20)
    robot = SimulatedRobot(resolve(simulator_node_schema, {"initial_position": [0.5, 0.25]}, 2))
    robot.act(0, True, np.array(EFFORT))
    arm.command()
    assert arm.position(21) == robot.state.arm.position.tolist()


def test_brakes_stop_the_arm_when_commands_stay_out_and_open_with_the_next(testbed: Testbed) -> None:
    summaries: list[str] = []
    truth: list[JointState] = testbed.hear(JointState, "simulator/ground_truth", 100)
    testbed.node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda message: summaries.append(message.status[0].message), 10
    )
    arm = Arm(testbed, "command.timeout:=0.05")
    arm.obedient = True
    testbed.spin_until(lambda: truth and min(map(abs, truth[-1].velocity)) > 0.05, "an arm in motion")

    arm.obedient = False
    arm.logs("(command.timeout): the brakes stop the arm")
    testbed.spin_until(lambda: not any(truth[-1].effort) and max(map(abs, truth[-1].velocity)) < 1e-6, "an arm at rest")
    testbed.spin_until(lambda: any("brakes engaged" in s for s in summaries), "word of it on /diagnostics")

    arm.obedient = True
    arm.logs("command received: brakes released")
    testbed.spin_until(lambda: min(map(abs, truth[-1].velocity)) > 0.05, "an arm in motion again")
    time = 1e-9 * np.array([nanoseconds(each.header.stamp) for each in truth])[:, np.newaxis]
    position, velocity = (np.array([getattr(each, name) for each in truth]) for name in ("position", "velocity"))
    dt = np.diff(time, axis=0)
    speed = np.maximum(np.abs(velocity[:-1]), np.abs(velocity[1:]))
    # A busy machine pauses the simulator, and the arm may have been faster meanwhile.
    acceleration = (np.abs(np.diff(velocity, axis=0)) / dt).max(axis=0)
    assert (np.abs(np.diff(position, axis=0)) <= 1.01 * speed * dt + 0.5 * acceleration * dt**2 + 1e-5).all(), "a jump"


def test_in_lockstep_silence_ends_the_run_with_the_name_of_who_is_silent(testbed: Testbed) -> None:
    arm = Arm(testbed, "clock:=lockstep", "lockstep.timeout:=0.5")
    arm.position(0)
    arm.command()
    arm.position(1)
    assert arm.process.wait() == 1
    assert "no command for t = 0.001 s within 0.5 s: /stranger did not respond" in arm.process.log.read_text()


WILD = ("rate:=50", "limits.effort:=1e6", "command.timeout:=0.0")
TOO_MUCH = [9e5, -9e5]


def test_an_arm_that_diverges_starts_again_and_nothing_infinite_is_published(testbed: Testbed) -> None:
    truth: list[JointState] = testbed.hear(JointState, "simulator/ground_truth", 1000)
    arm = Arm(testbed, *WILD)
    arm.effort, arm.obedient = TOO_MUCH, True
    arm.logs("s; it is at its initial position again, at rest")
    count = len(truth)
    testbed.spin_until(lambda: len(truth) > count + 50, "a second more")
    assert all(np.isfinite([*each.position, *each.velocity, *each.effort]).all() for each in truth)
    assert np.isfinite([each.position for each in arm.states]).all()


def test_in_lockstep_an_arm_that_diverges_ends_the_run_as_a_rollout_ends(testbed: Testbed) -> None:
    arm = Arm(testbed, *WILD, "clock:=lockstep")
    arm.position(0)
    arm.effort, arm.obedient = TOO_MUCH, True
    arm.command()
    testbed.spin_until(lambda: arm.process.process.poll() is not None, "the end")
    assert arm.process.wait() == 1
    assert "the arm moved too fast to be simulated at rate = 50, and diverged after" in arm.process.log.read_text()
    assert np.isfinite([each.position for each in arm.states]).all()


def test_in_realtime_no_sample_passes_before_somebody_answers(testbed: Testbed) -> None:
    truth: list[JointState] = testbed.hear(JointState, "simulator/ground_truth", 1000)
    arm = Arm(testbed, "duration:=0.3")
    arm.logs("waiting: no command on joint_commands so far; is a controller active?")
    assert not truth
    stamps = [nanoseconds(state.header.stamp) for state in arm.states]
    assert np.diff(stamps).min() >= 500_000, "the joint state comes again, with a fresh stamp"
    assert all(state.position == arm.states[0].position for state in arm.states)
    arm.obedient = True
    arm.command()
    testbed.spin_until(lambda: arm.process.process.poll() is not None, "the end")
    testbed.spin_until(
        lambda: truth and nanoseconds(truth[-1].header.stamp) - nanoseconds(truth[0].header.stamp) >= 299_000_000,
        "all of the truth",
    )
    assert nanoseconds(truth[0].header.stamp) >= stamps[-1]
    assert "done: 300 samples" in arm.process.log.read_text()


@pytest.mark.parametrize("clock", ["realtime", "lockstep"])
def test_it_waits_for_an_active_controller_in_whatever_order_a_manager_starts_them(
    testbed: Testbed, clock: str
) -> None:
    match = {"realtime": "latest", "lockstep": "stamp"}[clock]
    simulator = testbed.start("simulator", "autostart:=false", f"clock:={clock}", "rate:=200", "duration:=1.0")
    testbed.start("trajectory", "autostart:=false", f"clock:={clock}")
    testbed.start("controller", "autostart:=false", f"reference.match:={match}")

    def logs(text: str) -> None:
        testbed.spin_until(lambda: text in simulator.log.read_text(), f"{text!r} in the log")

    change(testbed, "simulator", Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
    logs("waiting: joint_states has 0 of 2 subscribers, joint_commands 0 publishers")
    change(testbed, "controller", Transition.TRANSITION_CONFIGURE)
    change(testbed, "trajectory", Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
    logs("waiting: no command on joint_commands so far; is a controller active?")
    # While a joint state is late, because the machine is busy, the controller refuses.
    activate = Transition.TRANSITION_ACTIVATE
    testbed.spin_until(lambda: changes(testbed, "controller", activate), "the controller is active")
    assert simulator.wait() == 0
    done = re.search(r"done: 200 samples in .*; (\d+) skipped, (\d+) answered", simulator.log.read_text())
    assert done
    skipped, answered = done.groups()
    assert int(skipped) + int(answered) >= 198


def test_stale_commands_are_counted_and_logged_once_and_so_are_the_stops_they_lead_to(testbed: Testbed) -> None:
    """Of a stranger whose stamps are late every now and then."""
    summaries: list[DiagnosticArray] = testbed.hear(DiagnosticArray, "/diagnostics")
    arm = Arm(testbed, "command.timeout:=0.02")
    arm.answers = lambda states: states[0] if len(states) % 100 < 50 else states[-1]
    arm.obedient = True

    def counted(name: str) -> float:
        values = {pair.key: pair.value for pair in summaries[-1].status[0].values} if summaries else {}
        return float(values.get(name, 0.0))

    testbed.spin_until(lambda: counted("stops by the brakes since activation") > 10, "the brakes stop the arm")
    assert counted("commands ignored for a stale stamp since activation") > 100
    log = arm.process.log.read_text()
    assert log.count("the brakes stop the arm") == 1
    assert log.count("ignored joint_commands: a command for this or a later joint state was used") == 1
    assert "rejected" not in log


def test_in_realtime_a_further_command_for_a_joint_state_takes_the_place_of_the_one_before(testbed: Testbed) -> None:
    truth: list[JointState] = testbed.hear(JointState, "simulator/ground_truth", 100)
    arm = Arm(testbed, "command.timeout:=3.0")
    testbed.spin_until(lambda: arm.states and arm.commands.get_subscription_count(), "a joint state")
    answered = arm.states[-1:]

    def went_on(since: int) -> bool:
        return len(truth) > since + 250

    arm.answers = lambda states: answered[0]
    for effort in ([40.0, 5.0], [20.0, -5.0]):
        arm.effort = effort
        # It counts as a command for command.timeout, too: all of them take 4 s.
        for _ in range(8):
            arm.command()
            count = len(truth)
            testbed.spin_until(partial(went_on, count), "a quarter of a second")
        assert list(truth[-1].effort) == effort
    assert "brakes" not in arm.process.log.read_text()


def test_a_first_joint_state_that_nobody_answers_is_sent_again(testbed: Testbed) -> None:
    heard: list[JointState] = testbed.hear(JointState, "joint_states")
    commands = testbed.node.create_publisher(JointState, "joint_commands", 10)
    testbed.start("simulator", "start.subscribers:=1", "clock:=lockstep", "lockstep.timeout:=60.0")
    testbed.spin_until(lambda: len(heard) == 3, "the same three times")
    assert all(state == heard[0] for state in heard)
    commands.publish(JointState(header=heard[0].header, name=NAMES, effort=EFFORT))
    testbed.spin_until(lambda: heard[-1].header.stamp != heard[0].header.stamp, "the next")
    assert nanoseconds(heard[-1].header.stamp) == 1_000_000


def test_a_transition_that_the_state_does_not_have_is_refused(testbed: Testbed) -> None:
    """And the node goes on; rclpy's own service ends it."""
    testbed.start("simulator", "autostart:=false")
    assert not changes(testbed, "simulator", Transition.TRANSITION_DEACTIVATE)
    change(testbed, "simulator", Transition.TRANSITION_CONFIGURE)
