"""Lower bound for the benchmarks of the nodes: the same messages between the same number of nodes, without control.

``python floor_nodes.py NAME,...[+ALTERNATIVE] --ros-args ...`` runs nodes of `NODES` in one process. The echo nodes
exchange the same bytes in the same way as the real nodes, but neither read them nor compute anything. The plain nodes
use rclpy's message objects, like most Python nodes.
"""

import gc
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from pidtsm_controller.controller_node import ControllerNode
from pidtsm_controller.trajectory_node import TrajectoryNode
from pidtsm_core.experiment.node_parameters import AUTOSTART, PRIORITY
from pidtsm_core.parameters import Parameter, as_float, names
from pidtsm_core.robots import DESCRIPTION, find_robot
from pidtsm_core.signals import Signal
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros import process
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stop import Stop
from pidtsm_ros.wire import OutgoingMessage
from two_link_sim.simulator_node import SimulatorNode

JOINTS = ["joint1", "joint2"]
MOTION = ("position", "velocity", "acceleration", "effort")
_SCALARS = ("period", "rate", "period_jitter", "state_age", "missed_deadlines", "compute_time")


class Floor(ManagedNode):
    """Base of the benchmark nodes, with their common parameters."""

    OWN: tuple[Parameter, ...] = ()

    def __init__(self, name: str, stop: Stop) -> None:
        super().__init__(name, lambda _: (AUTOSTART, PRIORITY, *self.OWN), lambda _: len(JOINTS), stop)

    @property
    def lockstep(self) -> bool:
        # The project's nodes have no priority in lockstep.
        return not self.priority

    @property
    def priority(self) -> int:
        return int(as_float(self.values[PRIORITY.name]))


class EchoController(Floor):
    """Publishes a command for every joint state; with `match`, after the reference of the same stamp."""

    OWN = (Parameter("match", False, "wait for the reference"),)

    def __init__(self, stop: Stop) -> None:
        super().__init__("echo_controller", stop)

    def configure(self) -> None:
        self._command = OutgoingMessage(JointState(name=JOINTS), ("effort",), joints=len(JOINTS))
        self._state = OutgoingMessage(
            ControllerState(name=JOINTS), [s.name.lower() for s in Signal], _SCALARS, len(JOINTS)
        )
        self._commands = self.advertise(JointState, "joint_commands")
        self._states = self.advertise(ControllerState, "echo/state")
        self._match = bool(self.values["match"])
        self._stamp = self._reference = -1
        self.listen(JointState, "joint_states", self._on_state, raw=True)
        self.listen(JointReference, "reference", self._on_reference, raw=True)

    def _on_state(self, data: bytes) -> None:
        self._stamp = serialized_nanoseconds(data)
        if not self._match or self._stamp == self._reference:
            self._answer()

    def _on_reference(self, data: bytes) -> None:
        self._reference = serialized_nanoseconds(data)
        if self._match and self._stamp == self._reference:
            self._answer()

    def _answer(self) -> None:
        self._commands.publish(self._command.to_bytes(self._stamp))
        self._states.publish(self._state.to_bytes(self._stamp))


class EchoTrajectory(Floor):
    """Publishes a reference for every joint state."""

    def __init__(self, stop: Stop) -> None:
        super().__init__("echo_trajectory", stop)

    def configure(self) -> None:
        self._message = OutgoingMessage(JointReference(name=JOINTS), MOTION, joints=len(JOINTS))
        self._references = self.advertise(JointReference, "reference")
        self.listen(JointState, "joint_states", self._on_state, raw=True)

    def _on_state(self, data: bytes) -> None:
        self._references.publish(self._message.to_bytes(serialized_nanoseconds(data)))


