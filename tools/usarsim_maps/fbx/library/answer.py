"""Lets the library read a file in a process of its own, and understands the answer.

Nothing in the answer is believed: what makes no sense is a refusal of the file.
"""

from __future__ import annotations

import importlib.util
import json
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.apart import patience, run_apart
from usarsim_maps.fbx.library.child import MAGIC
from usarsim_maps.fbx.library.text import MAX_DEPTH, check_text, is_binary, plain_text
from usarsim_maps.files import check_size, read_bytes
from usarsim_maps.meshes.mesh_files import CURE
from usarsim_maps.meshes.polygons import MAX_TRIANGLES, check_count
from usarsim_maps.reader import EXTRAS, need
from usarsim_maps.scene import Array, Integers
from usarsim_maps.units import affine
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.extras import install
from usarsim_server.base.launch import python
from usarsim_server.protocol.json_text import parse_json

MAX_BYTES = 512 << 20
MAX_NODES = 100_000
MAX_ANSWER = 6 << 30
"""Bytes; 8 million triangles with texture coordinates and colours need some 3 GiB at the worst."""

MEMORY, MEMORY_PER_BYTE = 3 << 30, 12
"""Bytes that the library may take, and how many more for each byte of the file."""

CHILD = Path(__file__).with_name("child.py")
TYPES: dict[str, np.dtype[Any]] = {
    "<f8": np.dtype("<f8"),
    "<u4": np.dtype("<u4"),
    "u1": np.dtype("u1"),
}


@dataclass(frozen=True, slots=True)
class FbxNode:
    """A node; matrices are (4, 4) into the world of the file, in its units."""

    name: str  # as in the file
    parent: int | None  # its number
    attributes: tuple[tuple[str, int], ...]  # type, and number among those of this type
    visible: bool  # itself
    inherits: bool  # it is hidden where its parent is
    matrix: Array  # of its own frame
    geometry: Array  # of what hangs on it
    materials: tuple[int, ...]  # numbers, by slot
    facts: Mapping[str, str | float]  # custom properties


@dataclass(frozen=True, slots=True, eq=False)
class FbxMesh:
    """A mesh in its own frame, or in the world's (`local` is false) where bones bend it."""

    name: str  # as in the file
    points: Array  # (n, 3)
    corners: Integers  # (c,) point of each corner
    faces: Integers  # (f, 2) first corner, and how many there are
    slots: Integers  # (f,) of materials; empty if there are none
    uvs: Array | None  # (c, 2), v upwards
    colors: Array | None  # (c, 4)
    materials: tuple[int, ...]  # numbers, by slot
    local: bool
    smooth: bool  # it is the cage of a subdivision surface


@dataclass(frozen=True, slots=True)
class FbxLight:
    """A lamp; `direction` is in the frame of its node, `cone` the whole angle, degrees."""

    kind: int  # number of the library
    color: tuple[float, ...]
    intensity: float  # 1: 100 percent
    direction: tuple[float, ...]
    cone: float
    on: bool
    shadows: bool


@dataclass(frozen=True, slots=True)
class FbxMaterial:
    """A surface as the file has it; None where it says nothing."""

    name: str
    color: tuple[float, ...] | None
    factor: float | None  # of the colour
    clear: tuple[float, ...] | None  # colour that passes
    clear_factor: float | None
    opacity: float | None  # by the property `Opacity`
    pbr_opacity: float | None  # by a shader with that input
    texture: int | None  # number
    holes: int | None  # number of the texture that says what is clear


@dataclass(frozen=True, slots=True)
class FbxTexture:
    """A picture: paths on the computer where the file was written, or the picture itself."""

    names: tuple[str, ...]
    content: bytes | None
    repeat: bool
    matrix: Array | None  # (4, 4) from texture coordinates into the picture


@dataclass(frozen=True, slots=True, eq=False)
class FbxScene:
    """All that a file holds."""

    axes: tuple[int, ...]  # right, up and front, as numbers of the library
    unit: float  # m
    stated: bool  # the file says its unit
    version: int  # of the format, for example 7400
    nodes: tuple[FbxNode, ...]  # parents first
    meshes: tuple[FbxMesh, ...]
    lights: tuple[FbxLight, ...]
    materials: tuple[FbxMaterial, ...]
    textures: tuple[FbxTexture, ...]
    hidden: frozenset[int]  # nodes in layers that are hidden
    shapes: tuple[tuple[str, float], ...]  # blend shapes: name and weight
    others: Mapping[str, Sequence[tuple[str, str]]]  # name and kind, by list of the library
    warnings: tuple[tuple[int, str], ...]  # number and text of the library


