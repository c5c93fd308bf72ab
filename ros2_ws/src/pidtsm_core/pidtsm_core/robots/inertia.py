"""The inertia matrix of an arm in compiled code, and Cholesky factors of such matrices.

The columns of the inertia matrix are efforts of unit accelerations (Walker and Orin 1982, method 1).
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.robots import Model, inverse_dynamics

_LEAST = 1e-9
"""Least pivot of a factorised matrix, kg m^2."""


@inlined
def write_inertia(model: Model, q: Array, rows: Array, efforts: Array, inertia: Array) -> None:
    """Write the inertia matrix (kg m^2) and, to the first row of `efforts`, the effort that carries the arm (N m).

    Args:
        model: of the arm.
        q: shape (joints,), rad.
        rows: scratch, shape (joints + 1, joints).
        efforts: scratch, likewise.
        inertia: result, shape (joints, joints).
    """
    joints = q.size
    for i in range(joints + 1):
        for j in range(joints):
            rows[i, j] = 1.0 if i == j + 1 else 0.0
    inverse_dynamics(model, q, rows[0], rows, efforts)
    for i in range(joints):
        for j in range(joints):
            inertia[i, j] = 0.5 * (efforts[i + 1, j] + efforts[j + 1, i] - efforts[0, j] - efforts[0, i])


@inlined
def factorise(matrix: Array) -> None:
    """Replace the lower triangle of a symmetric matrix, shape (n, n), by L of its Cholesky factorisation L L'."""
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = math.sqrt(max(value, _LEAST)) if i == j else value / matrix[j, j]


@inlined
def divide(lower: Array, row: Array) -> None:
    """Replace a row r by r L^-T, which is L^-1 r as a column; shape (joints,)."""
    for j in range(row.size):
        value = row[j]
        for m in range(j):
            value -= lower[j, m] * row[m]
        row[j] = value / lower[j, j]


@inlined
def divide_transposed(lower: Array, column: Array) -> None:
    """Replace a column c by L^-T c; shape (joints,)."""
    for i in range(column.size - 1, -1, -1):
        value = column[i]
        for m in range(i + 1, column.size):
            value -= lower[m, i] * column[m]
        column[i] = value / lower[i, i]
