"""Rays against MuJoCo's own rays: what is hit, how far, with which normal, and what never is."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from ray_scenes import (
    Reference,
    add_meshes,
    add_shape,
    agree,
    explained,
    random_fans,
    random_scene,
)
from sim_fakes import (
    RADIUS,
    ROBOT,
    Geom,
    Scenery,
    add_box,
    base_qpos,
    engine_with,
    floor,
    pose_at,
    robot_model,
    run,
    simulation,
    straight,
    yard,
)

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.rays import moving as moving_geometry
from usarsim_server.simulation.rays.cast import cast, cast_all
from usarsim_server.simulation.rays.culling import Spheres
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.query import PendingReport, RayBatch, RayFan, RayHits, join
from usarsim_server.simulation.rays.scenery import StaticGeometry
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

Array = NDArray[np.float64]


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


class TestStatic:
    """Fixed geometry of every kind."""

    @pytest.mark.parametrize("seed", range(6))
    def test_distances_are_those_of_mujoco(self, seed: int) -> None:
        """In random worlds of all shapes distances agree within 1 mm (edges may be 1 mm off)."""
        engine = Engine(lambda: random_scene(seed), PhysicsOptions())
        mujoco.mj_kinematics(engine.world.model, engine.data)
        fans = random_fans(np.random.default_rng(seed), count=14)
        assert check_against_reference(Caster(engine), outside_height_fields(engine, fans)) > 200

    def test_planes_are_endless(self) -> None:
        """A plane stops rays as it stops wheels: everywhere, also beyond its drawn size."""

        def scenery() -> mujoco.MjSpec:
            spec = mujoco.MjSpec()
            spec.worldbody.add_geom(type=Geom.mjGEOM_PLANE, size=[1.0, 1.0, 1.0])
            return spec

        (hit,) = Caster(Engine(scenery, PhysicsOptions()))(ray((5, 5, 2), (0, 0, -1)))
        assert hit.distances[0] == pytest.approx(2.0)

    def test_planes_are_seen_from_above_only(self) -> None:
        """A plane is the surface of a half-space: seen from below it is not there."""
        (hit,) = Caster(Engine(floor(), PhysicsOptions()))(ray((0, 0, -2), (0, 0, 1)))
        assert np.isinf(hit.distances[0])

    def test_sloping_planes(self) -> None:
        """Distance to a slope is that of geometry."""
        caster = Caster(Engine(floor(slope=np.radians(30.0)), PhysicsOptions()))
        (hit,) = caster(ray((-1, 0, 0), (1, 0, 0), normals=True))
        assert hit.distances[0] == pytest.approx(1.0)
        assert hit.normals is not None
        np.testing.assert_allclose(hit.normals[0], (-0.5, 0.0, np.sqrt(0.75)), atol=1e-9)

    def test_a_world_without_anything(self) -> None:
        """In an empty world nothing is hit, and asking does not fail."""
        (hit,) = Caster(Engine(mujoco.MjSpec, PhysicsOptions()))(
            ray((0, 0, 1), (1, 0, 0), normals=True)
        )
        assert np.isinf(hit.distances[0])
        assert hit.normals is not None
        assert not hit.normals.any()

    def test_the_parking_shelf_is_invisible(self) -> None:
        """Looking up one sees the sky, not the shelf above the world."""
        caster = Caster(engine_with((0.0, 0.0), spare=3))
        (hit,) = caster(ray((0, 0, 1), (0, 0, 1), reach=1e6), robot=0)
        assert np.isinf(hit.distances[0])

    def test_geometry_without_colour_is_invisible(self) -> None:
        """What is drawn with alpha zero is not seen by rays either."""

        def scenery() -> mujoco.MjSpec:
            spec = floor()()
            add_box(spec, "ghost", (2.0, 0.0, 0.5), (0.1, 1.0, 0.5)).rgba = [1, 1, 1, 0]
            add_box(spec, "wall", (3.0, 0.0, 0.5), (0.1, 1.0, 0.5))
            return spec

        (hit,) = Caster(Engine(scenery, PhysicsOptions()))(ray((0, 0, 0.5), (1, 0, 0)))
        assert hit.distances[0] == pytest.approx(2.9)

    def test_far_from_the_origin(self) -> None:
        """A kilometre away from the origin distances are good to a millimetre."""

        def scenery() -> mujoco.MjSpec:
            spec = floor()()
            add_box(spec, "wall", (1003.0, 1000.0, 0.5), (0.1, 1.0, 0.5))
            return spec

        caster = Caster(Engine(scenery, PhysicsOptions()))
        (hit,) = caster(ray((1000.2, 1000.3, 0.5), (1, 0, 0)))
        assert hit.distances[0] == pytest.approx(2.7, abs=1e-3)


class TestGlass:
    """Transparent material lets some rays through."""

    @pytest.fixture
    def caster(self) -> Caster:
        """A glass pane by material, one by name, and a wall behind them."""

        def scenery() -> mujoco.MjSpec:
            spec = floor()()
            spec.add_material(name="Window_Glass", rgba=[0.5, 0.7, 0.9, 0.3])
            add_box(spec, "pane", (1.0, 0.0, 0.5), (0.01, 1.0, 0.5)).material = "Window_Glass"
            add_box(spec, "TransparentDoor", (2.0, 0.0, 0.5), (0.01, 1.0, 0.5))
            add_box(spec, "wall", (3.0, 0.0, 0.5), (0.1, 1.0, 0.5))
            return spec

        return Caster(Engine(scenery, PhysicsOptions()))

    def test_stops_rays_normally(self, caster: Caster) -> None:
        """A laser or sonar sees a pane."""
        (hit,) = caster(ray((0, 0, 0.5), (1, 0, 0)))
        assert hit.distances[0] == pytest.approx(0.99)

    def test_lets_through_on_request(self, caster: Caster) -> None:
        """An infrared ray reads the wall behind the glass (robots checklist 77)."""
        (hit,) = caster(ray((0, 0, 0.5), (1, 0, 0), through_glass=True))
        assert hit.distances[0] == pytest.approx(2.9)

    def test_both_kinds_in_one_batch(self, caster: Caster) -> None:
        """Fans of both kinds are answered in order, whatever their mixture."""
        fans = [ray((0, 0, 0.5), (1, 0, 0), through_glass=bool(k % 3)) for k in range(7)]
        seen = [float(hit.distances[0]) for hit in caster(*fans)]
        np.testing.assert_allclose(seen, [2.9 if k % 3 else 0.99 for k in range(7)], atol=1e-4)


class TestFans:
    """Batches, ranges and normals."""

    def test_beyond_the_range_is_a_miss(self) -> None:
        """What is farther than a fan's range is not hit, each fan by its own range."""
        caster = Caster(Engine(yard, PhysicsOptions()))
        near, far, plain = caster(
            ray((0, 0, 0.5), (1, 0, 0), reach=2.89, normals=True),
            ray((0, 0, 0.5), (1, 0, 0), reach=2.91),
            ray((0, 0, 3.0), (0, 0, -1), reach=2.99),
        )
        assert np.isinf(near.distances[0])
        assert near.normals is not None
        assert not near.normals.any()
        assert far.distances[0] == pytest.approx(2.9)
        assert np.isinf(plain.distances[0])

    def test_moving_things_beyond_the_range_are_a_miss(self) -> None:
        """The range holds for robots and crates as well."""
        caster = Caster(engine_with((0.0, 0.0), (2.0, 0.0)))
        inside, outside = caster(
            ray((0.3, 0, 0.15), (1, 0, 0), reach=1.51),
            ray((0.3, 0, 0.15), (1, 0, 0), reach=1.49),
            robot=0,
        )
        assert inside.distances[0] == pytest.approx(1.5, abs=1e-6)
        assert np.isinf(outside.distances[0])

    @pytest.mark.parametrize("reach", [1e9, np.inf])
    def test_no_limit(self, reach: float) -> None:
        """A ray to a satellite may be as long as it likes."""
        caster = Caster(engine_with((0.0, 0.0), (2.0, 0.0)))
        up, ahead = caster(
            ray((0, 0, 1), (0, 0, 1), reach), ray((0.3, 0, 0.15), (1, 0, 0), reach), robot=0
        )
        assert np.isinf(up.distances[0])
        assert ahead.distances[0] == pytest.approx(1.5, abs=1e-6)

    def test_answers_keep_the_order_of_the_fans(self) -> None:
        """Fans of different sizes and origins are answered in their order."""
        caster = Caster(Engine(yard, PhysicsOptions()))
        fans = []
        for count in (1, 5, 2):
            directions = np.tile([1.0, 0.0, 0.0], (count, 1))
            fans.append(RayFan(np.array([0.1 * count, 0.0, 0.5]), directions, 20.0))
        for fan, hit in zip(fans, caster(*fans), strict=True):
            expected = np.full(len(fan.directions), 2.9 - fan.origin[0])
            np.testing.assert_allclose(hit.distances, expected, atol=1e-5)

    def test_no_fans_no_answers(self) -> None:
        """An empty batch is fine."""
        assert Caster(engine_with((0.0, 0.0)))() == []

    def test_normals_only_for_those_who_ask(self) -> None:
        """A fan that does not ask gets no normals, also beside one that does."""
        caster = Caster(Engine(yard, PhysicsOptions()))
        silent, asking = caster(
            ray((0, 0, 0.5), (1, 0, 0)), ray((0, 0, 0.5), (1, 0, 0), normals=True)
        )
        assert silent.normals is None
        assert asking.normals is not None
        np.testing.assert_allclose(asking.normals, [[-1.0, 0.0, 0.0]], atol=1e-9)

    @pytest.mark.parametrize("seed", range(3))
    def test_normals_are_unit_and_face_the_origin(self, seed: int) -> None:
        """Normals have length one where something was hit, face the ray, and are MuJoCo's."""
        engine = Engine(lambda: random_scene(seed, copies=4), PhysicsOptions())
        caster = Caster(engine)
        reference = Reference(engine.world)
        reference.show(engine.snapshot(), None)
        fans = outside_height_fields(engine, random_fans(np.random.default_rng(seed + 50)))
        compared = 0
        for fan, hit in zip(fans, caster(*fans), strict=True):
            assert hit.normals is not None
            found = np.isfinite(hit.distances)
            lengths = np.linalg.norm(hit.normals, axis=1)
            np.testing.assert_allclose(lengths[found], 1.0, atol=1e-6)
            assert not lengths[~found].any()
            facing = np.einsum("ij,ij->i", hit.normals, fan.directions)
            assert (facing[found] <= 1e-9).all()
            truth, normals, _ = reference.cast(fan.origin, fan.directions)
            same = found & agree(hit.distances, truth)
            cosine = np.abs(np.einsum("ij,ij->i", hit.normals, normals))
            compared += int(same.sum())
            # Facets of round shapes lean a little; 8 degrees is one facet of the coarsest.
            assert (cosine[same] > np.cos(np.radians(16.0))).all()
        assert compared > 40

    def test_normals_of_moving_things(self) -> None:
        """The normal of a robot's flat side faces who looks at it, from either side."""
        caster = Caster(engine_with((0.0, 0.0), (2.0, 0.0)))
        ahead, back = caster(
            ray((0.3, 0, 0.15), (1, 0, 0), normals=True),
            ray((4.0, 0, 0.15), (-1, 0, 0), normals=True),
            robot=0,
        )
        assert ahead.normals is not None
        assert back.normals is not None
        np.testing.assert_allclose(ahead.normals, [[-1.0, 0.0, 0.0]], atol=1e-6)
        np.testing.assert_allclose(back.normals, [[1.0, 0.0, 0.0]], atol=1e-6)

    def test_many_start_points(self) -> None:
        """A fan may have a start point for every ray; each is answered from its own."""
        caster = Caster(engine_with((0.0, 0.0), (2.0, 0.0), scenery=yard))
        dice = np.random.default_rng(5)
        origins = dice.uniform((-0.5, -1.0, 0.4), (0.5, 1.0, 0.6), (30, 3))
        origins[:15, 2] = 0.15
        directions = np.tile([1.0, 0.0, 0.0], (30, 1))
        (together,) = caster(RayFan(origins, directions, 20.0, normals=True), robot=0)
        single = caster(
            *[RayFan(o, d[None], 20.0) for o, d in zip(origins, directions, strict=True)], robot=0
        )
        np.testing.assert_allclose(
            together.distances, [hit.distances[0] for hit in single], atol=1e-5
        )
        assert len(set(np.round(together.distances, 3))) > 5

    @pytest.mark.parametrize("seed", range(3))
    def test_many_start_points_at_robots(self, seed: int) -> None:
        """Each of many parallel rays meets the robot that MuJoCo's single ray meets, or nothing."""
        engine = engine_with((0.0, 0.0), (1.5, 0.2, RADIUS, 0.5), (2.0, -0.8))
        caster, snapshot = Caster(engine), engine.snapshot()
        dice = np.random.default_rng(seed)
        origins = dice.uniform((-1.0, -1.2, 0.02), (-0.5, 0.6, 0.3), (300, 3))
        directions = np.tile([1.0, 0.0, 0.0], (300, 1))
        fan = RayFan(origins, directions, 2.4, normals=True, identify=True)
        (hit,) = caster.at(snapshot, fan, robot=0)
        reference = Reference(engine.world)
        reference.show(snapshot, 0)
        assert hit.normals is not None
        assert hit.names is not None
        met = np.zeros(1, dtype=np.int32)
        for row, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
            normal = np.zeros(3)
            far = mujoco.mj_ray(
                reference.model, reference.data, origin, direction, None, 1, -1, met, normal
            )
            if met[0] < 0 or far > fan.max_range:
                assert np.isinf(hit.distances[row])
                assert hit.names[row] is None
                assert not hit.normals[row].any()
            else:
                assert hit.distances[row] == pytest.approx(far, abs=1e-3)
                assert hit.normals[row] @ normal > 0.99, "a facet leans a little"
                assert hit.names[row] == caster.dynamic.objects.names[met[0]]
        assert 30 < np.isfinite(hit.distances).sum() < 270


