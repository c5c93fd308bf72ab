"""The gains of the observer of elastic joints: a Kalman filter for one joint, made before the loop begins."""

from functools import lru_cache

import numpy as np

from pidtsm_core.arrays import Array

STATES = 5
"""Of a joint: its motion p, p', the disturbance d, and the twist of its gear with its rate."""
_ROUGH = 3.0
"""White noise of the torques on motor and link, relative to the steps of the disturbance. Without that of the link, an
error of the twist would decay no faster than the gear's own damping lets it."""
_LIGHTEST = 0.01
"""Least inertia of a link that is believed, relative to that of its rotor."""


def kalman_gains(
    rotor: float, inertia: float, stiffness: float, damping: float, at_link: bool, bandwidth: float, period: float
) -> Array:
    """Corrections of p, p', d, twist and its rate for a measured position minus the predicted one, shape (STATES,).

    The disturbance is a random walk that would give a rigid joint an observer with its poles near the bandwidth (a
    Butterworth pattern); the torques on motor and link have white noise, and so has the measured position. See R. E.
    Kalman, J. Basic Eng. 82, 1960.

    Args:
        rotor: kg m^2, as the joint sees it; 0: the joint is rigid.
        inertia: of rotor and link, kg m^2.
        stiffness: N m/rad; 0: the joint is rigid.
        damping: N m s/rad.
        at_link: the encoder measures the link, not the motor.
        bandwidth: rad/s.
        period: of the samples, s.
    """
    return _kalman_gains(*map(float, (rotor, inertia, stiffness, damping)), bool(at_link), float(bandwidth), period)


@lru_cache(maxsize=4096)
def _kalman_gains(
    rotor: float, inertia: float, stiffness: float, damping: float, at_link: bool, bandwidth: float, period: float
) -> Array:
    from scipy.linalg import expm, solve_discrete_are  # Takes long to import.

    inertia = max(inertia, (1.0 + _LIGHTEST) * rotor)
    elastic = stiffness > 0.0 and rotor > 0.0
    size = STATES if elastic else 3
    a, seen = np.zeros((size, size)), np.zeros(size)
    a[0, 1] = a[1, 2] = seen[0] = 1.0
    pushes = np.zeros((2, size))  # What a torque on the motor does, and one on the link.
    pushes[:, 1] = 1.0 / inertia
    if elastic:
        # See `elastic_joints`, with one joint.
        link = inertia - rotor
        ratio = inertia / (rotor * link)
        a[3, 4] = 1.0
        a[4, 2:] = inertia / rotor, -ratio * stiffness, -ratio * damping
        pushes[:, 4] = 1.0 / rotor, -1.0 / link
        seen[3] = -rotor / inertia if at_link else link / inertia
    sampled = expm(period * np.block([[a, pushes.T], [np.zeros((2, size + 2))]]))
    move, push = sampled[:size, :size], sampled[:size, size:]
    step = period * bandwidth**3
    noise = (_ROUGH * inertia * step) ** 2 * push @ push.T
    noise[2, 2] += step**2
    spread = solve_discrete_are(move.T, seen[:, np.newaxis], noise, np.eye(1))
    gains = np.zeros(STATES)
    gains[:size] = spread @ seen / (seen @ spread @ seen + 1.0)
    return gains
