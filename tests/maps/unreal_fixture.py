"""Writes small UDK packages: tables, properties, brushes, a built level, static meshes, hulls.

The counterpart of the reader, written from the description of the format (worlds reference 5), so
that tests need no map of others. Numbers are Unreal units; points of brushes are in their frame.
"""

from __future__ import annotations

import itertools
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

from t3d_maps import cuboid

Triple = tuple[float, float, float]
Points = Sequence[Triple]

TAG = 0x9E2A83C1
STACK = 0x0200_0000_0000_0000
NORMAL = 0x0007_0000_0000_0000
VERSION = 860

BASES = {"Core", "Engine"}


@dataclass
class Object:
    """An export: `data` is made when the package is written, for it holds indices and offsets."""

    kind: str
    name: str
    outer: Object | None = None
    actor: bool = False
    archetype: Object | None = None
    properties: list[tuple[str, object]] = field(default_factory=list)
    tail: list[object] = field(default_factory=list)


@dataclass(frozen=True)
class Enumeration:
    """A value of a byte property."""

    type: str
    value: str


@dataclass(frozen=True)
class Struct:
    """A structure: raw bytes, or tagged properties."""

    type: str
    content: bytes | list[tuple[str, object]]


@dataclass(frozen=True)
class Structs:
    """A list of structures with tagged properties."""

    items: list[list[tuple[str, object]]]


@dataclass(frozen=True)
class Raw:
    """A list as bytes, its length included."""

    content: bytes


@dataclass(frozen=True)
class Ref:
    """An object of this package, of another one by its path, or nothing."""

    target: Object | str | None
    kind: str = "Object"


@dataclass(frozen=True)
class Name:
    """A name."""

    text: str


@dataclass(frozen=True)
class Here:
    """Where the following byte will be in the file: bulk data tell it."""


def vector(x: float, y: float, z: float) -> Struct:
    """X, Y, Z."""
    return Struct("Vector", struct.pack("<3f", x, y, z))


def rotator(pitch: int = 0, yaw: int = 0, roll: int = 0) -> Struct:
    """In rotation units."""
    return Struct("Rotator", struct.pack("<3i", pitch, yaw, roll))


def matrix(rows: Sequence[Triple]) -> Struct:
    """Axes and place; each is stored as W, X, Y, Z."""
    last = (0.0, 0.0, 0.0, 1.0)
    data = b"".join(struct.pack("<4f", w, *row) for w, row in zip(last, rows, strict=True))
    return Struct("Matrix", data)


