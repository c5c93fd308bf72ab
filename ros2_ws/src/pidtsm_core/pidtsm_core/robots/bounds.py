"""Largest descriptions: what MuJoCo's compiler is given, so that a small text cannot fill the memory or take hours."""

import math
import stat
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from pidtsm_core.robots.errors import DescriptionError

LONGEST = 2**24
"""Largest size of a description, and of each file that it includes, bytes."""
ELEMENTS = 20_000
"""Largest number of elements, those of included files and all copies counted."""
LINKS = 500
"""Largest number of links of a URDF."""
DEEPEST = 200
"""Largest depth of elements in each other."""
INCLUDES = 20
"""Largest number of files that include each other."""
POINTS = 2**24
"""Largest number of points of a height field, or of a picture."""
ASSET = 2**28
"""Largest size of a mesh or picture, bytes."""

_COPIED = {"replicate", "composite", "flexcomp"}
_INCLUDED = {"include", "model"}
_AREAS = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}
_LARGEST = {
    ("numeric", "size"): 100_000,
    ("user", "dim"): 100_000,
    ("size", "nuserdata"): 100_000,
    ("size", "nkey"): 1_000,
    ("size", "memory"): 2**29,
    ("size", "nstack"): 2**26,
    ("mesh", "params"): 500,
}
_LARGEST_OF_ANY = {"nsample": 10_000}
_USER_VALUES = 100
"""Largest number of values of a user at each body, joint and so on."""
_UNITS = {"k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40, "p": 2**50, "e": 2**60}
_PNG = b"\x89PNG\r\n\x1a\n"


def read_text(file: Path) -> str:
    """The text of a file.

    Raises:
        DescriptionError: it is too long, or a device.
        OSError: it cannot be read.
        UnicodeDecodeError: it is not text.
    """
    return file_bytes(file, LONGEST).decode("utf-8")


def file_bytes(file: Path, most: int) -> bytes:
    """The content of a file of at most so many bytes.

    Raises:
        DescriptionError: it is longer, or a device.
        OSError: it cannot be read.
    """
    status = file.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        raise DescriptionError(f"{file} is neither a file nor a folder")
    if stat.S_ISREG(status.st_mode) and status.st_size > most:
        raise DescriptionError(f"{file} has {status.st_size / 2**20:.0f} MB; at most {most // 2**20} MB are read")
    return file.read_bytes()


def check_bounds(root: Element, folder: Path | None = None) -> None:
    """Check the size of a description, with the files that it includes.

    Args:
        root: its root element.
        folder: where its included files are; None: the current folder.

    Raises:
        DescriptionError: it is too large; the message names the element.
    """
    if (links := len(root.findall("link"))) > LINKS:
        raise DescriptionError(f"the description has {links} links; at most {LINKS} are read")
    _Size(folder or Path()).add(root, 1, 0, 0)


class _Size:
    """The size of a description, which is added up."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._elements = 0.0

    def add(self, element: Element, copies: float, depth: int, includes: int) -> None:
        """Add an element that occurs so many times, at this depth, in a file included by so many others."""
        if depth > DEEPEST:
            raise DescriptionError(f"more than {DEEPEST} elements are nested in each other")
        _check_numbers(element)
        if element.tag in _COPIED:
            copies *= max(1.0, math.prod(_numbers(element, "count")))
        self._elements += copies
        if self._elements > ELEMENTS:
            reason = f"; there are {copies:.3g} copies of its {element.tag}" if copies > 1 else ""
            raise DescriptionError(
                f"the description has more than {ELEMENTS} elements, with all copies and included files{reason}"
            )
        if file := element.get("file", ""):
            self._add_file(element.tag, self._folder / file, copies, includes)
        for child in element:
            self.add(child, copies, depth + 1, includes)

    def _add_file(self, tag: str, file: Path, copies: float, includes: int) -> None:
        try:
            if tag not in _INCLUDED:
                _check_asset(file)
                return
            if includes == INCLUDES:
                raise DescriptionError(f"{file} includes itself")
            root = ElementTree.fromstring(read_text(file))  # noqa: S314  As that of the description.
        except (OSError, ElementTree.ParseError, UnicodeDecodeError):
            return  # The compiler reports what is wrong, or finds the file elsewhere.
        self.add(root, copies, 0, includes + 1)


def _check_numbers(element: Element) -> None:
    if area := _AREAS.get(element.tag):
        points = math.prod(max(_numbers(element, name), default=0.0) for name in area)
        if points > POINTS:
            size = " x ".join(element.get(name, "") for name in area)
            raise DescriptionError(f"the {element.tag} {element.get('name', '')} has {size} points; it is too large")
    for name in element.attrib:
        largest = _LARGEST.get((element.tag, name), _LARGEST_OF_ANY.get(name))
        if element.tag == "size" and name.startswith("nuser_"):
            largest = _USER_VALUES
        if largest is not None and max(_numbers(element, name), default=0.0) > largest:
            raise DescriptionError(f"{name} of {element.tag} is {element.get(name)!r}; it is at most {largest}")


def _numbers(element: Element, name: str) -> list[float]:
    """The numbers in an attribute, as large as any reader could take them; what is none counts as 0."""
    found = []
    for word in element.get(name, "").split():
        unit = _UNITS.get(word[-1:].lower(), 1)
        try:
            value = float(word if unit == 1 else word[:-1]) * unit
        except ValueError:
            value = 0.0
        found.append(0.0 if math.isnan(value) else abs(value))
    return found


def _check_asset(file: Path) -> None:
    """Check the size of a mesh or picture, and that of the picture when it is unpacked."""
    size = file.stat().st_size
    if size > ASSET:
        raise DescriptionError(f"{file} has {size / 2**20:.0f} MB; at most {ASSET // 2**20} MB are read")
    if file.is_file():
        with file.open("rb") as opened:
            head = opened.read(24)
        width, height = int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
        if head.startswith(_PNG) and width * height > POINTS:
            raise DescriptionError(f"the picture {file} has {width} x {height} points; it is too large")
