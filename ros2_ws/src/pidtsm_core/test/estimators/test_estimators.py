"""Properties of every estimator."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.estimators import ESTIMATORS, Estimator, Sample, estimate
from pidtsm_core.family import SLOTS
from pidtsm_core.parameters import Array
from pidtsm_core.robots import make_model
from pidtsm_core.robots.two_link import TWO_LINK

PROPERTY = settings(deadline=None, max_examples=40)
EACH = pytest.mark.parametrize("estimator", ESTIMATORS.members, ids=lambda e: e.name)
SENSED = pytest.mark.parametrize(
    "estimator", [e for e in ESTIMATORS.members if not e.needs_truth], ids=lambda e: e.name
)
POSITIONS = st.lists(st.tuples(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0)), min_size=1, max_size=40)


# A robot model without masses for tests that do not depend on the model: the joints are independent and do not fall.
FREE = make_model(
    TWO_LINK,
    TWO_LINK.pack_model({f"robot.{p.name}": 0.0 if p.name in ("m1", "m2") else p.default for p in TWO_LINK.parameters}),
)


def run(estimator: Estimator, positions: Array, dts: Array, truth: Array | None = None) -> Array:
    """Estimates after each sample, shape (samples, 3, joints); dt is 0 at the first sample."""
    joints = positions.shape[1]
    p = estimator.pack({f"estimator.{q.name}": q.default for q in estimator.parameters}, "estimator", joints)
    x = np.zeros((joints, SLOTS))
    truth = np.zeros((len(positions), 2, joints)) if truth is None else truth
    estimates = np.full((len(positions), 3, joints), np.nan)
    number, effort = ESTIMATORS.index(estimator.name), np.zeros(joints)
    for k, q in enumerate(positions):
        dt = float(dts[k]) if k else 0.0
        estimate(number, Sample(q, truth[k], dt, effort, FREE), p, x, estimates[k])
    return estimates


@EACH
@PROPERTY
@given(positions=POSITIONS, seed=st.integers(0, 2**32 - 1))
def test_estimates_are_finite_for_any_measurements_at_any_times(
    estimator: Estimator, positions: list[tuple[float, float]], seed: int
) -> None:
    dts = np.random.default_rng(seed).uniform(1e-6, 0.1, len(positions))
    assert np.isfinite(run(estimator, np.array(positions), dts)).all()


@EACH
def test_the_first_sample_is_at_rest(estimator: Estimator) -> None:
    (first,) = run(estimator, np.array([[0.3, -2.0]]), np.zeros(1))
    np.testing.assert_array_equal(first, [[0.3, -2.0], [0.0, 0.0], [0.0, 0.0]])


@EACH
@PROPERTY
@given(q=st.floats(-10.0, 10.0))
def test_an_arm_at_rest_stays_at_rest(estimator: Estimator, q: float) -> None:
    estimates = run(estimator, np.full((50, 2), q), np.full(50, 0.001))
    np.testing.assert_allclose(estimates[:, 0], q, rtol=1e-12)
    np.testing.assert_allclose(estimates[:, 1:], 0.0, atol=1e-9)


@EACH
@PROPERTY
@given(steps=st.lists(st.integers(-1000, 1000), min_size=2, max_size=40), offset=st.integers(-8, 8))
def test_derivatives_do_not_depend_on_where_zero_is(estimator: Estimator, steps: list[int], offset: int) -> None:
    # Multiples of 2^-20, so that adding the offset causes no rounding.
    positions = np.array(steps, dtype=float)[:, None] * [2.0**-20, -(2.0**-20)]
    dts = np.full(len(steps), 0.001)
    here, there = run(estimator, positions, dts), run(estimator, positions + offset, dts)
    np.testing.assert_allclose(there[:, 1:], here[:, 1:], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(there[:, 0], here[:, 0] + offset, rtol=0, atol=1e-12)


@SENSED
@PROPERTY
@given(lost=st.sets(st.integers(1000, 1099)))
def test_a_gap_counts_with_its_actual_duration(estimator: Estimator, lost: set[int]) -> None:
    # At a constant velocity, which every estimator has found by then, a gap counted as one period would be a jump.
    times = 0.001 * np.array([k for k in range(1120) if k not in lost])
    estimates = run(estimator, np.outer(times, [0.5, -2.0]), np.diff(times, prepend=0.0))
    np.testing.assert_allclose(estimates[1000:, 1], np.broadcast_to([0.5, -2.0], estimates[1000:, 1].shape), rtol=1e-6)


@EACH
def test_joints_do_not_mix(estimator: Estimator) -> None:
    positions = np.random.default_rng(1).uniform(-1, 1, (30, 2))
    dts = np.full(30, 0.001)
    both, swapped = run(estimator, positions, dts), run(estimator, positions[:, ::-1].copy(), dts)
    np.testing.assert_array_equal(both, swapped[:, :, ::-1])


@pytest.mark.parametrize("estimator", [e for e in ESTIMATORS.members if e.needs_truth], ids=lambda e: e.name)
def test_the_truth_passes_through(estimator: Estimator) -> None:
    random = np.random.default_rng(2)
    positions, truth = random.normal(size=(20, 2)), random.normal(size=(20, 2, 2))
    estimates = run(estimator, positions, np.full(20, 0.001), truth)
    np.testing.assert_array_equal(estimates[:, 0], positions)
    np.testing.assert_array_equal(estimates[:, 1:], truth)


@SENSED
def test_the_truth_is_ignored(estimator: Estimator) -> None:
    positions = np.random.default_rng(3).uniform(-1, 1, (20, 2))
    dts = np.full(20, 0.001)
    secret = np.full((20, 2, 2), np.nan)
    np.testing.assert_array_equal(run(estimator, positions, dts), run(estimator, positions, dts, secret))
