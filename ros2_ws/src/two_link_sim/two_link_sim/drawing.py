"""What viewers show of an arm: the frames of its links, its skeleton and its efforts."""

import numpy as np
from geometry_msgs.msg import Point, TransformStamped
from scipy.spatial.transform import Rotation
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from pidtsm_core.arrays import Array
from pidtsm_core.robots import Description
from pidtsm_core.robots.description import Links
from pidtsm_core.robots.picture import (
    ARM_COLOR,
    BONE_WIDTH,
    GHOST_COLOR,
    bones,
    effort_arc,
    effort_arrow,
    effort_color,
    effort_shares,
)
from pidtsm_core.robots.placement import relative_placements

GHOST = "reference"
"""TF prefix and namespace of the second arm, which shows the reference."""

# Lengths as shares of the reach of the arm.
_ARC_WIDTH = 0.01
_ARROW_WIDTHS = 0.02, 0.04  # shaft, head


def transforms(
    links: Links, placements: Array, header: Header, prefix: str, ghost: bool = False
) -> list[TransformStamped]:
    """Transform of every link relative to its parent.

    Args:
        links: the links.
        placements: as returned by `link_placements`, shape (links, 3, 4).
        header: provides the stamp.
        prefix: prefix of every frame name.
        ghost: whether this is the arm that shows the reference: its names have another prefix, `GHOST`, and its base
            coincides with that of the arm.
    """
    relative = relative_placements(links, placements)
    places = relative[:, :, 3].tolist()
    turns = Rotation.from_matrix(relative[:, :, :3]).as_quat().tolist()
    frames = []
    for name, parent, place, turn in zip(links.names, links.parents, places, turns, strict=True):
        if parent < 0 and not ghost:
            continue
        own = f"{prefix}{GHOST}/" if ghost else prefix
        above = prefix + links.names[0] if parent < 0 else own + links.names[parent]
        frame = TransformStamped(header=Header(stamp=header.stamp, frame_id=above), child_frame_id=own + name)
        to, by = frame.transform.translation, frame.transform.rotation
        to.x, to.y, to.z = place
        by.x, by.y, by.z, by.w = turn
        frames.append(frame)
    return frames


def skeleton(links: Links, placements: Array, header: Header, size: float, ghost: bool) -> Marker:
    """Lines from link to link, for viewers without the meshes of the arm.

    Args:
        links: the links.
        placements: as returned by `link_placements`, shape (links, 3, 4).
        header: provides the stamp.
        size: reach of the arm, m.
        ghost: whether this is the arm that shows the reference.
    """
    marker = _marker(header, links.names[0], GHOST if ghost else "arm", Marker.LINE_LIST, bones(links, placements))
    marker.scale.x = BONE_WIDTH * size
    red, green, blue, opacity = GHOST_COLOR if ghost else ARM_COLOR
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=opacity)
    return marker


def effort_markers(arm: Description, placements: Array, efforts: Array, header: Header, size: float) -> list[Marker]:
    """An arc about each joint that turns, an arrow along each joint that slides, in the direction of its effort.

    Its length is the share of the effort in the effort limit; its colour turns from green to red at the limit.

    Args:
        arm: the arm.
        placements: as returned by `joint_placements`, shape (joints, 3, 4).
        efforts: in the order of the joints, shape (joints,), N m or N; a joint without an effort (nan) or without an
            effort limit has no marker.
        header: provides the stamp.
        size: reach of the arm, m.
    """
    shares = effort_shares(arm, efforts)
    markers = []
    for joint in np.flatnonzero(np.isfinite(shares)):
        share, base = float(shares[joint]), arm.links.names[0]
        if arm.slides[joint]:
            marker = _marker(header, base, "effort", Marker.ARROW, effort_arrow(placements[joint], share, size))
            marker.scale.x, marker.scale.y = (width * size for width in _ARROW_WIDTHS)
        else:
            marker = _marker(header, base, "effort", Marker.LINE_STRIP, effort_arc(placements[joint], share, size))
            marker.scale.x = _ARC_WIDTH * size
        marker.id = int(joint)
        red, green, blue = effort_color(share)
        marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
        markers.append(marker)
    return markers


def _marker(header: Header, frame: str, namespace: str, kind: int, points: Array) -> Marker:
    """A marker with these points, shape (points, 3), m."""
    marker = Marker(
        header=Header(stamp=header.stamp, frame_id=frame),
        ns=namespace,
        type=kind,
        points=[Point(x=x, y=y, z=z) for x, y, z in points.tolist()],
    )
    marker.pose.orientation.w = 1.0
    return marker