class Writer:
    """A package being written.

    Attributes:
        objects: exports in the order of the table.
        flags, version: of the header.
    """

    def __init__(self, version: int = VERSION, flags: int = 0x20001) -> None:
        self.objects: list[Object] = []
        self.flags = flags
        self.version = version
        self._names: dict[str, int] = {"None": 0}
        self._imports: list[tuple[str, str, int, str]] = []
        self._known: dict[tuple[str, str], int] = {}

    def add(self, item: Object) -> Object:
        """One more export."""
        self.objects.append(item)
        return item

    # ---- tables ----------------------------------------------------------------------------

    def name(self, text: str) -> bytes:
        """Reference to a name; `Brush_3` is the name `Brush` with the number 4."""
        base, _, last = text.rpartition("_")
        number = 0
        if base and last.isdigit() and (last == "0" or not last.startswith("0")):
            text, number = base, int(last) + 1
        return struct.pack("<2i", self._names.setdefault(text, len(self._names)), number)

    def index(self, reference: Ref) -> int:
        """Object index."""
        if reference.target is None:
            return 0
        if isinstance(reference.target, str):
            return self._import(reference.target, reference.kind)
        return self.objects.index(reference.target) + 1

    def _import(self, path: str, kind: str) -> int:
        key = (path.lower(), kind)
        if key not in self._known:
            outer, _, name = path.rpartition(".")
            inside = self._import(outer, "Package") if outer else 0
            package = "Core" if kind in ("Package", "Class") else "Engine"
            self._imports.append((package, kind, inside, name))
            self._known[key] = -len(self._imports)
        return self._known[key]

    # ---- values ----------------------------------------------------------------------------

    def tagged(self, properties: Sequence[tuple[str, object]]) -> bytes:
        """A list of properties up to `None`."""
        return b"".join(self._property(n, v) for n, v in properties) + self.name("None")

    def _property(self, name: str, value: object) -> bytes:
        name, _, index = name.partition("[")
        number = int(index.rstrip("]") or 0)
        kind, word, data = self._value(value)
        size = 0 if kind == "BoolProperty" else len(data)
        head = self.name(name) + self.name(kind) + struct.pack("<2i", size, number)
        return head + (self.name(word) if word else b"") + data

    def _value(self, value: object) -> tuple[str, str, bytes]:
        match value:
            case bool():
                return "BoolProperty", "", bytes([value])
            case int():
                return "IntProperty", "", struct.pack("<i", value)
            case float():
                return "FloatProperty", "", struct.pack("<f", value)
            case Name():
                return "NameProperty", "", self.name(value.text)
            case str():
                return "StrProperty", "", string(value)
            case Ref():
                return "ObjectProperty", "", struct.pack("<i", self.index(value))
            case Enumeration():
                return "ByteProperty", value.type, self.name(value.value)
            case Struct(type=kind, content=bytes() as content):
                return "StructProperty", kind, content
            case Struct(type=kind, content=content):
                assert isinstance(content, list)
                return "StructProperty", kind, self.tagged(content)
            case Structs():
                items = b"".join(self.tagged(item) for item in value.items)
                return "ArrayProperty", "", struct.pack("<i", len(value.items)) + items
            case Raw():
                return "ArrayProperty", "", value.content
            case list():
                references = struct.pack(f"<{len(value)}i", *map(self.index, value))
                return "ArrayProperty", "", struct.pack("<i", len(value)) + references
        raise TypeError(value)

    def _data(self, item: Object, offset: int) -> bytes:
        if item.actor:
            kind = self.index(Ref(f"Engine.{item.kind}", "Class"))
            head = struct.pack("<iiIHii", kind, kind, 0xFFFFFFFF, 0, 0, -1)
        elif item.kind.endswith("Component"):
            head = struct.pack("<i", 0)
        else:
            head = b""
        data = bytearray(head + struct.pack("<i", self.objects.index(item)))
        data += self.tagged(item.properties)
        for piece in item.tail:
            match piece:
                case bytes():
                    data += piece
                case Ref():
                    data += struct.pack("<i", self.index(piece))
                case Name():
                    data += self.name(piece.text)
                case Here():
                    data += struct.pack("<i", offset + len(data) + 4)
                case _:
                    raise TypeError(piece)
        return bytes(data)

    # ---- the file --------------------------------------------------------------------------

    def content(self, compression: int = 0, pack: object = None) -> bytes:
        """The package.

        Args:
            compression: flag of the header; 0 for none.
            pack: function that compresses a block.
        """
        self._layout(0, compression)  # once, to learn all names and imports
        start = self._layout(0, compression)[1]
        body, start = self._layout(start, compression)
        if not compression:
            return body
        assert callable(pack)
        return _compressed(body, start, pack)

    def _layout(self, start: int, compression: int) -> tuple[bytes, int]:
        """All bytes, and the size of the header; offsets are right if it was given."""
        kinds = [self.index(Ref(f"Engine.{o.kind}", "Class")) for o in self.objects]
        own = [self.name(o.name) for o in self.objects]
        imports = b"".join(
            self.name(p) + self.name(k) + struct.pack("<i", outer) + self.name(n)
            for p, k, outer, n in self._imports
        )
        names = b"".join(string(n) + struct.pack("<Q", 0x70010) for n in self._names)
        size = len(self.objects) * 68
        places = [start, start + len(names), start + len(names) + len(imports)]
        offset = places[2] + size
        datas: list[bytes] = []
        table = b""
        for item, kind, name in zip(self.objects, kinds, own, strict=True):
            data = self._data(item, offset)
            outer = 0 if item.outer is None else self.objects.index(item.outer) + 1
            ancestor = 0 if item.archetype is None else self.objects.index(item.archetype) + 1
            flags = NORMAL | (STACK if item.actor else 0)
            table += struct.pack("<3i", kind, 0, outer) + name
            table += struct.pack("<iQ2iI", ancestor, flags, len(data), offset, 0)
            table += struct.pack("<i16sI", 0, b"", 0)
            datas.append(data)
            offset += len(data)
        header = struct.pack("<IHHi", TAG, self.version, 0, places[2] + size)
        header += string("None") + struct.pack("<I", self.flags)
        header += struct.pack("<2i", len(self._names), places[0])
        header += struct.pack("<2i", len(self.objects), places[2])
        header += struct.pack("<2i", len(self._imports), places[1])
        header += struct.pack("<5i16s", offset, 0, 0, 0, 0, b"fixture")
        header += struct.pack("<4i", 1, len(self.objects), len(self._names), 0)
        header += struct.pack("<3I", 9953, 0, compression)
        header += struct.pack("<i", 1 if compression else 0) + bytes(16 if compression else 0)
        return header + names + imports + table + b"".join(datas), len(header)


