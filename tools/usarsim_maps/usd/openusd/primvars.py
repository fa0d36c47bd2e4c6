"""Primvars of a shape: one value for all of it, or for each face, vertex or corner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from pxr import UsdGeom

from usarsim_maps.scene import Array, Integers
from usarsim_maps.usd.openusd.values import StageValues, numbers

COORDINATES = ("st", "UVMap", "st0", "map1")
"""Usual names of texture coordinates."""


DISPLAY = ("displayColor", "displayOpacity")
"""Primvars of what no material colours."""

Display: TypeAlias = tuple[tuple[float, ...] | None, tuple[float, ...] | None]
"""Values of these two for one copy of an instancer; None: it says none."""

NO_DISPLAY: Display = (None, None)


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """Triangles of a mesh by what primvars count."""

    places: Integers  # (t, 3) numbers in the mesh's list of corners
    points: Integers  # (t, 3) numbers of the points there
    faces: Integers  # (t,) numbers of the faces

    def of(self, chosen: Any) -> Corners:
        """Those of some triangles."""
        return Corners(self.places[chosen], self.points[chosen], self.faces[chosen])


def color_values(prim: Any, name: str, values: StageValues) -> Array | None:
    """Values (n, 1 or more) of a primvar, inherited ones too; None without sound ones."""
    found = _flat(prim, name, values)
    return None if found is None else found[0]


def colors_at(prim: Any, name: str, corners: Corners, values: StageValues) -> Array | None:
    """Mean of a primvar over each triangle, (t, 1 or more); None without sound values."""
    found = _flat(prim, name, values)
    if found is None:
        return None
    flat, how = found
    if how == "constant":
        return np.repeat(flat[:1], len(corners.faces), axis=0)
    index = _index(how, corners)
    if index.max(initial=0) >= len(flat):
        return None
    return np.asarray(flat[index].mean(axis=1))


def displays(prim: Any, count: int, outer: Display, values: StageValues) -> list[Display]:
    """Colour and opacity of each copy of an instancer: its own, else that of a copy around it."""
    columns: list[Sequence[tuple[float, ...] | None]] = []
    for name, otherwise in zip(DISPLAY, outer, strict=True):
        found = color_values(prim, name, values)
        if found is None or len(found) not in (1, count):
            columns.append([otherwise] * count)
        else:
            rows = [tuple(row) for row in found.tolist()]
            columns.append(rows * count if len(rows) == 1 else rows)
    return [(color, clearness) for color, clearness in zip(*columns, strict=True)]


def own_color(display: Display, name: str) -> Array | None:
    """The value (1, 1 or more) of a copy for one of the primvars `DISPLAY`; None without one."""
    value = dict(zip(DISPLAY, display, strict=True)).get(name)
    return None if value is None else np.array([value])


def coordinates_at(prim: Any, name: str, corners: Corners, values: StageValues) -> Array | None:
    """Texture coordinates (t, 3, 2), by this name, else a usual one, else any there are."""
    source = UsdGeom.PrimvarsAPI(prim)
    named = (
        source.FindPrimvarWithInheritance(word) for word in dict.fromkeys((name, *COORDINATES))
    )
    others = (
        primvar for primvar in source.GetPrimvarsWithAuthoredValues()
        if str(primvar.GetTypeName()) in ("texCoord2f[]", "texCoord2d[]", "texCoord2h[]")
    )  # fmt: skip
    for primvar in (*named, *others):
        if not primvar or not primvar.HasAuthoredValue():
            continue
        found = numbers(primvar.ComputeFlattened(values.time), 2)
        if found is None:
            continue
        index = _index(primvar.GetInterpolation(), corners)
        if len(found) and index.max(initial=0) < len(found):
            return found[index]
    return None


def _flat(prim: Any, name: str, values: StageValues) -> tuple[Array, str] | None:
    """Values (n, 1 or more) of a primvar without its indices, and its interpolation."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if not primvar or not primvar.HasAuthoredValue():
        return None
    value = primvar.ComputeFlattened(values.time)
    for read in _READINGS:
        found = read(value)
        if found is not None and len(found) and np.isfinite(found).all():
            return found, str(primvar.GetInterpolation())
    return None


def _scalar(value: Any) -> Array | None:
    """One number, or one colour, as a list of one."""
    if isinstance(value, (int, float)):
        return np.array([[float(value)]])
    found = numbers(value)
    return found[None, :] if found is not None and len(found) in (3, 4) else None


def _list(value: Any) -> Array | None:
    found = numbers(value)
    return None if found is None else found[:, None]


_READINGS: tuple[Callable[[Any], Array | None], ...] = (
    lambda value: numbers(value, 3),
    lambda value: numbers(value, 4),
    _list,
    _scalar,
)
"""Ways to take a value: colours, colours with opacity, numbers, a single one of these."""


def _index(how: str, corners: Corners) -> Integers:
    """Numbers (t, 3) of values at the corners of triangles, by the interpolation."""
    match how:
        case "faceVarying":
            return corners.places
        case "vertex" | "varying":
            return corners.points
        case "uniform":
            return np.repeat(corners.faces[:, None], 3, axis=1)
    return np.zeros_like(corners.places)
