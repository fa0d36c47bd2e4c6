"""Bounds of statistics that chance does not leave in the life of a kit."""

from __future__ import annotations

import math

CHANCE = 5.3
"""Standard deviations of a normal variate that are exceeded once in ten million times."""


def spread_bounds(samples: int) -> tuple[float, float]:
    """Between which the mean square of so many unit normal variates stays.

    The cube root of chi-square is nearly normal (Wilson and Hilferty 1931).
    """
    part = 2.0 / (9.0 * samples)
    low, high = (1.0 - part + sign * CHANCE * math.sqrt(part) for sign in (-1.0, 1.0))
    return max(low, 0.0) ** 3, high**3
