"""Where robots and things may be put: a robot gets the nearest free place, a thing its own or none.

The original put robots exactly where they were told, inside walls too, and left the rest to
physics. Here a robot that would start deeper than `TOLERATED` inside something, or outside the box
of the world, is moved, so that it can neither be shot out of a wall nor shove other robots aside:
to the nearest floor below or beside on which it stands level, and never to the top of a wall. What
floats is moved to the nearest free place. A thing is refused if its place is blocked.
"""

from __future__ import annotations

import math
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.errors import SpawnError
from usarsim_server.base.logs import Log
from usarsim_server.simulation.frames import Array, Pose, Vector, around
from usarsim_server.simulation.mailbox import yield_interpreter
from usarsim_server.simulation.model import SHELF_HEIGHT, CompiledWorld, put, root_qpos
from usarsim_server.simulation.movers import mocap_bodies, pose_as
from usarsim_server.simulation.objects import geom_names
from usarsim_server.simulation.raw import changeable
from usarsim_server.simulation.snapshot import Snapshot

TOLERATED = 0.02
"""m of overlap that the contact solver resolves gently (robots reference 5.1 #18)."""
CLEARANCE = 0.005
RINGS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5, 3.0)
"""m: radii searched around a blocked place."""
LIFTS = (0.05, 0.1, 0.25)
"""m: heights tried at every place of a ring that is blocked by scenery, such as a slope."""
HIGH_LIFTS = (0.5, 1.0, 2.0, 3.0, 5.0)
INWARD_STEP = 0.25
"""m between two looks for ground on the way from the edge of the world to its middle."""
MOST_LOOKS = 2000
FAR_RINGS = (4.0, 5.0, 6.5, 8.0, 10.0)
"""m: radii searched for a level floor where there is none within `RINGS`."""
DIRECTIONS = 12
TILT, UNEVEN = math.radians(3.0), 0.03
"""rad and m: how far ground may lean, and stand out of its plane, that counts as level."""
ABOVE_GROUND = 0.3
"""m above ground from which its neighbourhood is looked at."""
DROP, MOST_DROPS = 0.5, 5
"""m by which the neighbourhood lies lower at a drop, and in how many of eight directions there may
be one: five at the corner of a platform, six or more on the top of a wall."""
FOOT = 0.7
"""Part of its reach at which a robot stands on the ground."""
AROUND = 0.5
"""m beyond the robot's reach at which drops are looked for."""
EIGHT = tuple((math.cos(n * math.pi / 4.0), math.sin(n * math.pi / 4.0)) for n in range(8))
LOOKED_AROUND = 3.0
"""m around a place within which geoms are kept for rays up and down: all those around one robot,
and few others."""
FIT_CLEARANCE = 0.001
"""m above an endless floor that a thing is lifted to."""
CAPSULE_END = 2.0 / 3.0
"""Radii by which a cylinder is longer than the straight part of a capsule of the same volume."""
NUDGE = 1e-3
"""m: where two geoms have one centre the distance is measured with one of them moved by this."""

_TRIED = 1
"""Mask of the bodies that may be in contact with a robot whose place is looked for."""

_log = Log("simulation")

_PLANE, _MESH = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_MESH
_HFIELD = mujoco.mjtGeom.mjGEOM_HFIELD


class _Judge:
    """A box of the world, and a private copy of one model generation to try poses in."""

    _model: mujoco.MjModel

    def __init__(self, world: CompiledWorld, lower: Vector, upper: Vector) -> None:
        self._world = world
        self._lower, self._upper = lower, upper

    @cached_property
    def _data(self) -> mujoco.MjData:
        return mujoco.MjData(self._model)

    @cached_property
    def _mocap(self) -> NDArray[np.intp]:
        return mocap_bodies(self._model)

    def _show(self, snapshot: Snapshot) -> None:
        """Bring the private copy into the state of a snapshot."""
        pose_as(self._data, snapshot, self._mocap)

    def _inside(self, pose: Pose) -> bool:
        limits = zip(self._lower, pose.position, self._upper, strict=True)
        return all(low <= value <= high for low, value, high in limits)


