"""Errors that end a command with one line instead of a traceback."""


class RunError(RuntimeError):
    """The work failed: exit code 1."""
