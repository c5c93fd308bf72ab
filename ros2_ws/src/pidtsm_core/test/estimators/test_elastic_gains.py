"""The gains against a Kalman filter in other coordinates, those of motor and link, with SciPy's discretisation."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from pidtsm_core.arrays import Array
from pidtsm_core.estimators.elastic_gains import kalman_gains

ROTOR, LINK, DAMPING, PERIOD = 0.1, 0.7, 4.0, 0.002


def converged(stiffness: float, at_link: bool, bandwidth: float) -> Array:
    """Gains for link, motor, their velocities and d, after as many steps as it takes, shape (5,)."""
    inertia = ROTOR + LINK
    a, b = np.zeros((5, 5)), np.zeros((5, 2))
    b[2, 0], b[3, 1] = 1.0 / LINK, 1.0 / ROTOR
    a[0, 2] = a[1, 3] = 1.0
    spring = np.array([-stiffness, stiffness, -DAMPING, DAMPING])
    a[2, :4], a[3, :4] = spring / LINK, -spring / ROTOR
    a[3, 4] = inertia / ROTOR  # d is an acceleration of the whole, and acts on the motor.
    seen = np.array([[1.0 if at_link else 0.0, 0.0 if at_link else 1.0, 0.0, 0.0, 0.0]])
    move, push, *_ = cont2discrete((a, b, seen, np.zeros((1, 2))), PERIOD)
    step = PERIOD * bandwidth**3
    noise = (3.0 * inertia * step) ** 2 * push @ push.T
    noise[4, 4] += step**2
    spread = np.eye(5)
    for _ in range(4000):
        gains = spread @ seen.T / (seen @ spread @ seen.T + 1.0)
        spread = move @ (spread - gains @ seen @ spread) @ move.T + noise
    return np.asarray(gains[:, 0])


@pytest.mark.parametrize("at_link", [False, True])
@pytest.mark.parametrize("stiffness", [500.0, 20_000.0])
def test_the_gains_are_those_of_the_steady_filter(stiffness: float, at_link: bool) -> None:
    link, motor, link_rate, motor_rate, disturbance = converged(stiffness, at_link, 60.0)
    inertia = ROTOR + LINK
    mean = [(ROTOR * motor + LINK * link) / inertia, (ROTOR * motor_rate + LINK * link_rate) / inertia]
    expected = [*mean, disturbance, motor - link, motor_rate - link_rate]
    one = np.ones(1)
    (found,) = kalman_gains(ROTOR * one, inertia * one, stiffness * one, DAMPING * one, at_link, 60.0 * one, PERIOD)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)


def test_a_rigid_joint_has_a_butterworth_pattern_at_the_bandwidth() -> None:
    """Poles of the continuous error, rad/s; the noise of the torque matters little for a slow observer."""
    bandwidth, period = 5.0, 1e-4
    none, one = np.zeros(1), np.ones(1)
    ((p, dp, d, *twist),) = kalman_gains(none, 2.0 * one, none, none, False, bandwidth * one, period)
    poles = np.roots([1.0, p / period, dp / period, d / period])
    assert twist == [0.0, 0.0]
    np.testing.assert_allclose(np.abs(poles), bandwidth, rtol=0.01)
    np.testing.assert_allclose(sorted(poles.real), [-bandwidth, -bandwidth / 2, -bandwidth / 2], rtol=0.01)
