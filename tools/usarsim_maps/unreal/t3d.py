"""Reads T3D, the text that Unreal editors of generations 1 to 3 export (worlds reference 4)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.files import read_text
from usarsim_maps.placing import matrix_of_pose
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Collision, Mesh, Part, Scene
from usarsim_maps.units import pose_of_matrix, unreal_matrix, unreal_pose
from usarsim_maps.unreal.level import NO_COLLISION, PLACEHOLDER, Actor, UnrealLevel
from usarsim_maps.unreal.map_actors import ActorKind, kind_of
from usarsim_maps.unreal.t3d_actors import (
    actor_matrix,
    brush_of,
    light_of,
    mesh_of_block,
    polygons_of,
)
from usarsim_maps.unreal.t3d_text import Block, T3dError, parse, reference, rotator, vector
from usarsim_server.errors import MapImportError, at
from usarsim_server.simulation.frames import IDENTITY

Array = NDArray[np.float64]

MAX_BYTES = 96 << 20
"""Blocks take about ten times the memory of their text."""


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
        """See `Reader.read`; an error names the line (item 73)."""
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


class _Level:
    """A level being filled from blocks."""

    def __init__(self, source: Path, context: Context, title: str) -> None:
        self._source = source
        self._context = context
        self._findings = context.findings
        self._level = UnrealLevel(source, context, title)
        self._scale = self._level.scale
        level = self._level
        self._add: dict[ActorKind, Callable[[Block, Actor], None]] = {
            ActorKind.BRUSH: self._add_brush,
            ActorKind.MESH: self._add_mesh,
            ActorKind.MOVABLE: self._add_movable,
            ActorKind.START: lambda block, actor: level.add_start(actor),
            ActorKind.PATH_NODE: lambda block, actor: level.add_node(actor),
            ActorKind.VICTIM: lambda block, actor: level.add_victim(actor),
            ActorKind.LIGHT: self._add_light,
            ActorKind.SMOKE: lambda block, actor: level.add_smoke(actor),
            ActorKind.FOG: self._add_fog,
            ActorKind.LEVEL: self._add_level,
        }

    def scene(self) -> Scene:
        """What was found."""
        return self._level.scene()

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
                self._findings.skip(f"block {block.kind}")
        self._level.whole_map = bool(actors)
        for number, block in enumerate(actors):
            if number % 200 == 0:
                self._context.progress("actors", number / len(actors))
            actor_class = block.attributes.get("class", "?")
            handler = self._add.get(kind_of(actor_class))
            if handler is None:
                self._findings.skip(actor_class)
                continue
            self._findings.count(actor_class)
            handler(block, self._actor(block, actor_class))

    def _actor(self, block: Block, actor_class: str) -> Actor:
        properties = block.properties
        rotation = rotator(properties.get("rotation", ""))
        scale = np.array(vector(properties.get("drawscale3d", ""), 1.0))
        x, y, z = (scale * block.number("drawscale", 1.0)).tolist()
        return Actor(
            name=block.attributes.get("name") or block.get("name") or actor_class,
            kind=block.attributes.get("class", ""),
            tag=block.get("tag"),
            pose=unreal_pose(vector(properties.get("location", "")), rotation, self._scale),
            yaw=rotation[1],
            scale=(x, y, z),
        )

    # ---- solids ----------------------------------------------------------------------------

    def _add_brush(self, block: Block, actor: Actor) -> None:
        brush = brush_of(block, self._scale, self._findings)
        if brush is not None:
            self._level.add_brush(brush)

    def _add_mesh(self, block: Block, actor: Actor) -> None:
        self._add_object(block, actor, movable=False)

    def _add_movable(self, block: Block, actor: Actor) -> None:
        self._add_object(block, actor, movable=True)

    def _add_object(self, block: Block, actor: Actor, movable: bool) -> None:
        """A static mesh; its name is in a component (UE3) or on the actor (UE2)."""
        if block.get("deletestatus") or block.flag("bdeleteme", False):
            return
        parts = []
        matrix = actor_matrix(block, self._scale)
        owners = [child for child in block.inner("object") if "staticmesh" in child.properties]
        for owner in owners or [block]:
            path = reference(owner.properties.get("staticmesh", ""))
            if not path:
                if list(block.inner("brush")):
                    parts += self._brush_part(block)
                continue
            mesh = self._level.library.mesh(path)
            local = matrix @ _component_matrix(owner, self._scale) if owner is not block else matrix
            if mesh is None:
                if self._context.options.placeholders:
                    parts.append(Part(PLACEHOLDER, matrix_of_pose(pose_of_matrix(matrix))))
                continue
            parts.append(
                Part(
                    mesh,
                    local,
                    visible=not block.flag("bhidden", False),
                    collision=_collision(block, owner),
                    materials=_overrides(owner),
                )
            )
        self._level.add_object(actor, matrix, parts, movable)

    def _brush_part(self, block: Block) -> list[Part]:
        """A mover of UE1 or UE2: polygons that do not take part in the level's CSG."""
        polygons, _ = polygons_of(block, self._scale, self._findings)
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
        name = block.attributes.get("name", self._source.stem)
        mesh = mesh_of_block(block, name, self._scale, self._findings)
        if mesh is not None:
            actor = Actor(name, "StaticMesh", "", IDENTITY)
            self._level.add_object(actor, np.eye(4), [Part(mesh)])

    # ---- air and light ---------------------------------------------------------------------

    def _add_light(self, block: Block, actor: Actor) -> None:
        components = [
            b for b in block.inner("object") if "light" in b.attributes.get("class", "").lower()
        ]
        self._level.add_light(
            light_of(actor.name, actor.kind.lower(), actor.pose, [block, *components], self._scale)
        )

    def _add_fog(self, block: Block, actor: Actor) -> None:
        density = max((b.number("fogdensity", 0.0) for b in block.inner("object")), default=0.0)
        self._level.add_fog(actor, density or block.number("fogdensity", 0.0))

    def _add_level(self, block: Block, actor: Actor) -> None:
        if "killz" in block.properties:
            self._level.kill_z = block.number("killz", 0.0) / self._scale
        self._level.title = self._level.title or block.get("title")


def _component_matrix(component: Block, scale: float) -> Array:
    """A component's own offset in its actor (UE3)."""
    properties = component.properties
    scale3d = np.array(vector(properties.get("scale3d", ""), 1.0))
    return unreal_matrix(
        vector(properties.get("translation", "")),
        rotator(properties.get("rotation", "")),
        (scale3d * component.number("scale", 1.0)).tolist(),
        scale=scale,
    )


def _collision(actor: Block, owner: Block) -> Collision:
    off = not actor.flag("bcollideactors", True) or not owner.flag("collideactors", True)
    off |= not actor.flag("bblockactors", True) or not owner.flag("blockactors", True)
    off |= actor.get("collisiontype").lower() in NO_COLLISION
    return Collision.NONE if off else Collision.AUTO


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
