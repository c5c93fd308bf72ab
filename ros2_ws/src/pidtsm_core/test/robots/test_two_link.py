"""The two-link arm against eqs. (48)-(50), written a second time with matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.robots import ROBOTS
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.two_link import TWO_LINK

PAPER, LAGRANGE = 0.0, 1.0
ARTICLE = np.array([0.5, 1.5, 1.0, 0.85, 5.0, 5.0, 9.8, PAPER])
ANGLES = st.floats(-7.0, 7.0)
RATES = st.floats(-20.0, 20.0)
MODELS = st.tuples(*[st.floats(0.1, 10.0)] * 7).map(lambda m: np.array([*m, PAPER]))


def with_form(p: Array, form: float) -> Array:
    return np.array([*p[:-1], form])


def constants(p: Array) -> tuple[float, ...]:
    m1, m2, r1, r2, j1, j2, g, _ = p
    p3 = m2 * r2**2
    return (m1 + m2) * r1**2 + m2 * r2**2 + j1, m2 * r1 * r2, p3, p3 + j2, (m1 + m2) * r1 * g, m2 * r2 * g


def matrices(q: Array, dq: Array, p: Array) -> tuple[Array, Array, Array]:
    """H, C, G: (48), (49) or Lagrange's, (50)."""
    p1, p2, p3, p4, p5, p6 = constants(p)
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    h = np.array([[p1 + 2 * p2 * c2, p3 + p2 * c2], [p3 + p2 * c2, p4]])
    if p[-1] == PAPER:
        c = np.array([[-p2 * s2 * dq[0], -2 * p2 * s2 * dq[0]], [0.0, p2 * s2 * dq[1]]])
    else:  # Christoffel symbols of H.
        c = p2 * s2 * np.array([[-dq[1], -(dq[0] + dq[1])], [dq[0], 0.0]])
    g = np.array([p5 * np.cos(q[0]) + p6 * np.cos(q[0] + q[1]), p6 * np.cos(q[0] + q[1])])
    return h, c, g


def torque(q: object, dq: object, ddq: object, p: Array) -> Array:
    effort = np.zeros((1, 2))
    TWO_LINK.dynamics.inverse_dynamics(np.array(q), np.array(dq), np.array([ddq]), p, effort)
    return effort[0]


@pytest.mark.parametrize("form", [PAPER, LAGRANGE], ids=["paper", "lagrange"])
@settings(deadline=None, max_examples=100)
@given(q=st.tuples(ANGLES, ANGLES), dq=st.tuples(RATES, RATES), ddq=st.tuples(RATES, RATES), p=MODELS)
def test_torque_is_that_of_the_matrices(form: float, q: object, dq: object, ddq: object, p: Array) -> None:
    q, dq, ddq = (np.array(v) for v in (q, dq, ddq))
    for numbers in (with_form(p, form), with_form(ARTICLE, form)):
        h, c, g = matrices(q, dq, numbers)
        effort = torque(q, dq, ddq, numbers)
        scale = np.abs(h) @ np.abs(ddq) + np.abs(c) @ np.abs(dq) + np.abs(g) + 1.0
        np.testing.assert_allclose(effort, h @ ddq + c @ dq + g, rtol=0, atol=1e-12 * scale.max())


@pytest.mark.parametrize(
    ("form", "q", "dq", "ddq", "expected"),
    [
        # Arm stretched out, at rest: p5 + p6 = 19.6 + 12.495 and p6.
        (PAPER, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (32.095, 12.495)),
        # First column of H: p1 + 2 p2 = 8.08375 + 2.55, p3 + p2 = 1.08375 + 1.275.
        (PAPER, (0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (32.095 + 10.63375, 12.495 + 2.35875)),
        # Second column: p3 + p2, p4 = 6.08375.
        (PAPER, (0.0, 0.0), (0.0, 0.0), (0.0, 1.0), (32.095 + 2.35875, 12.495 + 6.08375)),
        # q2 = 90 degrees, q1 = 0: G = (p5, 0); C dq = (-p2 q1'^2 - 2 p2 q1' q2', p2 q2'^2) with q' = (1, 2).
        (PAPER, (0.0, np.pi / 2), (1.0, 2.0), (0.0, 0.0), (19.6 - 5 * 1.275, 4 * 1.275)),
        # Lagrange: (-p2 (2 q1' + q2') q2', p2 q1'^2).
        (LAGRANGE, (0.0, np.pi / 2), (1.0, 2.0), (0.0, 0.0), (19.6 - 8 * 1.275, 1.275)),
    ],
)
def test_values_worked_out_by_hand(form: float, q: object, dq: object, ddq: object, expected: object) -> None:
    effort = torque(q, dq, ddq, with_form(ARTICLE, form))
    np.testing.assert_allclose(effort, np.array(expected), rtol=1e-13, atol=1e-13)


def test_the_defaults_are_those_of_the_article() -> None:
    values = {f"robot.{p.name}": p.default for p in TWO_LINK.parameters}
    np.testing.assert_array_equal(TWO_LINK.pack_model(values), ARTICLE)
    values["robot.coriolis"] = "lagrange"
    np.testing.assert_array_equal(TWO_LINK.pack_model(values), with_form(ARTICLE, LAGRANGE))
    assert TWO_LINK.effort_limit == (100.0, 50.0)
    assert TWO_LINK.initial_position == (0.0, -0.1)
    assert ROBOTS["two_link"] is TWO_LINK


def test_the_payload_adds_to_the_second_mass_only() -> None:
    loaded = TWO_LINK.with_payload(ARTICLE, Payload(0.5))
    np.testing.assert_array_equal(loaded, [0.5, 2.0, 1.0, 0.85, 5.0, 5.0, 9.8, PAPER])


@settings(deadline=None, max_examples=50)
@given(q=st.tuples(ANGLES, ANGLES), dq=st.tuples(RATES, RATES), p=MODELS)
def test_only_the_lagrange_form_has_a_skew_symmetric_passivity_matrix(q: object, dq: object, p: Array) -> None:
    """x' (H' - 2C) x = 0 for x = q', with C q' as the model computes it."""
    q, dq = np.array(q), np.array(dq)
    p = with_form(p, LAGRANGE)
    step = 1e-6
    h_rate = (matrices(q + step * dq, dq, p)[0] - matrices(q - step * dq, dq, p)[0]) / (2 * step)
    rest = np.zeros(2)
    bias, gravity = torque(q, dq, rest, p), torque(q, rest, rest, p)
    scale = np.abs(dq).max() ** 3 * np.abs(p).max() ** 3 + 1.0
    assert abs(dq @ h_rate @ dq - 2 * dq @ (bias - gravity)) < 1e-6 * scale
