"""Tables for papers: LaTeX with booktabs, means with their intervals, names of any kind."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

CONFIDENCE = 0.95
"""Confidence of all intervals."""
NOTHING = "--"
"""What stands for a value that does not exist."""
_ESCAPED = {
    "\\": r"\textbackslash{}",
    **{each: f"\\{each}" for each in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{each: f"${each}$" for each in "<>|"},
    "²": "$^2$",
    "³": "$^3$",
    "Υ": r"$\Upsilon$",
    "τ": r"$\tau$",
    "σ": r"$\sigma$",
    "−": "$-$",
    "–": "--",
}
_DIGITS = 3
"""Significant digits of a number without an interval; the interval of others has one less."""
_LEAST, _MOST = -3, 5
"""Powers of ten between which numbers are written without one."""


class Spread(NamedTuple):
    """Mean of some runs, with the half width of its interval (Student's t); nan if there is no such value."""

    mean: float
    half: float


def spread(values: ArrayLike) -> Spread:
    """Mean and 95 % interval of the values that exist.

    Args:
        values: of independent runs, in any unit, shape (runs,); nan: does not exist.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    count = known.size
    mean = float(known.mean()) if count else math.nan
    if count < 2:
        return Spread(mean, math.nan)
    quantile = float(stdtrit(count - 1, 0.5 + 0.5 * CONFIDENCE))
    return Spread(mean, quantile * float(known.std(ddof=1)) / math.sqrt(count))


def escaped(text: str) -> str:
    """A text in which nothing has a meaning for LaTeX."""
    return "".join(_ESCAPED.get(each, each) for each in text)


def cell(mean: float, half: float = math.nan) -> str:
    """A number with its interval, in math mode; `NOTHING` if it is not finite."""
    if not math.isfinite(mean):
        return NOTHING
    has = math.isfinite(half)
    largest = max(abs(mean), half if has else 0.0)
    exponent = math.floor(math.log10(largest)) if largest > 0.0 else 0
    power = 0 if _LEAST <= exponent < _MOST else exponent
    mean, half = mean / 10.0**power, half / 10.0**power
    last = math.floor(math.log10(half)) - _DIGITS + 2 if has and half > 0.0 else exponent - power - _DIGITS + 1
    places = max(0, -last)
    text = f"{round(mean, -last):.{places}f}" + (rf" \pm {round(half, -last):.{places}f}" if has else "")
    if power:
        text = (f"({text})" if has else text) + rf" \times 10^{{{power}}}"
    return f"${text}$"


def table(columns: Sequence[str], rows: Iterable[Sequence[str]], texts: int = 1, comment: str = "") -> str:
    """A tabular environment for the package booktabs; rows that begin a group have a rule above them.

    Args:
        columns: headings, escaped.
        rows: cells, escaped; an empty one continues the cell above it.
        texts: number of columns with text at the left; the others are numbers.
        comment: lines to put at the top.

    Raises:
        ValueError: a row has another number of cells than there are headings.
    """
    lines = [f"% {line}".rstrip() for line in comment.splitlines()]
    lines += [rf"\begin{{tabular}}{{{'l' * texts}{'r' * (len(columns) - texts)}}}", r"\toprule"]
    lines += [" & ".join(columns) + r" \\", r"\midrule"]
    for number, row in enumerate(rows):
        if len(row) != len(columns):
            raise ValueError(f"row {number}: it has {len(row)} cells instead of {len(columns)}")
        if number and texts > 1 and row[0]:
            lines.append(r"\addlinespace")
        lines.append(" & ".join(row) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def grouped(labels: Sequence[str]) -> Mapping[str, list[int]]:
    """Numbers of the runs with each label, in the order of their first ones."""
    found: dict[str, list[int]] = {}
    for number, label in enumerate(labels):
        found.setdefault(label, []).append(number)
    return found
