"""The launcher as a user meets it: real processes on small made-up machines, and the decisions behind them."""

from __future__ import annotations

import fcntl
import importlib.machinery
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from launcher import environment, install  # noqa: E402
from launcher.environment import WHEELS, Layout  # noqa: E402

REAL_PYTHON = os.path.realpath(getattr(sys, "_base_executable", sys.executable))
STUB_CLI = """
import os, sys
print('cli', sys.argv[1:], os.environ.get('MARK_PATH', '-'))
sys.exit(int(os.environ.get('CODE', 0)))
"""


class Checkout:
    """A copy of the launcher, and a machine with nothing but a Python to run it on."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "checkout"
        self.bin = folder / "bin"
        self.bin.mkdir()
        for tool in ("sh", "env", "readlink", "dirname", "cat"):
            self.link(tool)
        (self.bin / "python3").symlink_to(REAL_PYTHON)
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "scripts", self.root / "scripts", ignore=ignore)
        shutil.copytree(ROOT / "requirements", self.root / "requirements", ignore=ignore)
        shutil.copy(ROOT / "pidtsm", self.root)
        (self.root / "ros2_ws" / "src" / "demo").mkdir(parents=True)
        (self.root / "ros2_ws" / "src" / "demo" / "package.xml").write_text("<package/>")
        self.layout = Layout(self.root)
        self.env = {"PATH": str(self.bin), "HOME": str(folder)}

    def link(self, tool: str) -> None:
        found = shutil.which(tool)
        assert found, tool
        (self.bin / tool).symlink_to(found)

    def script(self, name: str, text: str, folder: Path | None = None) -> None:
        file = (folder or self.bin) / name
        file.unlink(missing_ok=True)
        file.write_text(f"#!/bin/sh\n{text}\n")
        file.chmod(0o755)

    def customize_python(self, code: str) -> None:
        """Run `code` at the start of every Python of this machine."""
        folder = self.bin.parent / "customized"
        folder.mkdir()
        (folder / "sitecustomize.py").write_text(code)
        self.env["PYTHONPATH"] = str(folder)

    def files(self) -> set[str]:
        return {str(path.relative_to(self.root)) for path in self.root.rglob("*")}

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [str(self.root / "pidtsm"), *arguments],
            env=self.env,
            cwd=self.bin,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def call(self, *arguments: str) -> tuple[int, str, str]:
        process = self.start(*arguments)
        out, err = process.communicate(timeout=120)
        return process.returncode, out, err

    def make_ready(self, *, record: bool = True) -> None:
        """What a finished set-up leaves: an environment, a command line in the workspace, and the state of both."""
        (self.layout.venv / "bin").mkdir(parents=True)
        calls = self.root.parent / "calls"
        self.script("python", f'echo "$@" >> "{calls}"\nexec "{REAL_PYTHON}" "$@"', self.layout.venv / "bin")
        package = self.root / "ros2_ws" / "install" / "pidtsm_experiments"
        package.mkdir(parents=True)
        (package / "__init__.py").touch()
        (package / "cli.py").write_text(STUB_CLI)
        if record:
            self.record()

    def record(self) -> None:
        paths = {
            "PYTHONPATH": [str(self.root / "ros2_ws" / "install")],
            "PATH": [str(self.layout.venv / "bin")],
            "MARK_PATH": ["marked"],
        }
        environment.write(
            self.layout,
            environment.wanted(self.layout) | {"Python": os.path.realpath(self.layout.python)},
            workspace=environment.workspace_digest(self.layout, WHEELS),
            paths=paths,
        )

    def missing(self, **changes: Any) -> tuple[str, str] | None:
        """The work that is missing from the recorded state to the wanted one, with `changes` to the latter."""
        want = environment.wanted(self.layout) | changes
        return environment.missing(self.layout, want, environment.read(self.layout))


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Checkout:
    for name in ("ROS_DISTRO", "PIDTSM_PYTHON"):
        monkeypatch.delenv(name, raising=False)
    return Checkout(tmp_path)


# --- what a machine lacks: one sentence, exit code 1, nothing created -----------------------------------------------


def _no_compiler(checkout: Checkout) -> None:
    pass


def _only_c(checkout: Checkout) -> None:
    checkout.script("cc", "exit 0")


def _named_compiler_missing(checkout: Checkout) -> None:
    checkout.script("c++", "exit 0")
    checkout.env["CXX"] = "no-such-compiler -O2"


def _broken_compiler(checkout: Checkout) -> None:
    for name in ("cc", "c++"):
        checkout.script(name, "echo 'fatal error: stdio.h: No such file or directory' >&2; exit 1")


def _no_headers(checkout: Checkout) -> None:
    checkout.script("c++", 'echo "fatal error: Python.h: No such file or directory, in $3" >&2; exit 1')
    checkout.customize_python("import sysconfig\nsysconfig.get_path = lambda *a, **k: '/nowhere/include'\n")


def _without_module(name: str) -> Callable[[Checkout], None]:
    code = f"""
