"""Properties of every sliding surface, for the last joint of each arm."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.surfaces import SURFACES, Surface
from pidtsm_core.parameters import Value, as_float

PROPERTY = settings(deadline=None, max_examples=25)
EACH = pytest.mark.parametrize("surface", SURFACES.members, ids=lambda s: s.name)
AWAY_FROM_ZERO = st.floats(0.1, 2.0) | st.floats(-2.0, -0.1)
ANYTHING = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -0.0, 5e-324, -5e-324, 1e-200, -1e-200, 1e-16, 1e6, -1e6])


def packed(surface: Surface, arm: Arm, **changes: float) -> Array:
    """Gains of the last joint; the others have other ones."""
    values: dict[str, Value] = {}
    for parameter in surface.parameters:
        value = changes.get(parameter.name, as_float(parameter.default))
        values[f"law.{parameter.name}"] = arm.last(value) if parameter.per_joint else value
    return surface.pack(values, "law", arm.joints)[-1]


EVALUATE = {surface.name: njit(surface.evaluate) for surface in SURFACES.members}


def evaluate(surface: Surface, e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    return EVALUATE[surface.name](e, de, integral, p)


@EACH
@PROPERTY
@given(e=AWAY_FROM_ZERO, de=AWAY_FROM_ZERO, dde=st.floats(-10.0, 10.0), integral=st.floats(-2.0, 2.0))
def test_g_and_h_give_the_derivative_of_s(
    arm: Arm, surface: Surface, e: float, de: float, dde: float, integral: float
) -> None:
    p = packed(surface, arm, u_s=1e9)  # With a low limit, h would not be the derivative.

    def s_at(t: float) -> float:
        return evaluate(
            surface,
            e + t * (de + t * dde / 2),
            de + t * dde,
            integral + t * (e + t * (de / 2 + t * dde / 6)),
            p,
        )[0]

    step = 1e-5
    _, g, h = evaluate(surface, e, de, integral, p)
    scale = abs(g * dde) + abs(h) + 1.0
    assert (s_at(step) - s_at(-step)) / (2 * step) == pytest.approx(g * dde + h, abs=1e-6 * scale)


@EACH
@PROPERTY
@given(e=ANYTHING, de=ANYTHING, integral=ANYTHING)
def test_opposite_errors_give_opposite_values(arm: Arm, surface: Surface, e: float, de: float, integral: float) -> None:
    p = packed(surface, arm)
    s, g, h = evaluate(surface, e, de, integral, p)
    assert evaluate(surface, -e, -de, -integral, p) == (-s, g, -h)


@EACH
@PROPERTY
@given(e=ANYTHING, de=ANYTHING, integral=ANYTHING)
def test_values_are_finite_and_g_is_not_negative(
    arm: Arm, surface: Surface, e: float, de: float, integral: float
) -> None:
    s, g, h = evaluate(surface, e, de, integral, packed(surface, arm))
    assert math.isfinite(s)
    assert math.isfinite(g)
    assert math.isfinite(h)
    assert g >= 0.0


@EACH
def test_no_error_is_on_the_surface(arm: Arm, surface: Surface) -> None:
    s, _, h = evaluate(surface, 0.0, 0.0, 0.0, packed(surface, arm))
    assert s == 0.0
    assert h == 0.0