class TestBatches:
    """Many viewers at once."""

    def test_are_answered_as_if_each_had_asked_alone(self) -> None:
        """Robots with fans of all sizes and kinds get in one batch what they get one by one."""
        engine = engine_with(*[(1.5 * k, 0.3 * k) for k in range(5)], scenery=yard)
        static, dynamic = StaticGeometry(engine.world), DynamicGeometry(engine.world)
        snapshot, dice = engine.snapshot(), np.random.default_rng(3)
        empty = RayFan(np.zeros(3), np.zeros((0, 3)), 1.0)
        queries = [PendingReport(snapshot, 1), PendingReport(snapshot, 2, [empty])]
        for robot in (0, 1, 2, 3, 4, None, 99):
            x, y, z = snapshot.xpos[engine.world.layouts[(robot or 0) % 5].base]
            angles = np.linspace(-1.5, 1.5, 181)
            scan = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
            fans = [RayFan(np.array([x, y, z]), scan, 20.0), *narrow_fans(dice)]
            fans.append(RayFan(np.array([x, y, z]), scan[80:90], 5.0, normals=True, identify=True))
            queries.append(PendingReport(snapshot, robot, fans))
        together = cast_all(queries, static, dynamic)
        for query, answers in zip(queries, together, strict=True):
            alone = cast(query.fans, snapshot, query.robot, static, dynamic)
            for fan, one, other in zip(query.fans, answers, alone, strict=True):
                np.testing.assert_array_equal(one.distances, other.distances)
                assert one.names == other.names
                assert (one.normals is None) is not fan.normals
                if one.normals is not None and other.normals is not None:
                    np.testing.assert_array_equal(one.normals, other.normals)


