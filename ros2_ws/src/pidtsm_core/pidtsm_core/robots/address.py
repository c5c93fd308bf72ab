"""Dynamics that compiled code calls by their address.

Numba copies each function into the functions that call it, and optimises it again for every caller. The functions of
`tree` are long and have many callers; called by address, they are compiled once.
"""

from typing import Any

from llvmlite import ir
from numba import float64, int64, types
from numba.core.cgutils import unpack_tuple
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined

_POINTER = types.CPointer(float64)
SIGNATURE = types.void(_POINTER, _POINTER, _POINTER, int64, int64, _POINTER, int64, _POINTER)
"""Signature of such a function: q, q', the rows given, their number, joints, p, its length, the rows to be written."""


@intrinsic
def call(_typing: Any, address: Any, values: Any) -> Any:
    """Call the function at `address`, which returns nothing, with a tuple of numbers and contiguous arrays.

    Numbers arrive as they are, also as addresses; arrays as the addresses of their first elements.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds, unpacked = signature.args[1], unpack_tuple(builder, arguments[1])
        passed = [
            make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value
            for kind, value in zip(kinds, unpacked, strict=True)
        ]
        function = ir.FunctionType(ir.VoidType(), [value.type for value in passed])
        builder.call(builder.inttoptr(arguments[0], function.as_pointer()), passed)
        return context.get_dummy_value()

    return types.void(address, values), generate


@inlined
def inverse_at(address: int, q: Array, dq: Array, ddq: Array, p: Array, effort: Array) -> None:
    """See `Dynamics.inverse_dynamics`."""
    call(address, (q, dq, ddq, ddq.shape[0], q.size, p, p.size, effort))


@inlined
def forward_at(address: int, q: Array, dq: Array, effort: Array, p: Array, ddq: Array) -> None:
    """See `Dynamics.forward_dynamics`."""
    call(address, (q, dq, effort, 1, q.size, p, p.size, ddq))
