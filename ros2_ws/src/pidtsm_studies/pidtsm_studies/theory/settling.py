"""How long an error takes to 0 on s = 0 of the dual terminal surface: eq. (47), a bound, and the exact time."""

import math

import numpy as np

_NODES = 200


def printed_time(error: float, k1: float, k2: float, alpha: float) -> float:
    """Eq. (47) as the article prints it, s; nan where it is not defined.

    It is no bound for |error| < 1: (44) is the time from |error| down to 1, which is negative there, and (46) is the
    time from 1, not from |error|, down to 0.

    Args:
        error: where the error begins, rad.
        k1: K1.
        k2: K2, 1/s.
        alpha: exponent.
    """
    square = error * error
    if error == 0.0 or k1 <= 0.0 or k2 <= 0.0:
        return math.nan
    far = math.log((k1 + k2) * square / (k2 + k1 * square)) / (2.0 * k2)
    return far + math.log(k1 / (k1 + k2)) / ((alpha - 1.0) * k2)


def time_bound(error: float, k1: float, k2: float, alpha: float) -> float:
    """An upper bound of the time, s, in closed form: (43) down to 1 and (45) from the smaller of 1 and |error| on.

    Both leave out a term that only helps, so both are slower than (42). Arguments as those of `printed_time`; k2 may
    be 0.
    """
    size = abs(error)
    if k1 <= 0.0:
        return math.inf
    near = min(size, 1.0) ** (1.0 - alpha)
    square = max(size, 1.0) ** 2
    if k2 == 0.0:
        return (1.0 - 1.0 / square) / (2.0 * k1) + near / (k1 * (1.0 - alpha))
    far = math.log((k1 + k2) * square / (k2 + k1 * square)) / (2.0 * k2)
    return far + math.log1p(k2 / k1 * near) / ((1.0 - alpha) * k2)


def exact_time(error: float, k1: float, k2: float, alpha: float) -> float:
    """The time from (42) itself, s, by quadrature; arguments as those of `printed_time`.

    With x = |e|^(1 - alpha) the integrand is smooth at 0.
    """
    if k1 <= 0.0:
        return math.inf
    end = abs(error) ** (1.0 - alpha)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    x = 0.5 * end * (nodes + 1.0)
    rate = k1 * (1.0 + x ** ((3.0 - alpha) / (1.0 - alpha))) + k2 * x
    return float(0.5 * end * np.sum(weights / rate) / (1.0 - alpha))
