"""Numbers as people write them: few digits, a unit that fits, thin spaces and a real minus sign.

The pages have the same rule as a script, `pidtsm_studies/reports/templates/written.js`; a test compares both.
"""

import math
import re
from collections.abc import Iterable, Sequence
from decimal import ROUND_HALF_UP, Decimal
from typing import NamedTuple

DIGITS = 3
"""Significant digits of a number on a page; the whole number shows when the pointer rests on it."""
MINUS, THIN, NOTHING = "−", "\u202f", "–"
"""NOTHING stands for a value that does not exist."""

_PREFIXES = (("", 1.0), ("m", 1e3), ("µ", 1e6), ("n", 1e9))
_WITHOUT_PREFIX = ("", "%", "kg")
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_ROUNDING = 1e-12
"""Quantities below this are rounding."""
_SMALLEST, _LARGEST, _GROUPED = -3, 6, 10_000
"""Numbers from 10^_SMALLEST to below 10^_LARGEST need no power of ten; groups of three begin at _GROUPED."""


class Scale(NamedTuple):
    """How values in an SI unit are shown.

    Attributes:
        unit: with its prefix, such as mrad.
        factor: by which values in the SI unit are multiplied.
    """

    unit: str
    factor: float


def number(value: float | None, digits: int = DIGITS) -> str:
    """A number with some significant digits, halves rounded away from zero; all digits of an int.

    Args:
        value: None and nan mean that there is none, and become `NOTHING`.
        digits: significant digits; zeros at the end are left out.
    """
    if value is None or math.isnan(value):
        return NOTHING
    sign = MINUS if value < 0.0 else ""
    if math.isinf(value):
        return f"{sign}∞"
    if isinstance(value, int):
        return sign + _grouped(str(abs(value)))
    if value == 0.0:
        return "0"
    exact = abs(Decimal(value))
    rounded = exact.quantize(Decimal(1).scaleb(exact.adjusted() + 1 - digits), ROUND_HALF_UP)
    exponent = rounded.adjusted()
    if _SMALLEST <= exponent < _LARGEST:
        text = f"{rounded:f}"
        return sign + _grouped(text.rstrip("0").rstrip(".") if "." in text else text)
    mantissa = f"{rounded.scaleb(-exponent):f}".rstrip("0").rstrip(".")
    power = f"10{str(exponent).translate(_SUPERSCRIPTS)}"
    return f"{sign}{power}" if mantissa == "1" else f"{sign}{mantissa}{THIN}×{THIN}{power}"


def scale(values: Iterable[float | None], unit: str) -> Scale:
    """A common unit for several values, in which their median is at least 1.

    Args:
        values: in the SI unit; None and 0 do not count.
        unit: the SI unit.
    """
    sizes = sorted(abs(value) for value in values if value is not None and math.isfinite(value) and value != 0.0)
    if unit in _WITHOUT_PREFIX or not sizes or sizes[-1] < _ROUNDING:
        return Scale(unit, 1.0)
    middle = sizes[len(sizes) // 2]
    fitting = [each for each in _PREFIXES if middle * each[1] >= 1.0] or [_PREFIXES[-1]]
    prefix, factor = fitting[0]
    return Scale(prefix + unit, factor)


def quantity(value: float | None, unit: str, digits: int = DIGITS) -> str:
    """A value with the unit that fits it, such as 2.5 mrad; what is only rounding is 0.

    Args:
        value: in the SI unit; None means that there is none.
        unit: the SI unit.
        digits: significant digits.
    """
    if value is None:
        return NOTHING
    fitting = scale([value], unit)
    return f"{scaled(value, fitting, digits)}{THIN}{fitting.unit}".rstrip(THIN)


def scaled(value: float, shown: Scale, digits: int = DIGITS) -> str:
    """A value in the unit of a scale, without this unit, for a table whose head has it; what is only rounding is 0.

    Args:
        value: in the SI unit.
        shown: see `scale`.
        digits: significant digits.
    """
    return number(0.0 if abs(value) < _ROUNDING else shown.factor * value, digits)


def signed(value: float, digits: int = DIGITS) -> str:
    """A difference: with its sign, also if it is positive."""
    return f"+{number(value, digits)}" if value > 0.0 else number(value, digits)


def readable(text: str) -> str:
    """A text of a program as people write it: with minus signs before numbers, and powers of ten."""

    def power(found: "re.Match[str]") -> str:
        raised = f"10{str(int(found[2])).translate(_SUPERSCRIPTS)}"
        return raised if found[1] == "1" else f"{found[1]}{THIN}×{THIN}{raised}"

    return re.sub(r"(?<!\S)-(?=\d)", MINUS, re.sub(r"\b(\d+(?:\.\d+)?)e([-+]\d+)\b", power, text))


def _grouped(text: str) -> str:
    """Digits in groups of three, if there are more than four before the point."""
    whole, point, rest = text.partition(".")
    return (f"{int(whole):,}".replace(",", THIN) if int(whole) >= _GROUPED else whole) + point + rest


def enumeration(names: Sequence[str]) -> str:
    """Names as in a sentence: ``a``, ``a and b``, ``a, b and c``."""
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last
