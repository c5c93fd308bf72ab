"""The robust exact differentiator: exact, without chattering, within its bounds in noise."""

from typing import Any, TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.estimators import Sample
from pidtsm_core.estimators.robust_differentiator import ROBUST_DIFFERENTIATOR
from pidtsm_core.parameters.family import SLOTS

DT = 0.001

Floats: TypeAlias = NDArray[np.floating[Any]]
"""NumPy's type for operations between integers and floats."""


def run(arm: Arm, times: Floats, positions: Floats, jerk: float) -> tuple[Array, Array, Array]:
    """q, q' and q'' of the last joint after each sample; the others have smaller motions and bounds."""
    shares = np.array(arm.spread(0.1, 1.0)) if arm.joints > 1 else np.ones(1)
    p, x = np.outer(shares, np.full(SLOTS, jerk)), np.zeros((arm.joints, SLOTS))
    unused, estimates = np.zeros((3, arm.joints)), np.zeros((len(times), 3, arm.joints))
    for k, q in enumerate(np.outer(positions, shares)):
        dt = float(times[k] - times[k - 1]) if k else 0.0
        ROBUST_DIFFERENTIATOR.estimate(Sample(q, unused[:2], dt, unused[2], arm.free, 1.0), p, x, estimates[k])
    return estimates[:, 0, -1], estimates[:, 1, -1], estimates[:, 2, -1]


@settings(deadline=None, max_examples=5)
@given(seed=st.integers(0, 2**32 - 1), acceleration=st.floats(-3.0, 3.0))
def test_a_parabola_is_found_exactly_in_finite_time_at_irregular_times_and_over_gaps(
    arm: Arm, seed: int, acceleration: float
) -> None:
    random = np.random.default_rng(seed)
    periods = random.uniform(0.0005, 0.0015, 1500) * random.choice([1.0, 20.0], 1500, p=[0.98, 0.02])
    times = np.cumsum(periods)
    q, dq, ddq = run(arm, times, 0.3 - 2.0 * times + 0.5 * acceleration * times**2, 50.0)
    settled = times - times[0] > 1.0
    np.testing.assert_allclose(q[settled], (0.3 - 2.0 * times + 0.5 * acceleration * times**2)[settled], atol=1e-12)
    np.testing.assert_allclose(dq[settled], (acceleration * times - 2.0)[settled], atol=1e-8)
    np.testing.assert_allclose(ddq[settled], acceleration, atol=1e-5)


@pytest.mark.parametrize("jerk", [30.0, 3000.0])
def test_the_errors_of_a_sine_are_those_of_one_period_and_there_is_no_chattering(arm: Arm, jerk: float) -> None:
    omega, size = 4.0, 0.4
    times = np.arange(3000) * DT
    q, dq, ddq = run(arm, times, size * np.sin(omega * times), jerk)
    settled = times > 1.5
    largest = size * omega**3
    np.testing.assert_allclose(q[settled], (size * np.sin(omega * times))[settled], atol=1e-14)
    # Divided differences: T^2 / 3 of the third derivative in q', T in q''.
    np.testing.assert_allclose(dq[settled], (size * omega * np.cos(omega * times))[settled], atol=largest * DT**2 / 2)
    np.testing.assert_allclose(
        ddq[settled], (-size * omega**2 * np.sin(omega * times))[settled], atol=1.01 * largest * DT
    )
    # A discontinuous sign would step q'' by 1.1 L T every period.
    assert np.abs(np.diff(ddq[settled])).max() < 1.01 * largest * DT


@pytest.mark.parametrize("size", [1e-5, 1e-3])
@pytest.mark.parametrize("jerk", [10.0, 1000.0])
def test_noise_does_not_add_more_than_the_order_of_levant_s_bounds(arm: Arm, size: float, jerk: float) -> None:
    noise = size * np.random.default_rng(4).uniform(-1.0, 1.0, 8000)
    _, dq, ddq = run(arm, np.arange(8000) * DT, noise, jerk)
    assert np.abs(dq[2000:]).max() < 5.0 * jerk ** (1 / 3) * size ** (2 / 3)
    assert np.abs(ddq[2000:]).max() < 5.0 * jerk ** (2 / 3) * size ** (1 / 3)


def test_noise_is_multiplied_less_than_by_a_difference(arm: Arm) -> None:
    noise = 1e-4 * np.random.default_rng(4).standard_normal(8000)
    _, dq, ddq = run(arm, np.arange(8000) * DT, noise, 100.0)
    assert dq[2000:].std() < 0.1 * (np.diff(noise) / DT).std()
    assert ddq[2000:].std() < 0.01 * (np.diff(noise, 2) / DT**2).std()


def test_the_estimate_of_q_is_smoother_than_the_measurement(arm: Arm) -> None:
    noise = 1e-3 * np.random.default_rng(4).standard_normal(8000)
    q, _, _ = run(arm, np.arange(8000) * DT, noise, 100.0)
    assert q[2000:].std() < 0.6 * noise.std()
