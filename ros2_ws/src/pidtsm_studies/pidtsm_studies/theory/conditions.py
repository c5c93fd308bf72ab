"""The conditions that theory puts on the gains of a law, part by part: surface, manifold, reaching law.

Most are of the article (its equation numbers are given without a name), the others of the authors of a part. They are
about the gains alone; `bounds` judges what depends on a run. Shapes in this module: (joints,) for every gain.
"""

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value
from pidtsm_studies.theory.condition import Condition, Verdict, hurwitz, not_covered, positive, required, roots_of
from pidtsm_studies.theory.parts import Gains, Parts, parts_of
from pidtsm_studies.theory.whole_arm import LAW_RULES

Rule: TypeAlias = Callable[[Gains], list[Condition]]

_POWERS = {"dual_terminal", "terminal", "fast_terminal"}
"""Surfaces on which a decaying s leaves e = (s / K1)^(1 / alpha)."""


def conditions(values: Mapping[str, Value], joints: int, inertia: Array | None = None) -> tuple[Condition, ...]:
    """All conditions of the law of a controller.

    Args:
        values: every parameter of the controller, checked.
        joints: number of joints.
        inertia: largest inertia that each joint moves, kg m^2, shape (joints,), for laws without a model; None: their
            conditions are left out.
    """
    parts = parts_of(values, joints)
    if not parts.slides:
        return tuple(_of_baseline(parts, inertia))
    found: list[Condition] = []
    for kind, name, rules in (
        ("surface", parts.surface, SURFACE_RULES),
        ("manifold", parts.manifold, MANIFOLD_RULES),
        ("reaching law", parts.reaching, REACHING_RULES),
    ):
        found += rules[name](parts.gains) if name in rules else _unknown(f"{kind} {name}", joints)
    return (*found, *_together(parts, found))


def violations(values: Mapping[str, Value], joints: int) -> list[str]:
    """What the gains of a controller violate, one sentence each; without what needs the inertias of its arm.

    Args:
        values: every parameter of the controller, checked.
        joints: number of joints.
    """
    return [
        f"law {values['law.name']}: {each.name}, eq. {each.equation}: {each.cure}"
        if each.equation.startswith("(")
        else f"law {values['law.name']}: {each.name}: {each.cure}"
        for each in conditions(values, joints)
        if each.verdict is Verdict.VIOLATED
    ]


def manifold_roots(kp: float, ki: float, kd: float) -> tuple[complex, ...]:
    """Roots of Kd x^2 + Kp x + Ki, 1/s, eq. (10), the slowest one first: the rates at which s decays on sigma = 0.

    Args:
        kp: Kp, 1/s.
        ki: Ki, 1/s^2.
        kd: Kd.
    """
    return roots_of((kd, kp, ki))


def error_rate(surface: str, gains: Gains, rate: Array) -> Array:
    """Rate at which e decays, 1/s, if s decays at `rate`.

    Where a power alpha of the error is in s, e follows as e = (s / K1)^(1 / alpha): its derivative decays faster than s
    and no longer matters. Elsewhere e is no faster than s and no faster than on s = 0.

    Args:
        surface: its name.
        gains: of the law.
        rate: of s, 1/s.
    """
    if surface in _POWERS:
        return np.where(gains["k1"] > 0.0, rate / gains["alpha"], np.minimum(rate, gains.get("k2", rate)))
    if surface == "linear":
        return np.minimum(rate, gains["k1"])
    if surface == "integral":
        own = [-roots_of((1.0, k1, k2))[0].real for k1, k2 in zip(gains["k1"], gains["k2"], strict=True)]
        return np.minimum(rate, own)
    return rate


def _dual_terminal(gains: Gains) -> list[Condition]:
    return [
        positive(
            "terminal gain",
            "(11)",
            "K1",
            gains["k1"],
            "set law.k1 above 0: without it s = 0 is e' = -K2 e, and e decays exponentially at best",
        ),
        positive(
            "linear gain",
            "(11)",
            "K2",
            gains["k2"],
            "set law.k2 above 0: the article demands it, and its settling time (47) divides by it",
        ),
        _exponent(gains, "(11)"),
        _limit(gains),
    ]


