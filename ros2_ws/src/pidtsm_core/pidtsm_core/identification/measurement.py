"""What identification needs of a run: measured positions and efforts, smoothed and differentiated."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.signal import butter, sosfiltfilt, welch

from pidtsm_core.arrays import Array
from pidtsm_core.identification.regressor import REVERSAL, coulomb_column

_LONGEST_GAP = 0.02
"""s; longer gaps between samples, of more than three periods, separate a recording into pieces."""
_SHORTEST_PIECE = 2.0
"""s; by default, shorter pieces are not used."""
_ORDER = 4
"""Of the Butterworth low-pass, which runs forwards and backwards."""
SETTLING = 1.5
"""Part of each end of a piece that is not used, where the filter has not settled, in periods of the bandwidth."""
_MEMORY = 0.5
"""Time over which the filter averages to either side, in periods of the bandwidth."""
_OVERSAMPLING = 2.5
"""Samples kept per period of the bandwidth; in between, filtered data repeat themselves."""
SLOW = 1.0 / 3.0
"""Bandwidth of the motion that serves as an instrument, see `least_squares`, relative to that of the other."""
_LOWEST, _HIGHEST = 1.0, 15.0
"""Range of the bandwidth, Hz: motions of arms are slower, and their elasticity begins above."""
_ABOVE_NOISE = 4.0
"""Ratio to the spectrum of the noise above which the spectrum of a position counts as motion."""
FAST = 3.0 * REVERSAL
"""rad/s or m/s; from this velocity on, Coulomb friction has reached its level."""
_SPECTRUM = 4.0
"""Length of the pieces whose spectra are averaged, s."""


@dataclass(frozen=True)
class Measurement:
    """Measured motion of an arm.

    Attributes:
        joints: names, in the order of the columns.
        time: increasing, s, shape (samples,).
        position: rad or m, shape (samples, joints).
        effort: N m or N, likewise.
        limit: efforts that are as large are not used, because a drive that saturates may report another effort than it
            delivers, shape (joints,), N m or N; infinite: there is none.
        slowest: slower samples are not used, because their friction does not follow from the velocity, see
            `reversals`, rad/s or m/s: one for all joints, or shape (joints,).
        shortest: shorter pieces without gaps are not used, s.
    """

    joints: tuple[str, ...]
    time: Array
    position: Array
    effort: Array
    limit: Array
    slowest: Array | float = FAST
    shortest: float = _SHORTEST_PIECE

    @property
    def period(self) -> float:
        """The median of the periods, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def missing(self) -> float:
        """Share of the samples that a recording without gaps would have in addition."""
        return 1.0 - self.time.size / (1.0 + (self.time[-1] - self.time[0]) / self.period)

    def of(self, joints: Sequence[str]) -> "Measurement":
        """The same with these joints in this order; each must be one of its own."""
        order = [self.joints.index(joint) for joint in joints]
        return replace(
            self,
            joints=tuple(joints),
            position=self.position[:, order],
            effort=self.effort[:, order],
            limit=self.limit[order],
            slowest=np.broadcast_to(self.slowest, len(self.joints))[order],
        )

    def between(self, begin: float, end: float) -> "Measurement":
        """The part between two shares of its duration, from 0 to 1."""
        first, length = self.time[0], self.time[-1] - self.time[0]
        kept = (self.time >= first + begin * length) & (self.time <= first + end * length)
        return replace(self, time=self.time[kept], position=self.position[kept], effort=self.effort[kept])

    def pieces(self) -> Iterator[tuple[Array, Array, Array]]:
        """Time, shape (samples,), position and effort, (samples, joints), of the pieces without long gaps.

        They are on an even grid of its period.
        """
        period = self.period
        ends = np.flatnonzero(np.diff(self.time) > max(_LONGEST_GAP, 3.0 * period)) + 1
        for rows in np.split(np.arange(self.time.size), ends):
            time = self.time[rows]
            if time[-1] - time[0] >= self.shortest:
                even = np.arange(time[0], time[-1], period)
                yield even, _onto(even, time, self.position[rows]), _onto(even, time, self.effort[rows])


@dataclass(frozen=True)
class Motion:
    """Low-passed motion, without a shift of phase, and its derivatives; arrays of shape (samples, joints).

    Attributes:
        position, velocity, acceleration: rad or m, per s and per s^2.
        coulomb: the factor of Coulomb friction, filtered like the effort.
        effort: N m or N.
        effort_rate: its derivative, N m/s or N/s.
    """

    position: Array
    velocity: Array
    acceleration: Array
    coulomb: Array
    effort: Array
    effort_rate: Array

    def at(self, samples: slice | NDArray[np.int64]) -> "Motion":
        """These samples of it: arrays of shape (selected samples, joints)."""
        return Motion(*(getattr(self, each.name)[samples] for each in fields(self)))


