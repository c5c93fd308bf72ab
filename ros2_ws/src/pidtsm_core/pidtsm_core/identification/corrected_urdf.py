"""The bodies of a URDF, and a URDF with other ones."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.identification.pseudo_inertia import moved
from pidtsm_core.identification.regressor import LINK
from pidtsm_core.robots import Description
from pidtsm_core.robots.tree.layout import Column, rows, steiner

_DRAKE = "http://drake.mit.edu"


def carriers(arm: Description) -> tuple[tuple[str, ...], Array]:
    """The heaviest link of those that move with each joint; its mass and inertia are those that are identified.

    Returns:
        Names of the links in the order of the joints, and their ten parameters in the frame of the joint, shape
        (joints, 10); see `regressor`.

    Raises:
        UsageError: the description is not a URDF.
    """
    if not arm.urdf:
        raise UsageError(
            "the arm is described by an MJCF; identification corrects a URDF, so convert the description to one"
        )
    elements = {link.get("name"): link for link in ElementTree.fromstring(arm.urdf).iter("link")}  # noqa: S314
    joints = len(arm.joints)
    names, heaviest = [""] * joints, np.zeros((joints, LINK))
    places = rows(arm.tree)[:, Column.PLACE].astype(int)
    for name, row, placement in zip(arm.links.names, arm.links.rows, arm.links.placements, strict=True):
        if row < 0:
            continue
        j, found = places[row], moved(_parameters(elements[name]), placement)
        if not names[j] or found[0] > heaviest[j, 0]:
            names[j], heaviest[j] = name, found
    return tuple(names), heaviest


def corrected_urdf(arm: Description, parameters: Array) -> str:
    """The text of the URDF with other parameters.

    The heaviest link of each joint gets what the other links that move with the joint do not have. Friction becomes
    the element ``dynamics`` of the joint, the armature a ``transmission`` with the elements of Drake, which
    `urdf.rotor_inertias` reads.

    Args:
        arm: described by a URDF, see `carriers`.
        parameters: pi, see `regressor`, shape (14 joints,); offsets do not count.
    """
    root = ElementTree.fromstring(arm.urdf)  # noqa: S314  It has been read before.
    ElementTree.register_namespace("drake", _DRAKE)
    links = {link.get("name", ""): link for link in root.iter("link")}
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    names, before = carriers(arm)
    count = len(names)
    described = np.empty((count, LINK))
    for row in rows(arm.tree):
        described[int(row[Column.PLACE])] = row[Column.MASS : Column.ARMATURE]
    bodies = parameters[: LINK * count].reshape(count, LINK) - (described - before)
    armature, viscous, coulomb, _ = parameters[LINK * count :].reshape(4, count)
    for j, joint in enumerate(arm.joints):
        placement = arm.links.placements[arm.links.names.index(names[j])]
        back = np.column_stack([placement[:, :3].T, -placement[:, :3].T @ placement[:, 3]])
        _set_inertial(links[names[j]], moved(bodies[j], back))
        dynamics = joints[joint].find("dynamics")
        dynamics = SubElement(joints[joint], "dynamics") if dynamics is None else dynamics
        dynamics.attrib.update(damping=_text(viscous[j]), friction=_text(coulomb[j]))
        _set_rotor(root, joint, armature[j])
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def mass_and_center(link: Array) -> tuple[float, Array, Array]:
    """Mass (kg), centre of mass (m, shape (3,)), and inertia about it (kg m^2, shape (3, 3)) of ten parameters."""
    mass = float(link[0])
    center = link[1:4] / mass
    xx, yy, zz, xy, xz, yz = link[4:]
    return mass, center, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * steiner(center)


def _parameters(link: Element) -> Array:
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
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = turned @ about @ turned.T + mass * steiner(center)
    return np.array([mass, *(mass * center), xx, yy, zz, xy, xz, yz])


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


def _set_inertial(link: Element, parameters: Array) -> None:
    """Replace the inertial of a link."""
    mass, center, about = mass_and_center(parameters)
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = Element("inertial")
    link.insert(0, inertial)
    SubElement(inertial, "origin", xyz=" ".join(map(_text, center)), rpy="0 0 0")
    SubElement(inertial, "mass", value=_text(mass))
    names = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
    SubElement(inertial, "inertia", {name: _text(about[i, k]) for name, i, k in names})


def _set_rotor(root: Element, joint: str, armature: float) -> None:
    """Set the inertia of the rotor of a joint, as the joint sees it."""
    for transmission in root.findall("transmission"):
        driven, actuator = transmission.find("joint"), transmission.find("actuator")
        if driven is not None and driven.get("name") == joint and actuator is not None:
            for kind in ("rotor_inertia", "gear_ratio"):
                for old in actuator.findall(f"{{*}}{kind}"):
                    actuator.remove(old)
            break
    else:
        transmission = SubElement(root, "transmission", name=f"{joint}_transmission")
        SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        SubElement(transmission, "joint", name=joint)
        actuator = SubElement(transmission, "actuator", name=f"{joint}_motor")
    SubElement(actuator, f"{{{_DRAKE}}}rotor_inertia", value=_text(armature))


def _text(number: float) -> str:
    return f"{float(number):.9g}"
