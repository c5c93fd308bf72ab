"""Quintic polynomials have the given ends."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.references.polynomials import add_quintic, quintic

MOTION = st.lists(st.floats(-5.0, 5.0), min_size=6, max_size=6).map(lambda v: np.array(v).reshape(3, 2))


def at(coefficients: Array, duration: float, t: float) -> Array:
    motion = np.zeros((3, 2))
    add_quintic(coefficients, duration, t, motion)
    return motion


@settings(deadline=None)
@given(MOTION, MOTION, st.floats(0.1, 10.0))
def test_both_ends_are_met_and_the_derivatives_belong_together(start: Array, end: Array, duration: float) -> None:
    coefficients = np.zeros((6, 2))
    quintic(start, end, duration, coefficients)
    scale = 100.0 * (1.0 + duration + 1.0 / duration) ** 3
    np.testing.assert_allclose(at(coefficients, duration, 0.0), start, atol=1e-13 * scale)
    np.testing.assert_allclose(at(coefficients, duration, duration), end, atol=1e-13 * scale)
    h = 1e-4 * duration
    before, now, after = (at(coefficients, duration, 0.3 * duration + k * h) for k in (-1, 0, 1))
    np.testing.assert_allclose((after[:2] - before[:2]) / (2 * h), now[1:], atol=1e-5 * scale)


def test_from_rest_to_rest_it_is_the_minimum_jerk_motion() -> None:
    coefficients, rest = np.zeros((6, 2)), np.zeros((3, 2))
    goal = rest.copy()
    goal[0] = 1.0
    quintic(rest, goal, 2.0, coefficients)
    np.testing.assert_allclose(coefficients[:, 0], [0, 0, 0, 10, -15, 6])
