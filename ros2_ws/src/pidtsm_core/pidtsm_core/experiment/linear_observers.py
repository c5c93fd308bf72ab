"""Linear models of the observers of an arm that hardly moves, for `loop_margin`."""

from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.estimators.elastic_gains import STATES, kalman_gains


class LinearObserver(NamedTuple):
    """An observer that predicts x by one sample and corrects it with a measurement y.

    x' = predicts (x + corrects (y - measured x)) + driven effort; matrices of shape (states, states), (states, joints)
    or (joints, states), SI units.
    """

    predicts: Array
    driven: Array
    measured: Array
    position: Array
    velocity: Array
    disturbance: Array
    corrects: Array


def rigid_observer(period: float, inertia: Array, bandwidth: Array) -> LinearObserver:
    """The observer of `pidtsm_core.estimators.extended_state`: its states are q, q' and d.

    Args:
        period: of the samples, s.
        inertia: of the arm, shape (joints, joints), kg m^2.
        bandwidth: shape (joints,), rad/s.
    """
    joints = bandwidth.size
    eye, none = np.eye(joints), np.zeros((joints, joints))
    gone = -np.expm1(-bandwidth * period)
    pole, half = 1.0 - gone, 0.5 * period**2
    gains = (gone * (1.0 + pole + pole**2), 1.5 * gone**2 * (1.0 + pole) / period, gone**3 / period**2)
    q, dq, d = np.eye(3 * joints).reshape(3, joints, 3 * joints)
    predicts = np.block([[eye, period * eye, half * eye], [none, eye, period * eye], [none, none, eye]])
    driven = np.vstack([half * eye, period * eye, none]) @ np.linalg.inv(inertia)
    return LinearObserver(predicts, driven, q, q, dq, d, np.vstack([np.diag(each) for each in gains]))


def elastic_model(
    period: float, inertia: Array, rotor: Array, stiffness: Array, damping: Array, on_motor: bool
) -> LinearObserver:
    """The observer of `pidtsm_core.estimators.elastic_joints`, without its corrections.

    Its states are p, p', d, and the twists with their rates.

    Args:
        period: of the samples, s.
        inertia: of the arm, shape (joints, joints), kg m^2.
        rotor: see `loop_margin.Drives`.
        stiffness: likewise.
        damping: likewise.
        on_motor: likewise.
    """
    from scipy.linalg import expm  # Takes long to import.

    joints, elastic = rotor.size, (stiffness > 0.0) & (rotor > 0.0)
    eye, none = np.eye(joints), np.zeros((joints, joints))
    moved = np.where(elastic, rotor, 0.0)
    share = np.linalg.solve(inertia, np.diag(moved))
    # The acceleration of the twists, by force; joints that are rigid have none.
    bends = np.linalg.inv(np.diag(np.where(elastic, rotor, 1.0)) - np.diag(moved) @ share) * np.outer(elastic, elastic)
    mean = np.linalg.inv(inertia)
    a = np.zeros((6 * joints, 6 * joints))
    p, dp, _, twist, rate, _ = a.reshape(6, joints, 6 * joints)
    rows = np.split(np.eye(6 * joints), 6)
    p += rows[1]
    dp += rows[2] + mean @ rows[5]
    # What a rigid joint does not have decays.
    absent = -np.diag((~elastic).astype(float)) / period
    twist += np.diag(elastic.astype(float)) @ rows[4] + absent @ rows[3]
    rate += absent @ rows[4] + bends @ (
        (eye - np.diag(moved) @ mean) @ rows[5]
        + (inertia - np.diag(moved)) @ rows[2]
        - np.diag(stiffness) @ rows[3]
        - np.diag(damping) @ rows[4]
    )
    sampled = expm(period * a)
    states = STATES * joints
    link = np.hstack([eye, none, none, -share, none])
    motor = link + np.hstack([none, none, none, np.diag(elastic.astype(float)), none])
    return LinearObserver(
        sampled[:states, :states],
        sampled[:states, states:],
        motor if on_motor else link,
        link,
        np.hstack([none, eye, none, none, -share]),
        np.hstack([none, none, eye, none, none]),
        np.zeros((states, joints)),
    )


def elastic_corrections(
    period: float, inertia: Array, rotor: Array, stiffness: Array, damping: Array, on_motor: bool, bandwidth: Array
) -> Array:
    """Corrections of `elastic_model`, shape (states, joints); see `kalman_gains`.

    Args:
        period: of the samples, s.
        inertia: diagonal of the matrix in the middle of the range, shape (joints,), kg m^2.
        rotor: see `loop_margin.Drives`.
        stiffness: likewise.
        damping: likewise.
        on_motor: likewise.
        bandwidth: shape (joints,), rad/s.
    """
    gains = kalman_gains(rotor, inertia, stiffness, damping, not on_motor, bandwidth, period)
    return np.vstack([np.diag(each) for each in gains.T])
