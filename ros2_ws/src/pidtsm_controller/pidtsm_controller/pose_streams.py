"""Streams of poses and twists of the tool, which become streams of targets of the joints."""

from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped

from pidtsm_controller.planning_thread import planning_thread
from pidtsm_controller.streams import Streams
from pidtsm_controller.transforms import Transforms
from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import FRAME_PREFIX
from pidtsm_core.parameters import ParameterError, Value, as_float
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.poses.following import PoseTarget, ToolFollower, TwistTarget, explain
from pidtsm_core.poses.frames import Frames
from pidtsm_core.poses.kinematics import Distance, ToolKinematics
from pidtsm_core.poses.parameters import ANGULAR_VELOCITY, TOOL_FRAME, TWIST_TIMEOUT, VELOCITY
from pidtsm_core.poses.pose import read_pose, read_vector
from pidtsm_core.robots import DESCRIPTION, OF_ARM, find_robot
from pidtsm_core.timing import NANOSECONDS, seconds
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_ros.diagnostics import Reading
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import nanoseconds

POSE, TWIST = "~/pose_target", "~/twist_target"
_DEPTH = 10
"""Queue length: old targets are useless."""
_WAITING = 4
"""Number of targets that wait for the thread; of more, the oldest are skipped."""
_TICK = NANOSECONDS // 100
"""Time between two targets of a twist, ns."""
_FIRST, _SHORTEST, _LONGEST = 0.02, 1e-3, 0.1
"""Time that a target stands for: of the first one, the shortest and the longest, s."""
_PATIENCE = NANOSECONDS // 2
"""Time after which a tool that is off its target is reported, ns."""


class _Waiting(NamedTuple):
    """A target that waits for the thread."""

    topic: str
    target: PoseTarget | TwistTarget
    stamp: int  # ns; 0: none
    duration: float  # s


