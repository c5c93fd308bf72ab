"""Scenes: where the arm stands in them, and what its bodies feel when they touch something."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.testarms import PENDULUM, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

# A foot of 2 kg that slides down; its axes are turned by a quarter about x, so that its y axis points up.
FOOT = Arm(
    '<mujoco><worldbody><body name="foot" pos="0 0 0.3" euler="90 0 0"><joint name="drop" type="slide" axis="0 1 0"/>'
    '<geom type="sphere" size="0.1" mass="2"/></body></worldbody></mujoco>',
    (0.0,),
)
FOOT.settings["limits.effort"] = 100.0
FLOOR = '<geom name="floor" type="plane" size="2 2 0.1"/>'
BOX = '<body name="box" pos="1 0 0.5"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body>'
SITE = '<site name="robot" pos="0 0 0.5"/>'
STAND = '<site name="robot" pos="0 0 1"/>'


def scene(folder: Path, *parts: str) -> dict[str, Any]:
    """Parameters of a scene with these parts."""
    file = folder / "scene.xml"
    file.write_text(f"<mujoco><worldbody>{''.join(parts)}</worldbody></mujoco>", encoding="utf-8")
    return {"engine": "mujoco", "scene": str(file), "mujoco.integrator": "implicitfast"}


def robot_in(changes: dict[str, Any], arm: Arm = FOOT) -> SimulatedRobot:
    return SimulatedRobot(arm.values(simulator_schema, changes))


def run(robot: SimulatedRobot, samples: int, effort: float = 0.0, commanded: bool = True) -> Array:
    """Positions of the first joint."""
    positions = []
    for k in range(samples):
        robot.sense(k)
        robot.act(k, commanded, np.full(robot.joints, effort))
        positions.append(robot.state.arm.position[0])
    return np.array(positions)


def test_a_body_feels_its_weight_in_its_axes_where_it_rests(tmp_path: Path) -> None:
    robot = robot_in(scene(tmp_path, FLOOR))
    assert robot.touchable == ("foot",)
    falling = run(robot, 150)
    np.testing.assert_allclose(falling, -0.5 * 9.81 * (np.arange(1, 151) * 1e-3) ** 2, atol=1e-3)
    assert robot.contacts() == {}
    assert run(robot, 2000)[-1] == pytest.approx(-0.2, abs=1e-3)
    wrench = robot.contacts()["foot"]
    np.testing.assert_allclose(wrench, [0.0, 2 * 9.81, 0.0, 0.0, 0.0, 0.0], atol=1e-6)
    run(robot, 500, effort=5.0)
    assert robot.contacts()["foot"][1] == pytest.approx(2 * 9.81 - 5.0, abs=1e-3)


def test_the_payload_of_a_body_is_part_of_it(tmp_path: Path) -> None:
    robot = robot_in({**scene(tmp_path, FLOOR), "payload.mass": 3.0, "payload.time": 1.0, "payload.duration": 1.0})
    weights = []
    for k in range(3000):
        robot.sense(k)
        robot.act(k, True, np.zeros(1))
        if k in (900, 1900, 2900):
            weights.append(robot.contacts()["foot"][1] / 9.81)
    np.testing.assert_allclose(weights, [2.0, 5.0, 2.0], atol=1e-3)


def test_the_arm_stands_on_the_site_called_robot(tmp_path: Path) -> None:
    """The floor is 0.5 m lower for it."""
    robot = robot_in(scene(tmp_path, FLOOR, SITE))
    assert run(robot, 2500)[-1] == pytest.approx(-0.7, abs=1e-3)


def test_other_bodies_move_while_the_brakes_hold_the_arm_and_go_back_with_a_reset(tmp_path: Path) -> None:
    changes = scene(tmp_path, FLOOR, BOX)
    robot = robot_in(changes)
    positions = run(robot, 2000, commanded=False)
    assert (positions == 0.0).all()
    heights = robot._plant.mujoco.data.qpos  # type: ignore[union-attr]
    assert heights[2] == pytest.approx(0.1, abs=1e-3)
    robot.reset(FOOT.values(simulator_schema, changes))
    assert heights[2] == 0.5


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, r"scene: .*nowhere\.xml: no such file"),
        ("<mujoco><worldbody><thing/></worldbody></mujoco>", "unrecognized element"),
        ("<mujoco", "XML"),
    ],
)
def test_a_scene_that_cannot_be_read_is_refused(content: str | None, reason: str, tmp_path: Path) -> None:
    file = tmp_path / "nowhere.xml"
    if content is not None:
        file.write_text(content, encoding="utf-8")
    with pytest.raises(ParameterError, match=reason):
        robot_in({"engine": "mujoco", "scene": str(file)})


def test_an_arm_without_shapes_is_refused_in_a_scene(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"robot\.description: no link has a shape"):
        robot_in(scene(tmp_path, FLOOR), PENDULUM)


def test_the_shapes_of_a_urdf_touch_but_not_each_other(tmp_path: Path) -> None:
    ball = '<link name="rod"><{0}><geometry>{1}</geometry></{0}>'
    sphere, mesh = '<sphere radius="0.5"/>', '<mesh filename="package://nowhere/rod.stl"/>'
    for kind in ("visual", "collision"):
        text = PENDULUM.description.replace('<link name="rod">', ball.format(kind, sphere) + "")
        robot = robot_in(scene(tmp_path, STAND, FLOOR), Arm(text, (0.3,)))
        assert robot.touchable == ("rod",)
    text = PENDULUM.description.replace('<link name="rod">', ball.format("visual", mesh))
    with pytest.raises(ParameterError, match="no link has a shape"):
        robot_in(scene(tmp_path, FLOOR), Arm(text, (0.3,)))


def test_a_dropped_payload_falls_to_the_floor_beside_the_arm(tmp_path: Path) -> None:
    robot = robot_in({**scene(tmp_path, FLOOR), "payload.mass": 1.0, "payload.time": 0.05, "payload.duration": 0.07})
    mujoco = robot._plant.mujoco
    assert mujoco is not None
    model, data = mujoco.models.empty, mujoco.data
    box = int(model.body_jntadr[mujoco.models.dropped])
    place, speed = int(model.jnt_qposadr[box]), int(model.jnt_dofadr[box])
    run(robot, 120)
    assert data.qpos[place : place + 3].tolist() == [0.0, 0.0, 0.0]  # Until it is dropped, nobody sees it.
    robot.sense(120)
    robot.act(120, True, np.zeros(1))
    foot = robot.state.arm
    assert data.qpos[place + 2] == pytest.approx(0.3 + foot.position[0], abs=1e-4)
    assert data.qvel[speed + 2] == pytest.approx(foot.derivatives[0, 0], abs=1e-3)
    assert foot.derivatives[0, 0] < -1.1
    # The arm is pushed up, and the payload falls on.
    for k in range(121, 2000):
        robot.sense(k)
        robot.act(k, True, np.full(1, 60.0))
    assert foot.position[0] > 0.5
    assert data.qpos[place + 2] == pytest.approx(0.05, abs=2e-3)  # Half its side.
    assert robot.contacts() == {}
    robot.reset(FOOT.values(simulator_schema, {}))
    assert data.qpos[place : place + 3].tolist() == [0.0, 0.0, 0.0]


def test_a_carried_payload_touches_the_floor(tmp_path: Path) -> None:
    robot = robot_in({**scene(tmp_path, FLOOR), "payload.mass": 1.0, "payload.center_of_mass": [0.0, -0.2, 0.0]})
    run(robot, 1500)
    # The box hangs 0.2 m below the foot, and half its side is 0.05 m.
    assert robot.state.arm.position[0] == pytest.approx(-0.05, abs=2e-3)
    assert robot.contacts()["foot"][1] == pytest.approx(3 * 9.81, abs=1e-2)
