"""``./pidtsm bench``: each figure next to a lower bound or another implementation, measured in the same run.

A benchmark is a file ``NAME.py`` in the folder ``benchmarks`` of the checkout. Its function ``run(quick: bool)`` yields
the rows.
"""

import argparse
import importlib.util
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

from rich import box
from rich.console import Console
from rich.table import Table

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commands.options import CONSOLE

_LONG = "soak"
"""Takes half an hour, so it runs only on request."""


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes:
        name: what was measured.
        figure: result in `unit`, the median of several measurements if they are affordable.
        unit: unit of `figure` and `floor_figure`.
        floor: what it is compared with (a lower bound or another implementation), measured in the same run; None:
            nothing.
        floor_figure: its result in `unit`.
        ratio: ratio of both, in the sense of `target`.
        target: bound of the ratio, such as ``<= 2`` or ``>= 100``; None: no target.
        note: details of the measurement.
    """

    name: str
    figure: float
    unit: str
    floor: str | None = None
    floor_figure: float | None = None
    ratio: float | None = None
    target: str | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the ratio meets its target; None without one."""
        if self.target is None or self.ratio is None:
            return None
        relation, bound = self.target.split()
        return self.ratio <= float(bound) if relation == "<=" else self.ratio >= float(bound)


def medians(repetitions: int, *functions: Callable[[], object]) -> list[float]:
    """Median time of each function (s), after one warm-up call; they take turns to run under the same load."""
    times: list[list[float]] = [[] for _ in functions]
    for repetition in range(repetitions + 1):
        for function, measured in zip(functions, times, strict=True):
            begin = time.perf_counter()
            function()
            if repetition:
                measured.append(time.perf_counter() - begin)
    return [statistics.median(measured) for measured in times]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print only the figures, as one JSON object")
    parser.add_argument("--out", type=Path, metavar="DIR", help="also write DIR/bench.json")
    parser.add_argument("--only", nargs="+", metavar="NAME", help=f"benchmarks to run (default: all but {_LONG})")
    parser.add_argument(
        "--quick", action="store_true", help="short and coarse: checks that everything runs, without judging the ratios"
    )


def execute(options: argparse.Namespace) -> int:
    files = _files()
    names = options.only or [name for name in files if name != _LONG]
    if unknown := [name for name in names if name not in files]:
        raise UsageError(f"unknown benchmark {', '.join(unknown)}; known: {', '.join(files)}")
    rows: dict[str, list[Row]] = {}
    for name in names:
        with CONSOLE.status(name):
            rows[name] = list(_load(name, files[name])(options.quick))
    result = {
        "machine": {
            "processor": platform.machine(),
            "cores": os.cpu_count(),
            "load": os.getloadavg()[0],
            "python": platform.python_version(),
        },
        "quick": options.quick,
        "rows": [
            {"benchmark": name, **asdict(row), "met": None if options.quick else row.met}
            for name in rows
            for row in rows[name]
        ],
    }
    text = json.dumps(result, indent=2, allow_nan=False)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "bench.json").write_text(text + "\n", encoding="utf-8")
    if options.json:
        print(text)
    else:
        for name, some in rows.items():
            Console().print(_table(name, some, judged=not options.quick))
    return 0


def _files() -> dict[str, Path]:
    """Benchmarks of the checkout, by name."""
    folders = (parent / "benchmarks" for parent in Path(__file__).resolve().parents if (parent / "pidtsm").is_file())
    folder = next(folders, None)
    if folder is None:
        raise UsageError("bench needs the source checkout")
    # The other files are helpers of the benchmarks.
    return {file.stem: file for file in sorted(folder.glob("*.py")) if "\ndef run(" in file.read_text("utf-8")}


def _load(name: str, file: Path) -> Callable[[bool], Iterable[Row]]:
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", file)
    assert spec is not None
    assert spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # needed by dataclasses and pickle
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # for their helpers
    spec.loader.exec_module(module)
    return cast(Callable[[bool], Iterator[Row]], module.run)


def _table(name: str, rows: Iterable[Row], judged: bool) -> Table:
    table = Table(title=name, title_style="bold", title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("figure", "", "unit", "compared with", "", "ratio", "target"):
        table.add_column(column, justify="right" if column in ("", "ratio", "target") else "left")
    for row in rows:
        style = {True: "green", False: "bold red", None: ""}[row.met if judged else None]
        numbers = ("" if n is None else f"{n:.4g}" for n in (row.figure, row.floor_figure, row.ratio))
        figure, floor, ratio = numbers
        label = f"{row.name}\n[dim]{row.note}[/]" if row.note else row.name
        target = row.target or ""
        missed = " missed" if judged and row.met is False else ""
        table.add_row(
            label,
            figure,
            row.unit,
            row.floor or "",
            floor,
            f"[{style}]{ratio}[/]" if style else ratio,
            f"{target}{missed}",
        )
    return table
