"""Small UDK maps, written and read, for the tests of that reader."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Sequence
from pathlib import Path

from built_worlds import World, build_world
from mesh_samples import read, write
from t3d_maps import cuboid
from unreal_fixture import (
    VERSION,
    Enumeration,
    Here,
    Name,
    Object,
    Points,
    Raw,
    Ref,
    Struct,
    Triple,
    Writer,
    rotator,
    vector,
)

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Scene

TABLE = Ref("Furniture.Kitchen.Table", "StaticMesh")
"""A mesh of the package `Furniture.upk`, which most tests do not have."""


def scene_of(
    folder: Path, made: Writer, findings: Findings | None = None, **options: object
) -> Scene:
    """Write a package and read it."""
    return read(write(folder, made.content(), "map.udk"), findings, **options)


def world_of(folder: Path, made: Writer, **options: object) -> World:
    """Write a package, read and build it."""
    findings = Findings()
    return build_world(folder, scene_of(folder, made, findings, **options), findings)


def room() -> Map:
    """A closed room, 4 m square and 3 m high, cut out of the solid; without a built level."""
    made = Map()
    made.box("Room", (-500, -500, 0), (500, 500, 750), "CSG_Subtract")
    made.start("PlayerStart_0", (0, 0, 60))
    return made


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
