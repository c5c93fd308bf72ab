"""The tool goes along lines and arcs, within the limits of joints and tool; MuJoCo says where it is."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.poses.kinematics import ToolKinematics
from pidtsm_core.poses.paths import Speed, arc, line, plan_path
from pidtsm_core.poses.pose import Pose
from pidtsm_core.robots import find_robot
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_core.trajectories.motion import PiecewiseMotion

STARTS = {
    "panda": [0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.8],
    "ur5": [0.0, -1.2, 1.8, -2.2, -1.57, 0.0],
    "xarm7": [0.0, -0.2, 0.0, 1.2, 0.0, 1.4, 0.0],
    "z1": [-0.39, 1.89, -1.54, -0.76, -0.02, -0.18],
}
SPEED = Speed(velocity=0.25, acceleration=1.0)


class Judge:
    """The Panda and others as MuJoCo reads their URDF itself."""

    def __init__(self, name: str) -> None:
        robot: Any = find_robot({"robot.description": name})
        end = robot.description.text.rindex("</robot>")
        text = robot.description.text[:end] + '<mujoco><compiler fusestatic="false"/></mujoco></robot>'
        self._model = mujoco.MjModel.from_xml_string(text)
        self._data = mujoco.MjData(self._model)
        self._places = [int(self._model.joint(joint).qposadr[0]) for joint in robot.joints]
        self._tool = robot.description.links.names[robot.description.tool_link]

    def tool(self, q: Array) -> Pose:
        self._data.qpos[self._places] = q
        mujoco.mj_kinematics(self._model, self._data)
        body = self._data.body(self._tool)
        return Pose(body.xpos.copy(), body.xmat.reshape(3, 3).copy())


def moved(name: str, path: Any) -> tuple[PiecewiseMotion, list[Pose], Any]:
    """The motion along a path that is made of the first pose, that path, and the limits."""
    limits = motion_limits({"robot.description": name})
    kinematics = ToolKinematics(find_robot({"robot.description": name}), limits)
    q = np.array(STARTS[name])
    poses = path(kinematics.pose(q))
    return plan_path(kinematics, q, poses, limits, SPEED), poses, limits


def sampled(motion: PiecewiseMotion, count: int = 300) -> tuple[Array, Array]:
    """Times, and states, shape (times, 3, joints)."""
    times = np.linspace(0.0, motion.end, count)
    states = np.zeros((count, 3, motion.parameters.shape[0]))
    for t, state in zip(times, states, strict=True):
        motion.evaluate(float(t), state)
    return times, states


def circle(start: Pose) -> list[Pose]:
    """A circle of 0.2 m across, in two arcs."""
    opposite = start.moved(np.array([-0.2, 0.0, 0.0]), np.zeros(3))
    there = arc(start, np.add(start.position, [-0.1, 0.1, 0.0]), opposite)
    return [*there, *arc(opposite, np.add(start.position, [-0.1, -0.1, 0.0]), start)[1:]]


@pytest.mark.parametrize("name", STARTS)
def test_the_tool_goes_along_a_circle_within_all_limits(name: str) -> None:
    motion, poses, limits = moved(name, circle)
    times, states = sampled(motion)
    judge = Judge(name)
    tools = [judge.tool(q) for q in states[:, 0]]
    centre = poses[0].position - [0.1, 0.0, 0.0]
    places = np.array([tool.position for tool in tools]) - centre
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), 0.1, atol=2e-4)
    np.testing.assert_allclose(places[:, 2], 0.0, atol=2e-4)
    turned = [np.linalg.norm(poses[0].way_to(tool)[1]) for tool in tools]
    assert max(turned) < 1e-3
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
    assert 0.2 < speed.max() <= 1.01 * SPEED.velocity
    assert np.abs(np.diff(speed)).max() / (times[1] - times[0]) <= 1.1 * SPEED.acceleration
    for order, limit in ((1, limits.planned_velocity), (2, 1.001 * limits.acceleration)):
        assert (np.abs(states[:, order]) <= limit).all()


def test_a_line_turns_evenly_and_ends_where_it_should() -> None:
    turn = Rotation.from_euler("z", 0.6)

    def path(start: Pose) -> list[Pose]:
        return line(start, Pose(np.add(start.position, [0.0, 0.15, 0.05]), turn.as_matrix() @ start.rotation))

    motion, poses, _ = moved("panda", path)
    _, states = sampled(motion, 50)
    judge, way = Judge("panda"), poses[-1].position - poses[0].position
    for q in states[:, 0]:
        tool = judge.tool(q)
        share = (tool.position - poses[0].position) @ way / (way @ way)
        np.testing.assert_allclose(tool.position, poses[0].position + share * way, atol=2e-4)
        _, turned = poses[0].way_to(tool)
        np.testing.assert_allclose(turned, 0.6 * share * np.array([0.0, 0.0, 1.0]), atol=1e-3)
    np.testing.assert_allclose(states[-1, 1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(judge.tool(states[-1, 0]).position, poses[-1].position, atol=1e-5)


def test_what_is_out_of_reach_is_named_with_the_place() -> None:
    with pytest.raises(TrajectoryError, match=r"cannot follow its path beyond \d+ %.*mm and.*"):
        moved("ur5", lambda start: line(start, start.moved(np.array([1.0, 0.0, 0.0]), np.zeros(3))))
    with pytest.raises(TrajectoryError, match="on a line, so that they define no circle"):
        moved("ur5", lambda s: arc(s, np.add(s.position, [0.1, 0, 0]), s.moved(np.array([0.2, 0, 0]), np.zeros(3))))
    limits = motion_limits({"robot.description": "ur5"})
    kinematics = ToolKinematics(find_robot({"robot.description": "ur5"}), limits)
    q = np.array(STARTS["ur5"])
    here = kinematics.pose(q)
    with pytest.raises(TrajectoryError, match="must be positive numbers"):
        plan_path(kinematics, q, [here, here], limits, Speed(velocity=math.nan))
