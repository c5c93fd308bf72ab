"""What theory says of a run: bounds (19), (23) to (25), (29), (35), (41) and (47), beside what was measured.

Everything is measured from the true motion. The disturbance is what separates the true acceleration from the commanded
one: d = q'' - a_cmd, with q'' the change of the true velocity over the period in which a_cmd is held. It contains all
that the model lacks, also delays and the change of the torque that would be due within a period. In sigma it is
Lambda = Kd g d, eq. (17), or g d without a PID manifold, where s' = g q'' + h. Samples at which any torque is limited,
and those whose window reaches the event of the run, do not count.

Shapes in this module: (samples, joints) for series, (joints,) for anything per joint.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.laws.surfaces import SURFACES
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.family import SLOTS
from pidtsm_core.recording import Recording
from pidtsm_core.recording.metrics import SETTLED_SHARE, finite
from pidtsm_core.recording.outcome import GROUND_TRUTH
from pidtsm_studies.theory.condition import Truths
from pidtsm_studies.theory.parts import Parts, parts_of
from pidtsm_studies.theory.settling import exact_time, printed_time, time_bound

WINDOW = 0.02
"""s over which the rate of the disturbance is taken: shorter than anything that the arm does, longer than a ripple."""
_REST = 1e-12
"""Velocity of the error that is rounding, rad/s; as in the surfaces."""
_BAND = 0.01
"""Share of the largest |sigma| that counts as reached by a law without a dead zone or layer."""
_HOLD = 0.1
"""s for which |sigma| must stay in its band to count as reached."""
_FIT = (0.05, 0.005)
"""Shares of |s| at the reaching time between which its rate of decay is measured: with
Table 1 s passes 0 once and comes back to 0.083 of it, the faster mode has gone at 0.05, and disturbances do not show
yet."""
_DECAY_SAMPLES = 50
"""Smallest number of samples of such a measurement."""


@dataclass(frozen=True)
class Bounds:
    """Bounds along a run, and what was measured; per joint shape (joints,), nan: it does not exist.

    The unit of Lambda is that of sigma, for `piddtsm` rad/s^2; those of gains and of Lambda's rate have one more 1/s.

    Attributes:
        parts: the law.
        joints: names.
        time: s, shape (samples,).
        disturbance: sup |Lambda|, eq. (17).
        disturbance_rate: Upsilon_d, sup |Lambda'|, eq. (19).
        event_jump: jump of |Lambda| at the event of the run, where (19) holds for no Upsilon_d; nan without an event.
        gain_condition: Upsilon_d + Upsilon_t = (1 + k) Upsilon_d, the switching gain that (23), (24) demand; nan for
            another reaching law than the article's.
        gain_needed: what sigma' sigma < 0 needs of the switching gain: sup |Lambda' + k Lambda| for the article's
            reaching law; for one that prescribes the rate of sigma sup |Lambda'|, or sup |Lambda| without a PID
            manifold. For super-twisting the rate of those (Levant 1993), without a PID manifold only.
        gain: series: Y + xi, or the gain of the reaching law (of super-twisting the integral's), shape (samples,
            joints).
        need: series: what `gain_needed` is the largest of, over the window that ends here, shape (samples, joints); nan
            where it does not count.
        short: share of the samples that count at which the gain is below this need.
        switching_term: sup |tau_sw|.
        switching_bound: (sup Y + xi) / k, which bounds it by (25).
        terminal_rate: sup |u_f|, eq. (13), rad^alpha/s.
        limited: share of the samples in which (29) limits u_f.
        lyapunov: series: V, eq. (35), of all joints together, shape (samples,); with Y for the article's law on a PID
            manifold, otherwise of sigma alone.
        lyapunov_rise: how far V ever rises above an earlier value, as a share of its start.
        sigma_integral: integral of |sigma| up to the event.
        sigma_bound: V(0) / xi, which bounds their sum by (41).
        band: |sigma| that counts as reached: the dead zone (30), a layer, or 1 % of the largest.
        reaching_time: time from which |sigma| is in the band for at least 0.1 s, s.
        last_outside: time at which |sigma| is outside of the band for the last time after that, before the event, s;
            nan: never. PIDDTSM leaves it where e passes 0, see docs/theory.md.
        error_at_reaching: |e| then, rad.
        printed: (47) for this error as printed, s.
        settling_bound: a bound for it that holds, see `time_bound`, s.
        settling_exact: the time on s = 0, s.
        settling: measured, from the reaching time until |e| stays below 2 % of its start, s.
        decay: measured rate at which |s| decays after the reaching time, with a PID manifold, 1/s.
    """

    parts: Parts
    joints: tuple[str, ...]
    time: Array
    disturbance: Array
    disturbance_rate: Array
    event_jump: Array
    gain_condition: Array
    gain_needed: Array
    gain: Array
    need: Array
    short: Array
    switching_term: Array
    switching_bound: Array
    terminal_rate: Array
    limited: Array
    lyapunov: Array
    lyapunov_rise: float
    sigma_integral: Array
    sigma_bound: float
    band: Array
    reaching_time: Array
    last_outside: Array
    error_at_reaching: Array
    printed: Array
    settling_bound: Array
    settling_exact: Array
    settling: Array
    decay: Array

    def to_json(self) -> dict[str, Any]:
        """The numbers as plain dictionaries and lists; of series the last value, of V also the first one."""
        skipped = ("parts", "joints", "time", "gain", "need", "lyapunov")
        values = {
            name: each.tolist() if isinstance(each, np.ndarray) else each
            for name, each in vars(self).items()
            if name not in skipped
        }
        return {
            "joints": list(self.joints),
            **{name: finite(each) for name, each in values.items()},
            "gain": finite(self.gain[-1].tolist()),
            "lyapunov": finite([float(self.lyapunov[0]), float(self.lyapunov[-1])]),
        }


def evaluate(recording: Recording, controller: Mapping[str, Value]) -> Bounds | None:
    """The bounds along a run; None if its law has no sliding variable.

    Args:
        recording: of the run.
        controller: every parameter of its controller, checked; joints in the order of the recording.

    Raises:
        UsageError: the recording has no ground truth, or fewer than three samples.
    """
    parts = parts_of(controller, len(recording.joints))
    if not parts.slides:
        return None
    if recording.truth != GROUND_TRUTH:
        raise UsageError("the bounds need the true motion, and this run has only what was measured")
    if recording.time.size < 3:
        raise UsageError(f"the bounds need at least three samples, and this run has {recording.time.size}")
    before = recording.time.size
    if recording.event_time is not None:
        before = max(3, int(np.searchsorted(recording.time, recording.event_time)))
    sigma = recording.manifold_variable
    rate = _Disturbance(recording, parts, before)
    gain = _gain(recording, parts)
    lyapunov, start = _lyapunov(recording, parts, rate.condition)
    band = _band(parts, sigma)
    hold = max(1, round(_HOLD / float(np.median(np.diff(recording.time)))))
    outside = np.abs(sigma[:before]) > band
    reached = [_reached(outside[:, j], hold) for j in range(parts.joints)]
    u_f, limited = _terminal(recording, parts)
    dt = np.diff(recording.time[:before], append=recording.time[before - 1])[:, np.newaxis]
    return Bounds(
        parts=parts,
        joints=recording.joints,
        time=recording.time,
        disturbance=rate.size,
        disturbance_rate=rate.rate,
        event_jump=rate.jump,
        gain_condition=rate.condition,
        gain_needed=rate.needed,
        gain=gain,
        need=rate.need,
        short=rate.short(gain),
        switching_term=np.abs(recording.switching_term).max(axis=0),
        switching_bound=_switching_bound(gain, parts),
        terminal_rate=u_f,
        limited=limited,
        lyapunov=lyapunov,
        lyapunov_rise=_rise(lyapunov),
        sigma_integral=(np.abs(sigma[:before]) * dt).sum(axis=0),
        sigma_bound=_sigma_bound(start, parts),
        band=band,
        reaching_time=np.array([math.nan if k is None else recording.time[k] - recording.time[0] for k in reached]),
        last_outside=np.array([_last(recording.time, outside[:, j], k) for j, k in enumerate(reached)]),
        decay=np.array([_decay(recording, j, k, before, parts) for j, k in enumerate(reached)]),
        **_settling(recording, parts, reached, before),
    )


class _Disturbance:
    """Lambda along a run: its size, rate, and what they demand of the switching gain; shape (joints,) each."""

    def __init__(self, recording: Recording, parts: Parts, before: int) -> None:
        time, window = recording.time, _window(recording.time)
        period = np.diff(time)[:, np.newaxis]
        acceleration = np.diff(recording.velocity, axis=0) / period
        lumped = _slope(recording, parts)[:-1] * (acceleration - recording.acceleration_command[:-1])
        if parts.manifold == "pid":
            lumped *= parts.gains["kd"]
        limited = (recording.saturated[:-1] != 0.0).any(axis=1)
        at_event = np.arange(limited.size) == before - 1 if before < time.size else np.zeros_like(limited)
        rate = (lumped[window:] - lumped[:-window]) / (time[window:-1] - time[: -window - 1])[:, np.newaxis]
        middle = 0.5 * (lumped[window:] + lumped[:-window])
        usable = ~_reaches(limited | at_event, window)
        self.size = _largest(lumped, ~limited)
        self.rate = _largest(rate, usable)
        self.jump = np.full(parts.joints, math.nan)
        if before < lumped.shape[0]:
            self.jump = np.abs(lumped[before] - lumped[before - 2])
        self.condition = np.full(parts.joints, math.nan)
        need = rate if parts.manifold == "pid" or parts.reaching == "super_twisting" else middle
        if parts.reaching == "adaptive_continuous":
            self.condition = (1.0 + parts.gains["k"]) * self.rate
            need = rate + parts.gains["k"] * middle
        if parts.reaching == "super_twisting" and parts.manifold == "pid":
            need = np.full_like(rate, math.nan)
        self.needed = _largest(need, usable)
        self.need = np.full(recording.position.shape, math.nan)
        self.need[window:-1][usable] = np.abs(need[usable])

    def short(self, gain: Array) -> Array:
        """Share of the samples that count at which a gain, shape (samples, joints), is below the need."""
        known = ~np.isnan(self.need)
        with np.errstate(invalid="ignore"):
            return np.asarray(((gain < self.need) & known).sum(axis=0) / known.sum(axis=0))


def _window(time: Array) -> int:
    """Number of periods of `WINDOW`, at least one."""
    return min(max(1, round(WINDOW / float(np.median(np.diff(time))))), time.size - 2)


def _reaches(where: Truths, window: int) -> Truths:
    """Whether any sample from k to k + window, both included, is one of these, shape (samples - window,)."""
    count = np.concatenate(([0], np.cumsum(where)))
    return (count[window + 1 :] - count[: -window - 1]) > 0


def _largest(values: Array, usable: Truths) -> Array:
    """Largest magnitude over usable samples, shape (joints,); nan if there are none."""
    return np.abs(values[usable]).max(axis=0) if usable.any() else np.full(values.shape[1], math.nan)


def _slope(recording: Recording, parts: Parts) -> Array:
    """g of s' = g q'' + h, shape (samples, joints)."""
    e, de, surface = recording.estimated_error, recording.estimated_velocity_error, SURFACES[parts.surface]
    slope = np.ones_like(e)
    for j in range(parts.joints):
        p = np.zeros(SLOTS)
        p[: len(surface.parameters)] = [parts.gains[each.name][j] for each in surface.parameters]
        if surface.evaluate(0.1, 0.1, 0.0, p)[1] != 1.0:
            slope[:, j] = [surface.evaluate(a, b, 0.0, p)[1] for a, b in np.column_stack((e[:, j], de[:, j])).tolist()]
    return slope


