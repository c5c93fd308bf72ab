"""Numbers as people write them."""

import math
from collections.abc import Sequence

import pytest

from pidtsm_core.written import Scale, enumeration, number, quantity, readable, scale, signed


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1.125, "1.13"),
        (-0.5, "−0.5"),
        (99.96, "100"),
        (0.00123456, "0.00123"),
        (1e-5, "10⁻⁵"),
        (1.234e-5, "1.23 × 10⁻⁵"),
        (12345.6, "12 300"),
        (12345, "12 345"),
        (999, "999"),
        (-1.5e7, "−1.5 × 10⁷"),
        (None, "–"),
        (math.nan, "–"),
        (-math.inf, "−∞"),
    ],
)
def test_a_number_has_few_digits_and_no_computer_notation(value: float | None, text: str) -> None:
    assert number(value) == text.replace(" ", "\u202f")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0025, "rad", "2.5 mrad"),
        (1.64e-4, "rad", "164 µrad"),
        (-0.0123, "m", "−12.3 mm"),
        (12.34, "N m", "12.3 N m"),
        (0.5, "kg", "0.5 kg"),
        (0.0, "rad", "0 rad"),
        (1e-15, "m", "0 m"),
        (3.0, "", "3"),
        (None, "rad", "–"),
    ],
)
def test_a_quantity_has_the_unit_that_fits(value: float | None, unit: str, text: str) -> None:
    assert quantity(value, unit).replace("\u202f", " ") == text


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        ([0.001, 0.002, 1.5], Scale("mrad", 1e3)),
        ([2.0, 3.0], Scale("rad", 1.0)),
        ([None, 0.0], Scale("rad", 1.0)),
        ([math.inf, 2e-6], Scale("µrad", 1e6)),
    ],
)
def test_values_of_a_table_share_the_unit_of_their_median(values: Sequence[float | None], shown: Scale) -> None:
    assert scale(values, "rad") == shown


def test_a_difference_has_its_sign() -> None:
    assert [signed(value) for value in (1.0, -1.0, 0.0)] == ["+1", "−1", "0"]


def test_texts_of_programs_become_readable() -> None:
    text = "-2.9 to -0.1, 14-bit, 2026-11-25, 1.2e-05 rad, 3e+20, law.k1e5"
    expected = "−2.9 to −0.1, 14-bit, 2026-11-25, 1.2 × 10⁻⁵ rad, 3 × 10²⁰, law.k1e5"
    assert readable(text).replace("\u202f", " ") == expected


@pytest.mark.parametrize(("names", "text"), [(["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")])
def test_names_are_listed_as_in_a_sentence(names: list[str], text: str) -> None:
    assert enumeration(names) == text
