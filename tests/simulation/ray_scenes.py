"""Random sceneries for ray tests, and MuJoCo's own rays as the reference."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from sim_fakes import Geom, robot_model

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import SHELF_NAME, CompiledWorld
from usarsim_server.simulation.rays.cast import cast
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.rays.scenery import StaticGeometry
from usarsim_server.simulation.snapshot import Snapshot

Array = NDArray[np.float64]

SHAPES = ("box", "sphere", "ellipsoid", "capsule", "cylinder", "mesh", "hfield")
ROUND = ("sphere", "ellipsoid", "capsule", "cylinder")


def random_scene(seed: int, shapes: Sequence[str] = SHAPES, copies: int = 3) -> mujoco.MjSpec:
    """Fixed geometry of every kind over an endless floor, at random places in a 10 m cube."""
    dice = np.random.default_rng(seed)
    spec = mujoco.MjSpec()
    add_meshes(spec)
    spec.worldbody.add_geom(name="floor", type=Geom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    for number in range(copies):
        for shape in shapes:
            add_shape(spec, spec.worldbody, f"{shape}{number}", shape, dice)
    return spec


def add_meshes(spec: mujoco.MjSpec) -> None:
    """A mesh that is not convex (an open tray) and a height field with hills."""
    spec.add_mesh(name="tray", uservert=TRAY_VERTICES.ravel(), userface=TRAY_FACES.ravel())
    rows, columns = 7, 9
    y, x = np.mgrid[0:rows, 0:columns]
    # No sum of waves along x and y: then it would not matter which way cells are cut.
    hills = 0.5 + 0.5 * np.sin(1.3 * x) * np.cos(1.7 * y)
    field = spec.add_hfield(name="hills", nrow=rows, ncol=columns, size=[1.5, 1.0, 0.6, 0.2])
    field.userdata = hills.ravel()


def add_shape(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    name: str,
    shape: str,
    dice: np.random.Generator,
    spread: float = 5.0,
    scale: float = 1.0,
) -> mujoco.MjsGeom:
    """One geom of a kind with random size, place and attitude."""
    size = scale * dice.uniform(0.1, 0.8, 3)
    place = dice.uniform(-spread, spread, 3) + np.array([0.0, 0.0, spread + 1.0])
    attitude = dice.normal(size=4)
    geom = body.add_geom(name=name, type=getattr(Geom, f"mjGEOM_{shape.upper()}"), pos=place)
    geom.quat = attitude / np.linalg.norm(attitude)
    if shape == "mesh":
        geom.meshname = "tray"
    elif shape == "hfield":
        geom.hfieldname = "hills"
    else:
        geom.size = size
    return geom


def _tray() -> tuple[Array, NDArray[np.int32]]:
    """A tray of five boards without thickness, each with two faces: not convex, not closed."""
    floor = [(-1, -0.6, 0), (1, -0.6, 0), (1, 0.6, 0), (-1, 0.6, 0)]
    rim = [(1.3 * x, 1.3 * y, 0.5) for x, y, _ in floor]
    vertices = np.array([*floor, *rim], dtype=float)
    faces = [(0, 1, 2), (0, 2, 3)]
    for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
        faces += [(a, b, b + 4), (a, b + 4, a + 4)]
    both = faces + [(a, c, b) for a, b, c in faces]
    return vertices, np.array(both, dtype=np.int32)


TRAY_VERTICES, TRAY_FACES = _tray()


def random_fans(
    dice: np.random.Generator, count: int = 6, rays: int = 40, reach: float = 30.0
) -> list[RayFan]:
    """Fans with scattered rays from random places in the cube."""
    fans = []
    for _ in range(count):
        directions = dice.normal(size=(rays, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        origin = dice.uniform(-6.0, 6.0, 3) + np.array([0.0, 0.0, 6.5])
        fans.append(RayFan(origin, directions, reach, normals=True))
    return fans


def arm_robot() -> mujoco.MjSpec:
    """The test robot with an arm of two links and a lift, folded on its back."""
    spec = robot_model().build()
    shoulder = spec.body("base").add_body(name="shoulder", pos=[0.0, 0.0, 0.1])
    shoulder.add_joint(name="shoulder", axis=[0.0, 1.0, 0.0], pos=[0.4, 0.0, 0.0])
    shoulder.add_geom(type=Geom.mjGEOM_CAPSULE, fromto=[0, 0, 0, -0.3, 0, 0], size=[0.02, 0, 0])
    elbow = shoulder.add_body(name="elbow", pos=[-0.3, 0.0, 0.0])
    elbow.add_joint(name="elbow", axis=[0.0, 1.0, 0.0])
    elbow.add_geom(type=Geom.mjGEOM_CAPSULE, fromto=[0, 0, 0, 0.3, 0, 0], size=[0.02, 0, 0])
    lift = elbow.add_body(name="lift", pos=[0.3, 0.0, 0.0])
    lift.add_joint(
        name="lift", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0], range=[0.0, 0.8], limited=1
    )
    lift.add_geom(type=Geom.mjGEOM_BOX, size=[0.1, 0.02, 0.02])
    return spec


class Reference:
    """What MuJoCo's rays see of a snapshot, without the asking robot and the parked ones."""

    def __init__(self, world: CompiledWorld) -> None:
        self.model = world.model.__copy__()
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self.data = mujoco.MjData(self.model)
        self.world = world
        mujoco.mj_kinematics(self.model, self.data)

    def show(self, snapshot: Snapshot, robot: int | None) -> None:
        """Take the state of a snapshot and hide what a robot must not see."""
        self.data.qpos[:] = snapshot.qpos
        mujoco.mj_kinematics(self.model, self.data)
        present = {layout.slot for layout in snapshot.layouts.values()}
        if robot is not None:
            present.discard(snapshot.layouts[robot].slot)
        for layout in self.world.layouts:
            self.model.geom_rgba[layout.geoms, 3] = 1.0 if layout.slot in present else 0.0
        self.model.geom_rgba[self.model.geom(SHELF_NAME).id, 3] = 0.0

    def cast(self, origin: Array, directions: Array) -> tuple[Array, Array, NDArray[np.int32]]:
        """Distances (inf for a miss), normals and geoms of rays (n, 3)."""
        count = len(directions)
        distances, normals = np.empty(count), np.zeros((count, 3))
        geoms = np.empty(count, dtype=np.int32)
        start, ways = np.ascontiguousarray(origin), np.ascontiguousarray(directions).reshape(-1)
        answers = geoms, distances, normals.reshape(-1)
        mujoco.mj_multiRay(self.model, self.data, start, ways, None, 1, -1, *answers, count, 1e6)
        return np.where(geoms < 0, np.inf, distances), normals, geoms


