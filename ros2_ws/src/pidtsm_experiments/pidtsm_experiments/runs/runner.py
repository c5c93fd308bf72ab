"""Runs an experiment with real nodes: starts, monitors and ends the processes."""

import ctypes
import json
import os
import secrets
import selectors
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import compress
from pathlib import Path
from types import TracebackType
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import Experiment
from pidtsm_core.parameters import Value, as_float, names
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.robots import find_robot, robot_parameters
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs.domain import own_domain
from pidtsm_ros.middleware import on_this_machine
from pidtsm_ros.security import ENCLAVES, SecurityError, require_security, security_requested

EXECUTABLES = {
    "simulator": ("two_link_sim", "simulator"),
    "controller": ("pidtsm_controller", "controller"),
    "trajectory": ("pidtsm_controller", "trajectory"),
    "composed": ("pidtsm_ros", "composed"),
    "recorder": ("pidtsm_experiments", "recorder"),
    "visualization": ("two_link_sim", "visualization"),
}
"""Package and executable of each process; ``composed`` is simulator, trajectory and controller in one."""

_ENDS = ("simulator", "composed")  # end by themselves after the last sample
_FIRST_SAMPLE_WITHIN = 180.0  # s; the very first run compiles
_NEXT_SAMPLE_WITHIN = 20.0  # s
_END_WITHIN = 10.0  # s from SIGINT to the end of a process
_TAIL_LINES = 15
_PROFILES = {"recorder": "fastdds_recorder.xml"}  # Fast DDS profiles other than the default
_SUBSCRIBERS = {"simulator": 3, "controller": 2, "trajectory": 2}
"""Number of subscribers each node waits for at the start, including the recorder."""
_PR_SET_PDEATHSIG = 1
_ENDING = (signal.SIGINT, signal.SIGTERM)

Progress = Callable[[float], None]
"""Called with the simulated time recorded so far, s."""
Announce = Callable[[str], None]
"""Called with a line with the ROS domain and the namespace of a run."""


def _end_with_parent(runner: int) -> None:
    """Make the kernel end this process when the runner ends, for whatever reason."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != runner:  # The runner was killed before this request.
        os._exit(1)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer SIGINT and SIGTERM to the end of the block."""
    received: list[int] = []
    previous = {number: signal.signal(number, lambda n, _: received.append(n)) for number in _ENDING}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])


