"""Curves of runs over time for the pages, decimated for display; metrics never use decimated values."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal
from pidtsm_core.units import JointUnits
from pidtsm_core.written import scale
from pidtsm_studies.reports.packed import packed

_MOST_PARTS, _FEWEST_PARTS = 1000, 150
_NUMBERS = 225_000
"""Approximate number of values on a page for its curves, 1.2 MB; with many runs, each is drawn with fewer parts."""
_OWN = ""
"""Unit of variables whose unit depends on the law."""


class Timed(Protocol):
    """What has curves over time: a recording, or predictions of its efforts."""

    @property
    def time(self) -> Array:
        """Times of the samples, s, shape (samples,)."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names."""

    @property
    def units(self) -> tuple[JointUnits, ...]:
        """Units of each joint."""


@dataclass(frozen=True)
class Quantity:
    """A quantity plotted over time.

    Attributes:
        name: name used in ids.
        title: title of the plot.
        symbol: label of the vertical axis, before the unit.
        unit: "position" or "effort", a field of `JointUnits`; or a unit.
        values: returns the values of a run of the kind that is drawn, shape (samples, joints).
        magnitude: whether the magnitude is offered on a logarithmic axis.
        first: whether it stands beside the arm; others are folded.
    """

    name: str
    title: str
    symbol: str
    unit: str
    values: Callable[[Any], Array]
    magnitude: bool = False
    first: bool = False

    def unit_of(self, recording: Timed, joint: int) -> str:
        """SI unit for a joint."""
        return str(getattr(recording.units[joint], self.unit, self.unit))


def _signal(signal: Signal) -> Callable[[Recording], Array]:
    return lambda recording: recording.signals[:, signal]


QUANTITIES = (
    Quantity("error", "Tracking error", "e", "position", lambda run: run.error, magnitude=True, first=True),
    Quantity("effort", "Effort", "τ", "effort", lambda run: run.effort, first=True),
    Quantity("position", "Position", "q", "position", lambda run: run.position),
    Quantity("reference", "Reference", "q_d", "position", lambda run: run.desired),
    Quantity("sliding", "Sliding variable, in the unit of the surface", "s", _OWN, _signal(Signal.SLIDING_VARIABLE)),
    Quantity("manifold", "Manifold variable, in the unit of the law", "σ", _OWN, _signal(Signal.MANIFOLD_VARIABLE)),
    Quantity("gain", "Adaptive gain, in the unit of σ per second", "Υ", _OWN, _signal(Signal.ADAPTIVE_GAIN)),
)
"""Every quantity in the order of the plots."""


def curves(runs: Mapping[str, Timed], quantities: Sequence[Quantity] = QUANTITIES) -> dict[str, Any]:
    """Curves of runs with the same joints.

    Args:
        runs: by key, at least one.
        quantities: what is drawn; those that are zero in every run are left out.

    Returns:
        Plain data for viewer.js. ``plots``: one for each quantity and each unit of joints, with its title, symbol,
        unit, the factor from SI units to it, and indices of its joints. ``time``: by run, packed, s. ``values``: by
        run and id of the plot, packed, in SI units, one row for each of its joints. ``points``: of each curve at
        most; ``samples``: of each run at most.
    """
    first = next(iter(runs.values()))
    time, place = _grid([run.time for run in runs.values()], _parts(len(runs) * len(first.joints) * len(quantities)))
    plots: list[dict[str, Any]] = []
    values: dict[str, dict[str, Any]] = {key: {} for key in runs}
    for quantity in quantities:
        whole = {key: quantity.values(run) for key, run in runs.items()}
        if not any(np.any(each) for each in whole.values()):
            continue
        for unit, joints in _by_unit(quantity, first).items():
            name = f"{quantity.name}-{unit}" if len(_by_unit(quantity, first)) > 1 else quantity.name
            largest = max(float(np.abs(each[:, joints]).max()) for each in whole.values())
            plots.append(_plot(quantity, name, scale([largest], unit), joints))
            for key, run in runs.items():
                values[key][name] = packed(place(run.time, whole[key][:, joints]).T)
    return {
        "plots": plots,
        "time": packed(time),
        "values": values,
        "points": time.size,
        "samples": max(run.time.size for run in runs.values()),
    }


def _plot(quantity: Quantity, name: str, shown: tuple[str, float], joints: list[int]) -> dict[str, Any]:
    return {
        "id": name,
        "quantity": quantity.name,
        "title": quantity.title,
        "symbol": quantity.symbol,
        "unit": shown[0],
        "factor": shown[1],
        "joints": joints,
        "magnitude": quantity.magnitude,
        "first": quantity.first,
    }


def _by_unit(quantity: Quantity, recording: Timed) -> dict[str, list[int]]:
    """Indices of the joints by their unit."""
    found: dict[str, list[int]] = {}
    for joint in range(len(recording.joints)):
        found.setdefault(quantity.unit_of(recording, joint), []).append(joint)
    return found


def _parts(lines: int) -> int:
    return int(np.clip(_NUMBERS // (2 * lines), _FEWEST_PARTS, _MOST_PARTS))


def _grid(times: Sequence[Array], parts: int) -> tuple[Array, Callable[[Array, Array], Array]]:
    """A common time axis, and a function that places values of shape (samples, joints) on it.

    Short runs with the same times keep their samples. Otherwise each part of the axis has two points: the smallest and
    the largest value, so that no spike is lost, in the order in which the value moves; nan where a run has no samples.
    """
    first, *others = times
    if first.size <= 2 * parts and all(np.array_equal(first, other) for other in others):
        return first, lambda _, values: values
    begin, end = min(float(time[0]) for time in times), max(float(time[-1]) for time in times)
    width = max((end - begin) / parts, 1e-9)
    axis = np.asarray(begin + width * (np.arange(2 * parts) + 0.5) / 2.0, dtype=np.float64)
    axis[0], axis[-1] = begin, end

    def place(time: Array, values: Array) -> Array:
        part = np.minimum((time - begin) / width, parts - 1).astype(np.intp)
        begins = np.flatnonzero(np.diff(part, prepend=-1))
        low, high = np.minimum.reduceat(values, begins), np.maximum.reduceat(values, begins)
        rises = values[np.append(begins[1:], time.size) - 1] >= values[begins]
        placed = np.full((parts, 2, values.shape[1]), np.nan)
        placed[part[begins], 0] = np.where(rises, low, high)
        placed[part[begins], 1] = np.where(rises, high, low)
        return placed.reshape(2 * parts, -1)

    return axis, place
