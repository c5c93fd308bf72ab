"""Checks of arms: seeded mistakes are named with their element, and sound arms get no doubts."""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pytest
from support.testarms import CRANE, PENDULUM, TURNTABLE

from pidtsm_core.robots import NAMES
from pidtsm_core.robots.check import FIXED, LOCKED, USED, check_arm
from pidtsm_core.robots.check.elements import element_lines
from pidtsm_core.robots.source import read_source

BASES = {
    "pendulum": PENDULUM.description,
    "turntable": TURNTABLE,
    "crane": CRANE.description,
    "scara": read_source("scara")[1],
    "z1": read_source("z1")[1],
    "panda": read_source("panda")[1],
}
"""Sound descriptions of arms with 1 to 7 joints."""


@dataclass(frozen=True)
class Mistake:
    """A mistake in a description.

    Attributes:
        codes: what the check may call it.
        kind: of the element that must be named.
        seed: makes the mistake in the joint, or in the link that the joint moves; False: it cannot.
    """

    codes: tuple[str, ...]
    kind: str
    seed: Callable[[Element, Element, Element], bool]


def child(element: Element, path: str) -> Element:
    found = element.find(path)
    assert found is not None
    return found


def scaled(element: Element, path: str, factor: float, *names: str) -> bool:
    found = element.find(path)
    if found is None:
        return False
    for name in names or tuple(found.attrib):
        if name in found.attrib:
            found.set(name, " ".join(str(factor * float(word)) for word in found.attrib[name].split()))
    return True


def limit(joint: Element, **values: str | None) -> bool:
    """Set attributes of the limits of a joint, or remove them."""
    found = child(joint, "limit")
    for name, value in values.items():
        if value is None:
            found.attrib.pop(name)
        else:
            found.set(name, value)
    return True


def turns(joint: Element) -> bool:
    return joint.get("type") == "revolute"


def has_range(joint: Element) -> bool:
    return joint.get("type") != "continuous"


def has_upper(joint: Element) -> bool:
    """Whether the joint still has a range without its lower limit, which counts as 0 then."""
    return float(child(joint, "limit").get("upper", "0")) > 0.0


def in_degrees(_root: Element, joint: Element, _link: Element) -> bool:
    return turns(joint) and scaled(joint, "limit", 180.0 / math.pi, "lower", "upper")


def far_center(_root: Element, _joint: Element, link: Element) -> bool:
    child(link, "inertial/origin").set("xyz", "1.5 0.2 0.8")
    return True


def without_rotor(root: Element, joint: Element, _link: Element) -> bool:
    """A light wrist whose rotor is forgotten."""
    dynamics = joint.find("dynamics")
    if dynamics is None or joint.get("name") not in ("joint4", "joint6") or not turns(joint):
        return False
    for transmission in list(root.findall("transmission")):
        if child(transmission, "joint").get("name") == joint.get("name"):
            root.remove(transmission)
    return True


def heavy_rotor(root: Element, joint: Element, _link: Element) -> bool:
    """The square of the gear ratio is counted twice."""
    drives = [each for each in root.findall("transmission") if child(each, "joint").get("name") == joint.get("name")]
    return bool(drives) and scaled(child(drives[0], "actuator"), "{*}rotor_inertia", 1e4)


def set_dynamics(joint: Element, name: str, value: str) -> bool:
    found = joint.find("dynamics")
    if found is None:
        found = ElementTree.SubElement(joint, "dynamics")
    found.set(name, value)
    return True


def removed(element: Element, name: str) -> bool:
    element.remove(child(element, name))
    return True


def set_on(element: Element, path: str, name: str, value: str) -> bool:
    child(element, path).set(name, value)
    return True


