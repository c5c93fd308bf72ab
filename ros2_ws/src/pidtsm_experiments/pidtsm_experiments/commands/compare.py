"""``./pidtsm compare``: runs over each other."""

import argparse
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pidtsm_core.errors import UsageError
from pidtsm_core.recording.metric import METRICS, Metric
from pidtsm_core.recording.outcome import sources
from pidtsm_core.units import joint_units
from pidtsm_core.written import NOTHING
from pidtsm_experiments.commands.options import CONSOLE, read
from pidtsm_experiments.runs.origin import MadeOf, comment, origin_of
from pidtsm_experiments.runs.results import result_folder
from pidtsm_experiments.runs.saved import read_parameters
from pidtsm_studies.reports.comparison import check_comparable, differing_parameters, write_comparison
from pidtsm_studies.reports.labels import difference_text
from pidtsm_studies.reports.matrix import metric_text, metric_value
from pidtsm_studies.reports.paper import comparison_table, write_paper_figures

_TOGETHER = 3
"""Runs next to each other in 80 columns."""
_Metrics = Mapping[str, Mapping[str, Any]]
"""Metrics as in metrics.json, by run."""


_EPILOG = """For papers: table.tex has the metrics as a LaTeX table (booktabs). Runs whose parameters differ only in
the seed are one column, with mean and 95 % interval (Student's t). figures/ has position, error and effort as PDF and
SVG, with the data that they draw as CSV, in the style that plt.style.use("pidtsm_studies.paper") gives to figures of
your own.

example:
  for seed in 1 2 3; do ./pidtsm rollout --scenario noise --set simulator.seed=$seed --out results/seed$seed; done
  ./pidtsm compare results/seed1 results/seed2 results/seed3 results/pid
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument(
        "runs",
        nargs="+",
        type=Path,
        metavar="RUN",
        help="result folder of run, demo or rollout --out, or a bag; differences are those to the first",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("results", "compare"), metavar="DIR", help="default: results/compare"
    )
    parser.add_argument("--json", action="store_true", help="print only the comparison, as one JSON object")


def execute(options: argparse.Namespace) -> int:
    paths = named(options.runs)
    if any(path.resolve() == options.out.resolve() for path in paths.values()):
        raise UsageError(f"--out {options.out} is one of the runs; choose another folder")
    recordings = {name: read(path) for name, path in paths.items()}
    check_comparable(recordings)
    known = {name: read_parameters(path) for name, path in paths.items()}
    parameters = differing_parameters(known)
    metrics = {name: recording.metrics() for name, recording in recordings.items()}
    content = {
        "runs": {name: {"path": str(paths[name]), "metrics": metrics[name]} for name in paths},
        "differences": differences(metrics),
        "parameters": parameters,
    }
    text = json.dumps(content, allow_nan=False)
    with (
        result_folder(options.out, MadeOf(runs=tuple(paths.values()))) as folder,
        CONSOLE.status("drawing, writing the report"),
    ):
        (folder / "comparison.json").write_text(text + "\n", encoding="utf-8")
        runs = {name: (recordings[name], metrics[name]) for name in paths}
        commands = {name: (origin_of(path) or {}).get("command", ()) for name, path in paths.items()}
        write_comparison(folder / "report.html", runs, parameters, known, commands=commands)
        (folder / "table.tex").write_text(comparison_table(runs, known, comment().replace("# ", "")), encoding="utf-8")
        write_paper_figures(runs, known, folder / "figures")
    if options.json:
        print(text)
        return 0
    console = Console()
    for table in (*_metrics_tables(metrics), *_parameter_tables(list(paths), parameters)):
        console.print(table)
    for name, each in metrics.items():
        for text in sources(each):
            console.print(f"{name}: {text}", highlight=False, markup=False)
    CONSOLE.print(f"{options.out}: report.html comparison.json table.tex figures/", highlight=False)
    return 0


def named(paths: Sequence[Path]) -> dict[str, Path]:
    """Runs by the names of their folders, or by their paths if several folders have the same name.

    Raises:
        UsageError: fewer than two runs, or one of them twice.
    """
    if len(paths) < 2:
        raise UsageError("compare needs at least two runs")
    for path, count in Counter(path.resolve() for path in paths).items():
        if count > 1:
            raise UsageError(f"{path} is given twice")
    folders = [path.resolve().parent if path.resolve().name == "bag" else path.resolve() for path in paths]
    counts = Counter(folder.name for folder in folders)
    pairs = zip(folders, paths, strict=True)
    return {folder.name if counts[folder.name] == 1 else str(path): path for folder, path in pairs}


def differences(metrics: _Metrics) -> dict[str, dict[str, list[float | None]]]:
    """Each metric of each joint minus that of the first run, by run; None if one of them does not exist.

    Args:
        metrics: as in metrics.json, by run.
    """
    first, *others = metrics
    return {
        other: {
            metric.key: [_minus(metrics, other, first, metric.key, j) for j in range(len(metrics[first]["joints"]))]
            for metric in METRICS
            if metric.key in metrics[first] and metric.key in metrics[other]
        }
        for other in others
    }


def _minus(metrics: _Metrics, other: str, first: str, key: str, joint: int) -> float | None:
    ours, theirs = (metric_value(metrics[name], key, joint) for name in (other, first))
    return None if ours is None or theirs is None else ours - theirs


def _metrics_tables(metrics: _Metrics) -> Iterator[Table]:
    """A table for each joint and each few runs, which begins with the first run."""
    first, *others = metrics
    joints = metrics[first]["joints"]
    units = joint_units(metrics[first]["slides"], len(joints))
    step = _TOGETHER - 1
    for j, joint in enumerate(joints):
        for start in range(0, len(others), step):
            names = [first, *others[start : start + step]]
            table = _table(joint, "metric", "unit", *names)
            for metric in METRICS:
                runs = [metrics[name] for name in names]
                if any(metric.key in run and (not metric.only_if_any or run[metric.key][j]) for run in runs):
                    cells = (_cell(metrics, name, first, metric, j) for name in names)
                    table.add_row(metric.name, metric.unit_of(units[j]), *cells)
            yield table


def _cell(metrics: _Metrics, name: str, first: str, metric: Metric, joint: int) -> str:
    text = metric_text(metrics[name], metric.key, joint, metric.factor)
    if name == first:
        return text
    values = (metric_value(metrics[each], metric.key, joint) for each in (first, name))
    return f"{text} [dim]{difference_text(*values)}[/]".rstrip()


def _parameter_tables(names: Sequence[str], parameters: Mapping[str, Mapping[str, Any]]) -> Iterator[Table]:
    if parameters:
        table = _table("parameters that differ", "parameter", *names)
        for parameter, values in parameters.items():
            table.add_row(parameter, *(escape(str(values.get(name, NOTHING))) for name in names))
        yield table


def _table(title: str, *columns: str) -> Table:
    table = Table(title=escape(title), title_style="bold", box=box.SIMPLE_HEAD)
    for column in columns:
        table.add_column(escape(column), overflow="fold")
    return table
