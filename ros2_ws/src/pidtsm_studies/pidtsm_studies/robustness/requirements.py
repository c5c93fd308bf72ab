"""Scenarios with several imperfections at once, and the limits that a controller has to meet in them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

QUANTITIES = {
    "rmse": "RMSE, relative",
    "eci": "ECI, relative",
    "late_error": "error after 10 s (rad)",
    "torque_variation": "torque variation (N m)",
}
"""Limited quantities: the mean over the seeds (for the error, the largest value) of the worse joint. Relative values
refer to the same controller with ideal hardware."""


@dataclass(frozen=True)
class Requirement:
    """A type of hardware, and the limits that a controller has to meet with it.

    Attributes:
        label: label in tables.
        runs: scenario and overrides of each variant; the worst variant counts.
        limits: upper limits by quantity, see `QUANTITIES`.
        random: whether the seed matters.
    """

    label: str
    runs: tuple[tuple[str, tuple[str, ...]], ...]
    limits: Mapping[str, float]
    random: bool = False


def _limits(*values: float) -> dict[str, float]:
    return dict(zip(QUANTITIES, values, strict=True))


_LIGHT = ("simulator.model_error.mass=-0.25", "simulator.model_error.inertia=-0.25")

REQUIREMENTS = (
    Requirement("17-bit encoder", (("encoder_17", ()),), _limits(1.01, 1.005, 4e-4, 0.05)),
    Requirement("14-bit encoder, 1 ms delay", (("encoder_14_delay", ()),), _limits(1.01, 1.005, 6e-4, 0.12)),
    Requirement("12-bit encoder, 1 ms delay", (("encoder_12_delay", ()),), _limits(1.02, 1.005, 1.5e-3, 0.30)),
    Requirement("noise of 1e-3 rad", (("noise", ()),), _limits(1.02, 1.005, 2e-3, 0.50), random=True),
    Requirement(
        "14-bit encoder, 1 ms delay, 5 % and bursts of 20 lost",
        (("loss", ()),),
        _limits(1.01, 1.005, 1e-3, 0.12),
        random=True,
    ),
    Requirement(
        "14-bit encoder, 1 ms delay, 10 ms lag, arm 25 % heavier or lighter",
        (("hard", ()), ("hard", _LIGHT)),
        _limits(1.10, math.inf, 1e-3, 0.25),
    ),
)
"""In the order of the table."""
