"""Whatever is at the place of a result folder and beside it: only what the program has made is replaced or removed."""

import errno
import os
import resource
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import pytest

from pidtsm_core.errors import UsageError
from pidtsm_experiments.cli import main
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs import ownership
from pidtsm_experiments.runs.locks import locked
from pidtsm_experiments.runs.results import renewed, result_folder
from pidtsm_studies.reports import figures

SITUATIONS, COMMANDS = 150, 16
NOBODY = 65534
BESIDE = ("failed", "unfinished", "replaced")
SMALL = 2000  # bytes; the largest file on a disk that is nearly full


def foreign(folder: Path, name: str = "thesis.tex") -> None:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("years of work")


def result(folder: Path) -> None:
    folder.mkdir(parents=True)
    for name in ("metrics.json", "figures/error.svg", "bag/metadata.yaml"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("ours")
    ownership.mark(folder)


def filling(folder: Path) -> None:
    result(folder)
    ownership.begin(folder)


def linked(place: Path, make: Callable[[Path], None]) -> None:
    target = place.parent / f"elsewhere of {place.name}"
    make(target)
    place.symlink_to(target)


def old_result(place: Path) -> None:
    for name in ("metrics.json", "bag/bag.mcap"):
        foreign(place, name)


def dead_lock(place: Path) -> None:
    place.write_text("4194305")


def file(place: Path) -> None:
    foreign(place.parent, place.name)


def second_name(place: Path) -> None:
    foreign(place.parent, "first name")
    os.link(place.parent / "first name", place)


Maker = Callable[[Path], None]


def noted(make: Maker, name: str = "note.txt") -> Maker:
    """A folder in which somebody has put a file."""

    def make_both(place: Path) -> None:
        make(place)
        foreign(place, name)

    return make_both


def killed_at_once(place: Path) -> None:
    place.mkdir()
    (place / ".pidtsm.json.new").write_text("{")


PLACES: dict[str, Maker] = {
    "killed at once": killed_at_once,
    "missing": lambda place: None,
    "empty": lambda place: place.mkdir(),
    "result": result,
    "being filled": filling,
    "of somebody": foreign,
    "with our names": lambda place: foreign(place, "figures/mine.svg"),
    "old result": old_result,
    "result with a note": noted(result),
    "result with a figure": noted(result, "figures/mine.svg"),
    "being filled, with a note": noted(filling),
    "file": file,
    "link to a result": lambda place: linked(place, result),
    "link to files": lambda place: linked(place, foreign),
    "link to nothing": lambda place: place.symlink_to(place.parent / "nothing"),
    "link in a circle": lambda place: place.symlink_to(place),
    "pipe": os.mkfifo,
}
LOCKS: dict[str, Maker] = {
    "missing": lambda place: None,
    "of a dead process": dead_lock,
    "file": file,
    "link": lambda place: linked(place, file),
    "folder": foreign,
    "pipe": os.mkfifo,
    "second name": second_name,
}


class BrokenError(Exception):
    """The work of a command has failed."""


@contextmanager
def nearly_full_disk() -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (SMALL, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextmanager
def as_nobody() -> Iterator[None]:
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


def works(folder: Path) -> None:
    (folder / "metrics.json").write_text("new")
    (folder / "figures").mkdir()
    (folder / "figures" / "effort.svg").write_text("new")


def fills_the_disk(folder: Path) -> None:
    works(folder)
    with nearly_full_disk():
        (folder / "recording.npz").write_bytes(bytes(10 * SMALL))


def fails(folder: Path) -> None:
    works(folder)
    raise BrokenError


def loses_its_folder(folder: Path) -> None:
    shutil.rmtree(folder)
    works(folder)


def meets_a_dead_device(_: Path) -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def meets_another(folder: Path) -> None:
    """Somebody else wants the same folder at the same time, and is refused; then the work fails."""
    error = use(folder.with_name(folder.name.removesuffix(".unfinished")), works, as_new=True)
    assert "is being written by process" in error
    fails(folder)


WORK = (works, works, works, fills_the_disk, fails, loses_its_folder, meets_a_dead_device, meets_another)


def foreign_things(root: Path) -> set[tuple[Path, str, int, int]]:
    """All that is somebody's: files with their content, links and pipes; with place, kind, rights and owner."""
    found = set()
    for place, folders, names in os.walk(root):
        for path in (Path(place, name) for name in (*folders, *names)):
            status = path.lstat()
            kind = stat.filemode(status.st_mode)[0]
            if kind == "l":
                found.add((path, f"link to {path.readlink()}", status.st_mode, status.st_uid))
            elif kind == "p" or (kind == "-" and path.read_text(errors="replace") == "years of work"):
                found.add((path, kind, status.st_mode, status.st_uid))
    return found


@pytest.fixture
def root() -> Iterator[Path]:
    """A folder that other users may enter."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    folder.chmod(0o755)
    shutil.rmtree(folder)


def use(out: Path, work: Callable[[Path], None], as_new: bool) -> str:
    """Make a result in a folder, or renew one; returns the error, in one line."""
    place = result_folder(out) if as_new else renewed(out, "metrics.json", "figures", "recording.npz")
    try:
        with place as folder:
            work(folder)
    except (UsageError, RunError, BrokenError) as error:
        return str(error) or "the work failed"
    return ""


@pytest.mark.parametrize("seed", range(SITUATIONS))
def test_nothing_is_lost_that_is_not_ours(root: Path, seed: int) -> None:
    random = Random(seed)
    out = root / random.choice(["out", "out", "deep/out"])
    out.parent.mkdir(exist_ok=True)
    PLACES[random.choice(list(PLACES))](out)
    for kind in BESIDE:
        PLACES[random.choice([*PLACES, *["missing"] * 60, *["result"] * 10])](out.with_name(f"out.{kind}"))
    LOCKS[random.choice([*LOCKS, *["missing"] * 20])](out.with_name(".out.lock"))
    work, as_new = random.choice(WORK), random.random() < 0.7
    before = foreign_things(root)
    if random.random() < 0.2:
        out.parent.chmod(random.choice([0o755, 0o1777]) if os.geteuid() == 0 else 0o555)
        if os.geteuid() == 0:
            with as_nobody():
                error = use(out, work, as_new)
        else:
            error = use(out, work, as_new)
        out.parent.chmod(0o755)
    else:
        error = use(out, work, as_new)
    assert foreign_things(root) >= before
    assert "\n" not in error
    made = out / "figures" / "effort.svg"
    assert bool(error) != (made.exists() and made.read_text() == "new")
    if work is not works:
        assert error


def test_many_situations_end_well(root: Path) -> None:
    """The judge above could not notice if everything were refused."""
    for place in ("missing", "empty", "killed at once", "result", "link to a result", "link to nothing"):
        out = root / place / "out"
        out.parent.mkdir()
        PLACES[place](out)
        target = out.resolve()
        for kind in ("failed", "unfinished"):
            result(target.with_name(f"{target.name}.{kind}"))
        assert not use(out, works, as_new=True)
        assert (target / "figures" / "effort.svg").read_text() == "new"
        assert {path.name for path in out.parent.iterdir()} == {"out", target.name}, "no litter"


@pytest.mark.parametrize("seed", range(COMMANDS))
def test_a_command_loses_nothing_that_is_not_ours(
    root: Path, seed: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(figures, "FIGURES", {"error": figures.error})
    place = list(PLACES)[seed % len(PLACES)]
    PLACES[place](root / "out")
    foreign(root / "out.failed" if seed % 2 else root, "note.txt")
    before = foreign_things(root)
    code = main(["rollout", "--duration", "0.05", "--out", str(root / "out")])
    error = capfd.readouterr().err
    assert foreign_things(root) >= before
    assert (code == 0) == (root / "out" / "recording.npz").exists()
    assert code == 0 or (code == 2 and error.startswith("pidtsm: ") and error.count("\n") == 1)


def test_two_at_once_lose_nothing(root: Path) -> None:
    foreign(root)
    before, begin = foreign_things(root), threading.Barrier(2)
    errors: set[str] = set()

    def repeat(as_new: bool) -> None:
        begin.wait()
        errors.update(use(root / "out", works, as_new) for _ in range(30))

    both = [threading.Thread(target=repeat, args=(as_new,)) for as_new in (True, False)]
    for each in both:
        each.start()
    for each in both:
        each.join()
    assert errors <= {""} | {error for error in errors if "is being written by" in error}
    assert foreign_things(root) == before
    assert {path.name for path in root.iterdir()} == {"thesis.tex", "out"}
    assert (root / "out" / "figures" / "effort.svg").read_text() == "new"


FULL = """
import sys, resource
from pathlib import Path
from pidtsm_experiments.cli import main
from pidtsm_studies.reports import figures

figures.FIGURES = {"error": figures.error}
disk, is_mounted = Path(sys.argv[1]), sys.argv[2] == "mounted"
old = disk / "out"
assert main(["rollout", "--duration", "0.01", "--out", str(old)]) == 0
before = {file: file.read_bytes() for file in old.rglob("*") if file.is_file()}
for free in (0, 4096, 50_000):  # A result has more.
    filling = disk / "thesis.tex"
    if is_mounted:
        with filling.open("wb", buffering=0) as file:
            try:
                while file.write(b"x" * 4096):
                    pass
            except OSError:
                pass
            file.truncate(file.tell() - free)
        filled = filling.stat().st_size
    else:
        resource.setrlimit(resource.RLIMIT_FSIZE, (free, resource.RLIM_INFINITY))
    assert main(["rollout", "--duration", "0.05", "--out", str(old)]) in (1, 2)
    assert main(["gains", "--out", str(disk / "out.yaml")]) in ((0, 1) if free else (1,))
    assert {file: file.read_bytes() for file in old.rglob("*") if file.is_file()} == before
    if is_mounted:
        assert filling.stat().st_size == filled
        filling.unlink()
    (disk / "out.yaml").unlink(missing_ok=True)
"""
MOUNT = "mount -t tmpfs -o size=32m tmpfs"


def test_a_disk_that_is_full_loses_nothing(root: Path) -> None:
    """On a small disk of its own, or, where none can be mounted, with a limit on the size of files."""
    alone = ["unshare", "--map-root-user", "--mount", "sh", "-c", f'{MOUNT} "$0" && exec "$@"', str(root)]
    can_mount = shutil.which("unshare") is not None and not subprocess.run([*alone, "true"], check=False).returncode
    words = [sys.executable, "-c", FULL, str(root), "mounted" if can_mount else "limited"]
    done = subprocess.run(
        [*alone, *words] if can_mount else words, capture_output=True, text=True, check=False, timeout=300.0
    )
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("pidtsm: ")]
    assert len([line for line in lines if "cannot write " in line]) >= 4
    assert ("No space left on device" if can_mount else "File too large") in done.stderr
    assert "Traceback" not in done.stderr


def test_what_is_in_use_is_refused_by_any_of_its_names(root: Path) -> None:
    linked(root / "out", result)
    with locked((root / "out").resolve()):
        assert "is being written by process" in use(root / "out", works, as_new=True)


def test_a_killed_process_between_old_and_new_loses_neither(root: Path) -> None:
    result(root / "out.replaced")
    filling(root / "out.unfinished")
    assert use(root / "out", fails, as_new=True)
    assert (root / "out" / "metrics.json").read_text() == "ours"
    assert sorted(path.name for path in root.iterdir()) == ["out", "out.failed"]


@pytest.mark.parametrize(
    ("out", "words"),
    [("/", "is the root of all folders"), (".", "the current folder is in"), ("/proc/self/x", "cannot write to /proc")],
)
def test_a_place_that_cannot_be_is_refused_before_the_work(
    out: str, words: str, root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(root)
    assert main(["rollout", "--duration", "0.1", "--out", out]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert len(error.splitlines()) == 1
    assert not list(root.iterdir())


@pytest.mark.parametrize("words", [["--json"], []])
def test_an_output_that_cannot_be_written_ends_in_one_line(words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "pidtsm_experiments.cli", "rollout", "--duration", "0.02", *words]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=300.0)
    assert done.returncode == 1
    assert done.stderr == "pidtsm: cannot write the output: No space left on device\n"


def test_a_full_disk_ends_in_one_line(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result(root / "out")
    with nearly_full_disk():
        assert main(["rollout", "--duration", "1", "--out", str(root / "out")]) == 1
    error = capsys.readouterr().err.splitlines()
    assert error[-1].startswith("pidtsm: cannot write to ")
    assert "File too large" in error[-1]
    assert (root / "out" / "metrics.json").read_text() == "ours"
