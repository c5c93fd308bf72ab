"""The observer for an arm with known torque and disturbance; its lag and noise against the theory."""

import math
from typing import Any, TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from support.testarms import ROTOR, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.estimators import Sample
from pidtsm_core.estimators.extended_state import EXTENDED_STATE_OBSERVER
from pidtsm_core.parameters.family import SLOTS
from pidtsm_core.robots import Model, forward_dynamics

DT = 0.001

Floats: TypeAlias = NDArray[np.floating[Any]]
"""NumPy's type for operations between integers and floats."""


def observe(times: Floats, positions: Floats, efforts: Array, model: Model, bandwidth: float) -> Array:
    """Estimates of q, q', q'' after each sample, shape (samples, 3, joints); efforts[k] is held from sample k on."""
    joints = positions.shape[1]
    p, x = np.full((joints, SLOTS), bandwidth), np.zeros((joints, SLOTS))
    estimates, truth = np.zeros((len(times), 3, joints)), np.zeros((2, joints))
    for k, q in enumerate(positions):
        dt, held = (float(times[k] - times[k - 1]), efforts[k - 1]) if k else (0.0, efforts[0])
        EXTENDED_STATE_OBSERVER.estimate(Sample(q, truth, dt, held, model, 1.0), p, x, estimates[k])
    return estimates


def alike(values: Floats, arm: Arm) -> Array:
    """The same values for all joints, shape (samples, joints)."""
    return np.outer(values, np.ones(arm.joints))


def swing(arm: Arm, times: Array, disturbance: Array) -> tuple[Array, Array, Array]:
    """Motion of the arm under varying torques, in fine steps: q, q'; q'' before each sample; the torques."""
    efforts = arm.inertia * np.sin(np.outer(times, arm.spread(1.3, 2.1)))
    states, accelerations = np.zeros((len(times), 2, arm.joints)), np.zeros((len(times), arm.joints))
    q, dq, ddq = np.array(arm.start), np.zeros(arm.joints), np.zeros(arm.joints)
    states[0, 0] = q
    for k in range(1, len(times)):
        efforts[k - 1] += arm.effort(q)
        h = (times[k] - times[k - 1]) / 10
        for _ in range(10):
            forward_dynamics(arm.model, q, dq, efforts[k - 1], ddq)
            middle = dq + 0.5 * h * (ddq + disturbance)
            forward_dynamics(arm.model, q + 0.5 * h * dq, middle, efforts[k - 1], ddq)
            q = q + h * middle
            dq = dq + h * (ddq + disturbance)
        forward_dynamics(arm.model, q, dq, efforts[k - 1], ddq)
        states[k], accelerations[k] = (q, dq), ddq + disturbance
    return states, accelerations, efforts


@settings(deadline=None, max_examples=3)
@given(seed=st.integers(0, 2**32 - 1))
def test_motion_and_disturbance_are_found_at_irregular_times_and_over_gaps(arm: Arm, seed: int) -> None:
    random = np.random.default_rng(seed)
    periods = random.uniform(0.0005, 0.0015, 600) * random.choice([1.0, 20.0], 600, p=[0.98, 0.02])
    times = np.cumsum(periods)
    states, accelerations, efforts = swing(arm, times, np.array(arm.spread(0.5, -1.0)))
    estimates = observe(times, states[:, 0], efforts, arm.model, 40.0)
    settled = times - times[0] > 0.5
    np.testing.assert_allclose(estimates[settled, 0], states[settled, 0], atol=2e-5)
    np.testing.assert_allclose(estimates[settled, 1], states[settled, 1], atol=2e-3)
    np.testing.assert_allclose(estimates[settled, 2], accelerations[settled], atol=5e-2)


def test_a_jump_of_the_torque_is_known_at_once(arm: Arm) -> None:
    """Unlike with a differentiator, q'' follows the torque without lag, and q and q' have no error."""
    times = np.arange(1000) * DT
    efforts = np.where(times < 0.5, 1.0, -20.0)[:, None] * arm.spread(1.0, 0.5)
    ddq = efforts / ROTOR
    zero = np.zeros((1, arm.joints))
    dq = np.concatenate([zero, np.cumsum(ddq[:-1], axis=0) * DT])
    q = np.concatenate([zero, np.cumsum(dq[:-1] * DT + 0.5 * ddq[:-1] * DT**2, axis=0)])
    estimates = observe(times, q, efforts, arm.free, 30.0)
    np.testing.assert_allclose(estimates[1:, 0], q[1:], atol=1e-12)
    np.testing.assert_allclose(estimates[1:, 1], dq[1:], atol=1e-10)
    np.testing.assert_allclose(estimates[1:, 2], ddq[:-1], atol=1e-9)


