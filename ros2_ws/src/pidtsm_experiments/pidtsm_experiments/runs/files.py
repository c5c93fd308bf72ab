"""Files that a user names: written whole or not at all, and never in place of something else than a file."""

import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import BinaryIO

from pidtsm_core.errors import UsageError
from pidtsm_experiments.errors import RunError


def writable_file(out: Path, option: str = "--out") -> Path:
    """Check that a file can be written, before the work; a file that is there may be replaced, as by ``cp``.

    Args:
        out: its path; links to a file are followed.
        option: with which it was named.

    Returns:
        The path, for `write_file`.

    Raises:
        UsageError: it is a folder or a broken link, its folder is missing, or it cannot be written.
    """
    try:
        if _is_device(out):
            place, may = out, os.access(out, os.W_OK)
        else:
            place = Path(os.path.realpath(out))
            may = os.access(place.parent, os.W_OK | os.X_OK)
        place.parent.stat()
        is_broken = out.is_symlink() and not out.exists()
    except (OSError, ValueError) as error:  # ValueError: a null character.
        raise UsageError(f"{option} {out}: {getattr(error, 'strerror', None) or error}") from None
    if place.is_dir():
        raise UsageError(f"{option} {out}: is a folder; name a file")
    if is_broken:
        raise UsageError(f"{option} {out}: is a link to nothing; remove it, or name another file")
    if not place.parent.is_dir():
        raise UsageError(f"{option} {out}: {place.parent} is not a folder")
    if not may:
        raise UsageError(f"{option} {out}: may not be written")
    return place


def write_file(place: Path, content: str | bytes) -> None:
    """Write a file; if that fails, what was there is left.

    Args:
        place: what `writable_file` returns, or a new file.
        content: what is written; text as UTF-8.

    Raises:
        RunError: the disk is full or gone, or the folder has been removed.
    """
    with written_file(place) as file:
        file.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def written_file(place: Path) -> Iterator[BinaryIO]:
    """A stream, the content of which the file has after the block; if the block fails, what was there is left.

    Args:
        place: what `writable_file` returns, or a new file.

    Raises:
        RunError: the disk is full or gone, or the folder has been removed.
    """
    try:
        with _appended(place) if _is_device(place) else _replaced(place) as file:
            yield file
    except OSError as error:
        raise RunError(f"cannot write {place}: {error.strerror or error}") from None


@contextmanager
def _appended(device: Path) -> Iterator[BinaryIO]:
    """A stream that can be searched, the content of which is written to a device after the block."""
    with TemporaryFile() as draft:
        yield draft
        draft.seek(0)
        with os.fdopen(os.open(device, os.O_WRONLY | os.O_APPEND), "wb") as file:
            shutil.copyfileobj(draft, file)


@contextmanager
def _replaced(place: Path) -> Iterator[BinaryIO]:
    """A draft beside the file, which gets the name of the file after the block, with the rights that this has."""
    draft = place.with_name(f".{place.name[:100]}.{secrets.token_hex(4)}")
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666)
    try:
        with os.fdopen(descriptor, "wb") as file:
            with suppress(OSError):
                os.fchmod(descriptor, stat.S_IMODE(place.stat().st_mode))
            yield file
            file.flush()
            os.fsync(descriptor)
        draft.replace(place)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def _is_device(place: Path) -> bool:
    """Whether it is no file of a disk, such as a pipe or /dev/stdout: it is written to, not replaced."""
    try:
        mode = place.stat().st_mode
    except OSError:
        return False
    of_a_process = os.path.normpath(place.absolute()).startswith(("/dev/", "/proc/"))
    return not stat.S_ISDIR(mode) and (of_a_process or not stat.S_ISREG(mode))
