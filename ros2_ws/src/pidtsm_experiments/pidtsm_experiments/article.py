"""What the article prints about its evaluation (section 4), beside what a reproduction gives.

Only the article's numbers and statements are written here. The project's are computed from the runs at hand.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from pidtsm_core.metrics import STEADY_SHARE
from pidtsm_experiments.recording import Recording

Run: TypeAlias = tuple[Recording, Mapping[str, Any]]
"""A recording and its metrics, as `analysis.summarize` gives them."""

Reproduction: TypeAlias = Mapping[tuple[str, str], Run | str]
"""Runs by (scenario, law); a run that did not come to its end is the sentence that says why."""

Metric: TypeAlias = Callable[[Recording, Mapping[str, Any], int], float | None]
"""One number of one joint of a run: None where it does not exist, inf for a time that the run did not reach."""

ARTICLE_LAWS = ("piddtsm", "pidnftsm", "dtsm")
LABELS = {
    "piddtsm": "PIDDTSM",
    "pidnftsm": "PIDNFTSM",
    "dtsm": "DTSM",
    "pid": "PID",
    "computed_torque": "computed torque",
    "super_twisting": "super-twisting",
    "dtsm_printed": "DTSM, printed kappa",
}
"""How laws are called in tables and figures, in their order."""

CASES = {"case1": "Case 1", "case2": "Case 2"}
JOINTS = ("joint 1", "joint 2")
NOTHING = "–"
"""What tables show for a value that does not exist."""


def label(law: str) -> str:
    """How a law is called in tables and figures."""
    return LABELS.get(law, law.replace("_", " "))


def law_numbers(laws: Iterable[str]) -> dict[str, int]:
    """The number of each law's style (`figures.COLOURS`, `figures.DASHES`), in the order of legends.

    A law of `LABELS` has the same one everywhere; others get those that are left.
    """
    order = {law: number for number, law in enumerate(LABELS)}
    laws = sorted(set(laws), key=lambda law: (order.get(law, len(order)), law))
    free = [number for law, number in order.items() if law not in laws] or [0]
    unknown = [law for law in laws if law not in order]
    return {law: order[law] if law in order else free[unknown.index(law) % len(free)] for law in laws}


def number_text(value: float | None, digits: int = 5) -> str:
    """A number for a table."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "not within the run"
    return f"{value:.{digits}g}"


@dataclass(frozen=True)
class Row:
    """A line of the comparison.

    Attributes:
        what: the quantity, with the definition that the project uses.
        case: scenario.
        laws: which laws it is about, the one judged first.
        joint: number, from 0.
        article, project: as shown, with unit.
        values: the project's number of each law; None where it does not exist.
        deviation: of the project from the article, as shown.
        holds: whether a statement or limit of the article is true of the project; None for numbers and without runs.
        where: where the article prints it.
        why: what may make the project's value another.
    """

    what: str
    case: str
    laws: tuple[str, ...]
    joint: int
    article: str
    project: str
    values: tuple[float | None, ...]
    deviation: str
    holds: bool | None
    where: str
    why: str


@dataclass(frozen=True)
class Claim(ABC):
    """Something that the article prints; attributes as in `Row`.

    Attributes:
        unit: of the metric, empty for a count.
        metric: what it is about, of one run and joint.
    """

    what: str
    case: str
    laws: tuple[str, ...]
    joint: int
    unit: str
    where: str
    why: str
    metric: Metric

    def row(self, reproduction: Reproduction) -> Row:
        """The claim beside the project's runs."""
        outcomes = [reproduction.get((self.case, law), "not run") for law in self.laws]
        texts = [
            f"{label(law)}: {text}" for law, text in zip(self.laws, outcomes, strict=True) if isinstance(text, str)
        ]
        values = tuple(None if isinstance(o, str) else self.metric(o[0], o[1], self.joint) for o in outcomes)
        project, deviation, holds = "; ".join(texts) or NOTHING, NOTHING, None
        known = [value for value in values if value is not None]
        if len(known) == len(values):
            project, deviation, holds = self.judge(known)
        article = self.printed()
        return Row(
            self.what,
            self.case,
            self.laws,
            self.joint,
            article,
            project,
            values,
            deviation,
            holds,
            self.where,
            self.why,
        )

    @abstractmethod
    def printed(self) -> str:
        """The article's value as a table shows it."""

    @abstractmethod
    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        """The project's value and the deviation as a table shows them, and whether it holds; one value a law."""

    def with_unit(self, text: str) -> str:
        return f"{text} {self.unit}".rstrip()