@pytest.mark.parametrize("bandwidth", [20.0, 60.0])
def test_a_growing_disturbance_is_followed_with_the_errors_of_the_docstring(arm: Arm, bandwidth: float) -> None:
    rate = 3.0
    times = np.arange(2000) * DT
    positions = alike(rate * times**3 / 6.0, arm)
    estimates = observe(times, positions, np.zeros((2000, arm.joints)), arm.free, bandwidth)
    end = times[-1]
    truth = np.array([rate * end**3 / 6.0, rate * end**2 / 2.0, rate * end])
    expected = rate * np.array([bandwidth**-3, 3.0 * bandwidth**-2, 3.0 / bandwidth])
    for joint in range(arm.joints):
        # Sampling adds terms of the order of bandwidth times the period.
        np.testing.assert_allclose(truth - estimates[-1, :, joint], expected, rtol=2.0 * bandwidth * DT)


@pytest.mark.parametrize("bandwidth", [20.0, 60.0])
def test_the_poles_are_at_the_bandwidth(arm: Arm, bandwidth: float) -> None:
    """Without torque, an initial error decays as (a + b k + c k^2) exp(-bandwidth k dt)."""
    samples = 400
    times = np.arange(samples) * DT
    estimates = observe(times, alike(times, arm), np.zeros((samples, arm.joints)), arm.free, bandwidth)
    k = np.arange(1, samples)
    shape = np.exp(-bandwidth * times[1:])[:, None] * np.stack([np.ones_like(k), k, k**2], axis=1)
    error = estimates[1:, 1] - 1.0
    fit, *_ = np.linalg.lstsq(shape, error, rcond=None)
    np.testing.assert_allclose(shape @ fit, error, atol=1e-9)


@pytest.mark.parametrize("bandwidth", [20.0, 60.0])
def test_the_noise_of_the_estimates_is_that_of_the_theory(arm: Arm, bandwidth: float) -> None:
    """The stationary covariance of the sampled error, and the rule of thumb of the docstring."""
    pole = math.exp(-bandwidth * DT)
    gain = np.array([1 - pole**3, 1.5 * (1 - pole) ** 2 * (1 + pole) / DT, (1 - pole) ** 3 / DT**2])[:, None]
    predict = np.array([[1.0, DT, DT**2 / 2], [0.0, 1.0, DT], [0.0, 0.0, 1.0]])
    closed = (np.eye(3) - gain @ [[1.0, 0.0, 0.0]]) @ predict
    theory = np.sqrt(np.diag(solve_discrete_lyapunov(closed, gain @ gain.T)))
    thumb = math.sqrt(bandwidth * DT) * np.array([1.4, 1.3 * bandwidth, 0.43 * bandwidth**2])
    np.testing.assert_allclose(thumb, theory, rtol=0.05)

    std, samples = 1e-3, 30_000
    noise = std * np.random.default_rng(5).standard_normal((samples, arm.joints))
    estimates = observe(np.arange(samples) * DT, noise, np.zeros((samples, arm.joints)), arm.free, bandwidth)
    for joint in range(arm.joints):
        np.testing.assert_allclose(estimates[2000:, :, joint].std(axis=0), std * theory, rtol=0.1)


@pytest.mark.parametrize("silence", [2.0, 1e9])
def test_after_a_long_silence_the_arm_counts_as_at_rest(arm: Arm, silence: float) -> None:
    times, n = np.concatenate([np.arange(100) * DT, [0.1 + silence]]), arm.joints
    (*_, last) = observe(times, alike(times, arm), np.ones((101, n)), arm.model, 30.0)
    np.testing.assert_array_equal(last, [[times[-1]] * n, [0.0] * n, [0.0] * n])


def test_an_absurd_measurement_spoils_the_estimates_for_a_while_only(arm: Arm) -> None:
    positions = np.zeros((1000, arm.joints))
    positions[100] = 1e200
    estimates = observe(np.arange(1000) * DT, positions, np.zeros((1000, arm.joints)), arm.model, 30.0)
    assert np.isfinite(estimates).all()
    assert np.abs(estimates[-1, 0]).max() < 0.1
