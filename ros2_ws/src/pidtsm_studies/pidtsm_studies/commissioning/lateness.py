"""Step 3: how late torques act, from a small chirp of one joint after the other."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift
from scipy.signal import butter, sosfiltfilt

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.bench import Bench, Outcome, Plan
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.motions import Motion, chirp, joined, rest

_LOW, _HIGH, _DURATION = 2.0, 10.0, 2.4
"""Hz, Hz and s of a chirp."""
_QUICK, _SHARE = 6.0, 0.15
"""Largest acceleration, rad/s^2, and largest share of the effort limit that it needs."""
_BAND = 25.0
"""Hz; above, positions are mostly noise."""
_LONGEST, _GRID = 0.04, 0.00025
"""Delays that are tried, s."""
_PARTS = 4
"""Parts of a chirp whose delays tell how sure the delay is."""
_SLOW = 0.02
"""rad/s, about which the sign of the velocity changes gradually."""
_UNSURE = 0.5
"""Half-interval above which a delay does not replace a lower cautious one, as a share of that."""
_UNEXPLAINED = 0.5
"""Share of the torque's variation above which a chirp tells nothing."""


def _chirps(bench: Bench) -> list[Motion]:
    model = bench.model()
    inertia = np.diag(model.inertia(bench.home))
    acceleration = np.minimum(_QUICK, _SHARE * model.effort / inertia)
    amplitude = np.minimum(acceleration / (2.0 * np.pi * _LOW) ** 2, bench.reach(model, 0.1))
    return [
        chirp(bench.home, np.where(np.arange(inertia.size) == j, amplitude, 0.0), _LOW, _HIGH, _DURATION)
        for j in range(inertia.size)
    ]


def _motion(bench: Bench) -> Motion:
    return joined(*(part for each in _chirps(bench) for part in (each, rest(bench.home, 0.2))))


def plan(bench: Bench) -> Plan:
    """See `session.STEPS`."""
    text = f"One joint after the other swings a little, at {_LOW:g} to {_HIGH:g} Hz."
    return bench.plan(text, _motion(bench), bench.model())


def run(bench: Bench) -> Outcome:
    """See `session.STEPS`."""
    samples = bench.follow(_motion(bench))
    model, swings = bench.model(), samples.motion
    time = swings.time
    each = _DURATION + 0.2
    late = np.full(len(model.joints), np.nan)
    deviation = np.full(len(model.joints), np.nan)
    for j in range(late.size):
        rows = (time >= j * each) & (time < j * each + _DURATION)
        late[j], deviation[j] = _late(swings, rows, j)
    period = 1.0 / bench.rate
    known = np.isfinite(late)
    problems = [f"the chirp of {model.joints[j]} tells nothing: friction holds it" for j in np.flatnonzero(~known)]
    if not known.any():
        delay, half = bench.delay, bench.delay
        problems.append("no joint tells how late torques act; the cautious value stays")
    else:
        # Joints that stick differ most; the median does not mind some of them.
        middle = float(np.median(late[known]))
        spread = float(np.median(np.abs(late[known] - middle)))
        # The torque is held over a period, which the rule knows.
        delay = max(0.0, middle - 0.5 * period)
        half = 2.0 * max(1.5 * spread, float(np.median(deviation[known])), _GRID) / np.sqrt(known.sum())
        if half > _UNSURE * bench.delay and delay > bench.delay:
            # Gains for a delay that is only feared would be too low for friction.
            delay = bench.delay
            problems.append("joints that stick do not tell how late torques act; the cautious value stays")
    figures = {
        "delay": delay,
        "half_interval": half,
        "of_joints": [None if np.isnan(each) else float(each) for each in late],
    }
    verdict = f"torques act {1e3 * delay:.1f} ± {1e3 * half:.1f} ms after the position that they answer"
    return Outcome(verdict, figures, problems, samples={"lateness": samples})


def _late(swings: Samples, rows: NDArray[np.bool_], j: int) -> tuple[float, float]:
    """How late the torque of joint j acts in these rows, and its standard deviation, s; nan: not known."""
    time = swings.time[rows]
    period = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], period)
    q, torque = (np.interp(even, time, each[rows, j]) for each in (swings.position, swings.effort))
    band = butter(3, [0.5 * _LOW, min(_BAND, 0.3 / period)], "bandpass", fs=1.0 / period, output="sos")
    rough_rate = np.gradient(sosfiltfilt(butter(3, min(_BAND, 0.3 / period), fs=1.0 / period, output="sos"), q), period)
    columns = [np.gradient(rough_rate, period), rough_rate, np.tanh(rough_rate / _SLOW), q]
    matrix = np.stack([sosfiltfilt(band, each) for each in columns], axis=1)
    torque = sosfiltfilt(band, torque)
    inner = slice(round(0.1 / period), -round(0.1 / period))
    whole, unexplained = _best(matrix[inner], torque, inner, period)
    if unexplained > _UNEXPLAINED:
        return np.nan, np.nan
    ends = np.linspace(inner.start, even.size + inner.stop, _PARTS + 1).astype(int)
    parts = [_best(matrix[a:b], torque, slice(a, b), period)[0] for a, b in pairwise(ends.tolist())]
    return whole, float(np.std(parts) / np.sqrt(_PARTS))


def _best(matrix: Array, torque: Array, rows: slice, period: float) -> tuple[float, float]:
    """The delay with which a delayed torque fits best, s, and the share of it that stays unexplained."""
    delays = np.arange(0.0, _LONGEST, _GRID)
    left = []
    for delay in delays:
        late = shift(torque, delay / period, order=1, mode="nearest")[rows]
        fit = np.linalg.lstsq(matrix, late, rcond=None)[0]
        left.append(float(np.sum((late - matrix @ fit) ** 2) / np.sum(late**2)))
    k = int(np.clip(np.argmin(left), 1, len(left) - 2))
    low, middle, high = left[k - 1 : k + 2]
    curve = low - 2.0 * middle + high
    return float(delays[k] + (0.5 * _GRID * (low - high) / curve if curve > 0.0 else 0.0)), float(np.sqrt(min(left)))
