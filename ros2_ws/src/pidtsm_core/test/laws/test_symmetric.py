"""Jacobi's method against LAPACK."""

import numpy as np
import pytest

from pidtsm_core.laws.symmetric import diagonalise


@pytest.mark.parametrize("kind", ["random", "diagonal", "of rank one", "nearly equal eigenvalues"])
@pytest.mark.parametrize("size", [1, 2, 7])
def test_it_finds_the_eigenvalues_and_a_rotation(size: int, kind: str) -> None:
    random = np.random.default_rng(size)
    factor = random.normal(size=(size, size))
    matrix = {
        "random": factor @ factor.T,
        "diagonal": np.diag(random.uniform(1e-6, 1e3, size)),
        "of rank one": np.outer(factor[0], factor[0]),
        "nearly equal eigenvalues": np.eye(size) + 1e-9 * (factor + factor.T),
    }[kind]
    turned, rotation = matrix.copy(), np.empty_like(matrix)
    diagonalise(turned, rotation)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(size), rtol=0, atol=1e-13)
    np.testing.assert_allclose(rotation.T @ matrix @ rotation, turned, rtol=0, atol=1e-12 * np.abs(matrix).max())
    expected = np.linalg.eigvalsh(matrix)
    np.testing.assert_allclose(np.sort(np.diag(turned)), expected, rtol=1e-12, atol=1e-12 * np.abs(matrix).max())
