"""How fast the observers of an arm with elastic joints, lag and delay may be: eigenvalues of the sampled, linear loop.

A controller that takes the arm for rigid demands the torque H a. Above the frequency of an elastic joint, a motor with
an encoder moves as if it had to move only its rotor, so the loop has up to H / rotor times the gain it should have, and
through the couplings of H even the largest eigenvalue of rotor^-1 H times. All joints are therefore judged together. An
observer that knows the springs is judged with springs and rotors that differ from what it knows, too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from threadpoolctl import threadpool_limits

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.linear_observers import LinearObserver, elastic_corrections, elastic_model, rigid_observer

Plant: TypeAlias = tuple[Array, Array, Array]
"""Matrices A, B and C of a sampled system."""


class _Margin(NamedTuple):
    """How the loop may differ from what the controller knows before it is unstable."""

    gain: float = 1.0  # factor of the gain of the loop
    later: int = 0  # samples by which everything is later
    stiffness: float = 1.0  # factor of that of the gears
    rotor: float = 1.0  # factor of the inertia of the rotors
    corrected: bool = False  # the law sees a corrected velocity, see `Drives`


GAIN = 1.5
"""Factor by which the gain of the loop may be larger, 3.5 dB, before it is unstable."""
_MARGINS = (_Margin(gain=GAIN), _Margin(later=1))
_OF_SPRINGS = (_Margin(stiffness=0.8), _Margin(stiffness=1.2), _Margin(rotor=0.85), _Margin(rotor=1.15))
"""Also of an observer that knows the springs."""
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
        observed: the observer knows the springs.
        ahead: samples by which the controller predicts if they are.
        corrected: where the observer does not know the springs, the law may see a velocity that is corrected because
            friction is learnt, see `pidtsm_core.control.lacking`.
    """

    period: float
    delay: int
    lag: float
    rotor: Array
    stiffness: Array
    damping: Array
    on_motor: bool
    observed: bool = False
    ahead: int = 0
    corrected: bool = False


def bandwidths(drives: Drives, inertias: list[Array], fastest: Array) -> Array:
    """The highest bandwidths of the observers with which the loop has its margins, shape (joints,), rad/s.

    First all are lowered by the same factor; then each in turn is raised as far as possible, from the last joint on.

    Args:
        drives: of the arm.
        inertias: matrices in several postures, the middle of the range first, with rotors, shape (joints, joints) each,
            kg m^2.
        fastest: highest bandwidths allowed, shape (joints,), rad/s.
    """
    import scipy.linalg  # noqa: F401  Only the threads of what is loaded can be limited.

    # The matrices are small: several threads of BLAS wait for each other, on a busy machine six times as long.
    with threadpool_limits(limits=1, user_api="blas"):
        return _raised(_judge(drives, inertias, _margins(drives)), fastest)


def _margins(drives: Drives) -> tuple[_Margin, ...]:
    if drives.observed:
        return (*_MARGINS, *_OF_SPRINGS)
    return (*_MARGINS, *(each._replace(corrected=True) for each in _MARGINS if drives.corrected))


def _raised(keeps: Callable[[Array], bool], fastest: Array) -> Array:
    """See `bandwidths`; `keeps`: of `_judge`."""

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
    return _judge(drives, inertias, (_Margin(corrected=drives.corrected and not drives.observed),))(bandwidth)


