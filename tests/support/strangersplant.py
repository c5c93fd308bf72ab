"""Somebody else's plant: an arm written from the documented topics and standard messages alone, joint2 first."""

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState

from pidtsm_experiments.runs.runner import Process
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import nanoseconds, set_stamp
from support.testbed import Testbed

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


EPOCH = 86_400 * 365 * SECOND
"""Its stamps are of another clock."""


class StrangersPlant:
    """An arm by Lagrange's equations with friction; it moves when the command for its last state has come.

    Attributes:
        KEPT: states that are sent again to those who lack them.
        now: simulated time, ns.
        last: stamp of the last state, ns.
        off: what the sensor adds, rad.
        times, positions, efforts: s, rad and N m, of every state that was answered.
    """

    KEPT = 10

    def __init__(
        self, testbed: Testbed, rate: int = 1000, heavier: float = 0.0, jitter: float = 0.0, late: float = 0.0
    ) -> None:
        """Args: heavier, jitter: shares of the masses, and of the period; late: s after which a command acts."""
        self.testbed, self.late = testbed, round(late * rate)
        self.period, self.jitter, self.heavier = 1.0 / rate, jitter, 1.0 + heavier
        self.random = np.random.default_rng(rate)
        self.now, self.epoch = 0, EPOCH
        self.q, self.v = np.array([0.39, -0.01]), np.zeros(2)
        self.off, self.last = 0.0, 0
        self.times: list[float] = []
        self.positions: list[Vector] = []
        self.efforts: list[Vector] = []
        self.answers: list[JointState] = []
        self.states = testbed.node.create_publisher(JointState, "joint_states", self.KEPT)
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

    def answered(self) -> bool:
        """Whether there are command and reference for the last state: nobody need be faster than the latter."""
        newest = [heard[-1] if heard else None for heard in (self.answers, self.references)]
        return all(m and nanoseconds(m.header.stamp) == self.last for m in newest)

    def meet(self) -> None:
        """Measure at rest until a controller that has just been started answers."""

        def measured() -> bool:
            self.now += MS
            self.state()
            end = time.monotonic() + 0.5
            while not self.answered() and time.monotonic() < end:
                self.testbed.executor.spin_once(timeout_sec=0.02)
            return self.answered()

        self.testbed.spin_until(measured, "an answer of the new controller")

    def step(self) -> None:
        """A state, its command, and the arm's motion under it until the next."""
        self.state()
        self.testbed.spin_until(self.answered, f"a command at {self.now / SECOND} s")
        self.times.append(self.now / SECOND)
        self.positions.append(self.q)
        self.efforts.append(in_order(self.answers[-1], self.answers[-1].effort))
        self.move()

    def move(self) -> None:
        """The arm's motion under the last command until the next state."""
        took = round(self.period * (1.0 + self.random.uniform(-self.jitter, self.jitter)) * SECOND)
        self.now += took
        steps = math.ceil(took / SECOND / PERIOD)
        acting = self.efforts[max(len(self.efforts) - 1 - self.late, 0)]
        for _ in range(steps):
            self.integrate(acting, took / SECOND / steps)

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


_RELIABLE = "qos_overrides./{}.subscription.reliability:=reliable"
"""The test needs every answer."""


def start_controller(testbed: Testbed, recorders: int = 0, **parameters: object) -> Process:
    """Our controller in realtime; arguments as for `start`."""
    given = {"watchdog.state_stop": 5.0, **{name.replace("__", "."): value for name, value in parameters.items()}}
    return testbed.start(
        "controller",
        f"start.subscribers:={1 + recorders}",
        *(f"{name}:={value}" for name, value in given.items()),
        *(_RELIABLE.format(topic) for topic in ("joint_states", "reference")),
    )


def start(testbed: Testbed, plant: StrangersPlant, recorders: int = 0, **parameters: object) -> dict[str, Process]:
    """Our controller and trajectory in realtime, which the plant's time has nothing to do with.

    Args:
        testbed: where they run.
        plant: the arm.
        recorders: number of recorders that have been started; they get every message.
        parameters: of the controller, and of the trajectory node those of the reference; ``__`` for a dot.
    """
    parameters = {name.replace("__", "."): value for name, value in parameters.items()}
    reference = {name: parameters.pop(name) for name in list(parameters) if name.startswith("reference.")}
    nodes = {
        "controller": start_controller(testbed, recorders, **parameters),
        # It waits for the controller and the test, so that no reference is lost.
        "trajectory": testbed.start(
            "trajectory",
            _RELIABLE.format("joint_states"),
            f"start.subscribers:={2 + recorders}",
            *(f"{name}:={value}" for name, value in reference.items()),
        ),
    }
    readers = 2 + recorders
    testbed.spin_until(
        lambda: plant.states.get_subscription_count() == testbed.node.count_subscribers("reference") == readers,
        "controller, trajectory and recorders",
    )
    return nodes
