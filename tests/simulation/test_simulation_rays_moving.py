"""Rays against robots and loose things: what is hit, what is left out, and who looks meanwhile."""

from __future__ import annotations

import threading
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from ray_scenes import (
    Caster,
    add_meshes,
    add_shape,
    arm_robot,
    check_against_reference,
    narrow_fans,
    ray,
)
from sim_fakes import (
    RADIUS,
    ROBOT,
    Geom,
    Scenery,
    engine_with,
    in_parallel,
    populated,
    pose_at,
    robot_model,
    run,
    simulation,
    straight,
    yard,
)

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.rays import cast as casting
from usarsim_server.simulation.rays import moving as moving_geometry
from usarsim_server.simulation.rays.culling import Spheres
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.query import RayBatch, RayFan, RayHits, join
from usarsim_server.simulation.snapshot import Snapshot

Array = NDArray[np.float64]


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
        """Robots 73: a ring of rays around a robot meets none of its parts."""
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


class TestCulling:
    """Rays that cannot reach anything that moves are not cast; no hit may get lost by that."""

    @pytest.mark.parametrize("seed", range(4))
    def test_never_drops_a_hit(self, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
        """Without culling of fans and rays answers are the same, for random poses and joints, and
        also by compiled code."""
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
            at_once = caster.at(snapshot, *fans, robot=own)
            with monkeypatch.context() as patch:
                patch.setattr(casting, "ray_code", lambda: None)
                snapshot = engine.snapshot()
                with_culling = caster.at(snapshot, *fans, robot=own)
                patch.setattr(moving_geometry, "meetings", every_pair)
                patch.setattr(moving_geometry, "passing", every_ray)
                without = caster.at(snapshot, *fans, robot=own)
            for one, two, three in zip(at_once, with_culling, without, strict=True):
                np.testing.assert_array_equal(one.distances, two.distances)
                np.testing.assert_array_equal(two.distances, three.distances)
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

        in_parallel(look, *robots)
        world.stop()
        assert not failures
        assert len(answers) == 100
        for robot, snapshot, fans, hits in answers[::5]:
            for one, other in zip(hits, world.cast(fans, snapshot, robot), strict=True):
                np.testing.assert_array_equal(one.distances, other.distances)

    def test_casting_while_growing(self) -> None:
        """A thread that looks around is not disturbed by robots of new classes coming in."""
        world, robot = populated(yard, speed=2.0)
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
