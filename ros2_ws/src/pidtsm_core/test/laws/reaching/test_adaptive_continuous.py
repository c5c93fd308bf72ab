"""The article's reaching law against the solution of eqs. (25), (27), (30) for a held sigma."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.reaching.adaptive_continuous import ADAPTIVE_CONTINUOUS
from pidtsm_core.laws.reaching.base import Interval
from pidtsm_core.signals import Adaptation

K, KAPPA, XI, UPSILON = 2.0, 0.1, 0.3, 0.2

switch, advance = njit(ADAPTIVE_CONTINUOUS.switch), njit(ADAPTIVE_CONTINUOUS.advance)


def gains(arm: Arm, leakage: float = 0.0, maximum: float = 0.0, layer: float = 0.0) -> Array:
    """Packed gains of the last joint; the others have other ones."""
    values = (K, KAPPA, XI, UPSILON, leakage, maximum, layer)
    named = zip(ADAPTIVE_CONTINUOUS.parameters, values, strict=True)
    return ADAPTIVE_CONTINUOUS.pack({f"law.{p.name}": arm.last(value) for p, value in named}, "law", arm.joints)[-1]


def hold(
    p: Array,
    sigma: float,
    time: float,
    steps: int,
    x: Array | None = None,
    frozen: bool = False,
    adaptation: Adaptation = Adaptation.NORMAL,
) -> tuple[float, float]:
    x, interval = np.zeros(8) if x is None else x, Interval(time / steps, frozen, adaptation.value)
    for _ in range(steps):
        advance(sigma, p, x, interval)
    return switch(sigma, p, x, 0.001)


def solution(sigma: float, t: float) -> tuple[float, float]:
    """tau_sw and Y of (25), (27) from zero: Y is a ramp, which a first-order filter follows with a lag."""
    slope = abs(sigma) / KAPPA if abs(sigma) > UPSILON else 0.0
    faded = 1.0 - math.exp(-K * t)
    size = XI * faded / K + slope * (t / K - faded / K**2)
    return -math.copysign(size, sigma), slope * t


@pytest.mark.parametrize("sigma", [1.5, -1.5, 0.1, -0.1])
def test_a_held_sigma_gives_the_closed_form_to_first_order(arm: Arm, sigma: float) -> None:
    tau_sw, gain = solution(sigma, 1.0)
    errors = []
    for steps in (500, 1000, 2000):
        got_tau, got_gain = hold(gains(arm), sigma, 1.0, steps)
        assert got_gain == pytest.approx(gain, rel=1e-10)
        errors.append(abs(got_tau - tau_sw))
    assert errors[-1] < 1e-3 * abs(tau_sw)
    # Explicit Euler: half the step, half the error.
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.05)
    assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.05)


@settings(deadline=None, max_examples=12)
@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=50))
def test_the_gain_never_decreases_and_rests_in_the_dead_zone(arm: Arm, sigmas: list[float]) -> None:
    x, p = np.zeros(8), gains(arm)
    gain = 0.0
    for sigma in sigmas:
        _, after = hold(p, sigma, 0.001, 1, x)
        assert after == (gain if abs(sigma) <= UPSILON else pytest.approx(gain + 0.001 * abs(sigma) / KAPPA))
        assert after >= gain
        gain = after


@pytest.mark.parametrize("sigma", [UPSILON, -UPSILON, 0.0])
def test_the_border_belongs_to_the_dead_zone(arm: Arm, sigma: float) -> None:
    assert hold(gains(arm), sigma, 0.1, 10)[1] == 0.0
    assert hold(gains(arm), math.nextafter(UPSILON, 1.0), 0.1, 10)[1] > 0.0


def test_while_frozen_the_filter_goes_on_with_the_gain_it_has(arm: Arm) -> None:
    x = np.zeros(8)
    x[1] = 4.0
    tau_sw, gain = hold(gains(arm), 1.0, 20.0, 2000, x, frozen=True)
    assert gain == 4.0
    assert tau_sw == pytest.approx(-(4.0 + XI) / K, rel=1e-6)


@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("dt", [0.001, 10.0])
def test_with_leakage_the_gain_settles_where_growth_and_leakage_meet(arm: Arm, frozen: bool, dt: float) -> None:
    leakage, sigma = 5.0, 1.5
    _, gain = hold(gains(arm, leakage=leakage), sigma, 4000 * dt, 4000, frozen=frozen)
    assert gain == pytest.approx(0.0 if frozen else abs(sigma) / KAPPA / leakage, rel=1e-6)


@pytest.mark.parametrize("frozen", [False, True])
def test_the_gain_leaks_in_the_dead_zone_and_while_frozen(arm: Arm, frozen: bool) -> None:
    leakage = 0.5
    x = np.array([0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    _, gain = hold(gains(arm, leakage=leakage), 1.5 if frozen else 0.5 * UPSILON, 1.0, 2500, x, frozen)
    assert gain == pytest.approx(4.0 * math.exp(-leakage), rel=1e-4)


@settings(deadline=None, max_examples=12)
@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=50), st.floats(1e-3, 1e3))
def test_the_gain_stays_within_its_bound_and_is_the_article_s_below_it(
    arm: Arm, sigmas: list[float], maximum: float
) -> None:
    x, free = np.zeros(8), np.zeros(8)
    for sigma in sigmas:
        _, gain = hold(gains(arm, maximum=maximum), sigma, 0.1, 1, x)
        _, article = hold(gains(arm), sigma, 0.1, 1, free)
        assert gain == min(article, maximum)


def test_without_leakage_and_bound_nothing_limits_the_gain(arm: Arm) -> None:
    assert hold(gains(arm), 1.5, 1e6, 100)[1] == pytest.approx(1.5e6 / KAPPA)


@pytest.mark.parametrize("sigma", [0.0, 0.01, -0.01, 0.05, 1.5, -1.5])
def test_within_the_layer_the_sign_rises_straight_and_beyond_it_is_the_article_s(arm: Arm, sigma: float) -> None:
    layer = 0.02
    tau_sw, gain = hold(gains(arm, layer=layer), sigma, 1.0, 1000)
    article, article_gain = hold(gains(arm), math.copysign(max(abs(sigma), layer), sigma), 1.0, 1000)
    if abs(sigma) >= layer:
        assert (tau_sw, gain) == (article, article_gain)
    else:
        assert tau_sw == pytest.approx(-sigma / layer * abs(article), rel=1e-12)
        assert gain == 0.0


@pytest.mark.parametrize("sigma", [0.1, -0.1])
def test_on_the_way_to_a_reference_the_gain_learns_within_the_dead_zone_too(arm: Arm, sigma: float) -> None:
    _, gain = hold(gains(arm), sigma, 1.0, 1000, adaptation=Adaptation.APPROACHING)
    # The mean follows the held sigma within 0.05 s.
    assert gain == pytest.approx((1.0 - 0.05) * abs(sigma) / KAPPA, rel=0.01)
    assert hold(gains(arm), sigma, 1.0, 1000)[1] == 0.0


def test_on_the_way_to_a_reference_noise_within_the_dead_zone_hardly_increases_the_gain(arm: Arm) -> None:
    p, x, noise = gains(arm), np.zeros(8), np.random.default_rng(1).normal(scale=0.05, size=1000)
    for sigma in noise:
        hold(p, sigma, 0.001, 1, x, adaptation=Adaptation.APPROACHING)
    assert 0.0 < x[1] < 0.2 * np.abs(noise).mean() / KAPPA


@pytest.mark.parametrize("sigma", [0.1, 1.5])
def test_while_the_adaptation_is_frozen_the_gain_stays(arm: Arm, sigma: float) -> None:
    x = np.zeros(8)
    x[1] = 4.0
    tau_sw, gain = hold(gains(arm), sigma, 20.0, 2000, x, adaptation=Adaptation.FROZEN)
    assert gain == 4.0
    assert tau_sw == pytest.approx(-(4.0 + XI) / K, rel=1e-6)


def test_the_switching_term_is_continuous_in_sigma(arm: Arm) -> None:
    x, p = np.zeros(8), gains(arm)
    hold(p, 1.0, 0.1, 100, x)
    assert ADAPTIVE_CONTINUOUS.switch(1.0, p, x, 0.001) == ADAPTIVE_CONTINUOUS.switch(-1.0, p, x, 0.001)


def test_the_defaults_are_those_of_table_1() -> None:
    defaults = {p.name: p.default for p in ADAPTIVE_CONTINUOUS.parameters}
    assert (defaults["k"], defaults["kappa"]) == (1.0, 0.01)
