"""The action FollowJointTrajectory of the trajectory node, as MoveIt and rqt send it."""

import time
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np
from control_msgs.action import FollowJointTrajectory
from rclpy.action import GoalResponse
from rclpy.action.server import ServerGoalHandle
from trajectory_msgs.msg import JointTrajectoryPoint

from pidtsm_controller.goal_content import GoalContent, read_goal, rejection
from pidtsm_controller.goal_planning import GoalError, Plan, Splice, plan_goal
from pidtsm_controller.planning_thread import planning_thread
from pidtsm_core.arrays import Array
from pidtsm_core.parameters import as_float
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.timing import NANOSECONDS, seconds
from pidtsm_core.trajectories.feed_forward import FeedForward, fade
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.splice import MotionUnderWay
from pidtsm_core.trajectories.tracking import Code, Tracking
from pidtsm_ros.action_server import KEPT, LoopActionServer
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.serialization import serialize
from pidtsm_ros.stamps import set_stamp

_PATIENCE = {False: 1.0, True: 5.0}
"""Time without joint states after which the arm is lost, s, by whether the node is in lockstep."""
_FIRST_LEAD = 20_000_000
"""Time for planning while the reference moves, ns; doubled until planning is fast enough."""
_LONGEST_LEAD = 2_000_000_000
_MOST_KEPT = 200
"""Goals that are kept at once. Each change of a goal publishes the status of all, so more would hold up the loop."""
_MOST_WAITING = 32
"""Goals that wait to be planned; one more ends the oldest of them."""
_ENDED_AT_ONCE = 4
"""Waiting goals that end at one joint state when they are cancelled: a client keeps ten results, and loses others."""
_PREEMPTED = "Current goal preempted by new incoming action"
"""Text of joint_trajectory_controller."""
_SAME = 1e-9
"""States are the same up to rounding, rad, rad/s, rad/s^2."""


@dataclass(eq=False)
class _Goal:
    """A goal that was accepted and has not ended."""

    handle: ServerGoalHandle
    content: GoalContent
    lead: int = _FIRST_LEAD  # time for planning, ns
    start: int = -1  # of the trajectory, ns
    begin: int = -1  # when its motion takes over, ns
    tracking: Tracking | None = None
    due: Array | None = None  # where the arm should be at once, shape (3, joints); None: it follows the reference
    cancelled: bool = False  # its motion comes to rest
    next_feedback: int = 0  # ns

    @property
    def cancel_requested(self) -> bool:
        return bool(self.handle.is_cancel_requested)


