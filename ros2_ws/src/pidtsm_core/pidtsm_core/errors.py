"""Errors that end a command with one line instead of a traceback."""

from pathlib import Path


class UsageError(ValueError):
    """Invalid input from the user: exit code 2."""


class MemberError(UsageError):
    """A law, surface or other member from outside cannot be used; the message names it and the reason."""


class MemberWarning(UserWarning):
    """An installed package offers members that cannot be used."""


def how_to_install(extra: str) -> str:
    """The command that installs an optional part: in a checkout from its lock file, elsewhere an extra of the wheel."""
    lock = f"requirements/{extra}.lock"
    if any((root / lock).is_file() for root in Path(__file__).resolve().parents[4:5]):
        return f"./pidtsm shell -c 'python -m pip install --no-deps --require-hashes -r {lock}'"
    return f"python -m pip install 'pidtsm[{extra}]'"
