"""Angles as the UDK generation stored and printed them, and differences of angle triples."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.values import Dialect, Vector
from usarsim_server.simulation.frames import wrap_signed, wrap_turn

__all__ = ["ANGLE_UNIT", "angle_difference", "announced_angle", "each_turn"]

Array = NDArray[np.float64]

ANGLE_UNIT = math.tau / 65536
"""Smallest angle of the UDK engine, rad (protocol reference 2.4)."""


def announced_angle(angle: float, dialect: Dialect) -> float:
    """A configured angle (rad) as a dialect announces it.

    UDK kept configured angles as whole angle units and so printed slightly less: pi as 3.1414
    (protocol reference 2.1).
    """
    return int(angle / ANGLE_UNIT) * ANGLE_UNIT if dialect is Dialect.UDK else angle


def angle_difference(new: Vector, old: Vector) -> Array:
    """Smallest turns (3,) that lead from one triple of angles to the other, rad."""
    return np.array([wrap_signed(a - b) for a, b in zip(new, old, strict=True)])


def each_turn(angles: Vector | Array) -> Vector:
    """Three angles, each in [0, 2 pi)."""
    x, y, z = angles
    return wrap_turn(float(x)), wrap_turn(float(y)), wrap_turn(float(z))