def _gain(recording: Recording, parts: Parts) -> Array:
    """The switching gain, shape (samples, joints)."""
    if parts.reaching == "super_twisting":
        return np.broadcast_to(parts.gains["integral_gain"], recording.adaptive_gain.shape)
    return recording.adaptive_gain + parts.gains.get("xi", np.zeros(parts.joints))


def _switching_bound(gain: Array, parts: Parts) -> Array:
    if parts.reaching != "adaptive_continuous":
        return np.full(parts.joints, math.nan)
    with np.errstate(divide="ignore"):
        return np.asarray(gain.max(axis=0) / parts.gains["k"])


def _lyapunov(recording: Recording, parts: Parts, condition: Array) -> tuple[Array, float]:
    """V at every sample, shape (samples,), and at the start."""
    v = 0.5 * (recording.manifold_variable**2).sum(axis=1)
    if parts.manifold == "pid" and parts.reaching == "adaptive_continuous":
        missing = recording.adaptive_gain - np.nan_to_num(condition)
        v = v + 0.5 * (parts.gains["kappa"] * missing**2).sum(axis=1)
    return v, float(v[0])


def _rise(v: Array) -> float:
    """How far a series rises above an earlier value, as a share of its start."""
    return float((v - np.minimum.accumulate(v)).max() / v[0]) if v[0] > 0.0 else math.nan


