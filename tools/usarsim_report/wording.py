"""Numbers as a report writes them."""

from __future__ import annotations

import math

from usarsim_report.statistics import Interval, rejects

NONE = "–"
"""Stands where there is nothing to tell."""
LEAST = 1e-6
"""Smaller numbers are written with a power of ten."""


def number(value: float | None, scale: float | None = None) -> str:
    """Three significant digits of the value, or of the scale; a true minus sign.

    A value that is not 0 is never written as 0.
    """
    if value is None:
        return NONE
    size = abs(value if scale is None else scale)
    text = f"{value:.2e}" if 0.0 < size < LEAST else f"{value:.{_decimals(size)}f}"
    if not float(text):
        return number(value) if value and scale is not None else "0"
    return text.replace("-", "\N{MINUS SIGN}")


def _decimals(value: float) -> int:
    """Behind the point, for three significant digits."""
    return max(0, 2 - math.floor(math.log10(float(f"{value:.2e}")))) if value else 0


def span(low: float, high: float) -> str:
    """From and to, with as many decimals."""
    scale = max(abs(low), abs(high))
    return f"{number(low, scale)} to {number(high, scale)}"


def interval(found: Interval | None) -> str:
    """From and to."""
    return NONE if found is None else span(found.low, found.high)


def p_value(p: float | None, alpha: float) -> str:
    """Three digits, or that it is smaller; more where three would hide on which side of the level
    of the tests it is."""
    if p is None:
        return NONE
    if p < 0.001 <= alpha:
        return "< 0.001"
    for digits in range(3, 12):
        text = f"{p:.{digits}f}"
        if rejects(float(text), alpha) is rejects(p, alpha):
            break
    return text


def p_told(p: float | None, alpha: float) -> str:
    """The same in a sentence."""
    text = p_value(p, alpha)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def counted(count: int, one: str, more: str) -> str:
    """A number with its noun."""
    return f"{count} {one if count == 1 else more}"


def unit_told(unit: str) -> str:
    """A unit behind a number, with a blank; nothing for shares."""
    return "" if unit == "1" else " per minute" if unit == "1/min" else f" {unit}"


def with_unit(name: str, unit: str) -> str:
    """A name with its unit, for tables and axes; alone for shares."""
    return name if unit == "1" else f"{name} [{unit}]"


def comparative(direction: float, unit: str) -> str:
    """What has the larger value is: times are longer or shorter, all else is more or less."""
    if unit == "s":
        return "longer" if direction > 0 else "shorter"
    return "more" if direction > 0 else "less"
