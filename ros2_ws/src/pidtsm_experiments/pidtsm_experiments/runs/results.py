"""Result folders: complete or absent, without replacing other files, used by one process at a time."""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pidtsm_core.errors import UsageError
from pidtsm_experiments.runs.origin import write_origin

_FOLDERS = {"bag", "params", "log", "figures", "images"}
_FILES = {
    "recording.npz",
    "run.json",
    "metrics.json",
    "score.json",
    "params.yaml",
    "tuning.json",
    "tuning.html",
    "history.jsonl",
    "leaderboard.html",
    "leaderboard.md",
    "tournament.json",
    "tournament.md",
    "comparison.json",
    "engines.json",
    "report.html",
    "identified.urdf",
    "identified.yaml",
    "identification.html",
    "identification.json",
    "video.mp4",
    "still.png",
}


@contextmanager
def result_folder(out: Path) -> Iterator[Path]:
    """Yield an empty working folder; at the end of the block it becomes `out` and replaces earlier results.

    It gets a file that says where the results come from, see `write_origin`. If the block raises an exception, earlier
    results are kept, and the unfinished ones are moved to ``OUT.failed``, where the logs can be read.

    Raises:
        UsageError: `out` contains other files, cannot be written, or is used by another process.
    """
    out = out.absolute()
    with locked(out):
        if out.exists():
            _check_ours(out)
        unfinished = _empty(out)
        failed = out.with_name(f"{out.name}.failed")
        try:
            yield unfinished
            write_origin(unfinished)
        except BaseException:
            shutil.rmtree(failed, ignore_errors=True)
            unfinished.rename(failed)
            raise
        shutil.rmtree(failed, ignore_errors=True)
        if out.exists():
            shutil.rmtree(out)
        unfinished.rename(out)


@contextmanager
def renewed(out: Path) -> Iterator[Path]:
    """Yield an empty working folder; at the end of the block its content replaces that of the same names in `out`.

    If the block raises an exception, `out` is unchanged.

    Args:
        out: an existing result folder.

    Raises:
        UsageError: `out` cannot be written, or is used by another process.
    """
    out = out.absolute()
    with locked(out):
        unfinished = _empty(out)
        try:
            yield unfinished
            for entry in unfinished.iterdir():
                if (out / entry.name).is_dir():
                    shutil.rmtree(out / entry.name)
                entry.rename(out / entry.name)
        except OSError as error:
            raise UsageError(_cannot_write(out, error)) from None
        finally:
            shutil.rmtree(unfinished)


def _empty(out: Path) -> Path:
    """An empty folder beside `out`, for what is not finished."""
    unfinished = out.with_name(f"{out.name}.unfinished")
    try:
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.mkdir()
    except OSError as error:
        raise UsageError(_cannot_write(out, error)) from None
    return unfinished


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Lock `out` against other processes within the block.

    The lock is held on a file next to `out`; the kernel releases it if the process dies.

    Raises:
        UsageError: another process holds the lock (the message contains its id), or the lock file cannot be written.
    """
    out = out.absolute()
    file = out.with_name(f".{out.name}.lock")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        lock = _lock(file)
    except OSError as error:
        raise UsageError(_cannot_write(out, error)) from None
    if lock is None:
        raise UsageError(f"{out} is being written by {_owner(file)}; wait for it, or choose another --out")
    try:
        yield
    finally:
        file.unlink(missing_ok=True)
        os.close(lock)


def _lock(file: Path) -> int | None:
    """Create and lock a file with the id of this process; returns its descriptor, None if another process has it."""
    while True:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # The previous owner may have removed the file after it was opened here; then try again.
            if file.exists() and os.path.samestat(file.stat(), os.fstat(descriptor)):
                os.ftruncate(descriptor, 0)
                os.write(descriptor, str(os.getpid()).encode())
                return descriptor
        except FileNotFoundError:
            pass
        except BlockingIOError:
            os.close(descriptor)
            return None
        os.close(descriptor)


def _owner(file: Path) -> str:
    try:
        return f"process {int(file.read_text(encoding='ascii'))}"
    except (OSError, ValueError):  # It has just ended or just started.
        return "another process"


def _cannot_write(out: Path, error: OSError) -> str:
    return f"cannot write to {out.parent}: {error.strerror}"


def _check_ours(out: Path) -> None:
    if not out.is_dir():
        raise UsageError(f"{out} is a file; --out needs a folder")
    foreign = sorted(entry.name for entry in out.iterdir() if entry.name not in _FOLDERS | _FILES)
    if foreign:
        raise UsageError(f"{out} contains other files ({', '.join(foreign[:3])}); choose another --out")
