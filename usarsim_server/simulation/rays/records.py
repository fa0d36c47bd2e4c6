"""The structs that `rays.c` works on: what they point to, and of which types it has to be."""

from __future__ import annotations

import ctypes
from ctypes import c_int64
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

_NOTHING = ctypes.c_char * 0
"""Put where an array is, it tells its address, several times as fast as `ndarray.ctypes`."""


class Record(ctypes.Structure):
    """A struct of the code, of fields of 8 bytes; what it points to lives as long as it does.

    Attributes:
        KINDS: for each field the type of the array that it points to, or what it is instead:
            a number, a struct, something of Embree's.
    """

    KINDS: ClassVar[dict[str, str]] = {}

    def __init__(self, **values: Record | NDArray[Any] | int | None) -> None:
        """Fill all fields."""
        super().__init__()
        self._kept: list[object] = []
        for name, kind in self.KINDS.items():
            value = values[name]
            if isinstance(value, Record):
                self._kept.append(value)
                value = ctypes.addressof(value)
            elif isinstance(value, np.ndarray):
                array = np.ascontiguousarray(value, kind)
                self._kept.append(array)
                value = ctypes.addressof(_NOTHING.from_buffer(array.data))
            setattr(self, name, value or 0)


class SceneRecord(Record):
    """A `TriangleScene`."""

    KINDS: ClassVar[dict[str, str]] = {
        "embree": "Embree's scene",
        "parts": "i8",
        "normals": "f8",
        "rounds": "i8",
        "shapes": "f8",
        "box": "f8",
    }
    _fields_ = [(name, c_int64) for name in KINDS]


class FixedRecord(Record):
    """What never moves."""

    KINDS: ClassVar[dict[str, str]] = {
        "full": "scene",
        "clear": "scene",
        "count": "number",
        "planes": "f8",
        "geoms": "i8",
    }
    _fields_ = [(name, c_int64) for name in KINDS]


class MovingRecord(Record):
    """What moves, where it is at one instant."""

    KINDS: ClassVar[dict[str, str]] = {
        "trees": "number",
        **dict.fromkeys(("centres", "radii"), "f8"),
        **dict.fromkeys(("first", "count"), "i8"),
        **dict.fromkeys(("turns", "places", "middles", "spans"), "f8"),
        **dict.fromkeys(("full", "clear", "geoms", "geom_begins"), "i8"),
    }
    _fields_ = [(name, c_int64) for name in KINDS]


class WorkRecord(Record):
    """A batch of rays, and room for the answers."""

    KINDS: ClassVar[dict[str, str]] = {
        "intersect": "function of Embree's",
        "fixed": "struct",
        "moving": "struct",
        "fans": "number",
        **dict.fromkeys(("begins", "point_begins"), "i8"),
        **dict.fromkeys(("points", "directions", "ranges"), "f8"),
        "own": "i8",
        **dict.fromkeys(("through_glass", "facing"), "?"),
        **dict.fromkeys(("distances", "normals"), "f8"),
        "met": "i8",
    }
    _fields_ = [(name, c_int64) for name in KINDS]
