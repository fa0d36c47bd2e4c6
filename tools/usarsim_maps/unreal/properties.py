"""Tagged properties of objects: names, types and values, only where they differ from a default.

What makes no sense is a `PackageError`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

from usarsim_maps.unreal.archive import Archive, PackageError
from usarsim_maps.unreal.package import Export, Package

Triple: TypeAlias = tuple[float, float, float]

HAS_STACK = 0x0200_0000_0000_0000
"""Object flag: the state of a script stands before the properties, as in all actors."""

MAX_PROPERTIES = 10_000
MAX_ANCESTORS = 8


@dataclass(frozen=True, slots=True)
class _Value:
    """One property: its type, the name of its structure or enumeration, and where it is."""

    type: str
    kind: str
    flag: bool
    archive: Archive


@dataclass(slots=True)
class Properties:
    """Properties of one object, by name without regard to case; others mean the default.

    What has another type than is asked for counts as absent.
    """

    package: Package
    values: dict[tuple[str, int], _Value] = field(default_factory=dict)

    @classmethod
    def read(cls, package: Package, archive: Archive) -> Properties:
        """Everything up to the name `None`; the cursor stands behind it then."""
        answer = cls(package)
        begin = archive.offset
        package.spend(0)
        for _ in range(MAX_PROPERTIES):
            name = package.name(archive)
            if name == "None":
                package.spend(archive.offset - begin)
                return answer
            kind = package.name(archive)
            start = archive.offset
            size, index = archive.i32s(2)
            word = package.name(archive) if kind in ("StructProperty", "ByteProperty") else ""
            flag = False
            if kind == "BoolProperty":
                flag = archive.u8() != 0
            elif not kind.endswith("Property"):
                raise PackageError(f"property {name} has the type {kind!r}", start)
            value = _Value(kind, word, flag, archive.part(0 if kind == "BoolProperty" else size))
            answer.values.setdefault((name.lower(), index), value)
        raise PackageError(f"more than {MAX_PROPERTIES} properties", archive.offset)

    def __contains__(self, name: str) -> bool:
        return (name, 0) in self.values

    def over(self, base: Properties) -> Properties:
        """These, and those of an archetype where there are none here."""
        return Properties(self.package, base.values | self.values)

    # ---- plain values ----------------------------------------------------------------------

    def number(self, name: str, default: float, index: int = 0) -> float:
        """A finite number."""
        found = self._find(name, index)
        if found is None or found.archive.left < 4:
            return default
        if found.type == "FloatProperty":
            value = found.archive.copy().f32()
            return value if math.isfinite(value) else default
        if found.type == "IntProperty":
            return float(found.archive.copy().i32())
        return default

    def flag(self, name: str, default: bool) -> bool:
        """A truth value."""
        found = self._find(name)
        return found.flag if found is not None and found.type == "BoolProperty" else default

    def text(self, name: str) -> str:
        """A name, a string, or the name of a value of an enumeration; empty by default."""
        found = self._find(name)
        if found is None:
            return ""
        archive = found.archive.copy()
        if found.type == "StrProperty":
            return archive.string()
        if found.type in ("NameProperty", "ByteProperty") and archive.left == 8:
            return self.package.name(archive)
        return ""

    def reference(self, name: str, index: int = 0) -> int:
        """An object index; 0 for nothing."""
        found = self._find(name, index)
        if found is None or found.type not in ("ObjectProperty", "ComponentProperty"):
            return 0
        return found.archive.copy().i32() if found.archive.left == 4 else 0

    def references(self, name: str) -> list[int]:
        """A list of object indices."""
        found = self._find(name)
        if found is None or found.type != "ArrayProperty":
            return []
        archive = found.archive.copy()
        count = archive.count(4, name)
        return list(archive.i32s(count))

    # ---- structures ------------------------------------------------------------------------

    def vector(self, name: str, default: float = 0.0) -> Triple:
        """X, Y, Z; not finite ones count as absent."""
        archive = self._structure(name, "Vector", 12)
        if archive is None:
            return default, default, default
        x, y, z = archive.floats(3).tolist()
        if not all(map(math.isfinite, (x, y, z))):
            return default, default, default
        return x, y, z

    def rotator(self, name: str) -> Triple:
        """Pitch, Yaw, Roll in rotation units."""
        archive = self._structure(name, "Rotator", 12)
        if archive is None:
            return 0.0, 0.0, 0.0
        pitch, yaw, roll = archive.i32s(3)
        return float(pitch), float(yaw), float(roll)

    def color(self, name: str) -> Triple | None:
        """Red, green, blue from 0 to 1 of a Color, which is stored as B, G, R, A."""
        archive = self._structure(name, "Color", 4)
        if archive is None:
            return None
        blue, green, red, _ = archive.bytes(4)
        return red / 255.0, green / 255.0, blue / 255.0

    def structure(self, name: str) -> Properties | None:
        """A structure that holds tagged properties itself."""
        found = self._find(name)
        if found is None or found.type != "StructProperty":
            return None
        return Properties.read(self.package, found.archive.copy())

    def structures(self, name: str) -> Iterator[Properties]:
        """A list of such structures."""
        found = self._find(name)
        if found is None or found.type != "ArrayProperty":
            return
        archive = found.archive.copy()
        for _ in range(archive.count(8, name)):
            yield Properties.read(self.package, archive)

    def raw(self, name: str) -> Archive | None:
        """A cursor over the bytes of a list or structure."""
        found = self._find(name)
        return None if found is None else found.archive.copy()

    def _find(self, name: str, index: int = 0) -> _Value | None:
        return self.values.get((name, index))

    def _structure(self, name: str, kind: str, size: int) -> Archive | None:
        found = self._find(name)
        if found is None or found.kind != kind or found.archive.left < size:
            return None
        return found.archive.copy()


def read_object(package: Package, export: Export) -> tuple[Properties, Archive]:
    """Properties of an export, those of its archetypes included, and a cursor at what follows.

    Only archetypes in the same package are known.
    """
    properties, rest = _own(package, export)
    seen = {export.number}
    ancestor = package.export(export.archetype)
    while ancestor is not None and ancestor.number not in seen and len(seen) < MAX_ANCESTORS:
        seen.add(ancestor.number)
        properties = properties.over(_own(package, ancestor)[0])
        ancestor = package.export(ancestor.archetype)
    return properties, rest


def _own(package: Package, export: Export) -> tuple[Properties, Archive]:
    archive = package.archive(export)
    if export.flags & HAS_STACK:
        node, _ = archive.i32s(2)
        archive.skip(4 + 2)  # probe mask, latent action
        archive.skip(12 * archive.count(12, "stacked states"))
        if node != 0:
            archive.skip(4)
    elif package.class_of(export).lower().endswith("component"):
        return _component(package, archive)
    archive.skip(4)  # net index
    return Properties.read(package, archive), archive


def _component(package: Package, archive: Archive) -> tuple[Properties, Archive]:
    """A component: the class that owns its template, that one's name if it is a template itself."""
    archive.skip(4)
    start = archive.offset
    for head in (4, 8 + 4):
        try:
            archive.skip(head)
            return Properties.read(package, archive), archive
        except PackageError:
            archive = Archive(package.data, start, archive.end)
    raise PackageError("a component without a list of properties", start)
