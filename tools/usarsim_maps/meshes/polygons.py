"""Polygons into triangles, triangles into meshes.

Convex polygons become fans, ears are clipped of the rest (mapbox_earcut).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import mapbox_earcut
import numpy as np
from numpy.typing import NDArray

from usarsim_maps.scene import Array, Integers, Mask, Mesh, Scene
from usarsim_maps.units import matrix_of_pose
from usarsim_server.base.errors import MapImportError, at

Indices = NDArray[np.integer[Any]]

MAX_TRIANGLES = 8_000_000
"""Of one file; more would take gigabytes."""

MAX_CORNERS = 10_000
"""Polygons with more corners become fans: one that crosses itself takes the square of them."""

FAR = 1e12
"""Coordinates beyond which no polygon with an inward corner is believed."""

BENT = 1e-6
"""Sine of an inward corner that counts."""


def triangulate(points: Array, sizes: Integers) -> tuple[Integers, Integers]:
    """Triangles of many polygons: numbers of corners (t, 3), and whose each is (t,); in order.

    The points (c, 3) are the corners of all polygons, one after the other, and the sizes (p,) how
    many each has; those of fewer than three give nothing.
    """
    starts = np.cumsum(sizes) - sizes
    triangles = [np.zeros((0, 3), np.int64)]
    owners = [np.zeros(0, np.int64)]
    for size in np.unique(sizes[sizes >= 3]).tolist():
        chosen = np.flatnonzero(sizes == size)
        corners = starts[chosen, None] + np.arange(size)
        fans = np.ones(len(chosen), dtype=bool) if size == 3 else _is_convex(points[corners])
        triangles.append(corners[fans][:, _fan(size)].reshape(-1, 3))
        owners.append(np.repeat(chosen[fans], size - 2))
        for polygon, ring in zip(chosen[~fans].tolist(), corners[~fans], strict=True):
            found = triangulate_one(points[ring])
            triangles.append(ring[found])
            owners.append(np.full(len(found), polygon))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[order], owner[order]


def triangulate_one(outline: Array, holes: Sequence[Array] = ()) -> Integers:
    """Triangles (t, 3) of one polygon, which look to the same side as its outline (n, 3).

    Holes (m, 3) run in either direction inside it. Corners are numbered: those of the outline, then
    of each hole in turn. None where the polygon encloses nothing, or a corner is at no place.
    """
    points = np.concatenate([outline, *holes])
    if len(outline) < 3 or not (np.abs(points) < FAR).all():
        return np.zeros((0, 3), np.int64)
    if len(points) > MAX_CORNERS:
        return _fan(len(outline))
    rings = [len(outline), *(len(hole) for hole in holes)]
    numbers = np.arange(len(points))
    # A hole without three corners leaves nothing out.
    numbers = numbers[np.repeat([size >= 3 for size in rings], rings)]
    ends = np.cumsum([size for size in rings if size >= 3], dtype=np.uint32)
    found = mapbox_earcut.triangulate_float64(_flat(points, outline)[numbers], ends)
    return np.asarray(numbers[found].reshape(-1, 3))


def _fan(size: int) -> Integers:
    steps = np.arange(1, size - 1)
    return np.stack([np.zeros_like(steps), steps, steps + 1], axis=1)


def _is_convex(corners: Array) -> Mask:
    """Whether polygons (g, n, 3) have no inward corner."""
    with np.errstate(all="ignore"):
        before = corners - np.roll(corners, 1, axis=1)
        after = np.roll(before, -1, axis=1)
        normal = np.cross(corners - corners[:, :1], np.roll(corners, -1, axis=1) - corners[:, :1])
        normal = normal.sum(axis=1, keepdims=True)
        turn = (np.cross(before, after) * normal).sum(axis=2)
        size = np.linalg.norm(before, axis=2) * np.linalg.norm(after, axis=2)
        size *= np.linalg.norm(normal, axis=2)
        answer: Mask = (turn >= -BENT * size).all(axis=1)
        answer |= ~np.isfinite(size).all(axis=1)
    return answer


def _flat(points: Array, outline: Array) -> Array:
    """Coordinates (n, 2) in the plane of the outline, whose normal looks at us."""
    around = np.roll(outline, -1, axis=0)
    normal = np.cross(outline - outline[0], around - outline[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat: Array = points[:, [(1, 2), (2, 0), (0, 1)][axis]]
    flat = flat * (-1.0 if normal[axis] < 0.0 else 1.0, 1.0)
    return np.ascontiguousarray(flat)


# ---- meshes ----------------------------------------------------------------------------------


def make_mesh(
    name: str,
    points: Array,
    triangles: Indices,
    *,
    uvs: Array | None = None,
    slots: Indices | None = None,
    materials: Sequence[str] = (),
    linear: Array | None = None,
) -> Mesh:
    """A mesh of those points that its triangles use; see `MeshBuilder.add`.

    A linear map (3, 3) is applied to the points; where it mirrors, triangles are turned round.
    """
    used, inverse = np.unique(triangles.reshape(-1), return_inverse=True)
    corners = inverse.reshape(-1, 3)
    vertices = points[used]
    if linear is not None:
        with np.errstate(invalid="ignore", over="ignore"):
            vertices = vertices @ linear.T
        if np.linalg.det(linear) < 0.0:
            corners = corners[:, ::-1]
            uvs = None if uvs is None else uvs[:, ::-1]
    return Mesh(
        name=name,
        vertices=vertices,
        triangles=corners.astype(np.int32),
        uvs=uvs,
        slots=None if slots is None else slots.astype(np.int32),
        materials=tuple(materials),
    )


Profile: TypeAlias = list[tuple[float, float]]
"""Radii and heights, from below to above."""

POINTED = 1e-9
"""Radius of what is a point."""


def lathe(name: str, profile: Profile, sides: int, phase: float = 0.0) -> Mesh:
    """What turns about z with so many sides; the first corners are at an angle, rad."""
    angles = phase + np.arange(sides) * 2.0 * np.pi / sides
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    rings = [np.column_stack([circle * r, np.full(sides, z)]) for r, z in profile]
    number = np.arange(len(rings) * sides).reshape(len(rings), sides)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    d, c = number[1:], np.roll(number[1:], -1, axis=1)
    wide = np.array([r for r, _ in profile]) > POINTED
    halves = [np.stack([a, b, c], -1)[wide[:-1]], np.stack([a, c, d], -1)[wide[1:]]]
    return Mesh(name, np.vstack(rings), np.concatenate(halves).reshape(-1, 3).astype(np.int32))


def half_circle(radius: float, sides: int) -> Profile:
    """The profile of a ball, from pole to pole; its level edges are as long as those around it."""
    angles = np.linspace(-np.pi / 2.0, np.pi / 2.0, sides // 2 + 1).tolist()
    return [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]


class MeshBuilder:
    """Collects triangles in blocks, each with its materials, into one mesh."""

    def __init__(self, source: Path | None = None) -> None:
        """A file that is given is refused when its triangles are too many."""
        self._source = source
        self._points: list[Array] = []
        self._blocks: list[tuple[Indices, Array | None, Indices]] = []
        self._first: dict[int, int] = {}
        self._materials: dict[str, int] = {}

    def add(
        self,
        points: Array,
        triangles: Indices,
        uvs: Array | None = None,
        materials: Sequence[str] = ("",),
        slots: Indices | None = None,
    ) -> None:
        """Add triangles (m, 3) of points (n, 3); the same array of points is stored once.

        `uvs` (m, 3, 2) count upwards, `slots` (m,) are numbers of materials; None: all triangles
        have the first one.
        """
        if id(points) not in self._first:
            self._first[id(points)] = sum(map(len, self._points))
            self._points.append(points)
        known = self._materials
        table = np.array([known.setdefault(name, len(known)) for name in materials])
        own = np.zeros(len(triangles), np.int64) if slots is None else slots
        chosen = table[np.clip(own, 0, len(table) - 1)]
        self._blocks.append((triangles + self._first[id(points)], uvs, chosen))
        if self._source is not None:
            check_count(self._source, sum(len(block) for block, _, _ in self._blocks))

    def mesh(self, name: str, hulls: Sequence[Array] = ()) -> Mesh | None:
        """All of it; None if nothing was added."""
        if not self._blocks:
            return None
        triangles, uvs, slots = zip(*self._blocks, strict=True)
        textured = any(own is not None for own in uvs)
        plain = (np.zeros((len(t), 3, 2)) if u is None else u for t, u, _ in self._blocks)
        return Mesh(
            name=name,
            vertices=np.concatenate(self._points),
            triangles=np.concatenate(triangles).astype(np.int32),
            uvs=np.concatenate(list(plain)) if textured else None,
            slots=np.concatenate(slots).astype(np.int32),
            materials=tuple(self._materials),
            hulls=tuple(hulls),
        )


def merge_meshes(scene: Scene, name: str) -> Mesh | None:
    """One mesh out of everything visible in a scene, hulls of the artist included.

    Parts that are solid and not visible become hulls. None if there is no mesh at all.
    """
    merged, hulls = MeshBuilder(), []
    for thing in scene.objects:
        for part in thing.parts:
            mesh = part.shape
            if not isinstance(mesh, Mesh):
                continue
            matrix = matrix_of_pose(thing.pose) @ part.matrix
            linear, offset = matrix[:3, :3], matrix[:3, 3]
            if not part.visible:
                hulls.append(mesh.vertices @ linear.T + offset)
                continue
            hulls += [np.asarray(hull) @ linear.T + offset for hull in mesh.hulls]
            turned = -1 if np.linalg.det(linear) < 0.0 else 1
            names = enumerate(mesh.materials or ("",))
            merged.add(
                mesh.vertices @ linear.T + offset,
                mesh.triangles[:, ::turned],
                None if mesh.uvs is None else mesh.uvs[:, ::turned],
                [part.materials.get(slot, name) for slot, name in names],
                mesh.slots,
            )
    return merged.mesh(name, hulls)


def check_count(source: Path, count: int) -> None:
    """Refuse a file with too many triangles, by a `MapImportError`."""
    if count > MAX_TRIANGLES:
        problem = f"{count} triangles are more than {MAX_TRIANGLES}"
        raise MapImportError(at(source, problem, "simplify the mesh, or split it"))
