"""The URDF describes the arm of the article: same numbers, and the same dynamics in Pinocchio."""

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from ament_index_python.packages import get_package_share_directory
from numpy.typing import NDArray

from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot, robot_schema
from pidtsm_core.robots.tree.layout import inertia_matrix, rows, set_inertia
from pidtsm_core.robots.two_link import TWO_LINK, forward_dynamics, inverse_dynamics

FOLDER = Path(get_package_share_directory("two_link_sim"), "urdf")
URDF = FOLDER / "two_link.urdf"
SRDF = FOLDER / "two_link.srdf"
DEFAULTS: dict[str, Any] = {p.name: p.default for p in TWO_LINK.parameters}


def numbers(element: ElementTree.Element, path: str, attribute: str) -> list[float]:
    return [float(found.attrib[attribute]) for found in element.findall(path)]


def test_numbers_are_those_of_the_robot_model() -> None:
    robot = ElementTree.parse(URDF).getroot()
    joints = [j.attrib["name"] for j in robot.findall("joint") if j.attrib["type"] != "fixed"]
    ends = [e.attrib["xyz"].split() for e in robot.findall("link/inertial/origin")]

    assert robot.attrib["name"] == TWO_LINK.name
    assert joints == list(TWO_LINK.joints)
    assert numbers(robot, "link/inertial/mass", "value") == [DEFAULTS["m1"], DEFAULTS["m2"]]
    assert [float(x) for x, _, _ in ends] == [DEFAULTS["r1"], DEFAULTS["r2"]]
    assert [o.attrib["xyz"].split() for o in robot.findall("joint/origin")[1:]] == ends  # elbow, tool
    assert numbers(robot, "joint/limit", "effort") == list(TWO_LINK.effort_limit)
    rotors = ElementTree.parse(SRDF).getroot()
    assert [j.attrib["name"] for j in rotors.findall("rotor_params/joint")] == joints
    assert numbers(rotors, "rotor_params/joint", "mass") == [DEFAULTS["j1"], DEFAULTS["j2"]]


def motions() -> list[NDArray[np.float64]]:
    """20 states: q, q' and a third row, used as acceleration or torque."""
    return list(np.random.default_rng(0).uniform(-3.0, 3.0, (20, 3, 2)))


def closed_form() -> NDArray[np.float64]:
    """Parameters with the Coriolis terms of Lagrange's equations."""
    return TWO_LINK.pack_model({f"robot.{name}": v for name, v in {**DEFAULTS, "coriolis": "lagrange"}.items()})


def test_the_urdf_read_as_data_has_the_dynamics_of_the_closed_form() -> None:
    settings = {"robot.description": str(URDF), "robot.armature": [float(DEFAULTS["j1"]), float(DEFAULTS["j2"])]}
    read = find_robot(settings)
    tree = read.pack_model(resolve(robot_schema, settings, 2))
    tree[:3] = 0.0, 0.0, -float(DEFAULTS["g"])
    for row in rows(tree):  # The closed form has point masses.
        set_inertia(row, inertia_matrix(row) - 1e-9 * np.eye(3))
    effort, expected, acceleration = np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(2)
    for q, dq, third in motions():
        inverse_dynamics(q, dq, third[np.newaxis], closed_form(), expected)
        read.dynamics.inverse_dynamics(q, dq, third[np.newaxis], tree, effort)
        np.testing.assert_allclose(effort, expected, rtol=1e-12, atol=1e-12)
        read.dynamics.forward_dynamics(q, dq, expected[0], tree, acceleration)
        np.testing.assert_allclose(acceleration, third, rtol=1e-12, atol=1e-12)


def test_dynamics_are_the_closed_form() -> None:
    """Inverse dynamics match RNEA, forward dynamics ABA; with `lagrange`, since (49) as printed is not physical."""
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed, see requirements/README.md")
    model = pinocchio.buildModelFromUrdf(str(URDF))
    pinocchio.loadRotorParameters(model, str(SRDF), False)
    model.gravity.linear = np.array([0.0, 0.0, -float(DEFAULTS["g"])])
    data = model.createData()
    packed = closed_form()

    assert list(model.names)[1:] == list(TWO_LINK.joints)
    effort, acceleration = np.zeros((1, 2)), np.zeros(2)
    for q, dq, third in motions():
        inverse_dynamics(q, dq, third[np.newaxis], packed, effort)
        np.testing.assert_allclose(effort[0], pinocchio.rnea(model, data, q, dq, third), rtol=1e-7, atol=1e-7)
        forward_dynamics(q, dq, third, packed, acceleration)
        np.testing.assert_allclose(acceleration, pinocchio.aba(model, data, q, dq, third), rtol=1e-7, atol=1e-7)


def test_positive_angles_lift_the_arm() -> None:
    """As in G of (50): the axis points so that gravity pulls an arm stretched along x towards negative angles."""
    axes = [[float(x) for x in a.attrib["xyz"].split()] for a in ElementTree.parse(URDF).findall("joint/axis")]
    tip = np.cross(axes[0], [DEFAULTS["r1"], 0.0, 0.0])  # velocity of the first link's end for q1' = 1
    assert axes == [[0.0, -1.0, 0.0]] * 2
    assert math.isclose(tip[2], DEFAULTS["r1"])
