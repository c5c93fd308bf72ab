"""The same experiment on both engines of the simulated arm: what the choice of the engine changes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import Experiment
from pidtsm_core.recording import Recording
from pidtsm_core.recording.metric import MEAN_EFFORT, RMSE
from pidtsm_core.robots import find_robot
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.simulation.mujoco_model import ENGINE, MUJOCO
from pidtsm_core.units import alike
from pidtsm_core.written import quantity
from pidtsm_studies.reports.comparison import write_comparison
from pidtsm_studies.reports.figures import envelope, finished, line, logarithmic, panels, save_figures
from pidtsm_studies.reports.page import Answer

COMPARED = (RMSE, MEAN_EFFORT)
"""The metrics that are compared."""
_TOGETHER = 3
"""Largest number of joints in a panel."""


@dataclass(frozen=True)
class EngineComparison:
    """The runs of both engines.

    Attributes:
        runs: by engine, the equations of the robot model first.
        metrics: those of each run, see `Recording.metrics`.
        difference: |difference of q|, shape (samples, joints), rad or m.
    """

    runs: Mapping[str, Recording]
    metrics: Mapping[str, Mapping[str, Any]]
    difference: Array

    def relative(self, metric: str) -> Array:
        """Difference of a metric to that of the first engine, as a share of it, shape (joints,)."""
        first, second = (np.array(each[metric]) for each in self.metrics.values())
        return np.asarray(second / first - 1.0)


def compare_engines(experiment: Experiment) -> EngineComparison:
    """Simulate an experiment on both engines; that of the first is as it is without the parameters of MuJoCo.

    An arm in closed form has the parameters with which it is a rigid body on both.

    Raises:
        UsageError: see `rollout`.
        DivergedError: likewise.
    """
    given = experiment.settings["simulator"]
    rigid = {f"robot.{name}": value for name, value in find_robot(given).rigid.items()}
    ours = {name: value for name, value in given.items() if not name.startswith(f"{MUJOCO}.")}
    settings = {str(ENGINE.default): ours, MUJOCO: given}
    runs = {
        engine: rollout(_with_simulator(experiment, {**simulator, **rigid, ENGINE.name: engine}))
        for engine, simulator in settings.items()
    }
    first, second = runs.values()
    metrics = {engine: run.metrics() for engine, run in runs.items()}
    return EngineComparison(runs, metrics, np.abs(second.position - first.position))


def _with_simulator(experiment: Experiment, simulator: Mapping[str, Any]) -> Experiment:
    return replace(experiment, settings={**experiment.settings, "simulator": simulator})


def as_json(comparison: EngineComparison) -> dict[str, Any]:
    """The comparison for a JSON file: per joint, the metrics by engine and the largest difference of q."""
    first = next(iter(comparison.runs.values()))
    table = {
        metric.key: {
            **{engine: metrics[metric.key] for engine, metrics in comparison.metrics.items()},
            "relative_difference": comparison.relative(metric.key).tolist(),
        }
        for metric in COMPARED
    }
    return {
        "scenario": first.scenario,
        "law": first.law,
        "duration": first.duration,
        "joints": list(first.joints),
        **table,
        "largest_difference": comparison.difference.max(axis=0).tolist(),
    }


def write_engine_figures(comparison: EngineComparison, directory: Path) -> list[Path]:
    """Draw the difference of q over time, as PNG and SVG; returns the files."""
    return save_figures({"engines": lambda: _difference(comparison)}, directory)


def write_engine_page(comparison: EngineComparison, path: Path, simulator: Mapping[str, Any]) -> None:
    """Write the page that shows both runs over each other.

    Args:
        comparison: the runs.
        path: the HTML file; an existing one is replaced.
        simulator: parameters of the simulated arm, with the times of pushes and loads.
    """
    runs = {engine: (run, comparison.metrics[engine]) for engine, run in comparison.runs.items()}
    chosen = {f"simulator.{ENGINE.name}": {engine: engine for engine in runs}}
    first = next(iter(comparison.runs.values()))
    title = f"{first.scenario}, {first.law}: the equations of the model and MuJoCo"
    nodes = {engine: {"simulator": simulator} for engine in runs}
    write_comparison(path, runs, chosen, nodes, title, _apart(first, comparison.difference))


def _apart(run: Recording, difference: Array) -> Answer:
    """Where the engines differ most."""
    sample, joint = (int(each) for each in np.unravel_index(np.argmax(difference), difference.shape))
    far = quantity(float(difference[sample, joint]), run.units[joint].position)
    where = f"in the position of {run.joints[joint]} at {quantity(float(run.time[sample]), 's')}"
    return Answer("How far apart are they?", far, where)


def _difference(comparison: EngineComparison) -> Figure:
    """|difference of q| over time, on a logarithmic axis."""
    recording = next(iter(comparison.runs.values()))
    groups = alike(recording.units, _TOGETHER)
    figure, table = panels(len(groups), groups=len(groups))
    for ax, group in zip(table[:, 0], groups, strict=True):
        for style, j in enumerate(group):
            line(ax, *envelope(recording.time, comparison.difference[:, j]), style, recording.joints[j])
        logarithmic(ax)
        ax.set_ylabel(rf"$|\Delta q|$, envelope ({recording.units[group[0]].position})")
    return finished(figure, table, recording, groups=len(groups))