def load_fbx(source: Path) -> FbxScene:
    """Read a file.

    Raises:
        MapImportError: it cannot be used, or the library is missing.
    """
    content = read_bytes(source, MAX_BYTES)
    binary = is_binary(content)
    if not binary:
        content = plain_text(content)
        check_text(source, content)
    told, blobs = _split(source, _answer(source, content))
    if "unusable" in told:
        problem = f"the FBX library cannot be loaded: {told['unusable']}"[:300]
        raise MapImportError(at(source, problem, install(EXTRAS["ufbx"])))
    if "refused" in told:
        if not binary:
            check_text(source, content, closely=True)
        problem = " ".join(f"the FBX library says: {told['refused']}".split())[:300]
        raise MapImportError(at(source, problem, CURE))
    try:
        if "too_many" in told:
            _refuse_size(source, told["too_many"])
        return _scene(_Blobs(blobs), told)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        problem = f"the FBX library's answer makes no sense ({type(error).__name__})"
        raise MapImportError(at(source, problem, CURE)) from None


def _refuse_size(source: Path, counts: Mapping[str, Any]) -> None:
    if int(counts["nodes"]) > MAX_NODES:
        problem = f"{int(counts['nodes'])} nodes are more than {MAX_NODES}"
        raise MapImportError(at(source, problem, "split the map"))
    check_count(source, int(counts["triangles"]))
    problem = f"{int(counts['vertices'])} vertices are more than {3 * MAX_TRIANGLES}"
    raise MapImportError(at(source, problem, "simplify the mesh, or split it"))


def _answer(source: Path, content: bytes) -> bytes:
    """What the program of `child.py` makes of a file."""
    found = importlib.util.find_spec("ufbx")
    if found is None or found.origin is None:
        need("ufbx", source, "FBX files")
        raise ModuleNotFoundError("ufbx")
    limits = {
        "memory": MEMORY + MEMORY_PER_BYTE * len(content),
        "answer": MAX_ANSWER,
        "seconds": math.ceil(patience(len(content))) + 10,
        "nodes": MAX_NODES,
        "depth": MAX_DEPTH,
        "triangles": MAX_TRIANGLES,
    }
    folder = str(Path(found.origin).parent.parent)
    command = python("-I", "-S", str(CHILD), folder, json.dumps(limits))
    with tempfile.TemporaryFile() as file:  # nothing is left of it, whatever happens
        run_apart(command, source, "FBX", CURE, len(content), given=content, answer=file)
        check_size(source, file.seek(0, 2), MAX_ANSWER)
        file.seek(0)
        return file.read()


def _split(source: Path, answer: bytes) -> tuple[dict[str, Any], memoryview]:
    """The text of an answer, and its arrays."""
    start = len(MAGIC) + 8
    length = int.from_bytes(answer[len(MAGIC) : start], "little")
    try:
        if not answer.startswith(MAGIC) or length > len(answer) - start:
            raise ValueError
        told = parse_json(answer[start : start + length])
        if not isinstance(told, dict):
            raise ValueError
    except ValueError:
        raise MapImportError(at(source, "the FBX library ends in the middle of it", CURE)) from None
    return told, memoryview(answer)[start + length :]


# ---- values of an answer ---------------------------------------------------------------------


class _Blobs:
    """The arrays of an answer, which have to be asked for in their order."""

    def __init__(self, content: memoryview) -> None:
        self._content = content
        self._starts = [0]

    def array(self, told: Any) -> NDArray[Any]:
        """An array by its number, type and length in bytes."""
        number, name, length = told
        kind = TYPES[name]
        if number != len(self._starts) - 1 or not 0 <= length <= len(self._content):
            raise ValueError
        start = self._starts[number]
        if start + length > len(self._content):
            raise ValueError
        self._starts.append(start + length)
        found: NDArray[Any] = np.frombuffer(self._content[start : start + length], kind)
        return found

    def attribute(self, told: Any, width: int) -> tuple[Array, Integers]:
        """Values (n, width), and the number of the value of each corner."""
        values = self.array(told[0]).astype(float).reshape(-1, width)
        numbers = self.array(told[1]).astype(np.int64)
        if len(numbers) and numbers.max() >= len(values):
            raise ValueError
        return values, numbers


