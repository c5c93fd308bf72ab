"""Which scores stand in one table: those of one arm on one base, with sets of gains that are made alike."""

from collections.abc import Sequence

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import TUNED
from pidtsm_studies.score.intervals import Difference, paired
from pidtsm_studies.score.measure import ORACLE
from pidtsm_studies.score.plan import CONTROL
from pidtsm_studies.score.results import Entry
from pidtsm_studies.score.tasks import ON_HARDWARE
from pidtsm_studies.score.wording import arm_of


def by_arm(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """Entries by table, the best score first; the oracle and the control row stand in every table of their arm."""
    references = [each for each in entries if is_reference(each)]
    tables: dict[str, list[Entry]] = {}
    for entry in entries:
        if not is_reference(entry):
            tables.setdefault(table_of(entry), []).append(entry)
    for entry in references:
        names = [name for name, rows in tables.items() if place_of(rows[0]) == place_of(entry)]
        for name in names or [place_of(entry)]:
            tables.setdefault(name, []).append(entry)
    return {name: sorted(rows, key=lambda entry: -entry.score) for name, rows in sorted(tables.items())}


def is_reference(entry: Entry) -> bool:
    """Whether an entry is the oracle or the control row."""
    return entry.name in (ORACLE, CONTROL)


def place_of(entry: Entry) -> str:
    """The arm, and on hardware its class."""
    return "-".join([arm_of(entry), *([str(entry.task.hardware)] if entry.task.hardware else [])])


def table_of(entry: Entry) -> str:
    """The table of an entry: sets that come along tuned stand apart, as each was made with another effort."""
    tuned = any(name.startswith(TUNED) for name in entry.params)
    return f"{place_of(entry)}-tuned" if tuned else place_of(entry)


def ceiling(rows: Sequence[Entry]) -> Entry | None:
    """The oracle of a table; None: it has none."""
    return next((each for each in rows if each.name == ORACLE), None)


def rivals(rows: Sequence[Entry]) -> list[Entry]:
    """The rows of a table that compete: all but the oracle and the control row, if there are others."""
    return [each for each in rows if not is_reference(each)] or list(rows)


def behind_the_best(entry: Entry, rows: Sequence[Entry]) -> Difference | None:
    """The score of the best controller of a table minus that of an entry, by the same runs.

    None if there is nothing to compare: on ideal hardware, for the oracle, for the best itself.
    """
    first = rivals(rows)[0]
    if entry.task.base != ON_HARDWARE or is_reference(entry) or entry is first:
        return None
    (best, weights), (own, _) = (_runs(each) for each in (first, entry))
    return paired(best, own, weights)


def _runs(entry: Entry) -> tuple[Array, Array]:
    """What each run of a score reaches, from 0 to 1, and its weight in the score, shape (runs,) each."""
    shares, weights = [], []
    for outcome in entry.outcomes:
        for curve in outcome.curves:
            reached = np.array(curve.met).ravel() / curve.levels
            shares.append(reached)
            weights.append(np.full(reached.size, 1.0 / (reached.size * len(outcome.curves) * len(entry.outcomes))))
    return np.concatenate(shares), np.concatenate(weights)
