"""Tables for papers, judged by SciPy's intervals and by what LaTeX needs of a tabular environment."""

import math
import re

import numpy as np
import pytest
from scipy import stats

from pidtsm_core.recording.latex import NOTHING, cell, escaped, spread, table


def test_the_interval_is_students() -> None:
    values = np.random.default_rng(1).normal(3.0, 0.5, 6)
    low, high = stats.t.interval(0.95, 5, values.mean(), stats.sem(values))
    found = spread([*values, np.nan])
    assert found.mean == pytest.approx(values.mean())
    assert (found.mean - found.half, found.mean + found.half) == pytest.approx((low, high))
    assert math.isnan(spread([1.0]).half)
    assert math.isnan(spread([]).mean)


@pytest.mark.parametrize(
    ("mean", "half", "text"),
    [
        (1.23456, math.nan, "$1.23$"),
        (1.23456, 0.0372, r"$1.235 \pm 0.037$"),
        (0.0, math.nan, "$0.00$"),
        (-0.0123, 0.0, r"$-0.0123 \pm 0.0000$"),
        (1.5e-5, 2e-6, r"$(1.50 \pm 0.20) \times 10^{-5}$"),
        (20687.0, 22565.0, r"$21000 \pm 23000$"),
        (1234567.0, math.nan, r"$1.23 \times 10^{6}$"),
        (math.nan, 1.0, NOTHING),
    ],
)
def test_numbers_have_as_many_digits_as_are_known(mean: float, half: float, text: str) -> None:
    assert cell(mean, half) == text


def test_no_name_means_anything_to_latex() -> None:
    text = escaped(r"a_b & 50 % of \x {y} #1 $2 ~ ^ <>| Υ²")
    rest = re.sub(r"\\[&%$#_{}]|\\text\w+\{\}|\$[^$]*\$", "", text)
    assert not set(rest) & set("\\&%$#_{}~^<>|")
    assert escaped("run-1.5") == "run-1.5"


def test_every_row_has_the_columns_that_the_head_declares() -> None:
    text = table(["metric", "joint", "a"], [["x", "1", "$1$"], ["", "2", "$2$"], ["y", "1", "$3$"]], 2, "made\nby")
    assert text.startswith("% made\n% by\n\\begin{tabular}{llr}\n\\toprule\n")
    assert text.endswith("\\bottomrule\n\\end{tabular}\n")
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert len(rows) == 4
    assert {row.count("&") for row in rows} == {2}
    assert text.count(r"\addlinespace") == 1
    with pytest.raises(ValueError, match="row 0: it has 1 cells instead of 2"):
        table(["a", "b"], [["x"]])
