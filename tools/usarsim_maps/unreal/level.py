"""A level of Unreal being put together, whatever kind of file its actors come from.

What an actor's properties mean is told here once; `t3d.py` and `udk.py` only get at them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from usarsim_maps.reader import Context
from usarsim_maps.scene import (
    Array,
    Box,
    Brush,
    BrushOperation,
    Collision,
    Color,
    Light,
    LightKind,
    Material,
    Part,
    Polygon,
    Scene,
    SceneObject,
    Solidity,
    Source,
    map_victim,
)
from usarsim_maps.units import (
    UU_PER_METRE,
    matrix_of_pose,
    pose_of_matrix,
    reflect,
    unreal_matrix,
    unreal_pose,
)
from usarsim_maps.unreal.library import AssetLibrary
from usarsim_maps.unreal.names import (
    ActorKind,
    is_victim_tag,
    likely_color,
    path_node_of,
    start_of,
    victim_of_tag,
)
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.worlds.description import PathNode, Smoke, SmokePuff, StartPose, Victim

PLACEHOLDER = Box((0.5, 0.5, 0.5))
"""Stands for a mesh that is missing."""

NO_COLLISION = {"collide_nocollision", "collide_touchall", "collide_touchallbutweapons"}
"""Values of `CollisionType` of what is not solid."""

NOT_SOLID, SEMISOLID, PORTAL = 0x08, 0x20, 0x0400_0000
"""Flags of brushes and polygons."""

OPERATIONS = {"csg_add": BrushOperation.ADD, "csg_subtract": BrushOperation.SUBTRACT}

TEXTURE_SIZE = 128.0
"""Unreal units of one repeat of a texture whose axes have length one."""

PLAIN: Color = (0.7, 0.7, 0.7, 1.0)
"""Of materials of which nothing is known."""

DEFAULT_REACH = 1024.0
"""UU: UE3's radius of a light."""

DEFAULT_FOG = 0.02
"""UE3's density of fog, in thousandths per unit to the base 2."""


class Values(Protocol):
    """Properties of an actor or component, by name in lower case, as either kind of file has them.

    What is missing, or of another type than is asked for, is the default.
    """

    def __contains__(self, name: str) -> bool: ...
    def number(self, name: str, default: float) -> float: ...
    def flag(self, name: str, default: bool) -> bool: ...
    def text(self, name: str) -> str: ...
    def vector(self, name: str, default: float = 0.0) -> Vector: ...
    def rotator(self, name: str) -> Vector: ...


@dataclass(frozen=True, slots=True)
class Actor:
    """What all actors have."""

    name: str  # of the actor and its class
    kind: str
    tag: str
    pose: Pose  # in the simulation frame, m
    yaw: float = 0.0  # as in the map, rotation units
    scale: Vector = (1.0, 1.0, 1.0)  # DrawScale times DrawScale3D

    @classmethod
    def of(cls, name: str, kind: str, values: Values, scale: float) -> Actor:
        """An actor by its properties; `scale` is Unreal units per metre."""
        rotation = values.rotator("rotation")
        pose = unreal_pose(values.vector("location"), rotation, scale)
        return cls(name, kind, values.text("tag"), pose, rotation[1], draw_scale(values))


def draw_scale(values: Values) -> Vector:
    """DrawScale times DrawScale3D."""
    size = values.number("drawscale", 1.0)
    x, y, z = values.vector("drawscale3d", 1.0)
    return x * size, y * size, z * size


def component_matrix(component: Values, scale: float) -> Array:
    """(4, 4), a component's own place in its actor (UE3)."""
    size = component.number("scale", 1.0)
    x, y, z = component.vector("scale3d", 1.0)
    return unreal_matrix(
        component.vector("translation"),
        component.rotator("rotation"),
        (x * size, y * size, z * size),
        scale=scale,
    )


def collision_of(actor: Values, component: Values) -> Collision:
    """Whether a mesh is solid."""
    solid = actor.flag("bcollideactors", True) and actor.flag("bblockactors", True)
    solid &= component.flag("collideactors", True) and component.flag("blockactors", True)
    solid &= actor.text("collisiontype").lower() not in NO_COLLISION
    return Collision.AUTO if solid else Collision.NONE


