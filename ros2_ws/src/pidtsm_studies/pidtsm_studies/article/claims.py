"""Comparison of the article's printed evaluation (section 4) with a reproduction.

The article's numbers and statements are in claims.yaml; the project's are computed from its runs.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from pidtsm_core.recording import Recording
from pidtsm_core.written import NOTHING
from pidtsm_studies.article.measures import measure
from pidtsm_studies.article.printed import PRINTED
from pidtsm_studies.reports.labels import CASES, label, value_text

Run: TypeAlias = tuple[Recording, Mapping[str, Any]]
"""A recording and its metrics, as returned by `Recording.metrics`."""

Reproduction: TypeAlias = Mapping[tuple[str, str], Run | str]
"""Runs by (scenario, law); for a run that did not finish, the reason as a sentence."""

ARTICLE_LAWS = ("piddtsm", "pidnftsm", "dtsm")
"""In the article's order: the proposed law first."""

_JOINTS = (0, 1)
_NEARLY = 0.01  # relative difference of values that are "nearly the same"; the article gives none


@dataclass(frozen=True)
class Claim(ABC):
    """A statement or number of the article about one joint.

    Attributes:
        quantity: description, with the definition that the project uses.
        case: scenario.
        laws: the laws concerned, beginning with the one that is judged.
        joint: index, from 0.
        unit: unit of the metric, empty for a count.
        metric: name of the metric, see `measures.measure`.
        printed_in: place in the article.
        reason: why the project's value may differ, one or more sentences.
    """

    quantity: str
    case: str
    laws: tuple[str, ...]
    joint: int
    unit: str
    metric: str
    printed_in: str
    reason: str

    def compare(self, reproduction: Reproduction) -> "Comparison":
        """Compare the claim with the project's runs.

        Raises:
            KeyError: a run lacks the metric.
        """
        outcomes = {law: reproduction.get((self.case, law), "not run") for law in self.laws}
        missing = [f"{label(law)}: {outcome}" for law, outcome in outcomes.items() if isinstance(outcome, str)]
        metric = measure(self.metric)
        values = tuple(
            None if isinstance(outcome, str) else metric(*outcome, self.joint) for outcome in outcomes.values()
        )
        present = [value for value in values if value is not None]
        if len(present) < len(values):
            return Comparison(self, values, "; ".join(missing) or NOTHING, NOTHING, None)
        return Comparison(self, values, *self.judge(present))

    @abstractmethod
    def printed(self) -> str:
        """The article's value as shown in tables."""

    @abstractmethod
    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        """Judge the claim by the project's values.

        Args:
            values: one per law, in the order of `laws`.

        Returns:
            The project's value and its deviation, as shown in tables, and whether the claim holds.
        """

    def with_unit(self, text: str) -> str:
        """A value with the claim's unit, if it has one."""
        return f"{text} {self.unit}".rstrip()


@dataclass(frozen=True)
class Comparison:
    """A claim of the article compared with the project.

    Attributes:
        claim: the claim.
        values: the project's value for each law; None if it does not exist.
        project: the project's value as shown, with unit.
        deviation: deviation of the project from the article, as shown.
        holds: whether a statement or limit of the article is true for the project; None for numbers and without runs.
    """

    claim: Claim
    values: tuple[float | None, ...]
    project: str
    deviation: str
    holds: bool | None


@dataclass(frozen=True)
class Number(Claim):
    """A value of one law; `about` if the article gives it only approximately."""

    value: float
    about: bool = False

    def printed(self) -> str:
        return ("about " if self.about else "") + self.with_unit(value_text(self.value))

    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        if not math.isfinite(values[0]):
            return value_text(values[0]), NOTHING, None
        return self.with_unit(value_text(values[0])), f"{100.0 * (values[0] / self.value - 1.0):+.1f} %", None


@dataclass(frozen=True)
class Decrease(Claim):
    """By how much the first law's value is below the second's, %."""

    value: float

    def printed(self) -> str:
        return f"{self.value:g} % lower"

    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        own, other = values
        if not other > 0.0:
            return NOTHING, NOTHING, None
        decrease = 100.0 * (1.0 - own / other)
        return (
            f"{abs(decrease):.1f} % {'lower' if decrease >= 0.0 else 'higher'}",
            f"{decrease - self.value:+.1f} percentage points",
            None,
        )


