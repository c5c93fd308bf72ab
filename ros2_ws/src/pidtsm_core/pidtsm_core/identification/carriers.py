"""The bodies of a description whose mass and inertia are identified, and those with other ones."""

from collections.abc import Iterator
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.identification.pseudo_inertia import moved
from pidtsm_core.robots import Description
from pidtsm_core.robots.compiler import parse
from pidtsm_core.robots.inertials import Inertial, body_inertials
from pidtsm_core.robots.tree.layout import Column, rows, steiner
from pidtsm_core.robots.tree.unit_forces import LINK


def carriers(arm: Description) -> tuple[NDArray[np.int_], Array]:
    """The heaviest link of those that move with each joint; its mass and inertia are those that are identified.

    Returns:
        Indices of the links in `Description.links`, in the order of the joints, shape (joints,); and their ten
        parameters in the frame of the joint, shape (joints, 10), see `regressor`.
    """
    joints = len(arm.joints)
    links, heaviest = np.full(joints, -1), np.zeros((joints, LINK))
    places = rows(arm.tree)[:, Column.PLACE].astype(int)
    described = _of_urdf(arm) if arm.is_urdf else _of_mjcf(arm)
    for i, (row, placement) in enumerate(zip(arm.links.rows, arm.links.placements, strict=True)):
        if row < 0:
            continue
        j, found = places[row], moved(described[i], placement)
        if links[j] < 0 or found[0] > heaviest[j, 0]:
            links[j], heaviest[j] = i, found
    return links, heaviest


def corrected_links(arm: Description, parameters: Array) -> Iterator[tuple[int, Array]]:
    """The carrier of each joint with what the other links that move with the joint do not have of other parameters.

    Args:
        arm: its description.
        parameters: pi, see `regressor`, shape (14 joints,).

    Yields:
        Index of the link in `Description.links`, and its ten parameters in its frame, shape (10,).
    """
    links, before = carriers(arm)
    described = np.empty(before.shape)
    for row in rows(arm.tree):
        described[int(row[Column.PLACE])] = row[Column.MASS : Column.ARMATURE]
    bodies = parameters[: before.size].reshape(before.shape) - (described - before)
    for link, body in zip(links.tolist(), bodies, strict=True):
        placement = arm.links.placements[link]
        yield link, moved(body, np.column_stack([placement[:, :3].T, -placement[:, :3].T @ placement[:, 3]]))


def mass_and_center(link: Array) -> tuple[float, Array, Array]:
    """Mass (kg), centre of mass (m, shape (3,)), and inertia about it (kg m^2, shape (3, 3)) of ten parameters."""
    mass = float(link[0])
    center = link[1:4] / mass
    xx, yy, zz, xy, xz, yz = link[4:]
    return mass, center, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * steiner(center)


def _of_urdf(arm: Description) -> list[Array]:
    """Ten parameters of each link in its frame, as the URDF says, also where MuJoCo would refuse them."""
    elements = {link.get("name"): link for link in ElementTree.fromstring(arm.text).iter("link")}  # noqa: S314
    return [_of_element(elements[name]) for name in arm.links.names]


def _of_mjcf(arm: Description) -> list[Array]:
    """Ten parameters of each body in its frame; those of the base, which does not move, are zeros."""
    return [np.zeros(LINK), *map(_ten, body_inertials(parse(arm.text).spec))]


def _of_element(link: Element) -> Array:
    """Ten parameters of a link of a URDF in its frame; zeros without an inertial."""
    inertial = link.find("inertial")
    if inertial is None or (mass_element := inertial.find("mass")) is None:
        return np.zeros(LINK)
    mass, inertia = float(mass_element.get("value", "0")), inertial.find("inertia")
    moments = {} if inertia is None else inertia.attrib
    xx, yy, zz, xy, xz, yz = (float(moments.get(name, "0")) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    origin = inertial.find("origin")
    place = {} if origin is None else origin.attrib
    center = np.array(list(map(float, place.get("xyz", "0 0 0").split())))
    turned = _rotation(*map(float, place.get("rpy", "0 0 0").split()))
    return _ten(Inertial(mass, center, turned @ about @ turned.T))


def _ten(body: Inertial) -> Array:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia + body.mass * steiner(body.center)
    return np.array([body.mass, *(body.mass * body.center), xx, yy, zz, xy, xz, yz])


def _rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation matrix of fixed-axis angles about x, y, z."""
    (a, b, c), (d, e, f) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    return np.array(
        [
            [c * b, c * e * d - f * a, c * e * a + f * d],
            [f * b, f * e * d + c * a, f * e * a - c * d],
            [-e, b * d, b * a],
        ]
    )
