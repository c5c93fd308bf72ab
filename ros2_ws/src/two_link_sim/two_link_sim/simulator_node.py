"""Simulator node: publishes sensor readings, receives effort commands, integrates the arm."""

import time

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from pidtsm_core.experiment.node_parameters import FRAME_PREFIX, simulator_node_schema
from pidtsm_core.parameters import as_float, names
from pidtsm_core.parameters.joints import JointOrder
from pidtsm_core.robots import find_robot, robot_joints
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_core.timing import period_nanoseconds, seconds
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.diagnostics import Diagnostics, Reading, loop_readings
from pidtsm_ros.effort_topics import EFFORT_TOPICS
from pidtsm_ros.loop_statistics import LoopStatistics
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run_nodes
from pidtsm_ros.qos import RELIABLE_READER
from pidtsm_ros.stop import Stop
from pidtsm_ros.wire import IncomingMessages, OutgoingMessage
from two_link_sim import pushes
from two_link_sim.brake_log import BrakeLog
from two_link_sim.gripper import SimulatedGripper
from two_link_sim.joint_states import Drives
from two_link_sim.progress import Commands, Progress, Waiting
from two_link_sim.pushes import Pushes
from two_link_sim.touches import Touches

_POLL = 0.02
"""Time between two checks of the connections, s."""
_LATEST_CATCH_UP = 20
"""Periods that realtime may be late; beyond that, samples are skipped instead of made up for."""
_REPEAT_AFTER = 1.0
"""In lockstep, the very first sample is repeated after this time without a command, s. The controller may not be
connected or active yet."""
_UNANSWERED = 5
"""In realtime, the very first sample is repeated after this many periods without a command. The first command takes
longer than others, and a controller needs a recent joint state to become active (``watchdog.state_stop``)."""
_LONGEST_SILENCE = 1000
"""Samples without a measurement that lockstep simulates before the executor handles other events."""


