"""Properties of every reaching law."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.family import SLOTS
from pidtsm_core.parameters import Array
from pidtsm_core.reaching import REACHING_LAWS, Interval, ReachingLaw, advance_reaching, switch
from pidtsm_core.signals import Adaptation

PROPERTY = settings(deadline=None, max_examples=60)
EACH = pytest.mark.parametrize("law", REACHING_LAWS.members, ids=lambda r: r.name)
SIGMAS = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -0.0, 5e-324, -1e-200])
DT = 0.001


def packed(law: ReachingLaw) -> Array:
    return law.pack({f"law.{p.name}": p.default for p in law.parameters}, "law", 1)[0]


def hold(law: ReachingLaw, sigma: float, x: Array, steps: int, frozen: bool = False) -> tuple[float, float]:
    """(tau_sw, gain) after sigma was held for some milliseconds."""
    number, p = REACHING_LAWS.index(law.name), packed(law)
    for _ in range(steps):
        advance_reaching(number, sigma, p, x, Interval(DT, frozen, Adaptation.NORMAL))
    return switch(number, sigma, p, x, DT)


@EACH
@PROPERTY
@given(sigma=SIGMAS)
def test_values_from_the_zero_state_are_finite_and_stay_so(law: ReachingLaw, sigma: float) -> None:
    x = np.zeros(SLOTS)
    for steps in (0, 1, 20):
        tau_sw, gain = hold(law, sigma, x, steps)
        assert math.isfinite(tau_sw)
        assert math.isfinite(gain)
        assert gain >= 0.0
    assert np.isfinite(x).all()


@EACH
@pytest.mark.parametrize("sigma", [1e-3, 0.05, 1.0, 100.0])
def test_the_switching_term_opposes_sigma_alike_on_both_sides(law: ReachingLaw, sigma: float) -> None:
    above, gain = hold(law, sigma, np.zeros(SLOTS), 50)
    below, gain_below = hold(law, -sigma, np.zeros(SLOTS), 50)
    assert above < 0.0
    assert below == -above
    assert gain_below == gain


@EACH
def test_without_sigma_nothing_is_switched(law: ReachingLaw) -> None:
    tau_sw, _ = hold(law, 0.0, np.zeros(SLOTS), 50)
    assert tau_sw == 0.0


@EACH
@pytest.mark.parametrize("sigma", [0.3, -50.0])
def test_a_frozen_law_does_not_adapt(law: ReachingLaw, sigma: float) -> None:
    x = np.zeros(SLOTS)
    _, before = hold(law, sigma, x, 10)
    _, after = hold(law, sigma, x, 10, frozen=True)
    assert after == before


@EACH
def test_switching_does_not_change_the_state(law: ReachingLaw) -> None:
    x = np.zeros(SLOTS)
    hold(law, 1.0, x, 5)
    kept = x.copy()
    assert hold(law, 1.0, x, 0) == hold(law, 1.0, x, 0)
    np.testing.assert_array_equal(x, kept)
