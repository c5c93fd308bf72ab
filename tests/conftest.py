"""A fresh testbed for every test; nodes are forked, also those that commands start in the test process."""

import gc
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.nursery import NurseryProcess
from support.testbed import Testbed, open_testbed

from pidtsm_experiments.runs import runner
from pidtsm_studies.reports import figures

# A shell's background jobs ignore SIGINT, and so would the processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Thousands of tests, and all that they have imported, live to the end: nothing need look through them again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _forked_nodes() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "Process", NurseryProcess)
        yield


@pytest.fixture(scope="module", autouse=True)
def _one_figure() -> Iterator[None]:
    """A run in this process leaves one figure instead of five, as drawing takes long; test_command_line.py sees all."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "FIGURES", {"tracking": figures.tracking})
        yield


@pytest.fixture
def testbed(tmp_path: Path) -> Iterator[Testbed]:
    with open_testbed(tmp_path) as testbed:
        yield testbed
