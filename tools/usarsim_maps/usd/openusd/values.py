"""Values of a stage as plain Python: attributes, matrices, names."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

__all__ = ["NOW", "array", "authored", "matrix", "number", "numbers", "text"]

Array = NDArray[np.float64]

NOW = Usd.TimeCode.EarliestTime()
"""Animated values are taken at their first moment."""


def matrix(value: Any) -> Array:
    """(4, 4) for column vectors; the library's are for rows."""
    answer: Array = np.array(value, dtype=float).T
    return answer


def array(attribute: Any, *shape: int) -> Array | None:
    """A list of numbers, its first axis of any length; None if there is none of that shape."""
    return numbers(attribute.Get(NOW) if attribute else None, *shape)


def numbers(value: Any, *shape: int) -> Array | None:
    """A value as a list of numbers; None if it is none of that shape.

    Damaged and careless files give attributes values of any type.
    """
    if value is None:
        return None
    try:
        found: Array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        return None
    if found.size == 0:
        found = found.reshape(0, *shape)
    return found if found.shape[1:] == shape and found.ndim == len(shape) + 1 else None


def number(attribute: Any, default: float) -> float:
    """A finite number."""
    value = attribute.Get(NOW) if attribute else None
    if isinstance(value, (int, float)) and math.isfinite(value):
        return float(value)
    return default


def text(prim: Any, name: str) -> str:
    """A string or token of an attribute by name; empty by default."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get(NOW) if attribute else None
    return str(value) if isinstance(value, str) else ""


def authored(prim: Any, name: str) -> bool:
    """Whether somebody has given an attribute a value."""
    attribute = prim.GetAttribute(name)
    return bool(attribute and attribute.HasAuthoredValue())
