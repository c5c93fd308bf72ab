"""A gripper moves as it is commanded, stops at an object, and refuses what it cannot do."""

import math
from typing import Any

import numpy as np
import pytest

from pidtsm_core.experiment.node_parameters import simulator_node_schema
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.robots.description import read_description
from pidtsm_core.robots.payload import Payload, payload_of, payload_settings, together
from pidtsm_core.simulation.gripper import Gripper

INERTIAL = '<inertial><mass value="{}"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>'
    '<limit lower="{4}" upper="{5}" effort="50" velocity="2"/>{6}</joint>'
)
MIMIC = '<mimic joint="left" multiplier="-1" offset="0.01"/>'
ARM = "".join(
    (
        '<robot name="handy"><link name="base"/>',
        *(f'<link name="{name}">{INERTIAL.format(m)}</link>' for name, m in {"upper": 3, "lower": 2}.items()),
        *(f'<link name="{name}">{INERTIAL.format(0.05)}</link>' for name in ("finger1", "finger2", "finger3")),
        JOINT.format("shoulder", "revolute", "base", "upper", -2, 2, ""),
        JOINT.format("elbow", "revolute", "upper", "lower", -2, 2, ""),
        JOINT.format("left", "prismatic", "lower", "finger1", 0.0, 0.04, ""),
        JOINT.format("right", "prismatic", "lower", "finger2", -0.04, 0.04, MIMIC),
        JOINT.format("third", "prismatic", "lower", "finger3", 0.0, 0.04, ""),
        "</robot>",
    )
)
DT = 0.004


def values(**settings: Any) -> dict[str, Any]:
    given = {name.replace("__", "."): value for name, value in settings.items()}
    arm = {"robot.description": ARM, "joints": ["shoulder", "elbow"], "robot.locked": "left=0.04"}
    return dict(resolve(simulator_node_schema, {**arm, "gripper.joints": "left right", **given}, 2))


def run(gripper: Gripper, seconds: float) -> list[float]:
    """The positions of the first joint."""
    seen = []
    for _ in range(round(seconds / DT)):
        gripper.advance(DT)
        seen.append(float(gripper.position[0]))
    return seen


def test_joints_that_are_not_of_the_arm_are_known() -> None:
    found = read_description(ARM, ("shoulder", "elbow"))
    assert set(found.others) == set(found.locked) == {"left", "right", "third"}
    assert found.others["left"][:3] == (0.0, 0.04, True)
    assert found.others["right"].mimics == "left"
    assert (found.others["right"].factor, found.others["right"].offset) == (-1.0, 0.01)


def test_it_moves_no_faster_than_it_may_and_stays() -> None:
    gripper = Gripper(values())
    assert gripper.reached
    gripper.close_to(0.01)
    seen = run(gripper, 0.2)
    assert np.abs(np.diff(seen)).max() <= 0.1 * DT + 1e-12
    assert not gripper.reached
    run(gripper, 0.2)
    assert gripper.reached
    assert gripper.position.tolist() == pytest.approx([0.01, 0.0])
    assert not gripper.velocity.any()


def test_a_trajectory_is_followed_in_time() -> None:
    gripper = Gripper(values(gripper__velocity=10.0, gripper__joints="left right third"))
    gripper.follow(["third", "left"], [0.1, 0.3], [[0.0, 0.02], [0.04, 0.03]])
    seen = run(gripper, 0.4)
    expected = np.interp(np.arange(1, 101) * DT, [0.0, 0.1, 0.3], [0.04, 0.02, 0.03])
    np.testing.assert_allclose(seen, expected, atol=1e-12)
    assert gripper.position[2] == pytest.approx(0.04)


