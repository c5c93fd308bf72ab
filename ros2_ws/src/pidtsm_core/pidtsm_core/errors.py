"""Errors that end a command with one line instead of a traceback."""


class UsageError(ValueError):
    """What the user gave cannot be used: exit code 2."""
