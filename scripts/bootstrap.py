"""`./pidtsm`: set up the checkout if anything is missing, then start the command line in its environment."""

import os
import sys
from difflib import get_close_matches
from pathlib import Path

sys.dont_write_bytecode = True  # a failed set-up must leave nothing behind

from launcher import environment  # noqa: E402

_WITH_ACTIONS = ("actions", "move", "test")
"""Commands that need the actions of ROS 2; `actions` does nothing else."""
_SCRIPTS = ("release", "bundle", "docs")
"""Commands that are scripts of the checkout."""
_OWN = ("actions", "shell")
_COMMANDS = Path("ros2_ws", "src", "pidtsm_experiments", "pidtsm_experiments", "commands")
"""Where each command of the command line has a file of its name."""


def main(arguments: list[str]) -> None:
    """Replace this process by the command in `arguments`, in a complete environment; SetupError if set-up fails."""
    layout = environment.Layout(Path(__file__).resolve().parent.parent)
    shell = os.environ.get("SHELL") or "bash"
    match arguments:
        case ["shell"]:
            command = environment.interactive(shell)
        case ["shell", "-c", line]:
            command = [shell, "-c", line]
        case ["shell", *others]:
            environment.report('usage: pidtsm shell [-c "COMMAND"]: a shell, or one COMMAND, in the environment')
            sys.exit(0 if others in (["-h"], ["--help"]) else 2)
        case [name, *others] if name in _SCRIPTS:
            command = [str(layout.python), str(layout.root / "scripts" / f"{name}.py"), *others]
        case ["actions"]:
            command = [str(layout.python), "-c", ""]
        case _:
            command = [str(layout.python), "-m", "pidtsm_experiments.cli", *arguments]
    have = environment.read(layout)
    actions = bool(arguments) and arguments[0] in _WITH_ACTIONS
    if environment.missing(layout, environment.wanted(layout), have) or (actions and not layout.actions.exists()):
        _check_command(layout, arguments)
        from launcher.install import set_up  # imported only here, to keep the usual call fast

        have = set_up(layout, actions=actions)
    os.execvpe(command[0], command, environment.variables(layout, have["ROS 2"], have["paths"]))  # noqa: S606


def _check_command(layout: environment.Layout, arguments: list[str]) -> None:
    """End, before the minutes of a set-up, if the first argument is no command."""
    files = [file.stem.replace("_", "-") for file in (layout.root / _COMMANDS).glob("*.py")]
    known = [*files, *_SCRIPTS, *_OWN]
    if files and arguments and not arguments[0].startswith("-") and arguments[0] not in known:
        likely = get_close_matches(arguments[0], known, n=1)
        meant = f"; did you mean {likely[0]}?" if likely else ""
        environment.report(f"there is no command {arguments[0]}{meant} (README.md lists the most important ones)")
        sys.exit(2)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except KeyboardInterrupt:
        print("\npidtsm: interrupted; the next call repairs it", file=sys.stderr)
        sys.exit(130)
    except (environment.SetupError, OSError) as error:
        environment.report(str(error))
        sys.exit(1)
