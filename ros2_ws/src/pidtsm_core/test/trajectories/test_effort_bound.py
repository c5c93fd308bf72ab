"""No effort beyond its limit slips between the samples of a check, however short a segment is."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.references.piecewise import piecewise
from pidtsm_core.robots import make_model
from pidtsm_core.robots.compiler import compile_spec, parse
from pidtsm_core.robots.source import read_source
from pidtsm_core.trajectories.checking import check, excessive_effort
from pidtsm_core.trajectories.effort_bound import TOLERANCE
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import interpolate
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion

GOALS, MOMENTS = 60, 400
SHORTEST, LONGEST = 1e-4, 10.0  # s


class Judge:
    """MuJoCo's inverse dynamics of an arm, and limits of its efforts only, with a model that moves as a rigid body."""

    def __init__(self, arm: Arm, limits: MotionLimits) -> None:
        robot, joints = arm.robot, arm.joints
        packed = robot.pack_model(arm.values(controller_schema, {f"robot.{k}": v for k, v in robot.rigid.items()}))
        free = np.full(joints, np.inf)
        self.limits = replace(limits, lower=-free, upper=free, velocity=free, model=make_model(robot, packed))
        text = robot.mjcf(packed) if robot.mjcf else read_source(arm.description)[1]
        self._model = compile_spec(parse(text).spec)
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._order = np.array([self._model.joint(name).dofadr[0] for name in robot.joints])
        if robot.mjcf is None:
            self._model.dof_armature[self._order] = robot.parameters[0].default
        self._model.dof_damping[:] = self._model.dof_frictionloss[:] = 0.0
        self._data = mujoco.MjData(self._model)

    def largest(self, motion: PiecewiseMotion, random: np.random.Generator) -> float:
        """Largest effort at random moments of every segment, and close to its ends, as a share of its limit."""
        data, largest, state = self._data, 0.0, np.empty((3, len(self.limits.joints)))
        for begin, end in zip(motion.times[:-1], motion.times[1:], strict=True):
            for share in (1e-9, *random.random(MOMENTS), 1.0 - 1e-9):
                motion.evaluate(begin + (end - begin) * share, state)
                data.qpos[self._order], data.qvel[self._order], data.qacc[self._order] = state
                mujoco.mj_inverse(self._model, data)
                largest = max(largest, float((np.abs(data.qfrc_inverse[self._order]) / self.limits.effort).max()))
        return largest


@pytest.fixture(scope="module")
def judge(arm: Arm, limits: MotionLimits) -> Judge:
    return Judge(arm, limits)


def a_goal(limits: MotionLimits, start: Array, random: np.random.Generator) -> PiecewiseMotion:
    """One to three points with velocities and accelerations, from rest to rest, some with too much acceleration."""
    count, joints = int(random.integers(1, 4)), start.size
    longest = SHORTEST * (LONGEST / SHORTEST) ** random.random()
    times = np.concatenate([[0.0], np.cumsum(longest * random.uniform(0.3, 1.0, count))])
    shortest = np.diff(times).min()
    size = np.minimum(random.uniform(0.02, 1.5) * limits.acceleration * shortest**2, 1.0)
    points, present = np.zeros((count, 3, joints)), np.zeros((3, joints))
    present[0] = start
    points[:, 0] = start + np.cumsum(random.uniform(-1.0, 1.0, (count, joints)), axis=0) * size
    points[:-1, 1] = random.uniform(-1.0, 1.0, (count - 1, joints)) * size / shortest
    points[:-1, 2] = random.uniform(-1.0, 1.0, (count - 1, joints)) * size / shortest**2
    return interpolate(times, points, present)


def test_what_is_accepted_needs_no_more_than_the_limit_and_what_is_rejected_does(arm: Arm, judge: Judge) -> None:
    random, rejected = np.random.default_rng(arm.joints), 0
    for _ in range(GOALS):
        motion = a_goal(judge.limits, np.array(arm.start), random)
        excess, largest = excessive_effort(motion, judge.limits), judge.largest(motion, random)
        if excess is None:
            assert largest <= 1.0 + TOLERANCE
        else:
            rejected += 1
            # The judge's moments are not those of the check.
            assert largest >= 0.98
            assert abs(excess[2]) > judge.limits.effort[int(excess[1])]
    assert 0.1 * GOALS < rejected < 0.9 * GOALS


@pytest.mark.parametrize(("way", "duration"), [(100.0, 1e-3), (1000.0, 8e-3), (1.0, 1e-4)])
@pytest.mark.parametrize("fields", [1, 2, 3])
def test_a_leap_is_rejected_although_its_ends_and_its_middle_need_nothing(
    arm: Arm, limits: MotionLimits, way: float, duration: float, fields: int
) -> None:
    free = np.full(arm.joints, np.inf)
    unbounded = replace(limits, lower=-free, upper=free, velocity=free)
    present, points = np.zeros((3, arm.joints)), np.zeros((1, fields, arm.joints))
    present[0] = arm.start
    points[0, 0] = present[0] + way
    with pytest.raises(TrajectoryError, match=r"the (torque|force) would be"):
        check(interpolate(np.array([0.0, duration]), points, present), unbounded)


def test_a_short_burst_in_the_middle_of_a_long_motion_is_found(arm: Arm, limits: MotionLimits) -> None:
    """Between two slow segments, a joint turns by a little within 0.1 ms."""
    start = np.zeros((4, 3, arm.joints))
    start[:, 0] = arm.start
    for joint in range(arm.joints):
        states = start.copy()
        states[2:, 0, joint] += 1e-5 * limits.acceleration[joint]
        motion = PiecewiseMotion(piecewise(np.array([0.0, 1.0, 1.0001, 2.0]), states[:-1], states[1:]))
        with pytest.raises(TrajectoryError, match=r"the (torque|force) would be .* at 1\.000 s"):
            check(motion, replace(limits, velocity=np.full(arm.joints, np.inf)))


def test_a_step_of_the_velocity_counts(arm: Arm, limits: MotionLimits) -> None:
    """Straight lines need no acceleration, but their ends do."""
    free = np.full(arm.joints, np.inf)
    unbounded = replace(limits, lower=-free, upper=free, velocity=free)
    present = np.zeros((3, arm.joints))
    present[0] = arm.start
    for speed, refused in ((0.05, False), (1e4, True)):
        points = np.array(arm.start) + speed * 1e-3 * np.array([0.0, 0.0, 1.0])[:, None, None]
        motion = interpolate(np.array([0.0, 1.0, 2.0, 2.001]), points * np.ones((1, 1, arm.joints)), present, "linear")
        assert (excessive_effort(motion, unbounded) is not None) == refused