def _terminal(gains: Gains) -> list[Condition]:
    source = "Man 1994"
    cure = "set law.k1 above 0: without it nothing reduces e"
    return [positive("terminal gain", source, "K1", gains["k1"], cure), _exponent(gains, source), _limit(gains)]


def _fast_terminal(gains: Gains) -> list[Condition]:
    source = "Yu and Man 2002"
    cure = "set law.k1 above 0: without it e decays exponentially at best"
    linear = "set law.k2 above 0, or take the surface terminal: without it e decays slowly far from 0"
    return [
        positive("terminal gain", source, "K1", gains["k1"], cure),
        positive("linear gain", source, "K2", gains["k2"], linear),
        _exponent(gains, source),
        _limit(gains),
    ]


def _exponent(gains: Gains, source: str) -> Condition:
    alpha = gains["alpha"]
    cure = "set law.alpha between 0 and 1: from 1 on, e decays exponentially at best"
    return required("exponent", source, "0 < alpha < 1", {"alpha": alpha}, (alpha > 0.0) & (alpha < 1.0), cure)


def _limit(gains: Gains) -> Condition:
    cure = "set law.u_s above 0: with 0 the derivative of s has no terminal term"
    return positive("limit of u_f", "(29)", "u_s", gains["u_s"], cure)


def _fast_nonsingular(gains: Gains) -> list[Condition]:
    source, exponent, ratio = "Van 2018", gains["lambda"], gains["p_over_q"]
    return [
        positive(
            "gain of the error's power",
            source,
            "K1",
            gains["k1"],
            "set law.k1 above 0, or take the surface nonsingular_terminal: without it e decays slowly far from 0",
        ),
        positive("gain of the velocity", source, "K2", gains["k2"], "set law.k2 above 0: s needs e'"),
        _ratio(gains, source),
        required(
            "order of the exponents",
            source,
            "lambda > p/q",
            {"lambda": exponent, "p/q": ratio},
            exponent > ratio,
            "set law.lambda above law.p_over_q: otherwise the power of e does not dominate far from 0",
        ),
        *_singular(gains),
    ]


def _nonsingular_terminal(gains: Gains) -> list[Condition]:
    source = "Feng 2002"
    velocity = positive("gain of the velocity", source, "K2", gains["k2"], "set law.k2 above 0: s needs e'")
    return [velocity, _ratio(gains, source), *_singular(gains)]


def _ratio(gains: Gains, source: str) -> Condition:
    ratio = gains["p_over_q"]
    cure = "set law.p_over_q between 1 and 2: otherwise s' is singular at e' = 0, or e decays exponentially"
    return required(
        "ratio of the exponents", source, "1 < p/q < 2", {"p/q": ratio}, (ratio > 1.0) & (ratio < 2.0), cure
    )


def _singular(gains: Gains) -> list[Condition]:
    return not_covered(
        "division by zero at e' = 0",
        "Van 2018",
        "1 / (K2 (p/q) |e'|^(p/q-1))",
        {"p/q": gains["p_over_q"]},
        np.full(gains["p_over_q"].shape, True),
        "a_cmd is unbounded at e' = 0, so the torque has spikes there that only its limits bound",
    )


def _linear(gains: Gains) -> list[Condition]:
    polynomial = np.column_stack((np.ones_like(gains["k1"]), gains["k1"]))
    cure = "set law.k1 above 0: without it e does not decay on s = 0"
    return [hurwitz("surface", "Slotine 1991", "x + K1", {"K1": gains["k1"]}, polynomial, cure)]