class GoalServer:
    """Plans goals, changes the motion of the node, and judges how the arm follows.

    A goal is planned in a thread, from the state that the reference will have when it takes over. If the reference has
    another state by then, because it moves and planning took longer than expected, it is planned again. In lockstep
    time waits for the plan, so that a run does not depend on the speed of the machine.

    Attributes:
        now: time of the last joint state, ns; -1: there was none yet.
        trouble: why no goal can be followed now; empty if one can.
    """

    def __init__(self, node: ManagedNode, limits: MotionLimits) -> None:
        """Args: node: the trajectory node, while it is configured; limits: of the arm."""
        self._node, self._limits = node, limits
        self._log = node.get_logger()
        name = "~/follow_joint_trajectory"
        self._server = LoopActionServer(node, FollowJointTrajectory, name, self._admit, self._accept)
        self._planner = planning_thread("planner")
        self._queue: deque[_Goal] = deque()
        self._planning: tuple[_Goal, Splice, Future[Plan]] | None = None
        self._waiting: tuple[_Goal, FeedForward] | None = None
        self._running: _Goal | None = None
        self._efforts, self._efforts_start = fade(0.0, np.zeros(len(limits.joints))), 0
        self._received = time.monotonic()
        self._flooded = False
        self._admitted: GoalContent | None = None
        self.now = -1
        self.trouble = ""

    # Called by the node.

    def advance(self, now: int, motion: MotionUnderWay) -> None:
        """Change the motion if a goal is planned, begins or is cancelled; call before the reference of `now` (ns)."""
        self.now, self._motion = now, motion
        if self.trouble and self._goals():
            self._give_up(self.trouble)
        for goal in [goal for goal in self._queue if goal.cancel_requested][:_ENDED_AT_ONCE]:
            self._end(goal, Code.SUCCESSFUL, "cancelled before its start")
        if self._planning is None and (following := next((g for g in self._queue if not g.cancel_requested), None)):
            self._queue.remove(following)
            self._plan(following)
        if self._planning and (self._node.lockstep or self._planning[2].done()):
            self._install()
        self._received = time.monotonic()
        if self._waiting and now >= self._waiting[0].begin:
            (goal, self._efforts), self._waiting = self._waiting, None
            if self._running:
                reason = f"{_PREEMPTED}: replaced by a new goal at {seconds(now):.3f} s"
                self._end(self._running, Code.INVALID_GOAL, reason)
            self._running, self._efforts_start = goal, goal.start
        if self._waiting and self._waiting[0].cancel_requested:
            motion.withdraw()
            self._end(self._waiting[0], Code.SUCCESSFUL, "cancelled before its start")
        if self._running and self._running.cancel_requested and not self._running.cancelled:
            self._running.cancelled = True
            self._come_to_rest("the goal before it was cancelled")

    @property
    def busy(self) -> bool:
        """Whether there is a goal, also one that waits."""
        return bool(self._goals())

    def effort(self, now: int) -> Array:
        """Effort that is fed forward at `now` (ns), shape (joints,), N m."""
        return self._efforts.evaluate(seconds(now - self._efforts_start))

    @property
    def watching(self) -> bool:
        """Whether `judge` needs the measured position."""
        return self._running is not None

    def judge(self, now: int, desired: Array, position: Array) -> None:
        """End the running goal if it is reached or missed.

        Args:
            now: stamp of the joint state, ns.
            desired: the reference, shape (3, joints), rad, rad/s, rad/s^2.
            position: measured, shape (joints,), rad.
        """
        goal = self._running
        if goal is None or goal.tracking is None:
            return
        at_rest = not desired[1:].any()
        if goal.due is not None:
            desired = goal.due
        outcome = goal.tracking.judge(now, desired, position)
        if now >= goal.next_feedback:
            self._give_feedback(goal, now, desired)
        if goal.cancelled:
            if at_rest:
                self._end(goal, Code.SUCCESSFUL, "cancelled; the reference is at rest")
        elif outcome and outcome.code == Code.SUCCESSFUL:
            self._end(goal, *outcome)
        elif outcome:
            self._come_to_rest("the goal before it was aborted")
            self._end(goal, *outcome)

    def look_for_the_arm(self) -> None:
        """End all goals if no joint states arrive."""
        if self._goals() and (silent := time.monotonic() - self._received) > _PATIENCE[self._node.lockstep]:
            self._give_up(f"no joint state for {silent:.1f} s")

    def end_all(self, reason: str, now: int) -> None:
        """End all goals, whatever the motion does; the time is `now` (ns), even if the clock was set."""
        for goal in self._goals():
            self._end(goal, Code.INVALID_GOAL, reason)
        self._efforts, self._efforts_start = fade(0.0, self.effort(self.now)), now
        self.now = now

    def destroy(self) -> None:
        """Remove the action."""
        self._planner.shutdown(cancel_futures=True)
        self._server.destroy()

    # Goals.

    def _admit(self, request: Any) -> GoalResponse:
        """Reject what joint_trajectory_controller rejects, and goals while there are too many.

        A rejected goal has no result, so the log has the reason. All others are accepted, and have their reason in the
        result.
        """
        if self._server.kept >= _MOST_KEPT:
            if not self._flooded:
                self._flooded = True
                self._log.error(
                    f"goals are rejected: {_MOST_KEPT} have come within {KEPT} s, and more would delay the reference; "
                    "send them more slowly"
                )
            return GoalResponse.REJECT
        self._flooded = False
        if reason := self._read(request):
            self._log.error(f"goal rejected: {reason}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _read(self, request: Any) -> str:
        """Read a goal before it is accepted; returns why it is rejected, else nothing."""
        if not self._node.active:
            return "the node is not active; activate it first"
        try:
            self._admitted = read_goal(request if isinstance(request, bytes) else serialize(request))
        except MessageError as error:
            return str(error)
        partial = bool(self._node.values["allow_partial_joints_goal"])
        return rejection(self._admitted, self._limits.joints, partial=partial, now=self.now)

    def _accept(self, handle: ServerGoalHandle) -> None:
        handle.execute()
        assert self._admitted is not None
        goal, self._admitted = _Goal(handle, self._admitted), None
        reason = self.trouble
        if self.now < 0:
            reason = "no joint state received yet, so the start time is unknown; start the arm or its simulator first"
        if reason:
            self._end(goal, Code.INVALID_GOAL, reason)
        else:
            self._queue.append(goal)
            if len(self._queue) > _MOST_WAITING:
                reason = f"{_PREEMPTED}: replaced by a newer goal before it was planned"
                self._end(self._queue[0], Code.INVALID_GOAL, reason)

    def _goals(self) -> list[_Goal]:
        """All that have not ended."""
        planning = [self._planning[0]] if self._planning else []
        waiting = [self._waiting[0]] if self._waiting else []
        running = [self._running] if self._running else []
        return [*running, *waiting, *planning, *self._queue]

    def _plan(self, goal: _Goal) -> None:
        """Begin to plan; a goal without a start time may begin at any time while the reference rests."""
        start = goal.content.stamp
        anytime = not start and not self._motion.state_at(self.now)[1:].any()
        begin = max(self.now + (0 if anytime else goal.lead), start)
        splice = Splice(begin, self._motion.state_at(begin), self.effort(begin))
        job = self._planner.submit(plan_goal, goal.content, splice, self._limits, self._node.values)
        self._planning = goal, splice, job

    def _install(self) -> None:
        """Let the motion that is planned take over, if the reference still is where it begins."""
        assert self._planning is not None
        (goal, splice, job), self._planning = self._planning, None
        if goal.cancel_requested:
            self._end(goal, Code.SUCCESSFUL, "cancelled before its start")
            return
        try:
            plan = job.result()
        except GoalError as error:
            self._end(goal, error.code, str(error))
            return
        late = max(self.now - splice.begin, 0)
        stamped = plan.start != splice.begin
        present = self._motion.state_at(splice.begin + late)
        if (late and stamped) or not np.allclose(present, splice.present, rtol=0.0, atol=_SAME):
            goal.lead = max(2 * goal.lead, 2 * late)
            if goal.lead > _LONGEST_LEAD:
                self._end(goal, Code.INVALID_GOAL, f"planning takes more than {seconds(_LONGEST_LEAD):g} s")
            else:
                self._queue.appendleft(goal)
            return
        if self._waiting:
            reason = f"{_PREEMPTED}: replaced by a new goal before its start"
            self._end(self._waiting[0], Code.INVALID_GOAL, reason)
        goal.start, goal.begin = plan.start + late, splice.begin + late
        goal.next_feedback = goal.begin
        end = goal.start + round(plan.end * NANOSECONDS)
        if plan.due is not None:
            goal.due = np.zeros((3, len(self._limits.joints)))
            goal.due[0] = plan.due
        goal.tracking = Tracking(self._limits.joints, self._limits.continuous, plan.tolerances, goal.start, end)
        self._motion.replace(plan.motion, goal.start, goal.begin)
        self._waiting = goal, plan.efforts

    def _give_up(self, reason: str) -> None:
        """End all goals and come to rest."""
        if self._running:
            self._come_to_rest(reason)
        self.end_all(reason, self.now)

    def _come_to_rest(self, reason: str) -> None:
        """Bring the reference to rest; a goal that waited for its start would not begin where it was planned."""
        self._motion.cancel(self.now)
        self._efforts, self._efforts_start = fade(0.0, self.effort(self.now)), self.now
        if self._waiting:
            self._end(self._waiting[0], Code.INVALID_GOAL, reason)

    def _end(self, goal: _Goal, code: Code, text: str) -> None:
        """Send the result; the goal is forgotten."""
        if goal is self._running:
            self._running = None
        elif self._waiting and goal is self._waiting[0]:
            self._waiting = None
        elif self._planning and goal is self._planning[0]:
            self._planning = None
        elif goal in self._queue:
            self._queue.remove(goal)
        if goal.cancel_requested:
            goal.handle.canceled()
        elif code == Code.SUCCESSFUL:
            goal.handle.succeed()
        else:
            goal.handle.abort()
            self._log.error(f"goal aborted ({code.name}): {text}")
        self._server.finish(goal.handle, FollowJointTrajectory.Result(error_code=int(code), error_string=text))

    def _give_feedback(self, goal: _Goal, now: int, desired: Array) -> None:
        """Publish the desired state, the measured one, and the difference."""
        assert goal.tracking is not None
        rate = as_float(self._node.values["action_monitor_rate"])
        goal.next_feedback = max(goal.next_feedback + round(NANOSECONDS / rate), now)
        error = -goal.tracking.error  # desired minus actual, as other servers of this action have it
        message = FollowJointTrajectory.Feedback(
            joint_names=list(self._limits.joints),
            desired=_point(desired, self.effort(now)),
            actual=_point(desired[:2] - error),
            error=_point(error),
        )
        for point in (message.desired, message.actual, message.error):
            elapsed = point.time_from_start
            elapsed.sec, elapsed.nanosec = divmod(max(now - goal.start, 0), NANOSECONDS)
        set_stamp(message.header.stamp, now)
        goal.handle.publish_feedback(message)


def _point(rows: Array, effort: Array | None = None) -> JointTrajectoryPoint:
    """Positions, velocities and, if given, accelerations and efforts."""
    fields = ("positions", "velocities", "accelerations")
    point = JointTrajectoryPoint(**dict(zip(fields, rows.tolist(), strict=False)))
    if effort is not None:
        point.effort = effort.tolist()
    return point