class PlainController(Floor):
    """Like `EchoController`, with message objects."""

    def __init__(self, stop: Stop) -> None:
        super().__init__("plain_controller", stop)

    def configure(self) -> None:
        rows = {s.name.lower(): [0.0] * len(JOINTS) for s in Signal}
        self._command = JointState(name=JOINTS, effort=[0.0] * len(JOINTS))
        self._state = ControllerState(name=JOINTS, **rows)
        self._commands = self.advertise(JointState, "joint_commands")
        self._states = self.advertise(ControllerState, "plain/state")
        self.listen(JointState, "joint_states", self._on_state)
        self.listen(JointReference, "reference", lambda message: None)

    def _on_state(self, state: JointState) -> None:
        self._command.header.stamp = self._state.header.stamp = state.header.stamp
        self._commands.publish(self._command)
        self._states.publish(self._state)


class PlainTrajectory(Floor):
    """Like `EchoTrajectory`, with message objects."""

    def __init__(self, stop: Stop) -> None:
        super().__init__("plain_trajectory", stop)

    def configure(self) -> None:
        self._message = JointReference(name=JOINTS, **{name: [0.0] * len(JOINTS) for name in MOTION})
        self._references = self.advertise(JointReference, "reference")
        self.listen(JointState, "joint_states", self._on_state)

    def _on_state(self, state: JointState) -> None:
        self._message.header.stamp = state.header.stamp
        self._references.publish(self._message)


class EchoSimulator(Floor):
    """Lockstep without an arm: publishes each sample after the command for the previous one."""

    OWN = (Parameter("samples", 1000, "number of samples"),)

    def __init__(self, stop: Stop) -> None:
        super().__init__("echo_simulator", stop)

    def configure(self) -> None:
        self._state = OutgoingMessage(JointState(name=JOINTS), ("position",), joints=len(JOINTS))
        self._truth = OutgoingMessage(JointState(name=JOINTS), ("position", "velocity", "effort"), joints=len(JOINTS))
        self._clock_message = OutgoingMessage(Clock())
        self._states = self.advertise(JointState, "joint_states")
        self._truths = self.advertise(JointState, "echo/ground_truth")
        self._clocks = self.advertise(Clock, "/clock")
        self._commands = self.listen(JointState, "joint_commands", self._on_command, raw=True)
        self._samples = int(as_float(self.values["samples"]))
        self._sample = -1

    def poll(self) -> float:
        if self._sample < 0 and self._states.get_subscription_count() >= 2 and self._commands.get_publisher_count():
            self._began = time.monotonic()
            self._send(0)
        return 0.02

    def _send(self, sample: int) -> None:
        self._sample = sample
        self._states.publish(self._state.to_bytes(sample * 1_000_000))
        self._clocks.publish(self._clock_message.to_bytes(sample * 1_000_000))

    def _on_command(self, data: bytes) -> None:
        if serialized_nanoseconds(data) != self._sample * 1_000_000:
            return
        ended = self._sample
        if ended + 1 < self._samples:
            self._send(ended + 1)
        self._truths.publish(self._truth.to_bytes(ended * 1_000_000))
        if ended + 1 == self._samples:
            print(f"done: {self._samples} samples in {time.monotonic() - self._began:.4f} s", flush=True)
            self.finished = True


def _at_rest(description: str) -> OutgoingMessage:
    """The joint state of a robot at its start position."""
    robot = find_robot({DESCRIPTION.name: description})
    message = OutgoingMessage(JointState(name=list(robot.joints)), ("position",), joints=len(robot.joints))
    message.arrays[0] = robot.initial_position
    return message