def _integral(gains: Gains) -> list[Condition]:
    k1, k2 = gains["k1"], gains["k2"]
    polynomial = np.column_stack((np.ones_like(k1), k1, k2))
    cure = "set law.k1 and law.k2 above 0: with a root at 0 the integral of e keeps what it has, and is of no use"
    return [hurwitz("surface", "Slotine 1991", "x^2 + K1 x + K2", {"K1": k1, "K2": k2}, polynomial, cure)]


def _none(_gains: Gains) -> list[Condition]:
    return []


def _pid(gains: Gains) -> list[Condition]:
    kp, ki, kd = gains["kp"], gains["ki"], gains["kd"]
    return [
        hurwitz(
            "manifold",
            "(10)",
            "Kd x^2 + Kp x + Ki",
            {"Kp": kp, "Ki": ki, "Kd": kd},
            np.column_stack((kd, kp, ki)),
            "set law.kp, law.ki and law.kd above 0: with a root at 0 or to the right of it, s does not decay on "
            "sigma' = 0",
        )
    ]


def _adaptive_continuous(gains: Gains) -> list[Condition]:
    nothing = "the article has no such term, and sigma = 0 is no longer promised:"
    return [
        positive("pole", "(24)", "k", gains["k"], "set law.k above 0: with 0 tau_sw is a pure integrator"),
        positive("adaptation", "(27)", "kappa", gains["kappa"], "set law.kappa above 0"),
        positive("margin", "(23)", "xi", gains["xi"], "set law.xi above 0: V' <= -xi |sigma| (41) needs it"),
        positive(
            "dead zone",
            "(30)",
            "upsilon",
            gains["upsilon"],
            "set law.upsilon above the noise of sigma: with 0 the gain grows without end (Remark 6)",
        ),
        *not_covered(
            "layer",
            "(26)",
            "sign(sigma), not sigma / layer",
            {"layer": gains["layer"]},
            gains["layer"] > 0.0,
            f"{nothing} within the layer sigma only comes near 0, about layer (k |Lambda| + |Lambda'|) / (Y + xi)",
        ),
        *not_covered(
            "bound of the adaptive gain",
            "(27)",
            "Y' = |sigma| / kappa without a bound",
            {"gain_maximum": gains["gain_maximum"]},
            gains["gain_maximum"] > 0.0,
            f"{nothing} the disturbance must need less than law.gain_maximum, which a run shows",
        ),
        *not_covered(
            "leakage",
            "(27)",
            "Y' = |sigma| / kappa without leakage",
            {"leakage": gains["leakage"]},
            gains["leakage"] > 0.0,
            f"{nothing} Y fades below what the disturbance needs, and |sigma| grows until it holds Y there",
        ),
    ]


def _switching(source: str) -> Rule:
    def rule(gains: Gains) -> list[Condition]:
        cure = "set law.gain above 0: without it no disturbance is switched against"
        return [positive("switching gain", source, "gain", gains["gain"], cure)]

    return rule


def _boundary_layer(gains: Gains) -> list[Condition]:
    return [
        *_switching("Slotine 1983")(gains),
        positive("width", "Slotine 1983", "width", gains["width"], "set law.width above 0"),
    ]


def _power_rate(gains: Gains) -> list[Condition]:
    exponent = gains["exponent"]
    holds = (exponent > 0.0) & (exponent < 1.0)
    cure = "set law.exponent between 0 and 1: from 1 on, sigma decays exponentially at best"
    return [
        *_switching("Gao 1993")(gains),
        required("exponent of sigma", "Gao 1993", "0 < exponent < 1", {"exponent": exponent}, holds, cure),
    ]


def _super_twisting(gains: Gains) -> list[Condition]:
    root = "set law.gain above 0: without it sigma oscillates and does not decay"
    switched = "set law.integral_gain above 0: without it no disturbance is learnt"
    return [
        positive("gain of the root", "Levant 1993", "gain", gains["gain"], root),
        positive("gain of the switched integral", "Levant 1993", "integral_gain", gains["integral_gain"], switched),
    ]


