"""Result folders: complete or absent, and never somebody's other files."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pidtsm_experiments.errors import UsageError

_OURS = {"bag", "params", "log", "figures", "metrics.json", "robustness.json", "report.html"}


@contextmanager
def result_folder(out: Path) -> Iterator[Path]:
    """Yield an empty folder to work in; it becomes `out` at the end of the block, replacing earlier results there.

    Where the block raises, earlier results stay as they were, and the unfinished ones are kept beside them in
    ``OUT.failed`` for a look at the logs.

    Raises:
        UsageError: `out` holds other things than results, or cannot be written.
    """
    out = out.absolute()
    if out.exists():
        _check_ours(out)
    unfinished = out.with_name(f"{out.name}.unfinished")
    try:
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.mkdir(parents=True)
    except OSError as error:
        raise UsageError(f"cannot write to {out.parent}: {error.strerror}") from None
    failed = out.with_name(f"{out.name}.failed")
    try:
        yield unfinished
    except BaseException:
        shutil.rmtree(failed, ignore_errors=True)
        unfinished.rename(failed)
        raise
    shutil.rmtree(failed, ignore_errors=True)
    if out.exists():
        shutil.rmtree(out)
    unfinished.rename(out)


def _check_ours(out: Path) -> None:
    if not out.is_dir():
        raise UsageError(f"{out} is a file; --out needs a folder")
    foreign = sorted(entry.name for entry in out.iterdir() if entry.name not in _OURS)
    if foreign:
        raise UsageError(f"{out} holds other files ({', '.join(foreign[:3])}); choose another --out")
