"""Messages to the person at the terminal, and the failures that end in one."""

from __future__ import annotations

import sys


class SetupError(Exception):
    """Set-up cannot go on; the text is one sentence for the user."""


def say(message: str, end: str = "\n") -> None:
    """Tell the user, on standard error: standard output belongs to the command."""
    print(f"pidtsm: {message}", end=end, file=sys.stderr, flush=True)
