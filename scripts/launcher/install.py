"""Set-up: check the machine, create the environment, install packages, build the workspace, record the state."""

import ast
import fcntl
import os
import platform
import re
import shutil
import sys
import sysconfig
import time
from importlib.util import find_spec
from pathlib import Path
from subprocess import DEVNULL, check_output, run
from typing import Any, NamedTuple

from launcher import environment
from launcher.environment import STEPS, WHEELS, Layout, SetupError, report

# Options of pip and the corresponding variables of uv, which does not read pip's configuration.
_PIP = ("index-url", "extra-index-url", "find-links", "trusted-host", "cert", "no-cache-dir", "no-index")
_UV: tuple[str, ...] = ("UV_DEFAULT_INDEX", "UV_INDEX", "UV_FIND_LINKS", "UV_INSECURE_HOST", "SSL_CERT_FILE")
_UV += ("UV_NO_CACHE", "UV_OFFLINE")


def _check_machine(ros: str, root: Path, *, create: bool) -> None:
    """Raise SetupError, with what to install, if anything is missing; `create`: a new environment will be created."""
    system = f"{sys.platform} {platform.machine()} {platform.libc_ver()[0]}"
    free = shutil.disk_usage(root).free / 1e9
    advice = "(Debian, Ubuntu: sudo apt install build-essential python3-dev python3-venv)"
    if odd := re.search(r"[^\w./+,@=~-]", str(root), re.ASCII):
        cure = "move this folder to a path of plain letters, digits and . _ - / + , @ = ~ only"
        raise SetupError(f"the build tools of ROS 2 cannot handle {odd[0]!r} in {root}: {cure}.")
    if not os.access(root, os.W_OK):
        raise SetupError(f"{root} must be set up, but this user cannot write there.")
    if ros == WHEELS and system != "linux x86_64 glibc":
        raise SetupError(f"the wheels of ROS 2 need linux x86_64 glibc, this is {system}: source a ROS 2 Jazzy first.")
    if create and free < 2.0:
        raise SetupError(f"the set-up needs about 2 GB of disk, and {root} has {free:.1f} GB left.")
    if not (find_spec("venv") and find_spec("ensurepip")):
        raise SetupError(f"Python's venv or ensurepip module is missing in {sys.executable} {advice}.")
    compiler, include = os.environ.get("CXX") or "c++", f"-I{sysconfig.get_path('include')}"
    command = ["env", *compiler.split(), "-x", "c++", include, "-fsyntax-only", "-"]
    done = run(command, input="#include <string>\n#include <Python.h>\n", capture_output=True, text=True)
    if done.returncode != 0:
        raise SetupError(f"{compiler} {include} cannot compile a C++ program: {find_cause(done.stderr)} {advice}.")


def find_cause(output: str) -> str:
    """Short reason why a step failed, from its output."""
    if re.search("ConnectionError|Timeout|timed out|refused|unreachable|name resolution|ProxyError", output):
        return "no connection to the Python package index (network, proxy?)"
    errors = re.findall(r"(?im)^.*(?:error|failed|no such file).*$", output)
    return errors[-1].strip() if errors else "no reason given"


def uv_variables(pip_configuration: str) -> dict[str, str]:
    """Variables that make uv use pip's package index, from the output of `pip config list`."""
    given = dict(line.split("=", 1) for line in pip_configuration.splitlines())
    found = {"UV_INDEX_STRATEGY": "unsafe-best-match"}  # pip takes a package from any index, uv from the first with it
    for option, variable in zip(_PIP, _UV, strict=True):
        for section in ("global", "install", ":env:"):  # later ones override earlier ones, as in pip
            if value := given.get(f"{section}.{option}"):
                found[variable] = ("," if option == "find-links" else " ").join(ast.literal_eval(value).split())
    return found


def patch_wheels(venv: Path, include: str) -> None:
    """Replace the paths of the build machine in the wheels' CMake files by those of this environment."""
    for file in (venv / "share").rglob("*.cmake"):
        text = file.read_text()
        if "/opt/python/cp" in text:
            text = re.sub(r"/opt/python/cp\d+-cp\d+/include/python3\.\d+", include, text)
            file.unlink()  # uv creates hard links to its cache
            file.write_text(re.sub(r"/opt/python/cp\d+-cp\d+\b", str(venv), text))


