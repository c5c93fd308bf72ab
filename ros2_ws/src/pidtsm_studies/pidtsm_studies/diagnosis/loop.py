"""What several detectors need of a recording: an even grid, derivatives, and spectra."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, coherence, sosfiltfilt, welch

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.observed import Observed

Samples: TypeAlias = NDArray[np.bool_]
"""Whether each sample counts, shape (samples,)."""
_SHORTEST = 2.0
"""s that a loop must follow its reference; of one that does so for less time, everything is used."""
_SPECTRUM, _PIECES = 4.0, 4
"""s of the pieces whose spectra are averaged, and into how many a recording is cut at least: one is coherent."""
_SMOOTH = 10.0
"""Hz, bandwidth of `Loop.velocity`."""
_TELLS = 4.0
"""s that a loop must have followed before it was stopped, for more than the stop to be judged."""
_BEFORE, _AFTER = 3.0, 1.0
"""s of `Loop.around_stop` before and after it."""
_SETTLED = 1.0
"""s at the start that are left out: gains and observers settle."""


@dataclass(frozen=True)
class Spectrum:
    """Power spectral densities, shape (frequencies, joints).

    Attributes:
        frequency: Hz, shape (frequencies,).
        position, effort: of the recording, unit^2/Hz.
        coherence: of the two, from 0 to 1.
        following: coherence of position and desired position; zeros if that is not known.
    """

    frequency: Array
    position: Array
    effort: Array
    coherence: Array
    following: Array


class Loop:
    """A recording on an even grid, as far as the loop follows its reference.

    Attributes:
        observed: everything that was recorded.
        joints: names.
        period: s.
        time: s, even, shape (samples,).
        position, effort: shape (samples, joints), rad or m, N m or N.
        command, reference: likewise; None: not recorded.
    """

    def __init__(self, observed: Observed, before_stop: float = 0.5) -> None:
        """Leave out `before_stop` s before a stop.

        Raises:
            ValueError: the recording is shorter than two samples.
        """
        self.observed, self.joints, self.period = observed, observed.joints, observed.period
        rows = self._rows(before_stop)
        known = observed.time[rows]
        self.time = np.arange(known[0], known[-1], self.period)
        self.position = self._even(known, observed.position[rows])
        self.effort = self._even(known, observed.effort[rows])
        self.command = None if observed.command is None else self._even(known, observed.command[rows])
        self.reference = None if observed.reference is None else self._even(known, observed.reference[rows])

    def _rows(self, before_stop: float) -> Samples:
        """Samples that are used: those in which the loop follows, after it has settled."""
        observed = self.observed
        rows: Samples = np.asarray(np.isfinite(observed.position).all(axis=1))
        if observed.following is not None:
            rows = self._long_enough(rows & observed.following, rows)
        if observed.stopped and rows.any():
            # What happens at a stop is a consequence.
            rows = self._long_enough(rows & (observed.time < observed.time[rows][-1] - before_stop), rows)
        return self._long_enough(rows & (observed.time >= observed.time[np.argmax(rows)] + _SETTLED), rows)

    def _long_enough(self, rows: Samples, otherwise: Samples) -> Samples:
        """Samples, or others if these are too few."""
        return rows if np.count_nonzero(rows) * self.period >= _SHORTEST else otherwise

    def _even(self, known: Array, values: Array) -> Array:
        """Values on the grid; what is not a number is bridged."""
        columns = []
        for column in values.T:
            finite = np.isfinite(column)
            columns.append(np.interp(self.time, known[finite], column[finite]) if finite.any() else 0.0 * self.time)
        return np.stack(columns, axis=1)

    @property
    def followed(self) -> float:
        """How long the loop has followed its reference, s; infinite if that is not known."""
        following = self.observed.following
        return np.inf if following is None else float(np.count_nonzero(following) * self.period)

    @property
    def follows(self) -> bool:
        """Whether the loop has followed for long enough to be judged by how."""
        return not self.observed.stopped or self.followed >= _TELLS

    def around_stop(self) -> "Loop | None":
        """The last seconds before the controller stopped, and the first after it; None: it has not."""
        following = self.observed.following
        if not self.observed.stopped or following is None or not following.any():
            return None
        stop = self.observed.time[np.flatnonzero(following)[-1]]
        return self._between(stop - _BEFORE, stop + _AFTER)

    def last(self, seconds: float) -> "Loop | None":
        """The last seconds; None: there is nothing."""
        return self._between(float(self.time[-1]) - seconds, float(self.time[-1]))

    def _between(self, begin: float, end: float) -> "Loop | None":
        part = self.observed.between(begin, end)
        return Loop(part) if part.time.size > 1 else None

    @property
    def rate(self) -> float:
        """Samples per second."""
        return 1.0 / self.period

    @property
    def duration(self) -> float:
        """s."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def velocity(self) -> Array:
        """Low-passed velocity, shape (samples, joints), rad/s or m/s."""
        return np.asarray(np.gradient(self.smooth(self.position, _SMOOTH), self.period, axis=0))

    @cached_property
    def desired_velocity(self) -> Array:
        """Velocity of the reference, or of the slow part of the motion if there is none, shape (samples, joints)."""
        wanted = self.smooth(self.position, 0.5) if self.reference is None else self.smooth(self.reference, _SMOOTH)
        return np.asarray(np.gradient(wanted, self.period, axis=0))

    def smooth(self, values: Array, cutoff: float) -> Array:
        """Values below a frequency (Hz), without a shift of phase, shape (samples, joints)."""
        return self._filtered(values, cutoff, "lowpass")

    def rough(self, values: Array, cutoff: float) -> Array:
        """Values above a frequency (Hz), without a shift of phase, shape (samples, joints)."""
        return self._filtered(values, cutoff, "highpass")

    def _filtered(self, values: Array, cutoff: float, kind: str) -> Array:
        sections = butter(2, min(cutoff, 0.45 * self.rate), kind, fs=self.rate, output="sos")
        padding = min(len(values) - 1, round(3.0 * self.rate / cutoff))
        return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=padding))

    @cached_property
    def spectrum(self) -> Spectrum:
        """Spectra of position and effort."""
        length = min(round(_SPECTRUM * self.rate), len(self.time) // _PIECES)

        def power(values: Array) -> Array:
            return np.asarray(welch(values, self.rate, nperseg=length, detrend="linear", axis=0)[1])

        frequency = welch(self.position[:, 0], self.rate, nperseg=length)[0]
        position, effort = power(self.position), power(self.effort)
        together = [self._coherence(each, length) for each in (self.effort, self.reference)]
        return Spectrum(frequency, position, effort, *together)

    def _coherence(self, other: Array | None, length: int) -> Array:
        """Coherence of the position and something else, shape (frequencies, joints); 0 where one has no power."""
        if other is None:
            return np.zeros((length // 2 + 1, len(self.joints)))
        with np.errstate(divide="ignore", invalid="ignore"):
            found = coherence(self.position, other, self.rate, nperseg=length, detrend="linear", axis=0)[1]
        return np.nan_to_num(found)