@dataclass(frozen=True)
class Limit(Claim):
    """An upper limit for the values of all laws."""

    value: float

    def printed(self) -> str:
        return f"at most {self.with_unit(value_text(self.value))}"

    def judge(self, values: Sequence[float]) -> tuple[str, str, bool | None]:
        largest = max(values)
        holds = largest <= self.value
        return f"at most {self.with_unit(value_text(largest))}", _verdict(holds), holds


@dataclass(frozen=True)
class Order(Claim):
    """The first law's value is smaller (sign -1) or larger (sign 1) than those of all other laws."""

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
        holds = all(abs(value - values[0]) <= _NEARLY * abs(values[0]) for value in values)
        return self.with_unit(_each(self.laws, values)), _verdict(holds), holds


def _each(laws: Sequence[str], values: Sequence[float]) -> str:
    return ", ".join(f"{label(law)} {value_text(value)}" for law, value in zip(laws, values, strict=True))


def _verdict(holds: bool) -> str:
    return "as in the article" if holds else "not as in the article"


def claim_of(entry: Mapping[str, Any], joint: int) -> Claim:
    """The claim of an entry of claims.yaml for one joint.

    Args:
        entry: one of the claims in `PRINTED`.
        joint: index, from 0.

    Raises:
        ValueError: unknown kind of claim.
        KeyError: a key is missing.
    """
    common: dict[str, Any] = {
        "quantity": entry["quantity"],
        "case": entry["case"],
        "laws": tuple(entry["laws"]),
        "joint": joint,
        "unit": entry.get("unit", ""),
        "metric": entry["metric"],
        "printed_in": entry["printed_in"],
        "reason": PRINTED["reasons"][entry["reason"]],
    }
    match entry["kind"]:
        case "number":
            return Number(**common, value=entry["values"][joint], about=entry.get("about", False))
        case "decrease":
            return Decrease(**common, value=entry["values"][joint])
        case "limit":
            return Limit(**common, value=entry["values"][joint])
        case "order":
            return Order(**common, sign=entry["signs"][joint])
        case "same":
            return Same(**common)
        case kind:
            raise ValueError(f"claims.yaml: {entry['quantity']}: unknown kind of claim {kind}")


CLAIMS = tuple(claim_of(entry, joint) for entry in PRINTED["claims"] for joint in _JOINTS)
"""All claims of the article about its evaluation, in its order."""


def compare(reproduction: Reproduction) -> list[Comparison]:
    """Compare every claim with the project's runs, in the order of `CLAIMS`.

    Raises:
        KeyError: a run lacks the metric of a claim.
    """
    return [claim.compare(reproduction) for claim in CLAIMS]


def markdown(comparisons: Iterable[Comparison]) -> str:
    """The comparisons as a table in Markdown."""
    head = ("quantity", "case", "joint", "article", "project", "deviation", "why it may deviate", "printed in")
    lines = [head, ("---",) * len(head)]
    for each in comparisons:
        claim = each.claim
        place = (CASES[claim.case], str(claim.joint + 1))
        project = (claim.printed(), each.project, each.deviation)
        lines.append((claim.quantity, *place, *project, claim.reason, claim.printed_in))
    return "".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |\n" for line in lines)


def as_json(comparison: Comparison) -> dict[str, Any]:
    """A comparison for results.json; values that do not exist or are not finite are null."""
    claim = comparison.claim
    return {
        "what": claim.quantity,
        "case": claim.case,
        "laws": list(claim.laws),
        "joint": claim.joint,
        "article": claim.printed(),
        "project": comparison.project,
        "values": [value if value is not None and math.isfinite(value) else None for value in comparison.values],
        "deviation": comparison.deviation,
        "why": claim.reason,
    }


def printed_rmse(case: str) -> dict[str, list[float]]:
    """RMSE of both joints (rad) by law, if the article prints it or it follows from the article's percentages.

    Args:
        case: scenario.
    """
    rmse: dict[str, list[float]] = {}
    for claim in CLAIMS:
        if (claim.case, claim.metric) != (case, "rmse"):
            continue
        if isinstance(claim, Number):
            rmse.setdefault(claim.laws[0], []).append(claim.value)
        elif isinstance(claim, Decrease):
            own, other = claim.laws
            rmse.setdefault(other, []).append(rmse[own][claim.joint] / (1.0 - claim.value / 100.0))
    return rmse
