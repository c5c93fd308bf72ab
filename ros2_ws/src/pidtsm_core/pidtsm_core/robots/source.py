"""Where the description of an arm comes from: a name, a path, a URI, or the text itself."""

import os
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import yaml

from pidtsm_core.parameters import did_you_mean
from pidtsm_core.robots.bounds import check_bounds, read_text
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.expansion import expanded
from pidtsm_core.robots.stored import stored_names

_FOLDER = Path(__file__).with_name("arms")
ARMS = tuple(sorted(file.stem for file in _FOLDER.glob("*.urdf")))
"""Names of the arms that come with the package."""
_XACRO = ".xacro"


def rated_payload(arm: str) -> float:
    """Rated payload of an arm of `ARMS`, kg; its sources are in ``arms/payloads.yaml``."""
    rated = yaml.safe_load((_FOLDER / "payloads.yaml").read_text(encoding="utf-8"))
    return float(rated[arm]["payload"])


def read_source(source: str, arguments: tuple[tuple[str, str], ...] = ()) -> tuple[str, str]:
    """Name and text of a description.

    Args:
        source: a name in `ARMS`; the path or ``package://`` URI of a URDF, xacro or MJCF; or a text that begins with
            ``<``.
        arguments: of a xacro file, as pairs of name and value.

    Raises:
        DescriptionError: there is no such file, or it cannot be read, or it takes no arguments.
    """
    if arguments and not source.endswith(_XACRO):
        raise DescriptionError(f"only a xacro file has arguments, such as {':='.join(arguments[0])}, and this is none")
    if source.lstrip().startswith("<"):
        return "arm", source
    if "\0" in source:
        raise DescriptionError(f"{source!r} is no path: it contains a null character")
    if source in ARMS:
        file = _FOLDER / f"{source}.urdf"
    else:
        file = file_in_package(source) if source.startswith("package://") else Path(source)
    try:
        return _read(file.resolve(), file.stat().st_mtime_ns, arguments)
    except OSError as error:
        names = ("two_link", *ARMS, *stored_names())
        reason = f"{source}: {error.strerror or error}; neither a file nor one of {', '.join(names)}"
        raise DescriptionError(reason + did_you_mean(source, names)) from None
    except UnicodeDecodeError:
        raise DescriptionError(f"{file} is not text") from None
    except UnicodeEncodeError:
        raise DescriptionError(f"{source!r} is no path: it contains characters that no path can have") from None


@lru_cache(maxsize=64)
def _read(file: Path, _changed: int, arguments: tuple[tuple[str, str], ...]) -> tuple[str, str]:
    """Read a file, and again when it has changed: a node looks for its robot with every change of a parameter."""
    if file.suffix == _XACRO:
        return file.name.split(".")[0], expanded(file, dict(arguments))
    text = read_text(file)
    return file.stem, _located(file.parent, text) if "<mujoco" in text else text


def _located(folder: Path, text: str) -> str:
    """An MJCF that does not depend on its folder: with its included files, and with absolute paths of its assets.

    Raises:
        DescriptionError: an included file cannot be read.
    """
    try:
        root = ElementTree.fromstring(text)  # noqa: S314  A robot's own description; expat limits expansion.
    except ElementTree.ParseError:
        return text  # The compiler reports what is wrong.
    if root.tag != "mujoco" or not any("file" in element.attrib for element in root.iter()):
        return text
    check_bounds(root, folder)
    _include(folder, root)
    compilers = list(root.iter("compiler")) or [SubElement(root, "compiler")]
    for kind in ("meshdir", "texturedir"):
        given = [value for each in compilers if (value := each.get(kind, each.get("assetdir")))]
        for compiler in compilers:
            compiler.set(kind, str(folder / "".join(given[-1:])))
    return ElementTree.tostring(root, encoding="unicode")


def _include(folder: Path, element: Element) -> None:
    """Replace the elements ``include`` by the content of their files, whose paths are relative to the main file."""
    children = []
    for child in element:
        if child.tag == "include":
            file = folder / child.get("file", "")
            try:
                included = ElementTree.fromstring(read_text(file))  # noqa: S314  As above.
            except (OSError, ElementTree.ParseError, UnicodeDecodeError) as error:
                raise DescriptionError(f"the included file {file} cannot be read: {error}") from None
            _include(folder, included)
            children += list(included)
        else:
            _include(folder, child)
            children.append(child)
    element[:] = children


def file_in_package(uri: str) -> Path:
    """The file of a ``package://`` URI, in the installed packages of ROS.

    Raises:
        DescriptionError: there is no such package.
    """
    package, _, rest = uri.removeprefix("package://").partition("/")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        share = Path(prefix, "share", package)
        if prefix and share.is_dir():
            return share / rest
    raise DescriptionError(f"{uri}: the package {package} is not among the installed packages (AMENT_PREFIX_PATH)")
