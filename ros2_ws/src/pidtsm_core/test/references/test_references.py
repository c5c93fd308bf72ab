"""What every reference promises, and the article's by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.parameters import Array, resolve
from pidtsm_core.references import REFERENCES, Reference, ReferenceMotion, extrapolate, reference_schema

PROPERTY = settings(deadline=None, max_examples=60)
EACH = pytest.mark.parametrize("reference", REFERENCES.members, ids=lambda r: r.name)
TIMES = st.floats(0.0, 60.0)


def motion_of(reference: Reference) -> ReferenceMotion:
    return ReferenceMotion(resolve(reference_schema, {"reference.name": reference.name}, reference.joints))


def at(motion: ReferenceMotion, t: float) -> Array:
    desired = np.full((3, motion.joints), np.nan)
    motion.evaluate(t, desired)
    return desired


@EACH
@PROPERTY
@given(t=TIMES)
def test_derivatives_are_exact(reference: Reference, t: float) -> None:
    motion = motion_of(reference)
    assert motion.joints == reference.joints
    step = 1e-4
    before, now, after = (at(motion, t + d) for d in (-step, 0.0, step))
    assert np.isfinite(now).all()
    np.testing.assert_allclose((after[:2] - before[:2]) / (2 * step), now[1:], atol=1e-7)


def continued(desired: Array, dt: float) -> Array:
    later = np.full_like(desired, np.nan)
    extrapolate(desired, dt, later)
    return later


@EACH
@PROPERTY
@given(t=TIMES)
def test_continuing_over_no_time_gives_the_same_bits(reference: Reference, t: float) -> None:
    desired = at(motion_of(reference), t)
    assert continued(desired, 0.0).tobytes() == desired.tobytes()


@EACH
@PROPERTY
@given(t=st.floats(0.1, 30.0), dt=st.floats(-0.05, 0.05))
def test_continuing_over_a_short_time_is_right_to_third_order(reference: Reference, t: float, dt: float) -> None:
    motion = motion_of(reference)
    error = np.abs(continued(at(motion, t), dt) - at(motion, t + dt))
    jerk = max(np.abs(np.diff([at(motion, t + d)[2] for d in (-0.05, 0.0, 0.05)], axis=0)).max() / 0.05, 0.1)
    bound = 2.0 * jerk * np.array([abs(dt) ** 3 / 6, dt**2 / 2, abs(dt)]) + 1e-14
    assert (error.max(axis=1) <= bound).all()


def test_continuing_by_hand() -> None:
    desired = np.array([[1.0, -1.0], [2.0, 0.0], [4.0, 8.0]])
    np.testing.assert_allclose(continued(desired, 0.5), [[2.5, 0.0], [4.0, 4.0], [4.0, 8.0]], rtol=1e-15)


def test_the_article_starts_as_worked_out_by_hand() -> None:
    c, s = 0.2 * math.cos(0.2), math.sin(0.2)
    expected = [[0.2 + c, c - 0.2], [0.1 * s, 0.1 * s], [-0.098 - 0.25 * c, 0.098 - 0.25 * c]]
    np.testing.assert_allclose(at(motion_of(REFERENCES["article"]), 0.0), expected, rtol=1e-14)


def test_the_article_later() -> None:
    t = 10.0
    a, b = 0.2 * math.cos(7.0), 0.2 * math.cos(4.8)
    np.testing.assert_allclose(at(motion_of(REFERENCES["article"]), t)[0], [a + b, b - a], rtol=1e-13)
