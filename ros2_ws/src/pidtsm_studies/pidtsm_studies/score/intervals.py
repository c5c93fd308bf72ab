"""Intervals of shares, and paired tests of two controllers on the same runs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import bootstrap, norm, permutation_test

from pidtsm_core.arrays import Array

CONFIDENCE = 0.95
"""Confidence of all intervals."""
_RESAMPLES = 2000
_EQUAL = 1e-12
"""Differences of shares below this are rounding."""


class Difference(NamedTuple):
    """How much more a controller scores than another.

    Attributes:
        mean: difference of the scores.
        low, high: its interval.
        p: probability of a difference at least as large if both were equally good.
    """

    mean: float
    low: float
    high: float
    p: float


def of_repeats(shares: Sequence[Array]) -> tuple[float, float]:
    """Interval of a mean share for other seeds and motions.

    Args:
        shares: of each range, what each run reaches from 0 to 1, shape (values, runs). The values are fixed; the runs
            at a value are a sample. So the variance of the mean is that of stratified sampling (W. G. Cochran, Sampling
            Techniques, 1977, section 5.4), with one stratum per value.
    """
    mean = float(np.mean([each.mean() for each in shares]))
    variance = sum(
        float((each.var(axis=1, ddof=1) / each.shape[1]).sum()) / each.shape[0] ** 2
        for each in shares
        if each.shape[1] > 1
    )
    half = float(norm.ppf(0.5 + 0.5 * CONFIDENCE)) * variance**0.5 / len(shares)
    return max(mean - half, 0.0), min(mean + half, 1.0)


def paired(first: Array, second: Array, weights: Array, seed: int = 0) -> Difference:
    """Compare two controllers by the same runs, with the same random numbers.

    The interval is the percentile bootstrap of the runs, p that of the permutation test that exchanges both controllers
    in each run, see SciPy.

    Args:
        first: what each run of the one reaches, from 0 to 1, shape (runs,).
        second: likewise of the other.
        weights: of the runs in the score, with the sum 1, shape (runs,).
        seed: of the resampling.
    """
    gains = first.size * weights * (first - second)
    mean = float(gains.mean())
    if np.ptp(gains) < _EQUAL:
        return Difference(mean, mean, mean, 1.0 if abs(mean) < _EQUAL else 0.0)
    interval = bootstrap(
        (gains,),
        np.mean,
        n_resamples=_RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        random_state=seed,
    ).confidence_interval
    test = permutation_test(
        (gains,),
        lambda x, axis: np.mean(x, axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=_RESAMPLES,
        random_state=seed,
    )
    return Difference(mean, float(interval.low), float(interval.high), float(test.pvalue))
