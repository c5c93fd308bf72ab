"""The test bench, fresh for every test."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from bench import Bench

from pidtsm_experiments.domain import own_domain
from pidtsm_experiments.runner import Processes


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain() as domain, Processes() as processes:
        bench = Bench(tmp_path, domain, processes)
        yield bench
        bench.close()