@dataclass(frozen=True)
class Number(Claim):
    """A value of one law."""

    article: float
    about: bool = False

    def printed(self) -> str:
        return ("about " if self.about else "") + self.with_unit(number_text(self.article))

    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        if not math.isfinite(values[0]):
            return number_text(values[0]), NOTHING, None
        return self.with_unit(number_text(values[0])), f"{100.0 * (values[0] / self.article - 1.0):+.1f} %", None


@dataclass(frozen=True)
class Decrease(Claim):
    """By how much the first law's value is below the second's, %."""

    article: float

    def printed(self) -> str:
        return f"{self.article:g} % lower"

    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        own, other = values
        if not other > 0.0:
            return NOTHING, NOTHING, None
        decrease = 100.0 * (1.0 - own / other)
        return f"{abs(decrease):.1f} % {'lower' if decrease >= 0.0 else 'higher'}", self._points(decrease), None

    def _points(self, decrease: float) -> str:
        return f"{decrease - self.article:+.1f} percentage points"


@dataclass(frozen=True)
class Limit(Claim):
    """What no law's value is above."""

    article: float

    def printed(self) -> str:
        return f"at most {self.with_unit(number_text(self.article))}"

    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        largest = max(values)
        holds = largest <= self.article
        return f"at most {self.with_unit(number_text(largest))}", _verdict(holds), holds


@dataclass(frozen=True)
class Order(Claim):
    """How the first law compares with each of the others: `sign` is -1 for smaller, 1 for larger."""

    sign: int

    def printed(self) -> str:
        others = " and ".join(label(law) for law in self.laws[1:])
        return f"{label(self.laws[0])} {'smaller' if self.sign < 0 else 'larger'} than {others}"

    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        holds = all(self.sign * (values[0] - other) > 0.0 for other in values[1:])
        return self.with_unit(_each(self.laws, values)), _verdict(holds), holds


@dataclass(frozen=True)
class Same(Claim):
    """Values that are nearly the same: within 1 % of the first law's."""

    def printed(self) -> str:
        return " and ".join(label(law) for law in self.laws) + " nearly the same"

    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        holds = all(abs(value - values[0]) <= 0.01 * abs(values[0]) for value in values)
        return self.with_unit(_each(self.laws, values)), _verdict(holds), holds


def _each(laws: Sequence[str], values: Sequence[float]) -> str:
    return ", ".join(f"{label(law)} {number_text(value)}" for law, value in zip(laws, values, strict=True))


def _verdict(holds: bool) -> str:
    return "as in the article" if holds else "not as in the article"


def compare(reproduction: Reproduction) -> list[Row]:
    """Everything that the article prints about its evaluation, beside the project's runs."""
    return [claim.row(reproduction) for claim in CLAIMS]


def markdown(rows: Iterable[Row]) -> str:
    """The comparison as a table in Markdown."""
    head = ("quantity", "case", "joint", "article", "project", "deviation", "why it may deviate", "printed in")
    lines = [head, ("---",) * len(head)]
    for row in rows:
        place = (CASES[row.case], str(row.joint + 1))
        lines.append((row.what, *place, row.article, row.project, row.deviation, row.why, row.where))
    return "".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |\n" for line in lines)


def printed_rmse(case: str) -> dict[str, list[float]]:
    """RMSE of both joints (rad) by law, as far as the article has it: printed, or following from its percentages."""
    rmse: dict[str, list[float]] = {}
    for claim in CLAIMS:
        if claim.case == case and claim.metric is _RMSE and isinstance(claim, Number):
            rmse.setdefault(claim.laws[0], []).append(claim.article)
        if claim.case == case and claim.metric is _RMSE and isinstance(claim, Decrease):
            own, other = claim.laws
            rmse.setdefault(other, []).append(rmse[own][claim.joint] / (1.0 - claim.article / 100.0))
    return rmse


