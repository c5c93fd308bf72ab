"""The command line: ``./pidtsm COMMAND`` in a checkout, ``pidtsm COMMAND`` where the wheel is installed."""

import argparse
import errno
import importlib
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import NoReturn

from pidtsm_core import __version__
from pidtsm_core.errors import UsageError
from pidtsm_experiments.errors import OF_THE_DISK, RunError

_INTERRUPTED = 130
_IN_CHECKOUT = "./pidtsm"
"""How texts call the command line."""
_OF_ROS = ("rclpy", "ament_index_python", "domain_coordinator", "_msgs", "_interfaces")
"""Ends of the names of packages that ROS 2 and the workspace alone have."""
_COMMANDS = {
    "demo": "run the article's Case 1 with the proposed law and the real nodes: table, figures, bag",
    "run": "run any scenario and law with the real nodes",
    "live": "run the real nodes in real time, and show and control them on a page in the browser",
    "rollout": "run the same loop without ROS",
    "replay": "make a result again from what it records, and say whether the bits agree",
    "report": "make metrics, figures and report of a result folder anew",
    "compare": "compare runs: one report with curves over each other, metrics with differences, parameters that differ",
    "compare-engines": "simulate an experiment on both engines of the simulated arm, and show how far they differ",
    "check": "show what is understood of an arm, and what in its description looks like a mistake",
    "gains": "compute a first set of gains for an arm, with the reason for each number",
    "check-gains": "check gains against the conditions of the theory, and a run with them against its bounds",
    "excite": "make a motion that shows inertias and friction of an arm",
    "identify": "correct the description of an arm from bags of its motions, with intervals",
    "identify-payload": "estimate mass, centre of mass and inertia of what an arm carries, from a bag",
    "commission": "from a description to verified gains in one guided session: signs, noise, delay, friction, gravity, "
    "inertias, gains, each with a verdict",
    "reproduce": "compare both cases and all laws with the article",
    "tune": "search for gains for an arm and its hardware, on rollouts",
    "tournament": "tune every law on every arm with the same budget, and score it",
    "limit": "compute the smallest RMSE that any controller of the two-link arm can reach (needs CasADi)",
    "score": "measure how much imperfection of sensors, drives and model a controller tolerates on an arm",
    "leaderboard": "put all scores into one page and one document",
    "new": "write the files of a law, or of another part, of your own",
    "nodes": "start controller and trajectory node in your ROS domain, and operate them: parameters, faults, recording",
    "move": "move the arm of a running system to a posture",
    "replay-motion": "let the arm of a running system repeat the motion in a bag",
    "analyze": "compute the metrics of a recorded bag",
    "diagnose": "say what is wrong with a loop, from a bag of it, with evidence and cure",
    "export": "write a run or a bag for other programs: CSV, Parquet, Foxglove and RViz, rerun",
    "bench": "run benchmarks, each compared with a lower bound or another implementation measured in the same run",
    "test": "run all tests and checks",
}
_ACTIONS = "build the actions of ROS 2, if it has none, so that the node trajectory serves follow_joint_trajectory"
_SHELL = "start a shell with the workspace sourced (-c COMMAND runs one command in it)"

_OF_THE_LAUNCHER = {
    "docs": "build the documents as a site, or show them in the browser",
    "release": "build the wheel and the source archives, and use them as a user would",
    "bundle": "write a folder that sets pidtsm up on a machine without network",
    "actions": _ACTIONS,
    "shell": _SHELL,
}
_EPILOG = """examples:
  ./pidtsm demo
  ./pidtsm run --scenario case2 --law piddtsm --out results/case2
  ./pidtsm run --scenario case1 --clock realtime --duration 10
  ./pidtsm rollout --scenario case1 --set controller.estimator.name=exact --json
  ./pidtsm rollout --law pid --out results/pid
  ./pidtsm compare results/demo results/pid
  ./pidtsm analyze results/demo/bag

exit codes: 0 success, 1 the work failed, or the controller does not follow at the end of the run, 2 bad usage or input
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def _parser(command: str | None) -> argparse.ArgumentParser:
    """Create the parser; only the module of the given command is imported."""
    parser = _Parser(
        prog=_called(_IN_CHECKOUT),
        description="A robust torque controller for robot arms, a simulated arm, and experiments with both.",
        epilog=_called(_EPILOG),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"pidtsm {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)
    for name, text in _COMMANDS.items():
        sub = commands.add_parser(
            name, help=text, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if name == command:
            module = importlib.import_module(f"pidtsm_experiments.commands.{name.replace('-', '_')}")
            module.add_arguments(sub)
            sub.set_defaults(execute=module.execute)
            sub.epilog = sub.epilog and _called(sub.epilog)
    # Handled by the launcher, before it enters the Python environment.
    for name, text in _OF_THE_LAUNCHER.items():
        commands.add_parser(name, help=text)
    return parser


def _called(text: str) -> str:
    """A text with the command line as it was called: the wheel has no launcher."""
    return text.replace(_IN_CHECKOUT, "pidtsm") if Path(sys.argv[0]).name == "pidtsm" else text


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code: 0 success, 1 failure, 2 bad usage or input, 130 interrupted."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    signal.signal(signal.SIGTERM, _interrupt)
    command = next((word for word in words if not word.startswith("-")), None)
    try:
        if not words:
            _parser(None).print_help()
            return 2
        return _execute(words, command)
    except (UsageError, RunError) as error:
        print(f"pidtsm: {_called(str(error))}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except KeyboardInterrupt:
        print("pidtsm: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except OSError as error:
        if error.errno != errno.EPIPE and error.errno not in OF_THE_DISK:
            raise
        if error.errno != errno.EPIPE:  # Who reads the output may leave when it likes.
            print(f"pidtsm: cannot write {error.filename or 'the output'}: {error.strerror}", file=sys.stderr)
        _forget_output()
        return 1


def _execute(words: Sequence[str], command: str | None) -> int:
    """Execute a command; returns the exit code.

    Raises:
        UsageError, RunError: see `main`.
    """
    try:
        known = [*_COMMANDS, *_OF_THE_LAUNCHER]
        if command and words[0] == command and command not in known:
            likely = get_close_matches(command, known, n=1)
            meant = f"; did you mean {likely[0]}?" if likely else ""
            raise UsageError(f"there is no command {command}{meant} ({_IN_CHECKOUT} --help lists all)")
        parser = _parser(command)
        if command in _OF_THE_LAUNCHER:
            parser.error(f"{command} needs the source checkout")
        options, others = parser.parse_known_args(words)
        if command == "test":
            options.arguments = [*others, *options.arguments]  # such as pytest's -k
        elif others:
            raise UsageError(f"unrecognized arguments: {' '.join(others)}; see {parser.prog} {command} --help")
        return int(options.execute(options))
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.partition(".")[0].endswith(_OF_ROS):
            raise
        print(f"pidtsm: {command} needs ROS 2 Jazzy: call ./pidtsm {command} in the source checkout", file=sys.stderr)
        return 1


def _forget_output() -> None:
    """Write what is left of the output nowhere: at the end of the process it would fail again."""
    with suppress(OSError), Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _interrupt(_signal: int, _frame: object) -> NoReturn:
    raise KeyboardInterrupt


def main_of_process() -> NoReturn:
    """Run the command of this process, and end it with the command's exit code."""
    code = main()
    if code == _INTERRUPTED:
        # A thread that is still compiling would abort an orderly end.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    main_of_process()