class TestMoving:
    """Robots, crates and doors."""

    def crowd(self) -> Engine:
        """Five robots in a yard, one of them on its side, and two parked ones."""
        engine = engine_with(
            (0.0, 0.0), (1.2, 0.3), (-1.0, 0.5), (0.2, -1.0), (0.3, 1.4), scenery=yard, spare=2
        )
        start = engine.world.layouts[4].qpos
        engine.data.qpos[start + 3 : start + 7] = (0.7071, 0.7071, 0.0, 0.0)
        engine.data.qpos[start + 2] = 0.3
        for robot in range(4):
            engine.drive(robot, straight(2.0 - robot))
        run(engine, 0.3)
        return engine

    @pytest.mark.parametrize("robot", [None, 0, 3])
    def test_distances_are_those_of_mujoco(self, robot: int | None) -> None:
        """Among robots and crates distances are exact, whoever looks; the own body is not hit."""
        engine = self.crowd()
        dice = np.random.default_rng(7)
        fans = []
        for _ in range(20):
            directions = dice.normal(size=(50, 3)) * [1.0, 1.0, 0.15]
            directions /= np.linalg.norm(directions, axis=1)[:, None]
            fans.append(RayFan(dice.uniform((-2, -2, 0.05), (2, 2, 0.4)), directions, 8.0))
        assert check_against_reference(Caster(engine), fans, robot, tolerance=1e-4) > 300

    def test_own_body_is_never_hit(self) -> None:
        """From inside its own chassis a robot sees the world, others see the chassis."""
        engine = engine_with((0.0, 0.0), scenery=yard)
        caster = Caster(engine)
        fan = ray((0, 0, 0.15), (1, 0, 0))
        (own,) = caster(fan, robot=0)
        (other,) = caster(fan)
        assert own.distances[0] == pytest.approx(2.9, abs=1e-5)
        assert other.distances[0] == pytest.approx(0.2, abs=1e-5)
        (again,) = caster(fan, robot=0)
        assert again.distances[0] == own.distances[0]

    def test_own_wheels_are_never_hit(self) -> None:
        """Robots checklist 73: a ring of rays around a robot meets none of its parts."""
        caster = Caster(engine_with((0.0, 0.0)))
        angles = np.linspace(0.0, 2 * np.pi, 720)
        ring = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
        (hit,) = caster(RayFan(np.array([0.0, 0.0, 0.11]), ring, 20.0), robot=0)
        assert np.isinf(hit.distances).all()

    def test_parked_robots_are_never_hit(self) -> None:
        """Rays that look at the parking place see nothing there, before and after use."""
        engine = engine_with((0.0, 0.0), spare=1)
        caster = Caster(engine)
        place = engine.world.parking[1, :3]
        fan = ray((place[0] - 2.0, place[1], place[2] + 0.04), (1, 0, 0))
        (before,) = caster(fan)
        assert np.isinf(before.distances[0])
        engine.occupy(1, 1, pose_at(2.0, 0.0))
        (seen,) = caster(ray((0.5, 0, 0.15), (1, 0, 0)), robot=0)
        assert seen.distances[0] == pytest.approx(1.3, abs=1e-3)
        engine.vacate(1)
        (after,) = caster(fan)
        (gone,) = caster(ray((0.5, 0, 0.15), (1, 0, 0)), robot=0)
        assert np.isinf(after.distances[0])
        assert np.isinf(gone.distances[0])

    def test_parked_robots_are_not_hit_by_those_beside_them(self) -> None:
        """A robot that hovers beside a parked one sees through it."""
        engine = engine_with((0.0, 0.0), (0.0, 0.0), spare=1)
        place = engine.world.parking[2, :3]
        for robot, ahead in ((0, 2.0), (1, -1.0)):
            engine.teleport(robot, pose_at(place[0] - ahead, place[1], place[2]))
        fan = ray((place[0] - 1.7, place[1], place[2] + 0.04), (1, 0, 0))
        (hit,) = Caster(engine)(fan, robot=0)
        assert hit.distances[0] == pytest.approx(2.5, abs=1e-3)

    def test_wheels_are_seen_where_they_are(self) -> None:
        """Other robots are hit with their exact shapes: a gap between wheels is a gap."""
        caster = Caster(engine_with((0.0, 0.0), (0.0, 2.0)))
        low = 0.05  # under the chassis, over the floor
        through, wheel = caster(
            ray((-1.0, 2.0, low), (1, 0, 0)), ray((-1.0, 2.197, RADIUS), (1, 0, 0)), robot=0
        )
        assert np.isinf(through.distances[0])
        assert wheel.distances[0] == pytest.approx(1.0 - 0.1331 - 0.11, abs=1e-3)

    def test_crates_and_doors_are_seen_where_they_are(self) -> None:
        """A crate that was pushed and a door that was opened are hit at their new places."""
        engine = Engine(yard, PhysicsOptions())
        caster = Caster(engine)
        crate = engine.world.model.joint(engine.world.model.body("crate0").jntadr[0])
        engine.data.qpos[crate.qposadr[0] + 1] = -2.0
        engine.data.joint("hinge").qpos[0] = np.pi / 2
        box, leaf = caster(ray((0, 0, 0.1), (0, -1, 0)), ray((-3.4, 1.0, 0.6), (0, -1, 0)))
        assert box.distances[0] == pytest.approx(1.85, abs=1e-5)
        assert leaf.distances[0] == pytest.approx(0.98, abs=1e-5)

    def test_invisible_parts_stay_invisible(self) -> None:
        """A part without colour is not hit, also after its robot looked around itself."""

        def build() -> mujoco.MjSpec:
            spec = robot_model().build()
            spec.add_material(name="air", rgba=[1, 1, 1, 0])
            base = spec.body("base")
            base.add_geom(type=Geom.mjGEOM_BOX, size=[0.5, 0.5, 0.5], rgba=[1, 1, 1, 0])
            base.add_geom(type=Geom.mjGEOM_BOX, size=[0.5, 0.5, 0.5], material="air")
            for geom in base.geoms[-2:]:
                geom.contype = geom.conaffinity = 0
                geom.mass = 0.0
            return spec

        engine = engine_with((0.0, 0.0), (3.0, 0.0), model=replace(ROBOT, build=build))
        caster, snapshot = Caster(engine), engine.snapshot()
        caster.at(snapshot, ray((3, 0, 1), (1, 0, 0)), robot=1)
        (hit,) = caster.at(snapshot, ray((1, 0, 0.15), (1, 0, 0)), robot=0)
        assert hit.distances[0] == pytest.approx(1.8, abs=1e-5)

    def test_a_snapshot_is_what_counts(self) -> None:
        """Rays look into the snapshot that they are given, old or new."""
        engine = engine_with((0.0, 0.0), (2.0, 0.0))
        caster = Caster(engine)
        old = engine.snapshot()
        engine.teleport(1, pose_at(4.0, 0.0))
        new = engine.snapshot()
        fan = ray((0.3, 0, 0.15), (1, 0, 0))
        seen = [
            float(caster.at(snapshot, fan, robot=0)[0].distances[0]) for snapshot in (old, new, old)
        ]
        np.testing.assert_allclose(seen, (1.5, 3.5, 1.5), atol=1e-6)


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


