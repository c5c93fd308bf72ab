"""The wheel, without ROS: it installs in an empty environment of the oldest and the newest supported Python of the
machine, and runs the README's Python in both, in the newest the examples that need more than that, and its commands.

The other examples run in the environment of the tests, which hides ROS from them: there, most is compiled.
"""

import json
import os
import subprocess
import sys
from collections import ChainMap
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from distribution.tools import call, make_environment, outside, pythons  # noqa: E402

SOURCE = ROOT / "ros2_ws" / "src"
OF_THE_WORKSPACE = ("analyse_bag.py", "move_an_arm.py", "nodes_from_python.py", "two_arms.py")
"""test_examples.py, test_arm_client.py and test_two_arms.py run them."""
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


def tree(folder: Path) -> set[Path]:
    return {path for path in (*ROOT.glob("*"), *folder.rglob("*")) if "__pycache__" not in path.parts}


@cache
def supported() -> dict[str, str]:
    """The interpreters by what they are here."""
    found = [str(python) for python in pythons().values()]
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
    # What one process has read from the new environment, the others need not compile.
    own = {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": ""}
    own["NUMBA_OPT"] = "0"  # Only once.
    environment = {**outside(), **own}
    before = tree(SOURCE)
    # From a folder, pip and uv build the wheel that a release has.
    installed = make_environment(Path(supported()[which]), folder / "venv", f"{ROOT}[dask,tables]")
    assert tree(SOURCE) == before, "the installation leaves nothing in the source tree"
    done = subprocess.run(
        [installed, RUNNER, folder, *RUNS[which]], env=environment, cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "pidtsm: compiling, once after an installation .." in done.stderr, "the first rollout shows its progress"
    found: Outcomes = json.loads(done.stdout)
    if which == "newest":
        found["commands"] = commands(installed.with_name("pidtsm"), folder, environment)
    return found


def commands(pidtsm: Path, folder: Path, environment: dict[str, str]) -> dict[str, str]:
    """What some commands print: those that must find files of the wheel, and some that need ROS; two at a time."""
    # After each other: what one has written, the next reads.
    working = (("demo",), ("rollout --duration 0.5 --bag --out bag", "analyze bag/bag"))
    failing = {**dict.fromkeys(("run", "live", "nodes list", "move --to 0 0"), 1), "shell": 2, "limit": 2}

    def printed(each: tuple[str, ...]) -> dict[str, str]:
        return {
            words: call(pidtsm, *words.split(), environment=environment, cwd=folder, code=failing.get(words, 0))
            for words in each
        }

    with ThreadPoolExecutor(2) as two:
        return dict(ChainMap(*two.map(printed, (*working, *((words,) for words in failing)))))


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Outcomes]:
    """The outcome of each Python, once."""
    return cache(lambda python: outcome(python, tmp_path_factory.mktemp("library")))


@pytest.mark.parametrize(
    ("python", "file"),
    [
        pytest.param(python, file, id=f"{python}-{file.name}", marks=[pytest.mark.long] if python == "oldest" else [])
        for python, files in RUNS.items()
        for file in files
    ],
)
def test_it_runs_without_ros(outcomes: Callable[[str], Outcomes], python: str, file: Path) -> None:
    found = outcomes(python)[file.name]
    assert not found["failure"], found["failure"]
    assert SHOWN.get(file.name, "") in found["output"]


def test_its_commands_work_or_say_what_they_need(outcomes: Callable[[str], Outcomes]) -> None:
    printed = outcomes("newest")["commands"]
    assert "ROS 2 is not installed" in printed["demo"]
    assert "results/demo: report.html metrics.json" in printed["demo"]
    assert "joint2" in printed["analyze bag/bag"]
    for words in ("run", "live", "nodes list", "move --to 0 0"):
        command = words.split()[0]
        assert printed[words] == (
            f"pidtsm: {command} needs ROS 2 Jazzy: call ./pidtsm {command} in the source checkout\n"
        )
    assert printed["shell"] == "pidtsm: shell needs the source checkout; see pidtsm --help\n"
    assert printed["limit"] == "pidtsm: limit needs CasADi: python -m pip install 'pidtsm[limit]'\n"
