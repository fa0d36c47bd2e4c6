"""Geometry of COLLADA: sources, inputs with their offsets, and all kinds of primitives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.polygons import MeshBuilder, triangulate, triangulate_one
from usarsim_maps.meshes.vertex_colors import WHITE, shaded
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.scene import Array, Color, Integers, Material, Mesh
from usarsim_maps.support import Support, support_table
from usarsim_server.base.errors import MapImportError

PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans")

ELEMENTS = support_table(
    read="""
        ambient bind_shape_matrix blinn constant controller convex_mesh diffuse directional effect
        emission geometry image instance_controller instance_geometry instance_light instance_node
        joints lambert light lookat material matrix mesh morph node phong point polygons polylist
        profile_COMMON rotate sampler2D scale skin spot surface translate transparency transparent
        triangles trifans tristrips vertex_weights visual_scene
    """,
    left_out="""
        animation animation_clip articulated_system brep camera force_field formula
        index_of_refraction joint kinematics_model kinematics_scene lines linestrips
        physics_material physics_model physics_scene profile_BRIDGE profile_CG profile_GLES
        profile_GLES2 profile_GLSL reflective reflectivity shininess skew specular spline
    """,
)
"""Elements of COLLADA 1.4 and 1.5 that say what is in a scene and how it looks."""


@dataclass(frozen=True, slots=True)
class _Inputs:
    """Where in a primitive's index list positions and texture coordinates stand."""

    stride: int
    vertex: int
    points: Array
    texture: int | None
    uvs: Array | None
    shade: int  # offset of colours
    colors: Array | None  # (c, 3)


@dataclass(frozen=True, slots=True)
class ColladaGeometry:
    """A geometry as it is read."""

    mesh: Mesh  # its materials are symbols, or shades of symbols
    shades: Mapping[str, tuple[str, Color]]  # symbol and colour of each shade by its name


def read_geometry(
    document: Document,
    ids: Mapping[str, Node],
    geometry: Node,
    findings: Findings,
    bend: Callable[[Array], Array] | None = None,
) -> ColladaGeometry | None:
    """The mesh of a `geometry` in the file's units and axes; None if it has no triangles.

    Its vertices are moved by `bend` if that is given. A `MapImportError` names the line of what is
    broken.
    """
    mesh = geometry.child("mesh") or geometry.child("convex_mesh")
    if mesh is None:
        name = geometry.get("name") or geometry.get("id")
        shape = next((child.tag for child in geometry.children if child.tag in ELEMENTS), "")
        findings.skip(shape or "geometry without mesh", name)
        return None
    return _Mesh(document, ids, findings, bend).read(geometry, mesh)


def read_points(document: Document, ids: Mapping[str, Node], geometry: Node) -> Array | None:
    """Vertices (n, 3) of a `geometry`, as its primitives count them; None if it has none."""
    mesh = geometry.child("mesh") or geometry.child("convex_mesh")
    vertices = None if mesh is None else mesh.child("vertices")
    for entry in () if vertices is None else vertices.all("input"):
        if entry.get("semantic") == "POSITION":
            found = source_values(document, ids, entry)
            return found[:, :3] if found.shape[1] >= 3 else None
    return None


def source_values(document: Document, ids: Mapping[str, Node], entry: Node) -> Array:
    """Values (n, width) of the source that an input names, by its accessor."""
    source = ids.get(entry.get("source").removeprefix("#"))
    if source is None or source.tag != "source":
        raise document.error(entry, f"source {entry.get('source')[:60]!r} is missing")
    array = source.child("float_array")
    accessor = source.child("technique_common", "accessor")
    if array is None:
        raise document.error(source, "a source without numbers")
    values = document.floats(array)
    stride, start, count = 3, 0, None
    if accessor is not None:
        stride = max(1, whole_number(document, accessor, "stride", 1))
        start = whole_number(document, accessor, "offset", 0)
        count = whole_number(document, accessor, "count", -1)
    there = max(0, len(values) - start) // stride
    if count is None or count < 0:
        count = there
    if count > there:
        raise document.error(source, f"{count} entries are announced, {there} are there")
    return values[start : start + count * stride].reshape(count, stride)


def whole_number(document: Document, node: Node, attribute: str, default: int) -> int:
    """A whole number in an attribute; a `MapImportError` if it is none."""
    text = node.get(attribute)
    if not text.strip():
        return default
    try:
        value = int(text)
    except ValueError:
        value = -1
    if not 0 <= value < 1 << 31:
        raise document.error(node, f"{attribute}={text[:40]!r} is no whole number")
    return value


