"""The sidecar: a small TOML file beside a map that says what the map does not, or says wrongly.

It overrides scale and axes, adds or replaces starts, victims, path nodes, smoke and lights, and
changes single objects (worlds reference 3, item 74). Places are in the simulation frame, metres,
like those of `world.toml`.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from usarsim_maps.findings import Findings
from usarsim_maps.reader import ImportOptions
from usarsim_maps.scene import (
    Collision,
    Light,
    LightKind,
    Material,
    Part,
    Scene,
    SceneObject,
    Source,
    map_victim,
)
from usarsim_server.errors import MapImportError
from usarsim_server.files import is_regular
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.tables import Table
from usarsim_server.toml import read_toml
from usarsim_server.worlds.description import POSTURES, PathNode, StartPose, Victim
from usarsim_server.worlds.media import read_smoke

SUFFIX = ".usarsim.toml"
"""`map.t3d` has its sidecar in `map.usarsim.toml`."""

T = TypeVar("T")

REPLACEABLE = ("starts", "victims", "path_nodes", "lights", "smoke")


@dataclass(frozen=True, slots=True, eq=False)
class _Rule:
    """What happens to objects whose name, tag or class fits a pattern."""

    pattern: str
    exclude: bool
    hidden: bool
    collision: Collision | None
    movable: bool | None
    mass: float | None
    friction: float | None

    def fits(self, thing: SceneObject) -> bool:
        wanted = self.pattern.lower()
        return any(
            fnmatch.fnmatchcase(word.lower(), wanted)
            for word in (thing.name, thing.tag, thing.kind)
            if word
        )

    def apply(self, thing: SceneObject) -> SceneObject | None:
        if self.exclude:
            return None
        return replace(
            thing,
            parts=tuple(self._part(part) for part in thing.parts),
            movable=thing.movable if self.movable is None else self.movable,
            mass=thing.mass if self.mass is None else self.mass,
            friction=thing.friction if self.friction is None else self.friction,
        )

    def _part(self, part: Part) -> Part:
        collision = part.collision if self.collision is None else self.collision
        return replace(part, visible=part.visible and not self.hidden, collision=collision)


@dataclass(frozen=True, slots=True, eq=False)
class Sidecar:
    """A sidecar as read; `options` before reading the map, `apply` after."""

    path: Path
    scale: float | None
    up: str | None
    mirror: bool | None
    assets: tuple[Path, ...]
    placeholders: bool | None
    wall_height: float | None
    additions: Scene
    replaces: frozenset[str]
    rules: tuple[_Rule, ...]

    def options(self, given: ImportOptions) -> ImportOptions:
        """Options for the reader; what the user said on the command line wins."""
        return replace(
            given,
            scale=given.scale if given.scale is not None else self.scale,
            up=given.up or self.up,
            mirror=given.mirror or bool(self.mirror),
            assets=(*given.assets, *self.assets),
            placeholders=given.placeholders or bool(self.placeholders),
            wall_height=given.wall_height or self.wall_height,
        )

    def apply(self, scene: Scene, findings: Findings) -> Scene:
        """The scene with everything that the sidecar says, which is noted as findings."""
        more = self.additions
        objects = []
        used = {rule.pattern: 0 for rule in self.rules}
        for thing in scene.objects:
            left: SceneObject | None = thing
            for rule in self.rules:
                if left is not None and rule.fits(left):
                    used[rule.pattern] += 1
                    left = rule.apply(left)
            if left is not None:
                objects.append(left)
        brushes = []
        for brush in scene.brushes:
            out = [
                r for r in self.rules if r.exclude and _fits_brush(r.pattern, brush.name, brush.tag)
            ]
            for rule in out:
                used[rule.pattern] += 1
            if not out:
                brushes.append(brush)
        for pattern, times in used.items():
            text = f"object rule {pattern!r} of the sidecar applies to {times} things"
            findings.warn(self.path.name, text)

        smoke = more.smoke if "smoke" in self.replaces or not more.smoke.clear else scene.smoke
        return replace(
            scene,
            objects=tuple(objects),
            brushes=tuple(brushes),
            starts=self._merged("starts", scene.starts, more.starts, findings),
            victims=self._merged("victims", scene.victims, more.victims, findings),
            path_nodes=self._merged("path_nodes", scene.path_nodes, more.path_nodes, findings),
            lights=self._merged("lights", scene.lights, more.lights, findings),
            materials={**scene.materials, **more.materials},
            smoke=smoke,
            filled=scene.filled if more.filled is None else more.filled,
            title=more.title or scene.title,
        )

    def _merged(
        self, key: str, old: tuple[T, ...], new: tuple[T, ...], findings: Findings
    ) -> tuple[T, ...]:
        if new or key in self.replaces:
            verb = "replaces" if key in self.replaces else "adds to"
            findings.warn(self.path.name, f"the sidecar {verb} the {key}: {len(new)} new")
        return new if key in self.replaces else (*old, *new)


def _fits_brush(pattern: str, name: str, tag: str) -> bool:
    return any(word and fnmatch.fnmatchcase(word.lower(), pattern.lower()) for word in (name, tag))


def find_sidecar(source: Path, given: Path | None) -> Path | None:
    """The sidecar that the user named, else the one beside the map, else None."""
    if given is not None:
        return given
    beside = source.with_name(source.stem + SUFFIX)
    return beside if is_regular(beside) else None


def load_sidecar(path: Path) -> Sidecar:
    """Read a sidecar.

    Raises:
        MapImportError: naming key, what is wrong and what to write instead.
    """
    return _read(path, Table(read_toml(path, MapImportError, "start"), path, MapImportError))


def _read(path: Path, table: Table) -> Sidecar:
    scale = table.number("scale", 0.0, low=0.0, high=1e9) or None
    up = table.choice("up", ("X", "Y", "Z")) if table.has("up") else None
    materials = table.table("material")
    replaces = frozenset(table.words("replace"))
    unknown = sorted(replaces - set(REPLACEABLE))
    if unknown:
        raise table.error(
            "replace", f"{unknown[0]!r} is unknown", f"write some of {', '.join(REPLACEABLE)}"
        )
    sidecar = Sidecar(
        path=path,
        scale=scale,
        up=up,
        mirror=table.flag("mirror", False) if table.has("mirror") else None,
        assets=tuple(path.parent / name for name in table.texts("assets")),
        placeholders=table.flag("placeholders", False),
        wall_height=table.number("wall_height", 0.0, low=0.0, high=100.0) or None,
        additions=Scene(
            source=Source(path, "sidecar"),
            starts=tuple(map(_start, table.tables("start"))),
            victims=tuple(map(_victim, table.tables("victim"))),
            path_nodes=tuple(map(_path_node, table.tables("path_node"))),
            lights=tuple(map(_light, table.tables("light"))),
            smoke=read_smoke(table.tables("smoke")),
            materials=dict(_materials(path, table, materials)),
            filled=table.flag("filled", False) if table.has("filled") else None,
            title=table.text("title", ""),
        ),
        replaces=replaces,
        rules=tuple(map(_rule, table.tables("object"))),
    )
    table.finish()
    return sidecar


def _pose(table: Table) -> Pose:
    roll, pitch, yaw = table.vector("rotation_degrees", (0.0, 0.0, 0.0))
    yaw = table.number("yaw_degrees", yaw)
    angles = (math.radians(angle) for angle in (roll, pitch, yaw))
    return Pose(table.vector("position"), quaternion_from_rpy(*angles))


def _start(table: Table) -> StartPose:
    start = StartPose(table.word("tag"), _pose(table))
    table.finish()
    return start


def _victim(table: Table) -> Victim:
    size = table.number("scale", 1.0, low=0.1, high=10.0)
    victim = map_victim(
        name=table.word("name"),
        pose=_pose(table),
        figure=table.text("figure", "male"),
        posture=table.choice("posture", POSTURES) if table.has("posture") else "",
        scale=(size, size, size),
        status=table.word("status", "Alive"),
        properties=dict(table.free("properties")),
    )
    table.finish()
    return victim


def _path_node(table: Table) -> PathNode:
    node = PathNode(table.word("tag"), table.vector("position"), table.words("neighbours", ()))
    table.finish()
    return node


def _light(table: Table) -> Light:
    kinds = tuple(kind.value for kind in LightKind)
    light = Light(
        name=table.text("name", "lamp"),
        kind=LightKind(table.choice("kind", kinds)) if table.has("kind") else LightKind.POINT,
        position=table.vector("position", (0.0, 0.0, 3.0)),
        direction=table.vector("direction", (0.0, 0.0, -1.0)),
        color=table.vector("color", (1.0, 1.0, 1.0)),
        brightness=table.number("brightness", 1.0, low=0.0, high=1000.0),
        reach=table.number("reach", 0.0, low=0.0, high=1e5),
        cone=table.number("cone", 45.0, low=1.0, high=90.0),
        shadows=table.flag("shadows", False),
    )
    table.finish()
    return light


def _materials(path: Path, table: Table, materials: Table) -> Iterable[tuple[str, Material]]:
    names: Mapping[str, object] = table.free("material")
    for name in names:
        entry = materials.table(name)
        color = entry.vector("color", (1.0, 1.0, 1.0))
        texture = entry.text("texture", "")
        opacity = entry.number("opacity", 1.0, low=0.0, high=1.0)
        entry.finish()
        picture = path.parent / texture if texture else None
        yield name, Material(name, (*color, opacity), picture)


def _rule(table: Table) -> _Rule:
    kinds = tuple(kind.value for kind in Collision)
    rule = _Rule(
        pattern=table.text("match"),
        exclude=table.flag("exclude", False),
        hidden=table.flag("hidden", False),
        collision=(Collision(table.choice("collision", kinds)) if table.has("collision") else None),
        movable=table.flag("movable", False) if table.has("movable") else None,
        mass=table.number("mass", 0.0, low=0.0, high=1e6) or None,
        friction=(table.number("friction", low=0.0, high=10.0) if table.has("friction") else None),
    )
    table.finish()
    return rule
