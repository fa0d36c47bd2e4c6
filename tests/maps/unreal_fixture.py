"""Writes small UDK packages: tables, properties, brushes, a built level, static meshes, hulls.

The counterpart of the reader, written from the description of the format (worlds reference 5), so
that tests need no map of others. Numbers are Unreal units; points of brushes are in their frame.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

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
