"""Single imperfections of the hardware, and the tested values."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

CASE = "case1"
"""The default scenario of the study."""


@dataclass(frozen=True)
class Imperfection:
    """One imperfection of the hardware.

    Attributes:
        name: name in results and of the figure's files.
        description: label of the axis, without unit.
        unit: unit of the values; empty for a number.
        parameters: parameters of the simulator that are set to the value.
        values: tested values, the mildest first.
        random: whether the seed matters.
        logarithmic: whether the axis of the values is logarithmic.
        fixed: other parameters of the simulator, the same for every value.
    """

    name: str
    description: str
    unit: str
    parameters: tuple[str, ...]
    values: tuple[float, ...]
    random: bool = False
    logarithmic: bool = False
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Label of the axis."""
        return f"{self.description} ({self.unit})" if self.unit else self.description

    def settings(self, value: float) -> dict[str, float]:
        """Parameters of the simulator at this value."""
        return {**self.fixed, **dict.fromkeys(self.parameters, value)}


def _evenly(first: float, last: float, count: int = 20) -> tuple[float, ...]:
    return tuple(float(f"{value:.3g}") for value in np.linspace(first, last, count))


def _by_decades(first: float, last: float, count: int = 20) -> tuple[float, ...]:
    return tuple(float(f"{value:.2g}") for value in np.geomspace(first, last, count))


_MODEL = ("model_error.mass", "model_error.inertia")

IMPERFECTIONS = (
    Imperfection("encoder", "resolution of the encoders", "bits", ("encoder.bits",), tuple(range(26, 6, -1))),
    Imperfection(
        "noise",
        "noise of the position, standard deviation",
        "rad",
        ("noise.std",),
        _by_decades(1e-6, 3e-2),
        random=True,
        logarithmic=True,
    ),
    Imperfection("delay", "delay of the measurements", "ms", ("delay.samples",), (*range(10), *range(10, 60, 5))),
    Imperfection("dropout", "measurements lost", "share", ("dropout.probability",), _evenly(0.0, 0.95), random=True),
    Imperfection(
        "burst",
        "measurements lost in a row, about once per second",
        "",
        ("dropout.burst",),
        (1, 2, 3, 5, 7, 10, 15, 20, 25, 30, 40, 50, 60, 70, 80, 100, 120, 150, 200, 300),
        random=True,
        logarithmic=True,
        fixed={"dropout.burst_rate": 1.0},
    ),
    Imperfection("lag", "time constant of the drives", "s", ("actuator.lag",), _evenly(0.0, 0.095)),
    Imperfection("heavier", "masses and inertias above the model's", "share", _MODEL, _evenly(0.0, 1.9)),
    Imperfection("lighter", "masses and inertias below the model's", "share", _MODEL, _evenly(0.0, -0.95)),
    Imperfection(
        "payload", "payload picked up at 5 s", "kg", ("payload.mass",), _evenly(0.0, 3.8), fixed={"payload.time": 5.0}
    ),
    Imperfection("friction", "Coulomb friction", "N m", ("friction.coulomb",), _evenly(0.0, 19.0)),
)
"""In the order of tables and figures."""