class Placement(_Judge):
    """Finds free poses for robots in one model generation; used under the spawn lock only."""

    def __init__(self, world: CompiledWorld, lower: Vector, upper: Vector) -> None:
        super().__init__(world, lower, upper)
        # Awake, so that contacts with sleeping robots are found too.
        changed = ("body_contype", "body_conaffinity")
        self._model = changeable(world.model, *changed)
        self._model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._solid = (world.masks != 0).any(axis=0)
        # What is only seen (the true surface of a mesh) is no ground to stand on.
        felt = (self._model.geom_contype | self._model.geom_conaffinity) != 0
        self._felt = np.flatnonzero(felt & (self._model.geom_type != int(_PLANE)))
        self._floors = np.flatnonzero(self._model.geom_type == int(_PLANE))
        self._near: tuple[tuple[float, float], NDArray[np.intp]] | None = None
        self._dirty = True  # the robot is where it was tried, or this is another moment
        mujoco.mj_kinematics(self._model, self._data)

    def admit(self, pose: Pose, rest_height: float) -> Pose:
        """A wanted pose, moved into the box of the world and lifted above endless floors.

        It needs no slot, so it comes before making one.

        Raises:
            SpawnError: if the pose is not finite.
        """
        _check_finite(pose, "the spawn pose")
        return self._above_floor(self._moved_inside(pose), rest_height)

    def find(self, snapshot: Snapshot, slot: int, pose: Pose) -> Pose:
        """The wanted pose of the reference point if it is free, else the nearest good one.

        That is the nearest floor within 10 m below or beside it on which the robot stands level. If
        there is none, or the robot floats, it is the nearest free place within 3 m.

        Args:
            snapshot: where everything is.
            slot: the one that will be used, parked so far.
            pose: wanted.

        Raises:
            SpawnError: if the pose is not finite or everything near is full.
        """
        self._near, self._dirty = None, True
        self._look_for_contacts(snapshot, slot)
        rest_height = self._world.slots[slot].rest_height
        grounded = self.admit(pose, rest_height)
        outside = not self._inside(self._above_floor(pose, rest_height))
        if outside:
            grounded = self._over_ground(snapshot, slot, grounded)
        grounded = self._above_slab(snapshot, grounded, rest_height)
        floats = self._model.body_gravcomp[self._world.layouts[slot].base] > 0.0
        if grounded == pose and self._is_free(snapshot, slot, grounded):
            if not floats:
                self._tell_slope(snapshot, slot, grounded)
            return grounded
        found = None if floats else self._level_place(snapshot, slot, grounded)
        found = found or self._free_place(snapshot, slot, grounded)
        if found is None:
            x, y, z = pose.position
            raise SpawnError(f"no free place within {RINGS[-1]:g} m of ({x:.2f}, {y:.2f}, {z:.2f})")
        if outside:
            _log.warning(
                "a place outside the world was asked for, taking the nearest inside",
                wanted=pose.position,
                to=found.position,
            )
        return found

    def _look_for_contacts(self, snapshot: Snapshot, slot: int) -> None:
        """Look for contacts of one slot with all that is there, not for those of others with each
        other, and leave out what is parked: bodies offer a mask that the slot alone takes. Geoms
        have their own masks besides."""
        parked = {one.slot for one in self._world.layouts}
        parked -= {slot, *(one.slot for one in snapshot.layouts.values())}
        offered = np.where(self._solid, _TRIED, 0)
        for other in parked:
            offered[[*self._world.layouts[other].bodies]] = 0
        own = [*self._world.layouts[slot].bodies]
        self._model.body_conaffinity[:] = 0
        self._model.body_conaffinity[own] = offered[own]
        offered[own] = 0
        self._model.body_contype[:] = offered

    def _free_place(self, snapshot: Snapshot, slot: int, pose: Pose) -> Pose | None:
        """The nearest free pose of the same attitude, lifted if need be; None if all is full."""
        places = around(pose.position, RINGS, DIRECTIONS)
        poses = (Pose(place, pose.quaternion) for place in places)
        for place in filter(self._inside, poses):
            blocked, by_moving = self._overlap(snapshot, slot, place)
            if blocked <= TOLERATED:
                return place
            # Never on top of a robot or a crate, which may drive away below.
            for lift in () if by_moving else LIFTS:
                if self._is_free(snapshot, slot, _raised(place, lift)):
                    return _raised(place, lift)
        lifted = (_raised(pose, lift) for lift in HIGH_LIFTS)
        return next((one for one in lifted if self._is_free(snapshot, slot, one)), None)

    def _is_free(self, snapshot: Snapshot, slot: int, pose: Pose) -> bool:
        return self._overlap(snapshot, slot, pose)[0] <= TOLERATED

    # -- level ground ------------------------------------------------------------------------

    def _level_place(self, snapshot: Snapshot, slot: int, pose: Pose) -> Pose | None:
        """The nearest free pose on level ground below or beside a pose; None if there is none."""
        rest_height = self._world.slots[slot].rest_height
        self._park(snapshot)
        reach = self._reach(slot)
        for x, y, z in around(pose.position, (*RINGS, *FAR_RINGS), DIRECTIONS):
            # From a little higher, too: a floor beside may be a step or a slope up.
            for lift in (0.0, LIFTS[-1]):
                self._park(snapshot)
                floor = self._floor((x, y, z + lift))
                height = floor + rest_height
                stands = abs(z - height) < 1.5 * CLEARANCE
                place = Pose((x, y, z if stands else height + CLEARANCE), pose.quaternion)
                if not math.isfinite(floor) or not self._inside(place):
                    continue
                tilt, uneven = self._slope((x, y, floor), reach)
                if tilt > TILT or uneven > UNEVEN or self._drops((x, y, floor), reach):
                    continue
                if self._is_free(snapshot, slot, place):
                    return place
        return None

    def _tell_slope(self, snapshot: Snapshot, slot: int, pose: Pose) -> None:
        """Log that the ground below a place that was asked for is not level."""
        self._park(snapshot)
        x, y, z = pose.position
        floor = self._floor((x, y, z))
        if not math.isfinite(floor):
            return
        tilt, uneven = self._slope((x, y, floor), self._reach(slot))
        if tilt > TILT or uneven > UNEVEN:
            rough = math.isfinite(uneven)
            _log.warning(
                "the place that was asked for is not level",
                place=pose.position,
                tilt=f"{math.degrees(tilt):.0f} deg" if rough else "at an edge",
                uneven=f"{uneven:.2f} m" if rough else "at an edge",
            )

    def _park(self, snapshot: Snapshot) -> None:
        """Take the robot away from where it was tried, so that rays do not meet it."""
        if self._dirty:
            self._show(snapshot)
            mujoco.mj_kinematics(self._model, self._data)
            self._dirty = False

    def _floor(self, start: Vector) -> float:
        """Height of the ground straight below a point; infinite if that is a thing that moves."""
        way, geom = self._meet(start, -1.0)
        if geom < 0 or self._model.body_weldid[self._model.geom_bodyid[geom]]:
            return math.inf
        return start[2] - way

    def _slope(self, ground: Vector, reach: float) -> tuple[float, float]:
        """How far the ground below a robot leans, rad, and stands out of its plane, m.

        Both are infinite where there is a hole, or a thing that moves.

        Args:
            ground: the point below its reference point.
            reach: how far the robot reaches from there, m.
        """
        x, y, z = ground
        radius = FOOT * reach
        heights = np.array(
            [self._floor((x + c * radius, y + s * radius, z + ABOVE_GROUND)) - z for c, s in EIGHT]
        )
        if not np.isfinite(heights).all():
            return math.inf, math.inf
        ways = np.array(EIGHT) * radius
        # Least squares: the directions are even, so both parts of the slope are independent.
        gradient = heights @ ways / (ways**2).sum(axis=0)
        middle = heights.mean()
        uneven = max(np.abs(heights - middle - ways @ gradient).max(), abs(middle))
        return math.atan(float(np.hypot(*gradient))), float(uneven)

    def _drops(self, ground: Vector, reach: float) -> bool:
        """Whether ground is a wall's top: too many ways from it lead down."""
        x, y, z = ground
        away = reach + AROUND
        floors = (
            self._meet((x + c * away, y + s * away, z + ABOVE_GROUND), -1.0) for c, s in EIGHT
        )
        return sum(way > ABOVE_GROUND + DROP for way, _ in floors) > MOST_DROPS

    def _moved_inside(self, pose: Pose) -> Pose:
        """The nearest pose in the box of the world."""
        x, y, z = (
            min(max(value, low), high)
            for low, value, high in zip(self._lower, pose.position, self._upper, strict=True)
        )
        return Pose((x, y, z), pose.quaternion)

    def _over_ground(self, snapshot: Snapshot, slot: int, pose: Pose) -> Pose:
        """The first pose on the way to the middle of the world that has ground below or above it.

        The box of a world is larger than its ground. There has to be ground as far back as the
        robot reaches, so that it does not start with its rear wheels over the void.
        """
        x, y, z = pose.position
        ahead = [
            (low + high) / 2.0 - value
            for low, value, high in zip(self._lower, (x, y), self._upper, strict=False)
        ]
        looks = min(MOST_LOOKS, math.ceil(math.hypot(*ahead) / INWARD_STEP)) + 1
        self._park(snapshot)
        reach = self._reach(slot) / max(math.hypot(*ahead), 1e-6)

        def at(share: float) -> Vector:
            return x + share * ahead[0], y + share * ahead[1], z

        for share in np.linspace(0.0, 1.0, looks).tolist():
            if self._has_ground(at(share)) and self._has_ground(at(share - reach)):
                return Pose(at(share), pose.quaternion)
        return pose

    def _reach(self, slot: int) -> float:
        """How far a robot's shapes reach from its reference point, m."""
        layout = self._world.layouts[slot]
        away = self._data.geom_xpos[layout.geoms] - self._data.xpos[layout.base]
        reaches = np.linalg.norm(away, axis=1) + self._model.geom_rbound[layout.geoms]
        return float(reaches.max(initial=0.0))

    def _has_ground(self, place: Vector) -> bool:
        return math.isfinite(self._way(place, -1.0)) or math.isfinite(self._way(place, 1.0))

    def _above_floor(self, pose: Pose, rest_height: float) -> Pose:
        """Lift a pose below an endless floor to its surface; no way leads there otherwise."""
        x, y, z = pose.position
        for geom in self._floors:
            normal = self._data.geom_xmat[geom].reshape(3, 3)[:, 2]
            if normal[2] < 0.5:
                continue
            origin = self._data.geom_xpos[geom]
            level = (
                origin[2] - (normal[0] * (x - origin[0]) + normal[1] * (y - origin[1])) / normal[2]
            )
            if z < level + rest_height - TOLERATED:
                z = float(level) + rest_height + CLEARANCE
        return Pose((x, y, z), pose.quaternion)

    def _above_slab(self, snapshot: Snapshot, pose: Pose, rest_height: float) -> Pose:
        """Lift a pose with a void below it and something above onto the top of that.

        This is where a client's robot ends that takes z for upwards: under a floor of finite
        thickness, about to fall out of the world.
        """
        x, y, z = pose.position
        self._park(snapshot)
        if self._way(pose.position, -1.0) <= z - self._lower[2]:
            return pose
        bottom = self._way(pose.position, 1.0)
        thickness = self._way((x, y, z + bottom + 1e-6), 1.0) if math.isfinite(bottom) else math.inf
        if not math.isfinite(thickness):
            return pose
        return Pose((x, y, z + bottom + thickness + rest_height + CLEARANCE), pose.quaternion)

    def _way(self, start: Vector, up: float) -> float:
        """Way (m) to the next surface straight up (1) or down (-1); inf if there is none."""
        return self._meet(start, up)[0]

    def _meet(self, start: Vector, up: float) -> tuple[float, int]:
        """Way (m) to the next surface straight up (1) or down (-1), and its geom; inf and -1.

        Only geoms above or below the point are asked, and endless planes as contacts know them:
        `mj_ray` would ask all geoms of the world, and pass a plane beyond what is drawn of it.
        """
        model, data = self._model, self._data
        found, met = math.inf, -1
        point, upward = np.array(start), np.array([0.0, 0.0, up])
        places, turns, sizes = data.geom_xpos, data.geom_xmat, model.geom_size
        geoms = self._over_and_under(start)
        for geom, kind in zip(geoms.tolist(), model.geom_type[geoms].tolist(), strict=True):
            if kind == int(_MESH):
                way = mujoco.mj_rayMesh(model, data, geom, point, upward, None)
            elif kind == int(_HFIELD):
                way = mujoco.mj_rayHfield(model, data, geom, point, upward, None)
            else:
                shape = places[geom], turns[geom], sizes[geom]
                way = mujoco.mju_rayGeom(*shape, point, upward, kind, None)
            if 0.0 <= way < found and start[2] + up * way < SHELF_HEIGHT - 100.0:
                found, met = float(way), geom
        for geom in self._floors.tolist():
            normal = turns[geom].reshape(3, 3)[:, 2]
            rise = up * float(normal[2])
            if abs(rise) < 1e-9:
                continue
            way = float(normal @ (places[geom] - point)) / rise
            if 0.0 <= way < found:
                found, met = way, geom
        return found, met

    def _over_and_under(self, start: Vector) -> NDArray[np.intp]:
        """Geoms whose bounding spheres a vertical line meets."""
        x, y, _ = start
        if self._near is None or math.dist(self._near[0], (x, y)) > LOOKED_AROUND:
            self._near = (x, y), self._felt[self._aside(self._felt, x, y) < LOOKED_AROUND]
        near = self._near[1]
        return near[self._aside(near, x, y) < 0.0]

    def _aside(self, geoms: NDArray[np.intp], x: float, y: float) -> Array:
        """Level way (m) from a vertical line to the bounding spheres of geoms; negative within."""
        away = self._data.geom_xpos[geoms, :2] - (x, y)
        return np.asarray(np.hypot(away[:, 0], away[:, 1]) - self._model.geom_rbound[geoms])

    def _overlap(self, snapshot: Snapshot, slot: int, pose: Pose) -> tuple[float, bool]:
        """Deepest overlap (m) of the robot at a pose, and whether anything movable is in it."""
        layout = self._world.layouts[slot]
        data = self._data
        yield_interpreter()
        self._dirty = True
        self._show(snapshot)
        data.qpos[layout.qpos : layout.qpos + 7] = root_qpos(pose)
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_collision(self._model, data)
        if data.ncon == 0:
            return 0.0, False
        pairs = data.contact.geom
        own = np.isin(pairs, layout.geoms)
        touching = own.any(axis=1) & ~own.all(axis=1) & (data.contact.dist < -TOLERATED)
        if not touching.any():
            return 0.0, False
        others = np.where(own[touching, 0], pairs[touching, 1], pairs[touching, 0])
        moving = self._model.body_weldid[self._model.geom_bodyid[others]] != 0
        return float(-data.contact.dist[touching].min()), bool(moving.any())


