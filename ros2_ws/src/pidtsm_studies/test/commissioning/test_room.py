"""Motions of a commissioning touch neither the arm itself nor what is around it; MuJoCo is the judge."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import resolve
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema
from pidtsm_studies.commissioning.arm import CommissionError
from pidtsm_studies.commissioning.motions import Motion, straight
from pidtsm_studies.commissioning.room import Room

PANDA = ArmDefinition("panda").settings()
HOME = np.array(ArmDefinition("panda").robot().initial_position)
WALL = '<mujoco><worldbody><geom name="wall" type="box" size="0.05 1 1" pos="0.75 0 0.5"/></worldbody></mujoco>'


@pytest.fixture
def wall(tmp_path: Path) -> str:
    file = tmp_path / "wall.xml"
    file.write_text(WALL, encoding="utf-8")
    return str(file)


def touches(scene: str, q: Array) -> bool:
    """Whether MuJoCo's arm presses on something when it is simulated for a moment at q."""
    given = {**PANDA, "engine": "mujoco", "scene": scene, "initial_position": q.tolist()}
    robot = SimulatedRobot(resolve(simulator_schema, given, q.size))
    for sample in range(3):
        robot.sense(sample)
        robot.act(sample, False, np.zeros(q.size))
    return bool(robot.contacts())


def test_within_its_reach_the_arm_touches_no_wall(wall: str) -> None:
    most = np.ones(HOME.size)
    free = Room(PANDA, wall).reach(HOME, most)
    assert free[1] < 0.5 * Room(PANDA, "").reach(HOME, most)[1]
    corners = np.random.default_rng(5).choice([-1.0, 1.0], size=(60, HOME.size))
    assert not any(touches(wall, HOME + free * corner) for corner in corners)
    assert touches(wall, HOME + 0.6 * np.eye(HOME.size)[1])
    assert (free > 0.1).all()


def test_the_arm_keeps_clear_of_itself() -> None:
    """When the elbow of the Panda folds, its hand meets the upper arm."""
    shapes = ArmDefinition("panda").described().text.replace("visual", "collision")
    model = mujoco.MjModel.from_xml_string(shapes)
    data, body = mujoco.MjData(model), model.geom_bodyid
    apart = [(a, b) for a in range(model.ngeom) for b in range(model.ngeom) if body[b] >= body[a] + 3]

    def distance(q: Array) -> float:
        """Of those parts of the arm that are far from each other along it, m."""
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        return min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a, b in apart)

    most, random = np.ones(HOME.size), np.random.default_rng(5)
    free = Room(PANDA, "").reach(HOME, most)
    shares = [random.uniform(-1.0, 1.0, HOME.size) for _ in range(300)]
    assert min(distance(HOME + free * share) for share in shares) > 0.01
    assert min(distance(HOME + most * share) for share in shares) < 0.01
    assert (free > 0.1).all()


def test_a_motion_into_the_wall_is_refused_and_another_is_not(wall: str) -> None:
    room = Room(PANDA, wall)
    fast = (np.full(HOME.size, 1.0), np.full(HOME.size, 2.0))

    def to(change: float) -> Motion:
        return straight(HOME, HOME + change * np.eye(HOME.size)[1], *fast)

    room.check(HOME, to(-0.5))
    with pytest.raises(CommissionError, match=r"would bring panda_\w+ and wall nearer .* after 0\.\d s"):
        room.check(HOME, to(0.6))
    Room(PANDA, "").check(HOME, to(0.6))


@pytest.mark.parametrize(("radius", "link"), [(0.2, "link1"), (0.45, "link2"), (0.0, "")])
def test_every_link_keeps_clear_of_a_post(radius: float, link: str, tmp_path: Path) -> None:
    """The SCARA swings about its base, over which it is mounted; a post stands at 60 degrees, or there is none."""
    x, y = radius * np.cos(np.pi / 3.0), radius * np.sin(np.pi / 3.0)
    post = f'<geom name="post" type="box" size="0.03 0.03 0.5" pos="{x} {y} 0.25"/>' if radius else ""
    file = tmp_path / "post.xml"
    file.write_text(
        f'<mujoco><worldbody><geom name="table" type="box" size="0.1 0.1 0.05"/>{post}</worldbody></mujoco>'
    )
    scara = ArmDefinition("scara")
    room, home = Room(scara.settings(), str(file)), np.array(scara.robot().initial_position)
    swing = straight(home, home + np.array([1.2, 0.0, 0.0, 0.0]), np.ones(4), np.full(4, 4.0))
    free = room.reach(home, np.array([1.2, 0.1, 0.05, 0.1]))
    if not link:
        room.check(home, swing)
        assert free[0] == 1.2
        return
    assert free[0] < np.pi / 3.0
    with pytest.raises(CommissionError, match=f"{link} and post"):
        room.check(home, swing)


def test_a_home_at_the_wall_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "near.xml"
    file.write_text(WALL.replace("0.75 0 0.5", "0.5 0 0.5"), encoding="utf-8")
    room = Room(PANDA, str(file))
    for _ in range(2):
        with pytest.raises(CommissionError, match=r"panda_.* and wall are nearer .*: move the arm away"):
            room.sentence(HOME)


def test_what_is_known_of_collisions_is_said(wall: str, tmp_path: Path) -> None:
    assert "clear of itself and of wall.xml" in Room(PANDA, wall).sentence(HOME)
    assert "clear of itself;" in Room(PANDA, "").sentence(HOME)
    with pytest.raises(CommissionError, match="scene"):
        Room(PANDA, str(tmp_path / "absent.xml")).sentence(HOME)
