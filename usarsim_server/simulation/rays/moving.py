"""Everything that moves, as rays see it: robots, crates, doors, people.

The visible geoms that move as one piece are an Embree scene in the frame of their body, built once
per shape and shared by all that look the same, in this model generation and in later ones as long
as it is there. A ray is turned into the frame of every body whose bounding sphere it passes; so
nothing is rebuilt when things move, and all rays at bodies of one shape, whoever sent them, are one
call.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from ctypes import addressof
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from usarsim_server.simulation.frames import Array, Numbers, rotation_matrices
from usarsim_server.simulation.mailbox import yield_interpreter
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.objects import Objects
from usarsim_server.simulation.rays.culling import Spheres, bounding_spheres, meetings, passing
from usarsim_server.simulation.rays.groups import RigidGroup, rigid_groups
from usarsim_server.simulation.rays.query import RayBatch
from usarsim_server.simulation.rays.records import MovingRecord
from usarsim_server.simulation.rays.scenery import is_glass, is_visible
from usarsim_server.simulation.rays.triangles import (
    RoundPart,
    Surfaces,
    TriangleScene,
    shape_key,
    triangles,
    turned_back,
)
from usarsim_server.simulation.snapshot import Snapshot

GROUPS_AT_A_TIME = 16
"""Groups between two pauses, while a world grows."""
FINE = 1e-4
"""m between a tessellated and the true surface of what moves."""


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """A body that can be seen: its scenes with and without glass, and its visible geoms."""

    body: int
    full: TriangleScene
    clear: TriangleScene
    geoms: tuple[int, ...]


@dataclass(slots=True, eq=False)
class _Moment:
    """Where everything is in one snapshot."""

    snapshot: weakref.ref[Snapshot]  # that one, as long as anybody else has it
    trees: Numbers  # (t,) those that are in the world; spheres: around them
    spheres: Spheres
    turns: Array
    """(b, 3, 3) rotation matrices, places: (b, 3) origins, centres: (b, 3) middles of all visible
    bodies, in the world, m."""
    places: Array
    centres: Array
    record: MovingRecord | None = None
    """The same for compiled code, once that has asked."""


class DynamicGeometry:
    """Everything that moves in one model generation; shared by all threads.

    Attributes:
        generation: of the model.
        objects: names and facts of everything in that generation.
    """

    def __init__(self, world: CompiledWorld, older: DynamicGeometry | None = None) -> None:
        """Build the scenes of all shapes; those of a former generation are used again."""
        model = world.model
        self.generation = world.generation
        self.objects = Objects(world)
        self._layouts, self._nbody = world.layouts, int(model.nbody)
        self._scenes: dict[bytes, TriangleScene] = {}
        self._roots, self._radii, self._tree_of_root = bounding_spheres(model)
        robots = {layout.base for layout in world.layouts}
        self._is_robot = np.array([root in robots for root in self._roots], dtype=bool)
        self._bodies = self._visible_bodies(model, older)
        self._body_ids = np.array([one.body for one in self._bodies], dtype=np.intp)
        self._middles = np.array([one.full.centre for one in self._bodies]).reshape(-1, 3)
        self._spans = np.array([one.full.radius for one in self._bodies])
        trees = [self._tree_of_root[int(model.body_rootid[one.body])] for one in self._bodies]
        self._trees = np.array(trees, dtype=np.intp)
        self._count = np.bincount(self._trees, minlength=len(self._roots))
        """How many of the visible bodies each tree has, and which is the first."""
        self._first = np.cumsum(self._count) - self._count
        numbers = {id(scene): k for k, scene in enumerate(self._scenes.values())}
        self._scene_list = tuple(self._scenes.values())
        self._full = np.array([numbers[id(one.full)] for one in self._bodies], dtype=np.intp)
        self._clear = np.array([numbers[id(one.clear)] for one in self._bodies], dtype=np.intp)
        geoms = [geom for one in self._bodies for geom in one.geoms]
        self._geoms = np.array(geoms, dtype=np.intp)
        """Of all visible bodies, one body after the other, and where each begins."""
        counts = [len(one.geoms) for one in self._bodies]
        self._geom_begin = np.cumsum([0, *counts]).astype(np.intp)
        self._moment: _Moment | None = None

    def cast(
        self,
        batch: RayBatch,
        snapshot: Snapshot,
        viewers: list[int | None],
        reach: Array,
        *,
        normals: bool = False,
    ) -> Surfaces | None:
        """Cast rays at everything that moves; None if no ray met anything.

        Args:
            batch, snapshot: f fans with n rays; the instant, of this generation.
            viewers: (f,) number of the robot that each fan belongs to, which it does not see.
            reach: (n,) how far each ray goes, m.
            normals: also find surface normals.
        """
        moment = self._at(snapshot)
        if not len(moment.trees):
            return None
        rays, met = meetings(batch, reach, moment.spheres, self._own(snapshot, moment, viewers))
        if not len(rays):
            return None
        rays, bodies = self._bodies_met(moment, batch, reach, rays, moment.trees[met])
        if not len(rays):
            return None
        distances, geoms, facing = self._hits(moment, batch, rays, bodies, normals)
        return _nearest(len(batch.directions), rays, distances, geoms, facing)

    def at(self, snapshot: Snapshot, viewers: list[int | None]) -> tuple[MovingRecord, Numbers]:
        """Everything that moves, for compiled code, and which tree there each fan (f,) does not
        see."""
        moment = self._at(snapshot)
        if moment.record is None:
            full, clear = self._records
            moment.record = MovingRecord(
                trees=len(moment.trees),
                centres=moment.spheres.centres,
                radii=moment.spheres.radii,
                first=self._first[moment.trees],
                count=self._count[moment.trees],
                turns=moment.turns,
                places=moment.places,
                middles=moment.centres,
                spans=self._spans,
                full=full,
                clear=clear,
                geoms=self._geoms,
                geom_begins=self._geom_begin,
            )
        return moment.record, self._own(snapshot, moment, viewers)

    # -- what there is -----------------------------------------------------------------------

    def _visible_bodies(self, model: mujoco.MjModel, older: DynamicGeometry | None) -> list[_Body]:
        """Everything that moves and can be seen, tree by tree."""
        found, first, known = self._inherited(older)
        for rigid_group in rigid_groups(model, lambda geom: is_visible(model, geom), first):
            glass = [is_glass(model, geom) for geom in rigid_group.geoms]
            full = clear = self._scene(model, rigid_group, [True] * len(glass), known)
            if any(glass):
                clear = self._scene(model, rigid_group, [not pane for pane in glass], known)
            found.append(_Body(rigid_group.body, full, clear, rigid_group.geoms))
            if len(found) % GROUPS_AT_A_TIME == 0:
                yield_interpreter()
        trees = self._tree_of_root
        return sorted(found, key=lambda one: (trees[int(model.body_rootid[one.body])], one.body))

    def _inherited(
        self, older: DynamicGeometry | None
    ) -> tuple[list[_Body], int, Mapping[bytes, TriangleScene]]:
        """Bodies that a former generation has, too, by the same numbers; the first number that it
        has not; and all shapes that it knows."""
        if older is None:
            return [], 1, {}
        pairs = enumerate(zip(older._layouts, self._layouts, strict=False))
        shared = next(
            (n for n, (one, same) in pairs if one is not same),
            min(len(older._layouts), len(self._layouts)),
        )
        gone = [min(one.bodies) for one in older._layouts[shared:] if one.bodies]
        first = min(gone, default=older._nbody)
        bodies = [one for one in older._bodies if one.body < first]
        shown = {id(scene) for one in bodies for scene in (one.full, one.clear)}
        self._scenes = {key: one for key, one in older._scenes.items() if id(one) in shown}
        return bodies, first, older._scenes

    @cached_property
    def _records(self) -> list[Numbers]:
        """Addresses of the scenes of all visible bodies for compiled code, full and clear."""
        scenes = [addressof(scene.record) for scene in self._scene_list]
        return [np.array(scenes, dtype=np.intp)[which] for which in (self._full, self._clear)]

    def _scene(
        self,
        model: mujoco.MjModel,
        rigid_group: RigidGroup,
        shown: list[bool],
        known: Mapping[bytes, TriangleScene],
    ) -> TriangleScene:
        count = len(rigid_group.geoms)
        frames = np.hstack([rigid_group.places, rigid_group.turns.reshape(count, 9)])
        key = shape_key(model, rigid_group.geoms, frames, shown)
        if key in known:
            self._scenes[key] = known[key]
        if key not in self._scenes:
            parts, rounds = [], []
            for number, geom in enumerate(rigid_group.geoms):
                if not shown[number]:
                    continue
                place, turn = rigid_group.places[number], rigid_group.turns[number]
                parts.append((number, triangles(model, geom, place, turn, FINE)))
                axes = _semi_axes(model, geom)
                if axes is not None:
                    rounds.append((number, RoundPart(place, turn, axes)))
            self._scenes[key] = TriangleScene(parts, rounds)
        return self._scenes[key]

    # -- where it is -------------------------------------------------------------------------

    def _at(self, snapshot: Snapshot) -> _Moment:
        moment = self._moment
        if moment is None or moment.snapshot() is not snapshot:
            # Two threads may both do this; either result is right.
            moment = self._moment = self._locate(snapshot)
        return moment

    def _locate(self, snapshot: Snapshot) -> _Moment:
        active = [layout.base for layout in snapshot.layouts.values()]
        present = ~self._is_robot
        present[[self._tree_of_root[base] for base in active if base in self._tree_of_root]] = True
        trees = np.flatnonzero(present & (self._count > 0))
        turns = rotation_matrices(snapshot.xquat[self._body_ids])
        places = snapshot.xpos[self._body_ids]
        centres = places + np.einsum("bij,bj->bi", turns, self._middles)
        # A tree of one piece is bounded by the piece itself, more tightly.
        single = self._count[trees] == 1
        first = np.minimum(self._first[trees], len(self._bodies) - 1)
        spheres = Spheres(
            np.where(single[:, None], centres[first], snapshot.xpos[self._roots[trees]]),
            np.where(single, self._spans[first], self._radii[trees]),
        )
        return _Moment(weakref.ref(snapshot), trees, spheres, turns, places, centres)

    def _own(self, snapshot: Snapshot, moment: _Moment, viewers: list[int | None]) -> Numbers:
        """Place in the list of present trees of each fan's own robot, -1 for none."""
        place = np.full(len(self._roots) + 1, -1, dtype=np.intp)
        place[moment.trees] = np.arange(len(moment.trees))
        trees = [
            self._tree_of_root.get(snapshot.layouts[viewer].base, -1)
            if viewer is not None and viewer in snapshot.layouts
            else -1
            for viewer in viewers
        ]
        return place[trees]

    # -- casting -----------------------------------------------------------------------------

    def _bodies_met(
        self, moment: _Moment, batch: RayBatch, reach: Array, rays: Numbers, trees: Numbers
    ) -> tuple[Numbers, Numbers]:
        """Pairs of a ray and a body whose own sphere it passes."""
        counts = self._count[trees]
        if counts.max() == 1:
            return rays, self._first[trees]
        before = np.cumsum(counts) - counts
        bodies = np.repeat(self._first[trees] - before, counts) + np.arange(int(counts.sum()))
        rays = np.repeat(rays, counts)
        near = passing(
            batch.origins[rays],
            batch.directions[rays],
            reach[rays],
            moment.centres[bodies],
            self._spans[bodies],
        )
        return rays[near], bodies[near]

    def _hits(
        self, moment: _Moment, batch: RayBatch, rays: Numbers, bodies: Numbers, normals: bool
    ) -> tuple[Array, Numbers, Array | None]:
        """Distances (k,), geoms (k,) and world normals (k, 3) of pairs of a ray and a body."""
        scenes = self._full[bodies]
        if batch.through_glass is not None:
            scenes = np.where(batch.through_glass[rays], self._clear[bodies], scenes)
        order = np.argsort(scenes, kind="stable")  # one scene after the other
        rays, bodies = rays[order], bodies[order]
        turns = moment.turns.reshape(-1, 9).T.take(bodies, axis=1).reshape(3, 3, -1)
        offset = batch.origins.take(rays, axis=0) - moment.places.take(bodies, axis=0)
        starts = turned_back(turns, offset)
        ways = turned_back(turns, batch.directions.take(rays, axis=0))
        distances, parts = np.empty(len(rays)), np.empty(len(rays), dtype=np.intp)
        facing = np.zeros((len(rays), 3)) if normals else None
        ends = np.cumsum(np.bincount(scenes, minlength=len(self._scene_list))).tolist()
        for scene, begin, end in zip(self._scene_list, [0, *ends], ends, strict=False):
            if begin == end:
                continue
            some = slice(begin, end)
            hits = scene.cast(starts[some], ways[some], normals=normals)
            distances[order[some]] = hits.distances
            parts[order[some]] = np.where(
                hits.geoms < 0, -1, hits.geoms + self._geom_begin[bodies[some]]
            )
            if facing is not None and hits.normals is not None:
                facing[order[some]] = turned_back(turns[:, :, some].swapaxes(0, 1), hits.normals)
        return distances, np.where(parts < 0, -1, self._geoms.take(parts, mode="wrap")), facing


def _nearest(
    count: int, rays: Numbers, distances: Array, geoms: Numbers, normals: Array | None
) -> Surfaces:
    """For every ray the nearest of the pairs that it is part of."""
    order = np.argsort(-distances, kind="stable")
    chosen = np.full(count, -1, dtype=np.intp)
    # The nearest comes last, and the last one stays.
    chosen[rays[order]] = order
    none = chosen < 0
    found = np.where(none, np.inf, distances[chosen])
    facing = None
    if normals is not None:
        facing = np.where((none | np.isinf(found))[:, None], 0.0, normals[chosen])
    return Surfaces(found, np.where(none, -1, geoms[chosen]), facing)


def _semi_axes(model: mujoco.MjModel, geom: int) -> Array | None:
    """Semi-axes (3,) of a sphere or an ellipsoid, m; None for everything else."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.full(3, float(size[0]))
    return size.copy() if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else None