class _Mesh:
    """One geometry being read."""

    def __init__(
        self,
        document: Document,
        ids: Mapping[str, Node],
        findings: Findings,
        bend: Callable[[Array], Array] | None,
    ) -> None:
        self._document = document
        self._ids = ids
        self._findings = findings
        self._bend = bend
        self._sources: dict[int, Array] = {}
        self._points: dict[int, Array] = {}
        self._shades: dict[str, tuple[str, Color]] = {}

    def read(self, geometry: Node, mesh: Node) -> ColladaGeometry | None:
        """All primitives of a mesh in one."""
        whole = MeshBuilder(self._document.path)
        name = geometry.get("name") or geometry.get("id") or "geometry"
        for primitive in mesh.children:
            if primitive.tag not in PRIMITIVES:
                if ELEMENTS.get(primitive.tag) is Support.LEFT_OUT:
                    self._findings.skip(primitive.tag, name)
                continue
            inputs = self._inputs(mesh, primitive)
            rows = None if inputs is None else self._rows(primitive, inputs)
            if inputs is None or rows is None or not len(rows):
                continue
            uvs = None
            if inputs.uvs is not None and inputs.texture is not None:
                uvs = self._textured(primitive, inputs.uvs, rows[:, :, inputs.texture])
            corners = rows[:, :, inputs.vertex]
            names, slots = [primitive.get("material")], None
            if inputs.colors is not None:
                names, slots = self._shaded(names[0], inputs, rows)
            whole.add(inputs.points, corners, uvs, names, slots)
        made = whole.mesh(name)
        return None if made is None else ColladaGeometry(made, self._shades)

    def _shaded(
        self, symbol: str, inputs: _Inputs, rows: Integers
    ) -> tuple[list[str], Integers | None]:
        """Names of the shades of a material, and their numbers by triangle."""
        corners, colors = rows[:, :, inputs.shade], inputs.colors
        if colors is None or corners.min() < 0 or corners.max() >= len(colors):
            return [symbol], None
        shades, slots = shaded(colors[corners].mean(axis=1), Material(symbol, WHITE.color))
        self._shades |= {shade.name: (symbol, shade.color) for shade in shades}
        return [shade.name for shade in shades], slots

    def _textured(self, primitive: Node, uvs: Array, corners: Integers) -> Array:
        """Texture coordinates (m, 3, 2) of triangles; those that are not there become the first."""
        wrong = (corners < 0) | (corners >= len(uvs))
        if wrong.any():
            text = f"{int(wrong.sum())} corners have texture coordinates that are not there"
            self._document.note(primitive, text)
        return np.asarray(uvs[np.where(wrong, 0, corners)])

    # ---- inputs ----------------------------------------------------------------------------

    def _inputs(self, mesh: Node, primitive: Node) -> _Inputs | None:
        stride, vertex = 1, None
        points: Array | None = None
        texture, uvs = None, None
        shade, colors = 0, None
        for entry in primitive.all("input"):
            offset = whole_number(self._document, entry, "offset", 0)
            stride = max(stride, offset + 1)
            target = self._ids.get(entry.get("source").removeprefix("#"))
            match entry.get("semantic"):
                case "VERTEX" if target is not None:
                    vertex = offset
                    for inner in target.all("input"):
                        found = self._source(inner)
                        if inner.get("semantic") == "POSITION":
                            points = found
                        elif inner.get("semantic") == "TEXCOORD" and uvs is None:
                            texture, uvs = offset, found
                        elif inner.get("semantic") == "COLOR" and colors is None:
                            shade, colors = offset, found
                case "POSITION" if points is None:
                    vertex, points = offset, self._source(entry)
                case "TEXCOORD" if uvs is None or entry.get("set") == "0":
                    texture, uvs = offset, self._look_source(entry, "pictures")
                case "COLOR" if colors is None:
                    shade, colors = offset, self._look_source(entry, "colours")
        if vertex is None or points is None or points.shape[1] < 3:
            self._findings.warn(
                self._document.path.name, f"line {primitive.line}: {primitive.tag} without places"
            )
            return None
        flat = None if uvs is None or uvs.shape[1] < 2 or not len(uvs) else uvs[:, :2]
        if colors is not None and (colors.shape[1] < 3 or not len(colors)):
            colors = None
        rgb = None if colors is None else colors[:, :3]
        return _Inputs(stride, vertex, self._shared(points), texture, flat, shade, rgb)

    def _shared(self, points: Array) -> Array:
        """Three columns, bent; the same array for the same source."""
        key = id(points)
        if key not in self._points:
            found = points[:, :3]
            self._points[key] = found if self._bend is None else self._bend(found)
        return self._points[key]

    def _look_source(self, entry: Node, what: str) -> Array | None:
        """Texture coordinates or colours; None, and a note of what is lost, if there are none."""
        try:
            return self._source(entry)
        except MapImportError as error:
            self._findings.warn(self._document.path.name, f"{error}; its {what} are left out")
            return None

    def _source(self, entry: Node) -> Array:
        """Values of the source that an input names; the same array for the same source."""
        source = self._ids.get(entry.get("source").removeprefix("#"))
        if id(source) not in self._sources:
            self._sources[id(source)] = source_values(self._document, self._ids, entry)
        return self._sources[id(source)]

    # ---- primitives ------------------------------------------------------------------------

    def _rows(self, primitive: Node, inputs: _Inputs) -> Integers:
        """Triangles (t, 3, stride): the row of indices of every corner."""
        match primitive.tag:
            case "triangles":
                rows = self._corners(primitive.child("p"), inputs)
                found = rows[: len(rows) // 3 * 3].reshape(-1, 3, inputs.stride)
            case "polylist":
                found = self._polylist(primitive, inputs)
            case "polygons":
                found = self._polygons(primitive, inputs)
            case _:
                found = self._chains(primitive, inputs)
        return found

    def _corners(self, indices: Node | None, inputs: _Inputs) -> Integers:
        """Rows of indices, those of vertices checked."""
        if indices is None:
            return np.zeros((0, inputs.stride), dtype=np.int64)
        values = self._document.integers(indices)
        rows = values[: len(values) // inputs.stride * inputs.stride].reshape(-1, inputs.stride)
        column, count = rows[:, inputs.vertex], len(inputs.points)
        if len(column) and not 0 <= column.min() <= column.max() < count:
            worst = int(column.max()) if column.min() >= 0 else int(column.min())
            raise self._document.error(indices, f"index {worst} of {count} entries")
        return rows

    def _polylist(self, primitive: Node, inputs: _Inputs) -> Integers:
        rows = self._corners(primitive.child("p"), inputs)
        counts = primitive.child("vcount")
        sizes = np.zeros(0, dtype=np.int64) if counts is None else self._document.integers(counts)
        if len(sizes) and (sizes.min() < 0 or sizes.max() > len(rows) or sizes.sum() > len(rows)):
            problem = f"{len(rows)} corners for polygons of {sizes.sum()}"
            raise self._document.error(primitive, problem)
        rows = rows[: int(sizes.sum())]
        triangles, _ = triangulate(inputs.points[rows[:, inputs.vertex]], sizes)
        return rows[triangles]

    def _polygons(self, primitive: Node, inputs: _Inputs) -> Integers:
        """Polygons one by one, those in `ph` with holes."""
        simple = [self._corners(p, inputs) for p in primitive.all("p")]
        rows = np.concatenate([np.zeros((0, inputs.stride), dtype=np.int64), *simple])
        sizes = np.array([len(ring) for ring in simple], dtype=np.int64)
        triangles, _ = triangulate(inputs.points[rows[:, inputs.vertex]], sizes)
        found = [rows[triangles]]
        for polygon in primitive.all("ph"):
            outline = self._corners(polygon.child("p"), inputs)
            holes = [self._corners(hole, inputs) for hole in polygon.all("h")]
            corners = triangulate_one(
                inputs.points[outline[:, inputs.vertex]],
                [inputs.points[hole[:, inputs.vertex]] for hole in holes],
            )
            every = np.concatenate([outline, *holes])
            found.append(every[corners])
        return np.concatenate(found)

    def _chains(self, primitive: Node, inputs: _Inputs) -> Integers:
        """Strips and fans."""
        found = [np.zeros((0, 3, inputs.stride), dtype=np.int64)]
        for chain in primitive.all("p"):
            rows = self._corners(chain, inputs)
            if len(rows) < 3:
                continue
            if primitive.tag == "trifans":
                first = np.repeat(rows[:1], len(rows) - 2, axis=0)
                found.append(np.stack([first, rows[1:-1], rows[2:]], axis=1))
                continue
            triangles = np.stack([rows[:-2], rows[1:-1], rows[2:]], axis=1)
            triangles[1::2] = triangles[1::2][:, [1, 0, 2]]
            found.append(triangles)
        return np.concatenate(found)