class Installer(NamedTuple):
    """Set-up of one checkout, by the process that holds its `lock`."""

    layout: Layout
    want: dict[str, Any]
    lock: int

    def create(self) -> None:
        """Replace the environment by an empty one."""
        # Build products contain absolute paths of their environment.
        for made in (self.layout.venv, *(self.layout.workspace / name for name in ("build", "install", "log"))):
            shutil.rmtree(made, ignore_errors=True)
        options = [] if self.want["ROS 2"] == WHEELS else ["--system-site-packages"]
        self._run("creating a Python environment", [self.want["Python"], "-m", "venv", *options, str(self.layout.venv)])

    def install(self) -> None:
        """Install the locked packages, with uv if available, else with pip."""
        self.layout.state.unlink(missing_ok=True)
        python, lock = str(self.layout.python), str(self.layout.lock(self.want["ROS 2"]))
        pip = [python, "-m", "pip", "install", "--no-user", "--no-deps", "--no-compile", "--require-hashes", "-r"]
        uv = ["uv", "pip", "install", "--python", python, "--no-deps", "--require-hashes", "-r"]
        config = run([python, "-m", "pip", "config", "list"], capture_output=True, text=True).stdout
        fetch = [*pip, str(self.layout.root / "requirements" / "uv.lock"), "--only-binary=:all:"]
        has_uv = shutil.which("uv", path=self._variables()["PATH"]) or self._run("fetching uv", fetch, needed=False)
        if not (has_uv and self._run("installing packages", [*uv, lock], more=uv_variables(config), needed=False)):
            self._run("installing packages with pip", [*pip, lock])
        imports = "import numba, scipy.stats, rclpy, rosbags.highlevel, matplotlib.pyplot"
        self._run("checking packages", [python, "-c", imports])  # also creates the bytecode for all processes
        if self.want["ROS 2"] == WHEELS:
            query = "import sysconfig; print(sysconfig.get_path('include'), end='')"
            patch_wheels(self.layout.venv, check_output([self.want["Python"], "-Ic", query], text=True))

    def build(self) -> None:
        """Build the workspace and record the search paths set by its set-up script."""
        digest = environment.workspace_digest(self.layout, self.want["ROS 2"])
        environment.write(self.layout, self.want)  # until the build is complete, no workspace is recorded
        packages = [str(package) for package in environment.packages(self.layout, self.want["ROS 2"])]
        for share in self.layout.workspace.glob("install/*/share"):
            if share.parent.name not in map(os.path.basename, packages):  # no longer built
                shutil.rmtree(share.parent)
        for path in self.layout.workspace.glob("install/**/*"):
            if path.is_symlink() and not path.exists():  # its file has moved; colcon would not replace it
                path.unlink()
        cmake = ["--cmake-args", "-G", "Ninja", f"-DPython3_EXECUTABLE={self.layout.python}"]
        self._run("building the workspace", ["colcon", "build", "--symlink-install", "--base-paths", *packages, *cmake])
        env = {name: os.pathsep.join(entries) for name, entries in self._paths().items()}
        script = ["/bin/sh", "-c", ". install/local_setup.sh && /usr/bin/env -0"]
        output = check_output(script, env=env, cwd=self.layout.workspace, text=True)
        after = dict(variable.split("=", 1) for variable in output.split("\0") if variable)
        paths = {name: environment.entries(after, name) for name in after if name.endswith("PATH")}
        environment.write(self.layout, self.want, workspace=digest, paths=paths)

    def compile(self) -> None:
        """Compile the control loop, in lockstep so that no busy machine fails it; else the first command compiles."""
        nodes = ["run", "--params=practical", "--clock=lockstep", "--duration=0.1", "--out=../.venv/compiled"]
        self._run("compiling the control loop", ["../pidtsm", *nodes], needed=False)

    def _paths(self) -> dict[str, list[str]]:
        """Search path entries of the environment itself."""
        venv = self.layout.venv
        paths = {"PATH": [f"{venv}/bin"]}
        if self.want["ROS 2"] == WHEELS:
            paths["AMENT_PREFIX_PATH"] = paths["CMAKE_PREFIX_PATH"] = [str(venv)]
            paths["LD_LIBRARY_PATH"] = [f"{venv}/lib", *map(str, venv.glob("lib/python3*/site-packages/ros_*.libs"))]
        return paths

    def _variables(self) -> dict[str, str]:
        """Variables for uv, pip and colcon, without user settings that redirect their output."""
        env = environment.variables(self.layout, self.want["ROS 2"], self._paths())
        if self.want["ROS 2"] != WHEELS and (cmake := shutil.which("cmake")):
            env["CMAKE_COMMAND"] = cmake  # that of the ROS installation
        # Without an explicit number of jobs, colcon makes ninja wait for a load below the number of cores.
        own = {"COLCON_DEFAULTS_FILE": f"{self.layout.venv}/no-defaults", "MAKEFLAGS": f"-j{os.cpu_count()}"}
        return env | own | {"PYTHONDONTWRITEBYTECODE": ""}

    def _run(self, what: str, command: list[str], *, more: dict[str, str] | None = None, needed: bool = True) -> bool:
        """Run one step with `more` variables and its output in the log; print progress, return whether it succeeded."""
        report(f"{what} ...", end="")
        started = time.monotonic()
        env = (more or {}) | self._variables()
        with self.layout.log.open("a+", errors="replace") as log:
            print(f"\n$ {' '.join(command)}", file=log, flush=True)
            begin = log.tell()
            # The step inherits the lock: if this process is killed, the next one waits for the step to end.
            done = run(
                command, env=env, cwd=self.layout.workspace, stdin=DEVNULL, stdout=log, stderr=log, pass_fds=[self.lock]
            )
            log.seek(begin)
            output = log.read()
        print(" failed" if done.returncode else f" {time.monotonic() - started:.0f} s", file=sys.stderr)
        if done.returncode and needed:
            print("", *output.splitlines()[-30:], sep="\n    ", file=sys.stderr)
            raise SetupError(f"{what} failed: {find_cause(output)}; see {self.layout.log}. The next call tries again.")
        return done.returncode == 0


def set_up(layout: Layout, *, actions: bool) -> dict[str, Any]:
    """Do the missing steps under a lock and return the state; SetupError if anything fails or is missing.

    `actions`: also build the interfaces `environment.ON_DEMAND`.
    """
    lock = os.open(layout.root, os.O_RDONLY)  # locks the folder itself, without a file; released when this process ends
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        report("another pidtsm is setting this checkout up, waiting for it ...")
        fcntl.flock(lock, fcntl.LOCK_EX)
    want = environment.wanted(layout)
    installer = Installer(layout, want, lock)
    if work := environment.missing(layout, want, environment.read(layout)):
        first, reason = work
        _check_machine(want["ROS 2"], layout.root, create=first == "environment")
        report(f"{reason}: setting up the {first}.")
        for step in (installer.create, installer.install, installer.build)[STEPS.index(first) :]:
            step()
        if first == "environment":
            installer.compile()
    if actions and not layout.actions.exists():
        layout.actions.touch()
        try:
            installer.build()
        except SetupError:
            layout.actions.unlink()  # other commands do not need them
            raise
    return environment.read(layout)
