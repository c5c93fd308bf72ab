"""The arm and its ghost share one tree of frames; lines show the links, arcs and arrows the efforts."""

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from pidtsm_core.robots import find_description
from pidtsm_core.robots.placement import joint_placements, link_placements
from two_link_sim.drawing import effort_markers, skeleton, transforms

HEADER = Header(stamp=Time(sec=3, nanosec=5))
NAMES = ("two_link", "panda", "scara")
ARMS = {name: find_description({"robot.description": name}) for name in NAMES}
TWO_LINK = ARMS["two_link"]


def points(marker: Marker) -> NDArray[np.float64]:
    return np.array([[p.x, p.y, p.z] for p in marker.points])


def efforts(name: str, q: list[float], values: list[float]) -> list[Marker]:
    """Effort markers at these positions and efforts, for a reach of 10 m."""
    arm = ARMS[name]
    return effort_markers(arm, joint_placements(arm, np.array(q)), np.array(values), HEADER, 10.0)


@pytest.mark.parametrize("prefix", ["", "left/"])
@pytest.mark.parametrize("name", NAMES)
def test_frames_lead_to_every_link(name: str, prefix: str) -> None:
    """Of the arm and of the ghost, each link behind its parent."""
    arm = ARMS[name]
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (2, len(arm.joints)))
    base = prefix + arm.links.names[0]
    found = {base: np.eye(4)}
    expected: dict[str, NDArray[np.float64]] = {}
    for ghost, positions in ((False, q[0]), (True, q[1])):
        placements = link_placements(arm, positions)
        own = f"{prefix}reference/" if ghost else prefix
        expected |= {f"{own}{link}": place for link, place in zip(arm.links.names, placements, strict=True)}
        for frame in transforms(arm.links, placements, HEADER, prefix, ghost):
            assert frame.header.stamp == HEADER.stamp
            assert frame.child_frame_id not in found
            place, turn, step = frame.transform.translation, frame.transform.rotation, np.eye(4)
            step[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
            step[:3, 3] = place.x, place.y, place.z
            found[frame.child_frame_id] = found[frame.header.frame_id] @ step
    assert found.keys() == expected.keys()
    for link, placement in expected.items():
        np.testing.assert_allclose(found[link][:3], placement, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_skeleton_has_a_line_to_every_link(name: str) -> None:
    arm = ARMS[name]
    placements = link_placements(arm, np.full(len(arm.joints), 0.4))
    lines = points(skeleton(arm.links, placements, HEADER, 1.0, ghost=False)).reshape(-1, 2, 3)
    np.testing.assert_array_equal(lines[:, 1], placements[1:, :, 3])
    np.testing.assert_array_equal(lines[:, 0], placements[arm.links.parents[1:], :, 3])


def test_the_skeleton_of_the_ghost_is_another_marker_in_the_same_frame() -> None:
    placements = link_placements(TWO_LINK, np.zeros(2))
    arm, ghost = (skeleton(TWO_LINK.links, placements, HEADER, 1.0, ghost) for ghost in (False, True))
    assert (arm.ns, ghost.ns) == ("arm", "reference")
    assert arm.header.frame_id == ghost.header.frame_id == "base_link"
    assert ghost.color.a < arm.color.a == 1.0


def test_an_arc_starts_at_the_link_in_the_direction_of_the_torque() -> None:
    lifting, pulling = efforts("two_link", [0.0, 0.0], [50.0, -200.0])
    up, down = points(lifting), points(pulling)
    np.testing.assert_allclose(up[0], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(down[0], [2.0, 0.0, 0.0], atol=1e-12)
    assert up[1, 2] > 0.0 > down[1, 2]
    # Half the limit; torques above the limit are shown as the limit.
    np.testing.assert_allclose(up[-1], [math.cos(0.75 * math.pi), 0.0, math.sin(0.75 * math.pi)], atol=1e-12)
    np.testing.assert_allclose(down[-1], [1.0, 0.0, 1.0], atol=1e-12)
    assert (lifting.color.r, lifting.color.g) == (0.5, 0.5)
    assert (pulling.color.r, pulling.color.g) == (1.0, 0.0)
    assert {m.header.frame_id for m in (lifting, pulling)} == {"base_link"}


def test_an_arrow_points_along_a_sliding_joint() -> None:
    limit = float(ARMS["scara"].effort[2])
    *_, lifting, turning = efforts("scara", [0.3, 0.2, -0.1, 0.0], [1.0, 1.0, 0.5 * limit, 1.0])
    start, end = points(lifting)
    axis = joint_placements(ARMS["scara"], np.array([0.3, 0.2, -0.1, 0.0]))[2, :, 2]
    np.testing.assert_allclose(end - start, 1.25 * axis, atol=1e-12)
    assert (lifting.type, turning.type) == (Marker.ARROW, Marker.LINE_STRIP)


def test_a_joint_without_effort_has_no_marker() -> None:
    assert [m.id for m in efforts("two_link", [0.0, 0.0], [math.nan, 1.0])] == [1]
