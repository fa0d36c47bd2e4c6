"""What rays say they hit, and what is known about it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
from ray_scenes import Caster, Reference, agree, random_fans, random_scene, ray
from sim_fakes import (
    RADIUS,
    ROBOT,
    Geom,
    box,
    crate,
    engine_with,
    floor,
    furnished,
    pose_at,
    run,
    simulation,
    straight,
    yard,
)

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.objects import ObjectFacts, Objects
from usarsim_server.simulation.rays.query import RayFan, RayHits


def look(
    engine: Engine, fans: list[RayFan], robot: int | None = None, identify: bool = True
) -> list[RayHits]:
    """Cast fans at the present state."""
    return Caster(engine)(*(replace(fan, identify=identify) for fan in fans), robot=robot)


def hit(engine: Engine, *ray_of: tuple[float, ...], robot: int | None = None) -> str | None:
    """Name of what one ray hits."""
    (answer,) = look(engine, [ray(*ray_of)], robot)
    assert answer.names is not None
    return answer.names[0]


def facts(engine: Engine, name: str) -> ObjectFacts:
    """Facts at the present state, which must be there."""
    found = Objects(engine.world).facts(name, engine.snapshot())
    assert found is not None
    return found


def unknown(engine: Engine, name: str) -> bool:
    """Whether there are no facts at the present state."""
    return Objects(engine.world).facts(name, engine.snapshot()) is None


class TestIdentity:
    """Names against the geoms that MuJoCo's own rays find."""

    @pytest.mark.parametrize("seed", range(4))
    def test_fixed_geometry_of_every_kind(self, seed: int) -> None:
        """Wherever the distances agree so do the geoms; elsewhere there is an edge."""
        engine = Engine(lambda: random_scene(seed), PhysicsOptions())
        reference = Reference(engine.world)
        fans = random_fans(np.random.default_rng(seed), count=12)
        seen: set[str | None] = set()
        same = total = 0
        for fan, answer in zip(fans, look(engine, fans), strict=True):
            truth, _, geoms = reference.cast(fan.origin, fan.directions)
            names = [reference.model.geom(g).name if g >= 0 else None for g in geoms]
            assert answer.names is not None
            seen |= set(answer.names)
            for mine, theirs, near, far in zip(
                answer.names, names, answer.distances, truth, strict=True
            ):
                if far > fan.max_range:
                    continue
                total += 1
                same += mine == theirs
                assert mine == theirs or abs(near - far) > 1e-3 or math.isinf(near)
        assert same > 0.98 * total
        assert {"floor", "hfield0", "mesh0"} & seen
        assert len(seen) > 12

    def test_moving_geometry(self) -> None:
        """Crates, a door and other robots while everything moves, as MuJoCo names the geoms."""
        engine = engine_with((0.0, 0.0), (1.5, 0.3), (0.0, -1.2), scenery=yard)
        for robot in range(3):
            engine.drive(robot, straight(4.0))
        run(engine, 0.5)
        reference = Reference(engine.world)
        snapshot = engine.snapshot()
        reference.show(snapshot, 0)
        angles = np.linspace(-math.pi, math.pi, 721)
        directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(721)], axis=1)
        fan = RayFan(snapshot.xpos[snapshot.layouts[0].base] + [0, 0, 0.03], directions, 20.0)
        truth, _, geoms = reference.cast(fan.origin, directions)
        (answer,) = look(engine, [fan], robot=0)
        model = reference.model
        names = [
            model.geom(g).name or model.body(model.geom_bodyid[g]).name if g >= 0 else None
            for g in geoms
        ]
        same = agree(answer.distances, truth)
        assert same.mean() > 0.98
        assert answer.names is not None
        assert all(answer.names[i] == names[i] for i in np.flatnonzero(same))
        assert {"robot1:front_right", "wall", "crate1"} <= set(answer.names)
        assert not any(name.startswith("robot0") for name in answer.names if name)

    def test_a_geom_without_a_name_is_named_by_its_body(self) -> None:
        """Crates of the yard have one nameless geom each."""
        engine = Engine(yard, PhysicsOptions())
        assert hit(engine, (0.0, -3.0, 3.0), (0.0, 0.0, -1.0)) == "crate0"

    def test_what_has_no_name_at_all_is_none(self) -> None:
        """A nameless geom of the world is hit, but nobody knows what it is."""
        scene = furnished(box("", (2.0, 0.0, 0.0), (0.1, 1.0, 1.0)))
        engine = Engine(scene, PhysicsOptions())
        (answer,) = look(engine, [ray((0.0, 0.0, 0.5), (1.0, 0.0, 0.0))])
        assert answer.distances[0] == pytest.approx(1.9)
        assert answer.names == (None,)

    def test_a_miss_has_no_name(self) -> None:
        """Neither towards the sky nor beyond the maximum range."""
        engine = Engine(yard, PhysicsOptions())
        sky = ray((0.0, 0.0, 0.5), (0.0, 0.0, 1.0))
        short = RayFan(np.array([0.0, 0.0, 0.5]), np.array([[1.0, 0.0, 0.0]]), 2.0)
        for answer in look(engine, [sky, short]):
            assert answer.distances[0] == np.inf
            assert answer.names == (None,)

    def test_names_are_given_only_to_those_who_ask(self) -> None:
        """Fans of one batch are answered each as it asked, with equal distances."""
        engine = engine_with((0.0, 0.0), (1.5, 0.0), scenery=yard)
        ways = np.array([[1.0, 0.0, 0.0], [0.0, 0.3, -1.0], [0.0, 0.0, 1.0]])
        start = np.array([0.0, 0.0, 0.15])
        fans = [RayFan(start, ways, 20.0, identify=wanted) for wanted in (False, True, False)]
        answers = Caster(engine)(*fans, robot=0)
        assert [answer.names is None for answer in answers] == [True, False, True]
        assert answers[1].names == ("robot1:chassis", "floor", None)
        assert np.array_equal(answers[0].distances, answers[1].distances)

    def test_through_glass_the_thing_behind_is_named(self) -> None:
        """And without that option the pane."""
        build = furnished(
            box("glass_pane", (1.0, 0.0, 1.0), (0.01, 1.0, 1.0)),
            box("wall", (3.0, 0.0, 1.0), (0.1, 1.0, 1.0)),
        )
        engine = Engine(build, PhysicsOptions())
        ahead = (0.0, 0.0, 0.5), (1.0, 0.0, 0.0)
        assert hit(engine, *ahead) == "glass_pane"
        (answer,) = look(engine, [ray(*ahead, through_glass=True)])
        assert answer.names == ("wall",)


