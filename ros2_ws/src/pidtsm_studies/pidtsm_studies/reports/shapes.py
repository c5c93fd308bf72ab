"""What the links of a URDF look like: boxes, cylinders, spheres and mesh files."""

import os
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.source import file_in_package

_MESHES = (".stl", ".obj", ".dae", ".glb", ".gltf")
_GEOMETRIES = {"box": (("size", 3),), "cylinder": (("radius", 1), ("length", 1)), "sphere": (("radius", 1),)}
"""Attributes of each geometry, and how many numbers they have."""


@dataclass(frozen=True)
class Shape:
    """A part of a link.

    Attributes:
        kind: ``box``, ``cylinder`` (along z), ``sphere`` or ``mesh``.
        size: m: edges of a box; radius and length of a cylinder; radius of a sphere; factors of a mesh, without unit.
        file: of a mesh.
        translation: of its centre, or of the origin of a mesh, in the frame of the link, m, shape (3,).
        turn: quaternion from the frame of the shape to that of the link, shape (4,): x, y, z, w.
    """

    kind: str
    size: tuple[float, ...]
    file: Path | None
    translation: Array
    turn: Array


def shapes_of(urdf: str, beside: Path | None = None) -> tuple[Mapping[str, list[Shape]], int]:
    """Visible shapes of each link, and the number of meshes whose file cannot be read here or has another format.

    Args:
        urdf: text of a URDF that has been read before; empty: there are no shapes.
        beside: its file. The files of meshes may then be relative to its folder, and a ``package://`` whose package is
            not installed is looked for among the folders above it.
    """
    found: dict[str, list[Shape]] = defaultdict(list)
    lacking = 0
    root = ElementTree.fromstring(urdf) if urdf else Element("robot")  # noqa: S314  A robot's own description.
    for link in root.iter("link"):
        for visual in link.iter("visual"):
            geometry = next(iter(visual.find("geometry") or ()), None)
            if geometry is None:
                continue
            if shape := _shape(geometry, visual.find("origin"), beside):
                found[link.get("name", "")].append(shape)
            else:
                lacking += geometry.tag == "mesh"
    return found, lacking


def _shape(geometry: Element, origin: Element | None, beside: Path | None) -> Shape | None:
    """A shape, None if it cannot be drawn."""
    place = origin.attrib if origin is not None else {}
    with suppress(ValueError):  # Nobody has read the numbers of what is only seen.
        translation = _numbers(place.get("xyz", "0 0 0"), 3)
        turn = Rotation.from_euler("xyz", _numbers(place.get("rpy", "0 0 0"), 3)).as_quat()
        if geometry.tag == "mesh":
            file, scale = _file(geometry.get("filename", ""), beside), _numbers(geometry.get("scale", "1 1 1"), 3)
            return Shape("mesh", tuple(scale.tolist()), file, translation, turn) if file else None
        if geometry.tag in _GEOMETRIES:
            sizes = [_numbers(geometry.get(name, ""), count) for name, count in _GEOMETRIES[geometry.tag]]
            return Shape(geometry.tag, tuple(np.concatenate(sizes).tolist()), None, translation, turn)
    return None


def _file(name: str, beside: Path | None) -> Path | None:
    """The file of a mesh, None if it does not exist here or has another format."""
    with suppress(OSError, ValueError):
        for file in _places(name, beside):
            if file.is_absolute() and file.suffix.lower() in _MESHES and file.is_file() and os.access(file, os.R_OK):
                return file
    return None


def _places(name: str, beside: Path | None) -> Iterator[Path]:
    """Where the file of a mesh may be."""
    if name.startswith("package://"):
        with suppress(DescriptionError):
            yield file_in_package(name)
        package, _, rest = name.removeprefix("package://").partition("/")
        folders = beside.absolute().parents if beside else ()
        yield from (folder / rest for folder in folders if folder.name == package)
    else:
        file = Path(name.removeprefix("file://"))
        yield beside.absolute().parent / file if beside else file


def _numbers(text: str, count: int) -> Array:
    """So many finite numbers, shape (count,).

    Raises:
        ValueError: the text has others.
    """
    found = np.array([float(word) for word in text.split()])
    if found.size != count or not np.isfinite(found).all():
        raise ValueError(f"{text!r} is not {count} finite numbers")
    return found
