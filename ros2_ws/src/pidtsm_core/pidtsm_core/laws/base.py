"""Interface of a control law."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.parameters import Parameter, Value
from pidtsm_core.parameters.family import SLOTS

STATE_SLOTS = 3 + SLOTS
"""Largest number of state variables of a law per joint."""

OWN_INTEGERS = 4
"""Number of integers that a law's compiled functions may read."""

Integers = NDArray[np.int64]
Command = Callable[
    [float, float, float, float, Integers, Array, Array, float], tuple[float, float, float, float, float, float]
]
Advance = Callable[[float, float, float, Integers, Array, Array, Interval], None]


class Kernel(NamedTuple):
    """The functions of a law, compiled.

    Attributes:
        command: ``(e, de, dde, ddq_d, integers, p, x, dt) -> (a_cmd, a_eq, s, sigma, gain, tau_sw)``; the errors are in
            rad, rad/s, rad/s^2; p are the gains of the joint; x has shape (STATE_SLOTS,) and starts at zero; dt is the
            period in s (0 at the first sample); a_eq is a_cmd without the switching term.
        advance: ``(e, s, sigma, integers, p, x, interval)``: advances x over the `Interval` while these values are
            held.
    """

    command: Command
    advance: Advance


class LawConfig(NamedTuple):
    """A law with its parameters, as compiled code reads it."""

    command: int  # address of `Kernel.command`
    advance: int  # address of `Kernel.advance`
    integers: Integers  # shape (OWN_INTEGERS,)
    gains: Array  # as `Law.pack` returns them, shape (joints, parameters)


class LawParts(NamedTuple):
    """Names of what a sliding-mode law consists of."""

    surface: str
    manifold: str
    reaching: str


@dataclass(frozen=True)
class Law:
    """A control law of one joint: from errors to a commanded acceleration, which the robot model converts to torque.

    Attributes:
        name: the name by which users choose it.
        summary: one sentence with its source.
        parameters: the parameters of the group ``law`` for given settings (in some laws, users choose the parts).
        integers: the integers that its compiled functions read, shape (OWN_INTEGERS,).
        pack: the parameter values as the compiled functions read them, shape (joints, parameters).
        kernel: its functions for given `integers`.
        parts: what it consists of, for given settings; None: it has a formula of its own.
        uses_model: False if a_cmd and a_eq are torques (N m), not accelerations; then the robot model is not used.
    """

    name: str
    summary: str
    parameters: Callable[[Mapping[str, object]], tuple[Parameter, ...]]
    integers: Callable[[Mapping[str, Value]], Integers]
    pack: Callable[[Mapping[str, Value], int], Array]
    kernel: Callable[[Integers], Kernel]
    uses_model: bool = True
    parts: Callable[[Mapping[str, object]], LawParts] | None = None
