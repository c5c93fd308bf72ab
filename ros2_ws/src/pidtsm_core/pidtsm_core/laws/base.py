"""Interface of a control law: of one joint, or of the whole arm."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.parameters import Parameter, Value
from pidtsm_core.parameters.family import SLOTS
from pidtsm_core.robots import Model

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


class ArmSample(NamedTuple):
    """What a law of the whole arm is told at a sample.

    Attributes:
        motion: estimated q, q', q'', shape (3, joints), rad, rad/s, rad/s^2.
        desired: q_d, q_d', q_d'', likewise.
        effort: that has moved the arm since the last sample, shape (joints,), N m.
        rejected: disturbance that the controller subtracts from the command, shape (joints,), rad/s^2.
        limits: of the effort, shape (joints,), N m.
        model: for `inverse_dynamics`.
        tree: geometry and gravity of the arm, see `robots.tree.layout`, flat; shape (0,) unless `Law.needs_tree`.
        tool_row: row of the tree's link that carries the tool, see `robots.Tool`; -1: not known.
        tool_point: origin of the tool in that link, shape (3,), m.
        dt: time since the last sample, s; 0 at the first one.
    """

    motion: Array
    desired: Array
    effort: Array
    rejected: Array
    limits: Array
    model: Model
    tree: Array
    tool_row: int
    tool_point: Array
    dt: float


class Demand(IntEnum):
    """Rows of what a law of the whole arm demands, per joint."""

    EQUIVALENT_ACCELERATION = 0  # ACCELERATION without the switching term, rad/s^2
    ACCELERATION = 1  # the robot model converts it to an effort, rad/s^2
    EQUIVALENT_EFFORT = 2  # likewise, N m
    EFFORT = 3  # that is added to this one, N m
    SLIDING_VARIABLE = 4
    MANIFOLD_VARIABLE = 5
    ADAPTIVE_GAIN = 6
    SWITCHING_TERM = 7


ArmCommand = Callable[[ArmSample, Array, Array, Array], None]
ArmAdvance = Callable[[Array, Array, Array, float, int], None]


class ArmKernel(NamedTuple):
    """The functions of a law of the whole arm, compiled.

    Attributes:
        command: ``(arm, p, x, demand)``: p are the gains, shape (joints, SLOTS); x is the law's memory, flat, which
            starts at zero; writes to demand, shape (len(Demand), joints), which is zero before. It may be called
            twice in a sample, so it changes nothing in x that it also reads.
        advance: ``(p, x, frozen, dt, adaptation)``: advances x over dt (s), as what was commanded last is held;
            frozen, shape (joints,), is 1 for a joint whose effort was not the law's, so that nothing may wind up, else
            0; for adaptation see `Adaptation`.
    """

    command: ArmCommand
    advance: ArmAdvance


class LawConfig(NamedTuple):
    """A law with its parameters, as compiled code reads it."""

    command: int  # address of the kernel's function
    advance: int  # likewise
    of_arm: bool  # whether it is an `ArmKernel`
    integers: Integers  # shape (OWN_INTEGERS,)
    gains: Array  # as `Law.pack` returns them, shape (joints, parameters)
    tree: Array  # see `ArmSample`
    tool_row: int  # likewise
    tool_point: Array  # likewise


class LawParts(NamedTuple):
    """Names of what a sliding-mode law consists of."""

    surface: str
    manifold: str
    reaching: str


@dataclass(frozen=True)
class Law:
    """A control law: from errors to a commanded acceleration, which the robot model converts to torque.

    It is the law of one joint, and every joint has it; or it has a `memory`, and is a law of the whole arm.

    Attributes:
        name: the name by which users choose it.
        summary: one sentence with its source.
        parameters: the parameters of the group ``law`` for given settings (in some laws, users choose the parts).
        integers: the integers that its compiled functions read, shape (OWN_INTEGERS,).
        pack: the parameter values as the compiled functions read them, shape (joints, parameters).
        kernel: its functions for given `integers`.
        parts: what it consists of, for given settings; None: it has a formula of its own.
        uses_model: False if a_cmd and a_eq are torques (N m), not accelerations; then the robot model is not used.
        memory: of a law of the whole arm: how many numbers it keeps, for this number of joints.
        needs_tree: whether such a law needs `ArmSample.tree` and the tool.
    """

    name: str
    summary: str
    parameters: Callable[[Mapping[str, object]], tuple[Parameter, ...]]
    integers: Callable[[Mapping[str, Value]], Integers]
    pack: Callable[[Mapping[str, Value], int], Array]
    kernel: Callable[[Integers], Kernel | ArmKernel]
    uses_model: bool = True
    parts: Callable[[Mapping[str, object]], LawParts] | None = None
    memory: Callable[[int], int] | None = None
    needs_tree: bool = False

    @property
    def of_arm(self) -> bool:
        """Whether it is a law of the whole arm."""
        return self.memory is not None

    @property
    def softens(self) -> bool:
        """Whether it can follow in a slower time, see softening.py: its gains must not be known for that."""
        return self.uses_model and not self.of_arm
