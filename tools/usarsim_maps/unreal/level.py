"""A level of Unreal being put together, whatever kind of file its actors come from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.reader import Context
from usarsim_maps.scene import (
    Box,
    Brush,
    Color,
    Light,
    LightKind,
    Material,
    Part,
    Scene,
    SceneObject,
    Source,
    map_victim,
)
from usarsim_maps.units import UU_PER_METRE, matrix_of_pose, pose_of_matrix, reflect
from usarsim_maps.unreal.library import AssetLibrary
from usarsim_maps.unreal.names import (
    VictimNames,
    is_victim_tag,
    likely_color,
    path_node_of,
    start_of,
    victim_of_tag,
)
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.worlds.description import PathNode, Smoke, SmokePuff, StartPose, Victim

Array = NDArray[np.float64]

PLACEHOLDER = Box((0.5, 0.5, 0.5))
"""Stands for a mesh that is missing."""

NO_COLLISION = {"collide_nocollision", "collide_touchall", "collide_touchallbutweapons"}
"""Values of `CollisionType` of what is not solid."""

PLAIN: Color = (0.7, 0.7, 0.7, 1.0)
"""Of materials of which nothing is known."""

DEFAULT_REACH = 1024.0
"""UU: UE3's radius of a light."""

DEFAULT_FOG = 0.02
"""UE3's density of fog, in thousandths per unit to the base 2."""


@dataclass(frozen=True, slots=True)
class Actor:
    """What all actors have.

    Attributes:
        name, kind, tag: of the actor and its class.
        pose: in the simulation frame, m.
        yaw: as in the map, rotation units.
        scale: DrawScale times DrawScale3D.
    """

    name: str
    kind: str
    tag: str
    pose: Pose
    yaw: float = 0.0
    scale: Vector = (1.0, 1.0, 1.0)


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
    """A light of an actor class; its x axis is where it shines.

    Args:
        name: of the actor.
        kind: its class, lower case.
        pose: of the actor.
        scale: Unreal units per metre.
        radius: UU; 0 means the default, as do the other zeros.
        brightness: 1 is an ordinary lamp.
        color: red, green, blue from 0 to 1.
        cone: half angle of a spot, degrees.
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

    Attributes:
        scale: Unreal units per metre.
        library: of meshes and pictures in other files.
        files: everything that was read beside the map and the library's files.
        kill_z: m. title: of the map.
        whole_map: it is a level, not a package of meshes.
    """

    def __init__(self, source: Path, context: Context, title: str) -> None:
        """Start empty; `title` is that of the format."""
        self.scale = context.options.scale or UU_PER_METRE
        self.library = AssetLibrary(source, context, self.scale)
        self.files: list[Path] = []
        self.kill_z: float | None = None
        self.title = ""
        self.whole_map = False
        self._source = source
        self._format = title
        self._context = context
        self._findings = context.findings
        self._victim_names = VictimNames()
        self._objects: list[SceneObject] = []
        self._brushes: list[Brush] = []
        self._starts: list[StartPose] = []
        self._nodes: list[PathNode] = []
        self._victims: list[Victim] = []
        self._lights: list[Light] = []
        self._puffs: list[SmokePuff] = []
        self._haze = 0.0

    @property
    def brushes(self) -> Sequence[Brush]:
        """Those so far."""
        return self._brushes

    def add_brush(self, brush: Brush) -> None:
        """The next brush of the program."""
        self._brushes.append(brush)

    def add_object(
        self, actor: Actor, matrix: Array, parts: Sequence[Part], movable: bool = False
    ) -> None:
        """A thing with shapes.

        Args:
            actor: whose it is; its pose does not count.
            matrix: (4, 4) of the actor.
            parts: their matrices lead into the world.
            movable: it can be pushed.
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

    def add_start(self, actor: Actor) -> None:
        """A `PlayerStart`."""
        self._starts.append(start_of(actor.name, actor.tag, actor.kind, actor.pose, actor.yaw))

    def add_node(self, actor: Actor) -> None:
        """A `PathNode`, which may be a person (item 26)."""
        if is_victim_tag(actor.tag):
            self._victims.append(victim_of_tag(actor.tag, actor.pose, self._victim_names))
        else:
            self._nodes.append(path_node_of(actor.name, actor.tag, actor.kind, actor.pose))

    def add_victim(self, actor: Actor) -> None:
        """A `MaleVictim` or `FemaleVictim` (item 28)."""
        figure = "female" if "female" in actor.kind.lower() else "male"
        self._victims.append(map_victim(actor.name, actor.pose, figure, scale=actor.scale))

    def add_light(self, lamp: Light) -> None:
        """A lamp."""
        self._lights.append(lamp)

    def add_smoke(self, actor: Actor) -> None:
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
        self._findings.warn(actor.name, "smoke got a size of its own; the map does not say it")

    def add_fog(self, actor: Actor, density: float) -> None:
        """Fog over the whole level; density in thousandths per unit to the base 2, or 0."""
        density = density or DEFAULT_FOG
        self._haze = min(1.0, max(1e-6, density / 1000.0 * self.scale * math.log(2.0)))
        self._findings.warn(
            actor.name,
            f"fog became a haze of {self._haze:.2g}/m everywhere; a sidecar can change it",
        )

    def scene(self) -> Scene:
        """What was found."""
        materials = self._materials()  # first: it finds pictures, which are files that were read
        scene = Scene(
            source=Source(
                path=self._source,
                format=self._format,
                units_per_metre=self.scale,
                mirrored=True,
                whole_map=self.whole_map,
                files=tuple(dict.fromkeys([self._source, *self.files, *self.library.files])),
            ),
            objects=tuple(self._objects),
            brushes=tuple(self._brushes),
            materials=materials,
            starts=tuple(self._starts),
            path_nodes=tuple(self._nodes),
            victims=tuple(self._victims),
            lights=tuple(self._lights),
            smoke=Smoke(puffs=tuple(self._puffs), haze=self._haze),
            kill_z=self.kill_z,
            title=self.title,
        )
        return reflect(scene) if self._context.options.mirror else scene

    def _materials(self) -> dict[str, Material]:
        materials = dict(self.library.materials)
        guessed = 0
        used = {p.material: None for brush in self._brushes for p in brush.polygons}
        for thing in self._objects:
            for part in thing.parts:
                used |= dict.fromkeys(part.materials.values())
                used |= dict.fromkeys(getattr(part.shape, "materials", ()))
        for name in used:
            if name and name not in materials:
                picture = self.library.picture(name)
                if picture is None:
                    self._findings.missing("texture", name)
                color = (picture is None and likely_color(name)) or PLAIN
                guessed += color is not PLAIN
                materials[name] = Material(name, color, texture=picture)
        if guessed:
            self._findings.fact("materials coloured after their names", guessed)
        return materials
