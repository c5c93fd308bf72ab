"""The report of a run or a reproduction: content of its sections as plain data for their templates."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from pidtsm_core.recording import Recording
from pidtsm_core.recording.outcome import FOLLOWED
from pidtsm_core.written import quantity
from pidtsm_studies.article.claims import Comparison, Reproduction, Run
from pidtsm_studies.reports.labels import label, law_entries
from pidtsm_studies.reports.matrix import units_of
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN, Answer, Page, write_page
from pidtsm_studies.reports.sections import events_of, happened_section, made_section, matrix_sections, section
from pidtsm_studies.reports.verdicts import extents, run_answers, run_verdict, state_of, worst_joint
from pidtsm_studies.reports.viewer import case_name, more_curves_section, viewer_data, viewer_section


def write_report(
    path: Path,
    runs: Reproduction | Run,
    comparisons: Sequence[Comparison] = (),
    notes: Sequence[str] = (),
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    command: Sequence[str] = (),
) -> None:
    """Write the report; the same runs give the same file.

    The arm is drawn if the descriptions of all arms can be read; otherwise a sentence gives the reason.

    Args:
        path: the HTML file.
        runs: a reproduction, or a single run.
        comparisons: comparisons with the article, as returned by `claims.compare`; empty: a report without the article.
        notes: further notes on the deviations, each a sentence or a paragraph.
        parameters: of a single run by node: those of the simulated arm have the times of pushes and loads, those of the
            controller the limits.
        command: words of the command that has made a single run; empty: not known.
    """
    reproduction = {_key(runs[0]): runs} if isinstance(runs, tuple) else runs
    done = {key: run for key, run in reproduction.items() if not isinstance(run, str)}
    failed = {key: reason for key, reason in reproduction.items() if isinstance(reason, str)}
    entries = law_entries(law for _, law in done)
    cases = {
        case: {law: done[case, law] for law in entries if (case, law) in done}
        for case in sorted({case for case, _ in done})
    }
    metrics = {key: each for key, (_, each) in done.items()}
    happened = events_of(cases, dict.fromkeys(done, parameters or {}))
    single = next(iter(metrics.items())) if len(metrics) == 1 and not failed else None
    data = viewer_data(cases, entries, happened, _chosen(metrics)) if cases else None
    failures = [f"{_run_name(*key)}: {reason}" for key, reason in failed.items()]
    sections = (
        *([viewer_section(data)] if data else []),
        *matrix_sections(cases, entries, failures),
        section("article", "Article and project", _comparison_tables(comparisons), folded=single is not None),
        section(
            "deviations", "Deviations from the article, with reasons", _deviations(comparisons, notes), folded=True
        ),
        happened_section({key: _run_name(*key) for key in metrics}, metrics, happened),
        *([more_curves_section(data)] if data else []),
        *(made_section({"": recording}, {"": command}) for recording, _ in done.values() if single),
    )
    if single:
        key, each = single
        verdict, state, answers = run_verdict(each, happened[key]), state_of(each), run_answers(each, happened[key])
    else:
        verdict, state, answers = _of_reproduction(metrics, failed, comparisons)
    title = "The article, reproduced" if comparisons else ", ".join(_run_name(*key) for key in done)
    write_page(path, Page(title, verdict, state, _summary(metrics, failed), answers, sections, data))


def _chosen(metrics: Mapping[tuple[str, str], Mapping[str, Any]]) -> int | None:
    """The joint that is chosen at first: of several runs the worst one, so that each has one line."""
    if len(metrics) < 2:
        return None
    return worst_joint(next(iter(metrics.values()))) or 0


def _of_reproduction(
    metrics: Mapping[tuple[str, str], Mapping[str, Any]],
    failed: Collection[object],
    comparisons: Sequence[Comparison],
) -> tuple[str, str, list[Answer]]:
    """Verdict, its state and answers of several runs."""
    total = len(metrics) + len(failed)
    followed = sum(each["outcome"] == FOLLOWED for each in metrics.values())
    judged = [each for each in comparisons if each.holds is not None]
    true = sum(bool(each.holds) for each in judged)
    verdict = f"{followed} of {total} runs followed."
    if judged:
        verdict = f"{true} of {len(judged)} statements and limits of the article are true; {verdict}"
    answers = [Answer("Did they follow?", f"{followed} of {total}", "", GOOD if followed == total else BAD)]
    ranked = sorted((max(each["rmse"]), key) for key, each in metrics.items() if each["outcome"] == FOLLOWED)
    if ranked:
        (least, best), (most, worst) = ranked[0], ranked[-1]
        joints = {key: metrics[key]["joints"][metrics[key]["rmse"].index(value)] for value, key in ranked}
        unit = units_of(metrics[best])[0].position
        answers += [
            Answer("Which follows best?", _run_name(*best), f"RMSE {quantity(least, unit)} ({joints[best]})"),
            Answer("Which follows worst?", _run_name(*worst), f"RMSE {quantity(most, unit)} ({joints[worst]})"),
        ]
    if judged:
        text = f"{len(judged) - true} not true" if true < len(judged) else "nothing"
        answers.append(Answer("What differs from the article?", text, "see Deviations", PLAIN))
    return verdict, GOOD if followed == total else PLAIN, answers


def _key(recording: Recording) -> tuple[str, str]:
    return recording.scenario or "run", recording.law or "unknown law"


def _run_name(case: str, law: str) -> str:
    return f"{case_name(case)}, {label(law)}"


def _summary(done: Mapping[tuple[str, str], Mapping[str, Any]], failed: Collection[object]) -> str:
    """Description of the runs in one sentence; those without curves count too."""
    shown = extents(done)
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
