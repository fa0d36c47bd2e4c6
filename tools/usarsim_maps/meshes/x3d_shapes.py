"""Geometry nodes of X3D and VRML as triangles (ISO/IEC 19775-1, clauses 11 and 13)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.geometry import CORNERS, QUADS
from usarsim_maps.meshes.polygons import Profile, half_circle, lathe, make_mesh, triangulate
from usarsim_maps.meshes.vertex_colors import shaded
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.scene import Array, Integers, Material, Mesh

Find = Callable[..., Node | None]

SIDES = 32
"""Corners of round things."""

CURE = "export it again, or as glTF"


@dataclass(frozen=True, slots=True)
class XShape:
    """A geometry node as triangles."""

    mesh: Mesh  # in the node's own frame; without materials, or with those of `shades`
    shades: list[Material]  # plain ones in the colours that the node has for vertices or faces


def make_geometry(document: Document, node: Node, child: Find) -> XShape | None:
    """The triangles of a geometry node; None for other nodes.

    `child` finds the first of its children of some kinds. If a value makes no sense, a
    `MapImportError` has the line.
    """
    maker = _MAKERS.get(node.tag)
    if maker is None:
        return None
    fields = _Fields(document, node, child)
    points, polygons, uvs = maker(fields)
    if len(polygons) and (polygons.min() < -1 or polygons.max() >= len(points)):
        problem = f"{node.tag}: index {polygons.max()} of {len(points)} points"
        raise document.error(node, problem, CURE)
    corners = polygons >= 0
    # Polygons end with -1; the last one need not.
    sizes = np.diff(np.flatnonzero(np.concatenate([[True], ~corners, [True]]))) - 1
    ring = polygons[corners]
    triangles, _ = triangulate(points[ring], sizes[sizes > 0])
    if not len(triangles):
        return None
    shades: list[Material] = []
    slots = None
    colors = fields.colors(ring, sizes[sizes > 0])
    if colors is not None:
        shades, slots = shaded(colors[triangles].mean(axis=1))
    if node.get("ccw").lower() == "false":
        triangles = triangles[:, ::-1]
    name = node.get("DEF") or node.tag
    coordinates = None if uvs is None else uvs[triangles]
    names = [shade.name for shade in shades]
    mesh = make_mesh(name, points, ring[triangles], uvs=coordinates, slots=slots, materials=names)
    return XShape(mesh, shades)


class _Fields:
    """The fields of a node."""

    def __init__(self, document: Document, node: Node, child: Find) -> None:
        self._document = document
        self.node = node
        self.child = child

    def floats(self, field: str, node: Node | None = None, width: int = 1) -> Array:
        """All numbers of a field, in rows of some width."""
        owner = self.node if node is None else node
        text = owner.get(field).replace(",", " ")
        try:
            values = np.array(text.split(), dtype=float)
        except ValueError as error:
            raise self._document.error(owner, f"{field}: {error}"[:120], CURE) from None
        if len(values) % width:
            problem = f"{field}: {len(values)} numbers are no rows of {width}"
            raise self._document.error(owner, problem, CURE)
        return values.reshape(-1, width)

    def integers(self, field: str) -> Integers:
        """All whole numbers of a field."""
        values = self.floats(field).reshape(-1)
        if not (np.abs(values) < 1 << 31).all():
            raise self._document.error(self.node, f"{field}: a number without meaning", CURE)
        return values.astype(np.int64)

    def size(self, field: str, default: float) -> float:
        """A positive number."""
        values = self.floats(field).reshape(-1)
        if not len(values):
            return default
        if not 0.0 < values[0] < 1e9:
            problem = f"{field} is {self.node.get(field)[:40]!r}"
            raise self._document.error(self.node, problem, CURE)
        return float(values[0])

    def points(self) -> Array:
        """Of the Coordinate node."""
        found = self.child("Coordinate", "CoordinateDouble")
        return np.zeros((0, 3)) if found is None else self.floats("point", found, 3)

    def uvs(self) -> Array | None:
        """Of the TextureCoordinate node."""
        found = self.child("TextureCoordinate")
        return None if found is None else self.floats("point", found, 2)

    def colors(self, ring: Integers, sizes: Integers) -> Array | None:
        """Colour (c, 3) of each corner; None if there are none, or too few.

        There is a vertex number for each corner (c,), and a number of corners for each polygon.
        """
        found = self.child("Color", "ColorRGBA")
        if found is None:
            return None
        rows = self.floats("color", found, 3 if found.tag == "Color" else 4)[:, :3]
        order = self.integers("colorIndex")
        if self.node.get("colorPerVertex").lower() == "false":
            faces = order if len(order) else np.arange(len(sizes))
            if len(faces) < len(sizes):
                return None
            chosen = np.repeat(faces[: len(sizes)], sizes)
        else:
            chosen = order[order >= 0] if len(order) else ring
        if len(chosen) != len(ring) or chosen.min() < 0 or chosen.max() >= len(rows):
            return None
        return np.asarray(rows[chosen])


Made = tuple[Array, Integers, Array | None]
"""Points (n, 3); vertex numbers of polygons, each ended by -1; texture coordinates per corner."""


def _face_set(fields: _Fields) -> Made:
    points, order = fields.points(), fields.integers("coordIndex")
    order = np.maximum(order, -1)
    uvs, chosen = fields.uvs(), fields.integers("texCoordIndex")
    if uvs is None:
        return points, order, None
    chosen = np.maximum(chosen, -1) if len(chosen) else order
    corners = chosen[chosen >= 0]
    fits = len(corners) == np.count_nonzero(order >= 0) and (
        not len(corners) or corners.max() < len(uvs)
    )
    return points, order, uvs[corners] if fits else None


def _triangle_set(fields: _Fields) -> Made:
    points = fields.points()
    order = fields.integers("index") if fields.node.tag != "TriangleSet" else np.arange(len(points))
    order = order[: len(order) // 3 * 3]
    uvs = fields.uvs()
    fits = uvs is not None and (not len(order) or 0 <= order.min() <= order.max() < len(uvs))
    corners = uvs[order] if fits and uvs is not None else None
    return points, _ended(order.reshape(-1, 3)), corners


def _quads(fields: _Fields) -> Made:
    """Four corners after the other."""
    points = fields.points()
    order = fields.integers("index") if fields.node.tag != "QuadSet" else np.arange(len(points))
    return points, _ended(order[: len(order) // 4 * 4].reshape(-1, 4)), None


def _chains(fields: _Fields) -> Made:
    """Strips and fans: by their indices with -1 between them, or by their lengths."""
    points, tag = fields.points(), fields.node.tag
    if tag.startswith("Indexed"):
        order = fields.integers("index")
        ends = np.flatnonzero(order < 0)
        chains = [chain[chain >= 0] for chain in np.split(order, ends)]
    else:
        sizes = fields.integers("stripCount" if "Strip" in tag else "fanCount")
        chains = np.split(np.arange(len(points)), np.cumsum(np.maximum(sizes, 0)))
    found = [np.zeros((0, 3), dtype=np.int64)]
    for chain in chains:
        if len(chain) < 3:
            continue
        rows = np.column_stack([chain[:-2], chain[1:-1], chain[2:]])
        if "Fan" in tag:
            rows[:, 0] = chain[0]
        else:
            rows[1::2] = rows[1::2][:, [1, 0, 2]]
        found.append(rows)
    return points, _ended(np.concatenate(found)), None


def _box(fields: _Fields) -> Made:
    rows = fields.floats("size", width=3)
    half = (rows[0] if len(rows) else np.array([2.0, 2.0, 2.0])) / 2.0
    return CORNERS * half, _ended(np.array(QUADS)), None


def _sphere(fields: _Fields) -> Made:
    return _turned(half_circle(fields.size("radius", 1.0), SIDES))


def _cylinder(fields: _Fields) -> Made:
    radius, half = fields.size("radius", 1.0), fields.size("height", 2.0) / 2.0
    return _turned([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])


def _cone(fields: _Fields) -> Made:
    radius, half = fields.size("bottomRadius", 1.0), fields.size("height", 2.0) / 2.0
    return _turned([(0.0, -half), (radius, -half), (0.0, half)])


def _turned(profile: Profile) -> Made:
    """What turns about y."""
    mesh = lathe("", profile, SIDES)
    return mesh.vertices[:, [0, 2, 1]] * [1.0, 1.0, -1.0], _ended(mesh.triangles), None


def _grid(fields: _Fields) -> Made:
    """ElevationGrid: heights along y over a grid of x and z."""
    columns, rows = int(fields.size("xDimension", 0.0)), int(fields.size("zDimension", 0.0))
    heights = fields.floats("height").reshape(-1)[: columns * rows]
    if columns < 2 or rows < 2 or len(heights) < columns * rows:
        return np.zeros((0, 3)), np.zeros(0, np.int64), None
    x = np.arange(columns) * fields.size("xSpacing", 1.0)
    z = np.arange(rows) * fields.size("zSpacing", 1.0)
    points = np.column_stack([np.tile(x, rows), heights, np.repeat(z, columns)])
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
    # Two triangles for each cell: its corners need not lie in one plane.
    one = np.column_stack([first, first + columns, first + columns + 1])
    two = np.column_stack([first, first + columns + 1, first + 1])
    return points, _ended(np.concatenate([one, two])), None


def _ended(rows: NDArray[np.integer]) -> Integers:
    """Polygons (n, k), each ended by -1."""
    return np.column_stack([rows, np.full(len(rows), -1)]).reshape(-1).astype(np.int64)


_MAKERS: dict[str, Callable[[_Fields], Made]] = {
    "Box": _box,
    "Cone": _cone,
    "Cylinder": _cylinder,
    "ElevationGrid": _grid,
    "IndexedFaceSet": _face_set,
    "IndexedQuadSet": _quads,
    "IndexedTriangleFanSet": _chains,
    "IndexedTriangleSet": _triangle_set,
    "IndexedTriangleStripSet": _chains,
    "QuadSet": _quads,
    "Sphere": _sphere,
    "TriangleFanSet": _chains,
    "TriangleSet": _triangle_set,
    "TriangleStripSet": _chains,
}
