"""The sidecar: a small TOML file beside a map that says what the map does not, or says wrongly.

It overrides scale and axes, adds or replaces starts, victims, path nodes, smoke and lights, and
changes single objects (worlds reference 3, item 74). Places are in the simulation frame, metres,
like those of `world.toml`.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

from usarsim_maps.findings import Findings
from usarsim_maps.reader import ImportOptions
from usarsim_maps.scene import (
    Collision,
    Light,
    Material,
    Part,
    Scene,
    SceneObject,
    Source,
    map_victim,
)
from usarsim_server.base.errors import MapImportError
from usarsim_server.base.fields import field
from usarsim_server.base.files import is_regular
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import read_toml
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import POSTURES, PathNode, StartPose, Victim
from usarsim_server.worlds.smoke import read_smoke

SUFFIX = ".usarsim.toml"
"""`map.t3d` has its sidecar in `map.usarsim.toml`."""

T = TypeVar("T")

LAMP = Light("lamp", position=(0.0, 0.0, 3.0))
"""What is not said of a new lamp."""

REPLACEABLE = ("starts", "victims", "path_nodes", "lights", "smoke")


def _or_none(number: float) -> float | None:
    """Zero says nothing, too."""
    return number or None


@dataclass(frozen=True, slots=True, eq=False)
class _Rule:
    """What happens to objects whose name, tag or class fits a pattern."""

    pattern: str = field(key="match", help="name, tag or class; `*` and `?` stand for others")
    exclude: bool = field(default=False, help="leave it out, brushes too")
    hidden: bool = field(default=False, help="it is felt and not seen")
    collision: Collision | None = field(default=None, help="how it is solid")
    movable: bool | None = field(default=None, help="it can be pushed")
    mass: float | None = field(default=None, unit="kg", low=0.0, high=1e6, convert=_or_none)
    friction: float | None = field(default=None, low=0.0, high=10.0)

    def fits(self, *words: str) -> bool:
        wanted = self.pattern.lower()
        return any(word and fnmatch.fnmatchcase(word.lower(), wanted) for word in words)

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
    additions: Scene
    assets: tuple[Path, ...]
    replaces: frozenset[str]
    scale: float | None = field(default=None, low=0.0, high=1e9, convert=_or_none)
    up: Literal["X", "Y", "Z"] | None = field(default=None, help="axis that points up")
    mirror: bool = field(default=False, help="reflect the map: y becomes -y")
    placeholders: bool = field(default=False, help="a box stands in for every missing mesh")
    wall_height: float | None = field(
        default=None, unit="m", low=0.0, high=100.0, convert=_or_none, help="of occupancy grids"
    )
    rules: tuple[_Rule, ...] = field(default=(), key="object", help="changes of single objects")

    def options(self, given: ImportOptions) -> ImportOptions:
        """Options for the reader; what the user said on the command line wins."""
        return replace(
            given,
            scale=given.scale if given.scale is not None else self.scale,
            up=given.up or self.up,
            mirror=given.mirror or self.mirror,
            assets=(*given.assets, *self.assets),
            placeholders=given.placeholders or self.placeholders,
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
                if left is not None and rule.fits(left.name, left.tag, left.kind):
                    used[rule.pattern] += 1
                    left = rule.apply(left)
            if left is not None:
                objects.append(left)
        brushes = []
        for brush in scene.brushes:
            out = [r for r in self.rules if r.exclude and r.fits(brush.name, brush.tag)]
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
    table = Table(read_toml(path, MapImportError, "start"), path, MapImportError)
    replaces = frozenset(table.words("replace"))
    unknown = sorted(replaces - set(REPLACEABLE))
    if unknown:
        cure = f"write some of {', '.join(REPLACEABLE)}"
        raise table.error("replace", f"{unknown[0]!r} is unknown", cure)
    additions = Scene(
        source=Source(path, "sidecar"),
        starts=table.all("start", lambda one: StartPose(one.word("tag"), _pose(one))),
        victims=table.all("victim", _victim),
        path_nodes=table.all("path_node", PathNode),
        lights=table.all("light", lambda one: one.read(Light, LAMP)),
        smoke=read_smoke(table.tables("smoke")),
        materials=dict(_materials(path, table)),
        filled=table.flag("filled") if table.has("filled") else None,
        title=table.text("title", ""),
    )
    assets = tuple(path.parent / name for name in table.texts("assets"))
    sidecar = table.read(Sidecar, path=path, additions=additions, assets=assets, replaces=replaces)
    table.finish()
    return sidecar


def _pose(table: Table) -> Pose:
    roll, pitch, yaw = table.vector("rotation_degrees", (0.0, 0.0, 0.0))
    yaw = table.number("yaw_degrees", yaw)
    angles = (math.radians(angle) for angle in (roll, pitch, yaw))
    return Pose(table.vector("position"), quaternion_from_rpy(*angles))


def _victim(table: Table) -> Victim:
    size = table.number("scale", 1.0, low=0.1, high=10.0)
    return map_victim(
        name=table.word("name"),
        pose=_pose(table),
        figure=table.text("figure", "male"),
        posture=table.choice("posture", POSTURES) if table.has("posture") else "",
        scale=(size, size, size),
        status=table.word("status", "Alive"),
        properties=dict(table.free("properties")),
    )


def _materials(path: Path, table: Table) -> Iterable[tuple[str, Material]]:
    materials = table.table("material")
    for name in table.free("material"):
        entry = materials.table(name)
        color = entry.vector("color", (1.0, 1.0, 1.0))
        texture = entry.text("texture", "")
        opacity = entry.number("opacity", 1.0, low=0.0, high=1.0)
        entry.finish()
        picture = path.parent / texture if texture else None
        yield name, Material(name, (*color, opacity), picture, meant=entry.has("opacity"))