def _sigma_bound(start: float, parts: Parts) -> float:
    """V(0) / xi: (41) integrated."""
    if parts.manifold != "pid" or parts.reaching != "adaptive_continuous" or not (parts.gains["xi"] > 0.0).all():
        return math.nan
    return start / float(parts.gains["xi"].min())


def _band(parts: Parts, sigma: Array) -> Array:
    """|sigma| that counts as reached, shape (joints,)."""
    largest = _BAND * np.abs(sigma).max(axis=0)
    for name in ("upsilon", "width"):
        if name in parts.gains:
            return np.where(parts.gains[name] > 0.0, parts.gains[name], largest)
    return largest


def _reached(outside: Truths, hold: int) -> int | None:
    """First sample from which on a series is inside for so many samples, or to its end; None: it never is."""
    later = np.append(np.flatnonzero(outside), outside.size)
    starts = np.concatenate(([0], later[:-1] + 1))
    kept = (later - starts >= hold) | ((later == outside.size) & (starts < outside.size))
    return int(starts[kept][0]) if kept.any() else None


def _last(time: Array, outside: Truths, reached: int | None) -> float:
    """Time since the start of the last sample outside after one, s; nan: there is none."""
    where = np.flatnonzero(outside) if reached is not None else np.array([], dtype=np.intp)
    return float(time[where[-1]] - time[0]) if where.size and where[-1] > (reached or 0) else math.nan


