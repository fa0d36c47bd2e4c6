"""Reads T3D, the text that Unreal editors of generations 1 to 3 export (worlds reference 4)."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_server.errors import MapImportError, at
from usarsim_server.importers.assets import AssetLibrary
from usarsim_server.importers.files import read_text
from usarsim_server.importers.placing import matrix_of_pose
from usarsim_server.importers.reader import Context, Reader, register
from usarsim_server.importers.reflect import reflect
from usarsim_server.importers.scene import (
    Box,
    Brush,
    Collision,
    Light,
    Material,
    Mesh,
    Part,
    PathNode,
    Scene,
    SceneObject,
    Source,
    Start,
    Victim,
)
from usarsim_server.importers.t3d_brush import actor_matrix, brush_of, polygons_of
from usarsim_server.importers.t3d_light import light_of
from usarsim_server.importers.t3d_mesh import mesh_of_block
from usarsim_server.importers.t3d_text import (
    Block,
    T3dError,
    parse,
    reference,
    rotator,
    vector,
)
from usarsim_server.importers.units import (
    UU_PER_METRE,
    pose_of_matrix,
    unreal_matrix,
    unreal_pose,
)
from usarsim_server.importers.unreal_actors import (
    ActorKind,
    VictimNames,
    is_victim_tag,
    kind_of,
    path_node_of,
    start_of,
    victim_of_tag,
)
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import Smoke, SmokePuff

__all__ = ["T3dReader"]

Array = NDArray[np.float64]

MAX_BYTES = 96 << 20
"""Blocks take about ten times the memory of their text."""
PLACEHOLDER = Box((0.5, 0.5, 0.5))
NO_COLLISION = {"collide_nocollision", "collide_touchall", "collide_touchallbutweapons"}


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
        level = _Level(source, context)
        level.add_all(root)
        return reflect(level.scene()) if context.options.mirror else level.scene()


class _Level:
    """A scene being filled from blocks."""

    def __init__(self, source: Path, context: Context) -> None:
        options = context.options
        self._source = source
        self._context = context
        self._findings = context.findings
        self._scale = options.scale or UU_PER_METRE
        self._library = AssetLibrary(source, context, self._scale)
        self._victim_names = VictimNames()
        self._objects: list[SceneObject] = []
        self._brushes: list[Brush] = []
        self._starts: list[Start] = []
        self._nodes: list[PathNode] = []
        self._victims: list[Victim] = []
        self._lights: list[Light] = []
        self._puffs: list[SmokePuff] = []
        self._haze = 0.0
        self._kill_z: float | None = None
        self._title = ""
        self._add: dict[ActorKind, Callable[[Block, str], None]] = {
            ActorKind.BRUSH: self._add_brush,
            ActorKind.MESH: self._add_mesh,
            ActorKind.MOVABLE: self._add_movable,
            ActorKind.START: self._add_start,
            ActorKind.PATH_NODE: self._add_node,
            ActorKind.VICTIM: self._add_victim,
            ActorKind.LIGHT: self._add_light,
            ActorKind.SMOKE: self._add_smoke,
            ActorKind.FOG: self._add_fog,
            ActorKind.LEVEL: self._add_level,
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
                self._findings.skip(f"block {block.kind}")
        for number, actor in enumerate(actors):
            if number % 200 == 0:
                self._context.progress("actors", number / len(actors))
            actor_class = actor.attributes.get("class", "?")
            handler = self._add.get(kind_of(actor_class))
            if handler is None:
                self._findings.skip(actor_class)
                continue
            self._findings.count(actor_class)
            handler(actor, actor.attributes.get("name") or actor.get("name") or actor_class)

    def scene(self) -> Scene:
        """What was found."""
        materials = self._materials()
        files = tuple(dict.fromkeys([self._source, *self._library.files]))
        return Scene(
            source=Source(
                path=self._source,
                format="Unreal T3D",
                units_per_metre=self._scale,
                mirrored=True,
                files=files,
            ),
            objects=tuple(self._objects),
            brushes=tuple(self._brushes),
            materials=materials,
            starts=tuple(self._starts),
            path_nodes=tuple(self._nodes),
            victims=tuple(self._victims),
            lights=tuple(self._lights),
            smoke=Smoke(puffs=tuple(self._puffs), haze=self._haze),
            kill_z=self._kill_z,
            title=self._title,
        )

    # ---- solids ----------------------------------------------------------------------------

    def _add_brush(self, actor: Block, name: str) -> None:
        brush = brush_of(actor, self._scale, self._findings)
        if brush is not None:
            self._brushes.append(brush)

    def _add_mesh(self, actor: Block, name: str) -> None:
        self._add_object(actor, name, movable=False)

    def _add_movable(self, actor: Block, name: str) -> None:
        self._add_object(actor, name, movable=True)

    def _add_object(self, actor: Block, name: str, movable: bool) -> None:
        """A static mesh; its name is in a component (UE3) or on the actor (UE2)."""
        if actor.get("deletestatus") or actor.flag("bdeleteme", False):
            return
        parts = []
        matrix = actor_matrix(actor, self._scale)
        rigid = pose_of_matrix(matrix)
        back = matrix_of_pose(rigid.inverse())
        owners = [child for child in actor.inner("object") if "staticmesh" in child.properties]
        for owner in owners or [actor]:
            path = reference(owner.properties.get("staticmesh", ""))
            if not path:
                if list(actor.inner("brush")):
                    parts += self._brush_part(actor, back)
                continue
            mesh = self._library.mesh(path)
            local = matrix @ _component_matrix(owner, self._scale) if owner is not actor else matrix
            if mesh is None:
                if self._context.options.placeholders:
                    parts.append(Part(PLACEHOLDER))
                continue
            parts.append(
                Part(
                    mesh,
                    back @ local,
                    visible=not actor.flag("bhidden", False),
                    collision=_collision(actor, owner),
                    materials=_overrides(owner),
                )
            )
        if parts:
            self._objects.append(
                SceneObject(
                    name=name,
                    parts=tuple(parts),
                    pose=rigid,
                    tag=actor.get("tag"),
                    kind=actor.attributes.get("class", ""),
                    movable=movable,
                )
            )

    def _brush_part(self, actor: Block, back: Array) -> list[Part]:
        """A mover of UE1 or UE2: polygons that do not take part in the level's CSG."""
        polygons, _ = polygons_of(actor, self._scale, self._findings)
        vertices, triangles = [], []
        count = 0
        for polygon in polygons:
            size = len(polygon.vertices)
            vertices.append(polygon.vertices @ back[:3, :3].T + back[:3, 3])
            triangles += [(count, count + k, count + k + 1) for k in range(1, size - 1)]
            count += size
        if not triangles:
            return []
        mesh = Mesh("mover", np.concatenate(vertices), np.array(triangles, dtype=np.int32))
        return [Part(mesh)]

    def _add_static_mesh(self, block: Block) -> None:
        """A file that holds a mesh instead of a level."""
        name = block.attributes.get("name", self._source.stem)
        mesh = mesh_of_block(block, name, self._scale, self._findings)
        if mesh is not None:
            self._objects.append(SceneObject(name, (Part(mesh),), kind="StaticMesh"))

    # ---- places ----------------------------------------------------------------------------

    def _pose(self, actor: Block) -> Pose:
        properties = actor.properties
        return unreal_pose(
            vector(properties.get("location", "")),
            rotator(properties.get("rotation", "")),
            self._scale,
        )

    def _add_start(self, actor: Block, name: str) -> None:
        kind = actor.attributes.get("class", "")
        _, yaw, _ = rotator(actor.properties.get("rotation", ""))
        self._starts.append(start_of(name, actor.get("tag"), kind, self._pose(actor), yaw))

    def _add_node(self, actor: Block, name: str) -> None:
        tag, pose = actor.get("tag"), self._pose(actor)
        if is_victim_tag(tag):
            self._victims.append(victim_of_tag(tag, pose, self._victim_names))
        else:
            kind = actor.attributes.get("class", "")
            self._nodes.append(path_node_of(name, tag, kind, pose))

    def _add_victim(self, actor: Block, name: str) -> None:
        female = "female" in actor.attributes.get("class", "").lower()
        scale = np.array(vector(actor.properties.get("drawscale3d", ""), 1.0))
        x, y, z = (scale * actor.number("drawscale", 1.0)).tolist()
        self._victims.append(
            Victim(name, self._pose(actor), "female" if female else "male", scale=(x, y, z))
        )

    # ---- air and light ---------------------------------------------------------------------

    def _add_light(self, actor: Block, name: str) -> None:
        kind = actor.attributes.get("class", "").lower()
        components = [
            b for b in actor.inner("object") if "light" in b.attributes.get("class", "").lower()
        ]
        self._lights.append(
            light_of(name, kind, self._pose(actor), [actor, *components], self._scale)
        )

    def _add_smoke(self, actor: Block, name: str) -> None:
        x, y, z = self._pose(actor).position
        scale = vector(actor.properties.get("drawscale3d", ""), 1.0)
        size = actor.number("drawscale", 1.0)
        width, depth, height = (max(0.1, abs(s * size)) for s in scale)
        puff = SmokePuff(
            name=f"{name}",
            position=(x, y, z + height),
            size=(width, depth, 2.0 * height),
            particles=60,
            radius=0.128,
            seed=len(self._puffs) + 1,
            lifetime=10.0 if "dynamic" in actor.attributes.get("class", "").lower() else 0.0,
        )
        self._puffs.append(puff)
        self._findings.warn(name, "smoke got a size of its own; the map does not say it")

    def _add_fog(self, actor: Block, name: str) -> None:
        density = max((b.number("fogdensity", 0.0) for b in actor.inner("object")), default=0.0)
        density = density or actor.number("fogdensity", 0.02)
        # The engine counts thousandths per unit, to the base 2.
        self._haze = min(1.0, max(1e-6, density / 1000.0 * self._scale * math.log(2.0)))
        self._findings.warn(
            name, f"fog became a haze of {self._haze:.2g}/m everywhere; a sidecar can change it"
        )

    def _add_level(self, actor: Block, name: str) -> None:
        if "killz" in actor.properties:
            self._kill_z = actor.number("killz", 0.0) / self._scale
        self._title = self._title or actor.get("title")

    # ---- looks -----------------------------------------------------------------------------

    def _materials(self) -> dict[str, Material]:
        materials = dict(self._library.materials)
        used = {p.material: None for brush in self._brushes for p in brush.polygons}
        for thing in self._objects:
            for part in thing.parts:
                used |= dict.fromkeys(part.materials.values())
        for name in used:
            if name and name not in materials:
                picture = self._library.picture(name)
                if picture is None:
                    self._findings.missing("texture", name)
                materials[name] = Material(name, texture=picture)
        return materials


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
