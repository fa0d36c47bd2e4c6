"""Convex cells: polyhedra bounded by planes, which planes can cut (worlds reference 4.3).

Plain Python floats, not arrays: a cell has a dozen corners, and for such sizes tuples are several
times faster than numpy.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

Point = tuple[float, float, float]

TOLERANCE = 1e-4
"""m: points nearer to a plane than this count as on it."""

THINNEST = 1e-5
"""m: a cell with less extent along some face's normal is dropped."""


class Plane(NamedTuple):
    """Points p with normal . p = offset; the normal (unit) points out of the solid."""

    x: float
    y: float
    z: float
    offset: float

    def height(self, point: Point) -> float:
        """Signed distance of a point, positive on the outside."""
        return self.x * point[0] + self.y * point[1] + self.z * point[2] - self.offset


class Face(NamedTuple):
    """A convex polygon of a cell, counter-clockwise from outside.

    `surface` is whatever number the maker of the plane gave it; cells only hand it on.
    """

    plane: Plane
    points: tuple[Point, ...]
    surface: int


class Cell(NamedTuple):
    """A convex polyhedron with the box around it."""

    faces: tuple[Face, ...]
    lower: Point
    upper: Point

    @property
    def corners(self) -> list[Point]:
        """All corners, each once (to 1e-6 m)."""
        seen: dict[tuple[int, int, int], Point] = {}
        for face in self.faces:
            for p in face.points:
                seen.setdefault((round(p[0] * 1e6), round(p[1] * 1e6), round(p[2] * 1e6)), p)
        return list(seen.values())

    @property
    def volume(self) -> float:
        """m^3, by the pyramids from one corner over all faces."""
        if not self.faces:
            return 0.0
        apex = self.faces[0].points[0]
        return sum(-f.plane.height(apex) * polygon_area(f.points) for f in self.faces) / 3.0

    @property
    def thickness(self) -> float:
        """Least extent along any face's normal, m."""
        corners = self.corners
        return min((max(-f.plane.height(c) for c in corners) for f in self.faces), default=0.0)


def cell_of(faces: Iterable[Face]) -> Cell:
    """A cell with its box."""
    faces = tuple(faces)
    xs, ys, zs = zip(*(p for face in faces for p in face.points), strict=True)
    return Cell(faces, (min(xs), min(ys), min(zs)), (max(xs), max(ys), max(zs)))


def box_cell(lower: Point, upper: Point, surface: int = -1) -> Cell:
    """An axis-parallel box."""
    (a, b, c), (d, e, f) = lower, upper
    sides = (
        ((-1.0, 0.0, 0.0), ((a, b, c), (a, b, f), (a, e, f), (a, e, c))),
        ((1.0, 0.0, 0.0), ((d, b, c), (d, e, c), (d, e, f), (d, b, f))),
        ((0.0, -1.0, 0.0), ((a, b, c), (d, b, c), (d, b, f), (a, b, f))),
        ((0.0, 1.0, 0.0), ((a, e, c), (a, e, f), (d, e, f), (d, e, c))),
        ((0.0, 0.0, -1.0), ((a, b, c), (a, e, c), (d, e, c), (d, b, c))),
        ((0.0, 0.0, 1.0), ((a, b, f), (d, b, f), (d, e, f), (a, e, f))),
    )
    faces = [
        Face(
            Plane(*normal, sum(n * p for n, p in zip(normal, points[0], strict=True))),
            points,
            surface,
        )
        for normal, points in sides
    ]
    return Cell(tuple(faces), lower, upper)


def flip(plane: Plane) -> Plane:
    """The same plane with the solid on its other side."""
    return Plane(-plane.x, -plane.y, -plane.z, -plane.offset)


def polygon_normal(points: Sequence[Point]) -> tuple[float, float, float]:
    """Normal times twice the area (Newell's method: right for any flat polygon)."""
    x = y = z = 0.0
    px, py, pz = points[-1]
    for qx, qy, qz in points:
        x += (py - qy) * (pz + qz)
        y += (pz - qz) * (px + qx)
        z += (px - qx) * (py + qy)
        px, py, pz = qx, qy, qz
    return x, y, z


def polygon_area(points: Sequence[Point]) -> float:
    """m^2."""
    return math.hypot(*polygon_normal(points)) / 2.0


def plane_of(points: Sequence[Point]) -> Plane | None:
    """The plane that fits a polygon; None if it has no area."""
    x, y, z = polygon_normal(points)
    length = math.hypot(x, y, z)
    if length < 1e-9 or not math.isfinite(length):
        return None
    x, y, z = x / length, y / length, z / length
    offset = sum(x * p[0] + y * p[1] + z * p[2] for p in points) / len(points)
    return Plane(x, y, z, offset)


