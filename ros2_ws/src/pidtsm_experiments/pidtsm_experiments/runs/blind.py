"""A run of a blind arm with the real nodes; what would tell its faults at a glance is sealed."""

from collections.abc import Sequence
from pathlib import Path

from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_experiments.commands.options import progress_bar
from pidtsm_experiments.runs.results import result_folder
from pidtsm_experiments.runs.runner import run
from pidtsm_studies.blind.arms import blind_arm
from pidtsm_studies.blind.seal import seal

_TELLS = (Path("params", "simulator.yaml"), Path("log", "metadata.yaml"))
"""Files of a run that describe the arm as it is."""


def run_blind(seed: int, robot: ArmDefinition | None, overrides: Sequence[str], out: Path) -> None:
    """Run a blind arm in lockstep, and leave its bag, the parameters of controller and trajectory, and the seal.

    Args:
        seed: of the arm.
        robot: the arm; None: by the seed.
        overrides: see `make_experiment`.
        out: result folder.

    Raises:
        UsageError: the arm cannot be blind, see `blind_arm`; see also `runner.run` and `result_folder`.
        RunError: the run failed.
    """
    with result_folder(out) as folder, progress_bar() as bar:
        made = blind_arm(seed, folder, robot)
        experiment = make_experiment(made.experiment, overrides=overrides) if overrides else made.experiment
        title = f"blind {seed}"
        task = bar.add_task(f"{title}: starting the nodes", total=experiment.duration)
        run(experiment, "lockstep", folder, lambda time: bar.update(task, completed=time, description=title))
        for file in _TELLS:
            (folder / file).unlink()
        seal(made.truth, folder)
