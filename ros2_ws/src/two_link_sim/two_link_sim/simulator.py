"""Simulator node: publishes what the sensors say, takes effort commands, integrates the arm."""

import sys
import time

import numpy as np
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from pidtsm_core.node_parameters import PRIORITY, simulator_node_schema
from pidtsm_core.parameters import names, number
from pidtsm_core.plant import Plant
from pidtsm_core.robots import robot_joints
from pidtsm_core.timing import period_nanoseconds, seconds
from pidtsm_ros.diagnostics import Diagnostics, Reading, loop_readings
from pidtsm_ros.joints import MessageError
from pidtsm_ros.loop_statistics import LoopStatistics
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run
from pidtsm_ros.stamps import serialized_nanoseconds
from pidtsm_ros.wire import IncomingMessages, OutgoingMessage

_POLL = 0.02
"""s between two looks at who is connected."""
_PATIENCE = 2.0
"""s of waiting for others before the log says so."""
_LATEST_CATCH_UP = 20
"""Periods that realtime may be late before it gives up making up for them."""


class Simulator(ManagedNode):
    """The simulated arm.

    The torque of the command that answers sample k is held from sample k to k + 1. Until the first command
    arrives the arm stands on its brakes.
    """

    def __init__(self) -> None:
        super().__init__("simulator", simulator_node_schema, robot_joints)

    def configure(self) -> None:
        values = self.values
        self._joints_of_arm = list(names(values["joints"]))
        self._period = period_nanoseconds(int(number(values["rate"])))
        self._dt = seconds(self._period)
        self._samples = round(number(values["duration"]) * 1e9 / self._period)
        self._lockstep = values["clock"] == "lockstep"
        # Compile before the loop.
        Plant(values).step(Plant(values).state.effort, 0.0, self._dt)

        joints = len(self._joints_of_arm)
        self._measured = OutgoingMessage(JointState(name=self._joints_of_arm), ("position",), joints=joints)
        self._truth = OutgoingMessage(
            JointState(name=self._joints_of_arm), ("position", "velocity", "effort"), joints=joints
        )
        self._clock_message = OutgoingMessage(Clock())
        self._incoming = IncomingMessages(JointState, ("effort",), self._joints_of_arm)
        self._received = np.zeros((1, joints))
        self._statistics = LoopStatistics(number(values["diagnostics.deadline"]))

        self._joint_states = self.advertise(JointState, "joint_states")
        self._ground_truth = self.advertise(JointState, "~/ground_truth")
        if self._lockstep:
            self._clock_topic = self.advertise(Clock, "/clock")
        self._commands = self.listen(JointState, "joint_commands", self._on_command, raw=True)
        self._diagnostics = Diagnostics(self)

    @property
    def priority(self) -> int:
        return 0 if self._lockstep else int(number(self.values[PRIORITY.name]))

    def activate(self) -> None:
        self._plant = Plant(self.values)
        self._effort = self._plant.state.effort.copy()
        self._commanded = False
        self._sample = -1
        self._answered = -1
        self._waiting_since = time.monotonic()
        self._told = False
        self._skipped = 0
        self._commands_taken = 0
        self._reported = -1
        self._compute_time = 0.0
        self._statistics.reset()

    def parameters_changed(self) -> None:
        if self.active:
            self._plant.set_parameters(self.values)
            self._statistics.deadline = number(self.values["diagnostics.deadline"])

    def poll(self) -> float:
        if not self.active:
            return _POLL
        if self._diagnostics.due:
            self._publish_diagnostics()
        if self._sample < 0:
            if not self._others_ready():
                return _POLL
            self._start()
        if self._lockstep:
            self._check_silence()
            return _POLL
        return self._keep_time()

    # Start.

    def _others_ready(self) -> bool:
        wanted = number(self.values["start.subscribers"])
        listening = self._joint_states.get_subscription_count()
        commanded = self._commands.get_publisher_count()
        # In lockstep nothing goes on without a command.
        if listening >= wanted and (commanded > 0 or (wanted == 0 and not self._lockstep)):
            return True
        if not self._told and time.monotonic() - self._waiting_since > _PATIENCE:
            self._told = True
            self.get_logger().info(
                f"waiting: joint_states has {listening} of {wanted:g} subscribers, "
                f"joint_commands {commanded} publishers"
            )
        return False

    def _start(self) -> None:
        self._first_stamp = 0 if self._lockstep else time.time_ns()
        self._began = time.monotonic_ns()
        self._publish_sample(0)

    # One sample.

    def _stamp(self, sample: int) -> int:
        return self._first_stamp + sample * self._period

    def _publish_sample(self, sample: int) -> None:
        """Publish what the sensors say at this sample, and remember the truth for when its torque is known."""
        stamp = self._stamp(sample)
        self._measured.arrays[0] = self._plant.state.position
        self._sample = sample
        self._sent = time.monotonic_ns()
        self._joint_states.publish(self._measured.to_bytes(stamp))
        if self._lockstep:
            self._clock_topic.publish(self._clock_message.to_bytes(stamp))
        self._statistics.tick(self._sent, 0.0, self._compute_time)

    def _advance(self) -> None:
        """Integrate to the next sample, publish that, and the truth of the one that ends here."""
        began = time.perf_counter()
        state, truth = self._plant.state, self._truth.arrays
        truth[0] = state.position
        truth[1] = state.derivatives[0]
        ended = self._stamp(self._sample)
        self._integrate()
        truth[2] = state.effort
        self._compute_time = time.perf_counter() - began

        done = self._samples and self._sample + 1 >= self._samples
        if not done:
            self._publish_sample(self._sample + 1)
        self._ground_truth.publish(self._truth.to_bytes(ended))
        if done:
            took = (time.monotonic_ns() - self._began) / 1e9
            self.get_logger().info(
                f"done: {self._samples} samples in {took:.4f} s; "
                f"{self._skipped} skipped, {self._commands_taken} answered"
            )
            self.finished = True
            self.active = False

    def _integrate(self) -> None:
        """Move the arm over one period."""
        if self._commanded:
            self._plant.step(self._effort, seconds(self._sample * self._period), self._dt)

    def _on_command(self, data: bytes) -> None:
        stamp = serialized_nanoseconds(data)
        answered, remainder = divmod(stamp - self._first_stamp, self._period) if self._sample >= 0 else (0, 1)
        if remainder or answered > self._sample:
            raise MessageError(f"stamp {stamp} ns is that of no joint state sent")
        if answered <= self._answered:
            return  # A late reply to a sample that is past.
        self._incoming.read(data, self._received)
        self._effort[:] = self._received[0]
        self._answered = answered
        self._commands_taken += 1
        self._commanded = True
        if self._lockstep and answered == self._sample:
            self._advance()

    # Clocks.

    def _keep_time(self) -> float:
        """Realtime: advance when the next sample is due; returns the time until the next one, in s.

        A sample that was late is followed by the next after half a period at the earliest, so that lateness is made
        up for and no burst meets the others. Beyond `_LATEST_CATCH_UP` the samples that nobody took are skipped:
        the arm moves on under the torque it has, as one of steel does.
        """
        now = time.monotonic_ns()
        due = self._began + (self._sample + 1) * self._period
        earliest = self._sent + self._period // 2
        if now >= due and now >= earliest:
            late = (now - due) // self._period
            if late > _LATEST_CATCH_UP:
                self._skip(late)
            self._advance()
            now = time.monotonic_ns()
            due = self._began + (self._sample + 1) * self._period
            earliest = self._sent + self._period // 2
        return max(0, due - now, earliest - now) / 1e9

    def _skip(self, samples: int) -> None:
        """Let samples pass without telling anybody."""
        for _ in range(min(samples, self._samples - 2 - self._sample) if self._samples else samples):
            self._integrate()
            self._sample += 1
            self._skipped += 1

    def _check_silence(self) -> None:
        """Lockstep: a command that does not come ends the run, with the name of who is silent."""
        timeout = number(self.values["lockstep.timeout"])
        if time.monotonic_ns() - self._sent <= timeout * 1e9:
            return
        writers = [
            f"{i.node_namespace.rstrip('/')}/{i.node_name}"
            for i in self.get_publishers_info_by_topic(self._commands.topic_name)
        ]
        who = f"{', '.join(writers)} is silent" if writers else "no node publishes joint_commands any more"
        self.get_logger().fatal(
            f"no command for t = {seconds(self._sample * self._period):g} s within {timeout:g} s: {who}"
        )
        self.finished = self.failed = True

    def _publish_diagnostics(self) -> None:
        idle = ""
        if self._sample < 0:
            idle = "waiting for the others"
        elif self._sample == self._reported:
            idle = "no sample for a second"
        self._reported = self._sample
        readings = [
            *loop_readings(self._statistics, judged=not self._lockstep),
            Reading("samples", self._sample + 1),
            Reading("samples skipped", self._skipped),
            Reading("samples since the last command's", self._sample - self._answered),
        ]
        self._diagnostics.publish(readings, idle)


def main() -> None:
    """Entry point of ``ros2 run two_link_sim simulator``."""
    sys.exit(run([Simulator]))