def string(text: str) -> bytes:
    """With its length; UTF-16 where Latin-1 does not do."""
    try:
        data = text.encode("latin-1") + b"\0"
    except UnicodeEncodeError:
        data = text.encode("utf-16-le") + b"\0\0"
        return struct.pack("<i", -len(data) // 2) + data
    return struct.pack("<i", len(data)) + data


def blocks(content: bytes, pack: object, size: int = 0x20000) -> bytes:
    """A compressed part: tag, block size, totals, pairs, blocks."""
    assert callable(pack)
    raw = [content[i : i + size] for i in range(0, len(content), size)]
    packed = [pack(block) for block in raw]
    head = struct.pack("<IiII", TAG, size, sum(map(len, packed)), len(content))
    pairs = b"".join(struct.pack("<2i", len(p), len(r)) for p, r in zip(packed, raw, strict=True))
    return head + pairs + b"".join(packed)


def _compressed(body: bytes, start: int, pack: object) -> bytes:
    part = blocks(body[start:], pack)
    chunk = struct.pack("<4i", start, len(body) - start, start, len(part))
    return body[: start - 16] + chunk + part


def zlib_pack(block: bytes) -> bytes:
    """As UE3 does with its flag 1."""
    return zlib.compress(block)


# ---- what maps hold ------------------------------------------------------------------------


def polygon(points: Points, material: str = "Pack.Wall_Mat", flags: int = 3584) -> list[object]:
    """A polygon of `Polys`; its texture axes are those of the first edge and across it."""
    base, second, *_ = points
    along = [b - a for a, b in zip(base, second, strict=True)]
    length = sum(v * v for v in along) ** 0.5 or 1.0
    u = [v / length for v in along]
    third = points[-1] if len(points) < 3 else points[2]
    across = [b - a for a, b in zip(second, third, strict=True)]
    length = sum(v * v for v in across) ** 0.5 or 1.0
    v = [w / length for w in across]
    data = struct.pack("<12f", *base, 0.0, 0.0, 0.0, *u, *v)
    data += struct.pack("<i", len(points))
    data += b"".join(struct.pack("<3f", *p) for p in points)
    data += struct.pack("<Ii", flags, 0)
    tail = struct.pack("<2ifI36s", -1, -1, 32.0, 3, b"")
    return [data, Name("None"), Ref(material, "Material"), tail, Name("None")]


def model(nodes: bytes = b"", outside: int = 1, polys: Object | None = None) -> list[object]:
    """What follows the properties of a `Model`."""
    empty = [struct.pack("<2i", size, 0) for size in (12, 12)]
    return [
        struct.pack("<7f", *(0.0,) * 7),
        *empty,
        struct.pack("<2i", 64, len(nodes) // 64) + nodes,
        struct.pack("<2i", 0, 0),
        struct.pack("<2i", 24, 0),
        struct.pack("<2i", 0, 0),
        Ref(polys),
        struct.pack("<2i", 4, 0),
        struct.pack("<2i", 4, 0),
        struct.pack("<2i", outside, 1),
    ]


def node(plane: Sequence[float], back: int = -1, front: int = -1, flags: int = 0) -> bytes:
    """One node of a built level."""
    return struct.pack(
        "<4f3i2Hi4i4B2i", *plane, 0, 0, 0, 0, 0, 0, back, front, -1, -1, 0, 1, 4, flags, -1, -1
    )


def box_nodes(low: Triple, high: Triple) -> bytes:
    """The tree of one solid box: each plane's front is empty, the next node is at its back."""
    planes = []
    for axis in range(3):
        for sign, value in ((-1.0, low[axis]), (1.0, high[axis])):
            normal = [0.0, 0.0, 0.0]
            normal[axis] = sign
            planes.append((*normal, sign * value))
    return b"".join(node(p, i + 1 if i < 5 else -1) for i, p in enumerate(planes))


class Map(Writer):
    """A map with a level; actors are added in the order of the level."""

    def __init__(self, version: int = VERSION, flags: int = 0x20001) -> None:
        super().__init__(version, flags)
        self.level = self.add(Object("Level", "PersistentLevel"))
        self.actors: list[Object] = []
        self.info = self.actor("WorldInfo", "WorldInfo_0", [("KillZ", -5000.0)])

    def actor(self, kind: str, name: str, properties: Sequence[tuple[str, object]] = ()) -> Object:
        """Any actor."""
        item = Object(kind, name, self.level, actor=True, properties=list(properties))
        self.actors.append(item)
        return self.add(item)

    def brush(
        self,
        name: str,
        faces: Sequence[Points],
        operation: str = "CSG_Add",
        properties: Sequence[tuple[str, object]] = (),
        kind: str = "Brush",
        flags: int = 3584,
    ) -> Object:
        """A brush with its model and polygons."""
        item = self.actor(kind, name)
        inner = self.add(Object("Model", f"Model_{len(self.objects)}", item))
        polys = self.add(Object("Polys", f"Polys_{len(self.objects)}", inner))
        count = len(faces)
        polys.tail = [struct.pack("<2i", count, count), Ref(polys)]
        polys.tail += itertools.chain.from_iterable(polygon(f, flags=flags) for f in faces)
        inner.tail = model(polys=polys)
        item.properties = [("Brush", Ref(inner)), ("Tag", Name(kind)), *properties]
        if operation:
            item.properties.insert(0, ("CsgOper", Enumeration("ECsgOper", operation)))
        return item

    def box(self, name: str, low: Triple, high: Triple, operation: str = "CSG_Add") -> Object:
        """A brush that is a box."""
        return self.brush(name, cuboid(low, high), operation)

    def built(self, nodes: bytes, outside: int = 1) -> Object:
        """The built level."""
        return self.add(Object("Model", "Model_1000", self.level, tail=model(nodes, outside)))

    def start(self, name: str, place: Triple, tag: str = "PlayerStart", yaw: int = 0) -> Object:
        """A start pose."""
        properties = [("Location", vector(*place)), ("Tag", Name(tag))]
        return self.actor("PlayerStart", name, [*properties, ("Rotation", rotator(yaw=yaw))])

    def placed(
        self,
        kind: str,
        name: str,
        mesh: Ref,
        properties: Sequence[tuple[str, object]] = (),
        component: Sequence[tuple[str, object]] = (),
    ) -> Object:
        """An actor with a mesh component."""
        item = self.actor(kind, name)
        inner = Object("StaticMeshComponent", f"StaticMeshComponent_{len(self.objects)}", item)
        self.add(inner)
        inner.properties = [("StaticMesh", mesh), *component]
        item.properties = [("StaticMeshComponent", Ref(inner)), *properties]
        return item

    def content(self, compression: int = 0, pack: object = None) -> bytes:
        """The package, with the list of actors as it is now."""
        references = [Ref(actor) for actor in self.actors]
        self.level.tail = [Ref(self.level), struct.pack("<i", len(references) + 1), *references]
        self.level.tail += [Ref(None), b"\0" * 12]
        return super().content(compression, pack)


def static_mesh(
    writer: Writer,
    name: str,
    triangles: Sequence[Points],
    *,
    group: str = "",
    slots: Sequence[int] | None = None,
    materials: Sequence[str] = ("Pack.Mesh_Mat",),
    body: Sequence[tuple[str, object]] | None = None,
) -> Object:
    """A static mesh as the editor saves it, with triangles in the order of a brush's corners.

    The engine's own order is the reverse (worlds reference 4.4); this is where they are reversed.
    """
    outer = writer.add(Object("Package", group)) if group else None
    item = writer.add(Object("StaticMesh", name, outer))
    setup = None
    if body is not None:
        setup = writer.add(Object("RB_BodySetup", f"RB_BodySetup_{len(writer.objects)}", item))
        setup.properties = [("AggGeom", Struct("KAggregateGeom", list(body)))]
    size = 372 if writer.version >= 823 else 368
    raw = b""
    for number, points in enumerate(triangles):
        corners = list(reversed(points))
        data = struct.pack("<9f", *itertools.chain.from_iterable(corners))
        for x, y, _ in corners:
            data += struct.pack("<16f", x / 100.0, y / 100.0, *(0.0,) * 14)
        data += bytes(12) + struct.pack("<i", slots[number] if slots else 0)
        raw += data.ljust(size, b"\0")
    sections = struct.pack("<i", len(materials))
    tail: list[object] = [struct.pack("<7f", *(0.0,) * 7), Ref(setup)]
    tail += [struct.pack("<6f", *(0.0,) * 6), struct.pack("<2i", 6, 0), struct.pack("<2i", 8, 0)]
    tail += [struct.pack("<i", 18)]
    if writer.version >= 823:
        tail += [struct.pack("<3i", 0, 0, 0)]
    if writer.version >= 859:
        tail += [struct.pack("<i", 0)]
    tail += [struct.pack("<i", 1), struct.pack("<3i", 0, len(triangles), len(raw)), Here(), raw]
    tail += [sections]
    for number, material in enumerate(materials):
        tail += [Ref(material, "Material"), struct.pack("<8i", 1, 1, 1, 0, 0, 0, 0, number)]
        tail += [struct.pack("<iB", 0, 0)]
    item.tail = [*tail, bytes(40)]
    return item


def box_triangles(low: Triple, high: Triple) -> list[list[Triple]]:
    """Twelve triangles whose ordinary cross products point outwards."""
    return [[f[0], f[i], f[i + 1]] for f in cuboid(low, high) for i in (1, 2)]


def convex(points: Points) -> list[tuple[str, object]]:
    """A `KConvexElem`."""
    data = struct.pack("<i", len(points)) + b"".join(struct.pack("<3f", *p) for p in points)
    return [("VertexData", Raw(data)), ("PermutedVertexData", Raw(struct.pack("<i", 0)))]