MISTAKES = {
    "limits in degrees": Mistake(("limits-degrees",), "joint", in_degrees),
    "limits of 140 degrees": Mistake(
        ("limits-degrees",), "joint", lambda _r, j, _l: turns(j) and limit(j, lower="-140", upper="140")
    ),
    "limits in millimetres": Mistake(
        ("limits-millimetres",),
        "joint",
        lambda _r, j, _l: j.get("type") == "prismatic" and scaled(j, "limit", 1000.0, "lower", "upper"),
    ),
    "an effort in millinewton metres": Mistake(
        ("effort-large",), "joint", lambda _r, j, _l: scaled(j, "limit", 1000.0, "effort")
    ),
    "limits that are swapped": Mistake(
        ("refused",), "joint", lambda _r, j, _l: has_range(j) and limit(j, lower="1", upper="-2")
    ),
    "limits without room": Mistake(
        ("refused",), "joint", lambda _r, j, _l: has_range(j) and limit(j, lower="0", upper="0")
    ),
    "no velocity": Mistake(("velocity-missing",), "joint", lambda _r, j, _l: limit(j, velocity=None)),
    "a velocity of 0": Mistake(("velocity-zero",), "joint", lambda _r, j, _l: limit(j, velocity="0")),
    "a velocity in degrees": Mistake(
        ("velocity-large",), "joint", lambda _r, j, _l: turns(j) and limit(j, velocity="180")
    ),
    "a negative velocity": Mistake(("refused",), "joint", lambda _r, j, _l: limit(j, velocity="-2")),
    "a velocity of nearly 0": Mistake(("velocity-small",), "joint", lambda _r, j, _l: limit(j, velocity="0.0002")),
    "no lower limit": Mistake(("limits-missing",), "joint", lambda _r, j, _l: has_upper(j) and limit(j, lower=None)),
    "a weak motor": Mistake(
        ("too-weak-to-move", "too-weak-for-gravity"), "joint", lambda _r, j, _l: scaled(j, "limit", 0.001, "effort")
    ),
    "a heavy rotor": Mistake(("too-weak-to-move",), "joint", heavy_rotor),
    "its own parent": Mistake(
        ("refused",), "joint", lambda _r, j, _l: set_on(j, "parent", "link", child(j, "child").get("link", ""))
    ),
    "no effort": Mistake(("effort-missing",), "joint", lambda _r, j, _l: limit(j, effort=None)),
    "an effort of 0": Mistake(("effort-zero",), "joint", lambda _r, j, _l: limit(j, effort="0")),
    "an effort that is not a number": Mistake(("refused",), "joint", lambda _r, j, _l: limit(j, effort="nan")),
    "an infinite limit": Mistake(("refused",), "joint", lambda _r, j, _l: has_range(j) and limit(j, upper="inf")),
    "no axis": Mistake(("axis-missing",), "joint", lambda _r, j, _l: removed(j, "axis")),
    "an axis of zeros": Mistake(("refused",), "joint", lambda _r, j, _l: set_on(j, "axis", "xyz", "0 0 0")),
    "an origin in millimetres": Mistake(
        ("origin-far",), "joint", lambda _r, j, _l: set_on(j, "origin", "xyz", "0 0 316")
    ),
    "an origin in degrees": Mistake(
        ("origin-degrees",), "joint", lambda _r, j, _l: set_on(j, "origin", "rpy", "-90 0 0")
    ),
    "an origin that is not a number": Mistake(
        ("refused",), "joint", lambda _r, j, _l: set_on(j, "origin", "xyz", "0 nan 0")
    ),
    "an unknown parent": Mistake(("refused",), "joint", lambda _r, j, _l: set_on(j, "parent", "link", "nothing")),
    "much friction": Mistake(
        ("too-light-for-friction", "rotor-missing"), "joint", lambda _r, j, _l: set_dynamics(j, "damping", "20000")
    ),
    "friction beyond the motor": Mistake(
        ("too-weak-for-friction",), "joint", lambda _r, j, _l: set_dynamics(j, "friction", "900")
    ),
    "negative friction": Mistake(("refused",), "joint", lambda _r, j, _l: set_dynamics(j, "damping", "-1")),
    "no rotor": Mistake(("rotor-missing",), "joint", without_rotor),
    "a mass of 7 g": Mistake(("mass-small",), "link", lambda _r, _j, n: set_on(n, "inertial/mass", "value", "0.007")),
    "a mass in grams": Mistake(
        ("mass-large", "inertia-small"), "link", lambda _r, _j, n: scaled(n, "inertial/mass", 1000.0)
    ),
    "a negative mass": Mistake(("refused",), "link", lambda _r, _j, n: set_on(n, "inertial/mass", "value", "-2")),
    "a mass that is not a number": Mistake(
        ("refused",), "link", lambda _r, _j, n: set_on(n, "inertial/mass", "value", "nan")
    ),
    "no element of mass": Mistake(("refused",), "link", lambda _r, _j, n: removed(child(n, "inertial"), "mass")),
    "an incomplete inertia": Mistake(
        ("refused",), "link", lambda _r, _j, n: child(n, "inertial/inertia").attrib.pop("iyy") is not None
    ),
    "no mass": Mistake(("refused",), "link", lambda _r, _j, n: removed(n, "inertial")),
    "a centre of mass outside": Mistake(("center-outside",), "link", far_center),
    "a centre of mass in millimetres": Mistake(
        ("center-outside",), "link", lambda _r, _j, n: set_on(n, "inertial/origin", "xyz", "20 40 120")
    ),
    "a large inertia": Mistake(("inertia-large",), "link", lambda _r, _j, n: scaled(n, "inertial/inertia", 1000.0)),
    "a small inertia": Mistake(("inertia-small",), "link", lambda _r, _j, n: scaled(n, "inertial/inertia", 0.0005)),
    "an inertia that no body has": Mistake(
        ("refused", "inertia-impossible"), "link", lambda _r, _j, n: set_on(n, "inertial/inertia", "ixx", "3")
    ),
    "a negative inertia": Mistake(
        ("refused", "inertia-impossible"), "link", lambda _r, _j, n: scaled(n, "inertial/inertia", -1.0)
    ),
    "an inertia of zeros": Mistake(
        ("refused", "inertia-small"), "link", lambda _r, _j, n: scaled(n, "inertial/inertia", 0.0)
    ),
}