@pytest.mark.parametrize(("closes", "opened", "closed"), [("down", 0.04, 0.0), ("up", 0.0, 0.04)])
def test_it_stops_at_the_object_and_holds_it_until_it_opens(closes: str, opened: float, closed: float) -> None:
    gripper = Gripper(values(gripper__closes=closes, gripper__object_mass=0.5, gripper__object_at=0.02))
    gripper.close_to(opened)
    run(gripper, 0.6)
    assert gripper.held is None
    assert gripper.reached
    gripper.close_to(closed)
    run(gripper, 0.6)
    held = gripper.held
    assert held is not None
    assert held.mass == 0.5
    assert gripper.stalled
    assert not gripper.reached
    assert gripper.position[0] == 0.02
    run(gripper, 0.1)
    assert gripper.held is held, "an object stays the same one"
    gripper.close_to(opened)
    run(gripper, DT)
    assert gripper.held is None


def test_a_closed_gripper_holds_nothing_of_what_lies_outside() -> None:
    gripper = Gripper(values(robot__locked="left=0.0", gripper__object_mass=0.5, gripper__object_at=0.02))
    gripper.close_to(0.01)
    assert max(run(gripper, 0.3)) == pytest.approx(0.01)
    assert gripper.held is None


@pytest.mark.parametrize(
    ("names", "times", "points", "fastest", "cause"),
    [
        (["left"], [], [], 0.0, "there are no points"),
        (["right"], [0.0], [[0.0]], 0.0, "joints left are missing; the gripper has left, right"),
        (["left", "elbow"], [0.0], [[0.0, 0.0]], 0.0, "unknown joints elbow"),
        (["left", "left"], [0.0], [[0.0, 0.0]], 0.0, "named twice"),
        (["left"], [0.0], [[math.nan]], 0.0, "position of left is not finite"),
        (["left"], [0.0], [[0.05]], 0.0, "left is to leave its range, 0 to 0.04"),
        (["left"], [0.2, 0.1], [[0.0], [0.0]], 0.0, "do not increase"),
        (["left"], [math.nan], [[0.0]], 0.0, "do not increase"),
        (["left"], [-1.0], [[0.0]], 0.0, "do not increase"),
        (["left"], [0.0], [[0.0]], -1.0, "negative"),
    ],
)
def test_what_it_cannot_do_is_refused_and_changes_nothing(
    names: list[str], times: list[float], points: list[list[float]], fastest: float, cause: str
) -> None:
    gripper = Gripper(values())
    with pytest.raises(MessageError, match=cause):
        gripper.follow(names, times, points, fastest)
    assert set(run(gripper, 0.1)) == {0.04}


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ({"gripper.joints": "lefd"}, r"lefd is no joint: it must be locked; there are left.*; did you mean left\?"),
        ({"gripper.joints": "elbow"}, "elbow belongs to the arm"),
        ({"gripper.joints": "left", "robot.description": "two_link"}, "is a closed form; name the URDF"),
    ],
)
def test_a_gripper_that_does_not_exist_is_refused(settings: dict[str, Any], cause: str) -> None:
    arm = {"robot.description": ARM, "joints": ["shoulder", "elbow"]}
    if settings.get("robot.description"):
        arm = {}
    with pytest.raises(ParameterError, match=cause):
        simulator_node_schema({**arm, **settings})


def test_two_payloads_are_one_body() -> None:
    """As its parameters describe it, and as its parts have it: mass, first and second moment about the tool."""
    random = np.random.default_rng(1)
    parts = [Payload(m, random.normal(size=3), m * np.diag([1.0, 1.1, 1.2])) for m in (0.5, 2.0)]
    whole = payload_of(payload_settings(together(*parts), has_shape=True))

    def moments(p: Payload) -> Any:
        c = p.center_of_mass
        return np.hstack([p.mass, p.mass * c, (p.inertia + p.mass * (c @ c * np.eye(3) - np.outer(c, c))).ravel()])

    np.testing.assert_allclose(moments(whole), sum(moments(part) for part in parts), atol=1e-12)
    assert together(Payload(0.0), Payload(0.0)).mass == 0.0