class SimulatorNode(ManagedNode):
    """The simulated arm.

    The torque of the command for sample k is held from sample k to k + 1. Until the first command arrives, the brakes
    are engaged and time does not advance, unless ``start.subscribers`` is 0: the joint state is published again, in
    realtime every few periods with a new stamp. In realtime, the brakes are also engaged if commands are missing
    (``command.timeout``), and a command with the same stamp as the last one replaces it.

    Sensors, delays, losses and motors are those of `SimulatedRobot`: the stamp of a joint state is the time of its
    acquisition, and lost joint states are not published.
    """

    def __init__(self, stop: Stop) -> None:
        super().__init__("simulator", simulator_node_schema, robot_joints, stop)

    def configure(self) -> None:
        values = self.values
        self._joints_of_arm = list(names(values["joints"]))
        self._period = period_nanoseconds(int(as_float(values["rate"])))
        self._samples = round(as_float(values["duration"]) * 1e9 / self._period)
        # Compile before the loop.
        robot = SimulatedRobot(values, accelerations=False)
        robot.compile()
        # First, since a recorder looks for them when it has found the others.
        self._touches = Touches(self, robot.touchable)

        joints = len(self._joints_of_arm)
        self._gripper = SimulatedGripper(self)
        self._drives = Drives(values, self._joints_of_arm, self._gripper.gripper)
        self._truth = OutgoingMessage(
            JointState(name=self._joints_of_arm), ("position", "velocity", "effort"), joints=joints
        )
        self._clock_message = OutgoingMessage(Clock())
        self._order = JointOrder(self._joints_of_arm)
        self._incoming = IncomingMessages(JointState, ("effort",), self._joints_of_arm)
        self._received = np.zeros((1, joints))
        self._statistics = LoopStatistics(as_float(values["diagnostics.deadline"]))

        self._joint_states = self.advertise(JointState, "joint_states")
        self.watch_publishers("joint_states")
        self._ground_truth = self.advertise(JointState, "~/ground_truth")
        if self.lockstep:
            self._clock_topic = self.advertise(Clock, "/clock")
        self._input = EFFORT_TOPICS[str(values["input.type"])]
        self._stamped = self._input.message_type is JointState
        on_command = self._on_command if self._stamped else self._on_array
        self._subscription = self.listen(
            self._input.message_type, self._input.name, on_command, raw=self._stamped, one_publisher=True
        )
        self._diagnostics = Diagnostics(self)
        self._pushes = Pushes(f"{values[FRAME_PREFIX.name]}{find_robot(values).base}", self._period)
        self.listen(WrenchStamped, pushes.TOPIC, self._pushes.take, profile=RELIABLE_READER)
        self.offer("~/reset", self._reset)

    @property
    def lockstep(self) -> bool:
        return self.values["clock"] == "lockstep"

    def activate(self) -> None:
        self._robot = SimulatedRobot(self.values, accelerations=False)
        self._effort = np.zeros(self._robot.joints)
        self._drives.reset()
        self._gripper.parameters_changed()
        self._progress, self._commands = Progress(), Commands()
        self._brakes, self._waiting = BrakeLog(), Waiting()
        self._statistics.reset()

    def parameters_changed(self) -> None:
        if self.active:
            self._robot.set_parameters(self.values)
            self._gripper.parameters_changed()
            self._statistics.deadline = as_float(self.values["diagnostics.deadline"])

    def poll(self) -> float:
        if not self.active:
            return _POLL
        if self._diagnostics.due:
            self.diagnose()
        if self._progress.sample < 0:
            if not self._others_ready():
                return _POLL
            self._start()
        if not self.lockstep:
            return self._keep_time()
        if not self._progress.awaits_command:
            self._go_on()
            return 0.0
        self._check_silence()
        return _POLL

    # Start.

    def _others_ready(self) -> bool:
        wanted = as_float(self.values["start.subscribers"])
        listening = self._joint_states.get_subscription_count()
        commanded = self._subscription.get_publisher_count()
        # Lockstep cannot continue without a command.
        connected = listening >= wanted and (commanded > 0 or (wanted == 0 and not self.lockstep))
        if self._waiting.settled(connected) or (connected and (self.lockstep or wanted == 0)):
            return True
        if not connected:
            self._log_waiting(
                f"joint_states has {listening} of {wanted:g} subscribers, {self._input.name} {commanded} publishers"
            )
        return False

    def _log_waiting(self, what: str) -> None:
        """Log at intervals what the simulator is waiting for."""
        if self._waiting.reminds():
            self.get_logger().info(f"waiting: {what}")

    @property
    def _awaits_first(self) -> bool:
        """Whether the simulator waits for the very first command."""
        return not self._commands.begun and (self.lockstep or as_float(self.values["start.subscribers"]) > 0)

    def _repeat_sample(self, later: int) -> None:
        """Realtime: publish the sample that has received no command again, so many periods later."""
        self._progress.began += later * self._period
        self._progress.first_stamp += later * self._period
        # A command for any of the repetitions is accepted.
        self._commands.answered -= later
        self._publish_sample(self._progress.sample)
        self._log_waiting(f"no command on {self._input.name} so far; is a controller active?")

    def _start(self) -> None:
        self._progress.first_stamp = 0 if self.lockstep else time.time_ns()
        self._progress.began = time.monotonic_ns()
        self._waiting = Waiting()
        self._publish_sample(0)

    # One sample.

    def _stamp(self, sample: int) -> int:
        return self._progress.first_stamp + sample * self._period

    def _publish_sample(self, sample: int) -> None:
        """Publish the measurement that becomes available at this sample, if any."""
        acquired, measured = self._robot.sense(sample)
        progress = self._progress
        progress.awaits_command = acquired >= 0
        progress.sample = sample
        progress.sent = time.monotonic_ns()
        if progress.awaits_command:
            progress.acquired = acquired
            self._drives.measure(acquired * self._period, measured, self._robot.applied)
            self._joint_states.publish(self._drives.to_bytes(self._stamp(acquired)))
        if self.lockstep:
            self._clock_topic.publish(self._clock_message.to_bytes(self._stamp(sample)))
        self._statistics.tick(progress.sent, 0.0, progress.compute_time)

    def _advance(self) -> None:
        """Integrate to the next sample and publish it, then the ground truth of the completed one."""
        began = time.perf_counter()
        arm, truth = self._robot.state.arm, self._truth.arrays
        truth[0] = arm.position
        truth[1] = arm.derivatives[0]
        ended = self._stamp(self._progress.sample)
        self._act()
        truth[2] = arm.effort
        self._progress.compute_time = time.perf_counter() - began

        done = self._samples and self._progress.sample + 1 >= self._samples
        if not (done or self.failed):
            self._publish_sample(self._progress.sample + 1)
        self._ground_truth.publish(self._truth.to_bytes(ended))
        if self._touches:
            self._touches.publish(self._robot.contacts(), ended)
        if done:
            took = (time.monotonic_ns() - self._progress.began) / 1e9
            self.get_logger().info(
                f"done: {self._samples} samples in {took:.4f} s; "
                f"{self._progress.skipped} skipped, {self._commands.count} answered"
            )
            self.diagnose()
            self.finished = True
            self.active = False

    def _go_on(self) -> None:
        """Lockstep: advance to the next sample with a measurement."""
        for _ in range(_LONGEST_SILENCE):
            self._advance()
            if self._progress.awaits_command or self.finished:
                break

    def _act(self) -> None:
        """Move the arm over one period."""
        commanded, self._commands.new = self._commands.new, False
        self._pushes.act(self._robot)
        sample = self._progress.sample
        self._gripper.advance(seconds(sample * self._period), seconds(self._period), self._stamp(sample))
        self._robot.act(self._progress.sample, commanded, self._effort)
        if self._robot.diverged:
            self._start_again()
        # Before the first command, the brakes are always engaged.
        if self._robot.silence and self._brakes.changes(self._robot.braked):
            self._log_brakes()

    def _start_again(self) -> None:
        """Put a diverged arm back to its start; a run in lockstep ends, as a rollout does."""
        self._robot.reset(self.values)
        self._drives.reset()
        reason = (
            f"the arm moved too fast to be simulated at rate = {self.values['rate']}, and diverged after "
            f"{seconds(self._progress.sample * self._period):g} s"
        )
        if self.lockstep:
            self.get_logger().fatal(reason)
            self.finished = self.failed = True
        elif self._progress.diverged.begins():
            self.get_logger().error(f"{reason}; it is at its initial position again, at rest")

    def _log_brakes(self) -> None:
        """Log that the brakes were engaged for lack of commands, or released."""
        if self._brakes.engaged:
            silence = seconds(self._robot.silence * self._period)
            self.get_logger().warning(f"no command for {silence:.3g} s (command.timeout): the brakes stop the arm")
        else:
            self.get_logger().info("command received: brakes released")

    def _on_command(self, data: bytes) -> None:
        progress, commands, stamp = self._progress, self._commands, serialized_nanoseconds(data)
        answered, remainder = divmod(stamp - progress.first_stamp, self._period) if progress.sample >= 0 else (0, 1)
        if remainder or answered > progress.acquired:
            self.rejected += 1
            if commands.unknown.begins():
                self.get_logger().error(f"rejected {self._input.name}: no joint state with this stamp was sent")
        elif answered > commands.answered or (answered == commands.answered and self._replaceable):
            self._incoming.read(data, self._received)
            self._take(answered)
        elif commands.stale.begins():
            self.get_logger().warning(f"ignored {self._input.name}: a command for this or a later joint state was used")

    @property
    def _replaceable(self) -> bool:
        """Realtime: like real drives, use the newest torque, even without a new joint state."""
        return not self.lockstep and self._commands.begun

    def _on_array(self, message: Float64MultiArray) -> None:
        """Take a command without a stamp as one for the last joint state; in lockstep only if that waits for one."""
        if self._progress.sample < 0 or (self.lockstep and self._commands.answered == self._progress.acquired):
            return
        self._order.read(self._joints_of_arm, message.data, self._input.field, self._received[0])
        self._take(self._progress.acquired)

    def _take(self, answered: int) -> None:
        """Use the received torques as the command for this sample."""
        self._effort[:] = self._received[0]
        commands = self._commands
        commands.begun = commands.new = True
        commands.count += answered > max(commands.answered, -1)
        commands.answered = answered
        if self.lockstep and answered == self._progress.acquired:
            self._go_on()

    # Clocks.

    def _keep_time(self) -> float:
        """Realtime: advance when the next sample is due; returns the time until the next one, s.

        After a late sample, the next one follows after at least half a period. This makes up for the delay without
        sending a burst to the other nodes. Beyond `_LATEST_CATCH_UP` the overdue samples are skipped: like a real arm,
        the simulated one keeps moving under its last torque, and its brakes engage in time.
        """
        now, due, progress = time.monotonic_ns(), self._due(), self._progress
        earliest = progress.sent + self._period // 2
        if now >= due and now >= earliest:
            late = (now - due) // self._period
            if progress.awaits_command and self._awaits_first:
                self._repeat_sample(_UNANSWERED + late)
            else:
                if late > _LATEST_CATCH_UP:
                    self._skip(late)
                self._advance()
            now, due = time.monotonic_ns(), self._due()
            earliest = progress.sent + self._period // 2
        return max(0, due - now, earliest - now) / 1e9

    def _due(self) -> int:
        """When to publish the next sample, or to repeat the first; ns of the monotonic clock."""
        periods = _UNANSWERED if self._progress.awaits_command and self._awaits_first else 1
        return self._progress.began + (self._progress.sample + periods) * self._period

    def _reset(self) -> str:
        """Put the arm back to its initial position; returns the reason if refused, else an empty text."""
        if not self.active:
            return "the simulator is not active"
        self._robot.reset(self.values)
        self._drives.reset()
        self.get_logger().info("reset: the arm is at its initial position, at rest")
        return ""

    def _skip(self, samples: int) -> None:
        """Simulate samples without publishing them."""
        for _ in range(min(samples, self._samples - 2 - self._progress.sample) if self._samples else samples):
            self._act()
            self._progress.sample += 1
            self._progress.skipped += 1
            self._robot.sense(self._progress.sample)

    def _check_silence(self) -> None:
        """Lockstep: end the run if a command is missing, and name its publisher; only the first command may be late."""
        now = time.monotonic_ns()
        if self._awaits_first:
            self._log_waiting(f"no command on {self._input.name} so far; is a controller active?")
            # Not for arrays: without a stamp, it is unknown which of the repetitions they belong to.
            if self._stamped and now - self._progress.sent > _REPEAT_AFTER * 1e9:
                self._progress.sent = now
                self._joint_states.publish(self._drives.to_bytes(self._stamp(self._progress.acquired)))
            return
        timeout = as_float(self.values["lockstep.timeout"])
        if now - self._progress.sent <= timeout * 1e9:
            return
        writers = [
            f"{i.node_namespace.rstrip('/')}/{i.node_name}"
            for i in self.get_publishers_info_by_topic(self._subscription.topic_name)
        ]
        who = f"{', '.join(writers)} did not respond" if writers else f"no node publishes {self._input.name} any more"
        self.get_logger().fatal(
            f"no command for t = {seconds(self._progress.acquired * self._period):g} s within {timeout:g} s: {who}"
        )
        self.finished = self.failed = True

    def diagnose(self) -> None:
        idle = ""
        if self._progress.sample < 0:
            idle = "waiting for the other nodes"
        elif self._awaits_first:
            idle = "waiting for the first command"
        elif self._brakes.engaged:
            idle = "brakes engaged: no command for longer than command.timeout"
        elif self._progress.sample == self._progress.reported:
            idle = "no sample for a second"
        self._progress.reported = self._progress.sample
        readings = [
            *loop_readings(self._statistics, judged=not self.lockstep),
            Reading("samples", self._progress.sample + 1),
            Reading("samples skipped", self._progress.skipped),
            Reading("stops by the brakes since activation", self._brakes.count),
            Reading("divergences since activation", self._progress.diverged.count),
            Reading("samples since that of the last command", self._progress.sample - self._commands.answered),
            Reading("commands ignored for a stale stamp since activation", self._commands.stale.count),
            Reading("commands rejected for an unknown stamp since activation", self._commands.unknown.count),
        ]
        self._diagnostics.publish(readings, idle, scale=self._statistics.scale)


def run(stop: Stop) -> int:
    """``ros2 run two_link_sim simulator``; returns the exit code."""
    return run_nodes([SimulatorNode], stop)
