"""Generates docs/performance.md from the figures of `./pidtsm bench`, in one run or in several (`--only`).

./pidtsm shell -c "python scripts/performance.py results/bench/bench.json"
"""

import json
import sys
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parents[1] / "docs" / "performance.md"
_HEAD = """# Performance

`./pidtsm bench` measured these figures, and `scripts/performance.py` made this page of them. A figure depends on the
machine and on what else it does; a ratio to the figure beside it, measured in the same run, depends much less. To
measure your machine, see [Benchmarks](running.md#benchmarks). The page may lack those that take longer than ten
minutes.

Machine: {processor}, {cores} cores, Python {python}; load at the start {load:.1f}.
"""
_TABLE = """## {name}

| what | figure | compared with | its figure | ratio | target |
| --- | --- | --- | --- | --- | --- |
"""


def page(results: Sequence[Mapping[str, Any]]) -> str:
    """Content of the page.

    Args:
        results: content of each ``bench.json``, measured on one machine.

    Raises:
        ValueError: the figures are from a quick or an interrupted run.
    """
    if any(result["quick"] or not result["complete"] for result in results):
        raise ValueError("the page needs whole runs: ./pidtsm bench, without --quick")
    parts = [_HEAD.format(**results[0]["machine"])]
    every = sorted((row for result in results for row in result["rows"]), key=lambda row: row["benchmark"])
    for name, rows in groupby(every, key=lambda row: row["benchmark"]):
        parts.append(_TABLE.format(name=name) + "\n".join(map(_line, rows)) + "\n")
    return "\n".join(parts)


def _line(row: Mapping[str, Any]) -> str:
    """A row of a table."""
    name = f"{row['name']} ({row['note']})" if row["note"] else row["name"]
    cells = [name, _quantity(row["figure"], row["unit"]), "", "", "", ""]
    if row["floor"] is not None:
        target = f"{row['target']}{'' if row['met'] else ', missed'}" if row["target"] else ""
        cells[2:] = [row["floor"], _quantity(row["floor_figure"], row["unit"]), f"{row['ratio']:.3g}", target]
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def _quantity(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".rstrip()


def main(words: Sequence[str]) -> None:
    """Write the page; `words` are the arguments of the command."""
    results = [json.loads(Path(file).read_text(encoding="utf-8")) for file in words]
    PAGE.write_text(page(results), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