SURFACE_RULES: Mapping[str, Rule] = {
    "dual_terminal": _dual_terminal,
    "fast_nonsingular": _fast_nonsingular,
    "fast_terminal": _fast_terminal,
    "integral": _integral,
    "linear": _linear,
    "nonsingular_terminal": _nonsingular_terminal,
    "terminal": _terminal,
}
MANIFOLD_RULES: Mapping[str, Rule] = {"none": _none, "pid": _pid}
REACHING_RULES: Mapping[str, Rule] = {
    "adaptive_continuous": _adaptive_continuous,
    "boundary_layer": _boundary_layer,
    "constant": _switching("Gao 1993"),
    "exponential": _switching("Gao 1993"),
    "power_rate": _power_rate,
    "super_twisting": _super_twisting,
}


def _unknown(part: str, joints: int) -> list[Condition]:
    """A part of the user's own, of which nothing is known."""
    return not_covered(part, "-", "-", {}, np.full(joints, True), f"no conditions are known for the {part}")


def _together(parts: Parts, found: list[Condition]) -> list[Condition]:
    """What follows from the parts together."""
    if parts.manifold == "pid" and all(each.verdict is not Verdict.VIOLATED for each in found if each.roots):
        gains = parts.gains
        rows = zip(gains["kp"], gains["ki"], gains["kd"], strict=True)
        rate = np.array([-manifold_roots(*map(float, row))[0].real for row in rows])
        follows = error_rate(parts.surface, gains, rate)
        return not_covered(
            "finite time",
            "Theorem 1",
            "s = 0 after a finite time",
            {"rate of s": rate, "rate of e": follows},
            np.full(parts.joints, True),
            "on sigma = 0, s decays exponentially at the slowest root of (10), and e with it: no finite time follows",
        )
    if parts.manifold == "none" and parts.reaching == "adaptive_continuous":
        return not_covered(
            "sigma = tau_sw + Lambda",
            "(32)",
            "a PID manifold",
            {},
            np.full(parts.joints, True),
            "without a PID manifold sigma is s, tau_sw is the rate of s and not s itself, and the proof (35) to (41) "
            "says nothing",
        )
    return []


def _of_baseline(parts: Parts, inertia: Array | None) -> list[Condition]:
    """Conditions of the laws without a surface: the linear ones of each joint alone."""
    gains = parts.gains
    if parts.law == "computed_torque":
        kp, kd = gains["kp"], gains["kd"]
        polynomial = np.column_stack((np.ones_like(kp), kd, kp))
        cure = "set law.kp and law.kd above 0: with the exact model e obeys e'' + Kd e' + Kp e = 0"
        return [hurwitz("loop", "Spong 2006", "x^2 + Kd x + Kp", {"Kp": kp, "Kd": kd}, polynomial, cure)]
    if parts.law == "pid":
        return [] if inertia is None else _pid_loop(gains, inertia)
    if parts.law in LAW_RULES:
        return LAW_RULES[parts.law](gains)
    return _unknown(f"law {parts.law}", parts.joints)


def _pid_loop(gains: Gains, inertia: Array) -> list[Condition]:
    """The loop of one joint with the filter of the derivative, while the others rest and without gravity."""
    kp, ki, kd, cutoff = (gains[name] for name in ("kp", "ki", "kd", "derivative_cutoff"))
    rows = np.column_stack((inertia, inertia * cutoff, kp + kd * cutoff, kp * cutoff + ki, ki * cutoff))
    # Without an integral there is no root of it.
    polynomial = [row if gain > 0.0 else row[:-1] for row, gain in zip(rows, ki, strict=True)]
    cure = (
        "set law.kp, law.ki and law.kd above 0 with Kp Kd > Ki J, where J is the inertia that the joint moves: the "
        "integral is too strong for the damping"
    )
    values = {"J": inertia, "Kp": kp, "Ki": ki, "Kd": kd}
    return [hurwitz("loop", "Astrom 2006", "J x^3 + Kd x^2 + Kp x + Ki", values, polynomial, cure)]