class PoseStreams:
    """Receives poses on ``~/pose_target`` and twists on ``~/twist_target``; a thread finds the joints.

    The last of them counts, whichever it is. The joints follow as they follow a stream on ``~/joint_target``. In
    lockstep time waits for the thread.
    """

    def __init__(self, node: ManagedNode, limits: MotionLimits, streams: Streams, values: Mapping[str, Value]) -> None:
        """Subscribe, and build the model of the arm.

        Args:
            node: the trajectory node, while it is configured.
            limits: of the arm.
            streams: follow the targets of the joints.
            values: parameters of the node.
        """
        self._node, self._streams = node, streams
        self._follower, self._missing = _follower(limits, values)
        self._timeout = round(as_float(values[TWIST_TIMEOUT.name]) * NANOSECONDS)
        self._thread = planning_thread("poses")
        self._transforms = Transforms(node, self._follower.frames) if self._follower else None
        self._waiting: deque[_Waiting] = deque()
        self._job: tuple[_Waiting, Future[tuple[Array, Distance]]] | None = None
        self._twist: TwistTarget | None = None
        self._now = self._last = self._twist_came = self._off_since = 0  # ns
        self._left: Distance | None = None
        self._reported = ""
        self._skipped = 0
        node.listen(PoseStamped, POSE, self._on_pose, depth=_DEPTH)
        node.listen(TwistStamped, TWIST, self._on_twist, depth=_DEPTH)

    def destroy(self) -> None:
        """End the thread."""
        self._thread.shutdown(cancel_futures=True)
        if self._transforms is not None:
            self._transforms.destroy()

    def forget(self) -> None:
        """Targets that have not been followed do not count any more."""
        self._waiting.clear()
        self._job, self._twist, self._left, self._reported = None, None, None, ""

    def advance(self, now: int) -> None:
        """Move on; call before the stream of the joints does.

        Args:
            now: stamp of the joint state, ns.
        """
        self._now = now
        if self._twist is not None and (now - self._twist_came > self._timeout or self._streams.source != TWIST):
            self._twist = None
        if self._twist is not None and now - self._last >= _TICK:
            self._add(_Waiting(TWIST, self._twist, now, self._since(now)), now)
        while self._job is not None or self._waiting:
            if self._job is None:
                self._job = self._begin(self._waiting.popleft())
            if not (self._node.lockstep or self._job[1].done()):
                break
            job, self._job = self._job, None
            try:
                position, self._left = job[1].result()
                self._streams.take_position(job[0].stamp, position)
            except (MessageError, TrajectoryError) as error:
                self._node.reject(f"{job[0].topic}: {error}")
        self._report()

    def readings(self) -> list[Reading]:
        """How far the tool is from its target; empty before the first one."""
        if self._left is None or not self._streams.following:
            return []
        return [
            Reading("poses: distance to the target", self._left.position, "m"),
            Reading("poses: angle to the target", self._left.angle, "rad"),
            Reading("poses: targets skipped", self._skipped),
        ]

    def _begin(self, waiting: _Waiting) -> tuple[_Waiting, "Future[tuple[Array, Distance]]"]:
        """Let the thread find the joints."""
        assert self._follower is not None
        position = self._streams.held()
        if not self._streams.following:
            self._follower.begin(position)
            self._off_since = self._now
        return waiting, self._thread.submit(self._follower.follow, position, waiting.target, waiting.duration)

    def _on_pose(self, message: PoseStamped) -> None:
        self._check()
        p, o = message.pose.position, message.pose.orientation
        try:
            pose = read_pose((p.x, p.y, p.z), (o.x, o.y, o.z, o.w))
        except TrajectoryError as error:
            raise MessageError(str(error)) from None
        self._twist, stamp = None, nanoseconds(message.header.stamp)
        self._streams.source = POSE
        self._add(_Waiting(POSE, PoseTarget(message.header.frame_id, pose), stamp, self._since(self._now)), self._now)

    def _on_twist(self, message: TwistStamped) -> None:
        self._check()
        linear, angular = message.twist.linear, message.twist.angular
        try:
            of_origin = read_vector("linear", (linear.x, linear.y, linear.z))
            turning = read_vector("angular", (angular.x, angular.y, angular.z))
        except TrajectoryError as error:
            raise MessageError(str(error)) from None
        self._twist = TwistTarget(message.header.frame_id, of_origin, turning)
        self._twist_came, self._streams.source = self._now, TWIST

    def _check(self) -> None:
        """Check that targets can be followed.

        Raises:
            MessageError: it is not known where the tool is, or where the arm is.
        """
        if self._follower is None:
            raise MessageError(self._missing)
        self._streams.held()

    def _since(self, now: int) -> float:
        """Time that a target stands for, s."""
        if not self._streams.following or now - self._last > _LONGEST * NANOSECONDS:
            return _FIRST
        return max(seconds(now - self._last), _SHORTEST)

    def _add(self, waiting: _Waiting, now: int) -> None:
        if len(self._waiting) == _WAITING:
            self._waiting.popleft()
            self._skipped += 1
        self._waiting.append(waiting)
        self._last = now

    def _report(self) -> None:
        """Log that the tool is off its target, and that it is there again."""
        if self._left is None:
            return
        off = explain(self._left) if self._streams.following else ""
        if not off:
            self._off_since = self._now
            if self._reported and self._streams.following:
                self._node.get_logger().info("the tool is at its target again")
            self._reported = ""
        elif not self._reported and self._now - self._off_since > _PATIENCE:
            self._reported = off
            distance = f"{1e3 * self._left.position:.0f} mm and {np.degrees(self._left.angle):.0f} degrees"
            self._node.get_logger().warning(f"the tool is {distance} from its target: {off}")


def _follower(limits: MotionLimits, values: Mapping[str, Value]) -> tuple[ToolFollower | None, str]:
    """What finds the joints; None, and the reason, if that is not possible."""
    if not values[DESCRIPTION.name]:
        return None, f"poses need the arm: set {DESCRIPTION.name}"
    robot = find_robot({name: values[name] for name in OF_ARM if name in values})
    speeds = as_float(values[VELOCITY.name]), as_float(values[ANGULAR_VELOCITY.name])
    tool = str(values[TOOL_FRAME.name])
    try:
        kinematics = ToolKinematics(robot, limits, tool, *speeds)
    except ParameterError as error:
        if tool:
            raise
        return None, str(error)
    q = np.zeros(len(limits.joints))
    kinematics.toward(q, kinematics.pose(q), _FIRST)  # What is slow once.
    return ToolFollower(kinematics, robot.base, Frames(str(values[FRAME_PREFIX.name]))), ""
