"""Strangers: somebody else's controller on our simulator, and somebody else's plant under our controller.

They know the documented topics and standard messages, nothing of this project's code; they name joint2 first.
"""

import math
from typing import Any

import numpy as np
from bench import Bench
from numpy.typing import NDArray
from sensor_msgs.msg import JointState

Vector = NDArray[np.float64]

STRANGERS_ORDER = ["joint2", "joint1"]
PERIOD = 0.001  # s
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

    def __init__(self, bench: Bench) -> None:
        self.times: list[float] = []
        self.errors: list[Vector] = []
        self.start: Vector = np.zeros(2)
        self.last: Vector = np.zeros(2)
        self.commands = bench.node.create_publisher(JointState, "joint_commands", 10)
        bench.node.create_subscription(JointState, "joint_states", self.on_state, 10)

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


def test_a_strangers_controller_tracks_on_our_simulator(bench: Bench) -> None:
    stranger = StrangersController(bench)
    simulator = bench.start("simulator", "clock:=lockstep", "start.subscribers:=1", "duration:=1.5")

    bench.spin_until(lambda: simulator.process.poll() is not None, "the end of the run")

    assert simulator.process.returncode == 0, simulator.tail()
    np.testing.assert_allclose(stranger.times, np.arange(1500) * PERIOD, atol=1e-12)
    # The article's disturbance, up to 3 N m, pulls at the arm.
    assert np.abs(stranger.errors).max() < 2e-3


class StrangersPlant:
    """An arm by Lagrange's equations, integrated by RK4; it moves when the command for its last state has come."""

    def __init__(self, bench: Bench, samples: int) -> None:
        self.samples = samples
        self.q, self.v = np.array([0.3, 0.1]), np.zeros(2)
        self.positions: list[Vector] = []
        self.states = bench.node.create_publisher(JointState, "joint_states", 10)
        bench.node.create_subscription(JointState, "joint_commands", self.on_command, 10)

    def publish(self) -> None:
        message = JointState(name=STRANGERS_ORDER, position=[self.q[1], self.q[0]])
        message.header.stamp.sec, milliseconds = divmod(len(self.positions), 1000)
        message.header.stamp.nanosec = milliseconds * 1_000_000
        self.positions.append(self.q)
        self.states.publish(message)

    def on_command(self, message: JointState) -> None:
        assert round(seconds(message) / PERIOD) == len(self.positions) - 1, "each state is answered once"
        torque = np.clip(in_order(message, message.effort), [-100.0, -50.0], [100.0, 50.0])

        def rate(state: Vector) -> Vector:
            q, v = state[:2], state[2:]
            friction = 0.5 * v + 0.5 * np.tanh(v / 0.05)
            return np.concatenate([v, np.linalg.solve(mass_matrix(q), torque - bias(q, v) - friction)])

        state = np.concatenate([self.q, self.v])
        k1 = rate(state)
        k2 = rate(state + 0.5 * PERIOD * k1)
        k3 = rate(state + 0.5 * PERIOD * k2)
        k4 = rate(state + PERIOD * k3)
        state = state + PERIOD * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
        self.q, self.v = state[:2], state[2:]
        if len(self.positions) < self.samples:
            self.publish()


def article(t: Vector) -> NDArray[np.float64]:
    """Eq. (52), shape (samples, 2), rad."""
    first, second = 0.2 * np.cos(0.7 * t), 0.2 * np.cos(0.5 * t - 0.2)
    return np.stack([first + second, second - first], axis=1)


def test_our_controller_tracks_on_a_strangers_plant(bench: Bench) -> None:
    plant = StrangersPlant(bench, 3000)
    bench.start("controller", "reference.match:=stamp")
    bench.start("trajectory", "clock:=lockstep")
    bench.spin_until(
        lambda: plant.states.get_subscription_count() == 2 and bench.node.count_subscribers("reference") == 1,
        "controller and trajectory",
    )

    plant.publish()
    bench.spin_until(lambda: len(plant.positions) == plant.samples, "the last sample")

    error = plant.positions - article(np.arange(plant.samples) * PERIOD)
    assert np.abs(error[0]).max() > 0.05, "it begins off the reference"
    assert np.abs(error[-1000:]).max() < 3e-3
