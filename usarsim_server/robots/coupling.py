"""Joints that are coupled to others by gears, rods or belts: their positions are polynomials.

A URDF file says it by `<mimic>`, an MJCF file by `<equality><joint/>`. Coefficients stand in order
of their power, the constant first; positions are in rad or m.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.polynomial import Polynomial, polynomial

Coefficients: TypeAlias = tuple[float, float, float, float, float]

BISECTIONS = 40
"""Steps in which the farthest place of a leader is found: to a 10^12th of the way."""


def coupled_position(coefficients: Coefficients, leader: float) -> float:
    """Where a coupled joint is while its leader is at a position."""
    return float(polynomial.polyval(leader, coefficients))


def coupled_speed(coefficients: Coefficients, leader: float, speed: float) -> float:
    """Speed of a coupled joint while its leader passes a position at a speed, rad/s or m/s."""
    return float(polynomial.polyval(leader, polynomial.polyder(coefficients))) * speed


def moved(coefficients: Sequence[float], leader: float, follower: float) -> Coefficients:
    """The polynomial with other origins.

    Args:
        coefficients: of a polynomial P.
        leader: a.
        follower: b.

    Returns:
        The coefficients of P(x + a) + b.
    """
    found = Polynomial(coefficients)(Polynomial([leader, 1.0])) + follower
    a, b, c, d, e = np.resize(np.append(found.coef, np.zeros(5)), 5).tolist()
    return a, b, c, d, e


def farthest(wanted: float, home: float, allowed: Callable[[float], bool]) -> float:
    """The place on the way from home to a wanted one up to which all is allowed.

    The wanted place is the answer if it is allowed itself, and home if home is not.
    """
    if allowed(wanted) or not allowed(home):
        return wanted if allowed(wanted) else home
    inner, outer = home, wanted
    for _ in range(BISECTIONS):
        middle = (inner + outer) / 2.0
        inner, outer = (middle, outer) if allowed(middle) else (inner, middle)
    return inner
