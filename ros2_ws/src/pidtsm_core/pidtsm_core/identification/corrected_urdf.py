"""A URDF with other bodies."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from pidtsm_core.arrays import Array
from pidtsm_core.identification.carriers import corrected_links, mass_and_center
from pidtsm_core.robots import Description
from pidtsm_core.robots.tree.unit_forces import LINK

_DRAKE = "http://drake.mit.edu"


def corrected_urdf(arm: Description, parameters: Array) -> str:
    """The text of the URDF with other parameters.

    Friction becomes the element ``dynamics`` of the joint, the armature a ``transmission`` with the elements of Drake,
    which `urdf.rotor_inertias` reads.

    Args:
        arm: described by a URDF.
        parameters: pi, see `regressor`, shape (14 joints,); offsets do not count.
    """
    root = ElementTree.fromstring(arm.text)  # noqa: S314  It has been read before.
    ElementTree.register_namespace("drake", _DRAKE)
    links = {link.get("name", ""): link for link in root.iter("link")}
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for link, body in corrected_links(arm, parameters):
        _set_inertial(links[arm.links.names[link]], body)
    armature, viscous, coulomb, _ = parameters[LINK * len(arm.joints) :].reshape(4, len(arm.joints))
    for j, joint in enumerate(arm.joints):
        dynamics = joints[joint].find("dynamics")
        dynamics = SubElement(joints[joint], "dynamics") if dynamics is None else dynamics
        dynamics.attrib.update(damping=_text(viscous[j]), friction=_text(coulomb[j]))
        _set_rotor(root, joint, armature[j])
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


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
