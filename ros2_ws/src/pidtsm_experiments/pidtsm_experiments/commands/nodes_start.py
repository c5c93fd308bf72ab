"""``./pidtsm nodes start``: controller and trajectory node of an arm, in the user's ROS domain."""

import argparse
import asyncio
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

from pidtsm_core.control import LAW_NAME
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import PRACTICAL
from pidtsm_experiments.commands.options import add_experiment_arguments, experiment_of, warn
from pidtsm_experiments.errors import RunError
from pidtsm_ros.stop import Stop

_LOGS = Path("results", "nodes")
_FOLLOWS, _AWAITED = "Following the reference", "waiting for joint_states"
_POLL = 0.2  # s
_EPILOG = f"""Without --plant the arm is yours: it publishes joint_states and applies the efforts of joint_commands, see
docs/own-robot.md. The arm stays where it is until a motion comes, as from ./pidtsm move, or --scenario or
--set trajectory.reference... defines one. Ctrl-C brings the arm to rest; then the controller publishes a last torque
that carries the arm, and all nodes end.

With the law {LAW_NAME.default}, the parameters are those of --params {PRACTICAL}, unless others are given.

examples:
  ./pidtsm nodes start --robot my_arm.urdf --effort 20
  ./pidtsm nodes start --robot my_arm.urdf --remap joint_states:=/arm/joint_states --remap joint_commands:=/arm/effort
  ./pidtsm nodes start --robot panda --plant --engine mujoco --namespace left
"""


def add_arguments_of(parser: argparse.ArgumentParser, _action: str) -> None:
    """Add the options of the action."""
    parser.epilog = _EPILOG
    parser.add_argument("--plant", action="store_true", help="also start the simulated arm")
    parser.add_argument("--namespace", default="", metavar="NAME", help="namespace of all nodes and topics")
    parser.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="another name of a topic; can be repeated"
    )
    parser.add_argument(
        "--detach",
        action="store_true",
        help="return when the arm follows, or its joint_states are awaited; ./pidtsm nodes stop ends the nodes, what "
        f"changes meanwhile is in {_LOGS}",
    )
    add_experiment_arguments(parser, duration=False)


def execute_action(options: argparse.Namespace) -> int:
    """Start the nodes, and watch them."""
    if not options.detach:
        return _start(options)
    ready = [_FOLLOWS] if options.plant else [_FOLLOWS, _AWAITED]
    return _detached(lambda: _start(options), ready)


def _detached(work: Callable[[], int], ready: Sequence[str]) -> int:
    """Do work in a process of its own, which outlives this one, until its log shows that it is ready.

    Returns:
        0, or the exit code of the work if it has ended before.
    """
    log = _LOGS / f"start-{time.strftime('%Y-%m-%d-%H-%M-%S')}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    sys.stdout.flush()
    child = os.fork()  # Nothing of ROS runs yet.
    if child == 0:
        _be_detached(work, log)
    shown = 0
    try:
        while True:
            ended, status = os.waitpid(child, os.WNOHANG)
            text = log.read_text(encoding="utf-8") if log.exists() else ""
            print(text[shown:], end="", flush=True)
            shown = len(text)
            if ended:
                return os.waitstatus_to_exitcode(status)
            if any(word in text for word in ready):
                print(f"./pidtsm nodes stop ends the nodes; their changes are in {log}")
                return 0
            time.sleep(_POLL)
    except KeyboardInterrupt:
        os.kill(child, signal.SIGINT)
        raise


def _be_detached(work: Callable[[], int], log: Path) -> NoReturn:
    """The life of the process that goes on."""
    os.setsid()
    with log.open("wb") as file, Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    code = 1
    try:
        code = work()
    except (UsageError, RunError) as error:
        code = 2 if isinstance(error, UsageError) else 1
        print(f"pidtsm: {error}", file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _start(options: argparse.Namespace) -> int:
    from pidtsm_experiments.live.nodes import OPERATION, Nodes
    from pidtsm_experiments.operate.attached import joined, place
    from pidtsm_experiments.operate.claim import claimed
    from pidtsm_experiments.operate.starting import (
        REAL_ARM,
        Watch,
        described,
        refuse_simulator,
        start_of,
        still_scenario,
        surroundings,
    )

    if not options.plant:
        refuse_simulator(options.set, options.engine)
    start = start_of(experiment_of(options, OPERATION if options.plant else REAL_ARM, still_scenario()))
    warn(start.parameters["controller"])
    words = [word for remap in remaps(options.remap) for word in ("-r", remap)]
    namespace = options.namespace.strip("/")
    stop = Stop()
    stop.defer()
    with ExitStack() as stack:
        stack.enter_context(claimed(namespace))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pidtsm-nodes-")))
        system = stack.enter_context(joined(namespace, words))
        nodes = Nodes(start.parameters, folder, surroundings, [*words, "-r", f"__ns:={system.namespace}"])
        stack.enter_context(nodes)
        kind = "a simulated arm" if options.plant else "your arm"
        _show(f"starting nodes for {kind} {place(namespace)}")
        for node, text in described(start).items():
            _show(f"{node}: {text}")
        asyncio.run(Watch(system, nodes, start, _show).run(stop))
        _show("ending the nodes")
    _show("ended")
    return 0


def _show(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)
    sys.stdout.flush()


def remaps(given: list[str]) -> list[str]:
    """The values of ``--remap``, which can be repeated.

    Raises:
        UsageError: one of them is malformed.
    """
    for each in given:
        old, separator, new = each.partition(":=")
        if not (old and separator and new):
            raise UsageError(f"--remap {each}: must be of the form FROM:=TO, such as joint_states:=/arm/joint_states")
    return given
