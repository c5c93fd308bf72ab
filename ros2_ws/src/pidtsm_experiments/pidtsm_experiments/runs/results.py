"""Result folders: complete or absent, without replacing other files, used by one process at a time."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pidtsm_core.errors import UsageError
from pidtsm_experiments.errors import OF_THE_DISK, RunError
from pidtsm_experiments.runs import ownership
from pidtsm_experiments.runs.locks import cannot_write, locked
from pidtsm_experiments.runs.origin import NOTHING, ORIGIN, MadeOf, write_origin


@contextmanager
def result_folder(out: Path, made_of: MadeOf = NOTHING) -> Iterator[Path]:
    """Yield an empty working folder; at the end of the block it becomes `out` and replaces earlier results.

    It gets a file about where the results come from, see `write_origin`, and a marker, see `ownership`. If the
    block raises an exception, earlier results are kept, and the unfinished ones are moved to ``OUT.failed``, where the
    logs can be read. Links to `out` are followed. Only files that the program has made are removed.

    Args:
        out: the folder.
        made_of: what `write_origin` needs to know.

    Raises:
        UsageError: `out`, ``OUT.failed`` or ``OUT.unfinished`` contains other files, `out` cannot be a result folder or
            cannot be written, or it is used by another process.
        RunError: the disk is full or gone.
    """
    out = settled(out)
    _check_replaceable(out)
    with locked(out):
        _restore(out)
        for folder in (out, _beside(out, "failed")):
            _check_ours(folder)
        unfinished = _empty(out)
        try:
            yield unfinished
            write_origin(unfinished, made_of)
            ownership.mark(unfinished)
            _check_ours(out)
            _replace(out, unfinished)
        except BaseException as error:
            kept = _keep(unfinished, _beside(out, "failed"))
            if isinstance(error, OSError) and _is_of(error, unfinished):
                raise RunError(f"cannot write to {out}: {error.strerror or error}; {kept}") from None
            raise
        _remove(_beside(out, "failed"))
        _remove(_beside(out, "replaced"))


@contextmanager
def renewed(out: Path, *names: str, beside: tuple[str, ...] = (), made_of: MadeOf = NOTHING) -> Iterator[Path]:
    """Yield an empty working folder; at the end of the block its content replaces that of the same names in `out`.

    `out` gets a file about where the results come from, or a line in it if it has one, see `write_origin`. If the
    block raises an exception, `out` is unchanged. Links to `out` are followed.

    Args:
        out: a folder; if it is missing, it is made before the block.
        names: of the files and folders that the block will make in the working folder.
        beside: of the files that the block writes into `out` itself.
        made_of: what `write_origin` needs to know.

    Raises:
        UsageError: `out` has other files with one of these names, cannot be written, or is used by another process.
        RunError: the disk is full or gone.
    """
    out = settled(out)
    with locked(out):
        _check_ours(out, (*names, *beside, ORIGIN))
        unfinished = _empty(out)
        try:
            out.mkdir(exist_ok=True)
            ownership.mark(out, ownership.made_in(out).union(beside))
            yield unfinished
            write_origin(unfinished, made_of, before=out)
            _check_ours(out, (*names, ORIGIN))
            _move(unfinished, out)
        except OSError as error:
            if not (_is_of(error, unfinished) or _is_of(error, out)):
                raise
            raise RunError(f"cannot write to {out}: {error.strerror or error}") from None
        finally:
            shutil.rmtree(unfinished, ignore_errors=True)


def settled(out: Path) -> Path:
    """The folder that `out` means, without links.

    Raises:
        UsageError: it cannot be a result folder.
    """
    try:
        place = Path(os.path.realpath(out))
        is_there = os.path.lexists(place)
    except OSError as error:  # The current folder has been removed.
        raise UsageError(f"{out} cannot be found: {error.strerror}") from None
    if place.is_symlink():
        raise UsageError(f"the links of {out} lead in a circle; choose another --out")
    if place.parent == place:
        raise UsageError(f"{out} is the root of all folders; name a folder in it")
    if is_there and not place.is_dir():
        raise UsageError(f"{out} is a file; --out needs a folder")
    if is_there and os.path.ismount(place):
        raise UsageError(f"{out} is where a disk is mounted; name a folder in it")
    return place


def _check_replaceable(out: Path) -> None:
    """Check that the current folder is not in `out`: it would be removed.

    Raises:
        UsageError: it is.
    """
    try:
        is_within = Path.cwd().is_relative_to(out)
    except OSError:  # It has been removed already.
        return
    if is_within:
        raise UsageError(f"the current folder is in {out}, which will be replaced; name a folder in it")


def _check_ours(folder: Path, names: tuple[str, ...] | None = None) -> None:
    """Check that all files of a folder are ours, or those of these names.

    Raises:
        UsageError: some are not, or it cannot be read.
    """
    try:
        others = ownership.foreign(folder, names)
    except OSError as error:
        raise UsageError(f"cannot read {error.filename}: {error.strerror}") from None
    if others == [folder.name] and not folder.is_dir():
        raise UsageError(f"{folder} is not a result folder; move it away, or choose another --out")
    if others:
        tops = sorted({other for other in others if str(Path(other).parent) not in others})
        more = ", ..." if len(tops) > len(tops[:3]) else ""
        raise UsageError(
            f"{folder} contains other files ({', '.join(tops[:3])}{more}); move them away, or choose another --out"
        )


def _beside(out: Path, kind: str) -> Path:
    return out.with_name(f"{out.name}.{kind}")


def _restore(out: Path) -> None:
    """Finish what a killed process has begun: put earlier results back, or remove what has been replaced."""
    replaced = _beside(out, "replaced")
    _check_ours(replaced)
    try:
        if replaced.is_dir() and not os.path.lexists(out):
            replaced.rename(out)
        _remove(replaced)
    except OSError as error:
        raise UsageError(cannot_write(out, error)) from None


def _empty(out: Path) -> Path:
    """An empty folder beside `out`, for what is not finished."""
    unfinished = _beside(out, "unfinished")
    _check_ours(unfinished)
    try:
        _remove(unfinished)
        unfinished.mkdir()
        ownership.begin(unfinished)
    except OSError as error:
        with suppress(OSError):
            unfinished.rmdir()
        raise UsageError(cannot_write(out, error)) from None
    return unfinished


def _replace(out: Path, unfinished: Path) -> None:
    """Make `unfinished` the folder `out`; what was there is moved aside."""
    replaced = _beside(out, "replaced")
    if os.path.lexists(out):
        out.rename(replaced)
    try:
        unfinished.rename(out)
    except OSError:
        if replaced.is_dir():
            replaced.rename(out)
        raise


def _move(unfinished: Path, out: Path) -> None:
    """Move everything in `unfinished` to `out`."""
    made, before = ownership.listed(unfinished), ownership.made_in(out)
    ownership.mark(out, before | made)  # Whenever the process is killed, all that is ours is listed.
    for name in sorted({entry.partition(os.sep)[0] for entry in made}):
        if (out / name).is_dir():
            shutil.rmtree(out / name)
        (unfinished / name).rename(out / name)
    ownership.mark(out, made | (before & ownership.listed(out)))


def _keep(unfinished: Path, failed: Path) -> str:
    """Move what is unfinished to `failed`, and report it; never raises."""
    try:
        with suppress(OSError):  # On a full disk, it stays marked as unfinished.
            ownership.mark(unfinished)
        if not ownership.foreign(failed):
            if failed.is_dir():
                shutil.rmtree(failed)
            unfinished.rename(failed)
            return f"what was made is in {failed}"
    except OSError:
        pass
    return f"what was made is in {unfinished}" if unfinished.is_dir() else f"{unfinished} is gone"


def _remove(folder: Path) -> None:
    """Remove a folder, if there is one; all in it must be ours.

    Raises:
        RunError: it cannot be removed.
    """
    try:
        if folder.is_dir():
            shutil.rmtree(folder)
    except OSError as error:
        raise RunError(f"{folder} cannot be removed: {error.strerror}; remove it, or choose another --out") from None


def _is_of(error: OSError, folder: Path) -> bool:
    """Whether an error is one of the disk, or of a file in a folder."""
    names = [Path(os.fsdecode(name)) for name in (error.filename, error.filename2) if isinstance(name, (str, bytes))]
    return error.errno in OF_THE_DISK or any(name.is_relative_to(folder) for name in names)
