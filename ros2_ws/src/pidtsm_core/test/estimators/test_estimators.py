"""Properties of every estimator."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.testarms import ROTOR, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.estimators import ESTIMATORS, Estimator, Sample, estimate, estimator_address
from pidtsm_core.parameters.family import SLOTS

PROPERTY = settings(deadline=None, max_examples=10)
EACH = pytest.mark.parametrize("estimator", ESTIMATORS.members, ids=lambda e: e.name)
SENSED = pytest.mark.parametrize(
    "estimator", [e for e in ESTIMATORS.members if not e.needs_truth], ids=lambda e: e.name
)
ELASTIC = {"estimator.stiffness": 10_000.0, "estimator.damping": 100.0}
"""N m/rad and N m s/rad, for an estimator that knows elastic joints."""


def different(arm: Arm) -> Array:
    """A factor for each joint."""
    return arm.alternating(1.0) * arm.spread(1.0, 0.25)


def run(estimator: Estimator, arm: Arm, positions: Array, dts: Array, truth: Array | None = None) -> Array:
    """Estimates after each sample, shape (samples, 3, joints); dt is 0 at the first sample."""
    joints = arm.joints
    values = {f"estimator.{q.name}": q.default for q in estimator.parameters}
    values |= {name: value for name, value in ELASTIC.items() if name in values}
    p = estimator.make_parameters(values, np.full(joints, 0.2 * ROTOR), np.full(joints, ROTOR))
    x = np.zeros((joints + (estimator.rows(joints) if estimator.rows else 0), SLOTS))
    truth = np.zeros((len(positions), 2, joints)) if truth is None else truth
    estimates = np.full((len(positions), 3, joints), np.nan)
    address, effort = estimator_address(estimator), np.zeros(joints)
    for k, q in enumerate(positions):
        dt = float(dts[k]) if k else 0.0
        estimate(address, Sample(q, truth[k], dt, effort, arm.free, 1.0), p, x, estimates[k])
    return estimates


@EACH
@PROPERTY
@given(positions=st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=40), seed=st.integers(0, 2**32 - 1))
def test_estimates_are_finite_for_any_measurements_at_any_times(
    arm: Arm, estimator: Estimator, positions: list[float], seed: int
) -> None:
    dts = np.random.default_rng(seed).uniform(1e-6, 0.1, len(positions))
    assert np.isfinite(run(estimator, arm, np.outer(positions, different(arm)), dts)).all()


@EACH
def test_the_first_sample_is_at_rest(arm: Arm, estimator: Estimator) -> None:
    rest = np.zeros(arm.joints)
    (first,) = run(estimator, arm, np.array([arm.start]), np.zeros(1))
    np.testing.assert_array_equal(first, [arm.start, rest, rest])


@EACH
@PROPERTY
@given(q=st.floats(-10.0, 10.0))
def test_an_arm_at_rest_stays_at_rest(arm: Arm, estimator: Estimator, q: float) -> None:
    positions = np.tile(q * different(arm), (50, 1))
    estimates = run(estimator, arm, positions, np.full(50, 0.001))
    np.testing.assert_allclose(estimates[:, 0], positions, rtol=1e-12)
    np.testing.assert_allclose(estimates[:, 1:], 0.0, atol=1e-9)


@EACH
@PROPERTY
@given(steps=st.lists(st.integers(-1000, 1000), min_size=2, max_size=40), offset=st.integers(-8, 8))
def test_derivatives_do_not_depend_on_where_zero_is(
    arm: Arm, estimator: Estimator, steps: list[int], offset: int
) -> None:
    # Multiples of 2^-20, so that adding the offset causes no rounding.
    positions = np.array(steps, dtype=float)[:, None] * arm.alternating(2.0**-20)
    dts = np.full(len(steps), 0.001)
    here, there = run(estimator, arm, positions, dts), run(estimator, arm, positions + offset, dts)
    np.testing.assert_allclose(there[:, 1:], here[:, 1:], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(there[:, 0], here[:, 0] + offset, rtol=0, atol=1e-12)


@SENSED
@PROPERTY
@given(lost=st.sets(st.integers(1500, 1599)))
def test_a_gap_counts_with_its_actual_duration(arm: Arm, estimator: Estimator, lost: set[int]) -> None:
    # At a constant velocity, which every estimator has found by then, a gap counted as one period would be a jump.
    times = 0.001 * np.array([k for k in range(1620) if k not in lost])
    velocities = 2.0 * different(arm)
    estimates = run(estimator, arm, np.outer(times, velocities), np.diff(times, prepend=0.0))
    np.testing.assert_allclose(estimates[1500:, 1], np.broadcast_to(velocities, estimates[1500:, 1].shape), rtol=1e-6)


@EACH
def test_joints_do_not_mix(arm: Arm, estimator: Estimator) -> None:
    positions = np.random.default_rng(1).uniform(-1, 1, (30, arm.joints))
    dts = np.full(30, 0.001)
    forwards, backwards = run(estimator, arm, positions, dts), run(estimator, arm, positions[:, ::-1].copy(), dts)
    np.testing.assert_array_equal(forwards, backwards[:, :, ::-1])


@pytest.mark.parametrize("estimator", [e for e in ESTIMATORS.members if e.needs_truth], ids=lambda e: e.name)
def test_the_truth_passes_through(arm: Arm, estimator: Estimator) -> None:
    random = np.random.default_rng(2)
    positions, truth = random.normal(size=(20, arm.joints)), random.normal(size=(20, 2, arm.joints))
    estimates = run(estimator, arm, positions, np.full(20, 0.001), truth)
    np.testing.assert_array_equal(estimates[:, 0], positions)
    np.testing.assert_array_equal(estimates[:, 1:], truth)


@SENSED
def test_the_truth_is_ignored(arm: Arm, estimator: Estimator) -> None:
    positions = np.random.default_rng(3).uniform(-1, 1, (20, arm.joints))
    dts = np.full(20, 0.001)
    secret = np.full((20, 2, arm.joints), np.nan)
    np.testing.assert_array_equal(run(estimator, arm, positions, dts), run(estimator, arm, positions, dts, secret))
