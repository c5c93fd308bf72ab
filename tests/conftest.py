"""The test bench, fresh for every test."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from bench import Bench, open_bench

# A shell's background jobs ignore SIGINT, and so would the processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with open_bench(tmp_path) as bench:
        yield bench
