"""A tuning of the two-link arm with few candidates and short runs."""

from dataclasses import replace

import pytest

from pidtsm_studies.score.tasks import Task, find_task
from pidtsm_studies.tuning.objective import Problem, make_problem
from pidtsm_studies.tuning.space import Space, make_space

IDENTITY = {"robot": "two_link", "law": "piddtsm", "hardware": "14bit", "objective": "balanced", "seed": 3}


@pytest.fixture(scope="session")
def identity() -> dict[str, object]:
    return dict(IDENTITY)


@pytest.fixture(scope="session")
def task() -> Task:
    return replace(find_task(), duration=2.0, event=0.2, after=1.5, error=0.3)


@pytest.fixture(scope="session")
def problem(task: Task) -> Problem:
    return make_problem(task, "training", "14bit", "balanced")


@pytest.fixture(scope="session")
def space(task: Task) -> Space:
    return make_space(task, "piddtsm")
