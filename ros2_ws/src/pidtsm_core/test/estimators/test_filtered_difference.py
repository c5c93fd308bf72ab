"""The filtered difference for motions whose estimates can be calculated."""

import math
from typing import Any, TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.estimators import Sample
from pidtsm_core.estimators.filtered_difference import FILTERED_DIFFERENCE
from pidtsm_core.parameters.family import SLOTS

DT = 0.001

Floats: TypeAlias = NDArray[np.floating[Any]]
"""NumPy's type for operations between integers and floats."""


def run(
    arm: Arm, times: Floats, positions: Floats, velocity_cutoff: float, acceleration_cutoff: float
) -> tuple[Array, Array]:
    """q' and q'' of the last joint after each sample; the others have smaller motions and other cutoffs."""
    shares = np.array(arm.spread(0.1, 1.0)) if arm.joints > 1 else np.ones(1)
    p = np.zeros((arm.joints, SLOTS))
    p[:, :2] = np.outer(shares, [velocity_cutoff, acceleration_cutoff])
    x, unused = np.zeros((arm.joints, SLOTS)), np.zeros((3, arm.joints))
    estimates = np.zeros((len(positions), 3, arm.joints))
    for k, q in enumerate(np.outer(positions, shares)):
        dt = float(times[k] - times[k - 1]) if k else 0.0
        FILTERED_DIFFERENCE.estimate(Sample(q, unused[:2], dt, unused[2], arm.free, 1.0), p, x, estimates[k])
    np.testing.assert_array_equal(estimates[:, 0, -1], positions)
    return estimates[:, 1, -1], estimates[:, 2, -1]


def lag(cutoff: float) -> float:
    """Lag of a first-order filter of the last difference, s: half a sample and the filter, about 1/cutoff."""
    return DT / 2 / math.tanh(cutoff * DT / 2)


def test_the_lag_is_about_one_over_the_cutoff() -> None:
    assert lag(50.0) == pytest.approx(1 / 50.0, rel=1e-3)


@pytest.mark.parametrize("cutoffs", [(50.0, 500.0), (500.0, 500.0), (5000.0, 1000.0)])
def test_a_ramp_is_found_exactly_once_settled(arm: Arm, cutoffs: tuple[float, float]) -> None:
    times = np.arange(2000) * DT
    dq, ddq = run(arm, times, 0.3 + 2.0 * times, *cutoffs)
    assert dq[-1] == pytest.approx(2.0, rel=1e-10)
    assert ddq[-1] == pytest.approx(0.0, abs=1e-8)


@settings(deadline=None, max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_a_ramp_is_found_exactly_at_irregular_times(arm: Arm, seed: int) -> None:
    times = np.cumsum(np.random.default_rng(seed).uniform(0.0002, 0.004, 400))
    dq, ddq = run(arm, times, -1.5 * times, 500.0, 500.0)
    assert dq[-1] == pytest.approx(-1.5, rel=1e-9)
    assert ddq[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("cutoffs", [(50.0, 500.0), (500.0, 100.0), (5000.0, 1000.0)])
def test_a_parabola_is_followed_with_the_lag_of_the_filter(arm: Arm, cutoffs: tuple[float, float]) -> None:
    acceleration = 3.0
    times = np.arange(2000) * DT
    dq, ddq = run(arm, times, 0.5 * acceleration * times**2, *cutoffs)
    assert ddq[-1] == pytest.approx(acceleration, rel=1e-6)
    bias = acceleration * times[-1] - dq[-1]
    assert bias == pytest.approx(acceleration * lag(cutoffs[0]), rel=1e-6)


@pytest.mark.parametrize("cutoffs", [(200.0, 500.0), (500.0, 500.0), (5000.0, 1000.0)])
def test_a_sine_is_followed_within_its_lag(arm: Arm, cutoffs: tuple[float, float]) -> None:
    omega, size = 5.0, 0.4
    times = np.arange(3000) * DT
    dq, ddq = run(arm, times, size * np.sin(omega * times), *cutoffs)
    late = times - lag(cutoffs[0])
    later = late - lag(cutoffs[1])
    settled = times > 1.0
    # The delay explains all but the second order of omega times the lag.
    slack = (omega * (lag(cutoffs[0]) + lag(cutoffs[1]))) ** 2
    np.testing.assert_allclose(dq[settled], size * omega * np.cos(omega * late)[settled], atol=slack * size * omega)
    np.testing.assert_allclose(
        ddq[settled], -size * omega**2 * np.sin(omega * later)[settled], atol=slack * size * omega**2
    )


def test_the_filter_is_discretised_exactly(arm: Arm) -> None:
    # After a step of the difference to 1, a filter with cutoff c has the value 1 - exp(-c t), for any sampling.
    for dt in (0.001, 0.01):
        times = np.arange(0.0, 0.1005, dt)
        dq, _ = run(arm, times, times, 30.0, 30.0)
        np.testing.assert_allclose(dq, 1.0 - np.exp(-30.0 * times), rtol=1e-9, atol=1e-12)
