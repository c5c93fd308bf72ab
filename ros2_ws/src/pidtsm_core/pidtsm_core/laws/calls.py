"""How compiled code calls the law that was chosen."""

from collections.abc import Mapping

from numba import typeof

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import FLOAT, INTEGERS, NOTHING, ROW, Interface, tuple_of
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.base import Law, LawConfig
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.parameters import Value

_COMMAND = Interface(tuple_of(FLOAT, 6)(FLOAT, FLOAT, FLOAT, FLOAT, INTEGERS, ROW, ROW, FLOAT))
_ADVANCE = Interface(NOTHING(FLOAT, FLOAT, FLOAT, INTEGERS, ROW, ROW, typeof(Interval(0.0, False, 0))))
_command, _advance = _COMMAND.call, _ADVANCE.call


def make_law(law: Law, values: Mapping[str, Value], joints: int) -> LawConfig:
    """The law with these parameters, compiled."""
    integers = law.integers(values)
    kernel = law.kernel(integers)
    return LawConfig(
        command=_COMMAND.address(kernel.command),
        advance=_ADVANCE.address(kernel.advance),
        integers=integers,
        gains=law.pack(values, joints),
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
