"""Values of a stage as plain Python: attributes at the moment that is shown, matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Usd

from usarsim_maps.scene import Array


@dataclass(frozen=True, slots=True)
class StageValues:
    """Reads values at one moment of a stage."""

    time: Any  # Usd.TimeCode

    def value(self, attribute: Any) -> Any | None:
        """Any value; None if there is neither the attribute nor a value."""
        return attribute.Get(self.time) if attribute else None

    def array(self, attribute: Any, *shape: int) -> Array | None:
        """A list of numbers, its first axis of any length; None if there is none of that shape."""
        return numbers(self.value(attribute), *shape)

    def number(self, attribute: Any, default: float) -> float:
        """A finite number."""
        value = self.value(attribute)
        if isinstance(value, (int, float)) and math.isfinite(value):
            return float(value)
        return default

    def text(self, prim: Any, name: str) -> str:
        """A string or token of an attribute by name; empty by default."""
        value = self.value(prim.GetAttribute(name))
        return str(value) if isinstance(value, str) else ""


def shown_moment(stage: Any) -> Any:
    """The time code that is shown: where the stage starts, else its earliest samples.

    What has no samples has its default value at any time.
    """
    if stage.HasAuthoredMetadata("startTimeCode"):
        start = stage.GetStartTimeCode()
        if math.isfinite(start):
            return Usd.TimeCode(start)
    return Usd.TimeCode.EarliestTime()


def matrix(value: Any) -> Array:
    """(4, 4) for column vectors; the library's are for rows."""
    return np.asarray(np.array(value, dtype=float).T)


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


def upwards(prim: Any) -> list[Any]:
    """A prim and what it lies in."""
    answer = []
    while prim and not prim.IsPseudoRoot():
        answer.append(prim)
        prim = prim.GetParent()
    return answer


def in_prototype(prim: Any) -> Any:
    """The prim that all copies of an instance share; the prim itself if it is in no instance."""
    return prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
