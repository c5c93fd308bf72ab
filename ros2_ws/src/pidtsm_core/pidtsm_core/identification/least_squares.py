"""Weighted least squares of base parameters, with intervals that hold for coloured noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular
from scipy.signal import lfilter
from scipy.stats import t as student

from pidtsm_core.arrays import Array
from pidtsm_core.identification.base_parameters import BaseParameters
from pidtsm_core.identification.measurement import Measurement, Motion, Piece, filtered
from pidtsm_core.identification.regressor import regressor
from pidtsm_core.robots.tree.unit_forces import LINK

_ORDER = 3
"""Of the autoregressive model of the noise of each joint. With more, the model follows what the estimates absorb, too,
and intervals become too narrow; with fewer, it misses the low-pass."""
_MEMORY = 0.9
"""Largest share of the noise that is left after one sample. What lasts longer is no noise but what the model lacks; as
noise, it would excuse errors of gravity and friction, which last as long, and the estimates would drift away."""
_ROUNDS = 3
"""Repetitions with better known noise and delay; the estimates change by less than a hundredth of their intervals."""
_EXACT = 1e-3
"""Least noise, as a share of the effort: no sensor of efforts and no model is better."""
_WEAK = 10.0
"""How much more uncertain than assumed the description is taken to be, so that it does not compete with data."""
_LONGEST_DELAY = 0.1
"""Standard deviation of the delay before anything is known, s."""
_FEWEST = 10 * _ORDER
"""Smallest number of usable samples."""
CONFIDENCE = 0.95
"""Of all intervals."""


class Expectation(NamedTuple):
    """Base parameters by the description alone, and their standard deviations, shape (base,)."""

    beta: Array
    deviation: Array


@dataclass(frozen=True)
class Fit:
    """Estimated base parameters.

    Attributes:
        beta: estimates, shape (base,).
        factor: triangular R with covariance (R'R)^-1, shape (base, base).
        delay: time by which the stamps of efforts are later than the motion they cause, s.
        delay_deviation: its standard deviation, s.
        residual: of the efforts, root mean square, shape (joints,), N m or N, in the bandwidth.
        freedom: degrees of freedom of the intervals.
        condition: condition number of the weighted regressor with columns of equal length.
    """

    beta: Array
    factor: Array
    delay: float
    delay_deviation: float
    residual: Array
    freedom: int
    condition: float

    @property
    def deviation(self) -> Array:
        """Standard deviations of `beta`, shape (base,)."""
        inverse = solve_triangular(self.factor, np.eye(self.beta.size))
        return np.asarray(np.linalg.norm(inverse, axis=1))

    @property
    def half_interval(self) -> Array:
        """Half the width of the intervals of `beta` that contain the truth with `CONFIDENCE`, shape (base,)."""
        return np.asarray(student.ppf(0.5 + 0.5 * CONFIDENCE, self.freedom) * self.deviation)


def motion_regressor(tree: Array, motion: Motion) -> Array:
    """The regressor of all parameters at the samples of a motion, shape (samples, joints, 14 joints)."""
    full = regressor(tree, motion.position, motion.velocity, motion.acceleration)
    joints = motion.position.shape[1]
    each = np.arange(joints)
    full[:, each, (LINK + 2) * joints + each] = motion.coulomb
    return full


def fit(
    tree: Array,
    base: BaseParameters,
    measurements: Sequence[Measurement],
    cutoff: float,
    expected: Expectation,
    known: Array | None = None,
) -> Fit:
    """Estimate base parameters and delay.

    Generalised least squares: the noise of each joint is autoregressive, and what it is follows from the residuals
    (Cochrane and Orcutt, J. American Statistical Association 44, 1949). The delay is estimated along with the
    parameters, as the factor of the derivative of the efforts.

    Args:
        tree: geometry, see `tree.layout`, shape (size(joints),).
        base: base parameters of the arm.
        measurements: with the joints of the arm in its order.
        cutoff: bandwidth, Hz.
        expected: what the description says, which counts where the data say nothing.
        known: parameters pi of what is known, to which `base` adds something, shape (14 joints,); None: nothing is.

    Raises:
        ValueError: there are too few usable samples.
    """
    joints = len(measurements[0].joints)
    pieces = _usable(measurements, cutoff)
    full = [[motion_regressor(tree, m) for m in (piece.motion, piece.slow)] for piece in pieces]
    matrices = [[matrix[..., base.columns] for matrix in both] for both in full]
    explained = [fast @ known if known is not None else 0.0 for fast, _ in full]
    colours, scales, delay, count = np.zeros((joints, _ORDER)), np.ones(joints), 0.0, base.columns.size + 1
    least = _EXACT * _size([piece.motion.effort for piece in pieces], pieces)
    for done in range(1 + _ROUNDS):
        tables = [_table(*each) for each in zip(pieces, matrices, explained, strict=True)]
        rows, instruments, targets = np.split(_whitened(tables, pieces, colours, scales), [count, 2 * count], axis=1)
        triangle, solution = _solve(rows, targets[:, 0], instruments, expected)
        residuals = [table[..., -1] - table[..., :count] @ solution for table in tables]
        delay -= float(solution[-1])
        if done < _ROUNDS:
            # Before the size of the noise is known, the covariance is not either.
            spread = solve_triangular(triangle, np.eye(count)) if done else np.zeros((count, 0))
            errors = [
                np.concatenate([residual[..., np.newaxis], table[..., :count] @ spread], axis=2)
                for residual, table in zip(residuals, tables, strict=True)
            ]
            colours, scales = _noise(errors, pieces, least)
            pieces = [piece for each in measurements for piece in filtered(each, cutoff, delay)]
    inverse = solve_triangular(triangle, np.eye(count))
    # Of the base parameters alone: with the delay, which is the last one, as the first column, the other rows of the
    # triangle are free of it. No matrix is inverted or squared, so poor data make wide intervals and no error.
    factor = qr(np.roll(triangle, 1, axis=1), mode="r")[0][1:, 1:]
    return Fit(
        beta=solution[:-1],
        factor=factor,
        delay=delay,
        delay_deviation=float(np.linalg.norm(inverse[-1])),
        residual=_size(residuals, pieces),
        freedom=max(1, len(targets) - joints * _ORDER - count),
        condition=_condition(rows[:, :-1]),
    )


def _usable(measurements: Sequence[Measurement], cutoff: float) -> list[Piece]:
    """The filtered pieces of the measurements.

    Raises:
        ValueError: there are too few usable samples.
    """
    pieces = [piece for each in measurements for piece in filtered(each, cutoff)]
    if not pieces:
        raise ValueError("no part of the recording is long enough")
    if (most := max(np.sum([np.count_nonzero(_used(piece), axis=0) for piece in pieces], axis=0))) < _FEWEST:
        raise ValueError(f"too few samples in which a joint moves and its torque is below its limit: {most}")
    return pieces


def _table(piece: Piece, matrices: Sequence[Array], explained: Array | float) -> Array:
    """The columns of a piece side by side: rows of the system, instruments, targets.

    effort(t + delay) = Y beta + (delay - true delay) effort'(t), with the difference of delays as the last parameter.
    """
    fast, slow = matrices
    effort = piece.motion.effort - explained
    return np.dstack([fast, piece.motion.effort_rate, slow, piece.slow.effort_rate, effort])


def _solve(rows: Array, targets: Array, instruments: Array, expected: Expectation) -> tuple[Array, Array]:
    """Solve Z'(rows x - targets) = 0 with the instruments Z, together with what is expected.

    Returns:
        A triangle R such that (R'R)^-1 is the covariance of x if the errors of the targets are white and of size 1;
        and x.
    """
    basis, _ = qr(instruments, mode="economic")
    weights = 1.0 / np.array([*(_WEAK * expected.deviation), _LONGEST_DELAY])
    system = np.vstack([basis.T @ rows, np.diag(weights)])
    values = np.concatenate([basis.T @ targets, weights * np.array([*expected.beta, 0.0])])
    rotation, triangle = qr(system, mode="economic")
    return triangle, solve_triangular(triangle, rotation.T @ values)


def _size(residuals: Sequence[Array], pieces: Sequence[Piece]) -> Array:
    """Root mean square of the residuals of each joint where they are usable; 0 where none is."""
    usable = np.concatenate([piece.usable for piece in pieces])
    total = np.sum(np.concatenate(residuals) ** 2, axis=0, where=usable)
    return np.asarray(np.sqrt(total / np.maximum(np.count_nonzero(usable, axis=0), 1)))


def _condition(rows: Array) -> float:
    """Condition number with columns of equal length; those without effect do not count."""
    size = np.linalg.norm(rows, axis=0)
    return float(np.linalg.cond(rows[:, size > 0.0] / size[size > 0.0]))


def _whitened(tables: Sequence[Array], pieces: Sequence[Piece], colours: Array, scales: Array) -> Array:
    """Rows in which the noise is white and of size 1, where they are usable, from tables (samples, joints, columns)."""
    rows = []
    for table, piece in zip(tables, pieces, strict=True):
        used = _used(piece)
        for j, (colour, scale) in enumerate(zip(colours, scales, strict=True)):
            taps = np.array([1.0, *(-colour)]) / scale
            rows.append(lfilter(taps, 1.0, table[:, j], axis=0)[used[:, j]])
    return np.concatenate(rows)


def _used(piece: Piece) -> NDArray[np.bool_]:
    """Samples of each joint which the model of the noise can follow: it and those before it are usable."""
    used = piece.usable.copy()
    used[:_ORDER] = False
    for lag in range(1, _ORDER + 1):
        used[lag:] &= piece.usable[:-lag]
    return used


def _noise(errors: Sequence[Array], pieces: Sequence[Piece], least: Array) -> tuple[Array, Array]:
    """Autoregressive coefficients of the noise, shape (joints, order), and the size of what drives it, (joints,).

    Residuals alone lack what the estimates have absorbed, mostly at the low frequencies of the motion, and intervals
    would be too narrow. So the noise is what is expected of it (Dempster, Laird and Rubin, J. Royal Statistical Society
    B 39, 1977): `errors`, of shape (samples, joints, 1 + columns), has the residuals, and then the rows times a root of
    the covariance of the estimates. Residuals below `least`, shape (joints,), are errors of the filter: small, and not
    known otherwise.
    """
    joints = errors[0].shape[1]
    colours, scales = np.zeros((joints, _ORDER)), np.ones(joints)
    used = [_used(piece)[_ORDER:] for piece in pieces]
    for j in range(joints):
        columns = [values[:, j] for values in errors]
        past = np.concatenate([_lagged(values)[u[:, j]] for values, u in zip(columns, used, strict=True)])
        now = np.concatenate([values[_ORDER:][u[:, j]] for values, u in zip(columns, used, strict=True)])
        if len(now) <= _ORDER:
            continue
        colours[j] = _bounded(np.linalg.lstsq(past.reshape(-1, _ORDER), now.ravel(), rcond=None)[0])
        scales[j] = np.sqrt(np.sum((now - past @ colours[j]) ** 2) / (len(now) - _ORDER))
    exact = _size([values[..., 0] for values in errors], pieces) < least
    colours[exact], scales[exact] = 0.0, least[exact]
    return colours, np.maximum(scales, 1e-12)


def _bounded(colour: Array) -> Array:
    """Autoregressive coefficients whose poles have moved into the circle with radius `_MEMORY`, shape (order,)."""
    largest = np.abs(np.roots([1.0, *(-colour)])).max(initial=0.0)
    return colour * min(1.0, _MEMORY / max(largest, _MEMORY)) ** np.arange(1, _ORDER + 1)


def _lagged(values: Array) -> Array:
    """At [..., k] the values k + 1 samples earlier, shape (samples - order, columns, order)."""
    return np.stack([values[_ORDER - k - 1 : len(values) - k - 1] for k in range(_ORDER)], axis=-1)
