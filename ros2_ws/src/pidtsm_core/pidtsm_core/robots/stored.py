"""Where arms that the user has stored under a name are: small files under the user's configuration (XDG)."""

import os
import re
from pathlib import Path

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf")
"""Ends of the names of files that describe arms."""


def arms_folder() -> Path:
    """The folder of the stored arms: ``pidtsm/arms`` under ``XDG_CONFIG_HOME``, by default ``~/.config``."""
    given = Path(os.environ.get("XDG_CONFIG_HOME", ""))
    # The specification of XDG: a relative path is ignored. Without a home, `Path.expanduser` raises an exception.
    home = Path(os.path.expanduser("~/.config"))  # noqa: PTH111
    return (given if given.is_absolute() else home) / "pidtsm" / "arms"


def is_name(text: str) -> bool:
    """Whether an arm may be stored under this name."""
    return bool(_NAME.fullmatch(text)) and not text.endswith(_DESCRIPTIONS)


def stored_file(name: str) -> Path:
    """The file of a stored arm; it need not exist."""
    return arms_folder() / f"{name}.yaml"


def stored_names() -> tuple[str, ...]:
    """Names of the stored arms."""
    try:
        return tuple(sorted(file.stem for file in arms_folder().glob("*.yaml") if is_name(file.stem)))
    except OSError:
        return ()
