"""Strangers: somebody else's controller on our simulator, and somebody else's plant under our controller.

They know the documented topics and standard messages, not what the nodes do inside; they name joint2 first.
"""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from testbed import Testbed

from pidtsm_experiments.runs.runner import Process
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import nanoseconds, set_stamp

Vector = NDArray[np.float64]

STRANGERS_ORDER = ["joint2", "joint1"]
PERIOD = 0.001  # s
MS = 1_000_000
SECOND = 1000 * MS
G = 9.8  # m/s^2


def mass_matrix(q: Vector) -> NDArray[np.float64]:
    """Of 0.5 kg at 1 m and 1.5 kg 0.85 m behind it, and rotor inertias of 5 kg m^2; q of joint1, joint2."""
    coupled = 1.5 * 0.85 * math.cos(q[1])
    outer = 1.5 * 0.85**2
    return np.array([[2.0 + outer + 5.0 + 2.0 * coupled, outer + coupled], [outer + coupled, outer + 5.0]])


def bias(q: Vector, v: Vector) -> Vector:
    """Coriolis, centrifugal (Lagrange's) and gravity torques, N m."""
    h = 1.5 * 0.85 * math.sin(q[1])
    outer = 1.5 * 0.85 * G * math.cos(q[0] + q[1])
    return np.array([-h * v[1] * (2.0 * v[0] + v[1]) + 2.0 * G * math.cos(q[0]) + outer, h * v[0] ** 2 + outer])


def in_order(message: JointState, values: Any) -> Vector:
    """The values of joint1 and joint2, wherever they stand."""
    by_name = dict(zip(message.name, values, strict=True))
    return np.array([by_name["joint1"], by_name["joint2"]])


