"""Effects of an encoder on a position."""

import math

import numpy as np
import pytest

from pidtsm_core.parameters import Array, resolve
from pidtsm_core.simulation.randomness import Column
from pidtsm_core.simulation.sensor import PARAMETERS, measure, sensor_config

JOINTS = 2


def measurements(q: Array, dq: Array | None = None, **changes: object) -> Array:
    """Measurements of successive positions q, shape (samples, joints); names with two underscores instead of dots."""
    chosen = {name.replace("__", "."): value for name, value in changes.items()}
    config = sensor_config(resolve(lambda _: PARAMETERS, chosen, JOINTS), JOINTS)
    draws = np.zeros((len(q), Column.NOISE + JOINTS))
    draws[:, Column.JITTER :] = np.random.default_rng(1).standard_normal((len(q), 1 + JOINTS))
    motor, measured = q[0].copy(), np.empty_like(q)
    for k in range(len(q)):
        measure(config, motor, q[k], np.zeros(JOINTS) if dq is None else dq[k], draws[k], measured[k])
    return measured


SWEEP = np.linspace([-4.0, 3.0], [5.0, -2.0], 20_000)


def test_an_ideal_encoder_measures_the_true_position() -> None:
    assert measurements(SWEEP, dq=SWEEP).tobytes() == SWEEP.tobytes()


@pytest.mark.parametrize("bits", [8, 12, 17])
def test_an_encoder_rounds_to_its_steps(bits: int) -> None:
    step = 2.0 * math.pi / 2**bits
    error = measurements(SWEEP, encoder__bits=bits) - SWEEP
    counts = (SWEEP + error) / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(error).max() <= step / 2 * (1 + 1e-9)
    # Uniform over a step.
    np.testing.assert_allclose(error.std(axis=0), step / math.sqrt(12.0), rtol=0.05)
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=step / 20)


def test_joints_may_have_different_encoders() -> None:
    measured = measurements(SWEEP, encoder__bits=[0, 10], encoder__bias=[0.01, 0.0], noise__std=[0.0, 0.0])
    np.testing.assert_array_equal(measured[:, 0], SWEEP[:, 0] + 0.01)
    assert len(np.unique(measured[:, 1])) < 1000


def test_noise_has_its_standard_deviation() -> None:
    error = measurements(SWEEP, noise__std=[1e-3, 2e-5]) - SWEEP
    np.testing.assert_allclose(error.std(axis=0), [1e-3, 2e-5], rtol=0.02)
    assert abs(np.corrcoef(error.T)[0, 1]) < 0.03


def test_jitter_meets_the_joints_a_little_earlier_or_later() -> None:
    velocity = np.tile([2.0, -0.5], (len(SWEEP), 1))
    error = measurements(SWEEP, velocity, jitter__std=1e-4) - SWEEP
    np.testing.assert_allclose(error.std(axis=0), [2e-4, 0.5e-4], rtol=0.02)
    np.testing.assert_allclose(error[:, 0] / 2.0, error[:, 1] / -0.5, atol=1e-12, err_msg="all at the same moment")


def test_backlash_is_a_hysteresis_of_the_gap() -> None:
    gap = 0.02
    t = np.linspace(0.0, 20.0, 20_000)
    q = np.column_stack([0.1 * np.sin(t), 0.004 * np.sin(t)])
    measured = measurements(q, backlash__gap=gap)
    there, back = np.cos(t) > 0.8, np.cos(t) < -0.8
    settled = t > math.pi
    np.testing.assert_allclose((measured - q)[there & settled, 0], -gap / 2, atol=1e-12)
    np.testing.assert_allclose((measured - q)[back & settled, 0], gap / 2, atol=1e-12)
    assert (measured[:, 1] == 0.0).all(), "a joint that moves within the gap does not move the motor"