def _judge(drives: Drives, inertias: list[Array], margins: Sequence[_Margin]) -> Callable[[Array], bool]:
    """A function that tells whether the loop with some bandwidths is stable in all postures with all margins."""
    plants = [[_differing(drives, inertia, margin) for margin in margins] for inertia in inertias]
    known = (drives.rotor, drives.stiffness, drives.damping, drives.on_motor)
    models = [elastic_model(drives.period, inertia, *known) for inertia in inertias] if drives.observed else []

    def observers(bandwidth: Array) -> list[LinearObserver]:
        """One for each posture."""
        if not drives.observed:
            return [rigid_observer(drives.period, inertia, bandwidth) for inertia in inertias]
        corrects = elastic_corrections(drives.period, np.diag(inertias[0]), *known, bandwidth)
        return [model._replace(corrects=corrects) for model in models]

    # What failed last is tried first: it is likely to fail again, and the rest need not be tried then.
    order = [(place, margin) for place in range(len(inertias)) for margin in range(len(margins))]

    def keeps(bandwidth: Array) -> bool:
        its = observers(bandwidth)
        for k, (place, margin) in enumerate(order):
            plant, inertia = plants[place][margin], inertias[place]
            closed = _closed(drives, plant, its[place], inertia, bandwidth, margins[margin])
            if not np.isfinite(closed).all() or not np.abs(np.linalg.eigvals(closed)).max() < 1.0:
                order.insert(0, order.pop(k))
                return False
        return True

    return keeps


def _differing(drives: Drives, inertia: Array, margin: _Margin) -> Plant:
    """The arm as it is with a margin, while the controller knows `drives` and `inertia`."""
    rotor = margin.rotor * drives.rotor
    true = replace(drives, stiffness=margin.stiffness * drives.stiffness, rotor=rotor)
    return sampled_plant(true, inertia + np.diag(rotor - drives.rotor))


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


def _closed(
    drives: Drives, plant: Plant, observer: LinearObserver, inertia: Array, bandwidth: Array, margin: _Margin
) -> Array:
    """Matrix of the closed loop.

    Its states are those of the plant, the measurements on their way, the observer's, the corrections of the velocity,
    and the last commands. The law is linear, with a double pole, and rejects the disturbance.
    """
    (a, b, c), joints, period = plant, bandwidth.size, drives.period
    ahead = drives.ahead if drives.observed else 0
    corrected = joints if margin.corrected else 0
    begins = np.cumsum([a.shape[0], joints * (drives.delay + margin.later), observer.predicts.shape[0], corrected])
    moving, waiting = slice(0, begins[0]), slice(begins[0], begins[1])
    observed, correcting = slice(begins[1], begins[2]), slice(begins[2], begins[3])
    every = np.eye(begins[3] + joints * ahead)
    measured = np.vstack([c @ every[moving], every[waiting]])  # The newest one first.
    known = every[observed] + observer.corrects @ (measured[-joints:] - observer.measured @ every[observed])
    commands = every[begins[3] :].reshape(ahead, joints, every.shape[1])  # Likewise.
    position, velocity = _ahead(observer, known, np.linalg.inv(inertia) @ commands, period)
    correction = every[correcting]
    if corrected:
        lags = 3.0 * bandwidth[:, np.newaxis] * (measured[-joints:] - observer.position @ known)
        correction = correction - np.expm1(-bandwidth * period)[:, np.newaxis] * (lags - correction)
        velocity = velocity + correction
    rate = _POLES * bandwidth[:, np.newaxis]
    effort = inertia @ (-(rate**2) * position - 2.0 * rate * velocity - observer.disturbance @ known)
    acting = commands[-1] if ahead else effort
    return np.vstack(
        [
            a @ every[moving] + margin.gain * b @ effort,
            measured[:-joints],
            observer.predicts @ known + observer.driven @ acting,
            correction,
            *([effort, *commands[:-1]] if ahead else []),
        ]
    )


def _ahead(observer: LinearObserver, known: Array, under_way: Array, period: float) -> tuple[Array, Array]:
    """Position and velocity when the command acts, with accelerations that are under way; see `control.lateness`."""
    position, velocity, late = observer.position @ known, observer.velocity @ known, period * len(under_way)
    lacking = observer.disturbance @ known
    position = position + late * (velocity + 0.5 * late * lacking)
    velocity = velocity + late * lacking
    for back, acceleration in enumerate(under_way):
        position = position + 0.5 * period**2 * ((back + 1) ** 2 - back**2) * acceleration
        velocity = velocity + period * acceleration
    return position, velocity
