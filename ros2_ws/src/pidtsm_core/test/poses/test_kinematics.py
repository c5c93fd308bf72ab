"""Joints follow poses within their limits, whatever is asked; MuJoCo says where links are."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.testarms import TWO_LINK

from pidtsm_core.parameters import ParameterError
from pidtsm_core.poses.kinematics import ToolKinematics
from pidtsm_core.poses.pose import Pose
from pidtsm_core.robots import find_robot
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.streams import StreamFilter

ARMS = ("panda", "ur5", "scara", TWO_LINK.description)
TARGETS = 60
MS = 1_000_000


def kinematics_of(description: str, tool: str = "") -> tuple[ToolKinematics, MotionLimits]:
    settings = {"robot.description": description}
    limits = motion_limits(settings)
    return ToolKinematics(find_robot(settings), limits, tool), limits


def random_pose(kinematics: ToolKinematics, limits: MotionLimits, kind: int, rng: np.random.Generator) -> Pose:
    """A pose that the tool can have, with joints anywhere or at their limits, or anywhere in space, or far away."""
    low, high = np.maximum(limits.lower, -3.0), np.minimum(limits.upper, 3.0)
    share = rng.random(low.size)
    pose = kinematics.pose(low + (np.round(share) if kind == 1 else share) * (high - low))
    if kind == 2:
        return Pose(1.5 * rng.normal(size=3), Rotation.random(random_state=rng).as_matrix())
    return Pose(2.0 * pose.position, pose.rotation) if kind == 3 else pose


@pytest.mark.parametrize("description", ARMS)
def test_no_target_makes_the_reference_exceed_a_limit_of_the_joints(description: str) -> None:
    """Targets jump at 30 Hz through and beyond the space of the arm, as the trajectory node would follow them."""
    kinematics, limits = kinematics_of(description)
    rng, q = np.random.default_rng(3), np.clip(np.zeros(len(limits.joints)), limits.lower, limits.upper)
    kinematics.prefer(q)
    stream, before, now = StreamFilter(limits), np.zeros((3, q.size)), 0
    state = before.copy()
    for k in range(TARGETS):
        pose = random_pose(kinematics, limits, k % 4, rng)
        for _ in range(rng.integers(1, 8)):
            position, left = kinematics.toward(stream.targets(q), pose, 1.0 / 30.0)
            assert np.isfinite(position).all()
            assert math.isfinite(left.position + left.angle)
            stream.receive(now, now + 1, position)
            if not stream.running:
                stream.begin(now, np.array([q, 0.0 * q, 0.0 * q]))
                before[0] = q
            for _ in range(33):
                now += MS
                stream.advance(now)
                stream.evaluate(1e-9 * now, state)
                assert (state[0] >= limits.lower).all()
                assert (state[0] <= limits.upper).all()
                assert (np.abs(state[1]) <= limits.planned_velocity).all()
                assert (np.abs(state[2]) <= limits.acceleration * (1.0 + 1e-9)).all()
                assert (np.abs(state[2] - before[2]) <= 1e-3 * limits.jerk * (1.0 + 1e-6)).all()
                before[:] = state


def test_what_the_arm_cannot_reach_it_comes_near_and_rests() -> None:
    kinematics, _ = kinematics_of("ur5")
    q = np.array([0.0, -1.2, 1.8, -2.2, -1.57, 0.0])
    kinematics.prefer(q)
    start = kinematics.pose(q)
    far = Pose(np.add(start.position, [2.0, 0.0, 0.0]), start.rotation)
    for _ in range(400):
        last, (q, left) = q, kinematics.toward(q, far, 0.02)
    assert np.abs(q - last).max() < 0.02 * 0.01  # rad/s
    shoulder = kinematics.pose(q, "shoulder_link").position
    reached = np.linalg.norm(kinematics.pose(q).position - shoulder)
    assert reached > 0.95 * (0.425 + 0.392 + 0.1)  # Lengths of its links, m.
    assert left.singular


def test_any_link_can_be_the_tool_and_is_where_mujoco_says() -> None:
    kinematics, _ = kinematics_of("panda", "panda_link6")
    robot: Any = find_robot({"robot.description": "panda"})
    end = robot.description.text.rindex("</robot>")
    text = robot.description.text[:end] + '<mujoco><compiler fusestatic="false"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(text)
    data, q = mujoco.MjData(model), np.array([0.3, -0.3, 0.2, -2.2, 0.1, 2.0, 0.8])
    data.qpos[:7] = q
    mujoco.mj_kinematics(model, data)
    for pose, name in ((kinematics.pose(q), "panda_link6"), (kinematics.pose(q, "panda_link3"), "panda_link3")):
        np.testing.assert_allclose(pose.position, data.body(name).xpos, atol=1e-12)
        np.testing.assert_allclose(pose.rotation, data.body(name).xmat.reshape(3, 3), atol=1e-12)
    with pytest.raises(ParameterError, match=r"poses.tool: panda has no link panda_link9; did you mean panda_link"):
        kinematics_of("panda", "panda_link9")


def test_a_repeated_circle_brings_the_joints_back() -> None:
    """A redundant arm does not drift, because it prefers the posture in which the stream began."""
    kinematics, _ = kinematics_of("panda")
    q = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.8])
    kinematics.prefer(q)
    start, after = kinematics.pose(q), []
    for k in range(601):
        angle = 2.0 * math.pi * k / 150.0
        goal = start.moved(np.array([0.1 * math.cos(angle) - 0.1, 0.1 * math.sin(angle), 0.0]), np.zeros(3))
        q, left = kinematics.toward(q, goal, 0.02)
        assert left.position < 1e-4
        if k % 150 == 0:
            after.append(q)
    assert np.abs(np.diff(after[2:], axis=0)).max() < 2e-3
