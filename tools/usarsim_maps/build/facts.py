"""Starts, victims and path nodes as `world.toml` has them: a look into the finished scene decides.

A `Probe` says where floors are, what is blocked and how large it all is.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from usarsim_maps.build.extent import bounds_of_object
from usarsim_maps.build.sheet import Entry, NameBook, rotation, safe
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Array, LightKind, Scene
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy, rpy_from_quaternion
from usarsim_server.simulation.raw import changeable
from usarsim_server.specs import read_spec
from usarsim_server.worlds.description import StartPose
from usarsim_server.worlds.solids import read_apart
from usarsim_server.worlds.victims import PELVIS_HEIGHT

OUTSIDE, FAR_LIGHT = 40.0, 1000.0
"""m outside the map at which things, and lights, are still believed."""

STRAYS = 0.1
"""Part of the objects that may be taken for misplaced; if more are far away the scale is wrong."""

FLOOR_BELOW = 2.0
"""m within which a start has to have a floor (worlds reference 11)."""

FREE = 0.15
"""m: radius of the ball that has to fit at a start."""

FLOOR_PROBES, LEAST_FLOOR = 24, 0.05
"""Probes along each side of a map for something to stand on, and the part that should find it."""

HOVER = 0.25
"""m above the floor of start poses that the importer makes."""

AHEAD, FARTHEST_AHEAD = 2.0, 10.0
"""m of free way that a start which is made has ahead, and beyond which a longer one is no better.
"""

HEADINGS = 16
"""Directions that are tried for a start which is made."""

TRACK, ROBOT_HEIGHTS = 0.35, (0.1, 0.3, 0.6)
"""m: half the width of a free way, and heights above the floor at which nothing is in it."""

STRIDE, LEVEL = 0.25, 0.05
"""m between places of a way below which a floor is looked for, and by which it may rise or fall
from one to the next."""

CANDIDATES = 60
"""Free places that are looked at for a start with a free way."""

STANDING_ROOM, SITTING_ROOM = 1.8, 1.0
"""m of headroom that a person needs to stand and to sit."""


BALL = "probe:ball"
"""Geom and body of the ball with which free space is looked for."""
NUDGE = np.array([1e-3, 0.7e-3, 0.4e-3])
"""m: a ball whose centre is exactly that of a box counts as not touching it (MuJoCo 3.17)."""


@dataclass(frozen=True, slots=True)
class StartCheck:
    """A start pose as the report tells it: m above the floor, m of overlap with what is solid."""

    name: str
    height: float
    overlap: float


def within_reach(scene: Scene, bounds: tuple[Array, Array], findings: Findings) -> Scene:
    """The scene without what is far outside it: places that a slip of the pen has made."""

    def near(kind: str, name: str, position: Vector, slack: float = OUTSIDE) -> bool:
        inside = _within(position, bounds, slack)
        if not inside:
            findings.warn(name, f"a {kind} far outside the map was left out")
        return inside

    return replace(
        scene,
        starts=tuple(s for s in scene.starts if near("start pose", s.tag, s.pose.position)),
        victims=tuple(v for v in scene.victims if near("victim", v.name, v.pose.position)),
        path_nodes=tuple(n for n in scene.path_nodes if near("path node", n.tag, n.position)),
        lights=tuple(
            light
            for light in scene.lights
            if light.kind in (LightKind.AMBIENT, LightKind.DIRECTIONAL)
            or near("light", light.name, light.position, FAR_LIGHT)
        ),
        smoke=replace(
            scene.smoke,
            volumes=tuple(v for v in scene.smoke.volumes if near("smoke", v.name, v.pose.position)),
            puffs=tuple(p for p in scene.smoke.puffs if near("smoke", p.name, p.position)),
        ),
    )


def without_strays(scene: Scene, limit: float, findings: Findings) -> Scene:
    """The scene without the few objects that lie farther from the middle of all than a map is wide.

    The limit, m, is the largest extent of a map.
    """
    boxes = [bounds_of_object(thing) for thing in scene.objects]
    places = [None if box is None else (box[0] + box[1]) / 2.0 for box in boxes]
    known = [place for place in places if place is not None]
    if len(known) < 3:
        return scene
    middle = np.median(known, axis=0)
    away = [place is not None and bool(np.abs(place - middle).max() > limit) for place in places]
    if sum(away) > max(1.0, STRAYS * len(known)):
        return scene
    for thing, far in zip(scene.objects, away, strict=True):
        if far:
            findings.warn(thing.name, "an object far outside the map was left out")
    kept = (thing for thing, far in zip(scene.objects, away, strict=True) if not far)
    return replace(scene, objects=tuple(kept))


def note_floor(probe: Probe, bounds: tuple[Array, Array], findings: Findings) -> None:
    """Warn of a map that nobody can stand in: nearly nothing solid lies below any place of it."""
    low, high = bounds
    # Between the lines of a grid that builders use: walls on the lines are no floor.
    parts = (np.arange(FLOOR_PROBES) + 0.37) / FLOOR_PROBES
    places = [(x, y) for x in parts.tolist() for y in parts.tolist()]
    size, top = high - low, float(high[2]) + 0.5
    found = sum(
        math.isfinite(probe.height((float(low[0] + x * size[0]), float(low[1] + y * size[1]), top)))
        for x, y in places
    )
    if found < LEAST_FLOOR * len(places):
        findings.warn(
            "level",
            f"only {100.0 * found / len(places):.0f} % of the map have a floor: robots will fall "
            "out of it; export its floor too, check --up, or name missing meshes with --assets",
        )


def start_entries(
    scene: Scene, probe: Probe, bounds: tuple[Array, Array], findings: Findings
) -> tuple[list[Entry], list[StartCheck]]:
    """`[[start]]` tables, and what the report says about them (worlds 71)."""
    book = NameBook()
    entries: list[Entry] = []
    checks: list[StartCheck] = []
    inside = list(scene.starts)
    if scene.starts_made:
        inside = [replace(start, pose=facing_ahead(probe, start.pose)) for start in inside]
    if not inside:
        inside = [_default_start(probe, bounds)]
        findings.warn(
            inside[0].tag,
            "the map has no start pose; this one was made, add others with a sidecar file",
        )
    for start in inside:
        tag = book.take(start.tag)
        if tag.lower() != start.tag.lower():
            findings.warn(start.tag, f"start pose is called {tag} on the wire")
        position = start.pose.position
        facing = rotation(start.pose)
        entries.append(
            {"tag": tag, "position": _exact(position), **facing, "turns": start.turns or None}
        )
        height, overlap = probe.height(position), probe.overlap(position, FREE)
        checks.append(StartCheck(tag, height, overlap))
        if height > FLOOR_BELOW:
            findings.warn(
                start.tag,
                f"no floor within {FLOOR_BELOW:g} m below this start pose: robots will fall; give "
                "another with a sidecar file",
            )
        if overlap > 0.02:
            findings.warn(
                start.tag,
                "something solid is in the place of this start pose: robots will appear beside it, "
                "or fall; give another with a sidecar file",
            )
    return entries, checks


def facing_ahead(probe: Probe, pose: Pose) -> Pose:
    """A pose above a floor, turned to where the longest free way is, see `free_way`."""
    yaw, _ = free_way(probe, pose.position)
    return Pose(pose.position, quaternion_from_rpy(0.0, 0.0, yaw))


def free_way(probe: Probe, position: Vector) -> tuple[float, float]:
    """The yaw (rad) in which a robot can go farthest from a place above a floor, and m how far.

    Nothing is in its way at the height of robots, and the floor goes on, level or nearly. Of equal
    ways the one nearest to +x counts, to the left before to the right. Ways of more than
    `FARTHEST_AHEAD` are equal.
    """
    x, y, z = position
    floor = z - probe.height(position)
    if not math.isfinite(floor):
        return 0.0, 0.0
    turns = sorted(range(HEADINGS), key=lambda n: (min(n, HEADINGS - n), n))
    yaws = [math.tau * n / HEADINGS for n in turns]
    ways = np.array([[math.cos(yaw), math.sin(yaw), 0.0] for yaw in yaws])
    room = np.full(HEADINGS, FARTHEST_AHEAD)
    for height in ROBOT_HEIGHTS:
        place = np.array([x, y, floor + height])
        room = np.minimum(room, np.round(probe.ways(place, ways, FARTHEST_AHEAD), 4))
    best, longest = 0.0, 0.0
    for number in sorted(range(HEADINGS), key=lambda n: (-room[n], n)):
        if room[number] <= longest:
            break
        ahead = _room_beside(probe, (x, y, floor), ways[number], float(room[number]))
        ahead = _floor_ahead(probe, (x, y, floor), ways[number], ahead)
        if ahead > longest + 1e-6:
            best, longest = yaws[number], ahead
    return best, longest


def _room_beside(probe: Probe, foot: Vector, way: Array, room: float) -> float:
    """m along a way (3,) from a place on a floor to where a robot as wide as a track is stopped."""
    x, y, floor = foot
    ahead = (float(way[0]), float(way[1]), 0.0)
    for side in (-TRACK, TRACK):
        for height in ROBOT_HEIGHTS:
            place = (x - side * ahead[1], y + side * ahead[0], floor + height)
            room = min(room, probe.way(place, ahead))
    return room


def _floor_ahead(probe: Probe, foot: Vector, way: Array, room: float) -> float:
    """m along a level way (3,) from a place on a floor to where the floor ends or is not level."""
    x, y, floor = foot
    for step in range(1, math.floor(room / STRIDE + 1e-9) + 1):
        here = (x + step * STRIDE * float(way[0]), y + step * STRIDE * float(way[1]))
        height = floor + STRIDE - probe.height((*here, floor + STRIDE))
        if not abs(height - floor) <= LEVEL:
            return (step - 1) * STRIDE
        floor = height
    return room


def _default_start(probe: Probe, bounds: tuple[Array, Array]) -> StartPose:
    """A free place on a floor, as near as possible to the middle of the map, with a way ahead.

    Of the first `CANDIDATES` free places it is the first with `AHEAD` m of free way, else the one
    with the longest.
    """
    low, high = bounds
    middle = (low + high) / 2.0
    best, longest = Pose((float(middle[0]), float(middle[1]), float(high[2]) + HOVER)), -1.0
    for from_top in (False, True):
        top = float(high[2]) + 0.5 if from_top else float(middle[2])
        free = _free_places(probe, bounds, top)
        for place in itertools.islice(free, CANDIDATES):
            yaw, way = free_way(probe, place)
            if way > longest:
                best, longest = Pose(place, quaternion_from_rpy(0.0, 0.0, yaw)), way
            if way >= AHEAD:
                return StartPose("Start", best)
        if longest >= 0.0:
            break
    return StartPose("Start", best)


def _free_places(probe: Probe, bounds: tuple[Array, Array], top: float) -> Iterator[Vector]:
    """Places for a start above floors that are below a height, from the middle outwards."""
    low, high = bounds
    middle = (low + high) / 2.0
    step = max(0.5, float((high - low)[:2].max()) / 40.0)
    offsets = sorted(
        ((x * step, y * step) for x in range(-20, 21) for y in range(-20, 21)),
        key=lambda o: (math.hypot(*o), o),
    )
    for x, y in offsets:
        point = (float(middle[0]) + x, float(middle[1]) + y, top)
        if not _within(point, bounds, slack=1.0):
            continue
        height = probe.height(point)
        if not math.isfinite(height) or height > float(high[2] - low[2]) + 2.0:
            continue
        place = (point[0], point[1], top - height + HOVER)
        if probe.overlap((place[0], place[1], place[2] + 0.15), 0.35) == 0.0:
            yield place


def _within(point: Vector, bounds: tuple[Array, Array], slack: float = OUTSIDE) -> bool:
    low, high = bounds
    here = np.array(point)
    return bool((here >= low - slack).all() and (here <= high + slack).all())


def victim_entries(scene: Scene, probe: Probe, findings: Findings) -> list[Entry]:
    """`[[victim]]` tables: people stand, sit or lie on what is below them."""
    book = NameBook()
    entries: list[Entry] = []
    for victim in scene.victims:
        x, y, z = victim.pose.position
        height = probe.height((x, y, z + 0.05)) - 0.05
        if not math.isfinite(height) or height > 3.0:
            findings.warn(victim.name, "no floor below this victim; it stays where it is")
            height = 0.0
        floor = z - height
        posture = victim.posture or _posture(probe, (x, y, floor))
        _, _, yaw = rpy_from_quaternion(victim.pose.quaternion)
        upright = Pose((x, y, floor), quaternion_from_rpy(0.0, 0.0, yaw))
        entries.append(
            {
                "name": book.take(victim.name),
                "position": _exact((x, y, floor + PELVIS_HEIGHT[posture] * victim.scale)),
                **rotation(upright),
                "posture": posture,
                "status": safe(victim.status),
                "scale": victim.scale if abs(victim.scale - 1.0) > 1e-9 else None,
                "properties": victim.properties,
            }
        )
    return entries


def _posture(probe: Probe, floor: Vector) -> str:
    x, y, z = floor
    room = probe.headroom((x, y, z + 0.05))
    if room >= STANDING_ROOM:
        return "standing"
    return "sitting" if room >= SITTING_ROOM else "lying"


def path_node_entries(scene: Scene, findings: Findings) -> list[Entry]:
    """`[[path_node]]` tables."""
    book = NameBook()
    tags: dict[str, str] = {}
    for node in scene.path_nodes:
        tag = book.take(node.tag)
        tags.setdefault(node.tag, tag)
        if tag.lower() != node.tag.lower():
            findings.warn(node.tag, f"path node is called {tag} on the wire")
    book = NameBook()
    entries: list[Entry] = []
    for node in scene.path_nodes:
        known = [tags[name] for name in node.neighbours if name in tags]
        entries.append(
            {
                "tag": book.take(node.tag),
                "position": _exact(node.position),
                "neighbours": known or None,
            }
        )
    return entries


def _exact(position: Vector) -> list[float]:
    return [float(value) for value in position]


class Probe:
    """The compiled scenery (`model`) of a world folder, movable things where the map has them."""

    def __init__(self, scene: Path, source: Path) -> None:
        """Compile; `MapImportError` if MuJoCo refuses the scene."""
        try:
            parts = read_apart(scene)
            spec, fixed = parts or (read_spec(scene), None)
            ball = spec.worldbody.add_body(name=BALL, pos=[0.0, 0.0, 1e4])
            ball.add_freejoint()  # what cannot move does not touch what cannot move
            ball.add_geom(name=BALL, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0])
            model: mujoco.MjModel = spec.compile()
            self.model = model if fixed is None else fixed.into(model)
        except ValueError as error:
            text = " ".join(str(error).split()).removeprefix("Error: ")
            cure = "report this map; --sidecar can exclude the object that is named"
            raise MapImportError(at(source, f"MuJoCo refuses the result: {text}", cure)) from error
        model = self.model
        self._data = mujoco.MjData(model)
        mujoco.mj_forward(model, self._data)
        self._ball_geom = model.geom(BALL).id
        self._rays = changeable(model, "geom_rgba", "geom_matid")
        hollow = (model.geom_contype | model.geom_conaffinity) == 0
        hollow[self._ball_geom] = True
        self._rays.geom_rgba[hollow, 3] = 0.0
        self._rays.geom_matid[hollow] = -1

    @property
    def memory(self) -> float:
        """MiB of the compiled model."""
        return float(self.model.nbuffer) / (1 << 20)

    @property
    def has_ground(self) -> bool:
        """Whether anything solid is fixed in the world (worlds reference 11)."""
        model = self.model
        solid = (model.geom_contype | model.geom_conaffinity) != 0
        return bool((solid & (model.body_weldid[model.geom_bodyid] == 0)).any())

    def way(self, start: Vector, direction: Vector) -> float:
        """m to the next solid surface in a direction; inf if there is none."""
        geom = np.zeros(1, dtype=np.int32)
        ray = np.array(start), np.array(direction)
        way = mujoco.mj_ray(self._rays, self._data, *ray, None, 1, -1, geom, None)
        return float(way) if geom[0] >= 0 else math.inf

    def ways(self, start: Array, directions: Array, reach: float) -> Array:
        """m from a place (3,) along unit vectors (n, 3) to the next solid surface.

        Infinity where there is none within reach (m).
        """
        count = len(directions)
        geoms, ways = np.zeros(count, dtype=np.int32), np.zeros(count)
        mujoco.mj_multiRay(
            self._rays, self._data, start, directions.ravel(), None, 1, -1, geoms, ways, None,
            count, reach,
        )  # fmt: skip
        return np.where(geoms >= 0, ways, np.inf)

    def height(self, point: Vector) -> float:
        """m from a point down to the floor; inf if there is none."""
        return self.way(point, (0.0, 0.0, -1.0))

    def headroom(self, point: Vector) -> float:
        """m from a point up to the ceiling."""
        return self.way(point, (0.0, 0.0, 1.0))

    def overlap(self, point: Vector, radius: float = 0.1) -> float:
        """m by which a ball at a point would be inside something solid; 0 if it is free."""
        data, model, geom = self._data, self.model, self._ball_geom
        body = model.body(BALL).id
        place = int(model.joint(model.body_jntadr[body]).qposadr[0])
        model.geom_size[geom, 0] = model.geom_rbound[geom] = radius
        model.geom_aabb[geom, 3:] = model.bvh_aabb[model.body_bvhadr[body], 3:] = radius
        data.qpos[place : place + 3] = np.array(point) + NUDGE
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        own = (data.contact.geom == geom).any(axis=1)
        return max(0.0, -float(data.contact.dist[own].min())) if own.any() else 0.0
