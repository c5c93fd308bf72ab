"""From a goal of the action FollowJointTrajectory to a motion within the limits of the arm."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pidtsm_controller.goal_content import GoalContent
from pidtsm_controller.trajectory_points import check_extent, efforts_of, places, states_of
from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value, as_float, joint_array
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.timing import NANOSECONDS, seconds
from pidtsm_core.trajectories.checking import check
from pidtsm_core.trajectories.errors import StartError, TrajectoryError
from pidtsm_core.trajectories.feed_forward import FeedForward, fade, follow
from pidtsm_core.trajectories.interpolation import Interpolation, check_start, plan
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.splice import unwind
from pidtsm_core.trajectories.stopping import stop, stop_at
from pidtsm_core.trajectories.tracking import VIOLATED, Code, Tolerances

_NONE = -1.0
"""Value of a tolerance that stands for no limit; 0 stands for the default."""


class GoalError(ValueError):
    """A goal cannot be followed.

    Attributes:
        code: error code of the result.
    """

    def __init__(self, code: Code, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class Splice(NamedTuple):
    """Where a new motion takes over."""

    begin: int  # ns
    present: Array  # q_d, q_d', q_d'' then, shape (3, joints), rad, rad/s, rad/s^2
    effort: Array  # fed forward then, shape (joints,), N m


class Plan(NamedTuple):
    """A motion that follows a goal; its times are relative to the start of the trajectory."""

    start: int  # of the trajectory, ns
    end: float  # time of its last point, s
    motion: PiecewiseMotion
    efforts: FeedForward
    tolerances: Tolerances
    due: Array | None = None  # the last point if it is due at once, position, shape (joints,), rad


def plan_goal(goal: GoalContent, splice: Splice, limits: MotionLimits, values: Mapping[str, Value]) -> Plan:
    """Plan the motion for a goal.

    Args:
        goal: the goal.
        splice: where its motion takes over; if the goal has no start time, it starts there.
        limits: of the arm.
        values: parameters of the trajectory node.

    Raises:
        GoalError: the goal is invalid or exceeds a limit; the message gives the reason.
    """
    try:
        check_extent(goal.count, 0.0)
    except MessageError as error:
        raise GoalError(Code.INVALID_GOAL, str(error)) from None
    rest = goal.rest
    if rest is None:
        raise GoalError(Code.INVALID_GOAL, "its tolerances are too large: name each joint once")
    if len(rest.multi_dof_trajectory.points) or rest.component_path_tolerance or rest.component_goal_tolerance:
        raise GoalError(Code.INVALID_GOAL, "joints with several degrees of freedom are not supported")
    partial = bool(values["allow_partial_joints_goal"])
    try:
        columns = places(goal.names, limits.joints, partial=partial)
    except MessageError as error:
        raise GoalError(Code.INVALID_JOINTS, str(error)) from None
    tolerances = _tolerances(rest, limits.joints, values)
    try:
        return _plan(goal, columns, splice, limits, values, tolerances)
    except StartError as error:
        raise GoalError(Code.PATH_TOLERANCE_VIOLATED, f"{VIOLATED}: {error}") from None
    except (MessageError, TrajectoryError) as error:
        raise GoalError(Code.INVALID_GOAL, str(error)) from None


def _plan(
    goal: GoalContent,
    columns: NDArray[np.intp],
    splice: Splice,
    limits: MotionLimits,
    values: Mapping[str, Value],
    tolerances: Tolerances,
) -> Plan:
    assert goal.points is not None
    times, given = states_of(goal.names, goal.points)
    start = goal.stamp or splice.begin
    elapsed = seconds(splice.begin - start)
    if elapsed > times[-1]:
        raise GoalError(
            Code.OLD_HEADER_TIMESTAMP, f"it is over: it started {elapsed:.3f} s ago and takes {times[-1]:g} s"
        )
    points = unwind(_of_all_joints(given, columns, splice.present, limits), splice.present[0], limits)
    tolerance = as_float(values["start_tolerance"])
    if times[-1] == elapsed and times[0] >= 0.0:
        check_start(times.size, points[-1, 0], splice.present[0], tolerance)
        motion = stop_at(points[-1, 0], splice.present, limits)
        check(motion, limits)
        return Plan(splice.begin, 0.0, motion, fade(0.0, splice.effort), tolerances, points[-1, 0])
    interpolation = cast(Interpolation, values["interpolation"])
    motion = plan(times, points, elapsed, splice.present, tolerance, interpolation)
    check(motion, limits)
    efforts = fade(elapsed, splice.effort)
    if (fed := efforts_of(goal.names, goal.points)) is not None:
        all_efforts = np.zeros((times.size, len(limits.joints)))
        all_efforts[:, columns] = fed
        efforts = follow(elapsed, splice.effort, times, all_efforts)
    return Plan(start, motion.end, motion, efforts, tolerances)


def _of_all_joints(given: Array, columns: NDArray[np.intp], present: Array, limits: MotionLimits) -> Array:
    """States of all joints in the node's order; those that the goal does not name rest where they come to a stop."""
    points = np.zeros((*given.shape[:2], len(limits.joints)))
    if columns.size < points.shape[2]:
        rest, last = stop(present, limits), np.zeros_like(present)
        rest.evaluate(rest.end, last)
        points[:, 0] = last[0]
    points[:, :, columns] = given
    return points


def _tolerances(goal: Any, joints: Sequence[str], values: Mapping[str, Value]) -> Tolerances:
    """The goal's tolerances, completed from the parameters."""
    count = len(joints)
    path, arrival = np.full((2, count), math.inf), np.full((2, count), math.inf)
    path[0] = _limit(joint_array(values["constraints.trajectory"], count))
    arrival[0] = _limit(joint_array(values["constraints.goal"], count))
    arrival[1] = _limit(joint_array(values["constraints.stopped_velocity_tolerance"], count))
    for rows, field in ((path, "path_tolerance"), (arrival, "goal_tolerance")):
        for given in getattr(goal, field):
            if given.name not in joints:
                raise GoalError(Code.INVALID_JOINTS, f"{field}: unknown joint {given.name}; known: {', '.join(joints)}")
            joint = list(joints).index(given.name)
            for row, quantity in enumerate(("position", "velocity")):
                what = f"{field} of {given.name}: {quantity}"
                rows[row, joint] = _tolerance(getattr(given, quantity), rows[row, joint], what)
            if _tolerance(given.acceleration, math.inf, f"{field} of {given.name}: acceleration") < math.inf:
                raise GoalError(
                    Code.INVALID_GOAL, f"{field} of {given.name}: accelerations are not measured; 0 and -1 are allowed"
                )
    time = goal.goal_time_tolerance.sec + goal.goal_time_tolerance.nanosec / NANOSECONDS
    default = float(_limit(np.array([as_float(values["constraints.goal_time"])]))[0])
    return Tolerances(path, arrival, _tolerance(time, default, "goal_time_tolerance"))


def _limit(given: Array) -> Array:
    """Limits of parameters, infinite where 0 is given."""
    return np.where(given > 0.0, given, math.inf)


def _tolerance(given: float, default: float, what: str) -> float:
    """A tolerance of a goal."""
    if given == 0.0:
        return default
    if given == _NONE:
        return math.inf
    if not 0.0 < given < math.inf:
        raise GoalError(
            Code.INVALID_GOAL, f"{what} is {given:g}; a positive number, 0 (default) or -1 (none) is allowed"
        )
    return given
