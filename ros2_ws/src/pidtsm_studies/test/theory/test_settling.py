"""Times on s = 0 against a foreign integrator, and eq. (47) where it is no bound."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pidtsm_studies.theory.settling import exact_time, printed_time, time_bound

TABLE_1 = (3.0, 0.5, 7 / 9)
SETS = (TABLE_1, (0.5, 4.0, 0.5), (20.0, 0.1, 0.9), (3.0, 0.0, 7 / 9))
ERRORS = (1e-4, 0.1, 0.4, 1.0, 3.0, 50.0)


def integrated(error: float, k1: float, k2: float, alpha: float) -> float:
    """Time down to 1e-9 rad, and from there on that of K1 e^alpha + K2 e, whose closed form is known."""
    small = 1e-9
    rest = small ** (1.0 - alpha)

    def rate(_t: float, x: np.ndarray) -> list[float]:
        e = math.exp(x[0])
        return [-(k1 * (e ** (alpha - 1.0) + e * e) + k2)]

    def arrives(_t: float, x: np.ndarray) -> float:
        return float(x[0] - math.log(small))

    arrives.terminal = True  # type: ignore[attr-defined]
    run = solve_ivp(rate, (0.0, 1e3), [math.log(error)], "LSODA", events=arrives, rtol=1e-10, atol=1e-12)
    last = math.log1p(k2 / k1 * rest) / k2 if k2 else rest / k1
    return float(run.t_events[0][0]) + last / (1.0 - alpha)


@pytest.mark.parametrize("gains", SETS)
@pytest.mark.parametrize("error", ERRORS)
def test_the_exact_time_is_that_of_a_foreign_integrator_and_the_bound_above_it(
    error: float, gains: tuple[float, float, float]
) -> None:
    exact = exact_time(error, *gains)
    assert exact == pytest.approx(integrated(error, *gains), rel=1e-5)
    assert exact <= time_bound(error, *gains) * (1.0 + 1e-12)


@pytest.mark.parametrize("error", [0.0, -0.4])
def test_the_sign_does_not_matter_and_zero_takes_no_time(error: float) -> None:
    assert exact_time(error, *TABLE_1) == exact_time(-error, *TABLE_1)
    assert time_bound(0.0, *TABLE_1) == exact_time(0.0, *TABLE_1) == 0.0


def test_as_printed_it_is_no_bound_below_one() -> None:
    """At the article's start errors of 0.396 and 0.096 rad it is less than the time on s = 0, and even negative."""
    first, second = (0.2 + 0.2 * math.cos(0.2), 0.2 * math.cos(0.2) - 0.2 + 0.1)
    assert printed_time(first, *TABLE_1) == pytest.approx(0.817, abs=1e-3)
    assert exact_time(first, *TABLE_1) == pytest.approx(1.134, abs=1e-3)
    assert printed_time(second, *TABLE_1) == pytest.approx(-1.41, abs=0.01)
    assert printed_time(2.0, *TABLE_1) >= exact_time(2.0, *TABLE_1)


def test_without_a_terminal_gain_there_is_no_time() -> None:
    assert exact_time(0.4, 0.0, 0.5, 0.8) == time_bound(0.4, 0.0, 0.5, 0.8) == math.inf
    assert math.isnan(printed_time(0.4, 0.0, 0.5, 0.8))
    assert math.isnan(printed_time(0.4, 3.0, 0.0, 0.8))


def test_eq_44_as_printed_is_zero() -> None:
    """Numerator and denominator are the same; (47) has the denominator that Bernoulli's method gives."""
    k1, k2, e = 3.0, 0.5, 2.0
    assert math.log((k1 + k2) * e**2 / ((k2 + k1) * e**2)) / (2.0 * k2) == 0.0
    assert math.log((k1 + k2) * e**2 / (k2 + k1 * e**2)) / (2.0 * k2) == pytest.approx(
        np.trapezoid(1.0 / (k1 * (x := np.linspace(1.0, e, 100_001)) ** 3 + k2 * x), x), rel=1e-8
    )
