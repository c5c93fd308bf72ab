"""What each controller bears: curves over single imperfections of the hardware, and scenarios against limits.

Everything is Case 1. A curve varies one imperfection and leaves all else ideal; a row of the table is a scenario of
imperfect hardware as a whole.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, TypeAlias

import numpy as np
from scipy.stats import binomtest

from pidtsm_core.batch import BatchResult, batch
from pidtsm_core.experiment import ARTICLE, PRACTICAL, Settings, make_experiment
from pidtsm_core.metrics import JointMetrics
from pidtsm_core.parameters import Array
from pidtsm_core.rollout import Rollout
from pidtsm_core.signals import Signal
from pidtsm_studies.reports.labels import label

LATE = 10.0
"""From when on a run is judged, s: the transient is over."""
TRACKING = 0.02
"""A run whose error reaches this after `LATE` has failed, rad."""
METRICS = ("rmse", "eci", "torque_variation", "late_error")
"""What curves show; `late_error` is the largest |e| after `LATE`, the others are those of `pidtsm_core.metrics`."""
BAND = (5.0, 50.0, 95.0)
"""Percentiles over the seeds: the band of a curve and, in between, the curve."""
CONFIDENCE = 0.95
"""Of the interval of a success rate (Wilson's)."""

_CASE = "case1"


@dataclass(frozen=True)
class Contender:
    """A controller that is tried.

    Attributes:
        name: in results.
        label: in tables and figures.
        law: name of the law.
        params: parameter sets, as of `make_experiment`.
        overrides: ``NODE.PARAMETER=VALUE``.
    """

    name: str
    label: str
    law: str
    params: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """What it is called where there is little room."""
        return self.name.replace("_", " ")

    def settings(self, scenario: str, overrides: Sequence[str] = ()) -> Settings:
        """Parameters of a run in this scenario."""
        every = (*self.overrides, *overrides)
        return make_experiment(scenario, self.law, None, self.params, every).without_node_parameters().settings


OBSERVER = Contender("practical", "PIDDTSM, practical: observer", "piddtsm", (PRACTICAL,))
FILTERED = Contender("article", "PIDDTSM, article: filtered difference", "piddtsm", (ARTICLE,))
DIFFERENTIATOR = Contender(
    "levant",
    "PIDDTSM, article: robust differentiator",
    "piddtsm",
    (ARTICLE,),
    ("controller.estimator.name=robust_differentiator",),
)
CONTENDERS = (
    OBSERVER,
    FILTERED,
    DIFFERENTIATOR,
    *(Contender(law, label(law), law, (ARTICLE,)) for law in ("pidnftsm", "dtsm")),
    *(Contender(law, label(law), law) for law in ("pid", "computed_torque", "super_twisting")),
)
"""In the order of legends. All but the observer's and the differentiator's use filtered differences, as the article."""
ESTIMATORS = tuple(c.name for c in (OBSERVER, FILTERED, DIFFERENTIATOR))
"""The proposed law with each estimator."""
LAWS = tuple(c.name for c in CONTENDERS if c not in (FILTERED, DIFFERENTIATOR))
"""The proposed law, the comparators and the baselines."""
LABELS = {c.name: c.label for c in CONTENDERS}


@dataclass(frozen=True)
class Imperfection:
    """One thing that is not ideal.

    Attributes:
        name: in results, and of the figure's files.
        what: it is, in words.
        unit: of the values; empty for a number.
        parameters: of the simulator; all get the value.
        values: the mildest first.
        random: whether the seed matters.
        logarithmic: axis of the values.
        beside: other parameters of the simulator.
    """

    name: str
    what: str
    unit: str
    parameters: tuple[str, ...]
    values: tuple[float, ...]
    random: bool = False
    logarithmic: bool = False
    beside: Mapping[str, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Of the axis."""
        return f"{self.what} ({self.unit})" if self.unit else self.what

    def settings(self, value: float) -> dict[str, float]:
        """Parameters of the simulator at this value."""
        return {**self.beside, **dict.fromkeys(self.parameters, value)}


def _between(first: float, last: float, number: int = 20) -> tuple[float, ...]:
    return tuple(float(f"{value:.3g}") for value in np.linspace(first, last, number))


def _decades(first: float, last: float, number: int = 20) -> tuple[float, ...]:
    return tuple(float(f"{value:.2g}") for value in np.geomspace(first, last, number))


IMPERFECTIONS = (
    Imperfection("encoder", "resolution of the encoders", "bits", ("encoder.bits",), tuple(range(26, 6, -1))),
    Imperfection(
        "noise",
        "noise of the position, standard deviation",
        "rad",
        ("noise.std",),
        _decades(1e-6, 3e-2),
        random=True,
        logarithmic=True,
    ),
    Imperfection("delay", "delay of the measurements", "ms", ("delay.samples",), (*range(10), *range(10, 60, 5))),
    Imperfection("dropout", "measurements lost", "share", ("dropout.probability",), _between(0.0, 0.95), random=True),
    Imperfection(
        "burst",
        "measurements lost in a row, about once a second",
        "",
        ("dropout.burst",),
        (1, 2, 3, 5, 7, 10, 15, 20, 25, 30, 40, 50, 60, 70, 80, 100, 120, 150, 200, 300),
        random=True,
        logarithmic=True,
        beside={"dropout.burst_rate": 1.0},
    ),
    Imperfection("lag", "time constant of the drives", "s", ("actuator.lag",), _between(0.0, 0.095)),
    Imperfection(
        "heavier",
        "masses and inertias above the model's",
        "share",
        ("model_error.mass", "model_error.inertia"),
        _between(0.0, 1.9),
    ),
    Imperfection(
        "lighter",
        "masses and inertias below the model's",
        "share",
        ("model_error.mass", "model_error.inertia"),
        _between(0.0, -0.95),
    ),
    Imperfection(
        "payload", "payload picked up at 5 s", "kg", ("payload.mass",), _between(0.0, 3.8), beside={"payload.time": 5.0}
    ),
    Imperfection("friction", "Coulomb friction", "N m", ("friction.coulomb",), _between(0.0, 19.0)),
)


@dataclass(frozen=True)
class Row:
    """Scenarios of imperfect hardware, and the limits for them.

    Attributes:
        label: in tables.
        runs: scenario and overrides of each variant; the worst of them counts.
        limits: at most, by the quantities of `QUANTITIES`.
        random: whether the seed matters.
    """

    label: str
    runs: tuple[tuple[str, tuple[str, ...]], ...]
    limits: Mapping[str, float]
    random: bool = False


QUANTITIES = {
    "rmse": "RMSE, relative",
    "eci": "ECI, relative",
    "late_error": "error after 10 s (rad)",
    "torque_variation": "torque variation (N m)",
}
"""Columns of the table: mean over the seeds (largest for the error), of the worse joint; relative to ideal hardware."""
_LIGHT = ("simulator.model_error.mass=-0.25", "simulator.model_error.inertia=-0.25")


def _limits(*values: float) -> dict[str, float]:
    return dict(zip(QUANTITIES, values, strict=True))


ROWS = (
    Row("17-bit encoder", (("encoder_17", ()),), _limits(1.01, 1.005, 4e-4, 0.05)),
    Row("14-bit encoder, 1 ms delay", (("encoder_14_delay", ()),), _limits(1.01, 1.005, 6e-4, 0.12)),
    Row("12-bit encoder, 1 ms delay", (("encoder_12_delay", ()),), _limits(1.02, 1.005, 1.5e-3, 0.30)),
    Row("noise of 1e-3 rad", (("noise", ()),), _limits(1.02, 1.005, 2e-3, 0.50), random=True),
    Row(
        "14-bit encoder, 1 ms delay, 5 % and bursts of 20 lost",
        (("loss", ()),),
        _limits(1.01, 1.005, 1e-3, 0.12),
        random=True,
    ),
    Row(
        "14-bit encoder, 1 ms delay, 10 ms lag, arm 25 % heavier or lighter",
        (("hard", ()), ("hard", _LIGHT)),
        _limits(1.10, math.inf, 1e-3, 0.25),
    ),
)
ROW_CONTENDERS = (OBSERVER, FILTERED)
"""Whose rows are measured: the set for real hardware, and the article's own."""


@dataclass(frozen=True)
class Curve:
    """A contender against an imperfection.

    Attributes:
        success: share of the runs whose error stays below `TRACKING` and whose torque is off its limits after `LATE`;
            shape (values,).
        interval: of that share, low and high, shape (2, values); nan where nothing is random.
        metrics: those of `METRICS`, percentiles `BAND` over the seeds, shape (3, values, joints); inf where a run
            left the finite numbers.
    """

    success: Array
    interval: Array
    metrics: Mapping[str, Array]

    @property
    def tolerated(self) -> int:
        """Number of values, from the mildest on, at which every run succeeded."""
        failed = np.flatnonzero(self.success < 1.0)
        return int(failed[0]) if failed.size else self.success.size


@dataclass(frozen=True)
class Judged:
    """A row of a contender.

    Attributes:
        values: measured, by quantity; inf where a run left the finite numbers.
        success: share of the runs that succeeded.
    """

    values: Mapping[str, float]
    success: float

    def met(self, row: Row) -> dict[str, bool]:
        """Whether each limit is kept."""
        return {name: self.values[name] <= limit for name, limit in row.limits.items()}


@dataclass(frozen=True)
class Effort:
    """How much is run.

    Attributes:
        seeds: for each value where something is random; elsewhere one run says as much.
        values: of each imperfection: how many, spread over all.
        duration: of each run, s; longer than `LATE`.
    """

    seeds: int
    values: int
    duration: float


FULL = Effort(seeds=20, values=20, duration=30.0)
QUICK = Effort(seeds=2, values=2, duration=11.0)


@dataclass(frozen=True)
class Robustness:
    """What was found.

    Attributes:
        effort: how much was run.
        runs: their number.
        diverged: number of runs that left the finite numbers; they count as failed.
        values: of each imperfection.
        curves: by imperfection and contender.
        rows: by place in `ROWS` and contender.
    """

    effort: Effort
    runs: int
    diverged: int
    values: Mapping[str, tuple[float, ...]]
    curves: Mapping[str, Mapping[str, Curve]]
    rows: Sequence[Mapping[str, Judged]]

    def met(self) -> int:
        """How many rows the practical set meets in full."""
        return sum(all(judged[OBSERVER.name].met(row).values()) for row, judged in zip(ROWS, self.rows, strict=True))


_Place: TypeAlias = tuple[str, str, int]
"""Contender, imperfection (or row), number of the value (or variant)."""


def measure(effort: Effort, progress: Callable[[int, int], None]) -> Robustness:
    """Roll everything out, on all cores.

    Args:
        effort: how much to run.
        progress: called now and then with the number of runs done and the number of all.
    """
    values = {imperfection.name: _chosen(imperfection.values, effort.values) for imperfection in IMPERFECTIONS}
    places, settings = _plan(values, effort.seeds)
    result = batch(settings, effort.duration, progress=lambda done: progress(done, len(settings)), measure=_late)
    runs: dict[_Place, list[int]] = {}
    for number, place in enumerate(places):
        runs.setdefault(place, []).append(number)
    found = _Found(result, runs)
    return Robustness(
        effort=effort,
        runs=len(settings),
        diverged=len(result.failed),
        values=values,
        curves={
            imperfection.name: {
                contender.name: found.curve(contender, imperfection, len(values[imperfection.name]))
                for contender in CONTENDERS
            }
            for imperfection in IMPERFECTIONS
        },
        rows=[{contender.name: found.judged(contender, row) for contender in ROW_CONTENDERS} for row in ROWS],
    )


def as_json(robustness: Robustness) -> dict[str, Any]:
    """The content of robustness.json; what does not exist, or is not finite, is null."""
    return {
        "effort": asdict(robustness.effort),
        "runs": robustness.runs,
        "diverged": robustness.diverged,
        "success": {"after": LATE, "error": TRACKING, "confidence": CONFIDENCE},
        "percentiles": list(BAND),
        "contenders": {c.name: {"label": c.label, "settings": c.settings(_CASE)["controller"]} for c in CONTENDERS},
        "rows": [
            {
                "row": row.label,
                "scenarios": [{"scenario": scenario, "set": list(overrides)} for scenario, overrides in row.runs],
                "limits": {name: _plain(limit) for name, limit in row.limits.items()},
                "contenders": {
                    name: {
                        "values": {quantity: _plain(value) for quantity, value in each.values.items()},
                        "success": each.success,
                        "met": each.met(row),
                    }
                    for name, each in judged.items()
                },
            }
            for row, judged in zip(ROWS, robustness.rows, strict=True)
        ],
        "imperfections": {
            imperfection.name: {
                "label": imperfection.label,
                "parameters": list(imperfection.parameters),
                "beside": dict(imperfection.beside),
                "values": list(robustness.values[imperfection.name]),
                "seeds": robustness.effort.seeds if imperfection.random else 1,
                "contenders": {
                    name: {
                        "tolerated": curve.tolerated,
                        "success": _plain(curve.success),
                        "interval": _plain(curve.interval),
                        "metrics": {metric: _plain(table) for metric, table in curve.metrics.items()},
                    }
                    for name, curve in robustness.curves[imperfection.name].items()
                },
            }
            for imperfection in IMPERFECTIONS
        },
    }


def combined(metric: str, values: Array) -> Array:
    """Both joints in one number for figures: root of the sum of squares, sum, or the larger.

    Args:
        metric: one of `METRICS`.
        values: shape (..., joints).
    """
    if metric == "rmse":
        return np.asarray(np.sqrt(np.sum(values**2, axis=-1)))
    return np.asarray(np.max(values, axis=-1) if metric == "late_error" else np.sum(values, axis=-1))


def tolerance(robustness: Robustness, imperfection: Imperfection, contender: str) -> str:
    """Up to which value, from the mildest on, every run of a contender succeeded, for a table."""
    values = robustness.values[imperfection.name]
    tolerated = robustness.curves[imperfection.name][contender].tolerated
    if tolerated == len(values):
        return "all"
    return f"{values[tolerated - 1]:g}" if tolerated else "none"


def measured_text(value: float) -> str:
    """A measured value of a row, for a table."""
    return f"{value:.4g}" if math.isfinite(value) else "diverged"


def _plan(values: Mapping[str, Sequence[float]], seeds: int) -> tuple[list[_Place], list[Settings]]:
    """Every run: where it belongs, and its parameters."""
    places: list[_Place] = []
    settings: list[Settings] = []

    def add(place: _Place, common: Settings, random: bool, more: Mapping[str, float] | None = None) -> None:
        for seed in range(seeds if random else 1):
            places.append(place)
            settings.append({**common, "simulator": {**common["simulator"], **(more or {}), "seed": seed}})

    for contender in CONTENDERS:
        ideal = contender.settings(_CASE)
        for imperfection in IMPERFECTIONS:
            for number, value in enumerate(values[imperfection.name]):
                place = (contender.name, imperfection.name, number)
                add(place, ideal, imperfection.random, imperfection.settings(value))
    for contender in ROW_CONTENDERS:
        add((contender.name, _CASE, 0), contender.settings(_CASE), random=False)
        for row in ROWS:
            for number, (scenario, overrides) in enumerate(row.runs):
                add((contender.name, row.label, number), contender.settings(scenario, overrides), row.random)
    return places, settings


def _chosen(values: Sequence[float], number: int) -> tuple[float, ...]:
    """So many of the values, spread evenly, with the first and the last."""
    return tuple(values[round(place)] for place in np.linspace(0, len(values) - 1, min(number, len(values))))


def _late(run: Rollout) -> JointMetrics:
    """What decides on success, per joint: the largest |e| after `LATE`, and the share of its samples at a limit."""
    late = run.time >= LATE
    error = np.abs(run.position[late] - run.reference[late, 0])
    limited = run.signals[late, Signal.SATURATED] != 0.0
    return {"late_error": error.max(axis=0).tolist(), "late_saturation": limited.mean(axis=0).tolist()}


@dataclass(frozen=True)
class _Found:
    """What the runs gave, and which run is where."""

    result: BatchResult
    runs: Mapping[_Place, Sequence[int]]

    def of(self, metric: str, place: _Place) -> Array:
        """A metric of the runs of a place, shape (runs, joints); inf for a run that left the finite numbers."""
        values = self.result.metrics[metric][self.runs[place]]
        return np.where(np.isnan(values), np.inf, values)

    def succeeded(self, place: _Place) -> Array:
        """Whether each run of a place succeeded, shape (runs,)."""
        tracks = self.of("late_error", place) < TRACKING
        return np.asarray((tracks & (self.of("late_saturation", place) == 0.0)).all(axis=1))

    def curve(self, contender: Contender, imperfection: Imperfection, values: int) -> Curve:
        places = [(contender.name, imperfection.name, number) for number in range(values)]
        successes = [self.succeeded(place) for place in places]
        intervals = [_interval(each) if imperfection.random else (np.nan, np.nan) for each in successes]
        return Curve(
            success=np.array([each.mean() for each in successes]),
            interval=np.array(intervals).T,
            metrics={
                metric: np.stack(
                    # Percentiles that are a run's: nothing is interpolated towards inf.
                    [np.percentile(self.of(metric, place), BAND, axis=0, method="inverted_cdf") for place in places],
                    axis=1,
                )
                for metric in METRICS
            },
        )

    def judged(self, contender: Contender, row: Row) -> Judged:
        places = [(contender.name, row.label, number) for number in range(len(row.runs))]
        ideal = (contender.name, _CASE, 0)

        def worst(metric: str, relative: bool = False) -> float:
            means = [self.of(metric, place).mean(axis=0) for place in places]
            return float(np.max(means / self.of(metric, ideal)[0] if relative else means))

        return Judged(
            values={
                "rmse": worst("rmse", relative=True),
                "eci": worst("eci", relative=True),
                "late_error": max(float(self.of("late_error", place).max()) for place in places),
                "torque_variation": worst("torque_variation"),
            },
            success=float(np.concatenate([self.succeeded(place) for place in places]).mean()),
        )


def _interval(succeeded: Array) -> tuple[float, float]:
    interval = binomtest(int(succeeded.sum()), succeeded.size).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


def _plain(values: float | Array) -> Any:
    """For JSON: lists of numbers, None where one is not finite."""
    array = np.asarray(values, dtype=np.float64)
    table: Any = array.astype(object)
    table[~np.isfinite(array)] = None
    return table.tolist()
