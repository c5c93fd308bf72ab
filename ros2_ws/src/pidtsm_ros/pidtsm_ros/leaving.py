"""The end of a node's process, which must come even if the middleware does not end."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE = 2.0
"""Longest time for the middleware to end, s; also for readers to acknowledge what was published."""
_MESSAGE = (
    b"the middleware did not end within %.1f s, as happens after a freeze; this process leaves without it. "
    b"Other nodes may list it for up to 20 s"
)
_SETTLE = 0.1
"""Time in which the message is written, s."""
_MONOTONIC, _IN_A_THREAD = 1, 2
"""CLOCK_MONOTONIC and SIGEV_THREAD of Linux."""


class _Event(ctypes.Structure):
    """``struct sigevent`` of a 64-bit Linux: call a function with one argument in a thread of its own."""

    _fields_ = (
        ("argument", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("unused", ctypes.c_byte * 40),
    )


class _Timer(ctypes.Structure):
    """``struct itimerspec``: interval (never again) and time until the event, each in s and ns."""

    _fields_ = (("interval", ctypes.c_long * 2), ("value", ctypes.c_long * 2))


@contextmanager
def leaving_within(code: int, seconds: float = PATIENCE) -> Iterator[None]:
    """End this process with the exit code `code` if the block takes longer than so many seconds.

    The C library waits and ends the process, because the middleware may hang in a call during which Python runs
    neither threads nor signal handlers.
    """
    library = ctypes.CDLL(None)
    message = ctypes.create_string_buffer(_MESSAGE % seconds)
    timers = [
        _start(library, library.warnx, ctypes.addressof(message), seconds),
        _start(library, library._exit, code, seconds + _SETTLE),
    ]
    try:
        yield
    finally:
        for timer in timers:
            library.timer_delete(timer)


def leave_within(code: int, seconds: float = PATIENCE) -> None:
    """From now on, the process has so many seconds to end; then it ends anyway, with the exit code `code`."""
    library = ctypes.CDLL(None)
    _start(library, library._exit, code, seconds)


def _start(library: ctypes.CDLL, function: object, argument: int, seconds: float) -> ctypes.c_void_p:
    """Start a timer that calls a function of the C library; returns its handle."""
    timer = ctypes.c_void_p()
    address = ctypes.cast(function, ctypes.c_void_p)  # type: ignore[arg-type]
    event = _Event(argument=argument, notify=_IN_A_THREAD, function=address.value)
    whole, rest = divmod(round(seconds * 1e9), 1_000_000_000)
    at = _Timer(value=(whole, rest))
    if library.timer_create(_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)) == 0:
        library.timer_settime(timer, 0, ctypes.byref(at), None)
    return timer
