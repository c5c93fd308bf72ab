"""Which joints of a description are the arm, and which its gripper."""

import mujoco
import pytest

from pidtsm_core.robots import NAMES, DescriptionError, TreeRobot, compiler, find_robot
from pidtsm_core.robots.description import Description, read_description


def link(name: str, mass: float = 2.0) -> str:
    inertia = f'<inertia ixx="{mass / 50}" iyy="{mass / 50}" izz="{mass / 50}" ixy="0" ixz="0" iyz="0"/>'
    return (
        f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="{mass}"/>{inertia}</inertial></link>'
        if mass
        else f'<link name="{name}"/>'
    )


def joint(name: str, parent: str, child: str, kind: str = "revolute", low: float = -2.0, high: float = 2.0) -> str:
    limit = "" if kind == "fixed" else f'<limit lower="{low}" upper="{high}" effort="30" velocity="2"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{limit}</joint>'


def arm(side: str = "", base: str = "base") -> str:
    """Three links of 2 kg, of which the last is called wrist."""
    chain = ((base, "upper", "shoulder"), ("upper", "lower", "elbow"), ("lower", "wrist", "roll"))
    return "".join(
        link(side + child) + joint(side + name, parent if parent == base else side + parent, side + child)
        for parent, child, name in chain
    )


def read(content: str, **given: object) -> Description:
    return read_description(f'<robot name="r">{link("base", 0.0)}{content}</robot>', **given)  # type: ignore[arg-type]


JOINTS = ("shoulder", "elbow", "roll")
MIMIC = joint("b", "wrist", "right").replace("</joint>", '<mimic joint="roll"/></joint>')
GRIPPERS = {
    "two fingers on one link": (
        link("left", 0.1) + joint("a", "wrist", "left") + link("right", 0.1) + joint("b", "wrist", "right"),
        {"a": "side by side behind roll", "b": "side by side behind roll"},
    ),
    "a name": (link("left", 0.2) + joint("my_gripper", "wrist", "left"), {"my_gripper": "by its name"}),
    "the name of a link": (link("jaw", 0.2) + joint("a", "wrist", "jaw"), {"a": "by its name"}),
    "a coupled joint": (link("right", 0.2) + MIMIC, {"b": "coupled to roll"}),
    "a short stroke": (
        link("left", 0.2) + joint("a", "wrist", "left", "prismatic", 0.0, 0.04),
        {"a": "it slides 40 mm only"},
    ),
    "a tiny link beside a fixed one": (
        link("palm", 0.3)
        + joint("weld", "wrist", "palm", "fixed")
        + link("left", 0.05)
        + joint("a", "wrist", "left", "revolute", 0.0, 1.5),
        {"a": "it moves only 0.05 kg, beside a fixed part"},
    ),
    "two joints in a row": (
        link("finger1", 0.1) + joint("a", "wrist", "finger1") + link("finger2", 0.1) + joint("b", "finger1", "finger2"),
        {"a": "by its name", "b": "by its name"},
    ),
}


@pytest.mark.parametrize(("content", "expected"), GRIPPERS.values(), ids=GRIPPERS)
def test_a_gripper_is_recognised_and_locked(content: str, expected: dict[str, str]) -> None:
    found = read(arm() + content)
    assert found.joints == JOINTS
    assert set(found.locked) == set(found.grippers) == set(expected)
    for name, reason in expected.items():
        assert found.grippers[name].startswith(reason)


ARMS = {
    "a heavy last link with such a name": link("gripper", 1.0) + joint("last", "wrist", "gripper"),
    "a vertical axis": link("quill", 0.2) + joint("last", "wrist", "quill", "prismatic", 0.0, 0.2),
    "a wrist": link("flange", 0.05) + joint("last", "wrist", "flange"),
    "a wrist beside a camera": link("camera", 0.1)
    + joint("weld", "wrist", "camera", "fixed")
    + link("flange", 0.05)
    + joint("last", "wrist", "flange"),
}


@pytest.mark.parametrize("content", ARMS.values(), ids=ARMS)
def test_what_is_no_gripper_moves(content: str) -> None:
    found = read(arm() + content)
    assert found.joints == (*JOINTS, "last")
    assert not found.locked


def test_an_arm_keeps_two_joints() -> None:
    found = read(link("upper") + joint("a", "base", "upper") + link("finger", 0.1) + joint("b", "upper", "finger"))
    assert found.joints == ("a", "b")


@pytest.mark.parametrize("name", NAMES)
def test_no_arm_of_the_package_has_a_gripper(name: str) -> None:
    robot = find_robot({"robot.description": name})
    assert not isinstance(robot, TreeRobot) or not robot.description.locked


def test_joints_that_the_user_chooses_are_no_gripper() -> None:
    content = arm() + GRIPPERS["a name"][0]
    assert read(content, joints=(*JOINTS, "my_gripper")).joints == (*JOINTS, "my_gripper")
    found = read(content, joints=("shoulder",))
    assert not found.grippers
    assert set(found.locked) == {"elbow", "roll", "my_gripper"}


def test_a_locked_joint_leaves_the_chain() -> None:
    found = read(arm(), locked={"elbow": 0.5})
    assert found.joints == ("shoulder", "roll")
    assert found.locked == {"elbow": 0.5}


def test_of_two_arms_none_is_chosen_and_the_cure_works() -> None:
    both = arm("left_") + GRIPPERS["a name"][0].replace('"wrist"', '"left_wrist"') + arm("right_")
    with pytest.raises(DescriptionError, match="several chains of movable joints begin at the base") as refusal:
        read(both)
    left, right = "left_shoulder,left_elbow,left_roll", "right_shoulder,right_elbow,right_roll"
    assert f"--joints {left} or --joints {right}" in str(refusal.value)
    assert read(both, joints=right.split(",")).joints == tuple(right.split(","))


def test_a_lift_below_two_arms_is_not_taken_for_the_arm() -> None:
    lift = link("torso") + joint("lift", "base", "torso", "prismatic", 0.0, 0.5)
    with pytest.raises(DescriptionError, match=r"begin behind joint lift; .* --joints lift,left_shoulder,left_elbow"):
        read(lift + arm("left_", "torso") + arm("right_", "torso"))


def test_an_arm_with_a_short_branch_ends_there() -> None:
    """As before: what follows has fewer joints than the arm, but is no gripper."""
    branches = link("a") + joint("a", "wrist", "a") + link("b") + joint("b", "wrist", "b")
    assert read(arm() + branches).joints == JOINTS


def test_the_numbers_of_mujoco_are_those_of_mujoco() -> None:
    joint, motor, constraint = mujoco.mjtJoint, mujoco.mjtTrn, mujoco.mjtEq
    assert (joint.mjJNT_SLIDE, joint.mjJNT_HINGE) == (compiler.SLIDE, compiler.HINGE)
    assert motor.mjTRN_JOINT == compiler.ON_JOINT
    numbers = constraint.mjEQ_CONNECT, constraint.mjEQ_WELD, constraint.mjEQ_JOINT
    assert numbers == (compiler.CONNECT, compiler.WELD, compiler.COUPLE)
