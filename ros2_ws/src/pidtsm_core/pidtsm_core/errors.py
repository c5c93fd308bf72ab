"""Errors that end a command with one line instead of a traceback."""


class UsageError(ValueError):
    """Invalid input from the user: exit code 2."""


class MemberError(UsageError):
    """A law, surface or other member from outside cannot be used; the message names it and the reason."""


class MemberWarning(UserWarning):
    """An installed package offers members that cannot be used."""
