"""Samples of a user's Python function of time."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pidtsm_core.arrays import Array
from pidtsm_core.errors import MemberError


def sample(what: str, function: Callable[[float], ArrayLike], duration: float, period: float) -> tuple[Array, Array]:
    """Times, shape (n,), s, and what a function returns then, shape (n, joints).

    Raises:
        MemberError: there are no two samples, the function returns something else than finite numbers, or not as many
            each time; `what` begins the message.
    """
    if not 0.0 < period <= duration < 1e6:
        raise MemberError(f"{what}: a period of {period:g} s does not fit into a duration of {duration:g} s")
    times = np.arange(round(duration / period) + 1, dtype=np.float64) * period
    rows = [np.atleast_1d(np.asarray(function(float(t)), dtype=np.float64)) for t in times]
    for t, row in zip(times, rows, strict=True):
        if row.shape != rows[0].shape or row.ndim != 1 or not np.isfinite(row).all():
            raise MemberError(
                f"{what} returns {row.tolist()} for t = {t:g} s; it needs one finite number for each joint"
            )
    return times, np.array(rows)
