"""How compiled code calls the dynamics of a robot by address."""

from functools import cache
from typing import Any

from numba import carray

from pidtsm_core.compiling.addresses import INTEGER, NOTHING, POINTER, ROW, ROWS, Interface
from pidtsm_core.compiling.decorators import callable_inside
from pidtsm_core.robots.base import Dynamics
from pidtsm_core.robots.effort_differences import spread_of_differences

_INVERSE = Interface(NOTHING(POINTER, POINTER, POINTER, INTEGER, INTEGER, POINTER, INTEGER, POINTER))
_FORWARD = Interface(NOTHING(POINTER, POINTER, POINTER, INTEGER, POINTER, INTEGER, POINTER))
_SPREAD = Interface(NOTHING(ROW, ROW, ROW, ROWS, ROW, ROWS))
inverse_at, forward_at, spread_at = _INVERSE.call, _FORWARD.call, _SPREAD.call
"""Called by compiled code with `dynamics_addresses`: the functions are long and have many callers."""


@cache
def _by_pointer(dynamics: Dynamics) -> tuple[Any, Any]:
    """Inverse and forward dynamics that take pointers."""
    inverse, forward = callable_inside(dynamics.inverse_dynamics), callable_inside(dynamics.forward_dynamics)

    def inverse_dynamics(q: Any, dq: Any, ddq: Any, rows: int, joints: int, p: Any, length: int, effort: Any) -> None:
        shape = (rows, joints)
        inverse(carray(q, joints), carray(dq, joints), carray(ddq, shape), carray(p, length), carray(effort, shape))

    def forward_dynamics(q: Any, dq: Any, effort: Any, joints: int, p: Any, length: int, ddq: Any) -> None:
        forward(carray(q, joints), carray(dq, joints), carray(effort, joints), carray(p, length), carray(ddq, joints))

    return inverse_dynamics, forward_dynamics


def dynamics_addresses(dynamics: Dynamics) -> tuple[int, int]:
    """Addresses of inverse and forward dynamics; compiles them."""
    inverse, forward = _by_pointer(dynamics)
    return _INVERSE.address(inverse), _FORWARD.address(forward)


@cache
def spread_address(dynamics: Dynamics) -> int:
    """Address of the effort spread; compiles it."""
    return _SPREAD.address(dynamics.effort_spread or spread_of_differences(callable_inside(dynamics.inverse_dynamics)))
