"""Where the description of an arm comes from: a name, a path, a URI, or the text itself."""

import os
from functools import lru_cache
from pathlib import Path

import yaml

from pidtsm_core.parameters import did_you_mean
from pidtsm_core.robots.errors import DescriptionError

_FOLDER = Path(__file__).with_name("arms")
ARMS = tuple(sorted(file.stem for file in _FOLDER.glob("*.urdf")))
"""Names of the arms that come with the package."""


def rated_payload(arm: str) -> float:
    """Rated payload of an arm of `ARMS`, kg; its sources are in ``arms/payloads.yaml``."""
    rated = yaml.safe_load((_FOLDER / "payloads.yaml").read_text(encoding="utf-8"))
    return float(rated[arm]["payload"])


def read_source(source: str) -> tuple[str, str]:
    """Name and text of a description.

    Args:
        source: a name in `ARMS`; the path or ``package://`` URI of a URDF, xacro or MJCF; or a text that begins with
            ``<``.

    Raises:
        DescriptionError: there is no such file, or it cannot be read.
    """
    if source.lstrip().startswith("<"):
        return "arm", source
    if source in ARMS:
        file = _FOLDER / f"{source}.urdf"
    else:
        file = _in_package(source) if source.startswith("package://") else Path(source)
    try:
        return _read(file.resolve(), file.stat().st_mtime_ns)
    except OSError as error:
        names = ("two_link", *ARMS)
        reason = f"{source}: {error.strerror or error}; neither a file nor one of {', '.join(names)}"
        raise DescriptionError(reason + did_you_mean(source, names)) from None
    except UnicodeDecodeError:
        raise DescriptionError(f"{file} is not text") from None


@lru_cache(maxsize=64)
def _read(file: Path, _changed: int) -> tuple[str, str]:
    """Read a file, and again when it has changed: a node looks for its robot with every change of a parameter."""
    if file.suffix == ".xacro":
        return file.name.split(".")[0], _expanded(file)
    return file.stem, file.read_text(encoding="utf-8")


def _in_package(uri: str) -> Path:
    """The file of a ``package://`` URI, in the installed packages of ROS."""
    package, _, rest = uri.removeprefix("package://").partition("/")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        share = Path(prefix, "share", package)
        if prefix and share.is_dir():
            return share / rest
    raise DescriptionError(f"{uri}: the package {package} is not among the installed packages (AMENT_PREFIX_PATH)")


def _expanded(file: Path) -> str:
    """The URDF that a xacro file expands to."""
    try:
        import xacro
    except ImportError:
        raise DescriptionError(f"{file} needs xacro: pip install xacro, or expand it to a URDF") from None
    try:
        return str(xacro.process_file(str(file)).toxml())
    except OSError:
        raise
    except Exception as error:  # xacro raises many kinds.
        raise DescriptionError(f"{file}: {' '.join(str(error).split())}") from None
