"""URDF before MuJoCo's compiler reads it: what the compiler reports without a name, or does not read at all."""

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from pidtsm_core.parameters import did_you_mean
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.source import file_in_package

_TYPES = ("revolute", "continuous", "prismatic", "fixed")
_COMPILER = {
    "fusestatic": "false",  # keeps the names of fixed links
    "discardvisual": "true",
    "balanceinertia": "false",  # an impossible inertia is an error
}
_MESHES = (".stl", ".obj")
_VECTORS = {"origin": ("xyz", "rpy"), "axis": ("xyz",)}
_INERTIAS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def check_urdf(root: Element) -> None:
    """Check names, types, the tree, and that numbers of joints and masses are finite.

    Raises:
        DescriptionError: with the link or joint, and the element.
    """
    if any("/xacro}" in element.tag for element in root):
        raise DescriptionError("the description has elements of xacro; let the name of its file end with .xacro")
    for kind in ("link", "joint"):
        names = [element.get("name") for element in root.findall(kind)]
        for name in names:
            if not name:
                raise DescriptionError(f"a {kind} has no name; give each {kind} one of its own")
            if names.count(name) > 1:
                raise DescriptionError(f"{kind} {name}: two {kind}s are called {name}; rename one of them")
    for joint in root.findall("joint"):
        _check_joint(joint)
    _check_tree(root)
    for link in root.findall("link"):
        if (inertial := link.find("inertial")) is not None:
            _check_inertial(inertial, f"link {link.get('name')}")


def _check_inertial(inertial: Element, of: str) -> None:
    """Check that a mass is complete, and its numbers; `of` is the link."""
    for part, names in (("mass", ("value",)), ("inertia", _INERTIAS)):
        element = inertial.find(part)
        missing = [part] if element is None else [name for name in names if name not in element.attrib]
        if missing:
            raise DescriptionError(f"{of}: its inertial has no {missing[0]}; add it, or remove the inertial")
    if (mass := inertial.find("mass")) is not None and not _number(mass.get("value", ""), f"{of}: mass") >= 0.0:
        raise DescriptionError(f"{of}: its mass is {mass.get('value')} kg; it must be positive")
    _check_vectors(inertial, f"{of}: its inertial")
    if (inertia := inertial.find("inertia")) is not None:
        for name in _INERTIAS:
            _number(inertia.get(name, "0"), f"{of}: {name} of its inertia")


def _check_vectors(element: Element, of: str) -> None:
    """Check that origin and axis of an element have three finite numbers each; `of` is the joint or link."""
    for child, names in _VECTORS.items():
        found = element.find(child)
        for name in names if found is not None else ():
            if found is not None and (text := found.get(name)) is not None:
                numbers = [_number(word, f"{of}: {name} of its {child}, {text!r}") for word in text.split()]
                if len(numbers) != len("xyz"):
                    raise DescriptionError(f"{of}: {name} of its {child} is {text!r}; it needs three numbers")


def _check_joint(joint: Element) -> None:
    name, kind = joint.get("name"), joint.get("type")
    if kind not in _TYPES:
        raise DescriptionError(f"joint {name}: its type is {kind}, not {', '.join(_TYPES[:-1])} or {_TYPES[-1]}")
    if kind == "revolute" and joint.find("limit") is None:
        raise DescriptionError(f"joint {name}: a revolute joint needs a limit; one without limits is continuous")
    _check_vectors(joint, f"joint {name}")
    if (dynamics := joint.find("dynamics")) is not None:
        for key in ("damping", "friction"):
            if (value := _number(dynamics.get(key, "0"), f"joint {name}: {key} of its dynamics")) < 0.0:
                raise DescriptionError(f"joint {name}: {key} of its dynamics is {value:g}; it must not be negative")
    axis = joint.find("axis")
    if kind != "fixed" and axis is not None and not any(float(x) for x in axis.get("xyz", "1 0 0").split()):
        raise DescriptionError(f"joint {name}: its axis is {axis.get('xyz')!r}; it needs a direction, such as 0 0 1")


def _check_tree(root: Element) -> None:
    """Check that the joints connect all links to a tree with one base."""
    parents: dict[str, tuple[str, str]] = {}  # by link: its parent, and the joint between them
    links = [link.attrib["name"] for link in root.findall("link")]
    for joint in root.findall("joint"):
        name = joint.attrib["name"]
        parent, child = (_end(joint, kind) for kind in ("parent", "child"))
        if parent == child:
            raise DescriptionError(f"joint {name}: its parent and its child are both link {child}; correct one of them")
        for end in (parent, child):
            if end not in links:
                raise DescriptionError(f"joint {name}: there is no link {end}{did_you_mean(end, links)}")
        if child in parents:
            raise DescriptionError(
                f"link {child}: it is the child of two joints, {parents[child][1]} and {name}: a loop; remove one"
            )
        parents[child] = (parent, name)
    if not links:
        raise DescriptionError("the description has no links")
    bases = [link for link in links if link not in parents]
    if not bases:
        raise DescriptionError("every link has a parent, so the joints form a loop; the base has none")
    if len(bases) > 1:
        raise DescriptionError(
            f"link {bases[1]}: it has no parent, and neither has {bases[0]}; connect them with a joint, since an arm "
            "has one base"
        )
    for link in links:
        above, steps = link, 0
        while above in parents and steps <= len(links):
            above, steps = parents[above][0], steps + 1
        if above in parents:
            raise DescriptionError(f"link {link}: it is not connected to {bases[0]}: its joints form a loop")


