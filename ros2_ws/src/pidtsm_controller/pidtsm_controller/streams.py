"""Streams of targets that the trajectory node follows, from teleoperation or a learned policy."""

from collections.abc import Callable

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from pidtsm_controller.trajectory_points import joint_values, places, read_points
from pidtsm_core.arrays import Array
from pidtsm_core.parameters import as_float
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.timing import NANOSECONDS, seconds
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.splice import MotionUnderWay
from pidtsm_core.trajectories.streams import BLEND, StreamFilter
from pidtsm_ros.diagnostics import Reading
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import nanoseconds

_DEPTH = 10
"""Queue length: old targets are useless."""
_PAUSE = NANOSECONDS // 2
"""A stream that another motion has replaced must pause so long before it is followed again, ns."""
TARGET, CHUNK, ARRAY = "~/joint_target", "~/joint_target_trajectory", "~/joint_target_array"


class Streams:
    """Receives targets on ``~/joint_target`` and ``~/joint_target_array``, and chunks on ``~/joint_target_trajectory``.

    The first target of a stream takes over from any motion; another motion takes over from a stream, whose further
    targets are then rejected until it has paused.

    Attributes:
        stopped: that the stream has stopped, for diagnostics; empty if it has not, or another motion has followed.
        source: topic of the last target that was accepted; what other topics have begun is over.
    """

    def __init__(self, node: ManagedNode, limits: MotionLimits, replace: Callable[[str], None]) -> None:
        """Subscribe.

        Args:
            node: the trajectory node, while it is configured.
            limits: of the arm.
            replace: called with what takes over from the motion, before a stream does.
        """
        self._node, self._log, self._replace = node, node.get_logger(), replace
        self._joints, self._filter = limits.joints, StreamFilter(limits)
        self._motion: MotionUnderWay | None = None
        self._now = self._received = 0  # ns
        self._busy = self._gave_way = False
        self._warned = ""
        self.stopped = self.source = ""
        node.listen(JointState, TARGET, self._on_target, depth=_DEPTH)
        node.listen(JointTrajectory, CHUNK, self._on_chunk, depth=_DEPTH)
        node.listen(Float64MultiArray, ARRAY, self._on_array, depth=_DEPTH)

    def advance(self, now: int, motion: MotionUnderWay, busy: bool) -> None:
        """Move on; call before the reference of `now` is evaluated.

        Args:
            now: stamp of the joint state, ns.
            motion: of the node; it comes to rest if the stream has stopped.
            busy: whether a goal is planned or followed; a stream under way then gets no more targets.
        """
        self._now, self._motion, self._busy = now, motion, busy
        if not self._filter.running:
            return
        if motion.current is not self._filter:
            self._filter.end()
            self._gave_way = True
            return
        if busy or self._gave_way:
            self._filter.freeze()
        self._filter.advance(now)
        if self._filter.ended(now) and not self._gave_way:
            motion.cancel(now)
            self._filter.end()
            self.stopped = "the stream of targets has stopped"
            self._log.info(f"{self.stopped}: coming to rest")

    def give_way(self) -> None:
        """Another motion takes over, now or later; until then the last targets count."""
        self._gave_way, self.stopped = True, ""

    def forget(self) -> None:
        """The clock was set, or the node is active again: no motion and no time from before counts."""
        self._filter.end()
        self._motion, self.stopped, self._gave_way = None, "", False

    def readings(self) -> list[Reading]:
        """How the stream arrives; empty before the first target."""
        statistics = self._filter.statistics(self._now)
        if not statistics.received:
            return []
        return [
            Reading("stream: rate", statistics.rate, "1/s"),
            Reading("stream: delay of the reference", statistics.delay, "s"),
            Reading("stream: age of the last target", statistics.age, "s"),
            Reading("stream: targets used", statistics.received),
            Reading("stream: targets missing", statistics.missing),
            Reading("stream: targets beyond a position limit", statistics.clipped),
        ]

    def held(self) -> Array:
        """The last target, or else where the motion is, shape (joints,), rad or m.

        Raises:
            MessageError: no joint state has come yet.
        """
        if self._motion is None:
            raise MessageError("no joint state received yet, so the start time is unknown")
        return self._filter.targets(self._motion.state_at(self._now)[0])

    @property
    def following(self) -> bool:
        """Whether a stream is under way."""
        return self._filter.running and not self._gave_way

    def take_position(self, stamp: int, position: Array) -> None:
        """Follow a target of all joints.

        Args:
            stamp: time of the target on any clock, ns; 0: unknown.
            position: shape (joints,), rad or m.

        Raises:
            MessageError: it cannot be used.
        """
        self._take(lambda: self._filter.receive(self._now, stamp, position), self.source)

    def _on_target(self, message: JointState) -> None:
        columns = places(message.name, self._joints, partial=True)
        targets = np.zeros((2, len(self._joints)))
        targets[0] = self.held()
        for row, field in zip(targets, ("position", "velocity"), strict=True):
            given = getattr(message, field)
            if field == "position" or len(given):
                row[columns] = joint_values(field, given, columns.size)
        velocity, stamp = targets[1] if len(message.velocity) else None, nanoseconds(message.header.stamp)
        self._take(lambda: self._filter.receive(self._now, stamp, targets[0], velocity), TARGET)

    def _on_array(self, message: Float64MultiArray) -> None:
        """A target of all joints in the order of the node."""
        held = self.held()
        position = joint_values("data", message.data, held.size)
        distance, tolerance = np.abs(position - held), as_float(self._node.values["start_tolerance"])
        if not self.following and distance.max() > tolerance:  # Without names, nothing else tells what they are.
            raise MessageError(
                f"the first target is too far from the reference of {self._joints[int(distance.argmax())]}; at most "
                f"{tolerance:g} is allowed (start_tolerance): send positions, not velocities, in the order "
                f"{', '.join(self._joints)}"
            )
        self._take(lambda: self._filter.receive(self._now, 0, position), ARRAY)

    def _on_chunk(self, message: JointTrajectory) -> None:
        if not message.points:
            raise MessageError("it has no points")
        columns = places(message.joint_names, self._joints, partial=True)
        times, given = read_points(message)
        positions = np.tile(self.held(), (len(times), 1))
        positions[:, columns] = given[:, 0]
        start = nanoseconds(message.header.stamp)
        if len(times) == 1 and 0.0 <= times[0] < BLEND:  # Too short to take over as a chunk: a target.
            stamp = start + round(times[0] * NANOSECONDS) if start else 0
            velocity = None
            if given.shape[1] > 1:
                velocity = np.zeros(len(self._joints))
                velocity[columns] = given[0, 1]
            self._take(lambda: self._filter.receive(self._now, stamp, positions[0], velocity), CHUNK)
            return
        self._take(lambda: self._filter.receive_chunk(self._now, start, times, positions), CHUNK)

    def _take(self, receive: Callable[[], str], source: str) -> None:
        """Follow what is received from a topic, if it can be used."""
        assert self._motion is not None
        paused, self._received = self._now - self._received > _PAUSE, self._now
        if (self._busy and self._filter.running) or (self._gave_way and not paused):
            raise MessageError(
                f"another motion has taken over; the stream is followed again after a pause of {seconds(_PAUSE):g} s"
            )
        self._gave_way = False  # Also if this target cannot be used: the stream has paused.
        try:
            warning = receive()
        except TrajectoryError as error:
            raise MessageError(str(error)) from None
        self.stopped, self.source = "", source
        if warning and warning != self._warned:
            self._warned = warning
            self._log.warning(warning)
        if not self._filter.running:
            self._replace("a stream of targets")
            self._filter.begin(self._now, self._motion.state_at(self._now))
            self._motion.replace(self._filter, self._now, self._now)
            self._motion.evaluate(self._now, np.empty((3, len(self._joints))))
            self._log.info("following a stream of targets")
