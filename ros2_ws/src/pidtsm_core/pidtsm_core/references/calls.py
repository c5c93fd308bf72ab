"""How compiled code calls the reference that was chosen."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import FLOAT, NOTHING, ROWS, Interface
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.references.base import Reference

_EVALUATE = Interface(NOTHING(FLOAT, ROWS, ROWS))
_evaluate = _EVALUATE.call


def reference_address(reference: Reference) -> int:
    """Where `evaluate_reference` finds the reference; compiles it."""
    return _EVALUATE.address(reference.evaluate)


@inlined
def evaluate_reference(address: int, t: float, p: Array, desired: Array) -> None:
    """Write q_d, q_d', q_d'' at t (s): see `Reference.evaluate`; `address` is that of `reference_address`."""
    _evaluate(address, t, p, desired)
