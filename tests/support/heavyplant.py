"""Somebody else's plant for a commissioning: 20 % heavier, with permuted names, an inverted torque and brakes."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from support.strangersplant import STRANGERS_ORDER, Vector, bias, in_order, mass_matrix

RATE = 500
HEAVIER = 1.2
INVERTED = "joint2"
_PATIENCE = 25
"""Samples without a command after which the brakes close."""
_FIRST_ANSWER, _ANSWER = 0.01, 0.1
"""s of wall time to wait for the first command of all, and for the answer to a joint state after it, which a busy
machine may delay; later, the sample passes without one."""
_SUBSTEPS = 2
_FRICTION = np.array([0.5, 0.5])
_STEP = 2.0 * np.pi / 2**17


class HeavyPlant:
    """Publishes joint states by its own time, and applies efforts by the standard messages alone.

    Attributes:
        q, v: true state of joint1 and joint2.
        start: position at the begin.
        moved: farthest way from the begin while `watched`.
        braked: whether the brakes hold the arm.
        nonsense: joint states that somebody else publishes before each of the arm's, with its stamp.
    """

    def __init__(self, domain: int) -> None:
        self.q, self.v = np.array([0.4, 0.6]), np.zeros(2)
        self.start, self.moved, self.braked, self.commands = self.q.copy(), 0.0, True, 0
        self.nonsense: list[JointState] = []
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = Node("heavy_plant", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._states = self._node.create_publisher(JointState, "joint_states", 10)
        self._node.create_subscription(JointState, "joint_commands", self._take, 10)
        self._effort, self._answered, self._silent, self._sample = np.zeros(2), -1, _PATIENCE, 0
        self._random, self._ended = np.random.default_rng(1), False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _take(self, message: JointState) -> None:
        assert np.isfinite(message.effort).all()
        self._effort = in_order(message, message.effort) * np.where(np.array(["joint1", "joint2"]) == INVERTED, -1, 1)
        self._answered = round((message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec) * RATE)
        self.commands += 1

    def _run(self) -> None:
        while not self._ended:
            self._sample += 1
            measured = _STEP * np.round(self.q / _STEP)
            message = JointState(name=STRANGERS_ORDER, position=[measured[1], measured[0]])
            message.header.stamp.sec, rest = divmod(self._sample, RATE)
            message.header.stamp.nanosec = rest * (1_000_000_000 // RATE)
            for other in self.nonsense:
                other.header.stamp = message.header.stamp
                self._states.publish(other)
            self._states.publish(message)
            end = time.monotonic() + (_ANSWER if self.commands else _FIRST_ANSWER)
            while self._answered < self._sample and time.monotonic() < end and not self._ended:
                self._executor.spin_once(timeout_sec=0.002)
            self._silent = 0 if self._answered == self._sample else self._silent + 1
            self.braked = self._silent >= _PATIENCE
            for _ in range(_SUBSTEPS):
                self._move(1.0 / (RATE * _SUBSTEPS))
            self.moved = max(self.moved, float(np.abs(self.q - self.start).max()))

    def _move(self, dt: float) -> None:
        """Semi-implicit Euler."""
        if self.braked:
            self.v[:] = 0.0
            return
        friction = 0.5 * self.v + _FRICTION * np.tanh(self.v / 0.01)
        torque: Vector = self._effort - HEAVIER * bias(self.q, self.v) - friction
        self.v = self.v + dt * np.linalg.solve(HEAVIER * mass_matrix(self.q), torque)
        self.q = self.q + dt * self.v

    def wait(self) -> None:
        """Let the plant go on a little."""
        sample = self._sample
        while self._sample == sample:
            assert self._thread.is_alive(), "the plant has failed"
            self._thread.join(0.001)

    def close(self) -> None:
        self._ended = True
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def begin(self) -> None:
        self._thread.start()


@contextmanager
def heavy_plant(domain: int) -> Iterator[HeavyPlant]:
    """The plant in a domain, running."""
    plant = HeavyPlant(domain)
    plant.begin()
    try:
        yield plant
    finally:
        plant.close()