def _check_finite(pose: Pose, what: str) -> None:
    if not all(map(math.isfinite, (*pose.position, *pose.quaternion))):
        raise SpawnError(f"{what} is not finite")


def _raised(pose: Pose, lift: float) -> Pose:
    x, y, z = pose.position
    return Pose((x, y, z + lift), pose.quaternion)


class Fitting(_Judge):
    """Judges places for things in one model generation; used by one thread at a time.

    Contacts do not tell: between things that are placed, and between them and the scenery, there
    are none. So distances between geoms are measured.
    """

    def admit(self, pose: Pose) -> None:
        """Refuse what no thing can be put at, whatever its shape; needs no slot.

        Raises:
            SpawnError: if the pose is not finite, or beyond the walls or the roof of the world.
        """
        _check_finite(pose, "the pose")
        x, y, z = pose.position
        self._check_inside(Pose((x, y, max(z, self._lower[2])), pose.quaternion))

    def check(self, snapshot: Snapshot, slot: int, pose: Pose) -> Pose:
        """The wanted pose of a thing's origin, lifted out of an endless floor if need be.

        `slot` holds the thing; wherever it is now does not count.

        Raises:
            SpawnError: if the pose is not finite or outside the world, or if something is there.
        """
        self.admit(pose)
        self._put(snapshot, slot, pose)
        own = self._solid[np.isin(self._solid, self._world.layouts[slot].geoms)]
        depth = self._depth_in_floors(own)
        if depth > TOLERATED:
            x, y, z = pose.position
            pose = Pose((x, y, z + depth + FIT_CLEARANCE), pose.quaternion)
            self._put(snapshot, slot, pose)
        self._check_inside(pose)
        for geom in own:
            yield_interpreter()
            for other in self._near(geom, own):
                if self._distance(geom, other) < -TOLERATED:
                    name = geom_names(self._world.model)[other] or "something nameless"
                    raise SpawnError(f"the place is blocked by {name}")
        return pose

    @cached_property
    def _model(self) -> mujoco.MjModel:
        model = changeable(self._world.model, "geom_type", "geom_size")
        # A capsule whose axis is inside a box counts as touching it only (MuJoCo 3.17).
        capsules = model.geom_type == int(mujoco.mjtGeom.mjGEOM_CAPSULE)
        model.geom_type[capsules] = mujoco.mjtGeom.mjGEOM_CYLINDER
        model.geom_size[capsules, 1] += CAPSULE_END * model.geom_size[capsules, 0]
        return model

    @cached_property
    def _solid(self) -> NDArray[np.intp]:
        """Geoms that things can bump into."""
        model = self._model
        return np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0)

    def _put(self, snapshot: Snapshot, slot: int, pose: Pose) -> None:
        self._show(snapshot)
        put(self._world, self._data, slot, root_qpos(pose))
        mujoco.mj_kinematics(self._model, self._data)

    def _check_inside(self, pose: Pose) -> None:
        if not self._inside(pose):
            x, y, z = pose.position
            raise SpawnError(f"the place ({x:g}, {y:g}, {z:g}) is outside the world")

    def _depth_in_floors(self, own: NDArray[np.intp]) -> float:
        """How far (m) a thing has to rise to be above all level endless floors."""
        model, data = self._model, self._data
        depth = 0.0
        for plane in self._solid[model.geom_type[self._solid] == int(mujoco.mjtGeom.mjGEOM_PLANE)]:
            if data.geom_xmat[plane][8] < 1.0 - 1e-6:
                continue
            for geom in own:
                depth = max(depth, -self._distance(geom, plane))
        return depth

    def _near(self, geom: int, own: NDArray[np.intp]) -> NDArray[np.intp]:
        """Solid geoms of others whose bounding sphere touches that of a geom."""
        model, data = self._model, self._data
        others = self._solid[~np.isin(self._solid, own)]
        offset = data.geom_xpos[others] - data.geom_xpos[geom]
        gap = np.linalg.norm(offset, axis=1) - model.geom_rbound[others]
        for index in np.flatnonzero(model.geom_type[others] == int(mujoco.mjtGeom.mjGEOM_PLANE)):
            gap[index] = abs(offset[index] @ data.geom_xmat[others[index]].reshape(3, 3)[:, 2])
        near: NDArray[np.intp] = others[gap < model.geom_rbound[geom]]
        return near

    def _distance(self, geom: int, other: int) -> float:
        """Distance between two geoms, m; negative: how deep they overlap."""
        model, data = self._model, self._data
        nearest = np.zeros(6)
        reach = 0.5
        distance = mujoco.mj_geomDistance(model, data, geom, other, reach, nearest)
        if distance >= 0.0 and np.allclose(data.geom_xpos[geom], data.geom_xpos[other], atol=1e-4):
            kept = data.geom_xpos[geom].copy()
            data.geom_xpos[geom] += NUDGE * np.array([1.0, 0.7, 0.4])
            distance = mujoco.mj_geomDistance(model, data, geom, other, reach, nearest)
            data.geom_xpos[geom] = kept
        return float(distance)
