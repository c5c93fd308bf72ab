"""What a control law provides."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.family import SLOTS
from pidtsm_core.parameters import Array, Parameter, Value
from pidtsm_core.reaching import Interval

STATE_SLOTS = 3 + SLOTS
"""Numbers a joint that a law may have as state."""

OWN_INTEGERS = 4
"""Integers that a law's compiled functions may read."""

LAW_INTEGERS = OWN_INTEGERS + 1
"""The same, and last the place of these functions, by which compiled code finds them."""

Integers = NDArray[np.int64]
Command = Callable[
    [float, float, float, float, Integers, Array, Array, float], tuple[float, float, float, float, float, float]
]
Advance = Callable[[float, float, float, Integers, Array, Array, Interval], None]


@dataclass(frozen=True)
class Law:
    """A control law of one joint: errors to a commanded acceleration (the robot model turns that into torque).

    Attributes:
        name: how users choose it.
        summary: one sentence with its source.
        parameters: of the group ``law``, given the settings (some laws let the user choose their parts).
        integers: what its compiled functions read as integers, shape (OWN_INTEGERS,).
        pack: parameter values as the compiled functions read them, shape (joints, parameters).
        command: compiled ``(e, de, dde, ddq_d, integers, p, x, dt) -> (a_cmd, a_eq, s, sigma, gain, tau_sw)``;
            errors in rad, rad/s, rad/s^2, x of shape (STATE_SLOTS,), zero at the start, dt the period in s (0 at
            the first sample); a_eq is a_cmd without the switching term.
        advance: compiled ``(e, s, sigma, integers, p, x, interval)``: moves x over the `Interval` with these values
            held.
        uses_model: False where a_cmd and a_eq are not accelerations but torques (N m), for no robot model to change.
    """

    name: str
    summary: str
    parameters: Callable[[Mapping[str, object]], tuple[Parameter, ...]]
    integers: Callable[[Mapping[str, Value]], Integers]
    pack: Callable[[Mapping[str, Value], int], Array]
    command: Command
    advance: Advance
    uses_model: bool = True
