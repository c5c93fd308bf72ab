"""The arm and its ghost share one tree of frames; an arc shows each torque."""

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from two_link_sim.kinematics import read_urdf
from two_link_sim.visualization_node import _two_link, torque_markers, transforms

JOINTS = read_urdf(_two_link())
HEADER = Header(stamp=Time(sec=3, nanosec=5))


def test_the_arm_and_its_ghost_are_one_tree() -> None:
    frames = transforms(JOINTS, {}, HEADER, "") + transforms(JOINTS, {}, HEADER, "reference/")
    parents = {frame.child_frame_id: frame.header.frame_id for frame in frames}
    assert parents == {
        "link1": "base_link",
        "link2": "link1",
        "reference/base_link": "base_link",
        "reference/link1": "reference/base_link",
        "reference/link2": "reference/link1",
    }
    assert all(frame.header.stamp == HEADER.stamp for frame in frames)


def test_a_frame_turns_by_the_joint_angle() -> None:
    first, second = transforms(JOINTS, {"joint1": 0.4, "joint2": -1.0}, HEADER, "")
    assert first.transform.rotation.w == pytest.approx(math.cos(0.2))
    assert first.transform.rotation.y == pytest.approx(-math.sin(0.2))
    assert second.transform.rotation.y == pytest.approx(math.sin(0.5))
    assert second.transform.translation.x == 1.0


def arc(marker: Marker) -> NDArray[np.float64]:
    return np.array([[p.x, p.y, p.z] for p in marker.points])


def test_an_arc_starts_at_the_link_in_the_direction_of_the_torque() -> None:
    lifting, pulling = torque_markers(JOINTS, {}, {"joint1": 50.0, "joint2": -200.0}, HEADER)
    up, down = arc(lifting), arc(pulling)
    np.testing.assert_allclose(up[0], [0.3, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(down[0], [1.3, 0.0, 0.0], atol=1e-12)
    assert up[1, 2] > 0.0 > down[1, 2]
    # Half the limit; torques above the limit are shown as the limit.
    np.testing.assert_allclose(up[-1], 0.3 * np.array([math.cos(0.75 * math.pi), 0.0, math.sin(0.75 * math.pi)]))
    np.testing.assert_allclose(down[-1], [1.0, 0.0, 0.3], atol=1e-12)
    assert (lifting.color.r, lifting.color.g) == (0.5, 0.5)
    assert (pulling.color.r, pulling.color.g) == (1.0, 0.0)
    assert {m.header.frame_id for m in (lifting, pulling)} == {"base_link"}


def test_a_joint_without_torque_has_no_arc() -> None:
    assert [m.id for m in torque_markers(JOINTS, {}, {"joint2": 1.0}, HEADER)] == [1]