def agree(one: Array, other: Array, tolerance: float = 1e-3) -> NDArray[np.bool_]:
    """Where two arrays of distances agree; a miss agrees with a miss only."""
    both_missed = np.isinf(one) & np.isinf(other)
    with np.errstate(invalid="ignore"):
        return both_missed | (np.abs(one - other) < tolerance)


def explained(reference: Reference, origin: Array, direction: Array, seen: float) -> bool:
    """Whether a ray beside this one, 1 mm away at most, sees what was seen (edges, grazing)."""
    away = np.array([1.0, 0.0, 0.0]) if abs(direction[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    side = np.cross(direction, away)
    side /= np.linalg.norm(side)
    up = np.cross(direction, side)
    distances = []
    for angle in np.arange(0.0, 2 * np.pi, np.pi / 8):
        for step in (2e-4, 5e-4, 1e-3):
            shift = step * (np.cos(angle) * side + np.sin(angle) * up)
            distances.append(reference.cast(origin + shift, direction[None])[0][0])
    found = np.array(distances)
    if np.isinf(seen):
        return bool(np.isinf(found).any())
    return bool(found.min() - 1e-3 <= seen <= found.max() + 1e-3)


class Caster:
    """All that is needed to cast rays in the world of an engine."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.static = StaticGeometry(engine.world)
        self.dynamic = DynamicGeometry(engine.world)

    def __call__(self, *fans: RayFan, robot: int | None = None) -> list[RayHits]:
        """Cast fans in the present state."""
        return self.at(self.engine.snapshot(), *fans, robot=robot)

    def at(self, snapshot: Snapshot, *fans: RayFan, robot: int | None = None) -> list[RayHits]:
        """Cast fans in the state of a snapshot."""
        return cast(fans, snapshot, robot, self.static, self.dynamic)


def ray(
    origin: tuple[float, ...], direction: tuple[float, ...], reach: float = 20.0, **options: bool
) -> RayFan:
    """A fan of one ray."""
    way = np.array([direction], dtype=float)
    return RayFan(np.array(origin, dtype=float), way / np.linalg.norm(way), reach, **options)


def check_against_reference(
    caster: Caster, fans: list[RayFan], robot: int | None = None, tolerance: float = 1e-3
) -> int:
    """Every distance is MuJoCo's within the tolerance, but at edges; returns the number of hits."""
    snapshot = caster.engine.snapshot()
    reference = Reference(caster.engine.world)
    reference.show(snapshot, robot)
    hits = 0
    for fan, answer in zip(fans, caster.at(snapshot, *fans, robot=robot), strict=True):
        truth, _, _ = reference.cast(fan.origin, fan.directions)
        truth[truth > fan.max_range] = np.inf
        good = agree(answer.distances, truth, tolerance)
        hits += int(np.isfinite(truth).sum())
        assert good.mean() > 0.9
        for index in np.flatnonzero(~good):
            seen = float(answer.distances[index])
            assert explained(reference, fan.origin, fan.directions[index], seen)
    return hits


def outside_height_fields(engine: Engine, fans: list[RayFan]) -> list[RayFan]:
    """Fans that do not start inside a height field, where MuJoCo answers oddly."""
    model, data = engine.world.model, engine.data
    kept = []
    for fan in fans:
        inside = False
        for geom in np.flatnonzero(model.geom_type == Geom.mjGEOM_HFIELD):
            local = data.geom_xmat[geom].reshape(3, 3).T @ (fan.origin - data.geom_xpos[geom])
            inside |= bool((np.abs(local) < [1.6, 1.1, 0.7]).all())
        if not inside:
            kept.append(fan)
    return kept


def narrow_fans(dice: np.random.Generator) -> list[RayFan]:
    """Fans of different width and range, among them rings and single rays."""
    fans = []
    for width in (0.0, 0.05, 0.3, 1.0, 3.0) * 3:
        axis = dice.normal(size=3)
        directions = axis / np.linalg.norm(axis) + width * dice.normal(size=(12, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        origin = dice.uniform((-5, -5, 0.0), (5, 5, 3))
        if width == 1.0:
            origin = origin + 0.2 * dice.normal(size=(12, 3))
        fans.append(RayFan(origin, directions, float(dice.choice([0.5, 2.0, 20.0]))))
    return fans