def _end(joint: Element, kind: str) -> str:
    """The link at one end of a joint."""
    end = joint.find(kind)
    return "" if end is None else end.get("link", "")


def _number(text: str, what: str) -> float:
    number = math.nan
    with suppress(ValueError):
        number = float(text)
    if math.isnan(number):
        raise DescriptionError(f"{what}: {text!r} is not a number")
    if math.isinf(number):
        raise DescriptionError(f"{what}: {text!r} is not finite; where there is no limit, leave it out")
    return number


def joint_limits(root: Element) -> dict[str, dict[str, float]]:
    """Attributes of the element ``limit``, by joint; a continuous joint loses its range, which means nothing.

    Raises:
        DescriptionError: one is not a finite number.
    """
    found = {}
    for joint in root.findall("joint"):
        name, limit = joint.attrib["name"], joint.find("limit")
        if limit is not None and joint.get("type") == "continuous":
            for key in ("lower", "upper"):  # They mean nothing to a joint that turns without end.
                limit.attrib.pop(key, None)
        if limit is not None:
            found[name] = {key: _number(value, f"joint {name}: {key}") for key, value in limit.attrib.items()}
    return found


def check_ranges(limits: Mapping[str, Mapping[str, float]], joints: Iterable[str]) -> None:
    """Check that joints have room between their limits, of which one that is missing is zero, and no negative others.

    Joints that do not move need none, and a joint without both moves without limits.

    Args:
        limits: see `joint_limits`.
        joints: those that move.

    Raises:
        DescriptionError: with the joint and both numbers.
    """
    for name in joints:
        limit = limits.get(name, {})
        for key in ("effort", "velocity"):
            if limit.get(key, 0.0) < 0.0:
                raise DescriptionError(f"joint {name}: {key} of its limit is {limit[key]:g}; it must be positive")
        low, high = limit.get("lower", 0.0), limit.get("upper", 0.0)
        if {"lower", "upper"} & limit.keys() and not low < high:
            raise DescriptionError(
                f"joint {name}: lower of its limit, {low:g}, is not below upper, {high:g}; swap them, widen them, or "
                "make the joint fixed"
            )


def rotor_inertias(root: Element) -> dict[str, float]:
    """Inertia of the rotor as the joint sees it (kg m^2 or kg), by joint.

    URDF itself has none. As in Drake, a ``transmission`` has the elements ``drake:rotor_inertia`` and
    ``drake:gear_ratio`` in its ``actuator``.

    Raises:
        DescriptionError: one is not a number, or negative.
    """
    found = {}
    for transmission in root.findall("transmission"):
        joint, actuator = transmission.find("joint"), transmission.find("actuator")
        if joint is None or actuator is None or (rotor := actuator.find("{*}rotor_inertia")) is None:
            continue
        name, gear = joint.get("name", ""), actuator.find("{*}gear_ratio")
        ratio = 1.0 if gear is None else _number(gear.get("value", ""), f"joint {name}: gear_ratio")
        found[name] = ratio * ratio * _number(rotor.get("value", ""), f"joint {name}: rotor_inertia")
        if found[name] < 0.0:
            raise DescriptionError(f"joint {name}: its rotor_inertia is negative; it must be positive")
    return found


def keep_shapes(root: Element) -> None:
    """Make the geometry of a URDF what MuJoCo can read and touch.

    These are its collision elements, or if it has none its visual elements, except meshes that do not exist or have
    another format than STL or OBJ.
    """
    links = root.findall("link")
    kind = "collision" if any(link.find("collision") is not None for link in links) else "visual"
    for link in links:
        for element in link.findall(kind):
            mesh = element.find("geometry/mesh")
            file = None if mesh is None else _mesh_file(mesh.get("filename", ""))
            if mesh is not None and file is None:
                link.remove(element)
            elif mesh is not None:
                mesh.set("filename", str(file))
            element.tag = "collision"
        if kind == "collision":
            for element in link.findall("visual"):
                link.remove(element)


def _mesh_file(name: str) -> Path | None:
    """The file of a mesh that MuJoCo can read; None if there is none."""
    with suppress(DescriptionError):
        file = file_in_package(name) if name.startswith("package://") else Path(name.removeprefix("file://"))
        if file.is_file() and file.suffix.lower() in _MESHES:
            return file.resolve()
    return None


def strip(root: Element, geometry: bool = False) -> None:
    """Remove what MuJoCo's compiler need not read, and set its options.

    Args:
        root: the URDF.
        geometry: whether the geometry is kept; without it, missing meshes do not matter.
    """
    for link in root.findall("link"):
        for kind in () if geometry else ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    for extension in (*root.findall("mujoco"), *root.findall("transmission")):
        root.remove(extension)
    SubElement(SubElement(root, "mujoco"), "compiler", {**_COMPILER, "strippath": str(not geometry).lower()})