def split_polygon(
    points: Sequence[Point], plane: Plane, tolerance: float = TOLERANCE
) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    """The parts of a convex polygon behind and before a plane; a flat-lying one is in neither."""
    heights = [plane.height(p) for p in points]
    behind: list[Point] = []
    before: list[Point] = []
    last, last_height = points[-1], heights[-1]
    for point, height in zip(points, heights, strict=True):
        if (last_height > tolerance and height < -tolerance) or (
            last_height < -tolerance and height > tolerance
        ):
            share = last_height / (last_height - height)
            cut = (
                last[0] + (point[0] - last[0]) * share,
                last[1] + (point[1] - last[1]) * share,
                last[2] + (point[2] - last[2]) * share,
            )
            behind.append(cut)
            before.append(cut)
        if height <= tolerance:
            behind.append(point)
        if height >= -tolerance:
            before.append(point)
        last, last_height = point, height
    inside = tuple(behind) if min(heights) < -tolerance and len(behind) > 2 else ()
    outside = tuple(before) if max(heights) > tolerance and len(before) > 2 else ()
    return inside, outside


def side(cell: Cell, plane: Plane) -> int:
    """-1: all of the cell is behind the plane, 1: all before it, 0: the plane cuts it."""
    low = plane.x * (cell.lower[0] if plane.x > 0 else cell.upper[0])
    low += plane.y * (cell.lower[1] if plane.y > 0 else cell.upper[1])
    low += plane.z * (cell.lower[2] if plane.z > 0 else cell.upper[2]) - plane.offset
    if low >= -TOLERANCE:
        return 1
    heights = [plane.height(p) for face in cell.faces for p in face.points]
    if max(heights) <= TOLERANCE:
        return -1
    return 1 if min(heights) >= -TOLERANCE else 0


def split(cell: Cell, plane: Plane, inner: int, outer: int) -> tuple[Cell | None, Cell | None]:
    """The parts of a cell behind and before a plane; their new faces get `inner` and `outer`."""
    where = side(cell, plane)
    if where:
        return (cell, None) if where < 0 else (None, cell)
    inside: list[Face] = []
    outside: list[Face] = []
    rim: list[Point] = []
    for face in cell.faces:
        behind, before = split_polygon(face.points, plane)
        if behind:
            inside.append(Face(face.plane, behind, face.surface))
            rim.extend(p for p in behind if abs(plane.height(p)) <= TOLERANCE)
        if before:
            outside.append(Face(face.plane, before, face.surface))
    lid = _ring(rim, plane)
    if len(lid) < 3:
        return cell, None
    inside.append(Face(plane, lid, inner))
    outside.append(Face(flip(plane), lid[::-1], outer))
    return _sound(inside), _sound(outside)


def _sound(faces: list[Face]) -> Cell | None:
    """The cell, None if it is a sliver."""
    if len(faces) < 4:
        return None
    cell = cell_of(faces)
    return cell if cell.thickness >= THINNEST else None


def _ring(points: Sequence[Point], plane: Plane) -> tuple[Point, ...]:
    """Points on a plane, corners of a convex polygon, in order around its normal, each once."""
    unique: dict[tuple[int, int, int], Point] = {}
    for p in points:
        unique.setdefault((round(p[0] * 1e5), round(p[1] * 1e5), round(p[2] * 1e5)), p)
    corners = list(unique.values())
    if len(corners) < 3:
        return ()
    middle = tuple(sum(axis) / len(corners) for axis in zip(*corners, strict=True))
    u, v = _axes(plane)
    angles = []
    for p in corners:
        d = (p[0] - middle[0], p[1] - middle[1], p[2] - middle[2])
        along = d[0] * u[0] + d[1] * u[1] + d[2] * u[2]
        across = d[0] * v[0] + d[1] * v[1] + d[2] * v[2]
        angles.append(math.atan2(across, along))
    order = sorted(range(len(corners)), key=angles.__getitem__)
    return tuple(corners[i] for i in order)


def _axes(plane: Plane) -> tuple[Point, Point]:
    """Two unit vectors in a plane that turn anticlockwise around its normal."""
    n = (plane.x, plane.y, plane.z)
    smallest = min(range(3), key=lambda axis: abs(n[axis]))
    e = [0.0, 0.0, 0.0]
    e[smallest] = 1.0
    u = _cross((e[0], e[1], e[2]), n)
    length = math.hypot(*u)
    u = (u[0] / length, u[1] / length, u[2] / length)
    return u, _cross(n, u)


def _cross(a: Point, b: Point) -> Point:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
