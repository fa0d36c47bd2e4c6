"""Reads ASE, the text mesh format of the Unreal 2 and 3 era (worlds reference 4.4).

Its frame is that of the modeller that made it: right-handed, z up. Lengths are Unreal units, so
meshes get the scale of the map that names them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import ClassVar

import numpy as np

from usarsim_maps.files import AssetIndex, read_text
from usarsim_maps.findings import Findings
from usarsim_maps.meshes.mesh_files import broken
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Collision, Material, Mesh, Part, Scene, SceneObject, Source
from usarsim_maps.support import Support, SupportTable, support_table
from usarsim_maps.units import MIRROR, UU_PER_METRE, axis_matrix
from usarsim_server.base.errors import MapImportError, at

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
_QUOTED = re.compile(r'"[^"]*"')
_SLOT = re.compile(r"\*MESH_MTLID\s+(\d{1,9})\b")


BLOCKS = support_table(
    read="""
        GEOMOBJECT GROUP MAP_DIFFUSE MAP_GENERIC MATERIAL MATERIAL_LIST MESH MESH_FACE_LIST
        MESH_TFACELIST MESH_TVERTLIST MESH_VERTEX_LIST NODE_TM SCENE SUBMATERIAL
    """,
    left_out="""
        BONEOBJECT CAMERAOBJECT CAMERA_ANIMATION HELPEROBJECT IK_JOINT LIGHTOBJECT LIGHT_ANIMATION
        MAP_AMBIENT MAP_BUMP MAP_FILTERCOLOR MAP_OPACITY MAP_REFLECT MAP_REFRACT
        MAP_SELFILLUM MAP_SHINE MAP_SHINESTRENGTH MAP_SPECULAR MESH_ANIMATION MESH_CFACELIST
        MESH_CVERTLIST MESH_MAPPINGCHANNEL MESH_NORMALS MESH_WEIGHTS PHYSIQUE_DATA
        SHAPEOBJECT SKIN_DATA TM_ANIMATION
    """,
)
"""Blocks of an ASE file, by their words without the asterisk."""


@dataclass(slots=True)
class _AseMaterial:
    name: str = ""
    picture: str = ""


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
    support: ClassVar[Mapping[str, SupportTable]] = {"ASE blocks": BLOCKS}

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        file = _AseFile(source, context.findings)
        file.parse(read_text(source, MAX_BYTES))
        geoms, materials = file.geoms, file.materials
        scale = context.options.scale or UU_PER_METRE
        turn = axis_matrix(context.options.up or "Z") / scale
        if context.options.mirror:
            turn = MIRROR @ turn
        index = context.index(source)
        known, files = _materials(materials, index, source.parent)
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


class _AseFile:
    """What the lines of a file add up to: every name and number belongs to the block around it."""

    def __init__(self, source: Path, findings: Findings) -> None:
        self.geoms: list[_Geom] = []
        self.materials: list[list[_AseMaterial]] = []  # with their sub-materials
        self._source = source
        self._findings = findings
        self._blocks: list[str] = []  # that are open, the outermost first
        self._main = _AseMaterial()
        self._skipped = 0  # open blocks when one began that is left out; 0: none has
        self._name_wanted = ""  # kind of that block until its name has come

    def parse(self, text: str) -> None:
        """Read all lines; a `MapImportError` names the one that makes no sense."""
        items = 0
        number = 0
        for number, line in _lines(text):
            key, _, rest = line.partition(" ")
            key, rest = key.upper(), rest.strip()
            # Brackets inside of names are no blocks.
            bare = _QUOTED.sub("", line) if '"' in line else line
            more = bare.count("{") - bare.count("}")
            if not self._skipped:
                items += self._line(number, key, rest, bare)
            elif key == "*NODE_NAME" and self._name_wanted:
                self._skip(rest.strip('"'))
            if more > 0:
                self._blocks += [key] * more
            elif more < 0:
                del self._blocks[more:]
            if self._skipped and len(self._blocks) < self._skipped:
                if self._name_wanted:
                    self._skip("")
                self._skipped = 0
            if items > MAX_ITEMS:
                raise broken(self._source, f"more than {MAX_ITEMS} vertices and faces", number)
        if self._blocks:
            raise broken(self._source, "the file ends inside a block", text.count("\n") + 1)

    def _line(self, number: int, key: str, rest: str, bare: str) -> int:
        """Take in a line that is not left out; how many vertices or faces it has.

        The line without its texts in quotes is `bare`.
        """
        inner = self._blocks[-1] if self._blocks else ""
        if "{" in bare and key.startswith("*") and BLOCKS.get(key[1:]) is not Support.READ:
            if bare.count("{") <= bare.count("}"):
                return 0  # there is nothing in it
            self._skipped = len(self._blocks) + 1
            self._name_wanted = key[1:]
            if inner in ("*GEOMOBJECT", "*MESH", "*MATERIAL", "*SUBMATERIAL", "*SCENE"):
                # A part of something that is read: its kind says all.
                self._skip("")
            return 0
        if "*MATERIAL_LIST" in self._blocks:
            self._material(key, rest, inner)
            return 0
        if "*GEOMOBJECT" in self._blocks:
            return self._geom(number, key, rest, inner)
        if key == "*GEOMOBJECT":
            self.geoms.append(_Geom())
        elif key == "*MATERIAL" and "{" in rest:
            # Some exporters write no list around their materials.
            self._material(key, rest, inner)
        elif self._blocks[:1] == ["*MATERIAL"]:
            self._material(key, rest, inner)
        return 0

    def _skip(self, name: str) -> None:
        """Count the block that is left out."""
        self._findings.skip(self._name_wanted, name)
        self._name_wanted = ""

    def _material(self, key: str, rest: str, inner: str) -> None:
        """A line of a material; a material with sub-materials is these."""
        if key == "*MATERIAL":
            self._main = _AseMaterial()
            self.materials.append([self._main])
        elif key == "*SUBMATERIAL" and self.materials:
            if self.materials[-1][0] is self._main:
                self.materials[-1].clear()
            self.materials[-1].append(_AseMaterial())
        elif not self.materials:
            return
        elif key == "*MATERIAL_NAME":
            # That of the material itself stands before those of its sub-materials.
            group = self.materials[-1]
            (self._main if inner == "*MATERIAL" else group[-1]).name = rest.strip('"')
        elif key == "*BITMAP" and "*MAP_DIFFUSE" in self._blocks:
            # Maps that are made of others hold theirs inside; the first one counts.
            group = self.materials[-1]
            material = group[-1] if "*SUBMATERIAL" in self._blocks else self._main
            material.picture = material.picture or rest.strip('"')

    def _geom(self, number: int, key: str, rest: str, inner: str) -> int:
        """A line of a mesh; how many vertices or faces it has."""
        geom, source = self.geoms[-1], self._source
        match key:
            case "*NODE_NAME" if inner == "*GEOMOBJECT":
                geom.name = rest.strip('"')
            case "*MATERIAL_REF" if inner == "*GEOMOBJECT":
                geom.material = int(_numbers(rest, 1, source, number)[0])
            case "*MESH_VERTEX":
                values = _numbers(rest, 4, source, number, whole=1)
                geom.vertices[int(values[0])] = values[1:4]
            case "*MESH_TVERT":
                values = _numbers(rest, 3, source, number, whole=1)
                geom.texture[int(values[0])] = values[1:3]
            case "*MESH_TFACE":
                values = _numbers(rest, 4, source, number)
                geom.corners[int(values[0])] = (int(values[1]), int(values[2]), int(values[3]))
            case "*MESH_FACE":
                face = _FACE.match(rest)
                if face is None:
                    raise broken(source, f"{key} {rest[:50]!r} is no face", number)
                geom.faces.append((int(face[1]), int(face[2]), int(face[3])))
                slot = _SLOT.search(rest)
                geom.slots.append(int(slot[1]) if slot else 0)
            case _:
                return 0
        return int(key.startswith("*MESH"))


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
    materials: list[list[_AseMaterial]], index: AssetIndex, folder: Path
) -> tuple[dict[str, Material], list[Path]]:
    known: dict[str, Material] = {}
    files = []
    for group in materials:
        for material in group:
            name, picture = material.name, material.picture
            plain = PureWindowsPath(picture).name
            found = index.find(picture or name, PICTURES)
            if found is not None and found.suffix.lower() in PICTURES:
                files.append(found)
            else:
                found = folder / plain if plain and plain.lower() != "none" else None
            known.setdefault(name, Material(name, texture=found))
    return known, files


def _object(
    geom: _Geom, turn: Array, materials: list[list[_AseMaterial]], source: Path
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
    names = tuple(material.name for material in group) or ("",)
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
