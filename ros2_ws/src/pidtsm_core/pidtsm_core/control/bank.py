"""Hypotheses about how late the drives are: what they are, and the memory of what is known of each."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array

BANK_DELAYS = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07)
BANK_LAGS = (0.0, 0.01, 0.02, 0.03, 0.045, 0.06, 0.08)
"""s, of the hypotheses about the drives."""
_LATEST = 0.09
HYPOTHESES = tuple(
    (d, t) for t, lag in enumerate(BANK_LAGS) for d, delay in enumerate(BANK_DELAYS) if delay + lag <= _LATEST + 1e-9
)
"""Place of the delay and of the lag of each hypothesis; the first is that nothing is late."""
POLES, FILTERED = 3, 5
"""Number of low passes that an input passes, and of all filters; what they leave is in the row after them."""
NUISANCES = 5
"""Number of coefficients that explain what is not lateness."""
MOST_UNDER_WAY = 256
"""Number of commands that may be under way."""


class Bank(NamedTuple):
    """Hypotheses about the lateness of the drives, see lateness_learning.py; initially all zero."""

    drives: Array  # what the drives deliver with each lag, shape (len(BANK_LAGS), joints), N m
    efforts: Array  # the same for every command of `under_way`, shape (MOST_UNDER_WAY, len(BANK_LAGS), joints)
    rows: NDArray[np.int64]  # of `efforts`, for each delay, shape (len(BANK_DELAYS),)
    known: Array  # filtered regressors, shape (joints, FILTERED + 1, NUISANCES)
    filters: Array  # filtered efforts that are left by each hypothesis, shape (joints, FILTERED + 1, len(HYPOTHESES))
    normal: Array  # normal equations, shape (joints, NUISANCES, NUISANCES)
    mixed: Array  # their right sides, shape (joints, NUISANCES, len(HYPOTHESES))
    squares: Array  # integrals of the squares, shape (joints, len(HYPOTHESES))
    evidence: Array  # for how long each joint was observed, shape (joints,), s
    left: Array  # logarithm of what is left unexplained, shape (joints, len(HYPOTHESES))
    solved: Array  # scratch, shape (NUISANCES, len(HYPOTHESES))
    factor: Array  # scratch, shape (NUISANCES, NUISANCES)


def new_bank(joints: int) -> Bank:
    """The hypotheses of a controller that has not begun."""
    hypotheses = len(HYPOTHESES)
    return Bank(
        drives=np.zeros((len(BANK_LAGS), joints)),
        efforts=np.zeros((MOST_UNDER_WAY, len(BANK_LAGS), joints)),
        rows=np.zeros(len(BANK_DELAYS), np.int64),
        known=np.zeros((joints, FILTERED + 1, NUISANCES)),
        filters=np.zeros((joints, FILTERED + 1, hypotheses)),
        normal=np.zeros((joints, NUISANCES, NUISANCES)),
        mixed=np.zeros((joints, NUISANCES, hypotheses)),
        squares=np.zeros((joints, hypotheses)),
        evidence=np.zeros(joints),
        left=np.zeros((joints, hypotheses)),
        solved=np.zeros((NUISANCES, hypotheses)),
        factor=np.zeros((NUISANCES, NUISANCES)),
    )
