"""What happens while Numba compiles: options of our own, and progress for whoever waits.

The first compilation in a process takes seconds after an installation, and nothing once Numba has stored it.
"""

import gc
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import CodeType
from typing import Any

import numba
from numba.core import event

_PATIENCE = 1.0
"""s; a shorter compilation shows nothing."""
_FUNCTIONS_A_DOT = 8
_first = threading.Lock()


class _OwnOptions(event.Listener):
    """Options of Numba that hold while one of `functions` is compiled.

    Loops run over a few joints: checking whether they can be vectorised takes longer than vectorising saves, by 4 % of
    a rollout. Everything small is inlined anyway; more optimisation takes longer and makes nothing faster.
    """

    def __init__(self) -> None:
        self.functions: set[CodeType] = set()
        self._before: list[tuple[Any, Any]] = []

    def on_start(self, begun: event.Event) -> None:
        config = numba.config
        self._before.append((config.OPT, config.LOOP_VECTORIZE))
        if begun.data["dispatcher"].py_func.__code__ in self.functions:
            config.OPT, config.LOOP_VECTORIZE = type(config.OPT)(1), 0

    def on_end(self, _ended: event.Event) -> None:  # Also if the compilation failed.
        if self._before:  # Empty if the compilation began before this listener was there.
            numba.config.OPT, numba.config.LOOP_VECTORIZE = self._before.pop()


OWN_OPTIONS = _OwnOptions()
event.register("numba:compile", OWN_OPTIONS)


class _Dots(event.Listener):
    """Prints a dot for some functions that Numba has compiled."""

    def __init__(self) -> None:
        self.begin = 0.0
        self.printed = False
        self._count = 0

    def on_start(self, _event: event.Event) -> None:
        self.begin = self.begin or time.monotonic()

    def on_end(self, _event: event.Event) -> None:
        self._count += 1
        if self._count % _FUNCTIONS_A_DOT == 0 and time.monotonic() - self.begin > _PATIENCE:
            before = "" if self.printed else "pidtsm: compiling, once after an installation "
            self.printed = True
            print(f"{before}.", end="", file=sys.stderr, flush=True)


@contextmanager
def first_compilation() -> Iterator[None]:
    """Show on standard error that Numba compiles within the block, the first time in a process that one is entered.

    Meanwhile no garbage is collected, because that takes a tenth of the time.
    """
    if not _first.acquire(blocking=False):
        yield
        return
    dots, collects = _Dots(), gc.isenabled()
    gc.disable()
    try:
        with event.install_listener("numba:compile", dots):
            yield
    finally:
        if collects:
            gc.enable()
        if dots.printed:
            print(f" {time.monotonic() - dots.begin:.0f} s", file=sys.stderr)
