"""Runs notebooks for their outputs, by nbconvert, with the packages of this interpreter."""

import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from distribution.outputs import kept
from distribution.tools import call, outside

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
    kept("notebooks", notebooks, programs, folder, lambda made: _execute(notebooks, programs, made))


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
