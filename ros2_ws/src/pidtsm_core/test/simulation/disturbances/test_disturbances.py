"""Properties of every disturbance, and the article's values calculated by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.simulation.disturbances import DISTURBANCES, Disturbance, add_disturbance, make_disturbance

EACH = pytest.mark.parametrize("disturbance", DISTURBANCES.members, ids=lambda d: d.name)


def added(disturbance: Disturbance, q: Array, dq: Array, effort: Array | None = None) -> Array:
    effort = np.zeros(q.size) if effort is None else effort.copy()
    add_disturbance(make_disturbance(disturbance, {}, q.size), 0.0, q, dq, effort)
    return effort


@EACH
@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_disturbance_is_finite_and_adds_to_the_torque(disturbance: Disturbance, seed: int) -> None:
    random = np.random.default_rng(seed)
    n = disturbance.joints or random.integers(1, 8)
    q, dq, effort = random.uniform(-10, 10, (3, n))
    kept = q.copy(), dq.copy()
    alone = added(disturbance, q, dq)
    assert np.isfinite(alone).all()
    np.testing.assert_allclose(added(disturbance, q, dq, effort), effort + alone, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal((q, dq), kept)


def test_none_adds_nothing() -> None:
    effort = np.array([1.0, -2.0, 3.0])
    np.testing.assert_array_equal(added(DISTURBANCES["none"], np.ones(3), np.ones(3), effort), effort)


@pytest.mark.parametrize(
    ("q", "dq", "expected"),
    [
        ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
        ((math.pi / 6, math.pi / 4), (0.0, 0.0), (1.0, -1.8)),
        ((0.0, 0.0), (math.pi / 2, math.pi / 2), (math.pi / 4 + 0.5, 0.65 * math.pi + 1.1)),
        ((-math.pi / 6, -math.pi / 4), (-math.pi / 2, -math.pi / 2), (-1.5 - math.pi / 4, 0.7 - 0.65 * math.pi)),
    ],
)
def test_the_articles_values_by_hand(q: object, dq: object, expected: object) -> None:
    got = added(DISTURBANCES["article"], np.array(q), np.array(dq))
    np.testing.assert_allclose(got, np.array(expected), rtol=1e-14, atol=1e-15)