def solidity_of(flags: int, operation: BrushOperation) -> Solidity | None:
    """How a brush with these flags takes part; None if not at all."""
    if flags & PORTAL or (flags & NOT_SOLID and operation is BrushOperation.SUBTRACT):
        return None
    if flags & NOT_SOLID:
        return Solidity.NONSOLID
    return Solidity.SEMISOLID if flags & SEMISOLID else Solidity.SOLID


def world_polygon(local: Array, uvs: Array | None, material: str, matrix: Array) -> Polygon:
    """A polygon in the world; `local` corners are in the mirrored frame of its actor, m."""
    world = local @ matrix[:3, :3].T + matrix[:3, 3]
    # Mirroring into the simulation frame turns faces round, and so does a negative scale.
    turn = -1 if np.linalg.det(matrix[:3, :3]) > 0.0 else 1
    known = uvs is not None and bool(np.isfinite(uvs).all())
    return Polygon(world[::turn], material, uvs[::turn] if uvs is not None and known else None)


def light(
    name: str,
    kind: str,
    pose: Pose,
    scale: float,
    *,
    radius: float = 0.0,
    brightness: float = 0.0,
    color: Vector = (1.0, 1.0, 1.0),
    cone: float = 0.0,
) -> Light:
    """A light of an actor class (lower case); its x axis is where it shines.

    The radius is in UU, the brightness of an ordinary lamp is 1, the cone is the half angle of a
    spot in degrees; 0 means the default of each.
    """
    shape = LightKind.POINT
    if "directional" in kind or "sunlight" in kind:
        shape = LightKind.DIRECTIONAL
    elif "spot" in kind:
        shape = LightKind.SPOT
    elif "sky" in kind:
        shape = LightKind.AMBIENT
    fades = shape in (LightKind.POINT, LightKind.SPOT)
    return Light(
        name=name,
        kind=shape,
        position=pose.position,
        direction=pose.rotate((1.0, 0.0, 0.0)),
        color=color,
        brightness=brightness or 1.0,
        reach=(radius or DEFAULT_REACH) / scale if fades else 0.0,
        cone=cone or 44.0,
    )


