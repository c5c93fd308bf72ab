"""Trajectories of many points on ``joint_trajectory``, which are read and planned outside the loop."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_controller.planning_thread import planning_thread
from pidtsm_controller.trajectory_points import check_extent, places, read_points
from pidtsm_core.arrays import Array
from pidtsm_core.parameters import as_float
from pidtsm_core.parameters.joints import ABSURD, MessageError
from pidtsm_core.timing import seconds
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.splice import MotionUnderWay, plan_from
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.trajectory_cdr import read_serialized
from pidtsm_ros.wire import deserialize

LARGE = 16_384
"""Bytes from which on a message is read outside the loop; for those with fewer, that takes less than 3 ms."""
_FIRST_LEAD, _LONGEST_LEAD = 20_000_000, 2_000_000_000
"""Time for planning while the reference moves, ns: the first one, which is doubled until planning is fast enough."""
_SAME = 1e-9
"""States are the same up to rounding, rad, rad/s, rad/s^2."""


class _Plan(NamedTuple):
    start: int  # of the trajectory, ns
    motion: PiecewiseMotion
    points: int


@dataclass
class _Job:
    """A message that is planned from `begin` (ns), where the reference has the state `present`, shape (3, joints)."""

    data: bytes
    lead: int
    begin: int
    present: Array
    plan: "Future[_Plan]"


class LargeTrajectories:
    """Plans the newest trajectory in a thread, and lets its motion take over.

    If the reference has another state by then, because it moves and planning took longer than expected, it is planned
    again. In lockstep time waits for the plan, so that a run does not depend on the speed of the machine.
    """

    def __init__(self, node: ManagedNode, limits: MotionLimits, lockstep: bool) -> None:
        """Args: node: rejects what cannot be followed; limits: of the arm; lockstep: see the class."""
        self._node, self._limits, self._lockstep = node, limits, lockstep
        self._planner: ThreadPoolExecutor = planning_thread("reader of trajectories")
        self._waiting: tuple[bytes, int] | None = None  # message, and the time for planning, ns
        self._job: _Job | None = None
        # Compile before the loop.
        point = JointTrajectoryPoint(positions=[0.0] * len(limits.joints))
        read_serialized(serialize_message(JointTrajectory(joint_names=limits.joints, points=[point])))

    def receive(self, data: bytes) -> None:
        """Plan a serialized trajectory from the next joint state on; it replaces those before it."""
        self.forget("a newer trajectory")
        self._waiting = data, _FIRST_LEAD

    def forget(self, by: str) -> None:
        """Plan nothing of what came before, because `by` replaces it."""
        if self._waiting or self._job:
            self._node.reject(f"joint_trajectory: a trajectory is replaced by {by} before it was planned")
        self._waiting = self._job = None

    def destroy(self) -> None:
        """End the thread."""
        self._planner.shutdown(cancel_futures=True)

    def advance(self, now: int, motion: MotionUnderWay, took_over: Callable[[], None]) -> None:
        """Plan, or change the motion; call before the reference of `now` (ns). `took_over` is called after a change."""
        if self._job is None and self._waiting:
            self._plan(now, motion)
        if self._job is None or not (self._lockstep or self._job.plan.done()):
            return
        job, self._job = self._job, None
        try:
            plan = job.plan.result()
        except (MessageError, TrajectoryError) as error:
            self._node.reject(f"joint_trajectory: {error}")
            return
        late = max(now - job.begin, 0)
        stamped = plan.start != job.begin
        present = motion.state_at(job.begin + late)
        if (late and stamped) or not np.allclose(present, job.present, rtol=0.0, atol=_SAME):
            lead = max(2 * job.lead, 2 * late)
            if lead > _LONGEST_LEAD:
                self._node.reject(f"joint_trajectory: planning takes more than {seconds(_LONGEST_LEAD):g} s")
            else:
                self._waiting = job.data, lead
            return
        motion.replace(plan.motion, plan.start + late, job.begin + late)
        took_over()
        text = f"following a trajectory of {plan.points} points, {plan.motion.end:g} s"
        self._node.get_logger().info(text)

    def _plan(self, now: int, motion: MotionUnderWay) -> None:
        assert self._waiting is not None
        (data, lead), self._waiting = self._waiting, None
        begin = max(now + (lead if motion.state_at(now)[1:].any() else 0), serialized_nanoseconds(data))
        present = motion.state_at(begin)
        self._job = _Job(data, lead, begin, present, self._planner.submit(self._read_and_plan, data, begin, present))

    def _read_and_plan(self, data: bytes, begin: int, present: Array) -> _Plan:
        given_names, times, given = _read(data)
        columns = places(given_names, self._limits.joints, partial=False)
        points = np.empty_like(given)
        points[:, :, columns] = given
        start = serialized_nanoseconds(data) or begin
        tolerance = as_float(self._node.values["start_tolerance"])
        motion = plan_from(present, seconds(begin - start), (times, points), tolerance, self._limits)
        return _Plan(start, motion, len(times))


def _read(data: bytes) -> tuple[Sequence[str], Array, Array]:
    """Names of the joints, and times and states as `read_points` returns them."""
    if (read := read_serialized(data)) is not None and (np.abs(read.states) < ABSURD).all():
        check_extent(len(read.times), float(read.times.max()))
        return read.names, read.times, read.states
    message = deserialize(data, JointTrajectory)
    return message.joint_names, *read_points(message)
