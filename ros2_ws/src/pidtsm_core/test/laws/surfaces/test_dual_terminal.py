"""The dual terminal surface against eqs. (11), (13), (29), by hand."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.testarms import Arm

from pidtsm_core.laws.surfaces.dual_terminal import DUAL_TERMINAL

K1, K2, ALPHA, U_S = 3.0, 0.5, 0.5, 5.0
ROUNDING = 1e-12  # a smaller velocity is none


def evaluate(arm: Arm, e: float, de: float) -> tuple[float, float, float]:
    """s, g and h of the last joint; the others have other gains."""
    gains = {"law.k1": K1, "law.k2": K2, "law.alpha": ALPHA, "law.u_s": U_S}
    p = DUAL_TERMINAL.pack({name: arm.last(value) for name, value in gains.items()}, "law", arm.joints)
    return DUAL_TERMINAL.evaluate(e, de, 0.0, p[-1])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_values_by_hand(arm: Arm, sign: float) -> None:
    # e = 0.25, e' = 2: e^[0.5] = 0.5, e^3 = 0.015625, u_f = 2 / 0.5 = 4, 3 e^2 e' = 0.375.
    s, g, h = evaluate(arm, sign * 0.25, sign * 2.0)
    assert s == pytest.approx(sign * (2.0 + 3.0 * 0.515625 + 0.125), rel=1e-15)
    assert g == 1.0
    assert h == pytest.approx(sign * (3.0 * (0.5 * 4.0 + 0.375) + 1.0), rel=1e-15)


@pytest.mark.parametrize("e", [0.0, -0.0])
@pytest.mark.parametrize("de", [2.0, -2.0, 1e-11, -1e-11, 1e-13, -1e-300, 0.0, -0.0])
def test_without_error_u_f_is_its_limit_in_the_direction_of_the_velocity(arm: Arm, e: float, de: float) -> None:
    u_f = 0.0 if abs(de) < ROUNDING else math.copysign(U_S, de)
    s, _, h = evaluate(arm, e, de)
    assert s == de
    assert h == K1 * ALPHA * u_f + K2 * de


@settings(deadline=None, max_examples=25)
@given(e=st.floats(-10.0, 10.0), de=st.floats(-100.0, 100.0))
def test_u_f_is_limited_and_untouched_below_the_limit(arm: Arm, e: float, de: float) -> None:
    _, _, h = evaluate(arm, e, de)
    u_f = (h - K2 * de - K1 * 3.0 * e * e * de) / (K1 * ALPHA)
    # |e|^(alpha-1) e' of (13), if it is a number; the tolerance covers rounding of the cubic term in h.
    wanted = de / math.sqrt(abs(e)) if e != 0.0 else math.copysign(math.inf, de) * (de != 0.0 or math.nan)
    wanted = 0.0 if abs(de) < ROUNDING else min(max(wanted, -U_S), U_S)
    assert u_f == pytest.approx(wanted, rel=1e-12, abs=1e-14 * (1.0 + 3.0 * e * e * abs(de)))


def test_the_defaults_are_those_of_table_1() -> None:
    assert {p.name: p.default for p in DUAL_TERMINAL.parameters} == {"k1": 3.0, "k2": 0.5, "alpha": 7 / 9, "u_s": 5.0}
