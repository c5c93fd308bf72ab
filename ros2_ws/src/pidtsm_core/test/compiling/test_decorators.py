"""The cache of compiled functions is never stale; a folder that is not writable is no error."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import pidtsm_core

CACHE = "from pidtsm_core.compiling.decorators import cache_folder; print(cache_folder())"
COMPILE = """
import numpy
from pidtsm_core.compiling.decorators import cache_folder
from pidtsm_core.laws.computed_torque import command
print(command(0.0, 0.0, 0.0, 1.5, numpy.zeros(4, int), numpy.zeros(2), numpy.zeros(3), 0.0)[0], cache_folder())
"""


def run(code: str, package_parent: Path, **changes: str) -> str:
    """Standard output of a Python that imports the package from that folder."""
    kept = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "PYTHONPATH")}
    environment = {**kept, "PYTHONPATH": str(package_parent), "PYTHONDONTWRITEBYTECODE": "1", **changes}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A folder with a copy of the package."""
    target = tmp_path / "copy"
    shutil.copytree(
        Path(pidtsm_core.__file__).parent, target / "pidtsm_core", ignore=shutil.ignore_patterns("__pycache__")
    )
    return target


EDIT = """
import pathlib
import pidtsm_core
from pidtsm_core.compiling.decorators import cache_folder

def folder():
    cache_folder.cache_clear()
    return cache_folder()

package = pathlib.Path(pidtsm_core.__file__).parent
print(folder(), folder())
with (package / "robots" / "two_link.py").open("a") as file:
    file.write("# Another line.")
print(folder())
(package / "laws" / "new.py").touch()
print(folder())
"""


def test_an_edit_to_any_source_file_gives_another_cache_folder(copy: Path, tmp_path: Path) -> None:
    before, again, edited, longer = run(EDIT, copy, HOME=str(tmp_path / "home")).split()
    assert before == again
    assert Path(before).is_relative_to(tmp_path / "home")
    assert len({before, edited, longer}) == 3


@pytest.mark.parametrize("variable", ["HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"])
def test_a_folder_that_cannot_be_written_does_not_matter(copy: Path, tmp_path: Path, variable: str) -> None:
    # No user, not even root, can create a path below a file.
    blocked = tmp_path / "file"
    blocked.write_text("")
    printed = run(COMPILE, copy, **{"HOME": str(tmp_path), variable: str(blocked / "below"), "TMPDIR": str(tmp_path)})
    value, folder = printed.split(maxsplit=1)
    assert value == "1.5"
    assert Path(folder).is_dir()


def test_compiled_functions_are_kept_in_the_cache(copy: Path, tmp_path: Path) -> None:
    _, folder = run(COMPILE, copy, HOME=str(tmp_path), NUMBA_CACHE_DIR=str(tmp_path / "cache")).split(maxsplit=1)
    assert Path(folder).parent.parent == tmp_path / "cache"
    assert list(Path(folder).rglob("*command*.nbc"))


def test_only_own_old_caches_are_removed(copy: Path, tmp_path: Path) -> None:
    root = tmp_path / "cache"
    foreign = [root / f"project_{i}" for i in range(12)]
    for folder in foreign:
        folder.mkdir(parents=True)
        (folder / "precious").write_text("")
    run(CACHE, copy, HOME=str(tmp_path), NUMBA_CACHE_DIR=str(root))
    assert [f.name for f in foreign if not f.exists()] == []


MANY = """
import os, pathlib
import pidtsm_core
from pidtsm_core.compiling.decorators import cache_folder

def folder(number):
    (pathlib.Path(pidtsm_core.__file__).parent / "extra.py").write_text(f"N = {number}")
    cache_folder.cache_clear()
    return cache_folder()

for i in range(11):
    print(made := folder(i))
    if i < 9:
        yesterday = made.stat().st_mtime - 86_400 + i
        os.utime(made, (yesterday, yesterday))
before = (used := folder(9)).stat().st_mtime
os.utime(used, (before - 7200, before - 7200))
assert folder(9).stat().st_mtime > before - 60, "using it makes it young"
"""


def test_old_caches_do_not_pile_up_and_those_in_use_stay(copy: Path, tmp_path: Path) -> None:
    folders = [Path(line) for line in run(MANY, copy, HOME=str(tmp_path / "home")).splitlines()]
    assert len({*folders}) == 11
    left = [folder for folder in folders if folder.exists()]
    assert folders[9:] == left[-2:]
    assert len(left) < 9


USERS = """
import hashlib, json, sys
import numba
import numpy as np

def settings():
    return {name: repr(getattr(numba.config, name)) for name in dir(numba.config) if name.isupper()}

before = settings()
if sys.argv[1] == "after a rollout":
    from pidtsm_core.rollouts.closed_loop import rollout
    rollout("case1", duration=0.01)

@numba.njit(fastmath=True)
def dot(x, y):
    total = 0.0
    for i in range(x.size):
        total += x[i] * y[i]
    return total

dot(np.ones(8), np.ones(8))
(text,) = dot.inspect_asm().values()
words = text.split()
vectors = sum(words.count(name) for name in ("mulpd", "vmulpd", "vfmadd231pd", "vfmadd213pd", "vfmadd132pd", "fmla"))
print(json.dumps([before == settings(), vectors]))
"""


def test_a_function_of_the_users_own_is_compiled_as_without_this_package() -> None:
    """As fast, that is: into as many instructions that multiply several numbers at once, as without."""
    found = []
    for when in ("alone", "after a rollout"):
        done = subprocess.run([sys.executable, "-c", USERS, when], capture_output=True, text=True, check=True)
        unchanged, vectors = json.loads(done.stdout)
        assert unchanged, "numba.config"
        found.append(vectors)
    assert found[0] == found[1] > 0
