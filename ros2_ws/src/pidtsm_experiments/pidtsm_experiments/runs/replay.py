"""Makes the result of a rollout or of a run in lockstep again, and compares it bit for bit."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import Experiment
from pidtsm_core.parameters import as_float
from pidtsm_core.parameters.files import NODES, Settings
from pidtsm_core.recording import Recording
from pidtsm_core.recording.outcome import GROUND_TRUTH
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.signals import Status
from pidtsm_core.timing import NANOSECONDS, period_nanoseconds
from pidtsm_experiments.runs.origin import ORIGIN, origin_of

_OF_TRUTH = ("position", "velocity", "effort", "reference", "reference_velocity", "reference_acceleration")

_STATUS = {place.name.lower() for place in Status}


@dataclass(frozen=True)
class Difference:
    """Where a quantity differs first.

    Attributes:
        quantity: name, as of the columns of ``./pidtsm export``.
        joint: name; empty: the quantity is of the whole arm.
        sample: number of the sample, from 0.
        time: of the sample, s.
        recorded: value in the result, in SI units.
        again: value now.
        largest: largest difference of any sample and joint, in SI units; 0: only the sign of a zero differs.
    """

    quantity: str
    joint: str
    sample: int
    time: float
    recorded: float
    again: float
    largest: float


@dataclass(frozen=True)
class Agreement:
    """How far two recordings of the same experiment agree.

    Attributes:
        compared: names of the quantities.
        samples: number of samples that both have.
        lacking: number of samples that the result does not have, because messages were lost or its bag was cut off.
        surplus: number of samples that only the result has.
        differences: of each quantity that differs, the earliest first.
    """

    compared: tuple[str, ...]
    samples: int
    lacking: int
    surplus: int
    differences: tuple[Difference, ...]

    @property
    def agrees(self) -> bool:
        """Whether all samples of the result are there again, with the same bits."""
        return self.samples > 0 and not self.surplus and not self.differences


def origin_of_result(path: Path) -> dict[str, Any]:
    """Content of run.json of a result.

    Raises:
        UsageError: there is none, or the result is not that of one rollout or run.
    """
    origin = origin_of(path)
    if origin is None:
        raise UsageError(f"{path}: no {ORIGIN}, or one of another program: it does not say how it was made")
    if runs := origin.get("runs"):
        raise UsageError(f"{path}: was made of other runs; replay them: {', '.join(runs)}")
    if not set(NODES) <= (origin.get("parameters") or {}).keys():
        raise UsageError(f"{path}: {ORIGIN} has no parameters of all nodes; only a rollout or a run can be made again")
    return origin


def experiment_of_result(recording: Recording, parameters: Settings, robot: str | None = None) -> Experiment:
    """The experiment of a result, from its parameters alone.

    Args:
        recording: of the result.
        parameters: recorded ones, by node.
        robot: description of the arm instead of the recorded one; None: that one.

    Raises:
        UsageError: the result is of a real arm.
        ParameterError: this version does not know a parameter, or refuses a value.
    """
    if recording.truth != GROUND_TRUTH:
        raise UsageError("the bag has no ground truth: a real arm, or one of another simulator, cannot be made again")
    settings = {node: dict(values) for node, values in parameters.items()}
    if robot is not None:
        for node in ("simulator", "controller"):
            settings[node][DESCRIPTION.name] = robot
    duration = as_float(settings["simulator"].get("duration", 0.0))
    if not duration:
        period = period_nanoseconds(int(as_float(settings["simulator"]["rate"])))
        duration = (int(recording.stamps_ns[-1] - recording.stamps_ns[0]) + period) / NANOSECONDS
    scenario, law = recording.scenario or "replay", str(settings["controller"]["law.name"])
    experiment = Experiment(scenario, law, duration, settings)
    _ = experiment.values
    return experiment


def new_parameters(parameters: Mapping[str, Mapping[str, Any]], experiment: Experiment) -> list[str]:
    """``NODE.PARAMETER`` of those that the experiment has and the result does not: their defaults were used."""
    return [
        f"{node}.{name}"
        for node, values in experiment.values.items()
        for name in values
        if name not in parameters[node]
    ]


def contradictions(parameters: Mapping[str, Mapping[str, Any]], others: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """``NODE.PARAMETER`` of those that two sources of one run have with different values."""
    return [
        f"{node}.{name}"
        for node, values in others.items()
        for name, value in values.items()
        if name in parameters.get(node, {}) and _plain(parameters[node][name]) != _plain(value)
    ]


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def agreement(recorded: Recording, again: Recording) -> Agreement:
    """Compare two recordings of the same joints bit for bit, where they have the same stamps."""
    _, ours, theirs = np.intersect1d(recorded.stamps_ns, again.stamps_ns, assume_unique=True, return_indices=True)
    here, there = _quantities(recorded), _quantities(again)
    found = [
        _difference(name, recorded, (values[ours], there[name][theirs]), ours)
        for name, values in here.items()
        if values[ours].tobytes() != there[name][theirs].tobytes()
    ]
    return Agreement(
        compared=tuple(here),
        samples=ours.size,
        lacking=again.time.size - ours.size,
        surplus=recorded.time.size - ours.size,
        differences=tuple(sorted(found, key=lambda each: each.sample)),
    )


def _quantities(recording: Recording) -> dict[str, Array]:
    """Everything that a simulation decides, in the order in which it does, shape (samples, joints or 1) each."""
    arrays = recording.arrays()
    effort = arrays.pop("effort")
    arrays.pop("error")  # Computed from the others.
    status = {place.name.lower(): recording.status[:, place, None].astype(np.float64) for place in Status}
    values = {**arrays, **status, "effort": effort}
    known = _OF_TRUTH if recording.lacking else values
    return {name: np.ascontiguousarray(each) for name, each in values.items() if name in known}


def _difference(name: str, recorded: Recording, values: tuple[Array, Array], rows: Any) -> Difference:
    """Where the values (that of the result first) of a quantity differ; `rows`: their samples in the result."""
    ours, theirs = (np.ascontiguousarray(each) for each in values)
    row, column = np.argwhere(ours.view(np.uint64) != theirs.view(np.uint64))[0]
    return Difference(
        quantity=name,
        joint=recorded.joints[column] if ours.shape[1] == len(recorded.joints) and name not in _STATUS else "",
        sample=int(rows[row]),
        time=float(recorded.time[rows[row]]),
        recorded=float(ours[row, column]),
        again=float(theirs[row, column]),
        largest=float(np.abs(ours - theirs).max()),
    )