class TestStartPoints:
    """Fans whose rays start at a point each."""

    @pytest.mark.parametrize("seed", range(3))
    def test_they_are_answered_as_single_rays_are(self, seed: int) -> None:
        """Fixed and moving geometry, distances, normals and names."""
        engine = engine_with((0.0, 0.0), (1.2, 0.2), (-0.9, -0.8), scenery=yard)
        dice = np.random.default_rng(seed)
        count = 60
        points = dice.uniform([-1.5, -1.5, 0.02], [1.5, 1.5, 0.6], (count, 3))
        robots = np.array([[0.0, 0.0, 0.15], [1.2, 0.2, 0.15]])
        ways = robots[dice.integers(0, 2, count)] - points + 0.2 * dice.normal(size=(count, 3))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        together = RayFan(points, ways, 5.0, normals=True)
        alone = [
            RayFan(point, way[None], 5.0, normals=True)
            for point, way in zip(points, ways, strict=True)
        ]
        whole, *parts = look(engine, [together, *alone], robot=2)
        assert whole.names is not None
        assert whole.normals is not None
        assert np.array_equal(whole.distances, [part.distances[0] for part in parts])
        assert whole.names == tuple(part.names[0] for part in parts if part.names)
        assert np.array_equal(whole.normals, [part.normals[0] for part in parts])
        assert sum(name is not None and name.startswith("robot") for name in whole.names) > 10

    def test_a_wide_row_of_parallel_rays_reaches_what_only_its_edge_sees(self) -> None:
        """A crate in front of the last of many rays is not overlooked."""
        build = furnished(crate("crate", (2.0, 4.0, 0.15)))
        engine = Engine(build, PhysicsOptions())
        points = np.column_stack((np.zeros(41), np.linspace(-4, 4, 41), np.full(41, 0.1)))
        fan = RayFan(points, np.repeat([[1.0, 0.0, 0.0]], 41, axis=0), 3.0)
        (answer,) = look(engine, [fan])
        assert answer.names is not None
        assert answer.names[-1] == "crate"
        assert answer.names[:-1] == (None,) * 40


