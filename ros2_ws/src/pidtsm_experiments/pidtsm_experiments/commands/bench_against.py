"""``./pidtsm bench --against COMMIT``: the same benchmarks of two commits in turns, and the ratios of their figures."""

import json
import statistics
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.errors import RunError

_TURNS = 3
Figures = dict[tuple[str, str], list[float]]


def compare(commit: str, names: Sequence[str], quick: bool, as_json: bool) -> int:
    """Measure this checkout and another commit in turns, and print both medians with their ratio.

    Args:
        commit: any name that git knows.
        names: benchmarks; figures that one of both lacks are left out.
        quick: see ``--quick``.
        as_json: print one JSON object.

    Raises:
        UsageError: git does not know the commit.
        RunError: a checkout cannot be set up, or a benchmark fails.
    """
    root = _root()
    with tempfile.TemporaryDirectory(prefix="pidtsm-against-") as folder:
        other = Path(folder, "checkout")
        _git(root, "worktree", "add", "--detach", str(other), commit)
        try:
            sides: dict[str, tuple[Path, Figures]] = {commit: (other, {}), "here": (root, {})}
            for turn in range(_TURNS):
                for side, (checkout, figures) in sides.items():
                    CONSOLE.print(f"turn {turn + 1} of {_TURNS}: {side}")
                    for row in _measured(checkout, names, quick, Path(folder, "results")):
                        figures.setdefault((row["benchmark"], row["name"]), []).append(row["figure"])
        finally:
            _git(root, "worktree", "remove", "--force", str(other))
    (_, before), (_, now) = sides.values()
    show(commit, before, now, as_json)
    return 0


def _root() -> Path:
    """The checkout."""
    return next(parent for parent in Path(__file__).resolve().parents if (parent / "pidtsm").is_file())


def _git(root: Path, *words: str) -> None:
    done = subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise UsageError(f"git {words[0]}: {' '.join(done.stderr.split())}")


def _measured(checkout: Path, names: Sequence[str], quick: bool, out: Path) -> list[Mapping[str, Any]]:
    """Rows of the benchmarks in a checkout, which is set up first if it is new."""
    options = ["--json", "--out", str(out), *(["--quick"] if quick else [])]
    command = [str(checkout / "pidtsm"), "bench", *options, "--only", *names]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=checkout)
    if done.returncode:
        raise RunError(f"{checkout}: bench ended with {done.returncode}: {' '.join(done.stderr.split()[-40:])}")
    return list(json.loads(done.stdout)["rows"])


def show(commit: str, before: Figures, now: Figures, as_json: bool) -> None:
    """Print the medians of both sides and their ratios; figures by benchmark and name, one for each turn."""
    rows = []
    for benchmark, name in (key for key in now if key in before):
        old, new = (statistics.median(figures[benchmark, name]) for figures in (before, now))
        rows.append(
            {"benchmark": benchmark, "name": name, "before": old, "now": new, "ratio": new / old if old else None}
        )
    if as_json:
        print(json.dumps({"against": commit, "turns": _TURNS, "rows": rows}, indent=2, allow_nan=False))
        return
    for row in rows:
        ratio = "" if row["ratio"] is None else f"; ratio {row['ratio']:.3f}"
        print(f"{row['benchmark']}, {row['name']}\n    {row['before']:.4g} -> {row['now']:.4g}{ratio}")
