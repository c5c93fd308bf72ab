"""Properties of every reaching law, for the last joint of each arm."""

import math
from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from support.pairs import paired
from support.testarms import ARMS, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.reaching import REACHING_LAWS, Interval, ReachingLaw
from pidtsm_core.parameters import Value, as_float
from pidtsm_core.parameters.family import SLOTS
from pidtsm_core.signals import Adaptation

PROPERTY = settings(deadline=None, max_examples=15)
LAWS = REACHING_LAWS.members
EACH = paired("law,arm", LAWS, ARMS)
SIGMAS = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -0.0, 5e-324, -1e-200])
DT = 0.001
COMPILED = {law.name: (njit(law.switch), njit(law.advance)) for law in REACHING_LAWS.members}


@cache
def packed(law: ReachingLaw, arm: Arm) -> Array:
    """Gains of the last joint; the others have other ones."""
    values: dict[str, Value] = {}
    for parameter in law.parameters:
        value = as_float(parameter.default)
        values[f"law.{parameter.name}"] = arm.last(value) if parameter.per_joint else value
    return law.pack(values, "law", arm.joints)[-1]


def hold(arm: Arm, law: ReachingLaw, sigma: float, x: Array, steps: int, frozen: bool = False) -> tuple[float, float]:
    """(tau_sw, gain) after sigma was held for some milliseconds."""
    (switch, advance), p = COMPILED[law.name], packed(law, arm)
    for _ in range(steps):
        advance(sigma, p, x, Interval(DT, frozen, Adaptation.NORMAL.value))
    return switch(sigma, p, x, DT)


@EACH
@PROPERTY
@given(sigma=SIGMAS)
def test_values_from_the_zero_state_are_finite_and_stay_so(arm: Arm, law: ReachingLaw, sigma: float) -> None:
    x = np.zeros(SLOTS)
    for steps in (0, 1, 20):
        tau_sw, gain = hold(arm, law, sigma, x, steps)
        assert math.isfinite(tau_sw)
        assert math.isfinite(gain)
        assert gain >= 0.0
    assert np.isfinite(x).all()


@EACH
def test_the_switching_term_opposes_sigma_alike_on_both_sides(arm: Arm, law: ReachingLaw) -> None:
    for sigma in (1e-3, 0.05, 1.0, 100.0):
        above, gain = hold(arm, law, sigma, np.zeros(SLOTS), 50)
        below, gain_below = hold(arm, law, -sigma, np.zeros(SLOTS), 50)
        assert above < 0.0, sigma
        assert below == -above, sigma
        assert gain_below == gain, sigma


@EACH
def test_without_sigma_nothing_is_switched(arm: Arm, law: ReachingLaw) -> None:
    tau_sw, _ = hold(arm, law, 0.0, np.zeros(SLOTS), 50)
    assert tau_sw == 0.0


@EACH
def test_a_frozen_law_does_not_adapt(arm: Arm, law: ReachingLaw) -> None:
    for sigma in (0.3, -50.0):
        x = np.zeros(SLOTS)
        _, before = hold(arm, law, sigma, x, 10)
        _, after = hold(arm, law, sigma, x, 10, frozen=True)
        assert after == before, sigma


@EACH
def test_switching_does_not_change_the_state(arm: Arm, law: ReachingLaw) -> None:
    x = np.zeros(SLOTS)
    hold(arm, law, 1.0, x, 5)
    kept = x.copy()
    assert hold(arm, law, 1.0, x, 0) == hold(arm, law, 1.0, x, 0)
    np.testing.assert_array_equal(x, kept)