def joined(motions: Sequence[Motion]) -> Motion:
    """One motion after the other; there is at least one."""
    return Motion(*(np.concatenate([getattr(each, field.name) for each in motions]) for field in fields(Motion)))


@dataclass(frozen=True)
class Piece:
    """A piece of a measurement, filtered, at independent samples.

    Attributes:
        time: s, shape (samples,).
        motion: low-passed with the bandwidth.
        slow: low-passed with the share `SLOW` of it, which leaves nearly no noise in the accelerations.
        usable: whether, for as long as the filter remembers, the joint has moved so fast that its friction follows from
            its velocity, and its effort was below the limit, shape (samples, joints). A joint that sticks is held by
            any friction up to the largest.
    """

    time: Array
    motion: Motion
    slow: Motion
    usable: NDArray[np.bool_]


def bandwidth(measurements: Sequence[Measurement]) -> float:
    """Bandwidth of the low-pass, Hz: up to it, the positions contain more motion than noise.

    The noise is that of the upper half of the spectrum, which the encoders make.

    Raises:
        ValueError: no piece is long enough.
    """
    highest = 0.0
    pieces = [(each.period, position) for each in measurements for _, position, _ in each.pieces()]
    if not pieces:
        raise ValueError(f"no piece without gaps is longer than {_SHORTEST_PIECE:g} s")
    for period, position in pieces:
        length = min(round(_SPECTRUM / period), len(position))
        frequency, power = welch(position, 1.0 / period, nperseg=length, detrend="linear", axis=0)
        noise = np.median(power[frequency > 0.25 / period], axis=0)
        moves = (power > _ABOVE_NOISE * noise) & (frequency < _HIGHEST)[:, np.newaxis]
        # The first frequency at which noise prevails, not the last at which chance exceeds it.
        ends = [int(np.argmin(each[2:])) + 2 for each in moves.T]
        highest = max(highest, float(frequency[max(ends)]))
    return min(max(highest, _LOWEST), _HIGHEST, 0.2 / max(period for period, _ in pieces))


def filtered(measurement: Measurement, cutoff: float, delay: float = 0.0) -> list[Piece]:
    """The pieces of a measurement, filtered, that are long enough for the filter.

    Position and effort pass the same low-pass, so that it does not change the relation between them; derivatives are
    central differences of fourth order.

    Args:
        measurement: the measurement.
        cutoff: bandwidth, Hz.
        delay: time by which the stamps of efforts are later than the motion they cause, s.
    """
    pieces = [
        _filtered(even, position, _onto(even + delay, even, effort), measurement, cutoff)
        for even, position, effort in measurement.pieces()
    ]
    return [piece for piece in pieces if piece.time.size]


def _filtered(time: Array, position: Array, effort: Array, of: Measurement, cutoff: float) -> Piece:
    """One piece, on an even grid, of a measurement."""
    period = float(time[1] - time[0])
    motion, slow = (_low_passed(position, effort, period, each) for each in (cutoff, SLOW * cutoff))
    memory = 2 * round(_MEMORY / (cutoff * period)) + 1
    usable = (np.abs(motion.velocity) > of.slowest) & (np.abs(effort) < of.limit)
    margin = max(2, round(SETTLING / (SLOW * cutoff * period)))
    used = slice(margin, max(margin, len(time) - margin), max(1, round(1.0 / (_OVERSAMPLING * cutoff * period))))
    return Piece(time[used], motion.at(used), slow.at(used), minimum_filter1d(usable, memory, axis=0)[used])


def _low_passed(position: Array, effort: Array, period: float, cutoff: float) -> Motion:
    """Motion with this bandwidth (Hz), from samples with this period (s)."""
    sections = butter(_ORDER, cutoff, fs=1.0 / period, output="sos")
    padding = min(len(position) - 1, round(SETTLING / (cutoff * period)))
    q, torque = (sosfiltfilt(sections, each, axis=0, padlen=padding) for each in (position, effort))
    dq = _difference(q, period)
    coulomb = sosfiltfilt(sections, coulomb_column(dq), axis=0, padlen=padding)
    return Motion(q, dq, _second_difference(q, period), coulomb, torque, _difference(torque, period))


def _difference(values: Array, period: float) -> Array:
    """First derivative; the two rows at each end are 0."""
    result = np.zeros_like(values)
    result[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * period)
    return result


def _second_difference(values: Array, period: float) -> Array:
    """Second derivative; the two rows at each end are 0."""
    result = np.zeros_like(values)
    near, far = values[3:-1] + values[1:-3], values[4:] + values[:-4]
    result[2:-2] = (16.0 * near - far - 30.0 * values[2:-2]) / (12.0 * period**2)
    return result


def _onto(even: Array, time: Array, values: Array) -> Array:
    """Values at other times, by linear interpolation, shape (times, joints)."""
    return np.stack([np.interp(even, time, column) for column in values.T], axis=1)
