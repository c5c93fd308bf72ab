"""Eigenvalues of small symmetric matrices in compiled code, by Jacobi's method.

Golub and Van Loan, Matrix Computations, 2013, section 8.5.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined

_SWEEPS = 12
"""Each squares what is left off the diagonal, relative to it; six are enough for seven rows."""
_SMALL = 1e-28
"""Sum of squares off the diagonal, relative to that on it, which is left."""


@inlined
def _rotate(a: Array, v: Array, i: int, j: int) -> None:
    """Make a[i, j] zero."""
    if a[i, j] == 0.0:
        return
    ratio = 0.5 * (a[j, j] - a[i, i]) / a[i, j]
    t = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(a.shape[0]):
        a[k, i], a[k, j] = c * a[k, i] - s * a[k, j], s * a[k, i] + c * a[k, j]
    for k in range(a.shape[0]):
        a[i, k], a[j, k] = c * a[i, k] - s * a[j, k], s * a[i, k] + c * a[j, k]
        v[k, i], v[k, j] = c * v[k, i] - s * v[k, j], s * v[k, i] + c * v[k, j]


@inlined
def diagonalise(a: Array, v: Array) -> None:
    """Replace a symmetric matrix by V' a V, whose diagonal has the eigenvalues, and write V, shape (n, n) each."""
    n = a.shape[0]
    for i in range(n):
        for j in range(n):
            v[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        on, off = 0.0, 0.0
        for i in range(n):
            on += a[i, i] * a[i, i]
            for j in range(i + 1, n):
                off += a[i, j] * a[i, j]
        if not off > _SMALL * on:
            return
        for i in range(n):
            for j in range(i + 1, n):
                _rotate(a, v, i, j)