class Process:
    """Process of one node, with its output in a log file."""

    def __init__(self, name: str, arguments: Sequence[str], environment: dict[str, str], log: Path) -> None:
        """Start the process; raises RunError if its package is not installed."""
        package, executable = EXECUTABLES[name]
        try:
            path = Path(get_package_prefix(package), "lib", package, executable)
        except PackageNotFoundError:
            raise RunError(f"package {package} is not installed; source the workspace") from None
        self.name = name
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [str(path), "--ros-args", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if name == "recorder" else output,
                stderr=output,
                env=environment,
                start_new_session=True,
                preexec_fn=partial(_end_with_parent, os.getpid()),
            )

    def interrupt(self) -> None:
        """Send SIGINT to the process if it is still running."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)

    def wait(self) -> int:
        """Wait for the exit code; send SIGKILL if the process does not end in time."""
        try:
            return self.process.wait(_END_WITHIN)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def tail(self) -> str:
        """The last lines of its output."""
        lines = self.log.read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-_TAIL_LINES:]) or "    (no output)"


class Processes:
    """All processes of a run; they are ended at the end of the block."""

    def __init__(self) -> None:
        self.running: dict[str, Process] = {}

    def __enter__(self) -> "Processes":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # An impatient second Ctrl-C must not leave processes behind.
        with uninterrupted():
            self.end(*self.running)

    def start(self, name: str, arguments: Sequence[str], environment: dict[str, str], log: Path) -> Process:
        """Start a node; see `Process`."""
        # A Ctrl-C between the start of a process and its entry here would lose it.
        with uninterrupted():
            self.running[name] = Process(name, arguments, environment, log)
        return self.running[name]

    def end(self, *names: str) -> None:
        """Interrupt these processes and wait for them; their exit codes are ignored."""
        for name in names:
            self.running[name].interrupt()
        for name in names:
            self.running.pop(name).wait()

    def check(self) -> None:
        """Raise RunError if a process has ended unexpectedly."""
        for name, process in self.running.items():
            code = process.process.poll()
            if code is None or (name in _ENDS and code == 0):
                continue
            raise RunError(f"{name} {how_ended(code)}; its last lines:\n{process.tail()}")


def how_ended(code: int) -> str:
    """An exit code as the end of a sentence."""
    return f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"


def run(
    experiment: Experiment,
    clock: str,
    out: Path,
    progress: Progress,
    composed: bool = False,
    announce: Announce = lambda _place: None,
) -> Path:
    """Run an experiment and record it, in a separate ROS domain and namespace.

    If other nodes join the domain later, the namespace keeps the commands of both systems apart.

    Args:
        experiment: definition of the run.
        clock: ``lockstep`` or ``realtime``.
        out: an existing folder, in which ``bag/``, ``params/`` and ``log/`` are created.
        progress: called during the run.
        composed: run simulator, trajectory and controller in one process.
        announce: called once, before the nodes start; ``log/place.txt`` contains the same line.

    Returns:
        Path of the bag.

    Raises:
        UsageError: a parameter is invalid, or security is requested but not available.
        RunError: a process died or stopped responding, or the bag is incomplete; the message contains the process and
            its last lines.
    """
    parameters = recorded_parameters(experiment, clock)
    bag = out / "bag"
    for folder in ("params", "log"):
        (out / folder).mkdir()
    with ExitStack() as stack:
        domain, namespace = stack.enter_context(own_domain()), f"run_{secrets.token_hex(4)}"
        place = f"ROS_DOMAIN_ID={domain}, namespace /{namespace}"
        (out / "log" / "place.txt").write_text(place + "\n", encoding="utf-8")
        announce(place)
        processes = stack.enter_context(Processes())
        metadata = out / "log" / "metadata.yaml"  # The text of a robot may be too long for the command line.
        known = {"metadata": bag_metadata(experiment, clock, namespace)}
        metadata.write_text(ros_parameters("recorder", known), encoding="utf-8")
        arguments = {"recorder": ["--params-file", str(metadata), "-p", f"output:={bag}", "-p", "plain_names:=true"]}
        for node, values in parameters.items():
            file = out / "params" / f"{node}.yaml"
            file.write_text(ros_parameters(node, values), encoding="utf-8")
            arguments.setdefault("composed" if composed else node, []).extend(["--params-file", str(file)])
        check_security(arguments)
        for name, words in arguments.items():
            log = out / "log" / f"{name}.log"
            surroundings = environment(name, domain, log.parent)
            processes.start(name, [*words, "-r", f"__ns:=/{namespace}"], surroundings, log)
        rate = as_float(parameters["simulator"]["rate"])
        _watch(processes, lambda samples: progress(samples / rate))
        processes.end(*(name for name in arguments if name != "recorder"))
        recorder = processes.running["recorder"]
        processes.end("recorder")
        if recorder.process.returncode:
            raise RunError(f"the bag is incomplete; the recorder's last lines:\n{recorder.tail()}")
    return bag


def environment(process: str, domain: int, logs: Path) -> dict[str, str]:
    """Environment variables of a process of a run, in its ROS domain; `logs`: folder of the run."""
    return {
        **on_this_machine(os.environ, _PROFILES.get(process, "fastdds.xml")),
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOG_DIR": str(logs / "ros"),
        "PYTHONUNBUFFERED": "1",
    }


def check_security(names: Iterable[str]) -> None:
    """Raise UsageError if security is requested but not available for one of these executables."""
    try:
        if security_requested():
            for name in names:
                require_security(f"{ENCLAVES}/{name}")
    except SecurityError as error:
        raise UsageError(str(error)) from None


def bag_metadata(experiment: Experiment, clock: str, namespace: str = "") -> str:
    """Description of the run as a JSON object, which the recorder stores in the bag for the analysis.

    Args:
        experiment: definition of the run.
        clock: ``lockstep`` or ``realtime``.
        namespace: namespace of the nodes, without slashes at its ends, if the recorder omits it from topic names.

    Raises:
        UsageError: see `node_parameters`.
    """
    parameters = node_parameters(experiment, clock)
    known = {
        "scenario": experiment.scenario,
        "law": experiment.law,
        "clock": clock,
        "event_time": experiment.event_time,
        **({"namespace": namespace} if namespace else {}),
        "trajectory": parameters["trajectory"],
        **robot_metadata(parameters["simulator"]),
    }
    return json.dumps(known)


def robot_metadata(values: Mapping[str, Value]) -> dict[str, Any]:
    """The part of a bag's metadata about its robot, from the parameters of a node that has one.

    Raises:
        ParameterError: see `find_robot`.
    """
    given = robot_parameters(values)
    joints, robot = names(given["joints"]), find_robot(given)
    return {
        "robot": given,
        "sliding": list(compress(joints, robot.slides)),
        "continuous": list(compress(joints, robot.continuous)),
    }


def node_parameters(
    experiment: Experiment,
    clock: str,
    subscribers: Mapping[str, int] = _SUBSCRIBERS,
    duration: float | None = None,
) -> dict[str, dict[str, Value]]:
    """Every parameter of every node, by node, for a run with this clock.

    Args:
        experiment: definition of the run.
        clock: ``lockstep`` or ``realtime``.
        subscribers: number of subscribers that each node waits for, by node.
        duration: s, 0 for a run without an end; None: that of the experiment.

    Raises:
        UsageError: a parameter works in a rollout only.
    """
    of_the_run: dict[str, dict[str, Value]] = {
        "simulator": {"clock": clock, "duration": experiment.duration if duration is None else duration},
        "controller": {"reference.match": "stamp" if clock == "lockstep" else "latest"},
        "trajectory": {"clock": clock},
    }
    return experiment.node_values(
        {node: {**given, "start.subscribers": subscribers[node]} for node, given in of_the_run.items()}
    )


_RECORDED: dict[str, dict[str, Value]] = {
    "controller": {"output.type": "joint_state", "state.decimation": 1},
    "simulator": {"input.type": "joint_state"},
}
"""Parameter values that the recorder and the metrics of a run require."""


def recorded_parameters(experiment: Experiment, clock: str) -> dict[str, dict[str, Value]]:
    """`node_parameters` of a recorded run.

    Raises:
        UsageError: a parameter is invalid, or would make the recording incomplete.
    """
    parameters = node_parameters(experiment, clock)
    for node, needed in _RECORDED.items():
        for name, value in needed.items():
            if parameters[node][name] != value:
                raise UsageError(f"{node}.{name}: a recorded run requires {value}, not {parameters[node][name]}")
    return parameters


def _watch(processes: Processes, progress: Callable[[int], None]) -> None:
    """Return when the simulator has finished; raise RunError if another process ends or nothing more is recorded."""
    recorder = processes.running["recorder"].process
    simulator = next(processes.running[name].process for name in _ENDS if name in processes.running)
    assert recorder.stdout is not None
    samples, since, text = 0, time.monotonic(), b""
    with selectors.DefaultSelector() as selector:
        selector.register(recorder.stdout, selectors.EVENT_READ)
        while True:
            if selector.select(timeout=0.1):
                text = (text + os.read(recorder.stdout.fileno(), 65536))[-1000:]
                *_, last = text.decode().rpartition("\n")[0].rsplit("\n", 1)
                recorded = int(last.split()[1]) if last.startswith("recorded ") else samples
                if recorded > samples:
                    samples, since = recorded, time.monotonic()
                    progress(samples)
            processes.check()
            if simulator.poll() == 0:
                return
            if time.monotonic() - since > (_NEXT_SAMPLE_WITHIN if samples else _FIRST_SAMPLE_WITHIN):
                raise RunError(f"nothing was recorded for {time.monotonic() - since:.0f} s; {_last_words(processes)}")


def _last_words(processes: Processes) -> str:
    return "last lines of the processes:\n" + "\n".join(f"  {p.name}:\n{p.tail()}" for p in processes.running.values())