class TestCulling:
    """Rays that cannot reach anything that moves are not cast; no hit may get lost by that."""

    @pytest.mark.parametrize("seed", range(4))
    def test_never_drops_a_hit(self, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
        """Without culling of fans and rays answers are the same, for random poses and joints."""
        dice = np.random.default_rng(seed)
        model = replace(ROBOT, build=arm_robot)
        engine = engine_with(*[(2.0 * k, 0.0) for k in range(6)], model=model, scenery=yard)
        caster = Caster(engine)
        hits = 0
        for _ in range(12):
            for layout in engine.snapshot().layouts.values():
                attitude = dice.normal(size=4)
                pose = [*dice.uniform(-4, 4, 2), dice.uniform(0.1, 2), *attitude]
                engine.data.qpos[layout.qpos : layout.qpos + 7] = pose
                engine.data.qpos[layout.joint_qpos["shoulder"]] = dice.uniform(-3, 3)
                engine.data.qpos[layout.joint_qpos["elbow"]] = dice.uniform(-3, 3)
                engine.data.qpos[layout.joint_qpos["lift"]] = dice.uniform(0, 0.8)
            snapshot = engine.snapshot()
            tips = [snapshot.xpos[lay.links["lift"]] for lay in snapshot.layouts.values()]
            fans = [*narrow_fans(dice), *[aimed_fan(dice, tip) for tip in tips * 4]]
            own = int(dice.integers(0, 6))
            with_culling = caster.at(snapshot, *fans, robot=own)
            with monkeypatch.context() as patch:
                patch.setattr(moving_geometry, "meetings", every_pair)
                patch.setattr(moving_geometry, "passing", every_ray)
                without = caster.at(snapshot, *fans, robot=own)
            for one, other in zip(with_culling, without, strict=True):
                np.testing.assert_array_equal(one.distances, other.distances)
            hits += sum(int(np.isfinite(hit.distances).sum()) for hit in with_culling)
        assert hits > 200

    def test_is_done(self) -> None:
        """A fan that looks away from all robots costs no moving ray at all."""
        engine = engine_with((0.0, 0.0), (2.0, 0.0))
        snapshot, dynamic = engine.snapshot(), DynamicGeometry(engine.world)
        reach = np.full(1, 20.0)
        ahead = join([ray((0.3, 0, 0.15), (1, 0, 0))])
        assert dynamic.cast(ahead, snapshot, [0], reach) is not None
        behind = join([ray((0.3, 0, 0.15), (-1, 0, 0))])
        assert dynamic.cast(behind, snapshot, [0], reach) is None
        assert dynamic.cast(ahead, snapshot, [0], np.full(1, 1.2)) is None, "a wall is nearer"


def every_pair(
    batch: RayBatch, reach: Array, spheres: Spheres, own: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Culls nothing but what a viewer may not see."""
    rays, trees = np.indices((len(batch.directions), len(spheres.radii))).reshape(2, -1)
    seen = own[batch.fan[rays]] != trees
    return rays[seen], trees[seen]


def every_ray(origins: Array, *others: Array) -> NDArray[np.bool_]:
    """Culls nothing."""
    return np.ones(len(origins), dtype=bool)


def aimed_fan(dice: np.random.Generator, target: Array) -> RayFan:
    """A narrow fan towards a point, from anywhere."""
    origin = target + dice.normal(size=3)
    directions = target - origin + 0.02 * dice.normal(size=(5, 3))
    return RayFan(origin, directions / np.linalg.norm(directions, axis=1)[:, None], 20.0)


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


class TestThreads:
    """Several threads look around while the physics runs."""

    def test_casting_while_driving(self) -> None:
        """Rays of many threads agree with those cast alone, though the physics goes on."""
        world = simulation(yard, speed=2.0)
        robots = []
        for number in range(4):
            robot, _ = world.spawn(ROBOT, pose_at(0.0, 1.0 * number))
            world.body(robot).drive(straight(1.0))
            robots.append(robot)
        world.start()
        answers: list[tuple[int, Snapshot, list[RayFan], list[RayHits]]] = []
        failures: list[BaseException] = []

        def look(robot: int) -> None:
            dice = np.random.default_rng(robot)
            try:
                for _ in range(25):
                    fans, snapshot = narrow_fans(dice), world.look()
                    answers.append((robot, snapshot, fans, world.cast(fans, snapshot, robot)))
            except BaseException as error:
                failures.append(error)

        threads = [threading.Thread(target=look, args=(robot,)) for robot in robots]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        world.stop()
        assert not failures
        assert len(answers) == 100
        for robot, snapshot, fans, hits in answers[::5]:
            for one, other in zip(hits, world.cast(fans, snapshot, robot), strict=True):
                np.testing.assert_array_equal(one.distances, other.distances)

    def test_casting_while_growing(self) -> None:
        """A thread that looks around is not disturbed by robots of new classes coming in."""
        world = simulation(yard, speed=2.0)
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        world.start()
        stop = threading.Event()
        failures: list[BaseException] = []
        seen: list[float] = []

        def look() -> None:
            try:
                while not stop.is_set():
                    (hit,) = world.cast([ray((0, 0, 0.15), (1, 0, 0))], world.look(), robot)
                    seen.append(float(hit.distances[0]))
            except BaseException as error:
                failures.append(error)

        thread = threading.Thread(target=look)
        thread.start()
        for number in range(5):
            world.spawn(robot_model(f"class {number}"), pose_at(-2.0, 1.0 * number))
        stop.set()
        thread.join()
        world.stop()
        assert not failures
        assert seen
        np.testing.assert_allclose(seen, 2.9, atol=1e-4)


def crowd_of_shapes(seed: int) -> Scenery:
    """Loose bodies of every kind of shape that may move."""

    def build() -> mujoco.MjSpec:
        dice = np.random.default_rng(seed)
        spec = mujoco.MjSpec()
        add_meshes(spec)
        for number, shape in enumerate(
            ("box", "sphere", "ellipsoid", "capsule", "cylinder", "mesh") * 2
        ):
            body = spec.worldbody.add_body(name=f"loose{number}", pos=dice.uniform(-3, 3, 3))
            body.add_freejoint()
            geom = add_shape(spec, body, f"shape{number}", shape, dice, spread=0.2)
            geom.pos = dice.uniform(-0.3, 0.3, 3)
            geom.mass = 1.0
            if shape == "mesh":
                spec.mesh("tray").inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        return spec

    return build


@pytest.mark.parametrize("seed", range(3))
def test_loose_shapes_of_every_kind(seed: int) -> None:
    """Whatever a movable object is made of, it is hit exactly."""
    engine = Engine(crowd_of_shapes(seed), PhysicsOptions())
    dice = np.random.default_rng(seed)
    fans = []
    for _ in range(15):
        directions = dice.normal(size=(40, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        fans.append(RayFan(dice.uniform(-4, 4, 3), directions, 15.0))
    assert check_against_reference(Caster(engine), fans) > 30


def test_snapshot_of_a_robot_shows_where_its_rays_start() -> None:
    """A ray from a robot's own pose reads the distance from its reference point."""
    engine = engine_with((0.5, 0.0), scenery=yard)
    run(engine, 0.2)
    place = base_qpos(engine, 0)[:3]
    (hit,) = Caster(engine)(ray(tuple(place), (1, 0, 0)), robot=0)
    assert hit.distances[0] == pytest.approx(2.9 - place[0], abs=1e-5)


SHIPPED = [sheet.parent for sheet in sorted(Path(__file__).parents[2].glob("worlds/*/world.toml"))]


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_shipped_worlds(folder: Path) -> None:
    """In every shipped world rays from above the start poses agree with MuJoCo's within 1 mm."""
    world = load_world(folder)
    engine = Engine(lambda: build_scene(world), PhysicsOptions(), [ROBOT] * 3)
    dice = np.random.default_rng(1)
    fans = []
    for robot, start in enumerate(world.starts[:8]):
        if robot < 3:
            engine.occupy(robot, robot, start.pose)
        directions = dice.normal(size=(60, 3)) * [1.0, 1.0, 0.3]
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        fans.append(RayFan(np.add(start.pose.position, (0, 0, 0.3)), directions, 25.0))
    assert check_against_reference(Caster(engine), fans, robot=0) > 200
