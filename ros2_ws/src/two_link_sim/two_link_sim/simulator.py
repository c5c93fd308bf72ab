"""Simulator node: publishes what the sensors say, takes effort commands, integrates the arm."""

import sys
import time

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from pidtsm_core.node_parameters import simulator_node_schema
from pidtsm_core.parameters import names, number
from pidtsm_core.plant import Plant
from pidtsm_core.robots import robot_joints
from pidtsm_core.timing import period_nanoseconds, seconds
from pidtsm_ros.joints import JointOrder, MessageError, joint_field
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run
from pidtsm_ros.stamps import nanoseconds, set_stamp

_POLL = 0.02
"""s between two looks at who is connected."""
_PATIENCE = 2.0
"""s of waiting for others before the log says so."""
_LATEST_CATCH_UP = 5
"""Periods that realtime may be late before it gives up catching up."""


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
        self._order = JointOrder(self._joints_of_arm)
        self._period = period_nanoseconds(int(number(values["rate"])))
        self._dt = seconds(self._period)
        self._samples = round(number(values["duration"]) * 1e9 / self._period)
        self._lockstep = values["clock"] == "lockstep"
        # Compile before the loop.
        Plant(values).step(Plant(values).state.effort, 0.0, self._dt)

        joints = len(self._joints_of_arm)
        self._measured = JointState(name=self._joints_of_arm)
        self._measured_position = joint_field(self._measured, "position", joints)
        self._truth = JointState(name=self._joints_of_arm)
        self._true_position = joint_field(self._truth, "position", joints)
        self._true_velocity = joint_field(self._truth, "velocity", joints)
        self._applied_effort = joint_field(self._truth, "effort", joints)
        self._clock_message = Clock()

        self._joint_states = self.advertise(JointState, "joint_states")
        self._ground_truth = self.advertise(JointState, "~/ground_truth")
        if self._lockstep:
            self._clock_topic = self.advertise(Clock, "/clock")
        self._commands = self.listen(JointState, "joint_commands", self._on_command)

    def activate(self) -> None:
        self._plant = Plant(self.values)
        self._effort = self._plant.state.effort.copy()
        self._received = self._effort.copy()
        self._commanded = False
        self._sample = -1
        self._answered = -1
        self._waiting_since = time.monotonic()
        self._told = False

    def parameters_changed(self) -> None:
        if self.active:
            self._plant.set_parameters(self.values)

    def poll(self) -> float:
        if not self.active:
            return _POLL
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
        self._began = time.monotonic()
        self._deadline = time.monotonic_ns()
        self._publish_sample(0)

    # One sample.

    def _stamp(self, sample: int) -> int:
        return self._first_stamp + sample * self._period

    def _publish_sample(self, sample: int) -> None:
        """Publish what the sensors say at this sample, and remember the truth for when its torque is known."""
        state = self._plant.state
        self._measured_position[:] = state.position
        set_stamp(self._measured.header.stamp, self._stamp(sample))
        self._sample = sample
        self._sent = time.monotonic()
        self._joint_states.publish(self._measured)
        if self._lockstep:
            self._clock_message.clock = self._measured.header.stamp
            self._clock_topic.publish(self._clock_message)

    def _advance(self) -> None:
        """Integrate to the next sample, publish that, and the truth of the one that ends here."""
        state = self._plant.state
        self._true_position[:] = state.position
        self._true_velocity[:] = state.derivatives[0]
        set_stamp(self._truth.header.stamp, self._stamp(self._sample))
        if self._commanded:
            self._plant.step(self._effort, seconds(self._sample * self._period), self._dt)
        self._applied_effort[:] = state.effort

        done = self._samples and self._sample + 1 >= self._samples
        if not done:
            self._publish_sample(self._sample + 1)
        self._ground_truth.publish(self._truth)
        if done:
            took = time.monotonic() - self._began
            self.get_logger().info(f"done: {self._samples} samples in {took:.1f} s")
            self.finished = True
            self.active = False

    def _on_command(self, command: JointState) -> None:
        stamp = nanoseconds(command.header.stamp)
        answered, remainder = divmod(stamp - self._first_stamp, self._period) if self._sample >= 0 else (0, 1)
        if remainder or answered > self._sample:
            raise MessageError(f"stamp {stamp} ns is that of no joint state sent")
        if answered <= self._answered:
            return  # A late reply to a sample that is past.
        self._order.read(command.name, command.effort, "effort", self._received)
        self._effort[:] = self._received
        self._answered = answered
        self._commanded = True
        if self._lockstep and answered == self._sample:
            self._advance()

    # Clocks.

    def _keep_time(self) -> float:
        """Realtime: advance when the next sample is due; returns the time until the next one, in s."""
        now = time.monotonic_ns()
        if now >= self._deadline + self._period:
            self._deadline += self._period
            if now - self._deadline > _LATEST_CATCH_UP * self._period:
                self._deadline = now
            self._advance()
            now = time.monotonic_ns()
        return max(0.0, (self._deadline + self._period - now) / 1e9)

    def _check_silence(self) -> None:
        """Lockstep: a command that does not come ends the run, with the name of who is silent."""
        timeout = number(self.values["lockstep.timeout"])
        if time.monotonic() - self._sent <= timeout:
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


def main() -> None:
    """Entry point of ``ros2 run two_link_sim simulator``."""
    sys.exit(run(Simulator))