class TestFacts:
    """What object a name belongs to."""

    def test_a_piece_of_scenery_is_an_object_of_its_own(self) -> None:
        """Pose and extents of the geom."""
        found = facts(Engine(yard, PhysicsOptions()), "wall")
        assert found == ObjectFacts("wall", Pose((3.0, 0.0, 0.5)), None, (0.2, 8.0, 1.0))

    def test_an_endless_plane_has_no_size(self) -> None:
        """Infinite extents, no thickness."""
        found = facts(Engine(yard, PhysicsOptions()), "floor")
        assert found.size == (math.inf, math.inf, 0.0)

    def test_a_crate_that_was_pushed_is_where_it_is_now(self) -> None:
        """The pose is that of the snapshot; old snapshots keep theirs."""
        engine = engine_with((-1.0, -3.0), scenery=yard)
        engine.drive(0, straight(8.0))
        before = engine.snapshot()
        run(engine, 3.0)
        objects = Objects(engine.world)
        early, late = objects.facts("crate0", before), objects.facts("crate0", engine.snapshot())
        assert early is not None
        assert late is not None
        assert early.pose.position == pytest.approx((0.0, -3.0, 0.15), abs=1e-3)
        assert late.pose.position[0] > 0.2
        assert early.size == pytest.approx((0.3, 0.3, 0.3))
        assert early.robot is None

    def test_the_geoms_of_a_body_are_one_object(self) -> None:
        """A fixed table: any of its geoms leads to the table, each with its own material."""

        def build() -> mujoco.MjSpec:
            spec = floor()()
            spec.add_material(name="oak")
            table = spec.worldbody.add_body(name="table", pos=(2.0, 1.0, 0.0))
            add = partial(table.add_geom, type=Geom.mjGEOM_BOX)
            add(name="table:top", size=[0.6, 0.4, 0.02], pos=[0.0, 0.0, 0.7], material="oak")
            for number, (x, y) in enumerate([(-0.5, -0.3), (0.5, 0.3)]):
                add(name=f"table:leg{number}", size=[0.02, 0.02, 0.34], pos=[x, y, 0.34])
            return spec

        engine = Engine(build, PhysicsOptions())
        top, leg = facts(engine, "table:top"), facts(engine, "table:leg1")
        assert (top.name, leg.name) == ("table", "table")
        assert (top.material, leg.material) == ("oak", None)
        assert top.pose == leg.pose == Pose((2.0, 1.0, 0.0))
        assert top.size == leg.size == pytest.approx((1.2, 0.8, 0.72))
        assert facts(engine, "table") == top

    def test_a_leaf_of_a_door_is_not_its_frame(self) -> None:
        """Moving parts of fixed things are objects: what is rigid is one thing."""

        def build() -> mujoco.MjSpec:
            spec = floor()()
            frame = spec.worldbody.add_body(name="frame", pos=(0.0, 2.0, 0.0))
            frame.add_geom(name="post", type=Geom.mjGEOM_BOX, size=[0.1, 0.1, 1.0])
            leaf = frame.add_body(name="leaf", pos=(0.1, 0.0, 1.0))
            leaf.add_joint(name="hinge", axis=[0.0, 0.0, 1.0])
            leaf.add_geom(
                name="board", type=Geom.mjGEOM_BOX, size=[0.4, 0.02, 1.0], pos=[0.4, 0, 0]
            )
            handle = leaf.add_body(name="handle", pos=(0.7, 0.0, 0.0))
            handle.add_geom(name="grip", type=Geom.mjGEOM_BOX, size=[0.05, 0.05, 0.02])
            return spec

        engine = Engine(build, PhysicsOptions())
        names = [facts(engine, name) for name in ("post", "board", "grip")]
        assert [found.name for found in names] == ["frame", "leaf", "leaf"]

    def test_a_robot_is_one_object_with_its_number(self) -> None:
        """Any of its geoms leads to the reference point, whatever slot it is in."""
        engine = engine_with((0.0, 0.0), (2.0, 1.0, RADIUS, 0.5), spare=1)
        for name in ("robot1:chassis", "robot1:front_left", "robot1:base"):
            found = facts(engine, name)
            assert (found.name, found.robot) == ("robot1", 1)
            assert found.pose.position == pytest.approx((2.0, 1.0, RADIUS))
            assert found.size == pytest.approx((0.4862, 0.474, 0.22), abs=1e-3)

    def test_a_parked_robot_is_not_in_the_world(self) -> None:
        """Free slots have bodies but no facts."""
        engine = engine_with((0.0, 0.0), spare=1)
        assert unknown(engine, "robot1:chassis")

    def test_unknown_names_have_no_facts(self) -> None:
        """Neither has the world itself."""
        engine = Engine(yard, PhysicsOptions())
        for name in ("nothing", "", "world"):
            assert unknown(engine, name)

    def test_a_mesh_is_where_the_scene_put_it(self) -> None:
        """Not at its mass centre, to which the compiler moves the frame of its geom."""

        def build() -> mujoco.MjSpec:
            spec = floor()()
            corners = [[x, y, z] for x in (0, 2) for y in (0, 1) for z in (0, 0.5)]
            spec.add_mesh(name="brick", uservert=np.array(corners, dtype=float).ravel())
            quat = [math.cos(0.4), 0.0, 0.0, math.sin(0.4)]
            geom = spec.worldbody.add_geom(
                name="stone", type=Geom.mjGEOM_MESH, pos=[5.0, 6.0, 0.0], quat=quat
            )
            geom.meshname = "brick"
            return spec

        found = facts(Engine(build, PhysicsOptions()), "stone")
        assert found.pose.position == pytest.approx((5.0, 6.0, 0.0), abs=1e-6)
        assert found.pose.quaternion == pytest.approx(
            (math.cos(0.4), 0, 0, math.sin(0.4)), abs=1e-6
        )
        assert found.size == pytest.approx((2.0, 1.0, 0.5), abs=1e-6)

    def test_a_hundred_look_ups_are_cheap(self) -> None:
        """Names are indexed once, sizes measured once: the same value comes back."""
        engine = engine_with((0.0, 0.0))
        objects, snapshot = Objects(engine.world), engine.snapshot()
        first = objects.facts("robot0:base", snapshot)
        assert all(objects.facts("robot0:base", snapshot) == first for _ in range(100))
        assert objects.names is objects.names


class TestFacade:
    """The same through the simulation."""

    def test_facts_of_what_a_robot_sees_while_the_world_grows(self) -> None:
        """Names keep their meaning when the model is compiled anew for more robots."""
        world = simulation(yard)
        first, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        for number in range(4):
            world.spawn(ROBOT, pose_at(1.2, 1.5 * number))
            snapshot = world.look()
            ahead = RayFan(
                np.array([0.0, 0.0, 0.15]), np.array([[1.0, 0.0, 0.0]]), 9.0, identify=True
            )
            (answer,) = world.cast([ahead], snapshot, first)
            assert answer.names is not None
            name = answer.names[0]
            assert name is not None
            found = world.object_facts(name, snapshot)
            assert found is not None
            assert found.robot == 1
            assert found.pose.position[:2] == pytest.approx((1.2, 0.0), abs=1e-3)
        wall = world.object_facts("wall", world.look())
        assert wall is not None
        assert wall.pose.position == (3.0, 0.0, 0.5)
