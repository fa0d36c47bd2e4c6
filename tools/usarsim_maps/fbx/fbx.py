"""Reads FBX, text and binary, as Unreal, Blender, Maya and 3ds Max write it (worlds 6).

The library is optional: `pip install usarsim-server[fbx]`. It runs in a process of its own, see
`library/`. Custom properties count on nodes as in glTF: `tag`, `movable`, `mass`, `friction`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from usarsim_maps.fbx.library.answer import (
    FbxMaterial,
    FbxMesh,
    FbxNode,
    FbxScene,
    FbxTexture,
    load_fbx,
)
from usarsim_maps.meshes.mesh_files import Axes, SceneBuilder, axes_of, collision_of
from usarsim_maps.meshes.polygons import make_mesh, triangulate
from usarsim_maps.meshes.vertex_colors import shaded
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import (
    Array,
    LightKind,
    Material,
    Mesh,
    Opacity,
    Part,
    Scene,
    SceneObject,
)
from usarsim_maps.support import Support, SupportTable, support_table
from usarsim_maps.units import MIRROR, affine
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.files import is_regular

SMALLEST, LARGEST = 1e-6, 1e6
"""Metres per unit that are believed."""

ATTRIBUTES = {
    "Mesh": "Mesh", "Light": "Light", "Camera": "Camera", "Bone": "Skeleton", "Empty": "Null",
    "LineCurve": "Line", "NurbsCurve": "NurbsCurve", "NurbsSurface": "NurbsSurface",
    "NurbsTrimSurface": "TrimNurbsSurface", "NurbsTrimBoundary": "Boundary",
    "ProceduralGeometry": "ProceduralGeometry", "StereoCamera": "CameraStereo",
    "CameraSwitcher": "CameraSwitcher", "Marker": "Marker", "LodGroup": "LODGroup",
}  # fmt: skip
"""What hangs on nodes, by the library's name; that of the format's own library."""

ATTRIBUTE_SUPPORT = support_table(
    read="LODGroup Light Mesh Null Skeleton",
    left_out=(
        "Boundary Camera CameraStereo CameraSwitcher Line Marker NurbsCurve NurbsSurface "
        "ProceduralGeometry TrimNurbsSurface Unknown"
    ),
)

OBJECT_SUPPORT = support_table(
    read="BlendShape DisplayLayer Geometry LayeredTexture Material Model Skin Texture Video",
    left_out="AnimationStack Audio Character Constraint VertexCache",
)

OTHERS = {
    "anim_stacks": "AnimationStack", "audio_clips": "Audio", "characters": "Character",
    "constraints": "Constraint", "cache_files": "VertexCache",
}  # fmt: skip
"""Objects by the library's list."""

SPOT = 2
SHAPES = {0: LightKind.POINT, 1: LightKind.DIRECTIONAL, SPOT: LightKind.SPOT}
"""Of lamps by the library's number; areas and volumes shine as points."""

UNSAID = {0, 1, 4, 9, 12}
"""Warnings of the library that need no word: files that nothing asks for, and what it mends."""

_LEVEL = re.compile(r"lod[_ ]?(\d+)$", re.IGNORECASE)


@register("fbx")
class FbxReader(Reader):
    """One object for every node with a mesh."""

    title = "FBX"
    extensions = (".fbx",)
    head = re.compile(rb"\AKaydara FBX Binary|\A\s*; FBX \d|(?:\A|\n)FBXHeaderExtension:")
    support: ClassVar[Mapping[str, SupportTable]] = {
        "FBX node attributes": ATTRIBUTE_SUPPORT,
        "FBX objects": OBJECT_SUPPORT,
    }

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        context.progress("reading", 0.0)
        file = load_fbx(source)
        return _FbxWorld(file, source, context, _axes(file, source, context)).filled()


def _axes(file: FbxScene, source: Path, context: Context) -> Axes:
    """Axes and unit of the file; y up and a centimetre, as is usual, where it says nothing."""
    unit = float(f"{file.unit:.7g}")  # 0.01 times a factor of single precision
    if not SMALLEST <= unit <= LARGEST:
        if context.options.scale is None:
            problem = f"UnitScaleFactor is {file.unit * 100.0:g}"
            raise MapImportError(at(source, problem, "give the true scale with --scale"))
        unit = 1.0
    turn = _turn(file.axes)
    up = "Y" if turn is None else ("X", "-X", "Y", "-Y", "Z", "-Z")[file.axes[1]]
    if turn is None and file.stated:
        context.findings.warn(source.name, "its axes make no sense; Y up was taken, see --up")
    stated = file.stated and turn is not None
    return axes_of(context.options, up, unit, stated=stated, turn=turn)


