"""The version: defined in `pidtsm_core`, and written wherever a format demands it."""

import re
from pathlib import Path

_DEFINITION = Path("ros2_ws/src/pidtsm_core/pidtsm_core/__init__.py")
_ELSEWHERE = {
    "ros2_ws/src/*/setup.py": r'version="([^"]+)"',
    "ros2_ws/src/*/package.xml": r"<version>([^<]+)</version>",
    "CITATION.cff": r"^version: (\S+)",
}


def version(root: Path) -> str:
    """The version of the checkout at `root`."""
    return _found(root / _DEFINITION, r'^__version__ = "([^"]+)"')


def find_differences(root: Path) -> list[str]:
    """Files that give another version."""
    files = [(file, pattern) for name, pattern in _ELSEWHERE.items() for file in sorted(root.glob(name))]
    return [str(file.relative_to(root)) for file, pattern in files if _found(file, pattern) != version(root)]


def _found(file: Path, pattern: str) -> str:
    (value,) = re.findall(pattern, file.read_text("utf-8"), re.MULTILINE)
    return str(value)
