"""Reads T3D, the text that Unreal editors of generations 1 to 3 export (worlds reference 4)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from usarsim_maps.files import read_text
from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Brush, Mesh, Part, Polygon, Scene
from usarsim_maps.units import matrix_of_pose, pose_of_matrix, unreal_matrix, unreal_points
from usarsim_maps.unreal.grammar import Block, T3dError, numbers, parse, reference, value_of
from usarsim_maps.unreal.level import (
    OPERATIONS,
    PLACEHOLDER,
    TEXTURE_SIZE,
    Actor,
    UnrealLevel,
    collision_of,
    component_matrix,
    draw_scale,
    light,
    solidity_of,
    world_polygon,
)
from usarsim_maps.unreal.names import ActorKind, kind_of
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.simulation.frames import IDENTITY

MAX_BYTES = 96 << 20
"""Blocks take about ten times the memory of their text."""

BIGGEST = 1e7
"""UU: coordinates beyond this are nonsense (UE3's world ends at 262 144)."""

UE1_RADIUS, UE1_BRIGHTNESS = 25.0, 64.0
"""UU per step of LightRadius; LightBrightness of an ordinary lamp."""


@register("t3d")
class T3dReader(Reader):
    """Levels, and static meshes that were exported as T3D."""

    title = "Unreal T3D"
    extensions = (".t3d",)

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """It begins with `Begin Map`, `Begin Object` or the like."""
        text = head.replace(b"\0", b"").lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n").lower()
        return text.startswith((b"begin map", b"begin level", b"begin staticmesh", b"begin actor"))

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`; an error names the line (worlds 73)."""
        try:
            root = parse(
                read_text(source, MAX_BYTES), lambda part: context.progress("reading", part)
            )
        except T3dError as error:
            cure = "the file is damaged or cut off; export it again"
            raise MapImportError(at(source, str(error), cure, where=f"line {error.line}")) from None
        level = _Level(source, context, self.title)
        level.add_all(root)
        return level.scene()


class _Level(UnrealLevel):
    """A level being filled from blocks."""

    def __init__(self, source: Path, context: Context, title: str) -> None:
        super().__init__(source, context, title)
        self._add: dict[ActorKind, Callable[[Block, Actor], None]] = {
            ActorKind.BRUSH: self._add_brush,
            ActorKind.MESH: self._add_mesh,
            ActorKind.MOVABLE: partial(self._add_mesh, movable=True),
            ActorKind.LIGHT: self._add_light,
            ActorKind.FOG: self._add_fog_of,
            ActorKind.LEVEL: lambda block, actor: self.add_info(block),
        }

    def add_all(self, root: Block) -> None:
        """Everything in the file, actors in the order of the level."""
        actors: list[Block] = []
        todo = list(root.children)
        while todo:
            block = todo.pop(0)
            if block.kind in ("map", "level"):
                todo[:0] = block.children
            elif block.kind == "actor":
                actors.append(block)
            elif block.kind == "staticmesh":
                self._add_static_mesh(block)
            elif block.kind not in ("surface",):
                self.findings.skip(f"block {block.kind}")
        self.whole_map = bool(actors)
        for number, block in enumerate(actors):
            if number % 200 == 0:
                self.context.progress("actors", number / len(actors))
            actor_class = block.attributes.get("class", "?")
            kind = kind_of(actor_class)
            name = block.attributes.get("name") or block.text("name") or actor_class
            actor = Actor.of(name, block.attributes.get("class", ""), block, self.scale)
            if kind in self._add:
                self._add[kind](block, actor)
            elif not self.add_actor(kind, actor):
                self.findings.skip(actor_class)
                continue
            self.findings.count(actor_class)

    # ---- solids ----------------------------------------------------------------------------

    def _add_brush(self, block: Block, actor: Actor) -> None:
        """The next step of the program, unless it is the builder brush, which is a tool (17)."""
        operation = OPERATIONS.get(block.text("csgoper").lower())
        if operation is None:
            return
        name = block.attributes.get("name") or block.text("name") or "Brush"
        polygons, flags = self._polygons(block)
        if not polygons:
            self.findings.warn(name, "a brush without polygons was left out")
            return
        solidity = solidity_of(flags | int(block.number("polyflags", 0.0)), operation)
        if solidity is not None:
            brush = Brush(name, tuple(polygons), operation, solidity, actor.tag)
            self.brushes.append(brush)

    def _polygons(self, block: Block) -> tuple[list[Polygon], int]:
        """Polygons of an actor's inner PolyList in the world, and the flags that all of them have.

        The list at actor level is empty; the real one is inside `Begin Brush` (worlds 15).
        """
        lists = [plist for brush in block.inner("brush") for plist in brush.inner("polylist")]
        if not any(plist.children for plist in lists):
            lists = list(block.inner("polylist"))
        matrix = self._matrix(block)
        polygons: list[Polygon] = []
        common = -1
        for inner in (polygon for plist in lists for polygon in plist.inner("polygon")):
            found = _polygon(inner, self.scale)
            if found is None:
                name = block.attributes.get("name", "Brush")
                self.findings.warn(name, "a broken polygon was left out")
                continue
            common &= int(_first(inner.attributes.get("flags", "0")))
            material = reference(inner.attributes.get("texture", ""))
            polygons.append(world_polygon(*found, material, matrix))
        return polygons, common if polygons else 0

    def _matrix(self, block: Block) -> Array:
        """(4, 4) from the actor's mirrored local frame in metres into the world (worlds 11, 12)."""
        return unreal_matrix(
            block.vector("location"),
            block.rotator("rotation"),
            draw_scale(block),
            block.vector("prepivot"),
            self.scale,
            _brush_scale(block.properties.get("mainscale", "")),
            _brush_scale(block.properties.get("postscale", "")),
        )

    def _add_mesh(self, block: Block, actor: Actor, movable: bool = False) -> None:
        """A static mesh; its name is in a component (UE3) or on the actor (UE2)."""
        if block.text("deletestatus") or block.flag("bdeleteme", False):
            return
        parts = []
        matrix = self._matrix(block)
        owners = [child for child in block.inner("object") if "staticmesh" in child.properties]
        for owner in owners or [block]:
            path = reference(owner.properties.get("staticmesh", ""))
            if not path:
                if list(block.inner("brush")):
                    parts += self._brush_part(block)
                continue
            mesh = self.library.mesh(path)
            local = matrix @ component_matrix(owner, self.scale) if owner is not block else matrix
            if mesh is None:
                if self.context.options.placeholders:
                    parts.append(Part(PLACEHOLDER, matrix_of_pose(pose_of_matrix(matrix))))
                continue
            parts.append(
                Part(
                    mesh,
                    local,
                    visible=not block.flag("bhidden", False),
                    collision=collision_of(block, owner),
                    materials=_overrides(owner),
                )
            )
        self.add_object(actor, matrix, parts, movable)

    def _brush_part(self, block: Block) -> list[Part]:
        """A mover of UE1 or UE2: polygons that do not take part in the level's CSG."""
        polygons, _ = self._polygons(block)
        triangles = []
        count = 0
        for polygon in polygons:
            size = len(polygon.vertices)
            triangles += [(count, count + k, count + k + 1) for k in range(1, size - 1)]
            count += size
        if not triangles:
            return []
        vertices = np.concatenate([polygon.vertices for polygon in polygons])
        return [Part(Mesh("mover", vertices, np.array(triangles, dtype=np.int32)))]

    def _add_static_mesh(self, block: Block) -> None:
        """A file that holds a mesh instead of a level."""
        name = block.attributes.get("name", self.source.stem)
        mesh = mesh_of_block(block, name, self.scale, self.findings)
        if mesh is not None:
            actor = Actor(name, "StaticMesh", "", IDENTITY)
            self.add_object(actor, np.eye(4), [Part(mesh)])

    # ---- air and light ---------------------------------------------------------------------

    def _add_light(self, block: Block, actor: Actor) -> None:
        """An actor and its components: UE3's values, or UE1's hue and brightness."""
        owners = [block]
        for inner in block.inner("object"):
            if "light" in inner.attributes.get("class", "").lower():
                owners.append(inner)
        radius = brightness = 0.0
        color = (1.0, 1.0, 1.0)
        for owner in owners:
            steps, strength = owner.number("lightradius", 0.0), owner.number("lightbrightness", 0.0)
            radius = owner.number("radius", steps * UE1_RADIUS) or radius
            brightness = owner.number("brightness", strength / UE1_BRIGHTNESS) or brightness
            color = _color(owner) or color
        self.lights.append(
            light(
                actor.name,
                actor.kind.lower(),
                actor.pose,
                self.scale,
                radius=radius,
                brightness=brightness,
                color=color,
                cone=next((o.number("outerconeangle", 0.0) for o in reversed(owners)), 0.0),
            )
        )

    def _add_fog_of(self, block: Block, actor: Actor) -> None:
        density = max((b.number("fogdensity", 0.0) for b in block.inner("object")), default=0.0)
        self.add_fog(actor, density or block.number("fogdensity", 0.0))


def _brush_scale(text: str) -> tuple[float, float, float]:
    """The scale in `(Scale=(X=2),SheerAxis=SHEER_ZX)` of UE1 and UE2; sheer is not used."""
    value = value_of(text)
    inner = "" if isinstance(value, str) else value.get("scale", "")
    if isinstance(inner, str):
        return 1.0, 1.0, 1.0
    parts = [numbers(str(inner.get(key, ""))) for key in ("x", "y", "z")]
    x, y, z = (part[0] if part else 1.0 for part in parts)
    return x, y, z


def _polygon(block: Block, scale: float) -> tuple[Array, Array | None] | None:
    """Corners in the mirrored local frame (m) and texture coordinates; None if it is broken."""
    corners: list[list[float]] = []
    axes: dict[str, list[float]] = {}
    for _, line in block.lines:
        word, _, rest = line.partition(" ")
        word = word.lower()
        if word == "vertex":
            values = numbers(rest)
            if len(values) < 3 or max(map(abs, values[:3])) > BIGGEST:
                return None
            corners.append(values[:3])
        elif word in ("origin", "textureu", "texturev"):
            axes[word] = numbers(rest)[:3]
        elif word == "pan":
            axes[word] = numbers(rest)[:2]
    if len(corners) < 3:
        return None
    points = np.array(corners)
    return unreal_points(points, scale), _uvs(points, axes)


def _uvs(points: Array, axes: dict[str, list[float]]) -> Array | None:
    u, v = axes.get("textureu", []), axes.get("texturev", [])
    if len(u) < 3 or len(v) < 3:
        return None
    origin = axes.get("origin", [])
    base = np.array(origin if len(origin) == 3 else [0.0, 0.0, 0.0])
    pan = axes.get("pan", [])
    offset = np.array(pan if len(pan) == 2 else [0.0, 0.0])
    down = ((points - base) @ np.column_stack([u, v]) + offset) / TEXTURE_SIZE
    answer: Array = down * np.array([1.0, -1.0])
    return answer if np.isfinite(answer).all() else None


def _first(text: str) -> float:
    found = numbers(text)
    return found[0] if found else 0.0


def _color(owner: Block) -> tuple[float, float, float] | None:
    value = value_of(owner.properties.get("lightcolor", ""))
    if isinstance(value, str) or not value:
        return None
    parts = []
    for key in "rgb":
        member = value.get(key, "0")
        text = member.strip() if isinstance(member, str) else "0"
        parts.append(min(255.0, max(0.0, float(text) if text.isdigit() else 0.0)) / 255.0)
    return parts[0], parts[1], parts[2]


def mesh_of_block(block: Block, name: str, scale: float, findings: Findings) -> Mesh | None:
    """The mesh of a `Begin StaticMesh` block; None if it has no triangles.

    Each triangle names its texture and three `Vertex n x y z u v` lines. Their order is the
    reverse of that of brushes, so the reflection into the simulation frame sets it right.
    """
    corners: list[list[list[float]]] = []
    slots: list[int] = []
    materials: dict[str, int] = {}
    broken = 0
    for triangle in block.inner("triangle"):
        vertices = []
        material = ""
        for _, line in triangle.lines:
            word, _, rest = line.replace("=", " ", 1).partition(" ")
            match word.lower():
                case "vertex":
                    values = numbers(rest)
                    if len(values) >= 4:
                        vertices.append([*values[1:6], 0.0, 0.0][:5])
                case "texture":
                    material = rest.strip()
        if len(vertices) != 3:
            broken += 1
            continue
        corners.append(vertices)
        slots.append(materials.setdefault(material, len(materials)))
    if broken:
        findings.warn(name, f"{broken} triangles without three vertices were left out")
    if not corners:
        return None
    table = np.array(corners)
    points = unreal_points(table[:, :, :3].reshape(-1, 3), scale)
    uvs = table[:, :, 3:5] * np.array([1.0, -1.0]) + np.array([0.0, 1.0])
    return Mesh(
        name=name,
        vertices=points,
        triangles=np.arange(len(points), dtype=np.int32).reshape(-1, 3),
        uvs=uvs,
        slots=np.array(slots, dtype=np.int32),
        materials=tuple(materials),
    )


def _overrides(owner: Block) -> dict[int, str]:
    """Materials by slot: `Materials(0)=Material'A.B'`, `Skins(0)=...`."""
    found = {}
    for key, value in owner.properties.items():
        if key.startswith(("materials(", "skins(")) and key.endswith(")"):
            slot = key.partition("(")[2][:-1]
            path = reference(value)
            if slot.isdigit() and path and int(slot) < 1000:
                found[int(slot)] = path
    return found
