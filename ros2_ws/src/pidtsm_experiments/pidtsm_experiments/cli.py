"""The command line, ``./pidtsm COMMAND``."""

import argparse
import importlib
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from pidtsm_core.errors import UsageError
from pidtsm_experiments.errors import RunError

_COMMANDS = {
    "demo": "the article's Case 1 with the proposed law over the real nodes: table, figures, bag",
    "run": "any scenario and law over the real nodes",
    "rollout": "the same loop without ROS",
    "reproduce": "both cases, all laws: the article and the project side by side",
    "robustness": "how much imperfection of sensors, drives and model each controller bears",
    "analyze": "metrics of any recorded bag",
    "bench": "benchmarks, each figure beside its floor measured in the same run",
    "test": "all tests and checks",
}
_SHELL = "a shell with the workspace sourced (-c COMMAND runs one command in it)"

_EPILOG = """examples:
  ./pidtsm demo
  ./pidtsm run --scenario case2 --law piddtsm --out results/case2
  ./pidtsm run --scenario case1 --clock realtime --duration 10
  ./pidtsm rollout --scenario case1 --set controller.estimator.name=exact --json
  ./pidtsm analyze results/demo/bag

exit codes: 0 done, 1 the work failed, or the controller of a run does not follow at the end, 2 bad usage or input
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def _parser(command: str | None) -> argparse.ArgumentParser:
    """The parser; only the module of the command that is called is imported."""
    parser = _Parser(
        prog="./pidtsm",
        description="A robust torque controller for robot arms, a simulated arm, and experiments with both.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)
    for name, text in _COMMANDS.items():
        sub = commands.add_parser(
            name, help=text, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if name == command:
            module = importlib.import_module(f"pidtsm_experiments.commands.{name}")
            module.add_arguments(sub)
            sub.set_defaults(execute=module.execute)
    # Handled by the launcher, before Python's environment is entered.
    commands.add_parser("shell", help=_SHELL)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code: 0 done, 1 it failed, 2 bad usage or input, 130 interrupted."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    signal.signal(signal.SIGTERM, _interrupt)
    command = next((word for word in words if not word.startswith("-")), None)
    try:
        if not words:
            _parser(None).print_help()
            return 2
        options = _parser(command).parse_args(words)
        return int(options.execute(options))
    except UsageError as error:
        print(f"pidtsm: {error}", file=sys.stderr)
        return 2
    except RunError as error:
        print(f"pidtsm: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("pidtsm: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 1


def _interrupt(_signal: int, _frame: object) -> NoReturn:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
