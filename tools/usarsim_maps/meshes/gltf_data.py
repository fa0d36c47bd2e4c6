"""The container of glTF: JSON whose every value is checked, buffers, accessors.

Whatever makes no sense, and has no default, is a `MapImportError` that names its place.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.files import AssetIndex, read_bytes
from usarsim_maps.findings import Findings
from usarsim_maps.meshes.mesh_files import CURE, broken
from usarsim_maps.reader import need
from usarsim_maps.scene import Array, Integers
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.files import ALLOW, Folders
from usarsim_server.protocol.json_text import parse_json

MAX_BYTES = 1 << 30
MAX_JSON = 128 << 20
MAX_VALUES = 100_000_000
"""Numbers in one accessor."""

FAR = 1e12
"""Larger numbers in nodes have no meaning."""


_COMPONENTS = {
    5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4", 5130: "<f8",
}  # fmt: skip
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

_JSON, _BIN = 0x4E4F534A, 0x004E4942


@dataclass(frozen=True, slots=True)
class Item:
    """A JSON object of the file, and where it is."""

    path: Path  # of the file
    place: str  # for errors, such as `nodes[3]`
    value: dict[str, Any]  # the object; empty where the file has something else or nothing
    number: int = 0  # its position in its list

    def error(self, problem: str, cure: str = CURE) -> MapImportError:
        """An error that names file and place."""
        return MapImportError(at(self.path, problem, cure, where=self.place or None))

    def item(self, key: str) -> Item:
        """An object inside; an empty one if there is none."""
        found = self.value.get(key)
        place = f"{self.place}.{key}" if self.place else key
        return Item(self.path, place, found if isinstance(found, dict) else {})

    def items(self, key: str) -> list[Item]:
        """A list of objects inside."""
        found = self.value.get(key, [])
        place = f"{self.place}.{key}" if self.place else key
        if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
            raise self.error(f"{key!r} is no list of objects")
        return [Item(self.path, f"{place}[{n}]", entry, n) for n, entry in enumerate(found)]

    def text(self, key: str) -> str:
        """A text, empty if there is none."""
        found = self.value.get(key)
        return found if isinstance(found, str) else ""

    def number_of(self, key: str, default: int) -> int:
        """A whole number from 0 to 2^40."""
        found = self.value.get(key, default)
        if isinstance(found, float) and found.is_integer():
            found = int(found)
        if isinstance(found, bool) or not isinstance(found, int) or not 0 <= found < 1 << 40:
            raise self.error(f"{key!r} is {found!r:.40} instead of a whole number")
        return found

    def number_at(self, key: str) -> float | None:
        """A finite number; None for anything else."""
        found = self.value.get(key)
        if isinstance(found, bool) or not isinstance(found, int | float):
            return None
        return float(found) if abs(found) < 1e30 else None

    def positive(self, key: str) -> float | None:
        """A number above zero; None for anything else."""
        found = self.number_at(key)
        return found if found is not None and found > 0.0 else None

    def floats(self, key: str, count: int) -> Array | None:
        """So many finite numbers; None if the file has something else."""
        try:
            values = np.array(self.value.get(key), dtype=float)
        except (TypeError, ValueError, OverflowError):
            return None
        return values if values.shape == (count,) and (np.abs(values) < FAR).all() else None

    def vector(self, key: str, default: tuple[float, ...], findings: Findings) -> tuple[float, ...]:
        """As many numbers as the default has, which stands for what makes no sense."""
        if key not in self.value:
            return default
        found = self.floats(key, len(default))
        if found is None:
            findings.warn(self.path.name, f"{self.place}: {key!r} makes no sense; left out")
            return default
        return tuple(found.tolist())

    def index(self, key: str, of: Sequence[object]) -> int | None:
        """The number of an entry of a list; None if it is not given."""
        if key not in self.value:
            return None
        found = self.number_of(key, 0)
        if found >= len(of):
            raise self.error(f"{key!r} refers to entry {found} of {len(of)}")
        return found

    def indices(self, key: str, of: Sequence[object]) -> list[int]:
        """Numbers of entries of a list."""
        found = self.value.get(key, [])
        if not isinstance(found, list) or not all(
            isinstance(n, int) and not isinstance(n, bool) and 0 <= n < len(of) for n in found
        ):
            raise self.error(f"{key!r} refers to what is not there")
        return found

    def number_or(self, key: str, default: float) -> float:
        """A finite number."""
        found = self.number_at(key)
        return default if found is None else found


@dataclass(slots=True)
class GltfFile:
    """A file."""

    path: Path  # of the file
    root: Item  # the outermost object
    files: list[Path]  # everything that was read
    folders: Folders  # out of which buffers may be read
    _chunk: bytes | None = None
    _buffers: dict[int, bytes] = field(default_factory=dict)
    _unpacked: dict[int, bytes] = field(default_factory=dict)
    _lists: dict[str, list[Item]] = field(default_factory=dict)

    def items(self, key: str) -> list[Item]:
        """A list of the outermost object."""
        if key not in self._lists:
            self._lists[key] = self.root.items(key)
        return self._lists[key]

    def words(self, key: str) -> list[str]:
        """A list of texts of the outermost object."""
        found = self.root.value.get(key, [])
        return [word for word in found if isinstance(word, str)] if isinstance(found, list) else []

    def view(self, number: int) -> bytes:
        """The bytes of a buffer view."""
        views = self.items("bufferViews")
        if number >= len(views):
            raise self.root.error(f"bufferView {number} of {len(views)}")
        view = views[number]
        for name in MESHOPT:
            packed = view.item("extensions").item(name)
            if packed.value:
                try:
                    return self._meshopt(number, packed)
                except MapImportError:
                    # Where the plain bytes are there, too, nothing is lost.
                    if name in self.words("extensionsRequired") or self._is_stand_in(view, name):
                        raise
        return self._piece(view)

    def _is_stand_in(self, view: Item, name: str) -> bool:
        """Whether the buffer of a view holds nothing, for all of it is compressed elsewhere."""
        number = view.index("buffer", self.items("buffers"))
        buffer = view if number is None else self.items("buffers")[number]
        stands_in = buffer.item("extensions").item(name).value.get("fallback") is True
        return number is None or (stands_in and not buffer.text("uri"))

    def _meshopt(self, number: int, packed: Item) -> bytes:
        """The bytes of a view that is compressed by meshoptimizer."""
        if number not in self._unpacked:
            count, stride = packed.number_of("count", 0), packed.number_of("byteStride", 0)
            if count * stride > MAX_BYTES:
                raise packed.error(f"{count} elements of {stride} bytes are too many")
            content = self._piece(packed)
            meshopt = need("meshopt", self.path, "buffers compressed by meshoptimizer")
            mode, sieve = packed.text("mode"), packed.text("filter") or None
            try:
                found = np.asarray(meshopt.decode_gltf_buffer(content, count, stride, mode, sieve))
            except Exception as error:  # a library of C++ behind several layers
                text = f"meshoptimizer cannot decompress it: {error}"
                raise packed.error(" ".join(text.split())[:200]) from None
            kind = {2: np.uint16, 4: np.uint32}.get(stride, np.uint32)
            self._unpacked[number] = (
                found.astype(kind) if mode != "ATTRIBUTES" else found
            ).tobytes()
        return self._unpacked[number]

    def _piece(self, view: Item) -> bytes:
        """The bytes of a buffer that a view names."""
        buffer = view.index("buffer", self.items("buffers"))
        if buffer is None:
            raise view.error("no buffer")
        content = self._buffer(buffer)
        start, length = view.number_of("byteOffset", 0), view.number_of("byteLength", 0)
        if start + length > len(content):
            problem = f"bytes {start} to {start + length} of a buffer of {len(content)}"
            raise view.error(problem)
        return content[start : start + length]

    def accessor(self, number: int | None) -> Array:
        """Values (n, width) of an accessor, normalized and sparse ones included."""
        accessors = self.items("accessors")
        if number is None or number >= len(accessors):
            raise self.root.error(f"accessor {number} of {len(accessors)}")
        item = accessors[number]
        kind = _COMPONENTS.get(item.number_of("componentType", 0))
        width = _WIDTHS.get(item.text("type"))
        count = item.number_of("count", 0)
        if kind is None or width is None:
            raise item.error("unknown type of numbers")
        dtype = np.dtype(kind)
        if "bufferView" in item.value:
            values = self._strided(item, dtype, count, width)
        elif count * width > MAX_VALUES // 10:
            raise item.error(f"{count} values that are not there")
        else:
            values = np.zeros((count, width))
        sparse = item.item("sparse")
        if sparse.value:
            values = self._sparse(item, sparse, values, dtype, width)
        return _normalized(item, values, dtype)

    def greatest(self, number: int) -> int:
        """The largest number that the components of an accessor can hold: as an index, none."""
        kind = _COMPONENTS.get(self.items("accessors")[number].number_of("componentType", 0), "<u4")
        dtype = np.dtype(kind)
        return int(np.iinfo(dtype).max) if dtype.kind in "iu" else -1

    def as_accessor(self, number: int, values: NDArray[Any]) -> Array:
        """Values that come from elsewhere as those of an accessor, normalized if it says so."""
        return _normalized(self.items("accessors")[number], values.astype(float), values.dtype)

    def _strided(self, item: Item, dtype: np.dtype[Any], count: int, width: int) -> Array:
        number = item.index("bufferView", self.items("bufferViews")) or 0
        content = self.view(number)
        row = dtype.itemsize * width
        stride = self.items("bufferViews")[number].number_of("byteStride", 0) or row
        start = item.number_of("byteOffset", 0)
        if stride < row or (count and start + (count - 1) * stride + row > len(content)):
            raise item.error(f"{count} values do not fit into {len(content)} bytes")
        if count * width > MAX_VALUES:
            raise item.error(f"{count} values are too many", "split the map")
        raw = np.ndarray((count, width), dtype, content, start, (stride, dtype.itemsize))
        with np.errstate(invalid="ignore"):
            return raw.astype(float)

    def _sparse(
        self, item: Item, sparse: Item, values: Array, dtype: np.dtype[Any], width: int
    ) -> Array:
        count = sparse.number_of("count", 0)
        where, what = sparse.item("indices"), sparse.item("values")
        kind = _COMPONENTS.get(where.number_of("componentType", 0), "<u4")
        places = self._plain(where, np.dtype(kind), count)
        if len(places) and places.max() >= len(values):
            raise item.error("sparse values lie outside")
        values = values.copy()
        values[places.astype(np.int64)] = self._plain(what, dtype, count * width).reshape(-1, width)
        return values

    def _plain(self, item: Item, dtype: np.dtype[Any], count: int) -> Array:
        content = self.view(item.index("bufferView", self.items("bufferViews")) or 0)
        start = item.number_of("byteOffset", 0)
        if start + count * dtype.itemsize > len(content):
            raise item.error(f"{count} values do not fit into {len(content)} bytes")
        return np.frombuffer(content, dtype, count, start).astype(float)

    def _buffer(self, number: int) -> bytes:
        if number not in self._buffers:
            item = self.items("buffers")[number]
            uri = item.text("uri")
            if not uri:
                if self._chunk is None or number:
                    raise item.error("the binary part is missing")
                self._buffers[number] = self._chunk
            else:
                self._buffers[number] = self.resource(item, uri)
        return self._buffers[number]

    def resource(self, item: Item, uri: str) -> bytes:
        """The bytes behind a URI: data in the URI itself, or a file beside this one."""
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=False)
            except (binascii.Error, ValueError):
                raise item.error("data that is no base64") from None
        found = AssetIndex((), self.path, lambda path: True).find(uri)
        refusal = None if found is None else self.folders.refusal(found, self.path)
        if refusal is not None:
            raise item.error(refusal, ALLOW)
        if found is None:
            cure = "keep the files of the export together"
            raise item.error(f"the file {uri[:80]!r} is missing", cure)
        self.files.append(found)
        return read_bytes(found, MAX_BYTES)


def _normalized(item: Item, values: Array, dtype: np.dtype[Any]) -> Array:
    if item.value.get("normalized") is True and dtype.kind in "iu":
        return np.maximum(values / float(np.iinfo(dtype).max), -1.0)
    return values


def load_gltf(path: Path, folders: Folders) -> GltfFile:
    """Read the container, of version 2; buffers follow when needed, out of these folders."""
    content = read_bytes(path, MAX_BYTES)
    chunk = None
    text = content
    if content.startswith(b"glTF"):
        text, chunk = _chunks(path, content)
    if len(text) > MAX_JSON:
        raise MapImportError(at(path, f"{len(text) >> 20} MiB of JSON", "export as .glb"))
    try:
        value = parse_json(text.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise broken(path, "the JSON is not UTF-8") from None
    except json.JSONDecodeError as error:
        raise broken(path, f"no sound JSON: {error.msg}", error.lineno) from None
    except ValueError as error:  # absurdly long numbers
        raise broken(path, f"no sound JSON: {error}"[:200]) from None
    root = Item(path, "", value if isinstance(value, dict) else {})
    version = root.item("asset").text("version")
    if not version.startswith("2"):
        problem = f"version {version or '?'} of glTF is not known"
        raise MapImportError(at(path, problem, "export as glTF 2.0", where="asset"))
    return GltfFile(path, root, [path], folders, chunk)


def _chunks(path: Path, content: bytes) -> tuple[bytes, bytes | None]:
    """JSON and binary part of a GLB file."""
    text, chunk = None, None
    if len(content) >= 12:
        _, version, length = struct.unpack_from("<4sII", content)
        if version != 2:
            problem = f"version {version} of GLB is not known"
            raise MapImportError(at(path, problem, "export as glTF 2.0"))
        if length > len(content):
            problem = f"{length} bytes are announced, {len(content)} are there"
            raise broken(path, problem)
        place = 12
        while place + 8 <= length:
            size, kind = struct.unpack_from("<II", content, place)
            place += 8
            if place + size > len(content):
                break
            if kind == _JSON and text is None:
                text = content[place : place + size]
            elif kind == _BIN and chunk is None:
                chunk = content[place : place + size]
            place += size
    if text is None:
        raise broken(path, "a GLB file without a whole JSON part")
    return text, chunk


# ---- compressed meshes --------------------------------------------------------------------

DRACO = "KHR_draco_mesh_compression"

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
"""Extensions of buffer views; the second adds a version of the format and a filter to the first."""

NONE = 1 << 31
"""An attribute that no buffer has."""


class DracoPrimitive:
    """What is in the compressed buffer of a primitive."""

    def __init__(self, file: GltfFile, primitive: Item) -> None:
        """Decompress it; a `MapImportError` too if DracoPy is not installed."""
        draco = need("DracoPy", file.path, "meshes compressed by Draco")
        self._file = file
        self._item = primitive.item("extensions").item(DRACO)
        view = self._item.index("bufferView", file.items("bufferViews"))
        if view is None:
            raise self._item.error("no buffer view")
        try:
            self._mesh = draco.decode(file.view(view))
            faces = np.asarray(self._mesh.faces, np.int64)
        except Exception as error:  # a library of C++ behind several layers: it says what it likes
            raise self._item.error(f"Draco cannot decompress it: {error}"[:200]) from None
        self.chain: Integers = faces.reshape(-1)  # (3 n,) vertex numbers of its triangles

    def has(self, name: str) -> bool:
        """Whether an attribute is in the compressed buffer; others are in their accessors."""
        return name == "POSITION" or name in self._item.item("attributes").value

    def attribute(self, name: str, accessor: int) -> Array:
        """Values (n, width) of `POSITION` or another attribute, in the types of its accessor."""
        number = self._item.item("attributes").number_of(name, NONE)
        found = self._mesh.get_attribute_by_unique_id(number)
        if found is None:
            raise self._item.error(f"attribute {number} ({name}) is not in the compressed buffer")
        values = np.asarray(found["data"])
        return self._file.as_accessor(accessor, values)
