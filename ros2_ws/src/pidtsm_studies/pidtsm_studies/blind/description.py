"""URDFs of arms that differ from what the controller believes."""

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pidtsm_core.arrays import Array


def with_flipped_axis(urdf: str, joint: str) -> str:
    """The arm whose joint turns the other way; it reports the negative position and takes the negative effort."""
    root = _parsed(urdf)
    element = _joint(root, joint)
    axis = element.find("axis")
    if axis is None:
        axis = ElementTree.SubElement(element, "axis", xyz="1 0 0")
    axis.set("xyz", _written(-_vector(axis.get("xyz", "1 0 0"))))
    limit = element.find("limit")
    if limit is not None and "lower" in limit.attrib and "upper" in limit.attrib:
        lower, upper = limit.attrib["lower"], limit.attrib["upper"]
        limit.set("lower", _number(-float(upper)))
        limit.set("upper", _number(-float(lower)))
    return ElementTree.tostring(root, encoding="unicode")


def with_swapped_names(urdf: str, first: str, second: str) -> str:
    """The arm whose connectors of two joints are exchanged."""
    root = _parsed(urdf)
    elements = _joint(root, first), _joint(root, second)
    for element, name in zip(elements, (second, first), strict=True):
        element.set("name", name)
    return ElementTree.tostring(root, encoding="unicode")


def with_masses(urdf: str, factors: Mapping[str, float]) -> str:
    """The arm whose links, by name, have so many times their mass and inertia."""
    root = _parsed(urdf)
    for link in root.iter("link"):
        if factor := factors.get(link.get("name", "")):
            _scale_inertial(link, factor)
    return ElementTree.tostring(root, encoding="unicode")


def with_moved_centres(urdf: str, shifts: Mapping[str, Sequence[float]]) -> str:
    """The arm whose links, by name, have their centre of mass elsewhere by so much, m."""
    root = _parsed(urdf)
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is not None and (shift := shifts.get(link.get("name", ""))) is not None:
            origin = _origin(inertial)
            origin.set("xyz", _written(_vector(origin.get("xyz", "0 0 0")) + np.array(shift)))
    return ElementTree.tostring(root, encoding="unicode")


def of_another_build(urdf: str, random: np.random.Generator) -> str:
    """An arm with the same names and joints but other lengths, tilted axes and other masses."""
    root = _parsed(urdf)
    for joint in root.iter("joint"):
        if joint.get("type") == "fixed":
            continue
        origin = _origin(joint)
        place = _vector(origin.get("xyz", "0 0 0"))
        origin.set("xyz", _written(place * random.uniform(0.4, 1.8, 3) + random.uniform(-0.06, 0.06, 3)))
        angles = _vector(origin.get("rpy", "0 0 0")) + random.uniform(-0.8, 0.8, 3)
        origin.set("rpy", _written(angles))
    for link in root.iter("link"):
        _scale_inertial(link, random.uniform(0.6, 1.6))
    return ElementTree.tostring(root, encoding="unicode")


def _scale_inertial(link: Element, factor: float) -> None:
    """Multiply mass and inertia of a link; what has none stays so."""
    inertial = link.find("inertial")
    for element in () if inertial is None else (inertial.find("mass"), inertial.find("inertia")):
        if element is not None:
            for name, value in element.attrib.items():
                element.set(name, _number(factor * float(value)))


def _parsed(urdf: str) -> Element:
    return ElementTree.fromstring(urdf)  # noqa: S314


def _joint(root: Element, name: str) -> Element:
    return next(element for element in root.iter("joint") if element.get("name") == name)


def _origin(element: Element) -> Element:
    found = element.find("origin")
    return ElementTree.SubElement(element, "origin") if found is None else found


def _vector(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _written(vector: Array) -> str:
    return " ".join(map(_number, vector.tolist()))


def _number(value: float) -> str:
    return repr(float(value))
