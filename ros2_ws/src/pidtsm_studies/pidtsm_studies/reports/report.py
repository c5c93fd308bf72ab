"""The report of a run or a reproduction: content of its sections as plain data for their templates."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from pidtsm_core.recording import Recording
from pidtsm_studies.article.claims import Comparison, Reproduction, Run
from pidtsm_studies.reports.labels import Entry, label, law_entries
from pidtsm_studies.reports.page import write_page
from pidtsm_studies.reports.sections import (
    Cases,
    arm_section,
    case_name,
    draw,
    extents,
    happened_section,
    metrics_table,
    plots_section,
    section,
)


def write_report(
    path: Path,
    runs: Reproduction | Run,
    comparisons: Sequence[Comparison] = (),
    notes: Sequence[str] = (),
) -> None:
    """Write the report; the same runs give the same file.

    The arm is animated if the descriptions of all arms can be read; otherwise a sentence gives the reason.

    Args:
        path: the HTML file.
        runs: a reproduction, or a single run.
        comparisons: comparisons with the article, as returned by `claims.compare`; empty: a report without the article.
        notes: further notes on the deviations, each a sentence or a paragraph.
    """
    reproduction = {_key(runs[0]): runs} if isinstance(runs, tuple) else runs
    done = {key: run for key, run in reproduction.items() if not isinstance(run, str)}
    failed = {key: reason for key, reason in reproduction.items() if isinstance(reason, str)}
    entries = law_entries(law for _, law in done)
    cases = {
        case: {law: done[case, law] for law in entries if (case, law) in done}
        for case in sorted({case for case, _ in done})
    }
    drawings = draw(cases, entries)
    sections = (
        happened_section({_run_name(*key): metrics for key, (_, metrics) in done.items()}),
        arm_section(cases, entries, drawings),
        section("article", "Article and project", _comparison_tables(comparisons)),
        section("metrics", "Metrics", _metrics(cases, entries, failed)),
        plots_section(cases, entries, drawings),
        section("deviations", "Deviations from the article, with reasons", _deviations(comparisons, notes)),
    )
    title = "The article, reproduced" if comparisons else ", ".join(_run_name(*key) for key in done)
    write_page(path, title, _summary(done, failed), sections, drawings.figures, drawings.arm)


def _key(recording: Recording) -> tuple[str, str]:
    return recording.scenario or "run", recording.law or "unknown law"


def _run_name(case: str, law: str) -> str:
    return f"{case_name(case)}, {label(law)}"


def _summary(done: Mapping[tuple[str, str], Run], failed: Collection[object]) -> str:
    """Description of the runs in one sentence; those without curves count too."""
    shown = extents({key: metrics for key, (_, metrics) in done.items()})
    if failed:
        return f"{len(done) + len(failed)} runs: {shown}; {len(failed)} without curves, see Metrics"
    return shown


def _comparison_tables(comparisons: Sequence[Comparison]) -> list[dict[str, Any]]:
    """One table per case; neighbours that differ only in the joint form a group."""
    reasons = list(_reasons(comparisons))
    tables = []
    for case, of_case in groupby(comparisons, key=lambda each: each.claim.case):
        groups = []
        for _, alike in groupby(of_case, key=_group):
            group = list(alike)
            claim = group[0].claim
            about = f", {label(claim.laws[0])}" if len(claim.laws) == 1 else ""
            groups.append(
                {
                    "quantity": claim.quantity + about,
                    "printed_in": claim.printed_in,
                    "reason": reasons.index(claim.reason) + 1,
                    "comparisons": group,
                }
            )
        tables.append({"caption": f"{case_name(case)}: article and project", "groups": groups})
    return tables


def _group(comparison: Comparison) -> tuple[Any, ...]:
    claim = comparison.claim
    return claim.quantity, claim.laws, claim.printed_in, claim.reason


def _reasons(comparisons: Iterable[Comparison]) -> dict[str, list[str]]:
    """The quantities of each reason, in the order of the comparisons."""
    reasons: dict[str, list[str]] = {}
    for claim in (comparison.claim for comparison in comparisons):
        quantities = reasons.setdefault(claim.reason, [])
        quantity = f"{case_name(claim.case)}: {claim.quantity.partition(',')[0]}"
        if quantity not in quantities:
            quantities.append(quantity)
    return reasons


def _metrics(
    cases: Cases, entries: Mapping[str, Entry], failed: Mapping[tuple[str, str], str]
) -> dict[str, Any] | None:
    """The tables, and a sentence about each failed run."""
    if not (cases or failed):
        return None
    tables = [metrics_table(case, runs, entries, compared=False) for case, runs in cases.items()]
    failures = [f"{_run_name(*key)}: {reason}" for key, reason in failed.items()]
    return {"tables": tables, "failures": failures}


def _deviations(comparisons: Sequence[Comparison], notes: Sequence[str]) -> dict[str, Any] | None:
    if not (comparisons or notes):
        return None
    judged = [each for each in comparisons if each.holds is not None]
    false = [
        f"{case_name(each.claim.case)}, joint {each.claim.joint + 1}: {each.claim.quantity} ({each.claim.printed()})"
        for each in judged
        if not each.holds
    ]
    return {
        "notes": notes,
        "judged": len(judged),
        "false": false,
        "reasons": _reasons(comparisons),
    }
