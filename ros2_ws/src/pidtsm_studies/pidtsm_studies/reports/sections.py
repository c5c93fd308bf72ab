"""Sections that pages of runs share: their content as plain data for the templates."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pidtsm_core.recording import Recording
from pidtsm_core.recording.metric import METRICS
from pidtsm_core.recording.outcome import what_happened
from pidtsm_core.written import NOTHING
from pidtsm_studies.reports.events import Event, events
from pidtsm_studies.reports.labels import Entry
from pidtsm_studies.reports.matrix import of_joints, of_runs
from pidtsm_studies.reports.page import Section
from pidtsm_studies.reports.viewer import Cases, case_name

_LAUNCHED = ("cli.py", "pidtsm")
"""Names under which the launcher starts the command line."""
_FIRST = 2
"""Number of matrices of several runs that are open; the others are folded."""


def section(name: str, heading: str, content: Any, folded: bool = False, template: str = "") -> Section:
    """A section with the template of its name, or another one."""
    return Section(name, heading, f"reports/templates/{template or name}.html", content, folded)


def events_of(
    cases: Cases, parameters: Mapping[tuple[str, str], Mapping[str, Mapping[str, Any]]]
) -> dict[tuple[str, str], list[Event]]:
    """The events of runs.

    Args:
        cases: the runs.
        parameters: by case and law or name, and by node, as far as they are known.
    """
    return {
        (case, key): events(*run, nodes.get("simulator", {}), nodes.get("controller", {}))
        for case, runs in cases.items()
        for key, run in runs.items()
        for nodes in (parameters.get((case, key), {}),)
    }


def happened_section(
    names: Mapping[tuple[str, str], str],
    metrics: Mapping[tuple[str, str], Mapping[str, Any]],
    happened: Mapping[tuple[str, str], list[Event]],
) -> Section:
    """Everything unusual in runs; the name of a single run is not shown."""
    content = [
        {
            "run": names[key] if len(metrics) > 1 else "",
            "events": [event.data() for event in happened[key]],
            "sentences": what_happened(each),
        }
        for key, each in metrics.items()
        if happened[key] or what_happened(each)
    ]
    return section("happened", "What happened", content, folded=True, template="events")


def made_section(runs: Mapping[str, Recording], commands: Mapping[str, Sequence[str]]) -> Section:
    """How runs were made: version, commit, command, seed and the gains of the law; what nobody knows is left out.

    Args:
        runs: by name; those of several are the columns.
        commands: words of the command that has made each, by name, as far as they are known.
    """
    known = [
        {
            "pidtsm": each.version,
            "commit": each.commit,
            "command": command_text(commands.get(name, ())),
            "seed": each.seed,
        }
        | {f"law.{gain}": value for gain, value in each.gains.items()}
        for name, each in runs.items()
    ]
    rows = {}
    for row in dict.fromkeys(row for each in known for row in each):
        values = [each.get(row) for each in known]
        if any(value not in (None, "") for value in values):
            rows[row] = [NOTHING if value in (None, "") else _text(value) for value in values]
    content = {"runs": list(runs) if len(runs) > 1 else ["value"], "rows": rows}
    return section("made", "How it was made", content if rows else None, folded=True)


def command_text(words: Sequence[str]) -> str:
    """A command as a user types it; empty if there is none."""
    if not words:
        return ""
    name = Path(words[0]).name
    return " ".join(shlex.quote(word) for word in ("./pidtsm" if name in _LAUNCHED else name, *words[1:]))


def _text(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def matrix_sections(cases: Cases, entries: Mapping[str, Entry], failures: list[str]) -> list[Section]:
    """The metrics: one matrix for a single run; else one for each metric and case, the first of which are open."""
    tables: list[dict[str, Any]] = []
    folded: list[dict[str, Any]] = []
    for case, runs in cases.items():
        metrics = {key: each for key, (_, each) in runs.items()}
        if len(metrics) == 1:
            label = next(iter(entries[key].label for key in metrics))
            tables.append(of_joints(next(iter(metrics.values())), f"{case_name(case)}, {label}"))
            continue
        for number, table in enumerate(_of_case(case, metrics, entries)):
            (tables if number < _FIRST else folded).append(table)
    first = {"tables": tables, "failures": failures}
    return [
        section("metrics", "Metrics", first if tables or failures else None, template="matrix"),
        section("more-metrics", "More metrics", {"tables": folded, "failures": []} if folded else None, True, "matrix"),
    ]


def _of_case(case: str, metrics: Mapping[str, Mapping[str, Any]], entries: Mapping[str, Entry]) -> list[dict[str, Any]]:
    labels = {key: entries[key].label for key in metrics}
    tables = [
        of_runs(metrics, metric, labels) for metric in METRICS if all(metric.key in each for each in metrics.values())
    ]
    return [{**table, "caption": f"{case_name(case)}: {table['caption']}"} for table in tables]
