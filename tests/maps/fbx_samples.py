"""Small FBX files, written from scratch: text 6.1 as Blender 2.4x and 2.5 wrote it, text 7.x and
binary 7.x.

A file is a list of `Fbx` objects, connections between them, and settings; each kind of file is
written from the same list.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

Point = tuple[float, float, float]

X, Y, Z = 0, 1, 2
CUBE_POINTS: list[Point] = [(x, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)]
CUBE_FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


@dataclass
class Dom:
    """A node of the file: name, values (a list is an array), and nodes inside."""

    name: str
    values: tuple[Any, ...] = ()
    inside: list[Dom] = field(default_factory=list)
    bracket: bool = False
    """It has brackets even if there is nothing inside."""


def dom(name: str, *values: Any, inside: Iterable[Dom] = (), bracket: bool = False) -> Dom:
    """A node, shorter."""
    return Dom(name, values, list(inside), bracket)


@dataclass
class Fbx:
    """An object of a file.

    Attributes:
        kind: `Model`, `Geometry`, `NodeAttribute`, `Material`, `Texture`, `Video`, `Deformer`, ...
        name: without the kind in front.
        sub: third word of its line, `Mesh`, `Null`, `LodGroup`, ...
        properties: (name, type, values).
        inside: other nodes in it.
        number: that connections name in files of version 7.
    """

    kind: str
    name: str
    sub: str = ""
    properties: list[tuple[str, str, tuple[Any, ...]]] = field(default_factory=list)
    inside: list[Dom] = field(default_factory=list)
    number: int = 0


def prop(name: str, *values: Any, kind: str = "") -> tuple[str, str, tuple[Any, ...]]:
    """A property; its type is guessed from its values."""
    if not kind:
        first = values[0]
        names = {bool: "bool", int: "int", float: "double", str: "KString"}
        kind = "Vector3D" if len(values) == 3 else names[type(first)]
    return name, kind, values


def mesh_nodes(
    points: Sequence[Point],
    faces: Sequence[Sequence[int]],
    *,
    slots: Sequence[int] | None = None,
    uvs: Sequence[tuple[float, float]] | None = None,
    colors: Sequence[tuple[float, float, float, float]] | None = None,
) -> list[Dom]:
    """Nodes of a geometry; `slots` by face, `uvs` and `colors` by corner."""
    ends = [[*face[:-1], -face[-1] - 1] for face in faces]
    found = [
        dom("Vertices", [float(value) for point in points for value in point]),
        dom("PolygonVertexIndex", [index for face in ends for index in face]),
        dom("GeometryVersion", 124),
    ]
    layer = []
    if slots is not None:
        same = len(set(slots)) == 1
        found.append(
            dom("LayerElementMaterial", 0, inside=[
                dom("Version", 101), dom("Name", ""),
                dom("MappingInformationType", "AllSame" if same else "ByPolygon"),
                dom("ReferenceInformationType", "IndexToDirect"),
                dom("Materials", [slots[0]] if same else list(slots)),
            ])
        )  # fmt: skip
        layer.append("LayerElementMaterial")
    for word, values, numbers in (("UV", uvs, "UVIndex"), ("Color", colors, "ColorIndex")):
        if values is None:
            continue
        found.append(
            dom(f"LayerElement{word}", 0, inside=[
                dom("Version", 101), dom("Name", "one"),
                dom("MappingInformationType", "ByPolygonVertex"),
                dom("ReferenceInformationType", "IndexToDirect"),
                dom("Colors" if word == "Color" else "UV",
                    [float(value) for row in values for value in row]),
                dom(numbers, list(range(len(values)))),
            ])
        )  # fmt: skip
        layer.append(f"LayerElement{word}")
    found.append(
        dom("Layer", 0, inside=[dom("Version", 100), *(
            dom("LayerElement", inside=[dom("Type", name), dom("TypedIndex", 0)]) for name in layer
        )])
    )  # fmt: skip
    return found


class FbxFile:
    """A file to be written."""

    def __init__(self, up: int = Z, unit: float | None = 1.0, **settings: Any) -> None:
        """Right-handed axes with this one up, and centimetres per unit."""
        front, sign = (Y, -1) if up == Z else (Z, 1)
        axes = {
            "UpAxis": up, "UpAxisSign": 1, "FrontAxis": front, "FrontAxisSign": sign,
            "CoordAxis": X, "CoordAxisSign": 1,
        }  # fmt: skip
        self.settings: dict[str, Any] = axes | settings
        if unit is not None:
            self.settings["UnitScaleFactor"] = float(unit)
        self.objects: list[Fbx] = []
        self.links: list[tuple[Fbx, Fbx | None, str]] = []

    def add(
        self,
        kind: str,
        name: str,
        sub: str = "",
        *properties: tuple[str, str, tuple[Any, ...]],
        to: Fbx | None = None,
        by: str = "",
        inside: Iterable[Dom] = (),
    ) -> Fbx:
        """Add an object, connected `to` another one, by a property of that one if `by` says so."""
        thing = Fbx(kind, name, sub, list(properties), list(inside), 1000 + len(self.objects))
        self.objects.append(thing)
        if to is not None or kind == "Model":
            self.links.append((thing, to, by))
        return thing

    def model(self, name: str, sub: str = "Null", *properties: Any, to: Fbx | None = None) -> Fbx:
        """A node, by default an empty one."""
        thing = self.add("Model", name, sub, *properties, to=to)
        if sub not in ("Mesh", ""):
            self.add("NodeAttribute", name, sub, to=thing, inside=[dom("TypeFlags", sub)])
        return thing

    def mesh(
        self,
        name: str,
        points: Sequence[Point] = CUBE_POINTS,
        faces: Sequence[Sequence[int]] = CUBE_FACES,
        *properties: Any,
        size: float = 1.0,
        at: Point = (0.0, 0.0, 0.0),
        to: Fbx | None = None,
        materials: Sequence[Fbx] = (),
        **layers: Any,
    ) -> Fbx:
        """A node with a mesh, by default a cube whose lowest corner is at the node's place."""
        grown = [(x * size, y * size, z * size) for x, y, z in points]
        thing = self.add(
            "Model", name, "Mesh", prop("Lcl Translation", *at, kind="Lcl Translation"),
            *properties, to=to,
        )  # fmt: skip
        self.add("Geometry", name, "Mesh", to=thing, inside=mesh_nodes(grown, faces, **layers))
        self.links += [(material, thing, "") for material in materials]
        return thing

    def material(self, name: str, color: Point, *properties: Any) -> Fbx:
        """A plain surface."""
        return self.add(
            "Material", name, "", prop("DiffuseColor", *color, kind="Color"), *properties,
            inside=[dom("ShadingModel", "phong"), dom("MultiLayer", 0)],
        )  # fmt: skip

    def picture(
        self, material: Fbx, path: str, content: bytes | None = None, by: str = "DiffuseColor"
    ) -> Fbx:
        """A texture of a material, with the picture inside the file if there is content."""
        texture = self.add(
            "Texture", "Picture", "TextureVideoClip", to=material, by=by,
            inside=[
                dom("Type", "TextureVideoClip"), dom("FileName", path),
                dom("RelativeFilename", path),
            ],
        )  # fmt: skip
        inside = [dom("Type", "Clip"), dom("Filename", path), dom("RelativeFilename", path)]
        if content is not None:
            inside.append(dom("Content", content))
        self.add("Video", "Picture", "Clip", to=texture, inside=inside)
        return texture

    # ---- files -----------------------------------------------------------------------------

    def text6(self) -> bytes:
        """As Blender 2.4x and 2.5 wrote it: 6.1."""
        inside = []
        for thing in self.objects:
            if thing.kind in ("Geometry", "NodeAttribute"):
                continue
            own = [owned for owned, owner, _ in self.links
                   if owner is thing and owned.kind in ("Geometry", "NodeAttribute")]  # fmt: skip
            properties = [*thing.properties, *(p for one in own for p in one.properties)]
            nodes = [node for one in own for node in one.inside]
            if self._textures(thing):
                nodes.append(
                    dom("LayerElementTexture", 0, inside=[
                        dom("Version", 101), dom("Name", "one"),
                        dom("MappingInformationType", "AllSame"),
                        dom("ReferenceInformationType", "IndexToDirect"),
                        dom("BlendMode", "Translucent"), dom("TextureAlpha", 1),
                        dom("TextureId", [0]),
                    ])
                )  # fmt: skip
                nodes.append(
                    dom("Layer", 1, inside=[
                        dom("Version", 100),
                        dom("LayerElement", inside=[
                            dom("Type", "LayerElementTexture"), dom("TypedIndex", 0),
                        ]),
                    ])
                )  # fmt: skip
            inside.append(
                dom(thing.kind, f"{thing.kind}::{thing.name}", thing.sub, inside=[
                    dom("Version", 232), _properties(properties, "60"), *thing.inside, *nodes,
                ])
            )  # fmt: skip
        inside.append(dom("GlobalSettings", inside=[dom("Version", 1000), self._global("60")]))
        links = []
        for one, other, _ in self.links:
            if one.kind in ("Geometry", "NodeAttribute"):
                continue
            # Textures hang on nodes there.
            owners = [owner for material, owner, _ in self.links if material is other] \
                if one.kind == "Texture" else [other]  # fmt: skip
            links += [
                dom("Connect", "OO", f"{one.kind}::{one.name}",
                    "Model::Scene" if owner is None else f"{owner.kind}::{owner.name}")
                for owner in owners
            ]  # fmt: skip
        takes = dom("Takes", inside=[dom("Current", "")])
        nodes = [_header(6100), dom("Objects", inside=inside), dom("Connections", inside=links)]
        lines = ["; FBX 6.1.0 project file", *_text([*nodes, takes], "", old=True)]
        return "\n".join([*lines, ""]).encode()

    def dom7(self, version: int = 7400) -> list[Dom]:
        """All nodes of a file of version 7."""
        objects = [
            dom(thing.kind, thing.number, (thing.name, thing.kind), thing.sub, inside=[
                _properties(thing.properties, "70"), *thing.inside,
            ])
            for thing in self.objects
        ]  # fmt: skip
        links = [
            dom("C", "OP" if by else "OO", one.number, 0 if other is None else other.number,
                *([by] if by else []))
            for one, other, by in self.links
        ]  # fmt: skip
        return [
            _header(version),
            dom("GlobalSettings", inside=[dom("Version", 1000), self._global("70")]),
            dom("Objects", inside=objects, bracket=True),
            dom("Connections", inside=links, bracket=True),
        ]

    def text7(self, version: int = 7400) -> bytes:
        """Text of version 7."""
        lines = [f"; FBX {version // 1000}.{version // 100 % 10}.0 project file"]
        return "\n".join([*lines, *_text(self.dom7(version), "", old=False), ""]).encode()

    def binary(self, version: int = 7400, *, packed: bool = False) -> bytes:
        """Binary of version 7; from 7.5 on with 64 bits for places."""
        wide = version >= 7500
        content = bytearray(b"Kaydara FBX Binary  \0\x1a\0" + struct.pack("<I", version))
        for node in self.dom7(version):
            _binary(content, node, wide, packed)
        content += bytes(25 if wide else 13)
        content += bytes(16 - len(content) % 16) + struct.pack("<I", version) + bytes(120)
        return bytes(content + bytes.fromhex("f85a8c6adef5d97eece90ce375" + "8f290b"))

    def all(self) -> dict[str, bytes]:
        """The same file in every way it can be written."""
        return {
            "text 6.1": self.text6(),
            "text 7.4": self.text7(),
            "text 7.7": self.text7(7700),
            "binary 7.1": self.binary(7100),
            "binary 7.4": self.binary(),
            "binary 7.4 packed": self.binary(packed=True),
            "binary 7.5": self.binary(7500),
            "binary 7.7": self.binary(7700, packed=True),
        }

    def _textures(self, model: Fbx) -> list[Fbx]:
        """Of the materials of a node."""
        materials = [one for one, owner, _ in self.links if owner is model]
        return [one for one, owner, _ in self.links if one.kind == "Texture"
                and any(owner is other for other in materials)]  # fmt: skip

    def _global(self, version: str) -> Dom:
        return _properties([prop(name, value) for name, value in self.settings.items()], version)


