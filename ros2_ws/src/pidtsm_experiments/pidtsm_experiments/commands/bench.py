"""``./pidtsm bench``: each figure next to a lower bound or another implementation, measured in the same run.

A benchmark is a file ``NAME.py`` in the folder ``benchmarks`` of the checkout. Its function ``run(quick: bool)`` yields
the rows; ``TAKES`` is how long that takes without ``quick`` on two cores, s.
"""

import argparse
import ast
import importlib.util
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commands.bench_against import compare
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.runs.files import write_file
from pidtsm_experiments.runs.origin import making
from pidtsm_experiments.runs.results import renewed

_FILE = "bench.json"
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
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("results", "bench"),
        metavar="DIR",
        help="folder of bench.json, which has each row as soon as it is measured (default: %(default)s)",
    )
    parser.add_argument(
        "--only",
        nargs="*",
        metavar="NAME",
        help=f"benchmarks to run (default: all but {_LONG}); without NAME: list them",
    )
    parser.add_argument(
        "--quick", action="store_true", help="short and coarse: checks that everything runs, without judging the ratios"
    )
    parser.add_argument(
        "--against",
        metavar="COMMIT",
        help="run the benchmarks of that commit too, in turns with these, and print the ratio of each figure",
    )


def execute(options: argparse.Namespace) -> int:
    files = _files()
    if options.only == []:
        print("\n".join(f"{name}: {_minutes(_takes(file))}" for name, file in files.items()))
        return 0
    names = options.only or [name for name in files if name != _LONG]
    if unknown := [name for name in names if name not in files]:
        raise UsageError(f"unknown benchmark {', '.join(unknown)}; known: {', '.join(files)}")
    if options.against is not None:
        return compare(options.against, names, options.quick, options.json)
    with renewed(options.out, beside=(_FILE,)):
        _measure({name: _load(name, files[name]) for name in names}, options)
    return 0


def _measure(modules: Mapping[str, Any], options: argparse.Namespace) -> None:
    """Run the benchmarks; every row is printed, and written to ``bench.json``, when it is measured."""
    result: dict[str, Any] = {**making(), "machine": _machine(), "quick": options.quick, "complete": False, "rows": []}
    if not options.quick:
        CONSOLE.print(f"{', '.join(modules)}: {_minutes(sum(module.TAKES for module in modules.values()))}")
    for name, module in modules.items():
        if not options.json:
            print(f"\n{name}", flush=True)
        for row in module.run(options.quick):
            result["rows"].append({"benchmark": name, **asdict(row), "met": None if options.quick else row.met})
            if not options.json:
                print(_lines(row, judged=not options.quick), flush=True)
            _write(result, options.out)
    result["complete"] = True
    _write(result, options.out)
    if options.json:
        print(json.dumps(result, indent=2, allow_nan=False))


def _write(result: Mapping[str, Any], folder: Path) -> None:
    text = json.dumps(result, indent=2, allow_nan=False) + "\n"
    write_file(folder / _FILE, text)


def _machine() -> dict[str, Any]:
    return {
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
    }


def _minutes(seconds: float) -> str:
    return f"about {max(1, round(seconds / 60.0))} min"


def _files() -> dict[str, Path]:
    """Benchmarks of the checkout, by name."""
    folders = (parent / "benchmarks" for parent in Path(__file__).resolve().parents if (parent / "pidtsm").is_file())
    folder = next(folders, None)
    if folder is None:
        raise UsageError("bench needs the source checkout")
    # The other files are helpers of the benchmarks.
    return {file.stem: file for file in sorted(folder.glob("*.py")) if "\ndef run(" in file.read_text("utf-8")}


def _takes(file: Path) -> float:
    """How long a benchmark takes, s, read from its text: importing all of them takes seconds."""
    values = [
        ast.literal_eval(line.value)
        for line in ast.parse(file.read_text("utf-8")).body
        if isinstance(line, ast.Assign) and ast.unparse(line.targets[0]) == "TAKES"
    ]
    return float(values[0])


def _load(name: str, file: Path) -> Any:
    """The module of a benchmark: its function ``run``, and ``TAKES``, how long that takes, s."""
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # needed by dataclasses and pickle
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # for their helpers
    spec.loader.exec_module(module)
    return module


def _lines(row: Row, judged: bool) -> str:
    """A row as text that fits into 80 columns."""
    lines = [f"  {row.name}: {row.figure:.4g} {row.unit}".rstrip()]
    if row.floor is not None:
        target = f" ({row.target}{': missed' if judged and row.met is False else ''})" if row.target else ""
        lines.append(f"    {row.floor}: {row.floor_figure:.4g} {row.unit}; ratio {row.ratio:.4g}{target}")
    if row.note:
        lines += wrap(row.note, 74, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines)