def seeded() -> Iterator[tuple[str, str, str, Mistake]]:
    """Each mistake in each arm, in one of its joints or its link: name, text, name of the element, mistake."""
    for base, text in BASES.items():
        for turn, (what, mistake) in enumerate(MISTAKES.items()):
            root = ElementTree.fromstring(text)
            movable = [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]
            for joint in movable[turn % len(movable) :] + movable[: turn % len(movable)]:
                name = child(joint, "child").get("link")
                link = next(each for each in root.findall("link") if each.get("name") == name)
                # A heavier link that is fixed to it would hide the mistake.
                hidden = mistake.kind == "link" and name == "link06"
                if not hidden and mistake.seed(root, joint, link):
                    element = joint if mistake.kind == "joint" else link
                    yield f"{what} in {base}", ElementTree.tostring(root, "unicode"), element.get("name", ""), mistake
                    break


SEEDED = list(seeded())


@pytest.mark.parametrize(("text", "name", "mistake"), [each[1:] for each in SEEDED], ids=[each[0] for each in SEEDED])
def test_a_mistake_is_named_with_its_element_and_a_cure(text: str, name: str, mistake: Mistake) -> None:
    found = check_arm({"robot.description": text})
    named = [found.refusal] if found.refusal else list(found.doubts)
    codes = [(each.code, each.kind, each.name) for each in named]
    assert any((code, mistake.kind, name) in codes for code in mistake.codes), codes
    for each in named:
        assert each.line == element_lines(text)[each.kind, each.name]
        assert "\n" not in str(each)


@pytest.mark.parametrize("name", NAMES)
def test_the_arms_of_the_project_have_no_doubts(name: str) -> None:
    found = check_arm({"robot.description": name})
    assert (found.refusal, found.doubts, found.notes) == (None, (), ())
    assert len(found.used) == len(found.loads)
    for joint, load in zip(found.used, found.loads, strict=True):
        assert 0.0 <= load.gravity < joint.effort
        assert 0.0 < load.least_inertia <= load.largest_inertia


def test_a_weak_shoulder_is_named_itself() -> None:
    text = read_source("ur5")[1]
    root = ElementTree.fromstring(text)
    shoulder = next(joint for joint in root.findall("joint") if joint.get("name") == "shoulder_lift_joint")
    limit(shoulder, effort="40")
    (doubt,) = check_arm({"robot.description": ElementTree.tostring(root, "unicode")}).doubts
    assert (doubt.code, doubt.name) == ("too-weak-for-gravity", "shoulder_lift_joint")
    assert re.search(r"gravity takes up to 59\.\d N m of its 40 N m", str(doubt))


def test_effort_limits_a_payload_and_rotors_may_be_given_beside_the_description() -> None:
    text = re.sub(' effort="[^"]*"', "", TURNTABLE)
    bare = check_arm({"robot.description": text})
    assert [doubt.code for doubt in bare.doubts] == ["effort-missing", "effort-missing"]
    given = {"robot.description": text, "limits.effort": (60.0, 20.0), "robot.armature": (0.4, 0.4)}
    found = check_arm(given)
    assert found.doubts == ()
    assert [(joint.effort, joint.armature) for joint in found.used] == [(60.0, 0.4), (20.0, 0.4)]
    assert found.loads[1].least_inertia > bare.loads[1].least_inertia + 0.2
    (weak,) = check_arm({**given, "payload.mass": 5.0}).doubts
    assert (weak.code, weak.name) == ("too-weak-for-gravity", "joint2")


