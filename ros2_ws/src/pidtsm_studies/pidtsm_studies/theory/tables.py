"""The check of gains as rows of text, for the terminal."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.theory.bounds import Bounds
from pidtsm_studies.theory.check import GainCheck
from pidtsm_studies.theory.condition import Condition, Verdict
from pidtsm_studies.theory.conditions import manifold_roots

CONDITIONS = ("condition", "source", "formula", "values", "verdict")
"""Columns of `condition_rows`."""
NOTHING = "-"


def condition_rows(check: GainCheck) -> list[list[str]]:
    """By condition: its name, source, formula, values and verdict."""
    return [[each.name, source(each), each.formula, _values(each), each.verdict.value] for each in check.conditions]


def source(condition: Condition) -> str:
    """Where a condition comes from, as in a sentence."""
    return f"eq. {condition.equation}" if condition.equation.startswith("(") else condition.equation


def sentences(check: GainCheck) -> list[str]:
    """What is violated and what is not covered, one sentence each, with the joints if it does not concern all."""
    found = []
    for verdict in (Verdict.VIOLATED, Verdict.NOT_COVERED):
        for each in (each for each in check.conditions if each.verdict is verdict):
            of = (
                ""
                if len(each.joints) == len(check.joints)
                else f" of {', '.join(check.joints[j] for j in each.joints)}"
            )
            found.append(f"{verdict.value}: {each.name}{of}, {source(each)}: {each.cure}")
    return found


def bound_rows(bounds: Bounds) -> list[list[str]]:
    """By quantity of `Bounds` that the law has: its name with the equation, and one value per joint."""
    rows: list[tuple[str, Array]] = [
        ("sup |Lambda|, eq. (17)", bounds.disturbance),
        ("sup |Lambda'| = Upsilon_d, eq. (19)", bounds.disturbance_rate),
        ("jump of Lambda at the event, eq. (19)", bounds.event_jump),
        ("gain demanded, eqs. (23), (24)", bounds.gain_condition),
        ("gain needed", bounds.gain_needed),
        ("gain at the end", bounds.gain[-1]),
        ("time below what is needed (%)", 100.0 * bounds.short),
        ("sup |tau_sw|", bounds.switching_term),
        ("bound (sup Y + xi) / k, eq. (25)", bounds.switching_bound),
        ("sup |u_f|, eq. (13)", bounds.terminal_rate),
        ("time at its limit u_s (%), eq. (29)", 100.0 * bounds.limited),
        ("band of sigma, eq. (30)", bounds.band),
        ("reaching time (s)", bounds.reaching_time),
        ("last outside the band (s)", bounds.last_outside),
        ("|e| at the reaching time", bounds.error_at_reaching),
        ("settling as printed (s), eq. (47)", bounds.printed),
        ("bound of settling on s = 0 (s)", bounds.settling_bound),
        ("settling on s = 0 (s), eq. (42)", bounds.settling_exact),
        ("settling measured (s)", bounds.settling),
        ("rate of s on sigma = 0 (1/s), eq. (10)", _slow(bounds)),
        ("rate of s measured (1/s)", bounds.decay),
    ]
    return [[name, *map(_text, values)] for name, values in rows if not np.isnan(values).all()]


def lyapunov_sentence(bounds: Bounds) -> str:
    """How V, eq. (35), develops, in a sentence."""
    first, last = bounds.lyapunov[0], bounds.lyapunov[-1]
    text = f"V, eq. (35): {_text(first)} at the start, {_text(last)} at the end"
    if math.isfinite(bounds.lyapunov_rise):
        text += f"; it rises by at most {_text(100.0 * bounds.lyapunov_rise)} % of its start"
    return text


def _slow(bounds: Bounds) -> Array:
    """Rate of s at the slowest root of (10), 1/s, shape (joints,); nan without a PID manifold."""
    if bounds.parts.manifold != "pid":
        return np.full(len(bounds.joints), math.nan)
    gains = bounds.parts.gains
    rows = zip(gains["kp"].tolist(), gains["ki"].tolist(), gains["kd"].tolist(), strict=True)
    return np.array([-manifold_roots(*row)[0].real for row in rows])


def _values(condition: Condition) -> str:
    """The values of a condition, and its roots."""
    found = [f"{name} = {_joined(map(_text, each))}" for name, each in condition.values.items()]
    if condition.roots:
        found.append(f"roots {_joined(' '.join(map(_root, each)) for each in condition.roots)}")
    return ", ".join(found) or NOTHING


def _joined(texts: Iterable[str]) -> str:
    """One text per joint, or a single one if they are the same."""
    all_texts: Sequence[str] = list(texts)
    return all_texts[0] if len(set(all_texts)) == 1 else "; ".join(all_texts)


def _root(root: complex) -> str:
    if root.imag == 0.0:
        return _text(root.real)
    return f"{_text(root.real)}{'+' if root.imag > 0.0 else '-'}{_text(abs(root.imag))}j"


def _text(value: float) -> str:
    return NOTHING if math.isnan(value) else f"{value + 0.0:.3g}"