import sys
from importlib.machinery import PathFinder
class Hiding(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name == {name!r} else PathFinder.find_spec(name, path, target)
sys.meta_path[:] = [Hiding if finder is PathFinder else finder for finder in sys.meta_path]
"""
    return lambda checkout: checkout.customize_python(code)


def _other_machine(checkout: Checkout) -> None:
    checkout.customize_python("import platform\nplatform.machine = lambda: 'riscv64'\n")


def _full_disk(checkout: Checkout) -> None:
    for name in ("cc", "c++"):
        checkout.script(name, "exit 0")
    checkout.customize_python(
        "import shutil, collections\n"
        "shutil.disk_usage = lambda path: collections.namedtuple('Usage', 'total used free')(3e9, 2e9, 1e9)\n"
    )


def _old_python(checkout: Checkout, name: str = "python3") -> None:
    old = "import sys; sys.version_info = (3, 8, 0); exec(sys.argv[1])"
    checkout.script(name, f'exec "{REAL_PYTHON}" -S -c "{old}" "$3"')


@pytest.mark.parametrize(
    ("lack", "words"),
    [
        (_no_compiler, ("c++", "cannot compile", "No such file", "build-essential")),
        (_only_c, ("c++", "cannot compile", "No such file", "build-essential")),
        (_named_compiler_missing, ("no-such-compiler -O2", "cannot compile", "build-essential")),
        (_broken_compiler, ("c++", "cannot compile", "stdio.h", "build-essential")),
        (_no_headers, ("Python.h", "-I/nowhere/include", "python3-dev")),
        (_without_module("venv"), ("venv", "module", "python3-venv")),
        (_without_module("ensurepip"), ("ensurepip module", "python3-venv")),
        (_other_machine, ("riscv64", "source a ROS 2 Jazzy")),
        (_full_disk, ("2 GB of disk", "1.0 GB left")),
        (_old_python, ("Python 3.10 to 3.14", "python3", "PIDTSM_PYTHON")),
    ],
)
def test_what_is_missing_is_named_and_nothing_is_created(
    checkout: Checkout, lack: Callable[[Checkout], None], words: tuple[str, ...]
) -> None:
    lack(checkout)
    before = checkout.files()
    code, out, err = checkout.call("demo")
    assert (code, out) == (1, "")
    assert err.startswith("pidtsm: ")
    assert len(err.splitlines()) == 1, err
    assert [word for word in words if word not in err] == [], err
    assert checkout.files() == before


@pytest.mark.parametrize("name", ["my robots", "Übung", "a'b", "(1)", "100%"])
def test_a_path_that_cannot_be_set_up_is_refused_at_once(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    checkout = Checkout(tmp_path / name)
    for tool in ("cc", "c++"):
        checkout.script(tool, "exit 0")
    before = checkout.files()
    code, out, err = checkout.call("demo")
    assert (code, out) == (1, "")
    assert "the build tools of ROS 2 cannot handle" in err
    assert "move this folder" in err
    assert len(err.splitlines()) == 1
    assert checkout.files() == before


def test_a_word_that_is_no_command_is_refused_before_the_set_up(checkout: Checkout) -> None:
    commands = checkout.root / "ros2_ws" / "src" / "pidtsm_experiments" / "pidtsm_experiments" / "commands"
    shutil.copytree(ROOT / commands.relative_to(checkout.root), commands)
    before = checkout.files()
    code, out, err = checkout.call("rolout")
    assert (code, out) == (2, "")
    assert err.startswith("pidtsm: there is no command rolout; did you mean rollout?")
    assert len(err.splitlines()) == 1
    assert checkout.files() == before
    for known in ("compare-engines", "release", "shell", "--help"):  # It went for the set-up.
        code, _, err = checkout.call(known)
        assert (code, "cannot compile" in err) == (1, True), err


def test_a_newer_python_is_found_behind_an_old_one(checkout: Checkout) -> None:
    _old_python(checkout)
    (checkout.bin / "python3.12").symlink_to(REAL_PYTHON)
    assert "cannot compile" in checkout.call("demo")[2]


def test_a_named_python_is_the_only_candidate(checkout: Checkout) -> None:
    _old_python(checkout, "python-of-mine")
    checkout.env["PIDTSM_PYTHON"] = "python-of-mine"
    code, _, err = checkout.call("demo")
    assert code == 1
    assert "python-of-mine is not one" in err


# --- a finished set-up ----------------------------------------------------------------------------------------------


def test_a_ready_checkout_starts_the_command_line_and_nothing_else(checkout: Checkout) -> None:
    checkout.make_ready()
    for tool in ("bash", "pip", "colcon", "cmake", "cc"):
        checkout.script(tool, f'echo {tool} >> "{checkout.root.parent}/calls"')
    recorded = checkout.layout.state.read_bytes()
    before = checkout.files()
    checkout.env["CODE"] = "5"
    assert checkout.call("run", "--law", "a b") == (5, "cli ['run', '--law', 'a b'] marked\n", "")
    assert (checkout.root.parent / "calls").read_text() == "-m pidtsm_experiments.cli run --law a b\n"
    assert checkout.layout.state.read_bytes() == recorded
    assert {name for name in checkout.files() - before if "__pycache__" not in name} == set()


def test_it_can_be_called_through_a_link(checkout: Checkout) -> None:
    checkout.make_ready()
    (checkout.bin / "elsewhere").symlink_to(checkout.root / "pidtsm")
    done = subprocess.run([str(checkout.bin / "elsewhere"), "x"], env=checkout.env, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "cli ['x'] marked\n")


def test_a_moved_checkout_is_not_run(checkout: Checkout) -> None:
    checkout.make_ready()
    assert checkout.missing() is None
    moved = checkout.root.with_name("moved")
    checkout.root.rename(moved)
    checkout.root = moved
    checkout.layout = Layout(moved)
    assert checkout.missing() == ("environment", "the place of the checkout has changed")
    code, out, err = checkout.call("demo")
    assert (code, out) == (1, "")
    assert "cannot compile" in err  # it went for the set-up, which this machine cannot do


def test_the_second_of_two_waits_and_then_uses_what_the_first_made(checkout: Checkout) -> None:
    checkout.make_ready(record=False)
    for tool in ("cc", "c++"):
        checkout.script(tool, "exit 0")
    folder = os.open(checkout.root, os.O_RDONLY)
    fcntl.flock(folder, fcntl.LOCK_SH)
    second = checkout.start("demo")
    assert second.stderr is not None
    assert "another pidtsm is setting this checkout up" in second.stderr.readline()
    assert second.poll() is None
    checkout.record()
    os.close(folder)
    out, err = second.communicate(timeout=60)
    assert (second.returncode, out, err) == (0, "cli ['demo'] marked\n", "")


# --- interrupted, failed --------------------------------------------------------------------------------------------


def test_ctrl_c_ends_with_one_line_and_the_next_call_repairs(checkout: Checkout) -> None:
    lock = "numpy==2.0.0 --hash=sha256:" + "0" * 64 + "\n"
    checkout.layout.lock(WHEELS).write_text(lock)
    for tool in ("cc", "c++"):
        checkout.script(tool, "exit 0")
    with socket.create_server(("127.0.0.1", 0)) as index:
        index.settimeout(60)
        port = index.getsockname()[1]
        checkout.env |= {
            "PIP_INDEX_URL": f"http://127.0.0.1:{port}/simple",
            "PIP_CONFIG_FILE": os.devnull,
            "PIP_RETRIES": "1",
            "PIP_DEFAULT_TIMEOUT": "600",
        }
        first = checkout.start("demo")
        connection, _ = index.accept()  # pip waits for an answer that never comes
        with connection:
            first.send_signal(signal.SIGINT)  # to the launcher alone: what it started, it ends
            out, err = first.communicate(timeout=60)
            connection.settimeout(20)
            while connection.recv(4096):
                pass  # ends only when pip is gone
    assert (first.returncode, out) == (130, "")
    assert err.splitlines()[-1] == "pidtsm: interrupted; the next call repairs it"
    assert "Traceback" not in err
    assert checkout.layout.venv.exists()
    assert environment.read(checkout.layout) == {}

    (checkout.layout.venv / "half").touch()
    code, out, err = checkout.call("demo")  # nobody listens at the index any more
    assert (code, out) == (1, "")
    assert "the set-up was not finished: setting up the environment" in err
    assert not (checkout.layout.venv / "half").exists()
    assert "no connection to the Python package index" in err.splitlines()[-1]
    assert "No matching distribution" in checkout.layout.log.read_text()


@pytest.mark.parametrize("content", ["", '{"environment": {"root"', "[]", '{"environment": null}'])
def test_a_state_that_cannot_be_read_means_a_new_environment(checkout: Checkout, content: str) -> None:
    checkout.make_ready()
    checkout.layout.state.write_text(content)
    work = checkout.missing()
    assert work is not None
    assert work[0] == "environment"


def test_nothing_there_is_a_first_call(checkout: Checkout) -> None:
    assert checkout.missing() == ("environment", "this is the first call")


def test_an_interrupted_build_is_done_again_without_a_new_environment(checkout: Checkout) -> None:
    checkout.make_ready()
    want = environment.wanted(checkout.layout)
    environment.write(checkout.layout, want)  # what stands there while the workspace builds
    assert checkout.missing() == ("workspace", "the workspace is new or has changed")


def test_an_interrupted_write_leaves_the_state_of_before(checkout: Checkout, monkeypatch: pytest.MonkeyPatch) -> None:
    checkout.make_ready()
    before = checkout.layout.state.read_bytes()

    def power_cut(_self: Path, _text: str) -> None:
        raise OSError("power cut")

    want = environment.wanted(checkout.layout)
    monkeypatch.setattr(Path, "write_text", power_cut)
    with pytest.raises(OSError, match="power cut"):
        environment.write(checkout.layout, want)
    assert checkout.layout.state.read_bytes() == before


@pytest.mark.parametrize(
    ("output", "cause"),
    [
        ("ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device", "No space left"),
        ("NewConnectionError('...')\nERROR: No matching distribution found for numpy", "no connection"),
        ("ERROR: No matching distribution found for nonsense==1", "No matching distribution found for nonsense==1"),
        ("ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM", "DO NOT MATCH THE HASHES"),
        ("Failed   <<< pidtsm_msgs [1.29s, exited with code 1]\nSummary: 1 package", "Failed   <<< pidtsm_msgs"),
    ],
)
def test_the_cause_of_a_failure_is_named(output: str, cause: str) -> None:
    assert cause in install.find_cause(output)


def test_a_failure_that_says_nothing_has_no_cause() -> None:
    assert install.find_cause("something new") == "no reason given"


# --- what makes a set-up stale --------------------------------------------------------------------------------------


def test_a_changed_lock_updates_the_environment(checkout: Checkout) -> None:
    checkout.make_ready()
    with checkout.layout.lock(WHEELS).open("a") as lock:
        lock.write("# changed\n")
    assert checkout.missing() == ("packages", "the lock file has changed")


@pytest.mark.parametrize(
    ("name", "value"),
    [("ROS 2", "/opt/ros/jazzy/lib/python3.12/site-packages/rclpy"), ("version of the set-up", 1_000_000)],
)
def test_another_kind_of_environment_is_made_anew(checkout: Checkout, name: str, value: object) -> None:
    checkout.make_ready()
    assert checkout.missing(**{name: value, "lock file": "another, too"}) == ("environment", f"the {name} has changed")


def test_an_environment_without_its_python_is_made_anew(checkout: Checkout) -> None:
    checkout.make_ready()
    checkout.layout.python.unlink()
    assert checkout.missing() == ("environment", "the Python has changed")


def test_another_python_matters_only_if_asked_for(checkout: Checkout, monkeypatch: pytest.MonkeyPatch) -> None:
    checkout.make_ready()
    monkeypatch.setattr(sys, "_base_executable", "/usr/bin/python3.99", raising=False)
    assert checkout.missing() is None
    monkeypatch.setenv("PIDTSM_PYTHON", "python3.99")
    assert checkout.missing() == ("environment", "the Python has changed")


@pytest.mark.parametrize(
    ("file", "rebuild"),
    [
        ("demo/package.xml", True),
        ("demo/setup.py", True),
        ("demo/msg/State.msg", True),
        ("demo/demo/new_module.py", True),
        ("demo/demo/__pycache__/module.pyc", False),
        ("demo/.pytest_cache/README.md", False),
        ("demo/demo/.module.py.swp", False),
    ],
)
def test_the_workspace_is_built_again_when_a_file_comes(checkout: Checkout, file: str, rebuild: bool) -> None:
    checkout.make_ready()
    path = checkout.layout.workspace / "src" / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("changed")
    assert (checkout.missing() is not None) == rebuild


def test_the_content_of_a_module_needs_no_build_and_that_of_a_message_does(checkout: Checkout) -> None:
    module, message = (checkout.layout.workspace / "src" / "demo" / name for name in ("law.py", "State.msg"))
    module.write_text("a = 1")
    message.write_text("float64 a")
    checkout.make_ready()
    module.write_text("a = 2")
    assert checkout.missing() is None
    message.write_text("float64 b")
    assert checkout.missing() == ("workspace", "the workspace is new or has changed")


@pytest.mark.parametrize(
    ("ros", "theirs", "built"),
    [
        (WHEELS, {}, True),
        (WHEELS, {"opt": "tf2_msgs"}, True),  # The wheels do not see another ROS.
        (WHEELS, {"checkout/.venv": "tf2_msgs"}, False),
        ("/opt/ros", {"opt": "tf2_msgs"}, False),
        ("/opt/ros", {"opt": "geometry_msgs"}, True),
        ("/opt/ros", {"checkout/ros2_ws/install/tf2_msgs": "tf2_msgs"}, True),  # Our own does not count.
    ],
)
def test_interfaces_are_built_where_ros_lacks_them(
    checkout: Checkout, monkeypatch: pytest.MonkeyPatch, ros: str, theirs: dict[str, str], built: bool
) -> None:
    interface = checkout.layout.workspace / "interfaces" / "tf2_msgs"
    interface.mkdir(parents=True)
    (interface / "package.xml").write_text("<package/>")
    prefixes = [checkout.root.parent / prefix for prefix in theirs]
    for prefix, package in zip(prefixes, theirs.values(), strict=True):
        (prefix / "share" / package).mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(map(str, prefixes)))
    folders = [package.name for package in environment.packages(checkout.layout, ros)]
    assert folders == ["demo", *(["tf2_msgs"] if built else [])]


def test_actions_are_built_at_the_first_command_that_needs_them(checkout: Checkout) -> None:
    checkout.make_ready()
    for tool in ("cc", "c++"):
        checkout.script(tool, "exit 0")
    interface = checkout.layout.workspace / "interfaces" / "control_msgs"
    interface.mkdir(parents=True)
    (interface / "package.xml").write_text("<package/>")
    assert checkout.call("demo") == (0, "cli ['demo'] marked\n", "")

    checkout.script("colcon", "exit 1", checkout.layout.venv / "bin")
    code, out, err = checkout.call("actions")
    assert (code, out) == (1, "")
    assert "building the workspace failed" in err
    assert not checkout.layout.actions.exists(), "other commands do not need them"

    (checkout.root / "ros2_ws" / "install" / "local_setup.sh").write_text("export PYTHONPATH=$PWD/install")
    moved, kept = (checkout.root / "ros2_ws" / "install" / "demo" / name for name in ("moved.yaml", "kept.yaml"))
    moved.parent.mkdir()
    moved.symlink_to(checkout.root / "nowhere")
    kept.symlink_to(checkout.root / "pidtsm")
    checkout.script("colcon", f'echo "$@" > {checkout.root}/built', checkout.layout.venv / "bin")
    code, out, err = checkout.call("actions")
    assert (code, out) == (0, ""), err
    assert "building the workspace ..." in err
    assert str(interface) in (checkout.root / "built").read_text()
    assert kept.is_symlink()
    assert not moved.is_symlink(), "colcon cannot replace a link whose file has moved"
    assert checkout.call("actions") == (0, "", ""), "nothing is missing"
    assert checkout.call("test") == (0, "cli ['test'] -\n", "")


# --- where ROS 2 comes from, what reaches the environment -----------------------------------------------------------


def _fake_rclpy(folder: Path, suffix: str) -> str:
    package = folder / "rclpy"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("raise RuntimeError('finding it must not import it')")
    (package / f"_rclpy_pybind11{suffix}").touch()
    return str(package)


@pytest.mark.parametrize(
    ("distribution", "suffix", "found"),
    [
        ("jazzy", importlib.machinery.EXTENSION_SUFFIXES[0], True),
        ("jazzy", ".cpython-27-other.so", False),  # for another Python than the one that runs
        ("humble", importlib.machinery.EXTENSION_SUFFIXES[0], False),
    ],
)
def test_a_sourced_jazzy_is_one_that_this_python_can_import(
    checkout: Checkout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, distribution: str, suffix: str, found: bool
) -> None:
    package = _fake_rclpy(tmp_path / "jazzy", suffix)
    for name in [name for name in sys.modules if name.split(".")[0] == "rclpy"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path / "jazzy")
    monkeypatch.setenv("ROS_DISTRO", distribution)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "jazzy"))
    assert environment.sourced_jazzy(checkout.layout) == (package if found else None)


def test_the_environment_of_the_wheels_is_never_taken_for_an_installation(
    checkout: Checkout, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = checkout.layout.venv / "lib"
    _fake_rclpy(site, importlib.machinery.EXTENSION_SUFFIXES[0])
    for name in [name for name in sys.modules if name.split(".")[0] == "rclpy"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(checkout.layout.venv))
    assert environment.sourced_jazzy(checkout.layout) is None


HUMBLE = {
    "ROS_DISTRO": "humble",
    "AMENT_PREFIX_PATH": "/opt/ros/humble",
    "LD_LIBRARY_PATH": "/opt/ros/humble/lib:/opt/cuda/lib",
    "PATH": "/opt/ros/humble/bin:/usr/bin",
    "PYTHONPATH": "/opt/ros/humble/lib/python3.10/site-packages",
    "HOME": "/",
}


def _call_from(monkeypatch: pytest.MonkeyPatch, caller: dict[str, str]) -> None:
    for name in os.environ:
        monkeypatch.delenv(name)
    for name, value in caller.items():
        monkeypatch.setenv(name, value)


def test_another_distribution_does_not_leak_into_the_wheels(
    checkout: Checkout, monkeypatch: pytest.MonkeyPatch
) -> None:
    _call_from(monkeypatch, HUMBLE)
    env = environment.variables(checkout.layout, WHEELS, {})
    assert "humble" not in json.dumps(env)
    assert env["PATH"] == "/usr/bin"
    assert env["LD_LIBRARY_PATH"] == "/opt/cuda/lib"
    assert env["PYTHONNOUSERSITE"] == "1"


def test_packages_of_the_user_are_found_behind_the_workspace(
    checkout: Checkout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    humble, mine = tmp_path / "humble", tmp_path / "ws" / "install" / "my_arm"
    (humble / "share" / "rcl").mkdir(parents=True)
    (mine / "share" / "my_arm").mkdir(parents=True)
    caller = {
        "AMENT_PREFIX_PATH": f"{mine}:{humble}:/removed",
        "LD_LIBRARY_PATH": f"{mine}/lib:{humble}/lib",
        "PYTHONPATH": f"{mine}/lib/python3.10/site-packages",
        "HOME": "/",
    }
    _call_from(monkeypatch, caller)
    env = environment.variables(checkout.layout, WHEELS, {"AMENT_PREFIX_PATH": ["/ws"]})
    assert env["AMENT_PREFIX_PATH"] == f"/ws:{mine}"
    assert "my_arm" not in env["LD_LIBRARY_PATH"], "its libraries are for another ROS 2"
    assert "PYTHONPATH" not in env


def test_a_sourced_installation_is_kept_behind_the_workspace(
    checkout: Checkout, monkeypatch: pytest.MonkeyPatch
) -> None:
    caller = {"PATH": "/opt/ros/jazzy/bin:/ws:/usr/bin", "PYTHONPATH": "/opt/ros/jazzy/lib", "HOME": str(checkout.root)}
    _call_from(monkeypatch, caller)
    env = environment.variables(checkout.layout, "/opt/ros/jazzy", {"PATH": ["/ws"]})
    assert env["PATH"] == "/ws:/opt/ros/jazzy/bin:/usr/bin"
    assert env["PYTHONPATH"] == "/opt/ros/jazzy/lib"


@pytest.mark.parametrize("home", [None, "", "/nonexistent"])
def test_without_a_home_logs_and_caches_still_have_a_place(
    checkout: Checkout, monkeypatch: pytest.MonkeyPatch, home: str | None
) -> None:
    _call_from(monkeypatch, {} if home is None else {"HOME": home})
    monkeypatch.setattr(tempfile, "tempdir", str(checkout.bin))
    places = [Path(environment.variables(checkout.layout, WHEELS, {})["HOME"]) for _ in range(2)]
    assert places[0] == places[1]  # or every call would compile anew
    assert places[0].stat().st_uid == os.getuid()
    assert os.access(places[0], os.W_OK)


def test_the_wheels_cmake_files_get_the_paths_of_this_machine(tmp_path: Path) -> None:
    file = tmp_path / "share" / "x" / "cmake" / "export.cmake"
    file.parent.mkdir(parents=True)
    file.write_text(
        '"/opt/python/cp312-cp312/include/python3.12;/opt/python/cp312-cp312/lib/x" /opt/python/cp312-cp312'
    )
    cached = tmp_path / "cached.cmake"
    cached.hardlink_to(file)  # as uv installs
    before = cached.read_text()
    install.patch_wheels(tmp_path, "/usr/include/python3.12")
    assert cached.read_text() == before
    assert file.read_text() == f'"/usr/include/python3.12;{tmp_path}/lib/x" {tmp_path}'


# --- the packages ---------------------------------------------------------------------------------------------------


def test_uv_takes_the_index_that_pip_is_configured_with() -> None:
    listed = [
        "global.cert='/etc/ca.crt'",
        "global.extra-index-url='https://a/simple\\nhttps://b/simple'",
        "global.index-url='https://global/simple'",
        "global.trusted-host='a b'",
        "install.no-index='true'",
        ":env:.find-links='/wheels https://c'",
        ":env:.index-url='https://user:pass=word@env/simple'",
        ":env:.timeout='5'",
    ]
    assert install.uv_variables("\n".join(listed)) == {
        "UV_DEFAULT_INDEX": "https://user:pass=word@env/simple",
        "UV_INDEX": "https://a/simple https://b/simple",
        "UV_INDEX_STRATEGY": "unsafe-best-match",
        "UV_FIND_LINKS": "/wheels,https://c",
        "UV_INSECURE_HOST": "a b",
        "UV_OFFLINE": "true",
        "SSL_CERT_FILE": "/etc/ca.crt",
    }


FETCH, WITH_UV, WITH_PIP = "fetching uv", "installing packages", "installing packages with pip"


@pytest.mark.parametrize(
    ("on_path", "failing", "steps"),
    [
        (False, [], [FETCH, WITH_UV]),
        (True, [], [WITH_UV]),
        (False, [FETCH], [FETCH, WITH_PIP]),
        (False, [WITH_UV], [FETCH, WITH_UV, WITH_PIP]),
        (True, [WITH_UV], [WITH_UV, WITH_PIP]),
    ],
)
def test_pip_does_what_uv_cannot(
    checkout: Checkout, monkeypatch: pytest.MonkeyPatch, on_path: bool, failing: list[str], steps: list[str]
) -> None:
    checkout.make_ready(record=False)
    checkout.script("python", "echo \"global.index-url='https://mine/simple'\"", checkout.layout.venv / "bin")
    if on_path:
        checkout.script("uv", "exit 0")
    done = []

    def run(_self: object, what: str, command: list[str], *, more: Any = None, needed: bool = True) -> bool:
        assert needed == (what not in (FETCH, WITH_UV))
        assert (more or {}).get("UV_DEFAULT_INDEX") == ("https://mine/simple" if what == WITH_UV else None)
        assert what == "checking packages" or "--require-hashes" in command
        done.append(what)
        return what not in failing

    monkeypatch.setenv("PATH", str(checkout.bin))
    monkeypatch.setattr(install.Installer, "_run", run)
    install.Installer(checkout.layout, environment.wanted(checkout.layout), lock=0).install()
    assert done == [*steps, "checking packages"]


@pytest.mark.parametrize(
    ("changed", "steps"),
    [("", ["create", "install", "build", "compile"]), ("lock file", ["install", "build"]), ("workspace", ["build"])],
)
def test_only_a_new_environment_compiles_the_loop(
    checkout: Checkout, monkeypatch: pytest.MonkeyPatch, changed: str, steps: list[str]
) -> None:
    if changed:
        checkout.make_ready()
        known = environment.read(checkout.layout)
        environment.write(checkout.layout, known | {changed: "before"})
    done: list[str] = []
    monkeypatch.setattr(install, "_check_machine", lambda *_arguments, **_choices: None)
    for step in ("create", "install", "build", "compile"):
        monkeypatch.setattr(install.Installer, step, lambda _self, step=step: done.append(step))
    install.set_up(checkout.layout, actions=False)
    assert done == steps


@pytest.mark.parametrize(("code", "result"), [(0, " 0 s"), (1, " failed")])
def test_a_loop_that_does_not_compile_stops_no_set_up(
    checkout: Checkout, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], code: int, result: str
) -> None:
    checkout.make_ready()
    monkeypatch.setenv("CODE", str(code))
    lock = os.open(checkout.root, os.O_RDONLY)
    try:
        install.Installer(checkout.layout, environment.wanted(checkout.layout), lock).compile()
    finally:
        os.close(lock)
    assert re.sub(r"\d+ s", "0 s", capfd.readouterr().err) == f"pidtsm: compiling the control loop ...{result}\n"
    assert "cli ['run', '--params=practical', " in checkout.layout.log.read_text()


# --- the shell ------------------------------------------------------------------------------------------------------


def test_the_shell_returns_the_code_of_its_command(checkout: Checkout) -> None:
    checkout.make_ready()
    checkout.env["SHELL"] = str(checkout.bin / "sh")
    command = 'echo "$MARK_PATH $VIRTUAL_ENV"; exit 7'
    assert checkout.call("shell", "-c", command) == (7, f"marked {checkout.layout.venv}\n", "")


def test_the_shell_refuses_what_it_does_not_know(checkout: Checkout) -> None:
    code, out, err = checkout.call("shell", "--verbose")
    assert (code, out) == (2, "")
    assert "usage: pidtsm shell" in err


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_the_interactive_bash_keeps_the_environment_behind_a_bashrc_that_covers_it(checkout: Checkout) -> None:
    checkout.make_ready()
    checkout.link("bash")
    (Path(checkout.env["HOME"]) / ".bashrc").write_text(
        "export PATH=/covered:$PATH MARK_PATH=covered ROS_DISTRO=humble; mine=kept\n"
    )
    checkout.env["SHELL"] = "bash"
    done = subprocess.run(
        [str(checkout.root / "pidtsm"), "shell"],
        env=checkout.env,
        input='echo "$MARK_PATH|${PATH%%:*}|$mine|${ROS_DISTRO:-none}"; exit 3\n',
        capture_output=True,
        text=True,
        start_new_session=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout) == (3, f"marked|{checkout.layout.venv}/bin|kept|none\n")


@pytest.mark.skipif(not Layout(ROOT).state.exists(), reason="this checkout was not set up by ./pidtsm")
def test_the_shell_of_this_checkout_imports_ros_and_the_messages() -> None:
    code = "import sys, rclpy, pidtsm_msgs.msg, tf2_msgs.msg; print(sys.prefix)"
    done = subprocess.run(
        [str(ROOT / "pidtsm"), "shell", "-c", f'python -c "{code}"'],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (0, f"{ROOT}/.venv\n"), done.stderr