def _scene(blobs: _Blobs, told: Mapping[str, Any]) -> FbxScene:
    settings = told["settings"]
    nodes = tuple(map(_node, told["nodes"]))
    meshes = tuple(_mesh(blobs, one) for one in told["meshes"])
    materials = tuple(map(_material, told["materials"]))
    textures = tuple(_texture(blobs, one) for one in told["textures"])
    lights = tuple(map(_light, told["lights"]))
    for number, node in enumerate(nodes):
        if node.parent is not None and not 0 <= node.parent < number:
            raise ValueError
        _within(materials, node.materials)
        for kind, things in (("Mesh", meshes), ("Light", lights)):
            _within(things, [number for what, number in node.attributes if what == kind])
    for mesh in meshes:
        _within(materials, mesh.materials)
    for one in materials:
        _within(textures, [n for n in (one.texture, one.holes) if n is not None])
    return FbxScene(
        axes=tuple(int(axis) for axis in settings["axes"]),
        unit=float(settings["unit"]),
        stated=bool(settings["stated"]),
        version=int(settings["version"]),
        nodes=nodes,
        meshes=meshes,
        lights=lights,
        materials=materials,
        textures=textures,
        hidden=frozenset(
            int(node) for layer in told["layers"] if not layer["visible"] for node in layer["nodes"]
        ),
        shapes=tuple((str(name), float(weight)) for name, weight in told["shapes"]),
        others={
            str(key): [(str(name), str(kind)) for name, kind in found]
            for key, found in told["others"].items()
        },
        warnings=tuple((int(kind), str(text)) for kind, text in told["warnings"]),
    )


def _within(things: Sequence[object], numbers: Sequence[int]) -> None:
    if not all(0 <= number < len(things) for number in numbers):
        raise IndexError


def _matrix(columns: Any) -> Array:
    """(4, 4) of four columns of three numbers."""
    values = np.array(columns, dtype=float)
    if values.shape != (4, 3):
        raise ValueError
    return affine(values[:3].T, values[3])


def _numbers(values: Any, count: int = 3) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != count:
        raise ValueError
    return numbers


def _maybe(value: Any) -> float | None:
    return None if value is None else float(value)


def _node(told: Mapping[str, Any]) -> FbxNode:
    return FbxNode(
        name=str(told["name"]),
        parent=None if told["parent"] is None else int(told["parent"]),
        attributes=tuple((str(kind), int(number)) for kind, number in told["attributes"]),
        visible=bool(told["visible"]),
        inherits=bool(told["inherits"]),
        matrix=_matrix(told["matrix"]),
        geometry=_matrix(told["geometry"]),
        materials=tuple(int(number) for number in told["materials"]),
        facts={
            str(name): value if isinstance(value, str) else float(value)
            for name, value in told["facts"].items()
        },
    )


def _mesh(blobs: _Blobs, told: Mapping[str, Any]) -> FbxMesh:
    points, corners = np.zeros((0, 3)), np.zeros(0, np.int64)
    if told["places"] is not None:
        points, corners = blobs.attribute(told["places"], 3)
    faces = blobs.array(told["faces"]).astype(np.int64).reshape(-1, 2)
    holes = blobs.array(told["holes"])
    slots = blobs.array(told["slots"]).astype(np.int64)
    if len(faces) and faces.sum(axis=1).max() > len(corners):
        raise IndexError
    if len(holes) == len(faces):
        faces = faces[holes == 0]
        slots = slots[holes == 0] if len(slots) == len(holes) else slots
    by_corner: list[Array | None] = []
    for name, width in (("uvs", 2), ("colors", 4)):
        found = None
        if told[name] is not None:
            values, numbers = blobs.attribute(told[name], width)
            found = values[numbers] if len(numbers) == len(corners) else None
        by_corner.append(found)
    return FbxMesh(
        name=str(told["name"]),
        points=points,
        corners=corners,
        faces=faces,
        slots=slots if len(slots) == len(faces) else np.zeros(0, np.int64),
        uvs=by_corner[0],
        colors=by_corner[1],
        materials=tuple(int(number) for number in told["materials"]),
        local=bool(told["local"]),
        smooth=bool(told["smooth"]),
    )


def _light(told: Mapping[str, Any]) -> FbxLight:
    return FbxLight(
        kind=int(told["kind"]),
        color=_numbers(told["color"]),
        intensity=float(told["intensity"]),
        direction=_numbers(told["direction"]),
        cone=float(told["cone"]),
        on=bool(told["on"]),
        shadows=bool(told["shadows"]),
    )


def _material(told: Mapping[str, Any]) -> FbxMaterial:
    return FbxMaterial(
        name=str(told["name"]),
        color=None if told["color"] is None else _numbers(told["color"]),
        factor=_maybe(told["factor"]),
        clear=None if told["clear"] is None else _numbers(told["clear"]),
        clear_factor=_maybe(told["clear_factor"]),
        opacity=_maybe(told["opacity"]),
        pbr_opacity=_maybe(told["pbr_opacity"]),
        texture=None if told["texture"] is None else int(told["texture"]),
        holes=None if told["holes"] is None else int(told["holes"]),
    )


def _texture(blobs: _Blobs, told: Mapping[str, Any]) -> FbxTexture:
    content = told["content"]
    return FbxTexture(
        names=tuple(str(name) for name in told["names"]),
        content=None if content is None else blobs.array(content).tobytes(),
        repeat=bool(told["repeat"]),
        matrix=None if told["matrix"] is None else _matrix(told["matrix"]),
    )