def seconds(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


class StrangersController:
    """Computed torque, with velocities by difference, along a cosine from where the arm stands."""

    def __init__(self, testbed: Testbed) -> None:
        self.times: list[float] = []
        self.errors: list[Vector] = []
        self.start: Vector = np.zeros(2)
        self.last: Vector = np.zeros(2)
        self.commands = testbed.node.create_publisher(JointState, "joint_commands", 10)
        testbed.node.create_subscription(JointState, "joint_states", self.on_state, 10)

    def on_state(self, message: JointState) -> None:
        t, q = seconds(message), in_order(message, message.position)
        if not self.times:
            self.start = self.last = q
        v = (q - self.last) / (t - self.times[-1]) if self.times else np.zeros(2)
        amplitude, rate = np.array([0.3, -0.2]), 4.0
        e = q - self.start - amplitude * (1.0 - math.cos(rate * t))
        de = v - amplitude * rate * math.sin(rate * t)
        a = amplitude * rate**2 * math.cos(rate * t) - 900.0 * e - 60.0 * de
        torque = mass_matrix(q) @ a + bias(q, v)
        self.times.append(t)
        self.errors.append(e)
        self.last = q
        command = JointState(name=STRANGERS_ORDER, effort=[torque[1], torque[0]])
        command.header.stamp = message.header.stamp
        self.commands.publish(command)


def test_a_strangers_controller_tracks_on_our_simulator(testbed: Testbed) -> None:
    stranger = StrangersController(testbed)
    simulator = testbed.start("simulator", "clock:=lockstep", "start.subscribers:=1", "duration:=1.5")

    testbed.spin_until(lambda: simulator.process.poll() is not None, "the end of the run")

    assert simulator.process.returncode == 0, simulator.tail()
    np.testing.assert_allclose(stranger.times, np.arange(1500) * PERIOD, atol=1e-12)
    # The article's disturbance, up to 3 N m, pulls at the arm.
    assert np.abs(stranger.errors).max() < 2e-3


EPOCH = 86_400 * 365 * SECOND
"""Its stamps are of another clock."""


class StrangersPlant:
    """An arm by Lagrange's equations with friction; it moves when the command for its last state has come.

    Attributes:
        now: simulated time, ns.
        last: stamp of the last state, ns.
        off: what the sensor adds, rad.
        times, positions, efforts: s, rad and N m, of every state that was answered.
    """

    def __init__(self, testbed: Testbed, rate: int = 1000, heavier: float = 0.0, jitter: float = 0.0) -> None:
        self.testbed = testbed
        self.period, self.jitter, self.heavier = 1.0 / rate, jitter, 1.0 + heavier
        self.random = np.random.default_rng(rate)
        self.now, self.epoch = 0, EPOCH
        self.q, self.v = np.array([0.39, -0.01]), np.zeros(2)
        self.off, self.last = 0.0, 0
        self.times: list[float] = []
        self.positions: list[Vector] = []
        self.efforts: list[Vector] = []
        self.answers: list[JointState] = []
        self.states = testbed.node.create_publisher(JointState, "joint_states", 10)
        self.references: list[JointReference] = []
        testbed.node.create_subscription(JointState, "joint_commands", self.answers.append, 10)
        testbed.node.create_subscription(JointReference, "reference", self.references.append, 10)

    def publish(self, stamp: int, q: Vector) -> None:
        message = JointState(name=STRANGERS_ORDER, position=[q[1], q[0]])
        set_stamp(message.header.stamp, stamp)
        self.states.publish(message)

    def state(self) -> None:
        """The state of now."""
        self.last = self.epoch + self.now
        self.publish(self.last, self.q + self.off)

    def step(self) -> None:
        """A state, its command, and the arm's motion under it until the next."""
        self.state()

        def answered() -> bool:
            # Faster than the trajectory node can answer nobody need be.
            newest = [heard[-1] if heard else None for heard in (self.answers, self.references)]
            return all(m and nanoseconds(m.header.stamp) == self.last for m in newest)

        self.testbed.spin_until(answered, f"a command at {self.now / SECOND} s")
        self.times.append(self.now / SECOND)
        self.positions.append(self.q)
        self.efforts.append(in_order(self.answers[-1], self.answers[-1].effort))
        self.move()

    def move(self) -> None:
        """The arm's motion under the last command until the next state."""
        took = round(self.period * (1.0 + self.random.uniform(-self.jitter, self.jitter)) * SECOND)
        self.now += took
        steps = math.ceil(took / SECOND / PERIOD)
        for _ in range(steps):
            self.integrate(self.efforts[-1], took / SECOND / steps)

    def integrate(self, torque: Vector, dt: float) -> None:
        """RK4."""

        def rate(state: Vector) -> Vector:
            q, v = state[:2], state[2:]
            friction = 0.5 * v + 0.5 * np.tanh(v / 0.05)
            needed = self.heavier * bias(q, v) + friction
            return np.concatenate([v, np.linalg.solve(self.heavier * mass_matrix(q), torque - needed)])

        state = np.concatenate([self.q, self.v])
        k1 = rate(state)
        k2 = rate(state + 0.5 * dt * k1)
        k3 = rate(state + 0.5 * dt * k2)
        k4 = rate(state + dt * k3)
        state = state + dt * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
        self.q, self.v = state[:2], state[2:]

    def go_on(self, seconds: float) -> None:
        end = self.now + round(seconds * SECOND)
        while self.now < end:
            self.step()

    def largest_step(self, since: int) -> float:
        """Of the torque, N m."""
        return float(np.abs(np.diff(self.efforts[since:], axis=0)).max())


def article(t: Vector) -> NDArray[np.float64]:
    """Eq. (52), shape (samples, 2), rad."""
    first, second = 0.2 * np.cos(0.7 * t), 0.2 * np.cos(0.5 * t - 0.2)
    return np.stack([first + second, second - first], axis=1)


def start(testbed: Testbed, plant: StrangersPlant, **parameters: object) -> dict[str, Process]:
    """Our controller and trajectory in realtime, which the plant's time has nothing to do with."""
    given = {"watchdog.state_stop": 5.0, **{name.replace("__", "."): value for name, value in parameters.items()}}
    # The test needs every answer.
    reliable = "qos_overrides./{}.subscription.reliability:=reliable"
    nodes = {
        "controller": testbed.start(
            "controller",
            *(f"{name}:={value}" for name, value in given.items()),
            *(reliable.format(topic) for topic in ("joint_states", "reference")),
        ),
        # It waits for the controller and the test, so that no reference is lost.
        "trajectory": testbed.start("trajectory", reliable.format("joint_states"), "start.subscribers:=2"),
    }
    testbed.spin_until(
        lambda: plant.states.get_subscription_count() == 2 and testbed.node.count_subscribers("reference") == 2,
        "controller and trajectory",
    )
    return nodes


@pytest.mark.parametrize(
    ("rate", "jitter"), [(100, 0.0), (250, 0.0), (500, 0.0), (700, 0.4), (1000, 0.0)], ids=lambda value: f"{value:g}"
)
def test_our_nodes_track_on_a_strangers_plant_whatever_its_rate_and_its_stamps(
    testbed: Testbed, rate: int, jitter: float
) -> None:
    """A fifth heavier than the model; stamps come late, ahead and twice, and are of another clock than ours."""
    plant = StrangersPlant(testbed, rate, 0.2, jitter)
    nodes = start(testbed, plant, plausibility__velocity=20.0)
    plant.go_on(3.0)
    settled = len(plant.times)
    for milliseconds in (0, -1, -3, -20, -100, -500, -900, 5000, 3_600_000):
        for _ in range(2):
            plant.publish(plant.last + milliseconds * MS, np.array([0.5, -0.5]))
            plant.go_on(0.03)
    for _ in range(2):
        plant.off = 1.0  # A sample that cannot be.
        plant.step()
        plant.off = 0.0
        plant.go_on(0.05)
    plant.go_on(1.0)

    times = np.array(plant.times)
    error = np.abs(np.array(plant.positions) - article(times))
    assert error[settled:].max() < 1e-3, times[settled:][error[settled:].max(axis=1) > 1e-3]
    # What the law needs for the motion changes by less.
    assert plant.largest_step(settled) < 10.0
    for node in nodes.values():
        said = node.log.read_text()
        assert "rejected joint_states: late" in said
        assert "rejected joint_states: ahead" in said
        assert "holding" not in said


def test_where_a_strangers_clock_is_set_the_arm_stays_until_it_is_told_to_go_on(testbed: Testbed) -> None:
    plant = StrangersPlant(testbed, 500, 0.2)
    nodes = start(testbed, plant)
    plant.go_on(2.0)
    for epoch in (EPOCH - 3600 * SECOND, EPOCH + 5 * SECOND):
        before, plant.epoch = len(plant.times), epoch
        for _ in range(5):
            plant.state()
            plant.move()
        plant.go_on(2.0)
        rest = plant.q
        plant.go_on(2.0)
        assert np.abs(np.array(plant.positions[before:]) - rest).max() < 0.08, "it comes to rest"
        assert np.abs(plant.q - rest).max() < 2e-3
        assert plant.largest_step(before - 1) < 10.0
    assert "holding the arm where it is" in nodes["trajectory"].log.read_text()

    began, before = plant.now / SECOND, len(plant.times)
    assert testbed.call(Trigger, "trajectory/begin", Trigger.Request()).success
    plant.go_on(5.0)
    assert plant.largest_step(before) < 10.0
    assert np.abs(plant.q - article(np.array([plant.now / SECOND - began]))[0]).max() < 3e-3


@pytest.mark.parametrize("heavier", [-0.3, 0.3])
def test_a_strangers_arm_that_is_stopped_stays_also_while_nobody_measures_it(testbed: Testbed, heavier: float) -> None:
    plant = StrangersPlant(testbed, 250, heavier)
    start(testbed, plant, stop__brakes="true", watchdog__state_stop=0.5)
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    brakes: list[Bool] = testbed.hear(Bool, "controller/brakes", kept)
    # The service is known from now on: while it is being discovered later, no joint state would arrive.
    assert not testbed.call(Trigger, "controller/reset_fault", Trigger.Request()).success
    plant.go_on(2.0)
    before = len(plant.times)
    testbed.set("controller", {"limits.min_position": -0.01, "limits.max_position": 0.01})
    plant.go_on(1.5)
    stopped = plant.q
    plant.go_on(4.0)
    assert np.abs(np.array(plant.positions[-4 * 250 :]) - stopped).max() < 2e-3
    testbed.spin_until(lambda: brakes and brakes[-1].data, "the brakes")

    # The watchdog publishes on, and joint states come back.
    answers = len(plant.answers)
    testbed.spin_until(lambda: len(plant.answers) > answers + 20, "torques without joint states")
    plant.efforts += [in_order(command, command.effort) for command in plant.answers[answers:]]
    plant.now += 600 * MS
    plant.go_on(0.5)
    assert plant.largest_step(before) < 10.0
    testbed.set("controller", {"limits.min_position": 0.0, "limits.max_position": 0.0})
    assert testbed.call(Trigger, "controller/reset_fault", Trigger.Request()).success
    plant.go_on(0.1)
    testbed.spin_until(lambda: not brakes[-1].data, "the brakes' release")
