"""`./pidtsm`: set the checkout up if anything is missing, then start the command line in its environment."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any, NoReturn

sys.dont_write_bytecode = True  # a refused set-up leaves nothing behind

from launcher import state, variables  # noqa: E402
from launcher.console import SetupError, say  # noqa: E402

_SHELL_USAGE = 'usage: pidtsm shell [-c "COMMAND"]'


def command_for(arguments: list[str], python: str) -> list[str]:
    """The program to become; the shell is the one command that is handled here."""
    if arguments[:1] != ["shell"]:
        return [python, "-m", "pidtsm_experiments.cli", *arguments]
    shell = os.environ.get("SHELL") or "bash"
    match arguments[1:]:
        case []:
            return [shell, "-i"]
        case ["-c", command]:
            return [shell, "-c", command]
        case ["-h" | "--help"]:
            print(f"{_SHELL_USAGE}\n\nA shell with the environment and the workspace, or COMMAND run in it.")
            sys.exit(0)
        case _:
            say(f"{_SHELL_USAGE} (got: {' '.join(arguments[1:])})")
            sys.exit(2)


def ready_state(layout: state.Layout) -> dict[str, Any]:
    """The state of the checkout, after whatever set-up is still missing."""
    want = state.wanted(layout)
    recorded = state.read(layout)
    if state.missing(layout, want, recorded) is None:
        return recorded
    from launcher.install import set_up  # only here: the usual call does not pay for it

    return set_up(layout, want)


def main(arguments: list[str]) -> NoReturn:
    """Become the command that `arguments` ask for, in an environment that is ready for it."""
    layout = state.Layout(Path(__file__).resolve().parent.parent)
    command = command_for(arguments, str(layout.python))
    reached = ready_state(layout)
    env = variables.apply(os.environ, reached, layout)
    if Path(command[0]).name == "bash" and command[1] == "-i":
        command = [command[0], "--rcfile", variables.bash_start_file(env, reached), "-i"]
    try:
        os.execvpe(command[0], command, env)  # noqa: S606 (the user's own shell, or our Python)
    except OSError as error:
        raise SetupError(f"cannot start {command[0]}: {error.strerror}.") from error


def _stop(number: int, _frame: object) -> NoReturn:
    raise KeyboardInterrupt(number)


if __name__ == "__main__":
    for stopping in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(stopping) is not signal.SIG_IGN:  # nohup, background jobs
            signal.signal(stopping, _stop)
    try:
        main(sys.argv[1:])
    except KeyboardInterrupt as stop:
        say("interrupted; the next call repairs it")
        sys.exit(128 + (stop.args[0] if stop.args else signal.SIGINT))
    except (SetupError, OSError) as error:
        say(str(error))
        sys.exit(1)