class UnrealLevel:
    """A scene being filled, actor by actor in the order of the level.

    Readers derive from it.
    """

    PLAIN = frozenset({ActorKind.START, ActorKind.PATH_NODE, ActorKind.VICTIM, ActorKind.SMOKE})
    """Kinds of actors that `add_actor` takes."""

    def __init__(self, source: Path, context: Context, title: str) -> None:
        """Start empty; `title` is that of the format."""
        self.source = source
        self.context = context
        self.findings = context.findings
        self.scale = context.options.scale or UU_PER_METRE  # Unreal units per metre
        self.library = AssetLibrary(source, context, self.scale)  # of meshes and pictures
        self.files: list[Path] = []  # what was read beside the map and the library's files
        self.brushes: list[Brush] = []  # in the order of the program
        self.lights: list[Light] = []
        self.kill_z: float | None = None  # m
        self.title = ""
        self.whole_map = False  # it is a level, not a package of meshes
        self._format = title
        self._known_victims: Counter[str] = Counter()
        self._objects: list[SceneObject] = []
        self._starts: list[StartPose] = []
        self._nodes: list[PathNode] = []
        self._victims: list[Victim] = []
        self._puffs: list[SmokePuff] = []
        self._haze = 0.0

    def add_object(
        self, actor: Actor, matrix: Array, parts: Sequence[Part], movable: bool = False
    ) -> None:
        """A thing with shapes, whose matrices lead into the world; `matrix` (4, 4) is the actor's.

        The actor's own pose does not count.
        """
        if not parts:
            return
        rigid = pose_of_matrix(matrix)
        back = matrix_of_pose(rigid.inverse())
        self._objects.append(
            SceneObject(
                name=actor.name,
                parts=tuple(
                    Part(p.shape, back @ p.matrix, p.visible, p.collision, p.materials)
                    for p in parts
                ),
                pose=rigid,
                tag=actor.tag,
                kind=actor.kind,
                movable=movable,
            )
        )

    def add_actor(self, kind: ActorKind, actor: Actor) -> bool:
        """An actor that is all in its place, name and scale; False if it is of another kind."""
        match kind:
            case ActorKind.START:
                start = start_of(actor.name, actor.tag, actor.kind, actor.pose, actor.yaw)
                self._starts.append(start)
            case ActorKind.PATH_NODE if is_victim_tag(actor.tag):  # a person (worlds 26)
                self._victims.append(victim_of_tag(actor.tag, actor.pose, self._known_victims))
            case ActorKind.PATH_NODE:
                self._nodes.append(path_node_of(actor.name, actor.tag, actor.kind, actor.pose))
            case ActorKind.VICTIM:  # a `MaleVictim` or `FemaleVictim` (worlds 28)
                figure = "female" if "female" in actor.kind.lower() else "male"
                self._victims.append(map_victim(actor.name, actor.pose, figure, scale=actor.scale))
            case ActorKind.SMOKE:
                self._add_smoke(actor)
            case _:
                return False
        return True

    def add_info(self, values: Values) -> None:
        """What the actor of the level itself says."""
        if "killz" in values:
            self.kill_z = values.number("killz", 0.0) / self.scale
        self.title = self.title or values.text("title")

    def add_fog(self, actor: Actor, density: float) -> None:
        """Fog over the whole level; density in thousandths per unit to the base 2, or 0."""
        density = density or DEFAULT_FOG
        self._haze = min(1.0, max(1e-6, density / 1000.0 * self.scale * math.log(2.0)))
        self.findings.warn(
            actor.name,
            f"fog became a haze of {self._haze:.2g}/m everywhere; a sidecar can change it",
        )

    def _add_smoke(self, actor: Actor) -> None:
        """Local smoke; the map does not say how large it is."""
        x, y, z = actor.pose.position
        width, depth, height = (max(0.1, abs(value)) for value in actor.scale)
        self._puffs.append(
            SmokePuff(
                name=actor.name,
                position=(x, y, z + height),
                size=(width, depth, 2.0 * height),
                particles=60,
                radius=0.128,
                seed=len(self._puffs) + 1,
                lifetime=10.0 if "dynamic" in actor.kind.lower() else 0.0,
            )
        )
        self.findings.warn(actor.name, "smoke got a size of its own; the map does not say it")

    def scene(self) -> Scene:
        """What was found."""
        materials = self._materials()  # first: it finds pictures, which are files that were read
        scene = Scene(
            source=Source(
                path=self.source,
                format=self._format,
                units_per_metre=self.scale,
                mirrored=True,
                whole_map=self.whole_map,
                files=tuple(dict.fromkeys([self.source, *self.files, *self.library.files])),
            ),
            objects=tuple(self._objects),
            brushes=tuple(self.brushes),
            materials=materials,
            starts=tuple(self._starts),
            path_nodes=tuple(self._nodes),
            victims=tuple(self._victims),
            lights=tuple(self.lights),
            smoke=Smoke(puffs=tuple(self._puffs), haze=self._haze),
            kill_z=self.kill_z,
            title=self.title,
        )
        return reflect(scene) if self.context.options.mirror else scene

    def _materials(self) -> dict[str, Material]:
        materials = dict(self.library.materials)
        guessed = 0
        used = {p.material: None for brush in self.brushes for p in brush.polygons}
        for thing in self._objects:
            for part in thing.parts:
                used |= dict.fromkeys(part.materials.values())
                used |= dict.fromkeys(getattr(part.shape, "materials", ()))
        for name in used:
            if name and name not in materials:
                picture = self.library.picture(name)
                if picture is None:
                    self.findings.missing("texture", name)
                color = (picture is None and likely_color(name)) or PLAIN
                guessed += color is not PLAIN
                materials[name] = Material(name, color, texture=picture)
        if guessed:
            self.findings.fact("materials coloured after their names", guessed)
        return materials
