"""Where the elements of a description are in its file."""

from contextlib import suppress
from pathlib import Path
from xml.parsers import expat

from pidtsm_core.robots.bounds import read_text
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.source import ARMS, file_in_package

Lines = dict[tuple[str, str], int]
"""Lines of elements, by kind (``link`` or ``joint``) and name."""
_URDF = {"link": "link", "joint": "joint"}
_MJCF = {"body": "link", "joint": "joint", "freejoint": "joint"}


def file_of(source: str) -> Path | None:
    """The file of a description, see `read_source`; None: there is none."""
    if source.lstrip().startswith("<") or "\0" in source:
        return None
    if source in ARMS:
        return Path(__file__).parents[1] / "arms" / f"{source}.urdf"
    with suppress(DescriptionError, OSError):
        file = file_in_package(source) if source.startswith("package://") else Path(source)
        return file if file.is_file() else None
    return None


def lines_of(source: str) -> Lines:
    """Lines of the links and joints in a file or text; none for xacro, whose elements are made when it is expanded."""
    file = file_of(source)
    if file is None:
        return element_lines(source) if source.lstrip().startswith("<") else {}
    if file.suffix == ".xacro":
        return {}
    try:
        return element_lines(read_text(file))
    except (DescriptionError, OSError, UnicodeDecodeError):
        return {}


def element_lines(text: str) -> Lines:
    """Lines of the links and joints of a URDF or MJCF, as far as the text is XML; bodies of an MJCF are links."""
    found: Lines = {}
    path: list[str] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        path.append(tag)
        is_urdf = path[0] == "robot"
        kind = (_URDF if is_urdf else _MJCF).get(tag)
        # Elsewhere, elements of these names refer to links and joints.
        defines = len(path) == 2 if is_urdf else "worldbody" in path
        if kind and defines and (name := attributes.get("name")):
            found.setdefault((kind, name), parser.CurrentLineNumber)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _tag: path.pop()
    with suppress(expat.ExpatError):
        parser.Parse(text, True)
    return found
