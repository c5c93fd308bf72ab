"""Runs of any kind compared with each other: their differences, and the report."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment.node_parameters import NODE_ONLY
from pidtsm_core.parameters.files import NODES, Settings
from pidtsm_core.recording import Recording
from pidtsm_core.written import NOTHING, enumeration
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.contrast import (
    BEST,
    apart_section,
    contrast_answers,
    contrast_section,
    contrast_verdict,
    contrasts,
)
from pidtsm_studies.reports.labels import run_entries
from pidtsm_studies.reports.page import Answer, Page, write_page
from pidtsm_studies.reports.sections import events_of, happened_section, made_section, matrix_sections
from pidtsm_studies.reports.verdicts import extents, run_verdict, sentence
from pidtsm_studies.reports.viewer import more_curves_section, viewer_data, viewer_section

_TOGETHER = "Comparison"
"""Name of the case if the runs have different scenarios."""


def check_comparable(recordings: Mapping[str, Recording]) -> None:
    """Check that runs have the same joints in the same order and with the same units.

    Raises:
        UsageError: a run has others than the first; the message names the joints of both.
    """
    (name, first), *others = recordings.items()
    for other, recording in others:
        if (recording.joints, recording.units) != (first.joints, first.units):
            raise UsageError(
                f"{other} has other joints than {name}: {_joints(recording)} instead of {_joints(first)}; compare runs "
                "of one arm"
            )


def _joints(recording: Recording) -> str:
    pairs = zip(recording.joints, recording.units, strict=True)
    return ", ".join(f"{joint} ({units.position})" for joint, units in pairs)


def differing_parameters(parameters: Mapping[str, Settings]) -> dict[str, dict[str, Any]]:
    """Values of the parameters that are not the same in all runs.

    Runs without parameters do not count, and neither do those that a rollout does not have, if there is a rollout.

    Args:
        parameters: of the nodes, by run; empty if they are not known.

    Returns:
        By ``NODE.PARAMETER``, the value of each run that has the parameter.
    """
    known = {run: nodes for run, nodes in parameters.items() if nodes}
    names = dict.fromkeys((node, name) for node in NODES for nodes in known.values() for name in nodes.get(node, {}))
    found = {}
    for node, name in names:
        values = {run: nodes[node][name] for run, nodes in known.items() if name in nodes.get(node, {})}
        if len(values) < len(known):
            differs = name not in {parameter.name for parameter in NODE_ONLY[node]}
        else:
            first, *others = values.values()
            differs = any(other != first for other in others)
        if differs:
            found[f"{node}.{name}"] = values
    return found


def write_comparison(
    path: Path,
    runs: Mapping[str, Run],
    parameters: Mapping[str, Mapping[str, Any]],
    nodes: Mapping[str, Mapping[str, Mapping[str, Any]]] | None = None,
    title: str = "",
    apart: Answer | None = None,
    commands: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write the report of runs over each other; the same runs give the same file.

    Args:
        path: the HTML file.
        runs: at least two runs by name, with the same joints; differences are those to the first.
        parameters: see `differing_parameters`.
        nodes: parameters of every node by run, with the times of pushes and loads and with the limits.
        title: of the page; empty: the names of the runs.
        apart: how far the runs are apart, if this is the question, instead of which one follows best.
        commands: words of the command that has made each run, as far as they are known.
    """
    entries = run_entries(runs)
    scenarios = {recording.scenario for recording, _ in runs.values()}
    scenario = scenarios.pop() if len(scenarios) == 1 else None
    case = scenario or _TOGETHER
    cases, metrics = {case: runs}, {name: metrics for name, (_, metrics) in runs.items()}
    found = contrasts(metrics)
    happened = events_of(cases, {(case, name): values for name, values in (nodes or {}).items()})
    data = viewer_data(cases, entries, happened, found.joint)
    sections = (
        apart_section(found, metrics),
        viewer_section(data, "Runs"),
        contrast_section(found, metrics, _parameters(list(runs), parameters)),
        *matrix_sections(cases, entries, []),
        happened_section(
            {(case, name): name for name in runs}, {(case, name): each for name, each in metrics.items()}, happened
        ),
        more_curves_section(data),
        made_section({name: recording for name, (recording, _) in runs.items()}, commands or {}),
    )
    verdict, state = contrast_verdict(found, metrics)
    answers = contrast_answers(
        found, metrics, parameters, {name: run_verdict(each, happened[case, name]) for name, each in metrics.items()}
    )
    if apart is not None:
        verdict = sentence(f"The runs differ by at most {apart.text}, {apart.detail}")
        followed, *others = answers
        answers = [followed, apart, *(answer for answer in others if answer.question != BEST)]
    page = Page(title or enumeration(list(runs)), verdict, state, extents(metrics), answers, sections, data)
    write_page(path, page)


def _parameters(runs: list[str], parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    rows = {name: [str(values.get(run, NOTHING)) for run in runs] for name, values in parameters.items()}
    return {"runs": runs, "rows": rows}
