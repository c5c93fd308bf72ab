"""How compiled code calls the law that was chosen."""

import math
from collections.abc import Mapping

import numpy as np
from numba import typeof, types

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import (
    FLOAT,
    INTEGER,
    INTEGERS,
    NOTHING,
    ROW,
    ROWS,
    Interface,
    Pointer,
    lend,
    pointer_to,
    tuple_of,
)
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.base import ArmKernel, ArmSample, Law, LawConfig
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.parameters import Value
from pidtsm_core.robots import NO_TOOL, Model, Tool

_COMMAND = Interface(tuple_of(FLOAT, 6)(FLOAT, FLOAT, FLOAT, FLOAT, INTEGERS, ROW, ROW, FLOAT))
_ADVANCE = Interface(NOTHING(FLOAT, FLOAT, FLOAT, INTEGERS, ROW, ROW, typeof(Interval(0.0, False, 0))))
_MODEL = pointer_to(Model(0, 0, 0, 0, np.zeros(1)))
_ARM = types.NamedTuple((ROWS, ROWS, ROW, ROW, ROW, _MODEL, ROW, INTEGER, ROW, FLOAT), ArmSample)
_COMMAND_ARM = Interface(NOTHING(Pointer(_ARM), ROWS, ROW, ROWS))
_ADVANCE_ARM = Interface(NOTHING(ROWS, ROW, ROW, FLOAT, INTEGER))
_command, _advance = _COMMAND.call, _ADVANCE.call
_command_arm, _advance_arm = _COMMAND_ARM.call, _ADVANCE_ARM.call

_LARGEST = 1e9
"""What a law of the whole arm may demand, and keep, rad/s^2 or N m; far above what any torque limit allows."""


def make_law(law: Law, values: Mapping[str, Value], joints: int, tool: Tool = NO_TOOL) -> LawConfig:
    """The law with these parameters, compiled.

    Args:
        law: the law.
        values: every parameter of the controller.
        joints: number of joints.
        tool: the arm as a tree with its tool; only for a law that needs it.
    """
    integers = law.integers(values)
    kernel = law.kernel(integers)
    command, advance = (_COMMAND_ARM, _ADVANCE_ARM) if isinstance(kernel, ArmKernel) else (_COMMAND, _ADVANCE)
    return LawConfig(
        command=command.address(kernel.command),
        advance=advance.address(kernel.advance),
        of_arm=law.of_arm,
        integers=integers,
        gains=law.pack(values, joints),
        tree=tool.tree,
        tool_row=tool.row,
        tool_point=tool.point,
    )


@njit
def command(
    law: LawConfig, joint: int, e: float, de: float, dde: float, ddq_d: float, x: Array, dt: float
) -> tuple[float, float, float, float, float, float]:
    """(a_cmd, a_eq, s, sigma, gain, tau_sw) of one joint: see `Kernel.command`."""
    return _command(law.command, e, de, dde, ddq_d, law.integers, law.gains[joint], x, dt)


@njit
def advance(law: LawConfig, joint: int, e: float, s: float, sigma: float, x: Array, interval: Interval) -> None:
    """Advance the state of one joint over the interval: see `Kernel.advance`."""
    _advance(law.advance, e, s, sigma, law.integers, law.gains[joint], x, interval)


@njit
def command_arm_unchecked(law: LawConfig, arm: ArmSample, x: Array, demand: Array) -> None:
    """Write what the law demands: see `ArmKernel.command`."""
    for i in range(demand.shape[0]):
        for j in range(demand.shape[1]):
            demand[i, j] = 0.0
    own = ArmSample(
        arm.motion,
        arm.desired,
        arm.effort,
        arm.rejected,
        arm.limits,
        lend(arm.model),
        law.tree,
        law.tool_row,
        law.tool_point,
        arm.dt,
    )
    _command_arm(law.command, lend(own), law.gains, x, demand)


@njit
def command_arm(law: LawConfig, arm: ArmSample, x: Array, demand: Array) -> None:
    """Write what the law demands, see `ArmKernel.command`, within bounds; what is not finite becomes 0."""
    command_arm_unchecked(law, arm, x, demand)
    for i in range(demand.shape[0]):
        for j in range(demand.shape[1]):
            value = demand[i, j]
            demand[i, j] = min(max(value, -_LARGEST), _LARGEST) if math.isfinite(value) else 0.0


@njit
def advance_arm_unchecked(law: LawConfig, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """Advance the memory of a law of the whole arm: see `ArmKernel.advance`."""
    _advance_arm(law.advance, law.gains, x, frozen, dt, adaptation)


@njit
def advance_arm(law: LawConfig, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """Advance the memory of a law of the whole arm: see `ArmKernel.advance`. An absurd one begins afresh."""
    advance_arm_unchecked(law, x, frozen, dt, adaptation)
    absurd = False
    for k in range(x.size):
        absurd = absurd or not abs(x[k]) < _LARGEST
    if absurd:
        for k in range(x.size):
            x[k] = 0.0