def _turn(axes: Sequence[int]) -> Array | None:
    """Matrix (3, 3) from the file's axes to right, back and up, where x, y and z of the world are.

    None if the axes are no three different ones. Left-handed files are reflected.
    """
    if len(axes) != 3 or sorted(axis // 2 for axis in axes) != [0, 1, 2]:
        return None
    right, up, front = (
        np.eye(3)[axis // 2] * (-1.0 if axis % 2 else 1.0) for axis in axes
    )  # `front` is the axis that points at the viewer
    return np.stack([right, -front, up])


class _FbxWorld(SceneBuilder):
    """A scene being filled."""

    def __init__(self, file: FbxScene, source: Path, context: Context, axes: Axes) -> None:
        super().__init__(source, context, axes)
        self._file = file
        self._scale = context.options.scale
        self._names = _unique([one.name or "material" for one in file.materials])
        self._materials: dict[str, Material] = {}
        for name, one in zip(self._names, file.materials, strict=True):
            self._materials[name] = self._material(name, one)

    def filled(self) -> Scene:
        """Everything that the file shows."""
        for node in self._shown():
            self._node(node)
        self._tell_rest()
        if not self.objects:
            what = ", ".join(f"{n} {kind}" for kind, n in sorted(self.findings.skipped.items()))
            problem = "there is no mesh in this file" + (f", but {what}" if what else "")
            raise MapImportError(at(self.path, problem, "export meshes, as polygons"))
        scene = self.scene("FBX", self._materials)
        centimetres = 100.0 / self.axes.units_per_metre
        unit = f"a unit is {centimetres:g} cm, as the file says"
        told = unit if self._scale is None and not self.axes.assumed else ""
        return replace(scene, source=replace(scene.source, unit=told))

    # ---- nodes -----------------------------------------------------------------------------

    def _shown(self) -> Iterator[FbxNode]:
        """Nodes that are neither hidden nor a coarser level of detail; parents first."""
        nodes = self._file.nodes
        gone: set[int] = set()  # left out with all in them
        hidden: set[int] = set()
        coarse = self._coarser()
        for number, node in enumerate(nodes):
            above = node.parent
            if above in gone or number in coarse:
                gone.add(number)
                if self._has_mesh(node):
                    self.findings.skip("coarser level of detail", node.name)
                continue
            unseen = not node.visible or number in self._file.hidden
            if unseen or (above in hidden and node.inherits):
                hidden.add(number)
                # What collides is not seen anyway.
                if collision_of(node.name) is None:
                    if node.attributes:
                        self.findings.skip("hidden node", node.name)
                    continue
            if not (np.isfinite(node.matrix).all() and np.isfinite(node.geometry).all()):
                gone.add(number)
                text = f"node {node.name!r:.60} has no place; left out with all in it"
                self.findings.warn(self.path.name, text)
                continue
            if node.parent is not None or node.attributes:  # the root is no thing of the file
                yield node

    def _coarser(self) -> set[int]:
        """Children of groups of levels of detail, all but the finest of each."""
        groups = {
            number
            for number, node in enumerate(self._file.nodes)
            if any(ATTRIBUTES.get(kind) == "LODGroup" for kind, _ in node.attributes)
        }
        levels: dict[int, list[int]] = {}
        for number, node in enumerate(self._file.nodes):
            if node.parent in groups and node.parent is not None:
                levels.setdefault(node.parent, []).append(number)
        coarse: set[int] = set()
        for children in levels.values():
            seen = [n for n in children if collision_of(self._file.nodes[n].name) is None]
            finest = min(seen, key=lambda n: _level(self._file.nodes[n].name), default=-1)
            coarse |= set(seen) - {finest}
        return coarse

    def _has_mesh(self, node: FbxNode) -> bool:
        return any(ATTRIBUTES.get(kind) == "Mesh" for kind, _ in node.attributes)

    def _node(self, node: FbxNode) -> None:
        meshes, marked = 0, False
        for kind, number in node.attributes:
            what = ATTRIBUTES.get(kind, "Unknown")
            if ATTRIBUTE_SUPPORT[what] is not Support.READ:
                self.findings.skip(what, node.name)
            elif what == "Mesh":
                meshes += self._show(node, self._file.meshes[number])
            elif what == "Light":
                self._lamp(node, number)
            else:
                marked |= what == "Null"
        if marked or not node.attributes:
            self.mark(node.name, self._upright(node.matrix), self._text(node, "tag"))
        if meshes:
            self.findings.count("mesh node")

    def _upright(self, matrix: Array) -> Array:
        """The matrix of a node so that its pose stands upright if one of its axes does.

        Programs with z up turn every node when they write files with y up: then the node's z axis
        points up, and not the one that the file has upwards.
        """
        turn = self.axes.linear * self.axes.units_per_metre
        as_file = (turn @ matrix[:3, :3] @ turn.T)[2, 2]
        size = max(float(np.linalg.norm(matrix[:3, :3], axis=0).max()), 1e-12)
        as_node = (turn @ matrix[:3, :3])[2, 2]
        if as_node <= as_file + 1e-6 * size:
            return matrix
        proper = turn if np.linalg.det(turn) > 0.0 else MIRROR @ turn
        return affine(matrix[:3, :3] @ proper, matrix[:3, 3])

    def _show(self, node: FbxNode, mesh: FbxMesh) -> bool:
        """Add an object; whether there is anything of it."""
        made = self.mesh(id(mesh), lambda: self._made(mesh))
        if made is None:
            return False
        shape = node.geometry if mesh.local else np.eye(4)
        pose, local = self.axes.place(node.matrix, shape)
        own = {}
        if mesh.materials and node.materials != mesh.materials:
            own = {slot: self._names[n] for slot, n in enumerate(node.materials)}
        mass = self._number(node, "mass")
        friction = self._number(node, "friction")
        self.objects.append(
            SceneObject(
                name=node.name or mesh.name or f"node{len(self.objects)}",
                parts=(Part(made, local, materials=own),),
                pose=pose,
                tag=self._text(node, "tag"),
                kind=self._text(node, "class") or "node",
                movable=bool(self._number(node, "movable")),
                mass=mass,
                friction=friction,
            )
        )
        return True

    def _text(self, node: FbxNode, name: str) -> str:
        value = node.facts.get(name, "")
        return value if isinstance(value, str) else f"{value:g}"

    def _number(self, node: FbxNode, name: str) -> float | None:
        """A positive number among the custom properties of a node."""
        value = node.facts.get(name)
        return value if isinstance(value, float) and 0.0 < value < np.inf else None

    def _lamp(self, node: FbxNode, number: int) -> None:
        lamp = self._file.lights[number]
        values = np.nan_to_num([*lamp.color, *lamp.direction, lamp.intensity, lamp.cone])
        if not lamp.on or values[6] <= 0.0:
            self.findings.skip("Light that is switched off", node.name)
            return
        matrix = affine(offset=node.matrix[:3, 3])
        matrix[:3, 2] = -(node.matrix[:3, :3] @ values[3:6])
        self.light(
            node.name or "light",
            SHAPES.get(lamp.kind, LightKind.POINT),
            matrix,
            values[:3].clip(0.0, 1.0).tolist(),
            brightness=min(1.0, float(values[6])),
            cone=min(90.0, max(1.0, float(values[7]) / 2.0)) if lamp.kind == SPOT else 45.0,
            shadows=lamp.shadows,
        )

    def _tell_rest(self) -> None:
        """Count what is in the file and has no part in the world."""
        for key, found in self._file.others.items():
            for name, kind in found:
                what = OTHERS.get(key, kind or "Unknown")
                if OBJECT_SUPPORT.get(what) is not Support.READ:
                    self.findings.skip(what, name)
        for name, weight in self._file.shapes:
            if weight == 0.0:
                self.findings.skip("BlendShape of no weight", name)
        for number, text in self._file.warnings:
            if number not in UNSAID:
                self.findings.warn(self.path.name, f"the FBX library notes: {text}"[:200])
        if any(mesh.smooth for mesh in self._file.meshes):
            text = "subdivision surfaces are shown as their cages"
            self.findings.warn(self.path.name, text)

    # ---- meshes ----------------------------------------------------------------------------

    def _made(self, mesh: FbxMesh) -> Mesh | None:
        name = mesh.name or "mesh"
        begins, sizes = mesh.faces[:, 0], mesh.faces[:, 1]
        ends = np.cumsum(sizes)
        order = np.arange(int(sizes.sum())) + np.repeat(begins - (ends - sizes), sizes)
        corners = mesh.corners[order]
        triangles, owners = triangulate(mesh.points[corners], sizes)
        if not len(triangles):
            self.findings.skip("points and lines", name)
            return None
        slots = None if not len(mesh.slots) else mesh.slots[owners].clip(0)
        names = [self._names[number] for number in mesh.materials]
        uvs = None if mesh.uvs is None else mesh.uvs[order][triangles]
        if not names:
            slots, uvs = None, None
            if mesh.colors is not None:
                found, slots = shaded(mesh.colors[order][triangles].mean(axis=1))
                names = [one.name for one in found]
                self._materials |= {one.name: one for one in found}
        elif uvs is not None:
            uvs = self._in_pictures(uvs, mesh, slots)
        return make_mesh(
            name, mesh.points, corners[triangles], uvs=uvs, slots=slots, materials=names
        )

    def _in_pictures(self, uvs: Array, mesh: FbxMesh, slots: Array | None) -> Array | None:
        """Texture coordinates moved as the textures of the materials say; None if none has one."""
        used = [self._file.materials[number] for number in mesh.materials]
        numbers = [one.holes if one.texture is None else one.texture for one in used]
        found = [None if number is None else self._file.textures[number] for number in numbers]
        if all(texture is None for texture in found):
            return None
        uvs = uvs.copy()
        for slot, texture in enumerate(found):
            if texture is None or texture.matrix is None:
                continue
            chosen = np.ones(len(uvs), bool) if slots is None else slots == slot
            uvs[chosen] = uvs[chosen] @ texture.matrix[:2, :2].T + texture.matrix[:2, 3]
        return np.nan_to_num(uvs)

    # ---- looks -----------------------------------------------------------------------------

    def _texture(self, material: FbxMaterial) -> FbxTexture | None:
        return None if material.texture is None else self._file.textures[material.texture]

    def _material(self, name: str, found: FbxMaterial) -> Material:
        opacity, holes = self._opacity(found), self._holes(found)
        texture = self._texture(found)
        if texture is not None and (texture.content or any(texture.names)):
            material = Material(
                name, (1.0, 1.0, 1.0, opacity), repeat=texture.repeat, opacity=holes
            )
            if texture.content:
                return replace(material, image=texture.content)
            return replace(material, texture=self._picture(texture.names))
        color = (0.7, 0.7, 0.7) if found.color is None else found.color
        factor = 1.0 if found.factor is None else found.factor
        r, g, b = np.nan_to_num(np.clip(np.array(color) * factor, 0.0, 1.0)).tolist()
        return Material(name, (r, g, b, opacity), opacity=holes)

    def _holes(self, found: FbxMaterial) -> Opacity | None:
        """Opacity by a picture, which is the one of the surface or another.

        By the format's own library a bright picture is clear; programs write a dark one for that,
        or the alpha channel of the picture.
        """
        if found.holes is None:
            return None
        if found.holes == found.texture:
            return Opacity(blend=True)
        texture = self._file.textures[found.holes]
        if texture.content:
            return Opacity(texture.content, blend=True)
        picture = self._picture(texture.names) if any(texture.names) else None
        return None if picture is None else Opacity(picture, blend=True)

    def _picture(self, names: Sequence[str]) -> Path | None:
        """The first picture of these names that is there; else where it should be."""
        paths = [self.pictures.find(name) for name in names if name]
        return next((path for path in paths if path is not None and is_regular(path)), paths[0])

    def _opacity(self, found: FbxMaterial) -> float:
        """Opacity of a material: by `Opacity`, else one less what passes, else by its picture."""
        told = found.pbr_opacity if found.pbr_opacity is not None else found.opacity
        if told is None and found.holes is not None:
            return 1.0
        if told is None:
            passes = 0.0 if found.clear is None else float(np.mean(found.clear))
            if found.clear_factor is not None:
                passes = found.clear_factor * (1.0 if found.clear is None else passes)
            told = 1.0 - passes
        return float(np.nan_to_num(np.clip(told, 0.0, 1.0), nan=1.0))


def _level(name: str) -> int:
    """The level of detail that a name tells; 0 if it tells none."""
    found = _LEVEL.search(name)
    return int(found[1]) if found is not None and len(found[1]) < 9 else 0


def _unique(names: Sequence[str]) -> list[str]:
    """The names, equal ones with numbers behind them."""
    seen: set[str] = set()
    answer = []
    for name in names:
        number, free = 1, name
        while free in seen:
            number += 1
            free = f"{name}-{number}"
        seen.add(free)
        answer.append(free)
    return answer
