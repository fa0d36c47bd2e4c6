"""The header and the tables of a package: names, imports, exports (worlds reference 5.1)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

from usarsim_maps.unreal.archive import LZO, TAG, ZLIB, Archive, PackageError, inflate_part

OLDEST, NEWEST = 700, 868
"""File versions that are read: the beta releases of UDK from 2010 to the last one of 2015. 832 and
860 were checked against real files (worlds reference 5)."""

UE2 = 200
"""Versions below are of UT2004 and before; from there to `OLDEST` of UT3 and the first UDK."""

COOKED = 0x0000_0008
"""Package flag: stripped for a game."""

MAX_PACKAGE = 512 << 20
"""Bytes of a package when decompressed."""

MAX_RATIO = 60
"""Times that a compressed file may grow; zlib could reach 1 030 with nothing but zeros."""

MAX_PASSES = 16
"""Times that a package is looked at as a whole; real ones are read once."""

MAX_DEPTH = 32
"""Groups within groups."""

AS_T3D = "open it in the editor and export it as T3D"
AGAIN = "the file is damaged or cut off; copy it again, or save it again with the editor"


@dataclass(frozen=True, slots=True)
class Import:
    """An object of another package: its class, what it lies in (an object index), its name."""

    class_name: str
    outer: int
    name: str


@dataclass(frozen=True, slots=True)
class Export:
    """An object of this package."""

    number: int  # from 0, as in the table
    class_index: int  # object indices
    outer: int
    archetype: int
    name: str  # with its number
    flags: int  # of the object
    size: int  # of its data
    offset: int


@dataclass(slots=True)
class Package:
    """A package in memory; what makes no sense in it is a `PackageError`.

    Object indices are positive for exports (number + 1), negative for imports, 0 for nothing.
    """

    data: bytes  # all of it, decompressed
    version: int  # of the file format
    names: list[str]
    imports: list[Import]  # the tables
    exports: list[Export]
    _inside: dict[int, list[Export]] = field(default_factory=dict)
    _spent: int = 0

    def spend(self, size: int) -> None:
        """Count bytes that were looked at, so that a few objects cannot be read a million times.

        Raises:
            PackageError: it is too much for a package of this size.
        """
        self._spent += size
        if self._spent > MAX_PASSES * len(self.data) + (4 << 20):
            raise PackageError("objects that refer to each other over and over", 0, AGAIN)

    def name(self, archive: Archive) -> str:
        """A reference to the name table: `Brush`, or with a number `Brush_3`."""
        return _name(archive, self.names)

    def export(self, index: int) -> Export | None:
        """The export of an object index; None for imports, nothing and nonsense."""
        return self.exports[index - 1] if 0 < index <= len(self.exports) else None

    def object_name(self, index: int) -> str:
        """The name of an object, empty for nothing and nonsense."""
        found = self._entry(index)
        return found.name if found is not None else ""

    def class_of(self, export: Export) -> str:
        """The name of an export's class."""
        return self.object_name(export.class_index) or "Class"

    def class_name(self, index: int) -> str:
        """The name of the class of any object, empty for nothing and nonsense."""
        found = self._entry(index)
        if isinstance(found, Export):
            return self.class_of(found)
        return found.class_name if found is not None else ""

    def path(self, index: int) -> str:
        """`Package.Group.Name` of an import, `Group.Name` of an export."""
        parts: list[str] = []
        while len(parts) < MAX_DEPTH:
            found = self._entry(index)
            if found is None:
                break
            parts.append(found.name)
            index = found.outer
        return ".".join(reversed(parts))

    def of_class(self, *names: str) -> Iterator[Export]:
        """All exports of some classes, in the order of the table."""
        wanted = {name.lower() for name in names}
        return (export for export in self.exports if self.class_of(export).lower() in wanted)

    def inside(self, export: Export) -> list[Export]:
        """Exports whose outer is this one."""
        if not self._inside and self.exports:
            table: defaultdict[int, list[Export]] = defaultdict(list)
            for other in self.exports:
                table[other.outer].append(other)
            self._inside = dict(table)
        return self._inside.get(export.number + 1, [])

    def archive(self, export: Export) -> Archive:
        """A cursor over the data of an export."""
        return Archive(self.data, export.offset, export.offset + export.size)

    def _entry(self, index: int) -> Import | Export | None:
        if 0 < index <= len(self.exports):
            return self.exports[index - 1]
        if -len(self.imports) <= index < 0:
            return self.imports[-index - 1]
        return None


@dataclass(slots=True)
class _Header:
    version: int
    flags: int = 0
    names: tuple[int, int] = (0, 0)
    exports: tuple[int, int] = (0, 0)
    imports: tuple[int, int] = (0, 0)
    compression: int = 0
    chunks: list[tuple[int, ...]] = field(default_factory=list)


def open_package(data: bytes) -> Package:
    """Read the tables of a package.

    Raises:
        PackageError: it is damaged, or of a kind that is not read; it says which and what helps.
    """
    data = _whole(data)
    header = _header(Archive(data))
    if header.compression or header.chunks:
        data = _inflated(data, header)
    names = _names(data, *header.names)
    imports = _imports(data, names, *header.imports)
    exports = _exports(data, names, *header.exports)
    return Package(data, header.version, names, imports, exports)


