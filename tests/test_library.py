"""The library without ROS: it installs in an empty environment of the oldest and the newest supported Python of the
machine, and runs the README's Python in both, and in the newest the examples that need more than that.

The other examples run in the environment of the tests, which hides ROS from them: there, most is compiled.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from launcher.install import uv_variables  # noqa: E402

SOURCE = ROOT / "ros2_ws" / "src" / "pidtsm_core"
OF_THE_WORKSPACE = ("analyse_bag.py", "move_an_arm.py", "nodes_from_python.py")
"""test_examples.py and test_arm_client.py run them."""
FILES = [
    ROOT / "README.md",
    *sorted(f for f in ROOT.glob("examples/*.*") if f.suffix in (".py", ".ipynb") and f.name not in OF_THE_WORKSPACE),
]


SHOWN = {
    "dask_cluster.py": "threads: True",
    "own_law.ipynb": "failed: {}",
    "read_into_pandas.py": "joints that slide: ['joint3']",
}
"""What an example prints if a cluster, and tables, agree with the rollout: the examples that need other libraries."""
RUNNER = ROOT / "tests" / "support" / "run_examples.py"
SUPPORTED = [f"3.{minor}" for minor in range(10, 15)]


def pythons() -> list[str]:
    """The interpreters of the supported versions, one each: this one, those of the path, of pyenv and of uv."""
    path = [Path(folder) for folder in os.environ["PATH"].split(os.pathsep)]
    # pyenv has the interpreters beside its shims, which run only one of them.
    pyenv = [folder for shims in path if shims.name == "shims" for folder in shims.parent.glob("versions/*/bin")]
    uv = Path.home().glob(".local/share/uv/python/*/bin")
    found = {f"{sys.version_info.major}.{sys.version_info.minor}": sys.executable}
    for folder in (*path, *pyenv, *uv):
        for version in SUPPORTED:
            file = folder / f"python{version}"
            if version not in found and os.access(file, os.X_OK) and runs(file):
                found[version] = str(file)
    return [found[version] for version in sorted(found)]


def runs(python: Path) -> bool:
    """Whether it is an interpreter; a shim of pyenv may be none."""
    return subprocess.run([python, "-c", "import venv"], capture_output=True).returncode == 0


def tree(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if "__pycache__" not in path.parts}


@cache
def supported() -> dict[str, str]:
    """The interpreters by what they are here."""
    found = pythons()
    return {"oldest": found[0], "newest": found[-1]}


RUNS = {
    "oldest": FILES[:1],
    "newest": [file for file in FILES if file.name in ("README.md", *SHOWN)],
    "of the tests": [file for file in FILES[1:] if file.name not in SHOWN],
}
"""What each interpreter runs; the README is first."""


Outcomes = dict[str, dict[str, str]]


def without_ros(folder: Path) -> Outcomes:
    """Outcome by file in the environment of the tests, of which only the library is to be found."""
    library = [path for path in sys.path if (Path(path) / "pidtsm_core").is_dir()]
    environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": os.pathsep.join(library)}
    words = [sys.executable, str(RUNNER), "--without-ros", str(folder), *map(str, RUNS["of the tests"])]
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found: Outcomes = json.loads(done.stdout)
    return found


def outcome(which: str, folder: Path) -> Outcomes:
    """Outcome by file, from one process, because the first rollout there has to be compiled."""
    if which not in supported():
        return without_ros(folder)
    python = supported()[which]
    pip = subprocess.check_output([sys.executable, "-m", "pip", "config", "list"], text=True)
    # Nothing of the workspace, nor of ROS.
    kept = {name: value for name, value in os.environ.items() if not name.endswith("PATH") or name == "PATH"}
    # What one process has read from the new environment, the others need not compile.
    own = {"MPLBACKEND": "Agg", "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": ""}
    own["NUMBA_OPT"] = "0"  # Only once.
    environment = {**kept, **uv_variables(pip), **own}
    installed = folder / "venv" / "bin" / "python"

    def call(*words: object) -> subprocess.CompletedProcess[str]:
        done = subprocess.run([str(w) for w in words], env=environment, cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done

    before = tree(SOURCE)
    call("uv", "venv", "--python", python, folder / "venv")
    call("uv", "pip", "install", "--python", installed, f"{SOURCE}[dask,plot,tables]")
    assert tree(SOURCE) == before, "the installation leaves nothing in the source tree"
    done = call(installed, RUNNER, folder, *RUNS[which])
    assert "pidtsm: compiling, once after an installation .." in done.stderr, "the first rollout shows its progress"
    found: Outcomes = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Outcomes]:
    """The outcome of each Python, once."""
    return cache(lambda python: outcome(python, tmp_path_factory.mktemp("library")))


@pytest.mark.parametrize(
    ("python", "file"),
    [pytest.param(python, file, id=f"{python}-{file.name}") for python, files in RUNS.items() for file in files],
)
def test_it_runs_without_ros(outcomes: Callable[[str], dict[str, Any]], python: str, file: Path) -> None:
    found = outcomes(python)[file.name]
    assert not found["failure"], found["failure"]
    assert SHOWN.get(file.name, "") in found["output"]
