"""Whether a reference from outside can be used."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.trial import check_finite, compiles
from pidtsm_core.errors import MemberError
from pidtsm_core.parameters.family import check_parameters
from pidtsm_core.references.base import Reference
from pidtsm_core.references.calls import evaluate_reference, reference_address

_JOINTS = 3
"""Of a reference for any number of joints."""
_STEP = 1e-5  # s
_EXACT = 1e-3
_ORDERS = ("q", "q'", "q''")


def try_member(reference: Reference) -> None:
    """Compile a reference with its default parameters, and compare its derivatives with differences.

    Raises:
        MemberError: its parameters do not fit, it does not compile, it returns what is not finite, or its derivatives
            are not those of its position.
    """
    what = f"reference {reference.name}"
    check_parameters(what, reference.parameters)
    joints = reference.joints or _JOINTS
    values = {f"reference.{each.name}": each.default for each in reference.parameters}
    packed = reference.pack({**values, "joints": tuple(f"joint{j + 1}" for j in range(joints))}, "reference", joints)
    p = np.ascontiguousarray(packed, np.float64)
    with compiles(what):
        address = reference_address(reference)
    for t in (0.0, 0.3137, 1.7321, 12.3457):  # Not when a motion is likely to end.
        before, here, after = (_evaluated(address, t + step, p, joints) for step in (-_STEP, 0.0, _STEP))
        check_finite(what, here, f"t = {t:g} s")
        if t == 0.0:
            continue  # A motion may begin then.
        rates = (after - before) / (2.0 * _STEP)
        for order in (1, 2):
            wrong = np.abs(here[order] - rates[order - 1]) > _EXACT * (
                np.abs(here[order]) + np.abs(rates[order - 1]) + 1.0
            )
            if wrong.any():
                j = int(np.argmax(wrong))
                raise MemberError(
                    f"{what}: {_ORDERS[order]} of joint {j + 1} is {here[order, j]:.6g} at t = {t:g} s, but the "
                    f"derivative of its {_ORDERS[order - 1]} is {rates[order - 1, j]:.6g}"
                )


def _evaluated(address: int, t: float, p: Array, joints: int) -> Array:
    """q, q', q'' at t (s), shape (3, joints)."""
    desired = np.zeros((3, joints))
    evaluate_reference(address, t, p, desired)
    return desired
