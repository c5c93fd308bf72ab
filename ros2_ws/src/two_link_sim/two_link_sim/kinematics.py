"""Forward kinematics of a robot from its URDF."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from pidtsm_core.parameters import Array

_TURNING = ("revolute", "continuous")


class UrdfError(ValueError):
    """The text is not a URDF, or has joints that are neither rotating nor fixed; the message contains the reason."""


@dataclass(frozen=True)
class Joint:
    """A joint of a URDF.

    Attributes:
        name: its name.
        parent, child: the links it connects.
        origin: pose of the joint in the parent's frame, shape (4, 4), m.
        axis: unit vector in the child's frame, shape (3,); zero for a fixed joint.
        effort: torque limit, N m; infinite if there is none.
    """

    name: str
    parent: str
    child: str
    origin: Array
    axis: Array
    effort: float

    @property
    def turns(self) -> bool:
        """Whether the joint rotates; false: it is fixed."""
        return bool(self.axis.any())

    def pose(self, angle: float) -> Array:
        """Pose of the child in the parent's frame at an angle (rad), shape (4, 4), m."""
        turned = np.eye(4)
        turned[:3, :3] = Rotation.from_rotvec(angle * self.axis).as_matrix()
        return np.asarray(self.origin @ turned)


def read_urdf(text: str) -> list[Joint]:
    """The joints of a robot, each after the joint that moves its parent link.

    Raises:
        UrdfError: not XML, not a single tree of links, or a joint that is neither rotating nor fixed.
    """
    try:
        robot = ElementTree.fromstring(text)  # noqa: S314 (a robot's own description)
    except ElementTree.ParseError as error:
        raise UrdfError(f"the robot description is not XML: {error}") from None
    rest = [_joint(element) for element in robot.findall("joint")]
    roots = {joint.parent for joint in rest} - {joint.child for joint in rest}
    if len(roots) != 1:
        raise UrdfError(f"the robot description must have joints and one root link; it has the roots {sorted(roots)}")
    ordered: list[Joint] = []
    reached = roots
    while reached:
        found = [joint for joint in rest if joint.parent in reached]
        ordered += found
        reached = {joint.child for joint in found}
    return ordered


def link_poses(joints: Sequence[Joint], positions: Mapping[str, float]) -> dict[str, Array]:
    """Poses of all links in the root's frame, each of shape (4, 4), m.

    Args:
        joints: as from `read_urdf`.
        positions: rad, by joint; missing joints are at 0.
    """
    poses = {joints[0].parent: np.eye(4)}
    for joint in joints:
        poses[joint.child] = poses[joint.parent] @ joint.pose(positions.get(joint.name, 0.0))
    return poses


def _joint(element: ElementTree.Element) -> Joint:
    name, kind = element.get("name", ""), element.get("type")
    parent, child = element.find("parent"), element.find("child")
    if kind not in (*_TURNING, "fixed"):
        raise UrdfError(f"joint {name} is {kind}; only {', '.join(_TURNING)} and fixed joints are supported")
    if parent is None or child is None:
        raise UrdfError(f"joint {name} lacks a parent or a child link")
    origin = np.eye(4)
    origin[:3, :3] = Rotation.from_euler("xyz", _vector(element, "origin", "rpy", "0 0 0")).as_matrix()
    origin[:3, 3] = _vector(element, "origin", "xyz", "0 0 0")
    axis = np.zeros(3) if kind == "fixed" else _vector(element, "axis", "xyz", "1 0 0")
    limit = element.find("limit")
    effort = math.inf if limit is None else float(limit.get("effort", math.inf))
    return Joint(
        name, parent.get("link", ""), child.get("link", ""), origin, axis / (np.linalg.norm(axis) or 1.0), effort
    )


def _vector(element: ElementTree.Element, tag: str, attribute: str, default: str) -> Array:
    """Three numbers from a child element, with URDF's defaults."""
    found = element.find(tag)
    text = default if found is None else found.get(attribute, default)
    try:
        x, y, z = map(float, text.split())
    except ValueError:
        raise UrdfError(f"joint {element.get('name')}: {tag} {attribute} must be three numbers, not {text!r}") from None
    return np.array([x, y, z])
