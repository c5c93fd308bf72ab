"""Exact extrema of piecewise polynomials, by the convex hull of their Bernstein coefficients.

A polynomial on [0, 1] lies within its Bernstein coefficients, and touches the first and the last one. Halving the
interval brings them together quadratically (Farin, Curves and Surfaces for CAGD, 2002, ch. 5).
"""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine

DEPTH = 64
"""Rows of the scratch space: intervals that wait, shape (DEPTH, 8): six coefficients, begin and width."""
_EXACT = 1e-10
"""Largest error of an extremum, in its own unit."""


@subroutine
def bernstein(powers: Array, sign: float, coefficients: Array) -> float:
    """Write the Bernstein coefficients of `sign` times a polynomial, shape (6,), of the powers 0 to 5, shape (6,).

    Returns:
        The largest of them, an upper bound of the polynomial on [0, 1].
    """
    largest = -1e300
    for i in range(6):
        total, weight = 0.0, 1.0
        for j in range(i + 1):
            total += weight * powers[j]
            weight *= (i - j) / (5.0 - j) if j < 5 else 0.0
        coefficients[i] = sign * total
        largest = max(largest, coefficients[i])
    return largest


@subroutine
def maximum(powers: Array, sign: float, above: float, scratch: Array) -> tuple[float, float]:
    """The maximum of `sign` times a polynomial on [0, 1], and where it is; `above` and -1 if it does not exceed that.

    Args:
        powers: coefficients of the powers 0 to 5, shape (6,).
        sign: 1 or -1.
        above: maxima up to this do not matter.
        scratch: shape (DEPTH, 8).
    """
    best, place = above, -1.0
    if bernstein(powers, sign, scratch[0]) <= above:
        return best, place
    scratch[0, 6], scratch[0, 7] = 0.0, 1.0
    waiting = 1
    while waiting > 0:
        waiting -= 1
        left = scratch[waiting]
        begin, width = left[6], left[7]
        hull = left[0]
        for i in range(1, 6):
            hull = max(hull, left[i])
        if left[0] > best:
            best, place = left[0], begin
        if left[5] > best:
            best, place = left[5], begin + width
        if hull <= best + _EXACT or waiting + 2 > DEPTH:
            continue
        right = scratch[waiting + 1]
        # De Casteljau's algorithm at the middle.
        for i in range(6):
            right[5 - i] = left[5]
            for j in range(5, i, -1):
                left[j] = 0.5 * (left[j - 1] + left[j])
        left[6], left[7] = begin, 0.5 * width
        right[6], right[7] = begin + 0.5 * width, 0.5 * width
        waiting += 2
    return best, place
