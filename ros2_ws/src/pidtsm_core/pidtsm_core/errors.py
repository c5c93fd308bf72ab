"""Errors that end a command with one line instead of a traceback."""


class UsageError(ValueError):
    """Invalid input from the user: exit code 2."""
