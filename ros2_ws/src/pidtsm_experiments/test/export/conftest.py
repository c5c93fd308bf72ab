"""Runs of two arms, without the figures of the command rollout, as drawing takes long."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import pytest

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.rollout_bag import write_rollout_bag
from pidtsm_experiments.runs.saved import RECORDING, save_recording, write_parameters

ARMS = ("panda", "scara")
"""Seven joints that turn, and four of which one slides."""
Leave: TypeAlias = Callable[..., None]


@pytest.fixture(scope="session")
def leave() -> Leave:
    """A function that leaves a rollout as a bag, or as a result folder without one; see `run` for its arguments."""

    def run(place: Path, robot: str | None, duration: float, overrides: tuple[str, ...] = (), bag: bool = True) -> None:
        """Leave a rollout.

        Args:
            place: bag or folder that is made.
            robot: name or file; None: that of the scenario.
            duration: s.
            overrides: as for ``--set``.
            bag: whether it is a bag.
        """
        experiment = make_experiment(None, duration=duration, overrides=overrides, robot=robot)
        parameters = experiment.values
        if bag:
            write_rollout_bag(rollout(experiment), parameters["trajectory"], place)
        else:
            place.mkdir()
            save_recording(rollout(experiment), place / RECORDING)
            write_parameters(parameters, place)

    return run


@pytest.fixture(scope="session")
def bags(tmp_path_factory: pytest.TempPathFactory, leave: Leave) -> Path:
    """Folder with a bag of each of `ARMS`; do not change it."""
    folder = tmp_path_factory.mktemp("bags")
    for arm in ARMS:
        leave(folder / arm, arm, 0.2)
    return folder


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the test, in which commands run."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
