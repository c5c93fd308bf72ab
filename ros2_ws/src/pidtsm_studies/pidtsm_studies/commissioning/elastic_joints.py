"""How an arm answers when its joints are shaken: equations of motors, springs and links, and their derivatives.

Each joint j consists of a motor and a link with a spring between them (M. W. Spong, J. Dyn. Sys. Meas. Control 109,
1987). With the positions of motors T and links Q, in the Laplace domain and about a slow motion,

    U_j L = J_j s^2 T_j + v_j s T_j + c_j S_j + (M s^2 Q)_j,   (M s^2 Q)_j = K_j (1 + s tau) (T_j - Q_j),

where U is the torque that was commanded, L delay and lag of the drives, J the rotors, v viscous and c Coulomb friction,
S the sign of the velocity, K the stiffness, tau the same for all gears, and M the inertia matrix of the links, as it is
described but for a factor of each link. Encoders measure T or Q, and the other one follows from the second equation.
Positions of all joints are measured, so that nothing has to be known of what moves the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pidtsm_core.arrays import Array

Complex = NDArray[np.complex128]

_EDGE, _DRIFT = 0.1, 3
"""s of fading in and out of what is transformed, and degree of the polynomial that stands for the slow motion."""
_SLOW = 0.02
"""rad/s, about which the sign of the velocity changes gradually."""
_FREQUENCIES, _STRONG = 10, 0.2
"""Frequencies of each band that count, and share of the largest torque in it that each must have."""
_ERROR = 0.05
"""Share of the torque that the equations may leave unexplained beside the noise of the positions."""


class Side(Enum):
    """Where the encoders are; `RIGID`: there are no springs."""

    MOTOR = "motor"
    LINK = "link"
    RIGID = "rigid"


@dataclass(frozen=True)
class Answer:
    """How an arm answered when one joint was shaken, at some frequencies.

    Attributes:
        joint: the one that was shaken.
        rate: the frequencies, shape (frequencies,), rad/s.
        effort: amplitudes of the torque of that joint, likewise, N m.
        sliding: of the sign of its velocity, likewise.
        position: of all joints, shape (frequencies, joints), rad.
        links: inertia matrix without rotors where the arm was, shape (joints, joints), kg m^2.
        spread: standard deviation of a component of `position` for noise of standard deviation 1.
    """

    joint: int
    rate: Array
    effort: Complex
    sliding: Complex
    position: Complex
    links: Array
    spread: float


@dataclass(frozen=True)
class Believed:
    """What is believed of the arm beforehand, each of shape (joints,).

    Attributes:
        rotor: described inertias of the rotors as the joints see them, kg m^2; 0: nothing is described.
        effort: limits, N m.
        noise: standard deviation of the positions, rad.
        period: between commands, s.
    """

    rotor: Array
    effort: Array
    noise: Array
    period: float


def answer(
    time: Array,
    position: Array,
    effort: Array,
    joint: int,
    band: tuple[float, float],
    period: float,
    links: Array,
) -> Answer:
    """How an arm answered while one joint was shaken in a band of frequencies, and slowly moved.

    Args:
        time: of the joint states, shape (samples,), s; some may be missing.
        position: of all joints, shape (samples, joints), rad.
        effort: torque of the joint that was shaken, held from each joint state to the next, shape (samples,), N m.
        joint: its index.
        band: Hz.
        period: between joint states, s.
        links: see `Answer`.
    """
    even = time[0] + period * np.arange(int((time[-1] - time[0]) / period))
    torque = effort[np.clip(np.searchsorted(time, even + 0.5 * period) - 1, 0, None)]
    way = CubicSpline(time, position)(even)
    sliding = np.tanh(np.gradient(way[:, joint], period) / _SLOW)
    signals = np.column_stack([torque, sliding, way])
    slow = np.vander(np.linspace(-1.0, 1.0, even.size), _DRIFT + 1)
    signals -= slow @ np.linalg.lstsq(slow, signals, rcond=None)[0]
    edge = np.clip(np.minimum(even - even[0], even[-1] - even) / _EDGE, 0.0, 1.0)
    window = 0.5 - 0.5 * np.cos(np.pi * edge)
    spectra = 2.0 / window.sum() * np.fft.rfft(signals * window[:, np.newaxis], axis=0)
    frequency = np.fft.rfftfreq(even.size, period)
    within = np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]))
    size = np.abs(spectra[within, 0])
    strong = within[size > _STRONG * size.max()]
    chosen = strong[np.unique(np.linspace(0.0, strong.size - 1.0, _FREQUENCIES).round().astype(int))]
    return Answer(
        joint=joint,
        rate=2.0 * np.pi * frequency[chosen],
        effort=spectra[chosen, 0],
        sliding=spectra[chosen, 1],
        position=spectra[chosen, 2:],
        links=links,
        spread=2.0 / window.sum() * float(np.sqrt(np.sum(window**2) / 2.0)),
    )


class Unknowns(NamedTuple):
    """What is sought: five numbers of each joint that was shaken, and four of the arm."""

    rotor: Array  # logarithm
    stiffness: Array  # logarithm
    viscous: Array
    coulomb: Array
    links: Array  # logarithms of factors
    usual: Array  # logarithm of the stiffness per effort limit
    delay: Array
    relaxation: Array  # logarithm
    response: Array  # logarithm

    @classmethod
    def of(cls, vector: Array, shaken: int) -> "Unknowns":
        """From one vector, shape (5 shaken + 4,)."""
        return cls(*np.split(vector, np.cumsum([shaken] * 5 + [1] * 3)))


class Equations:
    """The first equation of each answer."""

    def __init__(self, answers: Sequence[Answer], believed: Believed, side: Side) -> None:
        """Args: answers: of the arm. believed: the noise and the period matter. side: where the encoders are."""
        counts = [each.rate.size for each in answers]
        self.side = side
        self.joint = np.repeat([each.joint for each in answers], counts)
        self.shaken = np.unique(self.joint)
        self.effort = np.concatenate([each.effort for each in answers])
        self.s = 1j * np.concatenate([each.rate for each in answers])
        self.position = np.concatenate([each.position for each in answers])
        self._sliding = np.concatenate([each.sliding for each in answers])
        self._links = np.repeat([each.links for each in answers], counts, axis=0)
        self._noise = believed.noise[self.joint] * np.repeat([each.spread for each in answers], counts)
        self._rows = np.arange(self.joint.size)
        half = 0.5 * believed.period
        self._held = np.exp(-self.s * half) * np.sinc(np.abs(self.s) * half / np.pi)

    def unknowns(self, vector: Array) -> Unknowns:
        """What is sought, from one vector, shape (5 shaken + 4,)."""
        return Unknowns.of(vector, self.shaken.size)

    def all_joints(self, values: Array) -> Array:
        """Values of the shaken joints among zeros, shape (joints,)."""
        result = np.zeros(self.position.shape[1])
        result[self.shaken] = values
        return result

    def late(self, unknowns: Unknowns) -> Complex:
        """L, with the time for which torques are held, shape (answers,)."""
        return np.asarray(np.exp(-self.s * unknowns.delay) * self._held / self._lag(unknowns))

    def _lag(self, unknowns: Unknowns) -> Complex:
        response = self.s / np.exp(unknowns.response)
        return np.asarray(1.0 + np.sqrt(2.0) * response + response**2)

    def torque(self, unknowns: Unknowns) -> Complex:
        """The right-hand side, shape (answers,), N m."""
        links = self._of_links(unknowns)
        through = self._through(links, unknowns)
        return np.asarray(
            self._resistance(unknowns) * self._motor(through, unknowns) + through + self._friction(unknowns)
        )

    def error(self, unknowns: Unknowns) -> Array:
        """By how much both sides may differ, shape (answers,), N m."""
        mass = self._mass(unknowns)[self._rows, self.joint, self.joint] * self.s**2
        rotor = self.all_joints(np.exp(unknowns.rotor))[self.joint] * self.s**2
        yields = self._compliance(unknowns)[self._rows, self.joint]
        of_link = (1.0 + yields * rotor) * mass if self.side is Side.LINK else mass / (1.0 + yields * mass)
        return np.asarray(np.hypot(_ERROR * np.abs(self.effort), np.abs(rotor + of_link) * self._noise))

    def slopes(self, unknowns: Unknowns) -> Complex:
        """Derivatives of U L minus the right-hand side, with opposite sign, shape (answers, unknowns)."""
        s, j = self.s, self.joint
        own = (j[:, np.newaxis] == self.shaken).astype(np.float64)
        links = self._of_links(unknowns)
        through = self._through(links, unknowns)
        motor, resistance = self._motor(through, unknowns), self._resistance(unknowns)
        of_links, of_springs = self._slopes_of_through(links, unknowns)
        yields, relaxed = self._compliance(unknowns), 1.0 + np.exp(unknowns.relaxation) * s
        gain = np.ones_like(s)
        own_yield = yields[self._rows, j]
        if self.side is Side.LINK:
            gain = 1.0 + resistance * own_yield
            of_springs = own * (resistance * through)[:, np.newaxis]
        else:
            of_springs = of_springs[:, self.shaken]
        # Compliances fall with stiffness and relaxation.
        of_stiffness = -of_springs * yields[:, self.shaken]
        of_relaxation = of_stiffness.sum(axis=1) * np.exp(unknowns.relaxation) * s / relaxed
        late = self.effort * self.late(unknowns)
        response = s / np.exp(unknowns.response)
        of_response = -late * (np.sqrt(2.0) * response + 2.0 * response**2) / self._lag(unknowns)
        rotor = self.all_joints(np.exp(unknowns.rotor))[j]
        columns = [  # in the order of `Unknowns`
            own * (rotor * s**2 * motor)[:, np.newaxis],
            of_stiffness,
            own * (s * motor)[:, np.newaxis],
            own * self._sliding[:, np.newaxis],
            gain[:, np.newaxis] * of_links[:, self.shaken],
            np.zeros((s.size, 1)),
            (s * late)[:, np.newaxis],
            of_relaxation[:, np.newaxis],
            of_response[:, np.newaxis],
        ]
        return np.concatenate(columns, axis=1)

    def _slopes_of_through(self, links: Complex, unknowns: Unknowns) -> tuple[Complex, Complex]:
        """Derivatives of `_through` by factors of links and by compliances, shape (answers, joints) each."""
        s, rows, j = self.s, self._rows, self.joint
        mass, yields = self._mass(unknowns), self._compliance(unknowns)
        inertial = np.einsum("rij,rj->ri", mass, links) * (s**2)[:, np.newaxis]
        row = mass[rows, j] * (s**2)[:, np.newaxis]
        own = (j[:, np.newaxis] == np.arange(links.shape[1])).astype(np.float64)
        by_links = 0.5 * (own * inertial[rows, j][:, np.newaxis] + row * links)
        if self.side is not Side.MOTOR:
            return by_links, np.zeros_like(by_links)
        # d Q = -A^-1 (C s^2 dM Q + dC s^2 M Q) with A = 1 + C s^2 M.
        through = np.linalg.solve(self._system(unknowns).swapaxes(1, 2), row[:, :, np.newaxis])[:, :, 0]
        weighted = through * yields
        back = np.einsum("ri,rij->rj", weighted, mass) * (s**2)[:, np.newaxis]
        by_links = by_links - 0.5 * (weighted * inertial + back * links)
        return by_links, -through * inertial

    def _compliance(self, unknowns: Unknowns) -> Complex:
        """How far each spring yields per torque, shape (answers, joints), rad/(N m)."""
        if self.side is Side.RIGID:
            return np.zeros(self.position.shape, dtype=np.complex128)
        still = self.all_joints(np.exp(-unknowns.stiffness))
        return np.asarray(still / (1.0 + np.exp(unknowns.relaxation) * self.s[:, np.newaxis]))

    def _mass(self, unknowns: Unknowns) -> Array:
        """Inertia matrices of the links, shape (answers, joints, joints)."""
        share = np.exp(0.5 * self.all_joints(unknowns.links))
        return np.asarray(self._links * np.outer(share, share))

    def _system(self, unknowns: Unknowns) -> Complex:
        """A with A Q = T, shape (answers, joints, joints)."""
        coupled = self._compliance(unknowns)[:, :, np.newaxis] * self._mass(unknowns)
        return np.asarray(np.eye(self.position.shape[1]) + coupled * (self.s**2)[:, np.newaxis, np.newaxis])

    def _of_links(self, unknowns: Unknowns) -> Complex:
        """Q, shape (answers, joints)."""
        if self.side is not Side.MOTOR:
            return self.position
        return np.asarray(np.linalg.solve(self._system(unknowns), self.position[:, :, np.newaxis])[:, :, 0])

    def _through(self, links: Complex, unknowns: Unknowns) -> Complex:
        """(M s^2 Q)_j, shape (answers,), N m."""
        return np.asarray(np.einsum("rk,rk->r", self._mass(unknowns)[self._rows, self.joint], links) * self.s**2)

    def _motor(self, through: Complex, unknowns: Unknowns) -> Complex:
        """T_j, shape (answers,)."""
        measured = self.position[self._rows, self.joint]
        if self.side is not Side.LINK:
            return measured
        return np.asarray(measured + self._compliance(unknowns)[self._rows, self.joint] * through)

    def _resistance(self, unknowns: Unknowns) -> Complex:
        """J_j s^2 + v_j s, shape (answers,)."""
        rotor, viscous = (self.all_joints(each)[self.joint] for each in (np.exp(unknowns.rotor), unknowns.viscous))
        return np.asarray((rotor * self.s + viscous) * self.s)

    def _friction(self, unknowns: Unknowns) -> Complex:
        return np.asarray(self.all_joints(unknowns.coulomb)[self.joint] * self._sliding)
