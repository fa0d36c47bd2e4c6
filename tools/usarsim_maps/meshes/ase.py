"""Reads ASE, the text mesh format of the Unreal 2 and 3 era (worlds reference 4.4).

Its frame is that of the modeller that made it: right-handed, z up. Lengths are Unreal units, so
meshes get the scale of the map that names them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath

import numpy as np

from usarsim_maps.files import AssetIndex, read_text
from usarsim_maps.meshes.mesh_files import broken
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Collision, Material, Mesh, Part, Scene, SceneObject, Source
from usarsim_maps.units import MIRROR, UU_PER_METRE, axis_matrix
from usarsim_server.errors import MapImportError, at

MAX_BYTES = 96 << 20
MAX_ITEMS = 5_000_000
PICTURES = (".png", ".tga", ".dds", ".bmp", ".jpg", ".jpeg")
COLLISION = ("mcdcx", "ucx_", "ubx_", "usp_", "mcdbx", "mcdsp")
"""Beginnings of names of collision pieces."""

FAR = 1e12
SENSELESS = "1e30"
"""Stands for `-1.#IND` and the like."""

_NOTHING = re.compile(r"[-+]?\d\.#\w+")
_NUMBERS = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_FACE = re.compile(r"\d+:\s*A:\s*(\d{1,9})\s*B:\s*(\d{1,9})\s*C:\s*(\d{1,9})\b")
_SLOT = re.compile(r"\*MESH_MTLID\s+(\d{1,9})\b")


@dataclass(slots=True)
class _Geom:
    name: str = "mesh"
    vertices: dict[int, list[float]] = field(default_factory=dict)
    faces: list[tuple[int, int, int]] = field(default_factory=list)
    slots: list[int] = field(default_factory=list)
    texture: dict[int, list[float]] = field(default_factory=dict)
    corners: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    material: int = -1


@register("ase")
class AseReader(Reader):
    """Static meshes as ASE."""

    title = "ASE"
    extensions = (".ase",)
    head = re.compile(rb"(?i)\A\s*\*3dsmax_asciiexport")

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        geoms, materials = _parse(source, read_text(source, MAX_BYTES))
        scale = context.options.scale or UU_PER_METRE
        turn = axis_matrix(context.options.up or "Z") / scale
        if context.options.mirror:
            turn = MIRROR @ turn
        index = context.index(source)
        known, files = _materials(materials, index)
        objects = [_object(geom, turn, materials, source) for geom in geoms if geom.faces]
        if not objects:
            cure = "export the mesh again as ASE with its faces"
            raise MapImportError(at(source, "there is no mesh in this file", cure))
        return Scene(
            source=Source(
                source,
                "ASE",
                scale,
                mirrored=context.options.mirror,
                assumed=context.options.scale is None,
                files=(source, *files),
            ),
            objects=tuple(objects),
            materials=known,
        )


def _parse(source: Path, text: str) -> tuple[list[_Geom], list[list[tuple[str, str]]]]:
    """Geometry, and per material its sub-materials as (name, picture)."""
    geoms: list[_Geom] = []
    materials: list[list[tuple[str, str]]] = []
    depth, sub_depth, items = 0, 0, 0
    names: list[str] = []
    for number, line in _lines(text):
        key, _, rest = line.partition(" ")
        rest = rest.strip()
        match key.upper():
            case "*MATERIAL":
                materials.append([])
                names = []
                sub_depth = depth + 1
            case "*MATERIAL_NAME" if materials:
                names.append(rest.strip('"'))
                if depth > sub_depth or not materials[-1]:
                    materials[-1].append((names[-1], ""))
            case "*SUBMATERIAL" if materials and len(names) == 1:
                materials[-1].clear()
            case "*BITMAP" if materials and materials[-1]:
                name, _ = materials[-1][-1]
                materials[-1][-1] = (name, rest.strip('"'))
            case "*GEOMOBJECT":
                geoms.append(_Geom())
            case "*NODE_NAME" if geoms:
                geoms[-1].name = rest.strip('"')
            case "*MATERIAL_REF" if geoms:
                geoms[-1].material = int(_numbers(rest, 1, source, number)[0])
            case "*MESH_VERTEX" if geoms:
                values = _numbers(rest, 4, source, number, whole=1)
                geoms[-1].vertices[int(values[0])] = values[1:4]
                items += 1
            case "*MESH_TVERT" if geoms:
                values = _numbers(rest, 3, source, number, whole=1)
                geoms[-1].texture[int(values[0])] = values[1:3]
                items += 1
            case "*MESH_TFACE" if geoms:
                values = _numbers(rest, 4, source, number)
                geoms[-1].corners[int(values[0])] = (int(values[1]), int(values[2]), int(values[3]))
                items += 1
            case "*MESH_FACE" if geoms:
                face = _FACE.match(rest)
                if face is None:
                    raise broken(source, f"{line[:60]!r} is no face", number)
                geoms[-1].faces.append((int(face[1]), int(face[2]), int(face[3])))
                slot = _SLOT.search(rest)
                geoms[-1].slots.append(int(slot[1]) if slot else 0)
                items += 1
        depth += line.count("{") - line.count("}")
        if items > MAX_ITEMS:
            raise broken(source, f"more than {MAX_ITEMS} vertices and faces", number)
    if depth > 0:
        raise broken(source, "the file ends inside a block", text.count("\n") + 1)
    return geoms, materials


def _lines(text: str) -> Iterator[tuple[int, str]]:
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.replace("\t", " ").strip()
        if line:
            yield number, line


def _numbers(
    text: str, count: int, source: Path, line: int, whole: int | None = None
) -> list[float]:
    """So many numbers; those behind the first `whole` ones may be senseless, and are NaN then."""
    found = _NUMBERS.findall(_NOTHING.sub(SENSELESS, text))
    if len(found) < count:
        raise broken(source, f"{text[:60]!r} has fewer than {count} numbers", line)
    values = [value if abs(value := float(word)) < FAR else math.nan for word in found]
    if any(map(math.isnan, values[:count][:whole])):
        raise broken(source, f"{text[:60]!r} has a number without meaning", line)
    return values


def _materials(
    materials: list[list[tuple[str, str]]], index: AssetIndex
) -> tuple[dict[str, Material], list[Path]]:
    known: dict[str, Material] = {}
    files = []
    for group in materials:
        for name, picture in group:
            plain = PureWindowsPath(picture).name
            found = index.find(picture or name, PICTURES)
            if found is not None and found.suffix.lower() in PICTURES:
                files.append(found)
            else:
                found = Path(plain) if plain and plain.lower() != "none" else None
            known.setdefault(name, Material(name, texture=found))
    return known, files


def _object(
    geom: _Geom, turn: Array, materials: list[list[tuple[str, str]]], source: Path
) -> SceneObject:
    order = {number: position for position, number in enumerate(geom.vertices)}
    try:
        triangles = np.array([[order[v] for v in face] for face in geom.faces], dtype=np.int32)
    except KeyError as error:
        problem = f"a face of {geom.name} refers to vertex {error}, which is not there"
        raise MapImportError(at(source, problem, "export the mesh again")) from None
    vertices = np.array(list(geom.vertices.values())) @ turn.T
    if np.linalg.det(turn) < 0.0:
        triangles = triangles[:, ::-1]
    uvs = None
    if len(geom.corners) == len(geom.faces) and geom.texture:
        nowhere = [0.0, 0.0]
        uvs = np.array(
            [
                [geom.texture.get(t, nowhere) for t in geom.corners.get(f, (0, 0, 0))]
                for f in range(len(geom.faces))
            ]
        )
        if np.linalg.det(turn) < 0.0:
            uvs = uvs[:, ::-1]
    group = materials[geom.material] if 0 <= geom.material < len(materials) else []
    names = tuple(name for name, _ in group) or ("",)
    mesh = Mesh(
        name=geom.name,
        vertices=vertices,
        triangles=triangles,
        uvs=uvs,
        slots=np.array(geom.slots, dtype=np.int32) % len(names),
        materials=names,
    )
    hidden = geom.name.lower().startswith(COLLISION)
    collision = Collision.HULL if hidden else Collision.AUTO
    part = Part(mesh, visible=not hidden, collision=collision)
    return SceneObject(geom.name, (part,), kind="GEOMOBJECT")
