"""Control laws: from errors to acceleration. One law per file; `LAWS` contains the laws imported here."""

from collections.abc import Mapping
from itertools import chain

import numpy as np
from numba.core.types import none
from numba.core.types.containers import UniTuple

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.parts import FLOAT, INTEGER, ROW, by_index
from pidtsm_core.laws.base import LAW_INTEGERS, OWN_INTEGERS, STATE_SLOTS, Integers, Law
from pidtsm_core.laws.computed_torque import COMPUTED_TORQUE
from pidtsm_core.laws.dtsm import DTSM
from pidtsm_core.laws.pid import PID
from pidtsm_core.laws.piddtsm import PIDDTSM
from pidtsm_core.laws.pidnftsm import PIDNFTSM
from pidtsm_core.laws.reaching import INTERVAL, Interval
from pidtsm_core.laws.sliding_mode import KERNELS, SLIDING_MODE
from pidtsm_core.laws.super_twisting import SUPER_TWISTING
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.family import Family

__all__ = ["LAWS", "LAW_INTEGERS", "STATE_SLOTS", "Integers", "Interval", "Law", "advance", "command", "law_integers"]

LAWS: Family[Law] = Family.of(Law, globals())

_NONE = np.zeros(OWN_INTEGERS, dtype=np.int64)
_KERNELS = list(dict.fromkeys([*(law.kernel(_NONE) for law in LAWS.members), *chain.from_iterable(KERNELS)]))
_INTEGERS = INTEGER[::1]
_command = by_index(
    [command for command, _ in _KERNELS],
    UniTuple(FLOAT, 6)(FLOAT, FLOAT, FLOAT, FLOAT, _INTEGERS, ROW, ROW, FLOAT),
)
_advance = by_index(
    [advance for _, advance in _KERNELS],
    none(FLOAT, FLOAT, FLOAT, _INTEGERS, ROW, ROW, INTERVAL),
)


def law_integers(law: Law, values: Mapping[str, Value]) -> Integers:
    """Integers that `command` and `advance` read, shape (LAW_INTEGERS,): those of the law, then its kernel's index.

    Compiles the law.
    """
    integers = law.integers(values)
    index = _KERNELS.index(law.kernel(integers))
    _command.prepare(index)
    _advance.prepare(index)
    return np.append(integers, index)


@njit
def command(
    e: float, de: float, dde: float, ddq_d: float, integers: Integers, p: Array, x: Array, dt: float
) -> tuple[float, float, float, float, float, float]:
    """(a_cmd, a_eq, s, sigma, gain, tau_sw) of one joint: see `Kernel.command` and `law_integers`."""
    return _command(integers[OWN_INTEGERS], e, de, dde, ddq_d, integers, p, x, dt)


@njit
def advance(e: float, s: float, sigma: float, integers: Integers, p: Array, x: Array, interval: Interval) -> None:
    """Advance the state of one joint over the interval: see `Kernel.advance` and `law_integers`."""
    _advance(integers[OWN_INTEGERS], e, s, sigma, integers, p, x, interval)
