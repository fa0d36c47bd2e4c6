"""Reads PLY, text and binary of both byte orders, with texture coordinates and colours.

The format knows neither units nor axes: one unit is taken for a metre and z for up, and the
report says that this was assumed (worlds reference 2.4).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.files import read_bytes
from usarsim_maps.meshes.mesh_files import Pictures, axes_of, broken
from usarsim_maps.meshes.polygons import MAX_TRIANGLES, check_count, make_mesh, triangulate
from usarsim_maps.meshes.vertex_colors import shaded
from usarsim_maps.numbers import read_number, read_whole
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Integers, Material, Part, Scene, SceneObject
from usarsim_server.base.errors import MapImportError, at

MAX_BYTES = 1 << 30
MAX_HEADER = 64 << 10
MAX_PROPERTIES = 200
SHADES = 16
"""Most steps per colour channel: colours of scans differ a little everywhere."""

ORDERS = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    kind: str
    count: str = ""
    """Type of the length of a list; empty: no list."""


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    def has_lists(self) -> bool:
        return any(item.count for item in self.properties)


@dataclass(slots=True)
class _Table:
    """Values of an element: plain columns, and lists as lengths and values one after another."""

    columns: dict[str, Array]
    lists: dict[str, tuple[Integers, Array]]


@register("ply")
class PlyReader(Reader):
    """One mesh."""

    title = "PLY"
    extensions = (".ply",)
    head = re.compile(rb"\A\s*ply\s*([\r\n]|\Z)")

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        axes = axes_of(context.options, "Z", stated=False)
        tables, pictures = _parse(source, read_bytes(source, MAX_BYTES))
        vertex, face = tables.get("vertex"), tables.get("face")
        if vertex is None or not {"x", "y", "z"} <= vertex.columns.keys():
            raise broken(source, "no vertices with x, y and z")
        points = np.column_stack([vertex.columns[axis] for axis in "xyz"])
        corners, sizes, uvs = _corners(source, vertex, face, tables.get("tristrips"), len(points))
        triangles, _ = triangulate(points[corners], sizes)
        if not len(triangles):
            cure = "points alone are not solid; make a mesh of them first"
            raise MapImportError(at(source, "there are no faces in this file", cure))
        finder = Pictures(source, context)
        found = finder.find(pictures[0]) if pictures and uvs is not None else None
        materials = {"": Material("")}
        slots = None
        if found is not None:
            materials = {found.stem: Material(found.stem, (1.0, 1.0, 1.0, 1.0), found)}
        elif {"red", "green", "blue"} <= vertex.columns.keys():
            materials, slots = _shades(vertex, corners[triangles])
        mesh = make_mesh(
            source.stem,
            points,
            corners[triangles],
            uvs=None if uvs is None else uvs[triangles],
            slots=slots,
            materials=list(materials),
            linear=axes.linear,
        )
        context.findings.count("mesh")
        return Scene(
            source=axes.source(source, "PLY", finder.files),
            objects=(SceneObject(source.stem, (Part(mesh),), kind="mesh"),),
            materials={name: material for name, material in materials.items() if name},
        )


# ---- header ----------------------------------------------------------------------------------


def _parse(source: Path, content: bytes) -> tuple[dict[str, _Table], list[str]]:
    """Tables by element, and names of pictures."""
    order, elements, pictures, start = _header(source, content)
    tables: dict[str, _Table] = {}
    if order == "ascii":
        words = content[start:].split()
        place = 0
        for element in elements:
            tables[element.name], place = _ascii(source, element, words, place)
        return tables, pictures
    for element in elements:
        tables[element.name], start = _binary(source, element, content, start, order)
    return tables, pictures


def _header(source: Path, content: bytes) -> tuple[str, list[_Element], list[str], int]:
    end = content.find(b"end_header", 0, MAX_HEADER)
    if not content.startswith(b"ply") or end < 0:
        raise broken(source, "no header of a PLY file")
    start = content.find(b"\n", end) + 1
    if not start:
        start = end + len(b"end_header\r")
    order, elements, pictures = "", [], []
    lines = content[:end].replace(b"\r\n", b"\n").replace(b"\r", b"\n").decode("latin-1")
    for number, line in enumerate(lines.split("\n"), start=1):
        words = line.split()
        try:
            match words:
                case ["format", word, *_]:
                    order = ORDERS[word]
                case ["comment", "TextureFile", *name]:
                    pictures.append(" ".join(name))
                case ["element", name, count]:
                    elements.append(_Element(name.lower(), read_whole(count)))
                    if elements[-1].count < 0:
                        raise ValueError
                case ["property", "list", length, kind, name]:
                    elements[-1].properties.append(
                        _Property(name.lower(), TYPES[kind], TYPES[length])
                    )
                case ["property", kind, name]:
                    elements[-1].properties.append(_Property(name.lower(), TYPES[kind]))
                case ["element" | "property", *_]:
                    raise ValueError
        except (KeyError, ValueError, IndexError):
            problem = f"{line[:60]!r} is no sound line of a header"
            raise broken(source, problem, number) from None
    if not order or any(len(e.properties) > MAX_PROPERTIES for e in elements):
        raise broken(source, "the header has no format that is known")
    return order, elements, pictures, start


def _short(source: Path, element: _Element) -> MapImportError:
    problem = f"the file ends before {element.count} of element {element.name!r}"
    return broken(source, problem)


# ---- values ----------------------------------------------------------------------------------


def _ascii(
    source: Path, element: _Element, words: Sequence[bytes], place: int
) -> tuple[_Table, int]:
    if element.count * max(1, len(element.properties)) > len(words) - place:
        raise _short(source, element)
    width = len(element.properties)
    try:
        if not element.has_lists():
            end = place + element.count * width
            values = _numbers(words[place:end]).reshape(element.count, width)
            columns = {p.name: values[:, k] for k, p in enumerate(element.properties)}
            return _Table(columns, {}), end
        reader = _Reader(words, place)
        return _rows(element, reader), reader.place
    except ValueError as error:
        raise broken(source, f"{error}"[:100], element.name) from None
    except IndexError:
        raise _short(source, element) from None


class _Reader:
    """Values one after another: words of a text, or bytes in the order `<` or `>`."""

    def __init__(self, content: Any, place: int, order: str = "") -> None:
        self._content = content
        self._order = order
        self.place = place

    def take(self, kind: str, count: int) -> list[Any]:
        """So many values; an IndexError if there are not so many."""
        end = self.place + count * (np.dtype(kind).itemsize if self._order else 1)
        if count < 0 or end > len(self._content):
            raise IndexError
        piece = self._content[self.place : end]
        self.place = end
        return np.frombuffer(piece, self._order + kind).tolist() if self._order else list(piece)

    def length(self, kind: str) -> int:
        """The number of values that follow; a ValueError if a word is no whole one."""
        (value,) = self.take(kind, 1)
        if not self._order:
            return read_whole(value)
        if not 0.0 <= value <= len(self._content):
            raise IndexError
        return int(value)


def _rows(element: _Element, reader: _Reader) -> _Table:
    """An element value by value, with lists of any lengths."""
    plain: dict[str, list[Any]] = {p.name: [] for p in element.properties if not p.count}
    lists: dict[str, tuple[list[int], list[Any]]] = {
        p.name: ([], []) for p in element.properties if p.count
    }
    for _ in range(element.count):
        for item in element.properties:
            if not item.count:
                plain[item.name] += reader.take(item.kind, 1)
                continue
            length = reader.length(item.count)
            lists[item.name][0].append(length)
            lists[item.name][1].extend(reader.take(item.kind, length))
    return _Table(
        {name: _numbers(values) for name, values in plain.items()},
        {name: (np.array(n, np.int64), _numbers(values)) for name, (n, values) in lists.items()},
    )


def _numbers(words: Sequence[Any]) -> Array:
    """Values of words, also of those with decimal commas."""
    try:
        return np.array(words, dtype=float)
    except ValueError:
        return np.array([read_number(word.decode("latin-1")) for word in words])


def _binary(
    source: Path, element: _Element, content: bytes, start: int, order: str
) -> tuple[_Table, int]:
    # Nearly always all lists have the length of the first one, and rows a fixed size.
    lengths = _first_lengths(element, content, start, order)
    fields: list[Any] = []
    for number, item in enumerate(element.properties):
        if item.count:
            fields.append((f"n{number}", order + item.count))
            fields.append((f"p{number}", order + item.kind, (lengths.get(number, 0),)))
        else:
            fields.append((f"p{number}", order + item.kind))
    row = np.dtype(fields)
    least = sum(np.dtype(item.count or item.kind).itemsize for item in element.properties)
    if element.count * max(1, least) > len(content) - start:
        raise _short(source, element)
    if element.count * row.itemsize <= len(content) - start:
        rows = np.frombuffer(content, row, element.count, start)
        even = all((rows[f"n{number}"] == length).all() for number, length in lengths.items())
        if even:
            end = start + element.count * row.itemsize
            return _regular(element, rows, lengths), end
    if element.count > 2 * MAX_TRIANGLES:
        check_count(source, element.count)
    reader = _Reader(content, start, order)
    try:
        return _rows(element, reader), reader.place
    except IndexError:
        raise _short(source, element) from None


def _first_lengths(element: _Element, content: bytes, start: int, order: str) -> dict[int, int]:
    lengths: dict[int, int] = {}
    for number, item in enumerate(element.properties):
        if not item.count:
            start += np.dtype(item.kind).itemsize
            continue
        kind = np.dtype(order + item.count)
        piece = content[start : start + kind.itemsize]
        length = float(np.frombuffer(piece, kind)[0]) if len(piece) == kind.itemsize else 0.0
        lengths[number] = int(length) if 0 <= length <= 255 else 0
        start += kind.itemsize + lengths[number] * np.dtype(item.kind).itemsize
    return lengths


def _regular(element: _Element, rows: NDArray[np.void], lengths: dict[int, int]) -> _Table:
    table = _Table({}, {})
    with np.errstate(invalid="ignore"):
        for number, item in enumerate(element.properties):
            values = rows[f"p{number}"].astype(float)
            if item.count:
                sizes = np.full(len(rows), lengths[number], dtype=np.int64)
                table.lists[item.name] = (sizes, values.reshape(-1))
            else:
                table.columns[item.name] = values
    return table


# ---- faces -----------------------------------------------------------------------------------


def _corners(
    source: Path, vertex: _Table, face: _Table | None, strips: _Table | None, count: int
) -> tuple[Integers, Integers, Array | None]:
    """Vertex of every corner, corners of every face, texture place of every corner."""
    empty = np.zeros(0)
    table = (face or _Table({}, {})).lists
    name = next((n for n in ("vertex_indices", "vertex_index") if n in table), "")
    sizes, values = table.get(name, (np.zeros(0, np.int64), empty))
    if not len(sizes) and strips is not None:
        _, chain = strips.lists.get("vertex_indices", (None, empty))
        values = _strips(chain)
        sizes = np.full(len(values) // 3, 3)
    if not np.isfinite(values).all() or (
        len(values) and not 0 <= values.min() <= values.max() <= count - 1
    ):
        raise broken(source, f"a face refers to none of the {count} vertices")
    if int(np.maximum(sizes - 2, 0).sum()) > MAX_TRIANGLES:
        check_count(source, int(sizes.sum()))
    corners = np.rint(values).astype(np.int64)
    wedge = table.get("texcoord")
    if wedge is not None and np.array_equal(wedge[0], 2 * sizes):
        return corners, sizes, wedge[1].reshape(-1, 2)
    for u, v in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")):
        if u in vertex.columns and v in vertex.columns:
            own = np.column_stack([vertex.columns[u], vertex.columns[v]])
            return corners, sizes, own[corners]
    return corners, sizes, None


def _strips(chain: Array) -> Array:
    """Triangles of strips that are separated by -1."""
    found: list[tuple[float, float, float]] = []
    run: list[float] = []
    for value in chain.tolist():
        if value < 0:
            run = []
            continue
        run.append(value)
        if len(run) >= 3:
            a, b, c = run[-3:]
            found.append((a, b, c) if len(run) % 2 else (b, a, c))
    return np.array(found).reshape(-1)


def _shades(vertex: _Table, triangles: Integers) -> tuple[dict[str, Material], Integers]:
    """Materials for coloured vertices, and the slot of every triangle."""
    colors = np.column_stack([vertex.columns[name] for name in ("red", "green", "blue")])
    if np.nanmax(colors, initial=0.0) > 1.0:
        colors = colors / 255.0
    materials, slots = shaded(np.clip(colors, 0.0, 1.0)[triangles].mean(axis=1), finest=SHADES)
    return {material.name: material for material in materials}, slots
