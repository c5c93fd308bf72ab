"""Poses are composed as transforms are, and numbers that are no pose are refused by name."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pidtsm_core.poses.frames import Frames
from pidtsm_core.poses.pose import Pose, read_pose
from pidtsm_core.trajectories.errors import TrajectoryError


def matrix(pose: Pose) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = pose.rotation, pose.position
    return result


def random_poses(count: int) -> list[Pose]:
    rng = np.random.default_rng(1)
    rotations = Rotation.random(count, random_state=rng)
    return [read_pose(p, r) for p, r in zip(rng.normal(size=(count, 3)), rotations.as_quat(), strict=True)]


def test_poses_are_composed_as_homogeneous_matrices_are() -> None:
    a, b = random_poses(2)
    np.testing.assert_allclose(matrix(a @ b), matrix(a) @ matrix(b), atol=1e-12)
    np.testing.assert_allclose(matrix(a.inverse), np.linalg.inv(matrix(a)), atol=1e-12)
    np.testing.assert_allclose(matrix(a.moved(*a.way_to(b))), matrix(b), atol=1e-12)
    np.testing.assert_allclose(matrix(read_pose(a.position, a.quaternion())), matrix(a), atol=1e-12)


def test_frames_are_found_above_beside_and_below_the_arm() -> None:
    """world carries the base of the arm and a table; a camera is on a link of the arm."""
    base, table, camera, link, cup = random_poses(5)
    frames = Frames()
    frames.place("base", "world", base)
    frames.place("table", "/world", table)
    frames.place("camera", "hand", camera)
    frames.place("cup", "table", cup)

    def find(name: str) -> np.ndarray:
        return matrix(frames.find(name, "base", {"hand": link}.get))

    np.testing.assert_allclose(find("camera"), matrix(link) @ matrix(camera), atol=1e-12)
    np.testing.assert_allclose(find("cup"), np.linalg.inv(matrix(base)) @ matrix(table) @ matrix(cup), atol=1e-12)
    np.testing.assert_allclose(find("world"), np.linalg.inv(matrix(base)), atol=1e-12)
    np.testing.assert_allclose(find(""), np.eye(4))
    frames.place("world", "cup", cup)  # A loop.
    with pytest.raises(TrajectoryError, match="frame_id moon: the arm has no such link, and tf has no way from it"):
        find("moon")


@pytest.mark.parametrize(
    ("position", "quaternion", "reason"),
    [
        ([0.0, math.nan, 0.0], [0.0, 0.0, 0.0, 1.0], r"position \(0, nan, 0\) is not finite"),
        ([0.0, 0.0], [0.0, 0.0, 0.0, 1.0], "position has 2 numbers; x y z are expected"),
        ([0.0] * 3, [0.0] * 4, "orientation is the zero quaternion"),
        ([0.0] * 3, [0.0, 0.0, math.inf, 1.0], "orientation .* is not finite"),
        ([0.0] * 3, [0.0, 0.0, 0.0, 2.0], "orientation .* has the norm 2"),
        ([0.0] * 3, [0.0, 0.0, 1.0], "orientation has 3 numbers"),
    ],
)
def test_what_is_no_pose_is_refused(position: list[float], quaternion: list[float], reason: str) -> None:
    with pytest.raises(TrajectoryError, match=reason):
        read_pose(position, quaternion)


def test_with_a_prefix_a_frame_of_the_same_name_is_another_one() -> None:
    """Both arms have a base named world, and stand in a common frame world."""
    frames, base = Frames("left/"), Pose(np.array([0.0, 0.4, 0.1]), np.eye(3))
    frames.place("left/world", "world", base)
    links = {"world": Pose(np.zeros(3), np.eye(3)), "hand": Pose(np.array([0.5, 0.0, 0.0]), np.eye(3))}
    np.testing.assert_allclose(frames.find("left/hand", "world", links.get).position, [0.5, 0.0, 0.0])
    for name in ("world", "/world"):
        np.testing.assert_allclose(frames.find(name, "world", links.get).position, [0.0, -0.4, -0.1])
    np.testing.assert_allclose(frames.find("", "world", links.get).position, 0.0)
    with pytest.raises(TrajectoryError, match="frame_id right/hand: the arm has no such link"):
        frames.find("right/hand", "world", links.get)