class Driver(Floor):
    """Measures round trips: publishes joint states at a constant rate to the namespaces in turn."""

    OWN = (
        Parameter("targets", ("law", "echo"), "namespaces"),
        Parameter("robots", ("two_link",), "robot.description by namespace; one: that of all"),
        Parameter("rate", 1000, "samples per second", "Hz"),
        Parameter("turn", 250, "consecutive samples to one namespace"),
        Parameter("turns", 40, "turns of each namespace"),
        Parameter("output", "round_trips.json", "file for the results"),
    )
    _WARM_UP = 4  # turns

    def __init__(self, stop: Stop) -> None:
        super().__init__("driver", stop)

    def configure(self) -> None:
        values = self.values
        self._targets = list(names(values["targets"]))
        self._period = round(1e9 / as_float(values["rate"]))
        self._turn, turns = int(as_float(values["turn"])), int(as_float(values["turns"])) + self._WARM_UP
        self._total = self._turn * turns * len(self._targets)
        robots = list(names(values["robots"]))
        self._messages = [_at_rest(robot) for robot in robots * (len(self._targets) // len(robots))]
        self._states = [self.advertise(JointState, f"{t}/joint_states") for t in self._targets]
        self._commanded = [
            self.listen(JointState, f"{t}/joint_commands", self._on_command, raw=True) for t in self._targets
        ]
        self._sent = np.zeros(self._total, np.int64)
        self._received = np.zeros(self._total, np.int64)
        self._number: dict[int, int] = {}
        self._k = -1

    def poll(self) -> float:
        if self._k < 0:
            ready = all(p.get_subscription_count() >= 2 for p in self._states)
            if not ready or not all(s.get_publisher_count() for s in self._commanded):
                return 0.02
            self._k, self._due = 0, time.monotonic_ns() + 500_000_000
        now = time.monotonic_ns()
        if now >= self._due:
            if self._k >= self._total:
                self._write()
                self.finished = True
                return 0.0
            stamp, target = time.time_ns(), self._k // self._turn % len(self._targets)
            data = self._messages[target].to_bytes(stamp)
            self._number[stamp] = self._k
            self._sent[self._k] = time.perf_counter_ns()
            self._states[target].publish(data)
            self._k += 1
            self._due = max(self._due + self._period, now + self._period // 2)
            if self._k >= self._total:
                self._due += 500_000_000
            now = time.monotonic_ns()
        return max(0, self._due - now) / 1e9

    def _on_command(self, data: bytes) -> None:
        now = time.perf_counter_ns()
        place = self._number.pop(serialized_nanoseconds(data), -1)
        if place >= 0:
            self._received[place] = now

    def _write(self) -> None:
        shape = (-1, len(self._targets), self._turn)
        sent, received = self._sent.reshape(shape)[self._WARM_UP :], self._received.reshape(shape)[self._WARM_UP :]
        result = {}
        for i, target in enumerate(self._targets):
            begin, end = sent[:, i], received[:, i]
            answered = end > 0
            trips = (end - begin)[answered] / 1e3
            both = answered[:, 1:] & answered[:, :-1]
            periods = np.diff(end, axis=1)[both] / 1e3
            result[target] = {
                "samples": int(begin.size),
                "lost": int((~answered).sum()),
                "round_trip_us": dict(
                    zip(("p50", "p99", "p99.9", "max"), np.percentile(trips, [50, 99, 99.9, 100]).tolist(), strict=True)
                ),
                "missed": float(((periods > 2000).sum() + (~answered).sum()) / begin.size),
                "period_jitter_us": float(periods.std()),
            }
        Path(str(self.values["output"])).write_text(json.dumps(result), encoding="utf-8")


NODES: dict[str, process.MakeNode] = {
    "driver": Driver,
    "controller": ControllerNode,
    "trajectory": TrajectoryNode,
    "simulator": SimulatorNode,
    "echo_controller": EchoController,
    "echo_trajectory": EchoTrajectory,
    "echo_simulator": EchoSimulator,
    "plain_controller": PlainController,
    "plain_trajectory": PlainTrajectory,
}


def _unfrozen() -> None:
    gc.freeze = lambda: None


def _wait_set() -> None:
    process.EventsExecutor = SingleThreadedExecutor  # type: ignore[attr-defined]  # The name that it looks up.


ALTERNATIVES: dict[str, Callable[[], None]] = {"unfrozen": _unfrozen, "wait_set": _wait_set}
"""Rejected design alternatives, for comparison: the garbage collector traverses all objects of the process; the
executor builds a wait set for every message."""

if __name__ == "__main__":
    chosen, _, alternative = sys.argv[1].partition("+")
    if alternative:
        ALTERNATIVES[alternative]()
    sys.exit(process.run_nodes([NODES[name] for name in chosen.split(",")], Stop(), sys.argv[1:]))
