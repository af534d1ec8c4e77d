"""Numbers and names for people: significant digits, powers of ten, infinity, a dash for missing values, lists of labels."""

from __future__ import annotations

import math
from collections.abc import Iterable

UNWRITTEN_EXCESS = 5e-13
"""Excess over a limit [1] that is not shown: it is the rounding of the polynomials' extrema."""

LEAST_P = 1e-6
"""p-values below it [1] are written as an upper bound."""

_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
"""Digits and the minus sign, superscript."""


def number(value: float | None, digits: int = 3) -> str:
    """Format a number: 0.00123, 88.4, 12,345, 1.2·10⁻⁷, ∞, – for NaN and None."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    mantissa, exponent = f"{abs(value):.{digits - 1}e}".split("e")
    power = int(exponent)
    sign = "−" if value < 0 else ""
    if -4 < power < 7:
        return f"{sign}{float(f'{mantissa}e{power}'):,.{max(digits - 1 - power, 0)}f}"
    return f"{sign}{mantissa}·10{str(power).translate(_RAISED)}"


def ratio(value: float) -> str:
    """Format the ratio of a value to its limit; above 1 with enough digits to show it, unless it is rounding."""
    off = value - 1.0
    if UNWRITTEN_EXCESS < off < 5e-4:
        return f"{value:.{1 - math.floor(math.log10(off))}f}"
    return number(value)


def p_value(p: float) -> str:
    """Format a p-value; below 10⁻⁶ only as a bound, because smaller values depend on the test's assumptions."""
    return f"< {number(LEAST_P, 1).replace('1·', '')}" if p < LEAST_P else number(p, 2)


def percent(share: float, digits: int = 1) -> str:
    """Format a rate given in percent."""
    return "–" if math.isnan(share) else f"{share:.{digits}f} %"


def quoted(label: str) -> str:
    """Return a label for a list: in quotation marks if it contains a comma or a semicolon."""
    return f"“{label}”" if set(label) & set(",;") else label


def listed(labels: Iterable[str]) -> str:
    """Return the labels in a sentence, with commas between them."""
    return ", ".join(map(quoted, labels))
