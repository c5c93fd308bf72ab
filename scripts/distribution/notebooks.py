"""Runs notebooks for their outputs, by nbconvert, with the packages of this interpreter."""

import hashlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from distribution.tools import ROOT, call, outside

_KERNEL = "pidtsm"
_LAUNCH = (
    "import sys; sys.path.append(sys.argv.pop(1)); "
    "from ipykernel.kernelapp import launch_new_instance; launch_new_instance()"
)
"""The tools come after this interpreter's own packages: the notebook gets those that it was written for."""


def execute(notebooks: Sequence[Path], programs: Path, folder: Path) -> None:
    """Write NAME.md for each notebook to a folder, and beside it its pictures, in NAME_files.

    A cell with the tag `skip-execution` is shown, but not run.

    Args:
        notebooks: their files.
        programs: folder of the programs of requirements/docs.lock.
        folder: exists.

    Raises:
        DistributionError: a cell fails.
    """
    kept("notebooks", key(notebooks, programs), folder, lambda made: _execute(notebooks, programs, made))


def kept(kind: str, changes: str, folder: Path, make: Callable[[Path], None]) -> None:
    """Copy to a folder what is made in a new one, or was made by an earlier call for the same `changes`."""
    stored = ROOT / ".venv" / kind / changes
    if not stored.exists():
        with tempfile.TemporaryDirectory(dir=ROOT / ".venv") as made:
            make(Path(made, "all"))
            shutil.rmtree(stored.parent, ignore_errors=True)
            stored.parent.mkdir()
            Path(made, "all").rename(stored)
    shutil.copytree(stored, folder, dirs_exist_ok=True)


def key(examples: Sequence[Path], programs: Path) -> str:
    """Changes with the examples and with what they run, which takes most of the time of a site."""
    sources = sorted((ROOT / "ros2_ws" / "src" / "pidtsm_core" / "pidtsm_core").rglob("*.py"))
    digest = hashlib.sha256(programs.parent.name.encode())
    for file in (*examples, *sources):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _execute(notebooks: Sequence[Path], programs: Path, folder: Path) -> None:
    folder.mkdir()
    (packages,) = programs.parent.glob("lib/python*/site-packages")
    with tempfile.TemporaryDirectory() as text:
        kernel = Path(text, "kernels", _KERNEL)
        kernel.mkdir(parents=True)
        spec = {
            "argv": [sys.executable, "-c", _LAUNCH, str(packages), "-f", "{connection_file}"],
            "display_name": _KERNEL,
            "language": "python",
            "env": {name: value for name, value in os.environ.items() if name.endswith("PATH")},
        }
        (kernel / "kernel.json").write_text(json.dumps(spec), "utf-8")
        # IPython chooses the back end that leaves figures in the page.
        environment = {**outside(), "JUPYTER_PATH": text, "IPYTHONDIR": text, "MPLBACKEND": ""}
        words = [
            "--to",
            "markdown",
            "--execute",
            f"--ExecutePreprocessor.kernel_name={_KERNEL}",
            "--output-dir",
            folder,
        ]
        call(programs / "python", "-m", "nbconvert", *words, *notebooks, environment=environment)
