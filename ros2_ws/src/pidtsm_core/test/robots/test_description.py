"""Descriptions of arms: what is read, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.robots import find_robot, robot_schema
from pidtsm_core.robots.description import read_description
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.source import read_source
from pidtsm_core.robots.tree.layout import Column, rows


def link(name: str, mass: str = "2.0", inertia: str = "0.02 0.02 0.02", more: str = "") -> str:
    xx, yy, zz = inertia.split()
    return (
        f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>'
    )


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = "") -> str:
    limit = "" if kind == "continuous" else '<limit lower="-2" upper="1" effort="30" velocity="2"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.3 0 0" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/>{limit}{more}</joint>'
    )


BASE = '<link name="base"/>'
ARM = BASE + link("upper") + link("lower") + joint("shoulder", "base", "upper") + joint("elbow", "upper", "lower")


AFLOAT = ARM + link("boat") + joint("sea", "base", "boat", "{}")


def urdf(content: str) -> str:
    return f'<robot name="arm">{content}</robot>'


BROKEN = {
    "no XML": ("<robot>", "the description is not XML"),
    "not a robot": ("<html/>", "neither URDF nor MJCF: its root element is <html>"),
    "a moving link without inertial": (
        urdf(ARM.replace(link("upper"), '<link name="upper"/>')),
        "link upper: joint shoulder moves it, and it has no mass; give it an inertial",
    ),
    "a mass of zero": (urdf(ARM.replace(link("lower"), link("lower", mass="0"))), "lower"),
    "a negative mass": (urdf(ARM.replace(link("lower"), link("lower", mass="-1"))), "link lower: its mass is -1 kg"),
    "a mass that is no number": (
        urdf(ARM.replace(link("lower"), link("lower", mass="nan"))),
        "link lower: mass: 'nan' is not a number",
    ),
    "a mass in words": (urdf(ARM.replace(link("lower"), link("lower", mass="two"))), "link lower: mass: 'two'"),
    "an impossible inertia": (
        urdf(ARM.replace(link("upper"), link("upper", inertia="0.1 0.1 0.9"))),
        "link upper: no body has its",
    ),
    "a negative inertia": (
        urdf(ARM.replace(link("upper"), link("upper", inertia="-0.1 0.1 0.1"))),
        "link upper: no body has its",
    ),
    "a loop": (
        urdf(ARM + joint("again", "base", "lower")),
        "link lower: it is the child of two joints, elbow and again",
    ),
    "a circle": (
        urdf(ARM.replace('<parent link="base"/>', '<parent link="lower"/>')),
        "link upper: it is not connected to base: its joints form a loop",
    ),
    "a floating joint": (
        urdf(ARM + link("boat") + joint("sea", "base", "boat", "floating")),
        "joint sea: its type is float",
    ),
    "a planar joint": (
        urdf(ARM + link("boat") + joint("sea", "base", "boat", "planar")),
        "joint sea: its type is planar",
    ),
    "a joint without type": (urdf(ARM.replace(' type="revolute"', "")), "joint shoulder: its type is None"),
    "a joint without name": (urdf(ARM.replace('<joint name="elbow"', "<joint")), "a joint has no name"),
    "an unknown child": (urdf(ARM + joint("hook", "lower", "nothing")), "joint hook: there is no link nothing"),
    "an unknown parent": (
        urdf(ARM + link("hand") + joint("hook", "nothing", "hand")),
        "joint hook: there is no link nothing",
    ),
    "a revolute joint without limit": (
        urdf(ARM.replace('<limit lower="-2" upper="1" effort="30" velocity="2"/>', "")),
        "joint shoulder: a revolute joint needs a limit",
    ),
    "a limit in words": (urdf(ARM.replace('effort="30"', 'effort="much"')), "joint shoulder: effort: 'much'"),
    "a range without room": (
        urdf(ARM.replace('lower="-2" upper="1"', 'lower="1" upper="1"')),
        "joint shoulder: lower of its limit, 1, is not below upper, 1; swap",
    ),
    "a range the wrong way round": (
        urdf(ARM.replace('lower="-2" upper="1"', 'lower="1" upper="-2"')),
        "joint shoulder: lower of its limit, 1, is not below upper, -2; swap",
    ),
    "a range above zero only": (
        urdf(ARM.replace('lower="-2" upper="1"', 'lower="1"')),
        "joint shoulder: lower of its limit, 1, is not below upper, 0",
    ),
    **{
        f"{value} as {what}": (urdf(ARM.replace(good, good.replace(number, value))), f"{where}.*{value}.* is not ")
        for value in ("nan", "inf")
        for what, good, number, where in (
            ("effort", 'effort="30"', "30", "joint shoulder: effort"),
            ("lower", 'lower="-2"', "-2", "joint shoulder: lower"),
            ("mass", '<mass value="2.0"', "2.0", "link upper: mass"),
            ("inertia", 'ixx="0.02"', "0.02", "link upper: ixx of its inertia"),
            ("centre of mass", '<origin xyz="0.1 0 0"/><mass', "0.1", "link upper: its inertial: xyz of its origin"),
            ("rotation", 'rpy="0.1 0.2 0.3"', "0.2", "joint shoulder: rpy of its origin"),
            ("axis", 'axis xyz="0 0 1"', "1", "joint shoulder: xyz of its axis"),
        )
    },
    "an axis without direction": (
        urdf(ARM.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"')),
        "joint shoulder: its axis",
    ),
    "two numbers for an origin": (
        urdf(ARM.replace('rpy="0.1 0.2 0.3"', 'rpy="0.1 0.2"')),
        "joint shoulder: rpy of its origin is '0.1 0.2'; it needs three numbers",
    ),
    "no movable joint": (urdf(BASE), "no chain of movable joints|cannot be read"),
    "xacro in a URDF": (
        urdf(ARM + '<x:include xmlns:x="http://www.ros.org/wiki/xacro" filename="hand.xacro"/>'),
        "the description has elements of xacro; let the name of its file end with .xacro",
    ),
    "no links": (urdf(""), "the description has no links"),
    "two links of one name": (urdf(ARM + link("upper")), "two links are called upper"),
    "two joints of one name": (
        urdf(ARM + link("hand") + joint("elbow", "lower", "hand")),
        "two joints are called elbow",
    ),
}


@pytest.mark.parametrize(("text", "reason"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_description_is_refused_with_the_link_or_joint(text: str, reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason):
        read_description(text)
    with pytest.raises(ParameterError, match=r"robot\.description: .*") as refused:
        find_robot({"robot.description": text})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("joints", "locked", "reason"),
    [
        (("shoulder", "knee"), {}, "no movable joint knee; there are shoulder, elbow"),
        (("shoulder", "shoulder"), {}, "joint shoulder is chosen twice"),
        (("shoulder", "elbow"), {"elbow": 0.1}, "joint elbow is both chosen and locked"),
        (("shoulder",), {"knee": 0.1}, "no movable joint knee"),
        ((), {}, "choose the joints"),
        (("shoulder",), {"elbow": float("nan")}, "joint elbow cannot be locked at nan"),
    ],
)
def test_joints_that_do_not_exist_are_refused(joints: tuple[str, ...], locked: dict[str, float], reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason):
        read_description(urdf(ARM), joints, locked)


def test_a_mimicking_joint_is_locked_or_refused() -> None:
    finger = link("finger") + joint("grip", "lower", "finger", "prismatic", '<mimic joint="elbow"/>')
    assert read_description(urdf(ARM + finger), ("shoulder", "elbow")).locked == {"grip": 0.0}
    with pytest.raises(DescriptionError, match="joint grip mimics elbow"):
        read_description(urdf(ARM + finger))


def test_a_closed_loop_of_an_mjcf_is_refused() -> None:
    body = '<body name="{0}"><joint name="j{0}"/><inertial pos="0 0 1" mass="1" diaginertia="1 1 1"/></body>'
    bodies = f"<worldbody>{body.format('a')}{body.format('b')}</worldbody>"
    loop = '<equality><connect name="knot" body1="a" body2="b" anchor="0 0 1"/></equality>'
    assert read_description(f"<mujoco>{bodies}</mujoco>", ["ja", "jb"]).joints == ("ja", "jb")
    with pytest.raises(DescriptionError, match="constraint knot closes a loop"):
        read_description(f"<mujoco>{bodies}{loop}</mujoco>", ["ja", "jb"])


def test_limits_friction_and_types_are_read() -> None:
    dynamics = '<dynamics damping="1.5" friction="0.5"/>'
    more = link("wheel") + joint("roll", "lower", "wheel", "continuous", '<limit effort="5" velocity="3"/>' + dynamics)
    more += link("slide") + joint("lift", "wheel", "slide", "prismatic")
    arm = read_description(urdf(ARM + more))
    assert arm.joints == ("shoulder", "elbow", "roll", "lift")
    assert arm.slides.tolist() == [False, False, False, True]
    assert arm.lower.tolist() == [-2.0, -2.0, -math.inf, -2.0]
    assert arm.upper.tolist() == [1.0, 1.0, math.inf, 1.0]
    assert arm.effort.tolist() == [30.0, 30.0, 5.0, 30.0]
    assert arm.velocity.tolist() == [2.0, 2.0, 3.0, 2.0]
    assert arm.damping.tolist() == [0.0, 0.0, 1.5, 0.0]
    assert arm.friction.tolist() == [0.0, 0.0, 0.5, 0.0]


def test_a_locked_joint_becomes_part_of_its_link() -> None:
    whole = read_description(urdf(ARM), ("shoulder",), {"elbow": 0.7})
    assert rows(whole.tree)[0, Column.MASS] == pytest.approx(4.0)
    assert whole.locked == {"elbow": 0.7}
    assert read_description(urdf(ARM.replace('lower="-2"', 'lower="0.5"')), ("shoulder",)).locked == {"elbow": 0.5}


def test_missing_meshes_do_not_matter() -> None:
    mesh = '<visual><geometry><mesh filename="package://nowhere/upper.dae"/></geometry></visual>'
    seen = read_description(
        urdf(ARM.replace(link("upper"), link("upper", more=mesh + mesh.replace("visual", "collision"))))
    )
    np.testing.assert_array_equal(seen.tree, read_description(urdf(ARM)).tree)


def test_a_description_is_a_name_a_file_a_uri_or_its_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = urdf(ARM)
    folder = tmp_path / "share" / "my_arm" / "urdf"
    folder.mkdir(parents=True)
    (folder / "arm.urdf").write_text(text)
    macro = text.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ').replace(
        '"2.0"', '"${1.0 + 1.0}"'
    )
    (folder / "arm.urdf.xacro").write_text(macro)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    sources = (text, str(folder / "arm.urdf"), "package://my_arm/urdf/arm.urdf", str(folder / "arm.urdf.xacro"))
    trees = [read_description(read_source(source)[1]).tree for source in sources]
    for tree in trees[1:]:
        np.testing.assert_array_equal(tree, trees[0])
    assert [read_source(source)[0] for source in sources] == ["arm"] * 4
    with pytest.raises(DescriptionError, match="the package your_arm is not among the installed packages"):
        read_source("package://your_arm/arm.urdf")
    with pytest.raises(DescriptionError, match=r"nowhere\.urdf: No such file or directory; neither a file nor"):
        read_source("nowhere.urdf")
    (folder / "broken.urdf.xacro").write_text(macro.replace("1.0 + 1.0", "mass"))
    with pytest.raises(DescriptionError, match=r"broken\.urdf\.xacro: .*mass"):
        read_source(str(folder / "broken.urdf.xacro"))


def test_an_mjcf_finds_its_files_wherever_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "assets").mkdir()
    corners = ("0 0 0", "0.2 0 0", "0 0.2 0", "0 0 0.2")
    faces = ("1 3 2", "1 2 4", "1 4 3", "2 3 4")
    lines = [*(f"v {corner}" for corner in corners), *(f"f {face}" for face in faces)]
    (tmp_path / "assets" / "rod.obj").write_text("\n".join(lines))
    rod = '<body name="{0}"><joint name="{0}" axis="0 1 0"/><geom type="mesh" mesh="rod"/>'
    (tmp_path / "second.xml").write_text(f"<mujoco>{rod.format('second')}</body></mujoco>")
    (tmp_path / "arm.xml").write_text(
        '<mujoco><compiler meshdir="assets"/><asset><mesh name="rod" file="rod.obj"/></asset><worldbody>'
        f'{rod.format("first")}<include file="second.xml"/></body></worldbody></mujoco>'
    )
    monkeypatch.chdir("/")
    name, text = read_source(str(tmp_path / "arm.xml"))
    assert name == "arm"
    assert read_description(text).joints == ("first", "second")
    (tmp_path / "arm.xml").write_text('<mujoco><include file="arm.xml"/></mujoco>')
    with pytest.raises(DescriptionError, match=r"arm\.xml includes itself"):
        read_source(str(tmp_path / "arm.xml"))
    (tmp_path / "arm.xml").write_text('<mujoco><include file="third.xml"/></mujoco>')
    with pytest.raises(DescriptionError, match=r"included file .*third\.xml cannot be read"):
        read_source(str(tmp_path / "arm.xml"))


def test_the_motors_of_an_mjcf_limit_the_efforts() -> None:
    body = '<body name="{0}"><joint name="{0}" axis="0 1 0"/><inertial pos="0 0 1" mass="1" diaginertia="1 1 1"/>'
    motors = (
        '<motor joint="a" ctrllimited="true" ctrlrange="-2 2" gear="30"/>'
        '<position joint="b" kp="5" ctrllimited="true" ctrlrange="-1 1"/>'
    )
    text = f"<worldbody>{body.format('a')}{body.format('b')}</body></body></worldbody><actuator>{motors}</actuator>"
    assert read_description(f"<mujoco>{text}</mujoco>").effort.tolist() == [60.0, math.inf]


def test_an_arm_without_effort_limits_needs_them_as_parameter() -> None:
    text = urdf(ARM.replace('effort="30"', 'effort="0"'))
    with pytest.raises(ParameterError, match=r"limits\.effort: the description has no effort limit of shoulder, elbow"):
        robot_schema({"robot.description": text})
    values = resolve(robot_schema, {"robot.description": text, "limits.effort": 20.0}, 2)
    assert values["limits.effort"] == 20.0


def test_model_errors_and_payloads_change_the_tree() -> None:
    robot = find_robot({"robot.description": urdf(ARM)})
    values = resolve(robot_schema, {"robot.description": urdf(ARM)}, 2)
    exact = robot.pack_model(values)
    heavier = robot.pack_model(values, factors={"mass": 1.25})
    np.testing.assert_allclose(rows(heavier)[:, Column.MASS :], 1.25 * rows(exact)[:, Column.MASS :])
    longer = robot.pack_model(values, factors={"length": 2.0})
    np.testing.assert_allclose(rows(longer)[:, Column.MOMENT], 2.0 * rows(exact)[:, Column.MOMENT])
    np.testing.assert_array_equal(robot.pack_model(values, factors={"mass": 1.0, "inertia": 1.0, "length": 1.0}), exact)
    loaded = rows(robot.with_payload(exact, Payload(3.0)))
    assert loaded[:, Column.MASS].tolist() == pytest.approx([2.0, 5.0])


def test_a_range_of_an_mjcf_without_room_is_refused_by_name() -> None:
    body = (
        '<body name="a"><joint name="swing" range="1 {}"/><inertial pos="0 0 1" mass="1" diaginertia="1 1 1"/></body>'
    )
    arm = "<mujoco><compiler autolimits='true'/><worldbody>{}</worldbody></mujoco>"
    assert read_description(arm.format(body.format(2))).joints == ("swing",)
    for upper in ("1", "0.5", "nan"):
        with pytest.raises(DescriptionError, match=r"joint swing: lower of its limit, 1, is not below upper, |swing"):
            read_description(arm.format(body.format(upper)))


def test_a_joint_that_does_not_move_needs_no_room() -> None:
    finger = link("finger") + joint("grip", "lower", "finger", "prismatic").replace('lower="-2" upper="1"', 'lower="0"')
    assert read_description(urdf(ARM + finger), ("shoulder", "elbow")).locked == {"grip": 0.0}
