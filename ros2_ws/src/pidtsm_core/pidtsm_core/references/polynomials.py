"""Quintic polynomials between two states of motion."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit


@njit
def quintic(start: Array, end: Array, duration: float, coefficients: Array) -> None:
    """Compute the quintic in t / duration with the given ends; from rest to rest, it has minimum jerk.

    Args:
        start: position, velocity, acceleration at 0, shape (3, joints).
        end: the same at `duration`.
        duration: s, positive.
        coefficients: result, shape (6, joints), of the powers 0 to 5.
    """
    for j in range(start.shape[1]):
        a, b = start[1, j] * duration, end[1, j] * duration
        c, d = 0.5 * start[2, j] * duration * duration, 0.5 * end[2, j] * duration * duration
        h = end[0, j] - start[0, j]
        coefficients[0, j] = start[0, j]
        coefficients[1, j] = a
        coefficients[2, j] = c
        coefficients[3, j] = 10.0 * h - 6.0 * a - 4.0 * b - 3.0 * c + d
        coefficients[4, j] = -15.0 * h + 8.0 * a + 7.0 * b + 3.0 * c - 2.0 * d
        coefficients[5, j] = 6.0 * h - 3.0 * a - 3.0 * b - c + d


@njit
def add_quintic(coefficients: Array, duration: float, t: float, motion: Array) -> None:
    """Add position, velocity and acceleration at t (s, within 0 and `duration`) to `motion`, shape (3, joints)."""
    x = t / duration
    for j in range(motion.shape[1]):
        c0, c1, c2 = coefficients[0, j], coefficients[1, j], coefficients[2, j]
        c3, c4, c5 = coefficients[3, j], coefficients[4, j], coefficients[5, j]
        motion[0, j] += c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5))))
        motion[1, j] += (c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / duration
        motion[2, j] += (2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / (duration * duration)
