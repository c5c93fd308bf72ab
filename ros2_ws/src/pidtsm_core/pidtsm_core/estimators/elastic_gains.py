"""The gains of the observer of elastic joints: a Kalman filter for each joint, made before the loop begins."""

import numpy as np

from pidtsm_core.arrays import Array

STATES = 5
"""Of a joint: its motion p, p', the disturbance d, and the twist of its gear with its rate."""
_ROUGH = 3.0
"""White noise of the torques on motor and link, relative to the steps of the disturbance. Without that of the link, an
error of the twist would decay no faster than the gear's own damping lets it."""
_LIGHTEST = 0.01
"""Least inertia of a link that is believed, relative to that of its rotor."""
_DEADBEAT = 5.0
"""Largest product of bandwidth and period: the filter then forgets everything from sample to sample."""
_DOUBLINGS = 60
"""Most steps of the Riccati equation's solution; each squares what is left."""
_CONVERGED = 1e-13
"""Relative change of a step that ends it."""


def kalman_gains(
    rotor: Array, inertia: Array, stiffness: Array, damping: Array, at_links: bool, bandwidth: Array, period: float
) -> Array:
    """Corrections of p, p', d, twist and its rate for a measured position minus the predicted one.

    The disturbance is a random walk that would give a rigid joint an observer with its poles near the bandwidth (a
    Butterworth pattern); the torques on motor and link have white noise, and so has the measured position. See R. E.
    Kalman, J. Basic Eng. 82, 1960; the doubling algorithm, which takes a tenth of the time that Schur forms take, is
    that of Chu, Fan, Lin and Wang, Int. J. Control 77, 2004.

    Args:
        rotor: as the joints see them, shape (joints,), kg m^2; 0: the joint is rigid.
        inertia: of rotor and link, shape (joints,), kg m^2.
        stiffness: shape (joints,), N m/rad; 0: the joint is rigid.
        damping: shape (joints,), N m s/rad.
        at_links: the encoders measure the links, not the motors.
        bandwidth: shape (joints,), rad/s.
        period: of the samples, s.

    Returns:
        The gains, shape (joints, STATES); nan where there are none with which the filter is stable.
    """
    from scipy.linalg import expm  # Takes long to import.

    rotor = np.where(stiffness > 0.0, rotor, 0.0)
    a, pushes, seen = _model(
        rotor, np.maximum(inertia, (1.0 + _LIGHTEST) * rotor), stiffness, damping, at_links, period
    )
    joints, size = bandwidth.size, STATES + pushes.shape[2]
    whole = np.zeros((joints, size, size))
    whole[:, :STATES, :STATES], whole[:, :STATES, STATES:] = a, pushes
    gains = np.full((joints, STATES), np.nan)
    with np.errstate(all="ignore"):
        sampled = expm(period * whole)
        move, push = sampled[:, :STATES, :STATES], sampled[:, :STATES, STATES:]
        step = period * np.minimum(bandwidth, _DEADBEAT / period) ** 3
        noise = ((_ROUGH * inertia * step) ** 2)[:, np.newaxis, np.newaxis] * (push @ np.swapaxes(push, 1, 2))
        noise[:, 2, 2] += step**2
        for j in range(joints):
            spread = _stationary(move[j], seen[j], noise[j])
            its = spread @ seen[j] / (seen[j] @ spread @ seen[j] + 1.0)
            error = move[j] - np.outer(move[j] @ its, seen[j])
            if np.isfinite(error).all() and np.abs(np.linalg.eigvals(error)).max() < 1.0:
                gains[j] = its
    return gains


def _model(
    rotor: Array, inertia: Array, stiffness: Array, damping: Array, at_links: bool, period: float
) -> tuple[Array, Array, Array]:
    """Of each joint alone, see `elastic_joints`: its motion, what torques on motor and link do, what is measured."""
    joints, elastic = rotor.size, rotor > 0.0
    a, pushes, seen = np.zeros((joints, STATES, STATES)), np.zeros((joints, STATES, 2)), np.zeros((joints, STATES))
    a[:, 0, 1] = a[:, 1, 2] = seen[:, 0] = 1.0
    pushes[:, 1] = (1.0 / inertia)[:, np.newaxis]
    link = inertia - rotor
    own = np.where(elastic, rotor, 1.0)
    ratio = inertia / (own * link)
    a[:, 3, 4] = elastic
    a[:, 4, 2] = np.where(elastic, inertia / own, 0.0)
    # What a rigid joint does not have decays.
    a[:, 3, 3] = np.where(elastic, 0.0, -1.0 / period)
    a[:, 4, 3] = np.where(elastic, -ratio * stiffness, 0.0)
    a[:, 4, 4] = np.where(elastic, -ratio * damping, -1.0 / period)
    pushes[:, 4, 0] = np.where(elastic, 1.0 / own, 0.0)
    pushes[:, 4, 1] = np.where(elastic, -1.0 / link, 0.0)
    seen[:, 3] = np.where(elastic, (-rotor if at_links else link) / inertia, 0.0)
    return a, pushes, seen


def _stationary(move: Array, seen: Array, noise: Array) -> Array:
    """The covariance before a measurement of variance 1, shape (STATES, STATES); not finite if there is none."""
    a, g, h, eye = move.T, np.outer(seen, seen), noise, np.eye(seen.size)
    for _ in range(_DOUBLINGS):
        try:
            both = np.linalg.solve(eye + g @ h, np.hstack([a, g]))
        except np.linalg.LinAlgError:
            return np.full_like(noise, np.nan)
        moved, measured = both[:, : seen.size], both[:, seen.size :]
        more = a.T @ h @ moved
        a, g, h = a @ moved, g + a @ measured @ a.T, h + 0.5 * (more + more.T)
        if not np.abs(more).max() > _CONVERGED * np.abs(h).max():
            break
    return h
