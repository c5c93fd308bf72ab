"""A result folder is used by one process at a time."""

import multiprocessing
import os
import signal
from multiprocessing.synchronize import Event
from pathlib import Path

import pytest

from pidtsm_core.errors import UsageError
from pidtsm_experiments.runs.locks import locked
from pidtsm_experiments.runs.results import result_folder

DEADLINE = 60.0  # s


def occupy(out: Path, begun: Event, end: Event) -> None:
    with result_folder(out) as folder:
        (folder / "metrics.json").write_text("{}")
        begun.set()
        end.wait(DEADLINE)


class Other:
    """Another process that works in a folder."""

    def __init__(self, out: Path) -> None:
        context = multiprocessing.get_context("spawn")
        begun, self.end = context.Event(), context.Event()
        self.process = context.Process(target=occupy, args=(out, begun, self.end))
        self.process.start()
        assert begun.wait(DEADLINE)

    def finish(self) -> None:
        self.end.set()
        self.process.join(DEADLINE)
        assert self.process.exitcode == 0


def test_a_folder_in_use_is_rejected_with_the_id_of_its_process(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    other = Other(out)
    with (
        pytest.raises(UsageError, match=rf"out is being written by process {other.process.pid};"),
        result_folder(out),
    ):
        pytest.fail("two at once")
    with result_folder(tmp_path / "deep" / "elsewhere"):
        pass
    other.finish()
    with result_folder(out):
        pass
    assert sorted(p.name for p in (tmp_path / "deep").iterdir()) == ["elsewhere", "out"], "no litter"


def test_the_lock_of_a_killed_process_is_gone(tmp_path: Path) -> None:
    other = Other(tmp_path / "out")
    assert other.process.pid is not None
    os.kill(other.process.pid, signal.SIGKILL)
    other.process.join(DEADLINE)
    with result_folder(tmp_path / "out"):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_failure_unlocks_and_keeps_what_was_made(tmp_path: Path) -> None:
    def fail() -> None:
        with result_folder(tmp_path / "out"):
            raise ZeroDivisionError

    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            fail()
    assert [p.name for p in tmp_path.iterdir()] == ["out.failed"]


def test_a_lock_holds_within_a_process_too(tmp_path: Path) -> None:
    with locked(tmp_path / "out"), pytest.raises(UsageError, match=f"process {os.getpid()}"), locked(tmp_path / "out"):
        pytest.fail("two at once")


def test_an_unwritable_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"cannot write to .*file"), locked(tmp_path / "file" / "out"):
        pytest.fail("in a file")
