"""How fast the observers of an arm with elastic joints, lag and delay may be: eigenvalues of the sampled, linear loop.

A controller that takes the arm for rigid demands the torque H a. Above the frequency of an elastic joint, a motor with
an encoder moves as if it had to move only its rotor, so the loop has up to H / rotor times the gain it should have, and
through the couplings of H even the largest eigenvalue of rotor^-1 H times. All joints are therefore judged together.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from pidtsm_core.arrays import Array

Plant: TypeAlias = tuple[Array, Array, Array]
"""Matrices A, B and C of a sampled system."""
GAIN = 1.5
"""Factor by which the gain of the loop may be larger, 3.5 dB, before it is unstable."""
_LATER = 1
"""Samples by which everything may be later, likewise."""
_POLES = 0.25
"""Poles of the law, relative to those of the observer, as in `law_gains`."""
_SLOWEST = 0.05
"""Smallest share of a bandwidth that is tried."""
_HALVINGS = 5
"""How often an interval of bandwidths is halved: it is then 10 % wide."""


@dataclass(frozen=True)
class Drives:
    """What lies between the controller and the links, arrays of shape (joints,).

    Attributes:
        period: of the samples, s.
        delay: samples from a measurement to the command that answers it.
        lag: time constant of the drives, s.
        rotor: inertia of the rotors as the joints see it, kg m^2.
        stiffness: of the gears, N m/rad; 0: rigid.
        damping: N m s/rad.
        on_motor: the encoders measure the motors.
    """

    period: float
    delay: int
    lag: float
    rotor: Array
    stiffness: Array
    damping: Array
    on_motor: bool


def bandwidths(drives: Drives, inertias: list[Array], fastest: Array) -> Array:
    """The highest bandwidths of the observers with which the loop has its margins, shape (joints,), rad/s.

    First all are lowered by the same factor; then each in turn is raised as far as possible, from the last joint on.

    Args:
        drives: of the arm.
        inertias: matrices in several postures, with rotors, shape (joints, joints) each, kg m^2.
        fastest: highest bandwidths allowed, shape (joints,), rad/s.
    """
    plants = [sampled_plant(drives, inertia) for inertia in inertias]

    def keeps(bandwidth: Array) -> bool:
        return all(
            _is_stable(drives, plants, inertias, bandwidth, gain, later) for gain, later in ((GAIN, 0), (1.0, _LATER))
        )

    def raised(slow: Array, fast: Array) -> Array:
        """The last of the bandwidths between these two that keeps the margins, as far as it is known."""
        if keeps(fast):
            return fast
        for _ in range(_HALVINGS):
            middle = np.sqrt(slow * fast)
            slow, fast = (middle, fast) if keeps(middle) else (slow, middle)
        return slow

    found = raised(_SLOWEST * fastest, fastest)
    for j in reversed(range(fastest.size)):
        found = raised(found, np.where(np.arange(fastest.size) == j, fastest, found))
    return found


def is_stable(drives: Drives, inertias: list[Array], bandwidth: Array) -> bool:
    """Whether the loop with these bandwidths, shape (joints,), rad/s, is stable without margins; see `bandwidths`."""
    return _is_stable(drives, [sampled_plant(drives, each) for each in inertias], inertias, bandwidth, 1.0, 0)


def _is_stable(
    drives: Drives, plants: list[Plant], inertias: list[Array], bandwidth: Array, gain: float, later: int
) -> bool:
    return all(
        np.abs(np.linalg.eigvals(_closed(drives, plant, inertia, bandwidth, gain, later))).max() < 1.0
        for plant, inertia in zip(plants, inertias, strict=True)
    )


def sampled_plant(drives: Drives, inertia: Array) -> Plant:
    """Sampled matrices A, B and C of arm and drives, from commanded torques to measured positions.

    The states are links and motors of elastic joints, their velocities, and with a lag the torques.

    Args:
        drives: of the joints.
        inertia: H of the arm with rotors, shape (joints, joints), kg m^2.

    Returns:
        A, shape (states, states); B, shape (states, joints); C, shape (joints, states).
    """
    from scipy.linalg import block_diag, expm  # See current_loop.py.

    joints, elastic = drives.rotor.size, np.flatnonzero(drives.stiffness)
    count = joints + elastic.size
    mass = block_diag(inertia - np.diag(np.where(drives.stiffness > 0.0, drives.rotor, 0.0)), *drives.rotor[elastic])
    spring = np.hstack([np.eye(joints)[elastic], -np.eye(elastic.size)])
    stiffness, damping = (spring.T @ np.diag(each[elastic]) @ spring for each in (drives.stiffness, drives.damping))
    # Where torques act, and what encoders measure.
    driven = np.eye(count)[:, :joints]
    driven[:, elastic] = np.eye(count)[:, joints:]
    measured = driven.T if drives.on_motor else np.eye(joints, count)
    motion, still = np.linalg.inv(mass), np.zeros((count, count))
    a = np.block([[still, np.eye(count)], [-motion @ stiffness, -motion @ damping]])
    b = np.vstack([np.zeros((count, joints)), motion @ driven])
    if drives.lag > 0.0:
        a = np.block([[a, b], [np.zeros((joints, 2 * count)), -np.eye(joints) / drives.lag]])
        b = np.vstack([np.zeros((2 * count, joints)), np.eye(joints) / drives.lag])
    sampled = expm(drives.period * np.block([[a, b], [np.zeros((joints, a.shape[0] + joints))]]))
    c = np.zeros((joints, a.shape[0]))
    c[:, :count] = measured
    return sampled[: a.shape[0], : a.shape[0]], sampled[: a.shape[0], a.shape[0] :], c


def _closed(drives: Drives, plant: Plant, inertia: Array, bandwidth: Array, gain: float, later: int) -> Array:
    """Matrix of the closed loop; its states are those of plant and observer, and the measurements on their way."""
    a, b, c = plant
    joints, size, delay = bandwidth.size, a.shape[0], drives.delay + later
    observer = slice(size, size + 3 * joints)
    rows = [slice(start, start + joints) for start in range(observer.stop, observer.stop + delay * joints, joints)]
    closed = np.zeros((observer.stop + delay * joints,) * 2)
    arrived = np.zeros((joints, closed.shape[0]))
    arrived[:, rows[-1] if rows else slice(0, size)] = np.eye(joints) if rows else c
    predicts, corrects, law = _observer(drives.period, bandwidth)
    closed[observer, observer] = predicts
    closed[observer] += corrects @ arrived
    closed[:size] = gain * b @ inertia @ law @ closed[observer]
    closed[:size, :size] += a
    for here, (there, what) in zip(rows, _moved(rows, size, c), strict=True):
        closed[here, there] = what
    return closed


def _moved(rows: list[slice], size: int, c: Array) -> Iterator[tuple[slice, Array]]:
    """Where each of the measurements on their way comes from: the plant, or the place of the one before."""
    if rows:
        yield slice(0, size), c
    for before in rows[:-1]:
        yield before, np.eye(c.shape[0])


def _observer(period: float, bandwidth: Array) -> tuple[Array, Array, Array]:
    """Of the extended state observer with the law's last acceleration: matrices of its states, of y, and the law's.

    See `pidtsm_core.estimators.extended_state`. The law is linear, with a double pole, and rejects the disturbance.
    """
    eye, none = np.eye(bandwidth.size), np.zeros((bandwidth.size,) * 2)
    gone = -np.expm1(-bandwidth * period)
    pole, rate = 1.0 - gone, _POLES * bandwidth
    gains = (gone * (1.0 + pole + pole**2), 1.5 * gone**2 * (1.0 + pole) / period, gone**3 / period**2)
    corrects = np.vstack([np.diag(each) for each in gains])
    law = -np.hstack([np.diag(rate**2), np.diag(2.0 * rate), eye])
    half = 0.5 * period**2 * eye
    predicted = np.block([[eye, period * eye, half], [none, eye, period * eye], [none, none, eye]])
    predicted += np.vstack([half, period * eye, none]) @ law
    return predicted - corrects @ predicted[: bandwidth.size], corrects, law
