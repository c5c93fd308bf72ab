"""Judges what hostile inputs do: each is used or refused in one line, soon, and in little memory."""

import resource
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

LONGEST = 10.0  # s of processor time, and of waiting
MOST = 2**30
"""Memory that inputs may need, bytes; what is reserved and never used does not count, up to `_RESERVED`."""
_RESERVED = 2**32


class SlowError(AssertionError):
    """An input took too long."""


@contextmanager
def soon() -> Iterator[None]:
    """Fail if the block takes more processor time than `LONGEST`, or waits for much longer."""

    def end(_signal: int, _frame: FrameType | None) -> None:
        raise SlowError

    kinds = ((signal.SIGPROF, signal.ITIMER_PROF, LONGEST), (signal.SIGALRM, signal.ITIMER_REAL, 6.0 * LONGEST))
    before = [(timer, kind, signal.signal(kind, end)) for kind, timer, _ in kinds]
    for _, timer, most in kinds:
        signal.setitimer(timer, most)
    try:
        yield
    finally:
        for timer, kind, handler in before:
            signal.setitimer(timer, 0.0)
            signal.signal(kind, handler)


@contextmanager
def little_memory() -> Iterator[None]:
    """Fail if the block needs more than `MOST`; no more than `_RESERVED` can be reserved at all."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    Path("/proc/self/clear_refs").write_text("5")  # The peak begins anew.
    used = _peak()
    resource.setrlimit(resource.RLIMIT_AS, (now + _RESERVED, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert _peak() - used <= MOST


def _peak() -> int:
    """Largest memory of this process so far, bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))


class Judge:
    """Uses inputs, and judges what happens; `used` and `refused` count them."""

    def __init__(self, *refusals: type[Exception]) -> None:
        """Args: refusals: exceptions whose text is for the user."""
        self._refusals = refusals
        self.used = self.refused = 0
        self.broken: list[str] = []

    def use(self, what: str, use: Callable[[], object], named: str = "") -> str:
        """Call `use`; a refusal is one line, with `named` in it. Returns the refusal; empty: it was used."""
        with soon(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Numbers that overflow; unfinished bags.
            try:
                use()
                self.used += 1
                return ""
            except self._refusals as error:
                self.refused += 1
                if "\n" in str(error) or named not in str(error):
                    self.broken.append(f"{what}: {error}")
                return str(error) or type(error).__name__
            except Exception as error:
                with suppress(Exception):
                    self.broken.append(f"{what}: {type(error).__name__}: {error}")
                return type(error).__name__

    def conclude(self, least: int, most: int) -> None:
        """Check that nothing broke, and that neither everything was used nor everything refused."""
        assert not self.broken, "\n".join(self.broken)
        assert least < self.used < most
