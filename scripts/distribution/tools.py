"""Tools that are installed apart from the workspace, and the interpreters of this machine."""

import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from launcher.install import uv_variables

ROOT = Path(__file__).resolve().parents[2]
SUPPORTED = tuple(f"3.{minor}" for minor in range(10, 15))


class DistributionError(Exception):
    """A step failed; the text ends with what it wrote."""


def outside() -> dict[str, str]:
    """Variables for processes that must find nothing of the workspace, nor of ROS, and for uv the index of pip."""
    pip = subprocess.check_output([sys.executable, "-m", "pip", "config", "list"], text=True)
    kept = {name: value for name, value in os.environ.items() if not name.endswith("PATH") or name == "PATH"}
    kept.pop("PYTHONDONTWRITEBYTECODE", None)  # A user's processes need not compile all modules each time.
    return {**kept, **uv_variables(pip), "MPLBACKEND": "Agg"}


def call(*words: object, environment: Mapping[str, str], cwd: Path = ROOT, code: int = 0) -> str:
    """Run a command and return its output, standard error included.

    Raises:
        DistributionError: it does not end with this exit code, or is not there.
    """
    line = [str(word) for word in words]
    try:
        done = subprocess.run(
            line, env=environment, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
    except FileNotFoundError as error:
        raise DistributionError(f"this needs the program {line[0]}, which is not here") from error
    if done.returncode != code:
        raise DistributionError(f"{' '.join(map(str, words))}: exit code {done.returncode}\n{done.stdout[-4000:]}")
    return done.stdout


def emptied(folder: Path, ours: str) -> Path:
    """Make a folder for results, or empty that of an earlier call; returns it.

    Args:
        folder: as the user names it.
        ours: a regular expression that fits all names which an earlier call leaves in it.

    Raises:
        DistributionError: it has something else, which must not be lost, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        found = list(folder.iterdir())
        if foreign := sorted(file.name for file in found if not re.fullmatch(ours, file.name)):
            raise DistributionError(f"{folder} has {foreign[0]}, which is not of an earlier call: name an empty folder")
        for file in found:
            if file.is_dir():
                shutil.rmtree(file)
            else:
                file.unlink()
    except OSError as error:
        raise DistributionError(f"{folder} cannot be written: {error.strerror}") from error
    return folder


def tools(name: str) -> Path:
    """Folder of the programs of ``requirements/NAME.lock``, which the first call installs.

    Raises:
        DistributionError: they cannot be installed.
    """
    lock = ROOT / "requirements" / f"{name}.lock"
    digest = hashlib.sha256(lock.read_bytes()).hexdigest()[:12]
    folder = ROOT / ".venv" / "tools" / f"{name}-{digest}"
    complete = folder / "complete"
    if not complete.exists():
        print(f"pidtsm: installing the tools of {lock.relative_to(ROOT)}", file=sys.stderr)
        shutil.rmtree(folder, ignore_errors=True)
        # Not in the checkout: uv would take the requirements of its pyproject.toml into account.
        make_environment(Path(sys.executable), folder, "--no-deps", "--require-hashes", "-r", lock)
        complete.touch()
    return folder / "bin"


def make_environment(python: Path, folder: Path, *packages: object) -> Path:
    """Create an empty environment, install packages in it with uv, and return its interpreter.

    Raises:
        DistributionError: uv fails.
    """
    environment = outside()
    folder.parent.mkdir(parents=True, exist_ok=True)
    call("uv", "venv", "--quiet", "--python", python, folder, environment=environment, cwd=folder.parent)
    installed = folder / "bin" / "python"
    call(
        *("uv", "pip", "install", "--quiet", "--python", installed, *packages),
        environment=environment,
        cwd=folder.parent,
    )
    return installed


def pythons() -> dict[str, Path]:
    """The interpreters of the supported versions, one each: this one, those of the path, of pyenv and of uv."""
    path = [Path(folder) for folder in os.environ["PATH"].split(os.pathsep)]
    # pyenv has the interpreters beside its shims, which run only one of them.
    pyenv = [folder for shims in path if shims.name == "shims" for folder in shims.parent.glob("versions/*/bin")]
    uv = Path.home().glob(".local/share/uv/python/*/bin")
    found = {f"{sys.version_info.major}.{sys.version_info.minor}": Path(sys.executable)}
    for folder in (*path, *pyenv, *uv):
        for version in SUPPORTED:
            file = folder / f"python{version}"
            if version not in found and os.access(file, os.X_OK) and _runs(file):
                found[version] = file
    return {version: found[version] for version in SUPPORTED if version in found}


def _runs(python: Path) -> bool:
    """Whether it is an interpreter; a shim of pyenv may be none."""
    return subprocess.run([python, "-c", "import venv"], capture_output=True).returncode == 0
