"""The conditions that theory puts on the gains of the laws of the whole arm, for each of them."""

from collections.abc import Callable, Mapping

import numpy as np

from pidtsm_studies.theory.condition import Condition, hurwitz, not_covered, positive, required
from pidtsm_studies.theory.parts import Gains


def _pd(gains: Gains, source: str) -> Condition:
    """Of e'' + Kd e' + Kp e = 0."""
    kp, kd = gains["kp"], gains["kd"]
    polynomial = np.column_stack((np.ones_like(kp), kd, kp))
    cure = "set law.kp and law.kd above 0: without a disturbance e obeys e'' + Kd e' + Kp e = 0"
    return hurwitz("loop", source, "x^2 + Kd x + Kp", {"Kp": kp, "Kd": kd}, polynomial, cure)


def _slotine_li(gains: Gains) -> list[Condition]:
    source = "Slotine 1987"
    return [
        positive("slope", source, "lambda", gains["slope"], "set law.slope above 0: without it e stays where s = 0"),
        positive("rate", source, "K", gains["rate"], "set law.rate above 0: V' = -s' K s needs it"),
        positive("adaptation", source, "Gamma", gains["adaptation"], "set law.adaptation above 0: nothing is learnt"),
        *not_covered(
            "leakage",
            source,
            "no leakage",
            {"leakage": gains["leakage"]},
            gains["leakage"] > 0.0,
            "what was learnt fades, and s only comes near 0",
        ),
    ]


def _integral_sliding_mode(gains: Gains) -> list[Condition]:
    cure = "set law.gain above 0: without it no disturbance is switched against"
    return [_pd(gains, "Utkin 1996"), positive("switching gain", "Utkin 1996", "rho", gains["gain"], cure)]


def _disturbance_observer(gains: Gains) -> list[Condition]:
    return [_pd(gains, "Ohnishi 1996")]


def _impedance(gains: Gains) -> list[Condition]:
    source, cure = "Ott 2008", "above 0: without it the tool does not return to its desired pose, or never rests"
    return [
        positive(name.replace("_", " "), source, symbol, gains[name], f"set law.{name} {cure}")
        for name, symbol in (
            ("stiffness_x", "Kx"),
            ("stiffness_y", "Ky"),
            ("stiffness_z", "Kz"),
            ("rotational_stiffness", "Kr"),
            ("damping_ratio", "zeta"),
            ("null_space", "omega"),
        )
    ]


def _time_delay(gains: Gains) -> list[Condition]:
    source, ratio = "Jin 2009", gains["p_over_q"]
    cure = "set law.p_over_q between 1 and 2: otherwise e does not reach 0 in a finite time, or u is singular at e' = 0"
    return [
        positive("gain of s", source, "k1", gains["k1"], "set law.k1 above 0: without it s does not decay"),
        required("ratio of the exponents", source, "1 < p/q < 2", {"p/q": ratio}, (ratio > 1.0) & (ratio < 2.0), cure),
    ]


def _by_construction(source: str) -> Callable[[Gains], list[Condition]]:
    def rule(gains: Gains) -> list[Condition]:
        cure = "set law.bandwidth above 0"
        return [positive("bandwidth", source, "bandwidth", gains["bandwidth"], cure)]

    return rule


LAW_RULES: Mapping[str, Callable[[Gains], list[Condition]]] = {
    "disturbance_observer": _disturbance_observer,
    "impedance": _impedance,
    "integral_sliding_mode": _integral_sliding_mode,
    "linear_quadratic": _by_construction("Zhou 1998"),
    "predictive": _by_construction("Maciejowski 2002"),
    "slotine_li": _slotine_li,
    "time_delay": _time_delay,
}
"""By the name of the law."""
