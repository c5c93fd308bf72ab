"""Files that a user names are written whole or not at all, and only where a file can be."""

import os
import resource
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from pidtsm_core.errors import UsageError
from pidtsm_experiments.cli import main
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs.files import writable_file, write_file

WORK = "years of work"
LONG = "x" * 100_000


def old(place: Path) -> None:
    place.write_text(WORK)
    place.chmod(0o640)


def link(place: Path) -> None:
    old(place.with_name("elsewhere"))
    place.symlink_to("elsewhere")


@pytest.mark.parametrize("make", [lambda place: None, old, link], ids=["new", "old", "link"])
def test_a_file_that_is_named_is_written_or_replaced(tmp_path: Path, make: Callable[[Path], object]) -> None:
    out = tmp_path / "gains.yaml"
    make(out)
    rights = stat.S_IMODE(out.stat().st_mode) if out.exists() else None
    names = {path.name for path in tmp_path.iterdir()} | {out.name}
    was_link = out.is_symlink()
    write_file(writable_file(out), LONG)
    assert out.read_text() == LONG
    assert rights in (None, stat.S_IMODE(out.stat().st_mode))
    assert out.is_symlink() == was_link
    assert {path.name for path in tmp_path.iterdir()} == names, "no litter"


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda place: place.mkdir(), "is a folder"),
        (lambda place: place.symlink_to(place.parent), "is a folder"),
        (lambda place: place.symlink_to("nothing"), "is a link to nothing"),
        (lambda place: place.symlink_to(place), "is a link to nothing"),
    ],
    ids=["folder", "link to a folder", "link to nothing", "circle"],
)
def test_what_is_no_file_is_refused_before_the_work(
    tmp_path: Path, make: Callable[[Path], object], reason: str
) -> None:
    make(tmp_path / "out")
    before = sorted(path.name for path in tmp_path.iterdir())
    with pytest.raises(UsageError, match=reason) as refusal:
        writable_file(tmp_path / "out")
    assert "\n" not in str(refusal.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("out", "reason"),
    [
        ("nowhere/x", "No such file"),
        ("file/x", "is not a folder|Not a directory"),
        ("x" * 300, "too long"),
        ("a\0b", "null"),
    ],
)
def test_a_place_that_cannot_be_is_refused_before_the_work(tmp_path: Path, out: str, reason: str) -> None:
    old(tmp_path / "file")
    with pytest.raises(UsageError, match=reason):
        writable_file(tmp_path / out)


def test_a_full_disk_leaves_the_file_that_was_there(tmp_path: Path) -> None:
    old(tmp_path / "out")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(RunError, match=r"cannot write .*out: File too large"):
            write_file(writable_file(tmp_path / "out"), LONG)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [path.read_text() for path in tmp_path.iterdir()] == [WORK]
    with pytest.raises(RunError, match=r"cannot write /dev/full: No space left on device"):
        write_file(writable_file(Path("/dev/full")), LONG)


def test_a_device_is_written_to(tmp_path: Path) -> None:
    read, write = os.pipe()
    write_file(writable_file(Path(f"/dev/fd/{write}")), WORK)
    os.close(write)
    with os.fdopen(read) as pipe:
        assert pipe.read() == WORK


EXCITE = ["excite", "--robot", "two_link", "--duration", "5", "--out", "arm.yaml"]


def test_the_motion_beside_a_scenario_replaces_only_a_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    old(tmp_path / "arm.csv")
    assert main(EXCITE) == 2
    assert "arm.csv is not of arm.yaml" in capsys.readouterr().err
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"arm.csv": WORK}
    (tmp_path / "arm.csv").unlink()
    for _ in range(2):
        assert main(EXCITE) == 0
    (tmp_path / "arm.yaml").write_text("description: mine\n")
    assert main(EXCITE) == 2, "somebody else's scenario now"
