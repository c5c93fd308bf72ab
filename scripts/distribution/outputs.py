"""Keeps what the examples have drawn: running them takes most of the time of a site."""

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from distribution.tools import ROOT


def kept(kind: str, examples: Sequence[Path], programs: Path, folder: Path, make: Callable[[Path], None]) -> None:
    """Copy to a folder what the examples make, or have made before they or what they run has changed.

    Args:
        kind: of what they make.
        examples: their files.
        programs: folder of the programs of requirements/docs.lock.
        folder: exists.
        make: called with the path of a new folder, which it makes and fills.
    """
    stored = ROOT / ".venv" / kind / _digest(examples, programs)
    if not stored.exists():
        with tempfile.TemporaryDirectory(dir=ROOT / ".venv") as made:
            make(Path(made, "all"))
            shutil.rmtree(stored.parent, ignore_errors=True)
            stored.parent.mkdir()
            Path(made, "all").rename(stored)
    shutil.copytree(stored, folder, dirs_exist_ok=True)


def _digest(examples: Sequence[Path], programs: Path) -> str:
    """Digest of the examples, the programs, and the whole core, with its parameters and arms."""
    core = (ROOT / "ros2_ws" / "src" / "pidtsm_core" / "pidtsm_core").rglob("*")
    sources = sorted(file for file in core if file.is_file() and file.suffix != ".pyc")
    digest = hashlib.sha256(programs.parent.name.encode())
    for file in (*examples, *sources):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
