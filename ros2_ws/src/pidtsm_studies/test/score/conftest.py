"""A real score with few runs, and one whose shares are known."""

from dataclasses import replace

import pytest

from pidtsm_core.experiment import PRACTICAL
from pidtsm_studies.score.criteria import QUICK
from pidtsm_studies.score.measure import measure
from pidtsm_studies.score.plan import Contender
from pidtsm_studies.score.results import Entry
from pidtsm_studies.score.tasks import Task, find_task


@pytest.fixture(scope="session")
def task() -> Task:
    """That of the two-link arm, shortened."""
    return replace(find_task(), duration=8.0, event=3.0, after=6.0)


@pytest.fixture(scope="session")
def contender() -> Contender:
    return Contender(None, (PRACTICAL,), ("controller.law.k1=3.5",), "mine")


@pytest.fixture(scope="session")
def entry(task: Task, contender: Contender) -> Entry:
    return measure(task, contender, QUICK)
