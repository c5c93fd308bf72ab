"""Labels of laws, cases and values in tables and figures."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from pidtsm_core.written import NOTHING

LABELS = {
    "piddtsm": "PIDDTSM",
    "pidnftsm": "PIDNFTSM",
    "dtsm": "DTSM",
    "pid": "PID",
    "computed_torque": "computed torque",
    "super_twisting": "super-twisting",
    "slotine_li": "Slotine-Li",
    "linear_quadratic": "linear-quadratic",
    "predictive": "predictive",
    "impedance": "impedance",
    "integral_sliding_mode": "integral sliding mode",
    "time_delay": "time delay",
    "disturbance_observer": "disturbance observer",
    "dtsm_printed": "DTSM, printed kappa",
}
"""Labels of the laws in tables and figures, in their order."""

CASES = {"case1": "Case 1", "case2": "Case 2"}
"""Labels of the article's cases in tables and figures, by scenario."""
DIGITS = 4
"""Significant digits of `value_text`: in the terminal, in figures and beside the article, which prints no more.

Matrices and sentences of pages have `pidtsm_core.written.DIGITS`.
"""


def label(law: str) -> str:
    """Label of a law in tables and figures."""
    return LABELS.get(law, law.replace("_", " "))


@dataclass(frozen=True)
class Entry:
    """An entry of a legend.

    Attributes:
        label: text.
        style: index of `figures.COLOURS` and `figures.DASHES`.
    """

    label: str
    style: int


def law_entries(laws: Iterable[str]) -> dict[str, Entry]:
    """The legend of laws, in its order; see `style_indices`."""
    return {law: Entry(label(law), style) for law, style in style_indices(laws).items()}


def run_entries(names: Iterable[str]) -> dict[str, Entry]:
    """The legend of runs that are compared, in their order."""
    return {name: Entry(name, style) for style, name in enumerate(names)}


def style_indices(laws: Iterable[str]) -> dict[str, int]:
    """The index of each law's style (`figures.COLOURS`, `figures.DASHES`), in the order of legends.

    A law of `LABELS` has the same style everywhere; other laws share the remaining styles.
    """
    order = {law: index for index, law in enumerate(LABELS)}
    laws = sorted(set(laws), key=lambda law: (order.get(law, len(order)), law))
    free = [index for law, index in order.items() if law not in laws] or [0]
    unknown = [law for law in laws if law not in order]
    return {law: order[law] if law in order else free[unknown.index(law) % len(free)] for law in laws}


def value_text(value: float | None) -> str:
    """A value with `DIGITS` significant digits; all digits of a count, which is an int.

    None and nan mean that there is no value and become `NOTHING`; inf is a time that was not reached in the run.
    """
    if isinstance(value, int):
        return str(value)
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "not within the run"
    return f"{value:.{DIGITS}g}"


def difference_text(first: float | None, value: float | None) -> str:
    """How a value differs from the first one, relative to it; empty if one does not exist, or only the first is 0."""
    if first is None or value is None:
        return ""
    if value == first:
        return "same"
    return f"{100.0 * (value / first - 1.0):+.1f} %" if first else ""
