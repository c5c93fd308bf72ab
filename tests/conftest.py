"""The test bench, fresh for every test; nodes are forked, also those that commands start in the test's process."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from bench import Bench, open_bench
from nursery import NurseryProcess

from pidtsm_experiments.runs import runner

# A shell's background jobs ignore SIGINT, and so would the processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _forked_nodes() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "Process", NurseryProcess)
        yield


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with open_bench(tmp_path) as bench:
        yield bench