def _header(version: int) -> Dom:
    return dom("FBXHeaderExtension", inside=[
        dom("FBXHeaderVersion", 1003), dom("FBXVersion", version), dom("Creator", "these tests"),
    ])  # fmt: skip


def _properties(properties: Iterable[tuple[str, str, tuple[Any, ...]]], version: str) -> Dom:
    word = "P" if version == "70" else "Property"
    between = ("",) if version == "70" else ()
    return dom(
        f"Properties{version}",
        inside=[dom(word, name, kind, *between, "A", *map(_number, values))
                for name, kind, values in properties],
        bracket=True,
    )  # fmt: skip


def _number(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else value


def _text(nodes: Iterable[Dom], indent: str, *, old: bool) -> Iterable[str]:
    for node in nodes:
        arrays = [value for value in node.values if isinstance(value, list)]
        if arrays:
            words = ",".join(_word(value) for value in arrays[0])
            if old:
                yield f"{indent}{node.name}: {words}"
            else:
                yield f"{indent}{node.name}: *{len(arrays[0])} {{"
                yield f"{indent}\ta: {words}"
                yield f"{indent}}}"
            continue
        words = ", ".join(map(_word, node.values))
        if not node.inside and not node.bracket:
            yield f"{indent}{node.name}: {words}"
            continue
        yield f"{indent}{node.name}: {words} {{"
        yield from _text(node.inside, indent + "\t", old=old)
        yield f"{indent}}}"


def _word(value: Any) -> str:
    match value:
        case bytes():
            import base64

            return f'\n"{base64.b64encode(value).decode()}"' if value else '""'
        case str():
            return '"' + value.replace('"', "&quot;") + '"'
        case (name, kind):
            return f'"{kind}::{name}"'
        case float():
            return f"{value:.9g}"
    return str(value)


def _binary(content: bytearray, node: Dom, wide: bool, packed: bool) -> None:
    """Append a node: where it ends, how many values it has and their bytes, name, values, nodes."""
    head = struct.Struct("<QQQB" if wide else "<IIIB")
    start = len(content)
    name = node.name.encode()
    values = b"".join(_value(value, packed) for value in node.values)
    content += bytes(head.size) + name + values
    for child in node.inside:
        _binary(content, child, wide, packed)
    if node.inside or node.bracket:
        content += bytes(head.size)
    head.pack_into(content, start, len(content), len(node.values), len(values), len(name))


def _value(value: Any, packed: bool) -> bytes:
    match value:
        case list():
            kind, code = (b"d", "d") if isinstance(value[0], float) else (b"i", "i")
            plain = struct.pack(f"<{len(value)}{code}", *value)
            stored = zlib.compress(plain) if packed else plain
            return kind + struct.pack("<III", len(value), packed, len(stored)) + stored
        case bytes():
            return b"R" + struct.pack("<I", len(value)) + value
        case str():
            return b"S" + struct.pack("<I", len(value.encode())) + value.encode()
        case (name, kind):
            word = name.encode() + b"\0\1" + kind.encode()
            return b"S" + struct.pack("<I", len(word)) + word
        case float():
            return b"D" + struct.pack("<d", value)
    return b"L" + struct.pack("<q", value)
