"""Effects of an encoder on a position."""

import math

import numpy as np
import pytest
from support.testarms import Arm, dotted

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import resolve
from pidtsm_core.simulation.randomness import Column
from pidtsm_core.simulation.sensor import PARAMETERS, measure, sensor_config


def measurements(q: Array, dq: Array | None = None, **changes: object) -> Array:
    """Measurements of successive positions q, shape (samples, joints); names with two underscores instead of dots."""
    joints = q.shape[1]
    config = sensor_config(resolve(lambda _: PARAMETERS, dotted(changes), joints), joints)
    draws = np.zeros((len(q), Column.NOISE + joints))
    draws[:, Column.JITTER :] = np.random.default_rng(1).standard_normal((len(q), 1 + joints))
    motor, measured = q[0].copy(), np.empty_like(q)
    for k in range(len(q)):
        measure(config, motor, q[k], np.zeros(joints) if dq is None else dq[k], draws[k], measured[k])
    return measured


def sweep(arm: Arm) -> Array:
    """Positions over more than a revolution, of each joint other ones."""
    return np.linspace(arm.alternating(-4.0), arm.alternating(5.0) * arm.spread(1.0, 0.9), 10_000)


def test_an_ideal_encoder_measures_the_true_position(arm: Arm) -> None:
    q = sweep(arm)
    assert measurements(q, dq=q).tobytes() == q.tobytes()


@pytest.mark.parametrize("bits", [8, 12, 17])
def test_an_encoder_rounds_to_its_steps(arm: Arm, bits: int) -> None:
    step, q = 2.0 * math.pi / 2**bits, sweep(arm)
    error = measurements(q, encoder__bits=bits) - q
    counts = (q + error) / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(error).max() <= step / 2 * (1 + 1e-9)
    # Uniform over a step.
    np.testing.assert_allclose(error.std(axis=0), step / math.sqrt(12.0), rtol=0.05)
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=step / 20)


def test_joints_may_have_different_encoders(arm: Arm) -> None:
    q, others = sweep(arm), arm.joints - 1
    bits, bias = [*[0] * others, 10], [*[0.01] * others, 0.0]
    measured = measurements(q, encoder__bits=bits, encoder__bias=bias, noise__std=[0.0] * arm.joints)
    np.testing.assert_array_equal(measured[:, :-1], q[:, :-1] + 0.01)
    assert len(np.unique(measured[:, -1])) < 2000


def test_noise_has_its_standard_deviation(arm: Arm) -> None:
    q, std = sweep(arm), arm.spread(1e-3, 2e-5)
    error = measurements(q, noise__std=std) - q
    np.testing.assert_allclose(error.std(axis=0), std, rtol=0.03)
    mixed = np.atleast_2d(np.corrcoef(error.T)) - np.eye(arm.joints)
    assert np.abs(mixed).max() < 0.04


def test_jitter_meets_the_joints_a_little_earlier_or_later(arm: Arm) -> None:
    q, velocity = sweep(arm), 2.0 * np.array(arm.alternating(1.0)) * arm.spread(1.0, 0.25)
    error = measurements(q, np.tile(velocity, (len(q), 1)), jitter__std=1e-4) - q
    np.testing.assert_allclose(error.std(axis=0), 1e-4 * np.abs(velocity), rtol=0.02)
    late = error / velocity
    np.testing.assert_allclose(late, late[:, [0] * arm.joints], atol=1e-12, err_msg="all at the same moment")


@pytest.mark.parametrize("moving", [0, -1], ids=["first joint", "last joint"])
def test_backlash_is_a_hysteresis_of_the_gap(arm: Arm, moving: int) -> None:
    gap = 0.02
    t = np.linspace(0.0, 20.0, 20_000)
    # The other joints move within the gap.
    size = np.full(arm.joints, 0.004)
    size[moving] = 0.1
    q = np.outer(np.sin(t), size)
    measured = measurements(q, backlash__gap=gap)
    there, back = np.cos(t) > 0.8, np.cos(t) < -0.8
    settled = t > math.pi
    np.testing.assert_allclose((measured - q)[there & settled, moving], -gap / 2, atol=1e-12)
    np.testing.assert_allclose((measured - q)[back & settled, moving], gap / 2, atol=1e-12)
    assert not np.delete(measured, moving, axis=1).any(), "a joint that moves within the gap does not move the motor"
