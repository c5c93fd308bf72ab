"""Bags of two arms."""

from pathlib import Path

import pytest

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import SCHEMAS, rollout
from pidtsm_experiments.bags.rollout_bag import write_rollout_bag

ARMS = ("panda", "scara")
"""Seven joints that turn, and four of which one slides."""


@pytest.fixture(scope="session")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a bag of each of `ARMS`; do not change it."""
    folder = tmp_path_factory.mktemp("bags")
    for arm in ARMS:
        experiment = make_experiment(None, duration=0.2, robot=arm)
        trajectory = experiment.resolved(SCHEMAS)["trajectory"]
        write_rollout_bag(rollout(experiment), trajectory, folder / arm)
    return folder


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the test, in which commands run."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
