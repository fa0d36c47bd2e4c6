"""Cubes, spheres, cylinders and the like as shapes of the scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from usarsim_maps.meshes.polygons import half_circle, lathe
from usarsim_maps.scene import Array, Box, Capsule, Cylinder, Mesh, Shape, Sphere
from usarsim_maps.usd.openusd.values import StageValues

SHAPES = {
    "Capsule", "Capsule_1", "Cone", "Cube", "Cylinder", "Cylinder_1", "Plane", "Sphere",
}  # fmt: skip
"""Types of prims that are understood beside meshes."""

AROUND = 24
"""Corners around what becomes a mesh because it is scaled unevenly, or tapers."""

SAME = 1e-4
"""Relative difference of scales that count as equal."""


def shape_of(prim: Any, matrix: Array, values: StageValues) -> tuple[Shape, Array] | None:
    """A shape of one of the types `SHAPES`, and the rigid matrix of its place; None if no size.

    The given matrix (4, 4) leads into the frame of its object. Shapes that it shears, or scales so
    that they are no longer what they were, become meshes.
    """
    found = _plain(prim, values)
    if found is None:
        return None
    shape, turn = found
    whole = matrix.copy()
    whole[:3, :3] = whole[:3, :3] @ turn
    scales = np.linalg.norm(whole[:3, :3], axis=0)
    if not np.isfinite(whole).all() or scales.min() <= 1e-9:
        return None
    axes = whole[:3, :3] / scales
    scaled = _scaled(shape, scales)
    if isinstance(shape, Mesh) or scaled is None or np.abs(axes.T @ axes - np.eye(3)).max() > SAME:
        return _tessellated(shape, prim.GetName()), whole
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0  # they are their own mirror images
    whole[:3, :3] = axes
    return scaled, whole


def _plain(prim: Any, values: StageValues) -> tuple[Shape, Array] | None:
    """The shape along z, and the rotation to its own axis; None if it has no size."""

    def number(name: str, default: float) -> float:
        return values.number(prim.GetAttribute(name), default)

    name, kind = prim.GetName(), prim.GetTypeName()
    turn = _axis(values.text(prim, "axis"))
    match kind:
        case "Cube":
            size = number("size", 2.0)
            return (Box((size, size, size)), np.eye(3)) if size > 0.0 else None
        case "Sphere":
            radius = number("radius", 1.0)
            return (Sphere(radius), np.eye(3)) if radius > 0.0 else None
        case "Plane":
            x, y = number("width", 2.0) / 2.0, number("length", 2.0) / 2.0
            corners = [[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]
            triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
            return Mesh(name, np.array(corners, dtype=float), triangles), turn
    half = number("height", 1.0 if "Capsule" in kind else 2.0) / 2.0
    usual = 0.5 if "Capsule" in kind else 1.0
    if kind.endswith("_1"):
        low, high = number("radiusBottom", usual), number("radiusTop", usual)
    else:
        low = number("radius", usual)
        high = 0.0 if kind == "Cone" else low
    if half <= 0.0 or min(low, high) < 0.0 or max(low, high) <= 0.0:
        return None
    if "Capsule" in kind:
        return (Capsule(low, 2.0 * half) if low == high else _bulged(name, low, high, half)), turn
    if low == high:
        return Cylinder(low, 2.0 * half), turn
    profile = [(0.0, -half), (low, -half), (high, half), (0.0, half)]
    return lathe(name, list(dict.fromkeys(profile)), AROUND), turn


def _bulged(name: str, low: float, high: float, half: float) -> Mesh:
    """A tapered cylinder with half balls of the radii of its ends, from -half to half between."""
    ball = half_circle(1.0, AROUND)
    lower = [(r * low, z * low - half) for r, z in ball[: AROUND // 4 + 1]]
    upper = [(r * high, z * high + half) for r, z in ball[AROUND // 4 :]]
    return lathe(name, list(dict.fromkeys(lower + upper)), AROUND)


def _axis(word: str) -> Array:
    """Rotation from z to the axis of a shape."""
    match word:
        case "X":
            return np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        case "Y":
            return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return np.eye(3)


def _scaled(shape: Shape, scales: Array) -> Shape | None:
    """The shape with scales along its axes, if there is one of its kind."""
    x, y, z = scales.tolist()
    level = abs(x - y) <= SAME * x
    match shape:
        case Box(size=(a, b, c)):
            return Box((a * x, b * y, c * z))
        case Sphere() if level and abs(x - z) <= SAME * x:
            return Sphere(shape.radius * x)
        case Cylinder() if level:
            return Cylinder(shape.radius * x, shape.length * z)
        case Capsule() if level and abs(x - z) <= SAME * x:
            return replace(shape, radius=shape.radius * x, length=shape.length * x)
    return None


def _tessellated(shape: Shape, name: str) -> Mesh:
    match shape:
        case Mesh():
            return shape
        case Box(size=size):
            corner = np.sqrt(0.5)
            profile = [(0.0, -0.5), (corner, -0.5), (corner, 0.5), (0.0, 0.5)]
            unit = lathe(name, profile, 4, np.pi / 4.0)
            return replace(unit, vertices=unit.vertices * np.array(size))
        case Sphere(radius=radius):
            return lathe(name, half_circle(radius, AROUND), AROUND)
        case Capsule(radius=radius, length=length):
            return _bulged(name, radius, radius, length / 2.0)
        case Cylinder(radius=r, length=length):
            half = length / 2.0
            return lathe(name, [(0.0, -half), (r, -half), (r, half), (0.0, half)], AROUND)
    raise TypeError(shape)
