"""Numbers as a report writes them."""

from __future__ import annotations

from usarsim_study.statistics import Interval

NONE = "–"
"""Stands where there is nothing to tell."""


def number(value: float | None, scale: float | None = None) -> str:
    """Three significant digits of the value, or of the scale; a true minus sign."""
    if value is None:
        return NONE
    size = abs(value if scale is None else scale)
    digits = 0 if size >= 100 else 1 if size >= 10 else 2 if size >= 1 else 3
    text = f"{value:.{digits}f}"
    return "0" if not float(text) else text.replace("-", "−")


def span(low: float, high: float) -> str:
    """From and to, with as many decimals."""
    scale = max(abs(low), abs(high))
    return f"{number(low, scale)} to {number(high, scale)}"


def interval(found: Interval | None) -> str:
    """From and to."""
    return NONE if found is None else span(found.low, found.high)


def p_value(p: float | None) -> str:
    """Three digits, or that it is smaller."""
    if p is None:
        return NONE
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def p_told(p: float | None) -> str:
    """The same in a sentence."""
    text = p_value(p)
    return f"p {text}" if text.startswith("<") else f"p = {text}"
