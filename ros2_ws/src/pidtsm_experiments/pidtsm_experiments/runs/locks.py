"""Locks of result folders: one process at a time."""

import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pidtsm_core.errors import UsageError

_LONGEST = 20
"""Largest number of characters of a process id."""


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Lock `out` against other processes within the block.

    The lock is held on a file next to `out`; the kernel releases it if the process dies.

    Raises:
        UsageError: another process holds the lock (the message contains its id), or the lock file cannot be written,
            or it is something else than a lock.
    """
    out = out.absolute()
    file = out.with_name(f".{out.name}.lock")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        lock = _lock(file)
    except OSError as error:
        raise UsageError(cannot_write(out, error)) from None
    if lock is None:
        raise UsageError(f"{out} is being written by {_owner(file)}; wait for it, or choose another --out")
    try:
        yield
    finally:
        file.unlink(missing_ok=True)
        os.close(lock)


def cannot_write(out: Path, error: OSError) -> str:
    """The message of an error beside `out`."""
    return f"cannot write to {out.parent}: {error.strerror or error}"


def _lock(file: Path) -> int | None:
    """Create and lock a file with the id of this process; returns its descriptor, None if another process has it."""
    while True:
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644)
        except OSError:
            if file.is_symlink():
                raise _no_lock(file) from None
            raise
        try:
            _check(file, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # The previous owner may have removed the file after it was opened here; then try again.
            if os.path.samestat(file.lstat(), os.fstat(descriptor)):
                os.ftruncate(descriptor, 0)
                os.pwrite(descriptor, str(os.getpid()).encode(), 0)
                return descriptor
        except FileNotFoundError:
            pass
        except BlockingIOError:
            os.close(descriptor)
            return None
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _check(file: Path, descriptor: int) -> None:
    """Check that a file is a lock: it is empty or contains a number, and has no other name.

    Raises:
        UsageError: it is not.
    """
    status = os.fstat(descriptor)
    content = os.pread(descriptor, _LONGEST + 1, 0) if stat.S_ISREG(status.st_mode) else b"other"
    if status.st_nlink > 1 or len(content) > _LONGEST or (content and not content.isdigit()):
        raise _no_lock(file)


def _no_lock(file: Path) -> UsageError:
    return UsageError(f"{file} is in the way of the lock, and is none; move it away, or choose another --out")


def _owner(file: Path) -> str:
    try:
        return f"process {int(file.read_text(encoding='ascii'))}"
    except (OSError, ValueError):  # It has just ended or just started.
        return "another process"