def _of_metrics(key: str) -> Metric:
    def metric(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
        value: float | None = metrics[key][joint]
        return value

    return metric


def _time_of_metrics(key: str) -> Metric:
    def metric(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
        if key not in metrics:
            return None
        value = metrics[key][joint]
        return math.inf if value is None else value

    return metric


def _time_below(thresholds: Sequence[float]) -> Metric:
    """From the first sample until |e| (rad) stays below the joint's threshold, s."""

    def metric(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
        above = np.flatnonzero(np.abs(recording.error[:, joint]) >= thresholds[joint])
        first = above[-1] + 1 if above.size else 0
        return float(recording.time[first] - recording.time[0]) if first < recording.time.size else math.inf

    return metric


def _largest_torque(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    return float(np.abs(recording.effort[:, joint]).max())


def _largest_error_time(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    return float(recording.time[np.abs(recording.error[:, joint]).argmax()] - recording.time[0])


def _overshoot(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """The largest error on the other side of zero than the start, within the article's 6 s of transient, rad."""
    error = recording.error[recording.time - recording.time[0] <= TRANSIENT, joint]
    return float(max(0.0, (-np.sign(error[0]) * error).max()))


def _fluctuation(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Mean change of the error from sample to sample over the last 40 % of the run, rad."""
    return float(np.abs(np.diff(recording.error[_steady(recording), joint])).mean())


def _steady_torque(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """Median |tau| over the last 40 % of the run, N m: what spikes do not move."""
    return float(np.median(np.abs(recording.effort[_steady(recording), joint])))


def _error_after_event(recording: Recording, metrics: Mapping[str, Any], joint: int) -> float | None:
    """The largest |e| from the event on, rad."""
    if recording.event_time is None:
        return None
    return float(np.abs(recording.error[recording.time >= recording.event_time, joint]).max(initial=0.0))


def _steady(recording: Recording) -> slice:
    return slice(int(recording.time.size * (1.0 - STEADY_SHARE)), None)


# Reasons. What the project measures belongs in notes, which are given to the report.
_OF_THE_START = (
    "The RMSE is that of the start, where the errors are 0.4 and 0.1 rad and a torque can be at its limit. The article "
    "does not say what the integrals do meanwhile (here they go on: no anti-windup), nor how q' and q'' are had "
    "(here from filtered differences of the measured position, as Remark 4 has it, instead of exact derivatives). "
    "Eq. (53) can be read in two ways; here it is the root of the mean of the squared error."
)
_OF_THE_LOAD = (
    "As in Case 1. What the load step adds depends on upsilon, u_s and xi, which the article does not give: they "
    "decide how much adaptive gain there is when the load comes."
)
_OF_THE_DEAD_ZONE = (
    "The adaptation only drives |sigma| below upsilon, which the article does not give, and leaves the error that "
    "follows from it. The article's solver, ode45, controls its error by a relative tolerance that it does not print "
    "either (1e-3 by default); here the arm is integrated by Runge-Kutta steps of 1 ms."
)
_OF_THE_TRANSIENT = (
    "The article contradicts itself: about 6 s of transient, and about 4 s to the region of the steady-state error in "
    "the same paragraph. It defines neither, so the project says what it measures. The end of such a time is where a "
    "slowly falling error crosses a threshold, and moves much with the threshold."
)
_OF_THE_SINGULARITY = (
    "|e'|^(1-p/q) of PIDNFTSM is unbounded at e' = 0. How large its spikes are, and what they add to the error, is a "
    "matter of the solver: ode45 shortens its steps there, while here the torque is held for 1 ms and limited. Beside "
    "the spikes the two loops have the same gains and the same reaching law, and differ little."
)
_OF_KAPPA = (
    "DTSM needs another kappa than Table 1 prints (see the notes), and the article does not say which one it used. "
    "Without the PID manifold sigma is s, which starts far from zero, and kappa decides how fast the gain grows then."
)
_OF_GRAVITY = (
    "Nearly all of the ECI is the torque that holds the arm against gravity, which every law must give. What differs "
    "is the first second and the switching, parts in a thousand: the sign of so small a difference turns on the start, "
    "the anti-windup and the solver, of which the article says nothing."
)
_OF_RECOVERY = (
    "The article does not define when a joint has recovered; here it is when |e| stays below 1e-3 rad. The time "
    "depends on upsilon and on the adaptive gain when the load comes, which only the adaptation before it decides."
)
_OF_LIMITS = "None expected: the simulator limits the applied torque as Remark 8 says."

TRANSIENT = 6.0
"""Transient time that the article prints, s."""

STEADY_STATE_ERROR = (7e-4, 2e-5)
"""Steady-state error of PIDDTSM that the article prints, rad, both joints."""

_RMSE, _ECI = _of_metrics("rmse"), _of_metrics("eci")
_STEADY_STATE = _of_metrics("steady_state_error")
_RECOVERY = _time_of_metrics("recovery_time")


def _per_joint(
    kind: Callable[..., Claim],
    what: str,
    case: str,
    laws: tuple[str, ...],
    unit: str,
    metric: Metric,
    where: str,
    why: str,
    article: Sequence[float] = (),
    sign: Sequence[int] = (),
    **more: Any,
) -> list[Claim]:
    """The same claim of both joints, with each joint's own value or sign."""
    own = [
        {**more, **({"article": article[joint]} if article else {}), **({"sign": sign[joint]} if sign else {})}
        for joint in range(len(JOINTS))
    ]
    return [kind(what, case, laws, joint, unit, where, why, metric, **values) for joint, values in enumerate(own)]


_PROPOSED = ("piddtsm",)
_AGAINST_PIDNFTSM = ("piddtsm", "pidnftsm")
_AGAINST_DTSM = ("piddtsm", "dtsm")
_SMALLER, _LARGER = (-1, -1), (1, 1)
_CASE_1, _CASE_2 = "section 4, Case 1", "section 4, Case 2"

CLAIMS: tuple[Claim, ...] = (
    *_per_joint(
        Number, "RMSE", "case1", _PROPOSED, "rad", _RMSE, f"{_CASE_1}, Figure 5", _OF_THE_START, (0.03808, 0.00889)
    ),
    *_per_joint(
        Order, "RMSE", "case1", ARTICLE_LAWS, "rad", _RMSE, f"{_CASE_1}, Figure 5", _OF_THE_SINGULARITY, sign=_SMALLER
    ),
    *_per_joint(
        Decrease,
        "RMSE against PIDNFTSM",
        "case1",
        _AGAINST_PIDNFTSM,
        "rad",
        _RMSE,
        f"{_CASE_1}, below eq. (53)",
        _OF_THE_SINGULARITY,
        (25.0, 46.0),
    ),
    *_per_joint(
        Decrease,
        "RMSE against DTSM",
        "case1",
        _AGAINST_DTSM,
        "rad",
        _RMSE,
        f"{_CASE_1}, below eq. (53)",
        _OF_KAPPA,
        (50.0, 65.0),
    ),
    *_per_joint(
        Number,
        "steady-state error, max |e| over the last 40 % of the run",
        "case1",
        _PROPOSED,
        "rad",
        _STEADY_STATE,
        f"{_CASE_1}, on Figure 4",
        _OF_THE_DEAD_ZONE,
        STEADY_STATE_ERROR,
    ),
    *_per_joint(
        Order,
        "steady-state error, max |e| over the last 40 % of the run",
        "case1",
        ARTICLE_LAWS,
        "rad",
        _STEADY_STATE,
        f"{_CASE_1}, on Figure 4",
        _OF_THE_DEAD_ZONE,
        sign=_SMALLER,
    ),
    *_per_joint(
        Number,
        "transient time, until |e| stays below 2 % of its start",
        "case1",
        _PROPOSED,
        "s",
        _time_of_metrics("settling_time"),
        f"{_CASE_1}, on Figure 3",
        _OF_THE_TRANSIENT,
        (TRANSIENT, TRANSIENT),
        about=True,
    ),
    *_per_joint(
        Number,
        "time to steady state, until |e| stays below the article's steady-state error",
        "case1",
        _PROPOSED,
        "s",
        _time_below(STEADY_STATE_ERROR),
        f"{_CASE_1}, on Figure 4",
        _OF_THE_TRANSIENT,
        (4.0, 4.0),
        about=True,
    ),
    *_per_joint(
        Order,
        "transient time, until |e| stays below 2 % of its start",
        "case1",
        ARTICLE_LAWS,
        "s",
        _time_of_metrics("settling_time"),
        f"{_CASE_1}, on Figure 3",
        _OF_THE_TRANSIENT,
        sign=_SMALLER,
    ),
    *_per_joint(
        Order,
        "overshoot in the first 6 s",
        "case1",
        ("pidnftsm", "piddtsm", "dtsm"),
        "rad",
        _overshoot,
        f"{_CASE_1}, on Figure 3",
        _OF_KAPPA,
        sign=_LARGER,
    ),
    *_per_joint(
        Order,
        "fluctuation of the error, its mean change from sample to sample over the last 40 % of the run",
        "case1",
        ARTICLE_LAWS,
        "rad",
        _fluctuation,
        f"{_CASE_1}, on Figure 4",
        _OF_THE_SINGULARITY,
        sign=_SMALLER,
    ),
    *_per_joint(
        Limit,
        "time of the largest error, in the initial stage",
        "case1",
        ARTICLE_LAWS,
        "s",
        _largest_error_time,
        f"{_CASE_1}, on Figure 4",
        "None expected: the arm starts away from the reference. Initial stage is taken as the 6 s of transient.",
        (TRANSIENT, TRANSIENT),
    ),
    *_per_joint(
        Limit,
        "largest applied torque",
        "case1",
        ARTICLE_LAWS,
        "N m",
        _largest_torque,
        f"Remark 8, and {_CASE_1}, Figure 6",
        _OF_LIMITS,
        (100.0, 50.0),
    ),
    *_per_joint(
        Order,
        "oscillation of the torque, its mean change from sample to sample",
        "case1",
        ARTICLE_LAWS,
        "N m",
        _of_metrics("torque_variation"),
        f"{_CASE_1}, Figure 6",
        _OF_THE_SINGULARITY,
        sign=_SMALLER,
    ),
    *_per_joint(
        Order,
        "ECI, mean |torque|",
        "case1",
        _AGAINST_PIDNFTSM,
        "N m",
        _ECI,
        f"{_CASE_1}, Figure 7",
        _OF_GRAVITY,
        sign=_SMALLER,
    ),
    *_per_joint(
        Order,
        "ECI, mean |torque|",
        "case1",
        _AGAINST_DTSM,
        "N m",
        _ECI,
        f"{_CASE_1}, Figure 7",
        _OF_GRAVITY,
        sign=(-1, 1),
    ),
    *_per_joint(
        Number, "RMSE", "case2", _PROPOSED, "rad", _RMSE, f"{_CASE_2}, Figure 10", _OF_THE_LOAD, (0.03827, 0.00903)
    ),
    *_per_joint(
        Order, "RMSE", "case2", ARTICLE_LAWS, "rad", _RMSE, f"{_CASE_2}, Figure 10", _OF_THE_SINGULARITY, sign=_SMALLER
    ),
    *_per_joint(
        Number,
        "recovery from the load step, until |e| stays below 1e-3 rad",
        "case2",
        _PROPOSED,
        "s",
        _RECOVERY,
        f"{_CASE_2}, on Figures 8 and 9",
        _OF_RECOVERY,
        (4.0, 4.0),
        about=True,
    ),
    *_per_joint(
        Order,
        "recovery from the load step, until |e| stays below 1e-3 rad",
        "case2",
        ARTICLE_LAWS,
        "s",
        _RECOVERY,
        f"{_CASE_2}, on Figures 8 and 9",
        _OF_RECOVERY,
        sign=_SMALLER,
    ),
    *_per_joint(
        Order,
        "recovery from the load step, until |e| stays below 1e-3 rad: DTSM is unsatisfactory",
        "case2",
        ("dtsm", "pidnftsm", "piddtsm"),
        "s",
        _RECOVERY,
        f"{_CASE_2}, on Figures 8 and 9",
        _OF_KAPPA,
        sign=_LARGER,
    ),
    *_per_joint(
        Order,
        "largest |e| after the load step",
        "case2",
        ARTICLE_LAWS,
        "rad",
        _error_after_event,
        f"{_CASE_2}, on Figures 8 and 9",
        _OF_THE_LOAD,
        sign=_SMALLER,
    ),
    *_per_joint(
        Limit,
        "largest applied torque",
        "case2",
        ARTICLE_LAWS,
        "N m",
        _largest_torque,
        f"Remark 8, and {_CASE_2}, Figure 11",
        _OF_LIMITS,
        (100.0, 50.0),
    ),
    *_per_joint(
        Order,
        "sudden increases of the torque, samples at which it changes by more than 5 N m",
        "case2",
        ("pidnftsm", "piddtsm"),
        "",
        _of_metrics("torque_jumps"),
        f"{_CASE_2}, Figure 11",
        _OF_THE_SINGULARITY,
        sign=_LARGER,
    ),
    *_per_joint(
        Same,
        "torque in the steady state, median over the last 40 % of the run",
        "case2",
        _AGAINST_PIDNFTSM,
        "N m",
        _steady_torque,
        f"{_CASE_2}, Figure 11",
        _OF_GRAVITY,
    ),
    *_per_joint(
        Order,
        "ECI, mean |torque|",
        "case2",
        _AGAINST_PIDNFTSM,
        "N m",
        _ECI,
        f"{_CASE_2}, Figure 12",
        _OF_GRAVITY,
        sign=_SMALLER,
    ),
)
"""Everything that the article prints about its evaluation, in its order."""
