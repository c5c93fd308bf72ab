"""The launcher as a user meets it: real processes on small made-up machines, and the decisions behind them."""

from __future__ import annotations

import fcntl
import importlib.machinery
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from launcher import install, state, variables  # noqa: E402

REAL_PYTHON = state.base_python()
STUB_CLI = """
import os, sys
print('cli', sys.argv[1:], os.environ.get('MARK', '-'))
sys.exit(int(os.environ.get('CODE', 0)))
"""


class Checkout:
    """A copy of the launcher, and a machine with nothing but a Python to run it on."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "checkout"
        self.bin = folder / "bin"
        self.bin.mkdir()
        for tool in ("sh", "readlink", "dirname", "cat"):
            self.link(tool)
        (self.bin / "python3").symlink_to(REAL_PYTHON)
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "scripts", self.root / "scripts", ignore=ignore)
        shutil.copytree(ROOT / "requirements", self.root / "requirements", ignore=ignore)
        shutil.copy(ROOT / "pidtsm", self.root)
        (self.root / "ros2_ws" / "src" / "demo").mkdir(parents=True)
        (self.root / "ros2_ws" / "src" / "demo" / "package.xml").write_text("<package/>")
        self.layout = state.Layout(self.root)
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

    def wanted(self) -> state.Wanted:
        lock = self.layout.lock(state.WHEELS)
        return state.Wanted(str(self.root), state.WHEELS, str(self.layout.python), state.lock_digest(lock))

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
        prepend = {"PYTHONPATH": [str(self.root / "ros2_ws" / "install")], "PATH": [str(self.layout.venv / "bin")]}
        state.write(
            self.layout,
            self.wanted(),
            workspace=state.workspace_digest(self.layout.workspace / "src"),
            variables={"prepend": prepend, "set": {"MARK": "marked"}},
        )

    def missing(self, want: state.Wanted | None = None) -> state.Work | None:
        return state.missing(self.layout, want or self.wanted(), state.read(self.layout))


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    return Checkout(tmp_path)


# --- what a machine lacks: one sentence, exit code 1, nothing created -----------------------------------------------


def _no_compiler(checkout: Checkout) -> None:
    pass


def _only_c(checkout: Checkout) -> None:
    checkout.script("cc", "exit 0")


def _broken_compiler(checkout: Checkout) -> None:
    for name in ("cc", "c++"):
        checkout.script(name, "echo 'fatal error: stdio.h: No such file or directory' >&2; exit 1")


def _no_headers(checkout: Checkout) -> None:
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
        (_no_compiler, ("no C compiler", "build-essential")),
        (_only_c, ("no C++ compiler", "build-essential")),
        (_broken_compiler, ("C compiler", "trivial program", "stdio.h", "build-essential")),
        (_no_headers, ("headers", "/nowhere/include/Python.h", "python3-dev")),
        (_without_module("venv"), ("venv module", "python3-venv")),
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


def test_a_newer_python_is_found_behind_an_old_one(checkout: Checkout) -> None:
    _old_python(checkout)
    (checkout.bin / "python3.12").symlink_to(REAL_PYTHON)
    assert "no C compiler" in checkout.call("demo")[2]


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
    checkout.layout = state.Layout(moved)
    work = checkout.missing()
    assert work is not None
    assert (work.create, work.reason) == (True, "the checkout was moved")
    code, out, err = checkout.call("demo")
    assert (code, out) == (1, "")
    assert "no C compiler" in err  # it went for the set-up, which this machine cannot do


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
    checkout.layout.lock(state.WHEELS).write_text(lock)
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
    assert state.read(checkout.layout) == {}

    (checkout.layout.venv / "half").touch()
    code, out, err = checkout.call("demo")  # nobody listens at the index any more
    assert (code, out) == (1, "")
    assert "the set-up was not finished: making the environment anew" in err
    assert not (checkout.layout.venv / "half").exists()
    assert "no connection to the Python package index" in err.splitlines()[-1]
    assert "No matching distribution" in checkout.layout.log.read_text()


@pytest.mark.parametrize("content", ["", '{"environment": {"root"', "[]", '{"environment": null}'])
def test_a_state_that_cannot_be_read_means_a_new_environment(checkout: Checkout, content: str) -> None:
    checkout.make_ready()
    checkout.layout.state.write_text(content)
    assert checkout.missing() == state.Work(create=True, build=True, reason="the set-up was not finished")


def test_nothing_there_is_a_first_call_without_a_reason(checkout: Checkout) -> None:
    assert checkout.missing() == state.Work(create=True, build=True, reason="")


def test_an_interrupted_build_is_done_again_without_a_new_environment(checkout: Checkout) -> None:
    checkout.make_ready()
    state.write(checkout.layout, checkout.wanted())  # what stands there while the workspace builds
    assert checkout.missing() == state.Work(build=True, reason="")


def test_an_interrupted_write_leaves_the_state_of_before(checkout: Checkout, monkeypatch: pytest.MonkeyPatch) -> None:
    checkout.make_ready()
    before = checkout.layout.state.read_bytes()

    def power_cut(_file: int) -> None:
        raise OSError("power cut")

    monkeypatch.setattr(os, "fsync", power_cut)
    with pytest.raises(OSError, match="power cut"):
        state.write(checkout.layout, checkout.wanted())
    assert checkout.layout.state.read_bytes() == before


@pytest.mark.parametrize(
    ("output", "cause"),
    [
        ("OSError: [Errno 28] No space left on device", "disk is full"),
        ("NewConnectionError('...')\nERROR: No matching distribution found for numpy", "no connection"),
        ("ERROR: No matching distribution found for nonsense==1", "no nonsense==1 for this Python"),
        ("ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM", "not the one that was locked"),
        ("Failed   <<< pidtsm_msgs [1.29s, exited with code 1]", "package pidtsm_msgs does not build"),
    ],
)
def test_the_cause_of_a_failure_is_named(output: str, cause: str) -> None:
    assert cause in install.find_cause(output)


def test_an_unknown_failure_has_no_cause() -> None:
    assert install.find_cause("Traceback: something new") == ""


# --- what makes a set-up stale --------------------------------------------------------------------------------------


def test_a_changed_lock_updates_the_environment(checkout: Checkout) -> None:
    checkout.make_ready()
    with checkout.layout.lock(state.WHEELS).open("a") as lock:
        lock.write("# changed\n")
    assert checkout.missing() == state.Work(update=True, build=True, reason="wheels.lock has changed")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"ros": "/opt/ros/jazzy/lib/python3.12/site-packages/rclpy"}, "sourced installation"),
        ({"version": state.SETUP_VERSION + 1}, "set-up itself"),
    ],
)
def test_another_kind_of_environment_is_made_anew(checkout: Checkout, change: dict[str, Any], reason: str) -> None:
    checkout.make_ready()
    work = checkout.missing(checkout.wanted()._replace(**change))
    assert work is not None
    assert work.create
    assert reason in work.reason


def test_an_environment_without_its_python_is_made_anew(checkout: Checkout) -> None:
    checkout.make_ready()
    checkout.layout.python.unlink()
    work = checkout.missing()
    assert work is not None
    assert work.create


def test_another_python_matters_only_if_asked_for(checkout: Checkout, monkeypatch: pytest.MonkeyPatch) -> None:
    checkout.make_ready()
    other = checkout.wanted()._replace(python="/usr/bin/python3.99")
    monkeypatch.delenv("PIDTSM_PYTHON", raising=False)
    assert checkout.missing(other) is None
    monkeypatch.setenv("PIDTSM_PYTHON", "python3.99")
    work = checkout.missing(other)
    assert work is not None
    assert work.create


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
    assert checkout.missing() == state.Work(build=True, reason="the workspace has changed")


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
    assert state.sourced_jazzy(checkout.layout) == (package if found else None)


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
    assert state.sourced_jazzy(checkout.layout) is None


HUMBLE = {
    "ROS_DISTRO": "humble",
    "AMENT_PREFIX_PATH": "/opt/ros/humble",
    "LD_LIBRARY_PATH": "/opt/ros/humble/lib:/opt/cuda/lib",
    "PATH": "/opt/ros/humble/bin:/usr/bin",
    "PYTHONPATH": "/opt/ros/humble/lib/python3.10/site-packages",
    "HOME": "/",
}


def test_another_distribution_does_not_leak_into_the_wheels() -> None:
    env = variables.clean(HUMBLE, state.WHEELS)
    assert "humble" not in json.dumps(env)
    assert env["PATH"] == "/usr/bin"
    assert env["LD_LIBRARY_PATH"] == "/opt/cuda/lib"
    assert env["PYTHONNOUSERSITE"] == "1"


def test_a_sourced_installation_is_kept_behind_the_workspace(checkout: Checkout) -> None:
    reached = {"environment": {"ros": "/opt/ros/jazzy"}, "variables": {"prepend": {"PATH": ["/ws"]}, "set": {}}}
    caller = {"PATH": "/opt/ros/jazzy/bin:/ws:/usr/bin", "PYTHONPATH": "/opt/ros/jazzy/lib", "HOME": str(checkout.root)}
    env = variables.apply(caller, reached, checkout.layout)
    assert env["PATH"] == "/ws:/opt/ros/jazzy/bin:/usr/bin"
    assert env["PYTHONPATH"] == "/opt/ros/jazzy/lib"


@pytest.mark.parametrize("home", [None, "", "/nonexistent"])
def test_without_a_home_logs_and_caches_still_have_a_place(checkout: Checkout, home: str | None) -> None:
    checkout.layout.venv.mkdir()
    env = variables.with_home({} if home is None else {"HOME": home}, checkout.layout)
    for name in ("ROS_LOG_DIR", "COLCON_HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR"):
        assert env[name].startswith(str(checkout.layout.venv)), name
    assert env["HOME"]
    assert variables.with_home({"HOME": home or "", "ROS_LOG_DIR": "/mine"}, checkout.layout)["ROS_LOG_DIR"] == "/mine"


def test_the_wheels_cmake_files_get_the_paths_of_this_machine(tmp_path: Path) -> None:
    file = tmp_path / "share" / "x" / "cmake" / "export.cmake"
    file.parent.mkdir(parents=True)
    file.write_text(
        '"/opt/python/cp312-cp312/include/python3.12;/opt/python/cp312-cp312/lib/x" /opt/python/cp312-cp312'
    )
    install.patch_wheels(tmp_path, "/usr/include/python3.12")
    assert file.read_text() == f'"/usr/include/python3.12;{tmp_path}/lib/x" {tmp_path}'


# --- the shell ------------------------------------------------------------------------------------------------------


def test_the_shell_returns_the_code_of_its_command(checkout: Checkout) -> None:
    checkout.make_ready()
    checkout.env["SHELL"] = str(checkout.bin / "sh")
    assert checkout.call("shell", "-c", 'echo "$MARK $PIDTSM_ROOT"; exit 7') == (7, f"marked {checkout.root}\n", "")


def test_the_shell_refuses_what_it_does_not_know(checkout: Checkout) -> None:
    code, out, err = checkout.call("shell", "--verbose")
    assert (code, out) == (2, "")
    assert "usage: pidtsm shell" in err


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_the_interactive_bash_keeps_the_environment_behind_a_bashrc_that_covers_it(checkout: Checkout) -> None:
    checkout.make_ready()
    checkout.link("bash")
    (Path(checkout.env["HOME"]) / ".bashrc").write_text(
        "export PATH=/covered:$PATH MARK=covered ROS_DISTRO=humble; mine=kept\n"
    )
    checkout.env["SHELL"] = "bash"
    done = subprocess.run(
        [str(checkout.root / "pidtsm"), "shell"],
        env=checkout.env,
        input='echo "$MARK|${PATH%%:*}|$mine|${ROS_DISTRO:-none}"; exit 3\n',
        capture_output=True,
        text=True,
        start_new_session=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout) == (3, f"marked|{checkout.layout.venv}/bin|kept|none\n")


@pytest.mark.skipif(not state.Layout(ROOT).state.exists(), reason="this checkout was not set up by ./pidtsm")
def test_the_shell_of_this_checkout_imports_ros_and_the_messages() -> None:
    code = "import sys, rclpy, pidtsm_msgs.msg; print(sys.prefix)"
    done = subprocess.run(
        [str(ROOT / "pidtsm"), "shell", "-c", f'python -c "{code}"'],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (0, f"{ROOT}/.venv\n"), done.stderr
