"""Which files of a folder are ours: a marker in it lists them, and nothing else may be replaced or removed."""

import json
import os
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path

MARKER = ".pidtsm.json"
"""File in every result folder: all files and folders in it that the program has made, relative to it."""
_NEW = f"{MARKER}.new"
"""The next marker, while it is written; if the process is killed, it stays."""
_FILES = "made by pidtsm"
"""The only key of the marker; its value is null while the folder is being filled."""
_KNOWN = {
    *("bag", "params", "log", "figures", "images"),
    *("recording.npz", "run.json", "metrics.json", "score.json", "params.yaml", "video.mp4", "still.png"),
    *("tuning.json", "tuning.html", "leaderboard.html", "leaderboard.md", "tournament.md"),
    *("comparison.json", "comparison.md", "results.json", "engines.json", "report.html"),
    *("identified.urdf", "identified.xml", "identified.yaml", "identification.html", "identification.json"),
}
"""Names in a folder that is being filled; of one whose process was killed, only these are removed."""
_DRAFT = ".metrics.json."
"""Beginning of the name of a file that a killed process may not have renamed."""


def begin(folder: Path) -> None:
    """Mark an empty folder as one that is being filled."""
    _write(folder, None)


def mark(folder: Path, made: Iterable[str] | None = None) -> None:
    """List in the marker what is ours.

    Args:
        folder: of the marker.
        made: paths of files and folders, relative to it; without, all that are in it.
    """
    _write(folder, sorted(_entries(folder) if made is None else set(made)))


def made_in(folder: Path) -> set[str]:
    """What the marker of a folder lists; nothing if there is no marker, or while the folder is being filled."""
    return _read(folder) or set()


def listed(folder: Path) -> set[str]:
    """Paths of all files and folders in a folder, relative to it, without the marker."""
    return set(_entries(folder))


def foreign(folder: Path, names: Iterable[str] | None = None) -> list[str]:
    """Files and folders in a folder that are not ours, sorted; none if there is no such folder.

    Args:
        folder: it may be missing; a link or a file in its place is foreign.
        names: only these names in it, and what is below them.

    Raises:
        OSError: it cannot be read.
    """
    if not os.path.lexists(folder):
        return []
    if not stat.S_ISDIR(folder.lstat().st_mode):
        return [folder.name]
    only = None if names is None else set(names)
    ours, found = _read(folder), []
    for entry in _entries(folder):
        top = entry.partition(os.sep)[0]
        is_known = top in _KNOWN or top.startswith(_DRAFT)
        is_ours = is_known if ours is None and _is_marked(folder) else entry in (ours or ())
        if not is_ours and (only is None or top in only):
            found.append(entry)
    if os.path.lexists(folder / MARKER) and not _is_marked(folder):
        found.append(MARKER)
    return sorted(found)


def _entries(folder: Path) -> Iterator[str]:
    """Paths of all files and folders in a folder, relative to it; links are not followed."""

    def fail(error: OSError) -> None:
        raise error

    for place, folders, files in os.walk(folder, onerror=fail):
        for name in (*folders, *files):
            path = str(Path(place, name).relative_to(folder))
            if path != MARKER and (path != _NEW or not stat.S_ISREG((folder / path).lstat().st_mode)):
                yield path


def _content(folder: Path) -> object:
    """The content of a marker; None if there is none, or if it is a link or no JSON."""
    try:
        descriptor = os.open(folder / MARKER, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with os.fdopen(descriptor, encoding="utf-8") as file:
            return json.load(file) if stat.S_ISREG(os.fstat(descriptor).st_mode) else None
    except (OSError, ValueError, RecursionError):
        return None


def _is_marked(folder: Path) -> bool:
    content = _content(folder)
    if not isinstance(content, dict) or set(content) != {_FILES}:
        return False
    return content[_FILES] is None or isinstance(content[_FILES], list)


def _read(folder: Path) -> set[str] | None:
    """What the marker lists; None if there is no marker, or while the folder is being filled."""
    content = _content(folder)
    files = content.get(_FILES) if isinstance(content, dict) else None
    return {str(file) for file in files} if isinstance(files, list) else None


def _write(folder: Path, files: list[str] | None) -> None:
    draft = folder / _NEW
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o644)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            json.dump({_FILES: files}, file)
        draft.replace(folder / MARKER)
    except BaseException:  # On a full disk.
        draft.unlink(missing_ok=True)
        raise