def hand(*fingers: str) -> str:
    """Fingers on the last link of the turntable, and a lift below it; and a camera beside it."""
    links = "".join(
        f'<link name="{name}"><inertial><origin xyz="0 0 0.02"/><mass value="0.03"/>'
        '<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for name in (*fingers, "lens")
    )
    slide = (
        '<joint name="to_{0}" type="prismatic"><parent link="{1}"/><child link="{0}"/><axis xyz="0 1 0"/>'
        '<limit lower="0" upper="0.04" effort="20" velocity="0.1"/>{2}</joint>'
    )
    mimic = f'<mimic joint="to_{fingers[0]}"/>'
    joints = "".join(slide.format(name, "boom", mimic if i else "") for i, name in enumerate(fingers))
    return TURNTABLE.replace("</robot>", f"{links}{joints}{slide.format('lens', 'base', '')}</robot>")


def test_every_joint_has_a_role_and_a_reason() -> None:
    found = check_arm({"robot.description": hand("left", "right"), "joints": ["joint1", "joint2"]})
    assert found.refusal is None
    assert {joint.name: (joint.role, joint.reason) for joint in found.joints} == {
        "joint1": (USED, "chosen"),
        "joint2": (USED, "chosen"),
        "to_left": (LOCKED, "gripper, behind boom"),
        "to_right": (LOCKED, "mimics to_left"),
        "to_lens": (LOCKED, "on another branch, from base"),
        "mount": (FIXED, "fixed, moves with its parent"),
    }
    assert found.mimics == {"to_right": "to_left"}
    assert found.format == "URDF"
    assert found.base == "base"
    assert math.isclose(found.reach, math.hypot(0.1, 0.2) + 0.4)


def test_what_no_motor_moves_is_locked_for_that_reason() -> None:
    body = '<body name="{0}" pos="0 0 0.3"><joint name="{0}" axis="0 1 0" range="-90 90" armature="0.1"/>'
    mass = '<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>'
    motors = '<motor joint="upper" ctrlrange="-50 50"/><motor joint="lower" ctrlrange="-30 30"/>'
    text = (
        f"<mujoco><worldbody>{body.format('upper')}{mass}{body.format('lower')}{mass}"
        f"{body.format('door')}{mass}</body></body></body></worldbody><actuator>{motors}</actuator></mujoco>"
    )
    found = check_arm({"robot.description": text})
    assert [(joint.name, joint.role) for joint in found.joints] == [("upper", USED), ("lower", USED), ("door", LOCKED)]
    assert found.locked[0].reason == "no motor moves it"
    assert found.doubts == ()
    narrow = check_arm({"robot.description": text.replace("-90 90", "-1.5 1.5")})
    assert {(doubt.code, doubt.name) for doubt in narrow.doubts} == {
        ("limits-narrow", "upper"),
        ("limits-narrow", "lower"),
    }


def test_a_mistake_that_cannot_matter_is_a_note() -> None:
    bad = TURNTABLE.replace(
        '<link name="base"/>',
        '<link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="9" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>",
    )
    found = check_arm({"robot.description": bad})
    assert found.doubts == ()
    assert [(note.code, note.name) for note in found.notes] == [("inertia-impossible", "base")]


def test_a_file_is_named_with_the_line_unless_it_was_expanded(tmp_path: Path) -> None:
    text = TURNTABLE.replace("><", ">\n<").replace('velocity="2.5"', 'velocity="0"')
    for name in ("arm.urdf", "arm.urdf.xacro"):
        (tmp_path / name).write_text(text)
    found = check_arm({"robot.description": str(tmp_path / "arm.urdf")})
    (doubt,) = found.doubts
    line = 1 + text.splitlines().index('<joint name="joint2" type="revolute">')
    assert found.where(doubt) == f"{tmp_path / 'arm.urdf'}:{line}"
    expanded = check_arm({"robot.description": str(tmp_path / "arm.urdf.xacro")})
    assert (expanded.format, expanded.where(expanded.doubts[0])) == ("xacro", str(tmp_path / "arm.urdf.xacro"))


def test_what_cannot_be_read_is_refused_with_the_reason(tmp_path: Path) -> None:
    missing = check_arm({"robot.description": str(tmp_path / "nowhere.urdf")})
    assert missing.refusal is not None
    assert str(missing.refusal).startswith(f"{tmp_path / 'nowhere.urdf'}: No such file")
    unknown = check_arm({"robot.description": "panda", "joints": ["panda_joint8"]})
    assert unknown.refusal is not None
    assert "no movable joint panda_joint8" in str(unknown.refusal)
    assert unknown.as_json()["usable"] is False