def _stays(size: Array, bound: float) -> int | None:
    """First sample from which on a series, shape (samples,), is at most its bound; None: it ends above."""
    above = np.flatnonzero(size > bound)
    first = int(above[-1]) + 1 if above.size else 0
    return first if first < size.size else None


def _terminal(recording: Recording, parts: Parts) -> tuple[Array, Array]:
    """Largest |u_f| without its limit, and the share of the samples in which it is limited."""
    if "u_s" not in parts.gains:
        return np.full(parts.joints, math.nan), np.full(parts.joints, math.nan)
    e, de = np.abs(recording.estimated_error), np.abs(recording.estimated_velocity_error)
    with np.errstate(divide="ignore"):
        u_f = np.where(de < _REST, 0.0, np.where(e == 0.0, np.inf, e ** (parts.gains["alpha"] - 1.0)) * de)
    return u_f.max(axis=0), np.asarray((u_f >= parts.gains["u_s"]).mean(axis=0))


def _settling(recording: Recording, parts: Parts, reached: list[int | None], before: int) -> dict[str, Array]:
    """The error when sigma is reached, the times that follow from it, and the measured one."""
    names = ("error_at_reaching", "printed", "settling_bound", "settling_exact", "settling")
    found = {name: np.full(parts.joints, math.nan) for name in names}
    for j, k in enumerate(reached):
        if k is None:
            continue
        size = np.abs(recording.error[:before, j])
        found["error_at_reaching"][j] = size[k]
        settled = _stays(size, SETTLED_SHARE * size[0])
        if settled is not None:
            found["settling"][j] = max(0.0, float(recording.time[settled] - recording.time[k]))
        if parts.surface == "dual_terminal":
            gains = tuple(float(parts.gains[name][j]) for name in ("k1", "k2", "alpha"))
            for name, of in zip(names[1:4], (printed_time, time_bound, exact_time), strict=True):
                found[name][j] = of(float(size[k]), *gains)
    return found


def _decay(recording: Recording, j: int, reached: int | None, before: int, parts: Parts) -> float:
    """Rate at which |s| of a joint decays between two shares of its value when sigma is reached, 1/s; nan: too few."""
    if reached is None or parts.manifold != "pid":
        return math.nan
    size = np.abs(recording.sliding_variable[reached:before, j])
    first, last = (int(np.flatnonzero(size >= share * size[0])[-1]) for share in _FIT)
    if last - first < _DECAY_SAMPLES or last == size.size - 1:
        return math.nan
    time = recording.time[reached + first : reached + last]
    return -float(np.polyfit(time, np.log(np.maximum(size[first:last], 1e-300)), 1)[0])