def _whole(data: bytes) -> bytes:
    """The package itself, if the file is one that is compressed as a whole."""
    if len(data) < 32:
        raise PackageError(f"only {len(data)} bytes", 0, AGAIN)
    archive = Archive(data)
    tag, second = archive.u32(), archive.u32()
    if tag == int.from_bytes(TAG.to_bytes(4, "little"), "big"):
        cure = "use the files of the PC editor"
        raise PackageError("a package of a console (its bytes are swapped)", 0, cure)
    if tag != TAG:
        raise PackageError("no Unreal package (its first four bytes are others)", 0, AGAIN)
    if second != 0x20000:  # the size of a block where a version ought to be
        return data
    size = Archive(data, 12).i32()
    first = 16 + 8 * -(-max(0, size) // second)
    method = ZLIB if data[first : first + 1] == b"\x78" else LZO
    return inflate_part(Archive(data), method, _limit(data))


def _limit(data: bytes) -> int:
    return min(MAX_PACKAGE, MAX_RATIO * len(data) + (1 << 20))


def _header(archive: Archive) -> _Header:
    archive.skip(4)
    version, _ = archive.u16(), archive.u16()
    _check_version(version)
    header = _Header(version)
    archive.skip(4)  # size of the header
    archive.string()  # folder in the content browser
    header.flags = archive.u32()
    if header.flags & COOKED:
        cure = "use the package as the editor saved it, before it was cooked"
        raise PackageError("a cooked package, without what the editor needs", archive.offset, cure)
    header.names = archive.i32(), archive.i32()
    header.exports = archive.i32(), archive.i32()
    header.imports = archive.i32(), archive.i32()
    archive.skip(4 + 12 + 4 + 16)  # depends, guid tables, thumbnails, GUID
    archive.skip(12 * archive.count(12, "generations"))
    archive.skip(8)  # engine and cooker version
    header.compression = archive.u32()
    header.chunks = [archive.i32s(4) for _ in range(archive.count(16, "compressed chunks"))]
    return header


def _check_version(version: int) -> None:
    if version >= 0x8000:
        cure = "export the level as USD there and import that"
        raise PackageError("a package of Unreal Engine 4 or 5", 4, cure)
    if version < UE2:
        problem = f"file version {version} is of Unreal Engine 1 or 2 (up to UT2004)"
        raise PackageError(problem, 4, AS_T3D)
    if version < OLDEST:
        problem = f"file version {version} is older than UDK ({OLDEST})"
        raise PackageError(problem, 4, f"save it with a later UDK, or {AS_T3D}")
    if version > NEWEST:
        problem = f"file version {version} is newer than the last UDK ({NEWEST})"
        raise PackageError(problem, 4, f"{AS_T3D} with the editor of that game")


def _inflated(data: bytes, header: _Header) -> bytes:
    """The package as its offsets mean it: the header, then what the chunks hold."""
    if not header.chunks:
        raise PackageError("a compressed package without chunks", 0, AGAIN)
    limit = _limit(data)
    start = header.chunks[0][0]
    if not 0 <= start <= len(data):
        raise PackageError(f"a compressed chunk for byte {start}", 0, AGAIN)
    whole = bytearray(data[:start])
    for place, size, packed_place, packed in header.chunks:
        if place != len(whole) or size < 0 or packed < 0:
            raise PackageError(f"a compressed chunk for byte {place}, not {len(whole)}", 0, AGAIN)
        part = Archive(data, packed_place, packed_place + packed)
        inside = inflate_part(part, header.compression, limit - len(whole))
        if len(inside) != size:
            raise PackageError(f"a chunk of {len(inside)} bytes, not {size}", packed_place, AGAIN)
        whole += inside
    return bytes(whole)


def _table(data: bytes, count: int, offset: int, item: int, what: str) -> Archive:
    if count < 0 or not 0 < offset <= len(data) or count * item > len(data) - offset:
        problem = f"{count} {what} at byte {offset} of {len(data)}"
        raise PackageError(problem, offset, AGAIN)
    return Archive(data, offset)


def _names(data: bytes, count: int, offset: int) -> list[str]:
    archive = _table(data, count, offset, 12, "names")
    answer = []
    for _ in range(count):
        answer.append(archive.string())
        archive.skip(8)
    return answer


def _name(archive: Archive, names: list[str]) -> str:
    start = archive.offset
    index, number = archive.i32(), archive.i32()
    if not 0 <= index < len(names):
        raise PackageError(f"name {index} of {len(names)}", start)
    return f"{names[index]}_{number - 1}" if number > 0 else names[index]


def _imports(data: bytes, names: list[str], count: int, offset: int) -> list[Import]:
    archive = _table(data, count, offset, 28, "imports")
    answer = []
    for _ in range(count):
        _name(archive, names)  # package of the class
        kind = _name(archive, names)
        answer.append(Import(kind, archive.i32(), _name(archive, names)))
    return answer


def _exports(data: bytes, names: list[str], count: int, offset: int) -> list[Export]:
    archive = _table(data, count, offset, 68, "exports")
    answer = []
    total = 0
    for number in range(count):
        start = archive.offset
        kind, _, outer = archive.i32s(3)
        name = _name(archive, names)
        archetype = archive.i32()
        flags = archive.u64()
        size, place = archive.i32s(2)
        archive.skip(4)  # export flags
        archive.skip(4 * archive.count(4, "net objects"))
        archive.skip(20)  # GUID, package flags
        if size < 0 or not 0 <= place <= len(data) - size:
            problem = f"{name} has {size} bytes at {place} of {len(data)}"
            raise PackageError(problem, start, AGAIN)
        total += size
        if total > len(data):
            raise PackageError("objects that overlap", start, AGAIN)
        answer.append(Export(number, kind, outer, archetype, name, flags, size, place))
    return answer
