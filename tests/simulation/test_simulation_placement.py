"""Where new robots may stand, and what physics makes of it."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from sim_fakes import (
    RADIUS,
    ROBOT,
    Geom,
    Scenery,
    add_box,
    base_qpos,
    base_qvel,
    box,
    build_robot,
    crate,
    drive,
    engine_with,
    floor,
    furnished,
    pose_at,
    run,
    straight,
    yard,
)

from usarsim_server.base.errors import SpawnError
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.model import PhysicsOptions, RobotModel
from usarsim_server.simulation.placement import CLEARANCE, TOLERATED, Placement

LOWER, UPPER = (-20.0, -20.0, -10.0), (20.0, 20.0, 20.0)
FRONT = 0.1331 + RADIUS
"""How far the test robot reaches forward, m."""


def placement(engine: Engine) -> Placement:
    """A placement in a box of 40 m."""
    return Placement(engine.world, LOWER, UPPER)


def find(engine: Engine, slot: int, pose: Pose) -> Pose:
    """Where a slot's robot would be put."""
    return placement(engine).find(engine.snapshot(), slot, pose)


def fresh(scenery: Scenery | None = None, model: RobotModel = ROBOT) -> Engine:
    """An engine with one free slot."""
    return Engine(scenery or floor(), PhysicsOptions(), [model])


def walled(gap: float = 0.0) -> Scenery:
    """A floor and a thick wall whose face is at x = 1 m, with an overhang to squeeze under."""
    return furnished(box("wall", (2.0 + gap, 0.0, 1.0), (1.0, 3.0, 1.0)))


def slab(thickness: float, top: float = 0.0) -> Scenery:
    """A floor of finite thickness over a void."""

    def build() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        add_box(spec, "floor", (0.0, 0.0, top - thickness / 2), (15.0, 15.0, thickness / 2))
        return spec

    return build


def overlap(engine: Engine, robot: int) -> float:
    """Deepest overlap of a robot with anything else, m."""
    model = engine.world.model.__copy__()
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    data = mujoco.MjData(model)
    data.qpos[:] = engine.data.qpos
    mujoco.mj_forward(model, data)
    geoms = engine.world.layouts[engine.active[robot]].geoms
    own = np.isin(data.contact.geom, geoms).any(axis=1)
    return float(max(0.0, -data.contact.dist[own].min())) if own.any() else 0.0


class TestFree:
    """Places where nothing is in the way."""

    @pytest.mark.parametrize(
        "pose",
        [
            pose_at(0.0, 0.0),
            pose_at(-7.5, 3.25, 0.3, yaw=2.0),
            pose_at(0.0, 0.0, 5.0),
            Pose((1.0, 1.0, 0.6), quaternion_from_rpy(0.4, -0.3, 1.0)),
        ],
    )
    def test_a_free_pose_is_kept_exactly(self, pose: Pose) -> None:
        """A pose that is free is used as it is, on the floor, in the air or tilted."""
        assert find(fresh(), 0, pose) == pose

    def test_small_overlap_is_kept(self) -> None:
        """Robots 18: up to 2 cm of overlap the pose is used as it is."""
        pose = pose_at(1.0 - FRONT + 0.018, 0.0)
        assert find(fresh(walled()), 0, pose) == pose

    def test_parked_robots_are_in_nobodys_way(self) -> None:
        """A robot may be put where the parking shelf is, sideways of it."""
        engine = engine_with((0.0, 0.0), spare=3)
        assert find(engine, 2, pose_at(-3.0, 3.0)) == pose_at(-3.0, 3.0)


class TestRefused:
    """Poses that make no sense."""

    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    @pytest.mark.parametrize("index", range(7))
    def test_not_finite(self, index: int, value: float) -> None:
        """A pose with any value that is not finite is refused."""
        values = [0.0, 0.0, RADIUS, 1.0, 0.0, 0.0, 0.0]
        values[index] = value
        pose = Pose(tuple(values[:3]), tuple(values[3:]))  # type: ignore[arg-type]
        with pytest.raises(SpawnError, match="finite"):
            find(fresh(), 0, pose)

    def test_no_room_anywhere(self) -> None:
        """Deep inside a massive block there is no free place; the search ends with an error."""

        def rock() -> mujoco.MjSpec:
            spec = mujoco.MjSpec()
            add_box(spec, "rock", (0.0, 0.0, 0.0), (9.0, 9.0, 9.0))
            return spec

        with pytest.raises(SpawnError, match="no free place"):
            find(fresh(rock), 0, pose_at(0.0, 0.0, 0.0))


class TestOutside:
    """Poses outside the box of the world: the nearest place inside is taken, and logged."""

    @pytest.mark.parametrize(
        ("place", "expected"),
        [
            ((20.1, 0.0, RADIUS), (20.0, 0.0, RADIUS)),
            ((3.0, -1e9, RADIUS), (3.0, -20.0, RADIUS)),
            ((1e9, -1e9, RADIUS), (20.0, -20.0, RADIUS)),
            ((0.0, 0.0, 500.0), (0.0, 0.0, RADIUS + CLEARANCE)),
        ],
    )
    def test_nearest_place_inside(
        self,
        place: tuple[float, float, float],
        expected: tuple[float, float, float],
        caplog: pytest.LogCaptureFixture,
    ) -> None:
        """It is the edge of the box, on the floor there, and one line tells of it."""
        assert find(fresh(), 0, pose_at(*place)).position == expected
        assert [record.getMessage().count("outside the world") for record in caplog.records] == [1]

    def test_ground_below(self) -> None:
        """The box is larger than the floor: it starts where the floor begins, not over the void."""
        x, y, z = find(fresh(slab(0.2)), 0, pose_at(1e4, 0.0, 0.5)).position
        assert 14.0 < x < 15.0 - FRONT
        assert (y, z) == (0.0, pytest.approx(RADIUS + CLEARANCE))

    def test_below_a_floor_of_finite_thickness(self) -> None:
        """From below the box it is lifted onto the floor above."""
        assert find(fresh(slab(0.2)), 0, pose_at(0.0, 0.0, -11.0)).position[2] > RADIUS

    def test_inside_nothing_is_said(self, caplog: pytest.LogCaptureFixture) -> None:
        """Below an endless floor is not outside; a robot in the box is left alone."""
        find(fresh(), 0, pose_at(0.0, 0.0, -60.0))
        find(fresh(), 0, pose_at(19.9, 0.0))
        assert not caplog.records


def flying() -> RobotModel:
    """The test robot, carried by something else than the floor."""

    def build() -> mujoco.MjSpec:
        spec = build_robot()
        for body in spec.bodies:
            body.gravcomp = float(body.name != "world")
        return spec

    return RobotModel("flying", build, ROBOT.driven, RADIUS)


def terraced() -> Scenery:
    """A wall of 2.2 m, 0.6 m thick, between a floor and the edge of a platform 0.4 m high."""
    return furnished(
        box("wall", (5.0, 0.0, 1.1), (0.3, 6.0, 1.1)),
        box("platform", (8.3, 0.0, 0.2), (3.0, 6.0, 0.2)),
    )


class TestGround:
    """Robots that have to be moved stand on level ground."""

    @pytest.mark.parametrize("z", [0.5, 1.5, 2.15])
    def test_not_on_a_wall(self, z: float) -> None:
        """From inside a wall it comes to the floor beside it, however near its top is."""
        x, _, height = find(fresh(terraced()), 0, pose_at(4.9, 0.3, z)).position
        assert x < 5.0 - 0.3 - FRONT + TOLERATED
        assert height == pytest.approx(RADIUS + CLEARANCE)

    def test_not_on_a_wall_at_the_edge_of_the_world(self) -> None:
        """From outside the world, above the top of the wall around it, it comes inside."""
        ring = furnished(box("wall", (19.8, 0.0, 1.0), (0.25, 20.0, 1.0)))
        x, _, height = find(fresh(ring), 0, pose_at(23.0, 0.3, 2.25)).position
        assert 18.0 < x < 19.5
        assert height == pytest.approx(RADIUS + CLEARANCE)

    def test_floor_beyond_what_is_drawn_of_it(self) -> None:
        """A plane carries a robot beyond the rectangle that cameras draw of it."""

        def small() -> mujoco.MjSpec:
            spec = walled()()
            spec.geom("floor").size = [0.5, 0.5, 0.1]
            return spec

        x, _, height = find(fresh(small), 0, pose_at(1.0 - FRONT + 0.3, 0.4, 1.5)).position
        assert x < 1.0 - FRONT + TOLERATED
        assert height == pytest.approx(RADIUS + CLEARANCE)

    def test_platform_is_ground(self) -> None:
        """A platform that it can drive on is ground as good as the floor."""
        x, _, height = find(fresh(terraced()), 0, pose_at(5.2, 0.3, 0.6)).position
        assert x > 5.3
        assert height == pytest.approx(0.4 + RADIUS + CLEARANCE)

    def test_level_ground_rather_than_near(self) -> None:
        """On the posts of a step field it would lean; a metre farther it does not."""
        posts = [
            box(
                f"post{n}",
                (0.2 * (n % 6), 0.2 * (n // 6), 0.0),
                (0.1, 0.1, 0.01 + 0.05 * (n * 5 % 7)),
            )
            for n in range(36)
        ]
        blocked = box("block", (0.5, 0.5, 0.4), (0.2, 0.2, 0.4))
        x, y, height = find(fresh(furnished(*posts, blocked)), 0, pose_at(0.5, 0.5)).position
        assert height == pytest.approx(RADIUS, abs=1.1 * CLEARANCE)
        assert not (-0.2 < x < 1.2 and -0.2 < y < 1.2)

    @pytest.mark.parametrize(
        ("slope", "said"), [(0.0, 0), (2.0, 0), (4.0, 1)], ids=["level", "2 deg", "4 deg"]
    )
    def test_free_place_is_kept_and_told(
        self, slope: float, said: int, caplog: pytest.LogCaptureFixture
    ) -> None:
        """A free place that was asked for is kept; where it leans the log says so."""
        pose = pose_at(0.0, 0.0, RADIUS + 0.03)
        assert find(fresh(floor(slope=math.radians(slope))), 0, pose) == pose
        assert [record.getMessage().count("not level") for record in caplog.records] == [1] * said

    def test_what_flies_takes_the_nearest_place(self, caplog: pytest.LogCaptureFixture) -> None:
        """Aircraft stay in the air: neither moved down to a floor nor told of its slope."""
        engine = fresh(terraced(), flying())
        assert find(engine, 0, pose_at(4.9, 0.3, 2.1)).position[2] == pytest.approx(2.1, abs=0.3)
        assert find(engine, 0, pose_at(0.0, 0.0, 1.0)) == pose_at(0.0, 0.0, 1.0)
        assert not caplog.records


class TestBlocked:
    """Poses where something is in the way."""

    @pytest.mark.parametrize("depth", [0.03, 0.1, 0.24, 0.5])
    def test_inside_a_wall_it_moves_out(self, depth: float) -> None:
        """A robot in a wall is moved to a free place near by, with its attitude kept."""
        engine = fresh(walled())
        wanted = pose_at(1.0 - FRONT + depth, 0.4, yaw=0.0)
        placed = find(engine, 0, wanted)
        assert placed.position != wanted.position
        assert placed.quaternion == wanted.quaternion
        assert math.dist(placed.position, wanted.position) < depth + 0.5
        engine.occupy(0, 0, placed)
        assert overlap(engine, 0) <= TOLERATED

    def test_on_a_robot_it_moves_aside(self) -> None:
        """Two robots at one place: the second stands beside the first, not on top of it."""
        engine = engine_with((0.0, 0.0), spare=1)
        placed = find(engine, 1, pose_at(0.0, 0.0))
        assert placed.position[2] == RADIUS
        assert 0.3 < math.hypot(*placed.position[:2]) < 1.0
        engine.occupy(1, 1, placed)
        assert overlap(engine, 1) <= TOLERATED

    def test_sleeping_robots_and_crates_are_noticed(self) -> None:
        """What sleeps is in the way all the same."""
        engine = engine_with((5.0, 5.0), scenery=yard, spare=1)
        run(engine, 2.0)
        assert engine.data.ntree_awake == 0
        for place in ((5.0, 5.0), (0.0, -3.0)):
            placed = find(engine, 1, pose_at(*place))
            assert math.hypot(placed.position[0] - place[0], placed.position[1] - place[1]) > 0.1
            assert placed.position[2] == RADIUS

    def test_things_are_where_they_are_now(self) -> None:
        """A crate that was pushed away leaves its place free and takes another one."""
        engine = engine_with((5.0, 5.0), scenery=yard, spare=1)
        crate = engine.world.model.joint(engine.world.model.body("crate0").jntadr[0])
        engine.data.qpos[crate.qposadr[0]] = -5.0
        assert find(engine, 1, pose_at(0.0, -3.0)) == pose_at(0.0, -3.0)
        assert find(engine, 1, pose_at(-5.0, -3.0)) != pose_at(-5.0, -3.0)

    def test_never_outside_the_world(self) -> None:
        """The place found instead lies inside the world, too."""
        corner = furnished(box("block", (19.6, 19.6, 0.5), (0.5, 0.5, 0.5)))
        placed = find(fresh(corner), 0, pose_at(19.9, 19.9))
        assert max(placed.position[:2]) <= 20.0
        assert min(placed.position[:2]) < 19.1

    def test_parts_that_overlap_each_other_do_not_count(self) -> None:
        """A robot whose own parts run into each other can be placed like any other."""

        def build() -> mujoco.MjSpec:
            spec = build_robot()
            hub = spec.body("front_left").add_body(name="hub")
            hub.add_joint(name="hub", axis=[1.0, 0.0, 0.0])
            hub.add_geom(type=Geom.mjGEOM_BOX, size=[0.02, 0.15, 0.02], mass=0.1)
            return spec

        model = RobotModel("knot", build, ROBOT.driven, RADIUS)
        assert find(fresh(model=model), 0, pose_at(0.0, 0.0)) == pose_at(0.0, 0.0)


class TestUnderTheFloor:
    """Poses from which there is no way up."""

    @pytest.mark.parametrize("depth", [0.05, 0.5, 3.0, 9.0, 500.0])
    def test_under_an_endless_floor(self, depth: float) -> None:
        """Any pose under an endless floor is lifted onto it, however deep it is."""
        placed = find(fresh(), 0, pose_at(2.0, 3.0, -depth))
        assert placed.position[:2] == (2.0, 3.0)
        assert RADIUS <= placed.position[2] < RADIUS + 0.01

    def test_under_a_slope(self) -> None:
        """On a slope it is lifted to the height of the slope at that place."""
        slope = math.radians(10.0)
        placed = find(fresh(floor(slope=slope)), 0, pose_at(5.0, 0.0, -2.0))
        assert placed.position[2] == pytest.approx(5.0 * math.tan(slope) + RADIUS, abs=0.06)

    @pytest.mark.parametrize("thickness", [0.05, 0.3, 2.0])
    def test_under_a_slab(self, thickness: float) -> None:
        """Under a floor of finite thickness, with a void below, it is lifted onto the floor."""
        placed = find(fresh(slab(thickness)), 0, pose_at(1.0, 1.0, -thickness - 1.0))
        assert placed.position[:2] == (1.0, 1.0)
        assert RADIUS <= placed.position[2] < RADIUS + 0.01

    @pytest.mark.parametrize("depth", [0.1, 0.3, 0.5, 0.8])
    def test_inside_a_slab(self, depth: float) -> None:
        """Inside the floor itself it comes out at the top, not far above."""
        engine = fresh(slab(1.0))
        placed = find(engine, 0, pose_at(1.0, 1.0, -depth))
        assert RADIUS - TOLERATED <= placed.position[2] < RADIUS + 0.6
        engine.occupy(0, 0, placed)
        assert overlap(engine, 0) <= TOLERATED

    def test_a_cellar_is_a_place(self) -> None:
        """Between two floors it stays where it was told: there is ground below."""

        def cellar() -> mujoco.MjSpec:
            spec = slab(0.3)()
            add_box(spec, "ground", (0.0, 0.0, -3.1), (15.0, 15.0, 0.1))
            return spec

        assert find(fresh(cellar), 0, pose_at(0.0, 0.0, -2.0)) == pose_at(0.0, 0.0, -2.0)

    def test_in_the_open_air_it_stays(self) -> None:
        """With nothing above or below it stays where it was told."""
        pose = pose_at(18.0, 18.0, 1.0)
        assert find(fresh(slab(0.3)), 0, pose) == pose

    def test_parked_robots_are_no_ground(self) -> None:
        """In a void right below the parked robots it stays where it was told, too."""
        engine = Engine(mujoco.MjSpec, PhysicsOptions(), [ROBOT] * 9)
        x, y, _ = engine.world.parking[8, :3]
        assert find(engine, 0, pose_at(x, y, 1.0)) == pose_at(x, y, 1.0)


class TestDrop:
    """What physics makes of a spawn (robots reference 5.1)."""

    @pytest.mark.parametrize("tilt", [0.0, 0.3])
    def test_from_a_metre_it_settles(self, tilt: float) -> None:
        """Robots 17: from 1 m it settles within 3 s to 1 cm, upright, no bounce."""
        engine = fresh()
        pose = Pose((0.0, 0.0, RADIUS + 1.0), quaternion_from_rpy(tilt, 0.0, 0.5))
        engine.occupy(0, 0, find(engine, 0, pose))
        lowest, bounce = math.inf, 0.0
        for _ in range(750):
            assert engine.advance(1) == []
            height = base_qpos(engine, 0)[2]
            if height < lowest:
                lowest = height
            elif lowest < 0.2:
                bounce = max(bounce, height - lowest)
        assert base_qpos(engine, 0)[2] == pytest.approx(RADIUS, abs=0.01)
        assert bounce < 0.05
        assert up(engine)[2] > math.cos(math.radians(1.0))
        assert np.abs(base_qvel(engine, 0)).max() < 0.01

    @pytest.mark.parametrize("yaw", [0.0, 0.6, math.pi / 2])
    @pytest.mark.parametrize("depth", [0.005, 0.0199])
    def test_small_overlap_is_pushed_out_gently(self, depth: float, yaw: float) -> None:
        """Robots 18: out of 2 cm of wall and floor it comes slower than 1 m/s."""
        engine = fresh(walled())
        reach = touching_distance(yaw)
        wanted = pose_at(1.0 - reach + depth, 0.0, RADIUS - depth + 0.0005, yaw)
        placed = find(engine, 0, wanted)
        assert placed == wanted
        engine.occupy(0, 0, placed)
        fastest = 0.0
        for _ in range(250):
            engine.advance(1)
            fastest = max(fastest, float(np.linalg.norm(base_qvel(engine, 0)[:3])))
        assert fastest < 1.0
        assert overlap(engine, 0) < 0.005

    def test_no_jump_in_a_step(self) -> None:
        """Robots 62: a spawn at the limit of overlap moves no body 0.1 m in a step."""
        engine = fresh(walled())
        engine.occupy(0, 0, pose_at(1.0 - FRONT + 0.02, 0.0, RADIUS - 0.02))
        last = base_qpos(engine, 0)[:3]
        for _ in range(250):
            engine.advance(1)
            now = base_qpos(engine, 0)[:3]
            assert np.linalg.norm(now - last) < 0.1
            last = now

    def test_a_newcomer_does_not_shove(self) -> None:
        """A robot spawned onto a standing one leaves it where it stands."""
        engine = engine_with((0.0, 0.0), spare=1)
        run(engine, 1.0)
        before = base_qpos(engine, 0)
        engine.occupy(1, 1, find(engine, 1, pose_at(0.05, 0.05)))
        drive(engine, straight(0.0), 1.0, robot=1)
        assert np.linalg.norm(base_qpos(engine, 0)[:3] - before[:3]) < 0.03

    def test_a_crate_on_the_spot_stays(self) -> None:
        """A crate where the robot should stand is neither crushed nor shot away."""
        scenery = furnished(crate("crate", (0.0, 0.0, 0.15)))
        engine = fresh(scenery)
        run(engine, 0.5)
        engine.occupy(0, 0, find(engine, 0, pose_at(0.0, 0.0)))
        run(engine, 1.0)
        np.testing.assert_allclose(engine.data.body("crate").xpos, (0.0, 0.0, 0.15), atol=0.02)


def up(engine: Engine) -> NDArray[np.float64]:
    """The robot's upward axis in the world."""
    w, x, y, z = base_qpos(engine, 0)[3:]
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


def touching_distance(yaw: float) -> float:
    """How far the test robot reaches along x at a heading, m, found by looking."""
    engine = fresh(walled())
    low, high = 0.1, 0.6
    for _ in range(40):
        middle = (low + high) / 2
        engine.occupy(0, 0, pose_at(1.0 - middle, 0.0, RADIUS + 0.05, yaw))
        low, high = (middle, high) if overlap(engine, 0) > 0.0 else (low, middle)
    return high


def test_contacts_of_others_are_not_looked_for() -> None:
    """Those of parked robots with their shelf, and of robots with each other, cost a newcomer
    nothing: in a crowd they were most of what its place took."""
    engine = Engine(floor(), PhysicsOptions(), [ROBOT] * 6)
    for robot in range(3):
        engine.occupy(robot, robot, pose_at(3.0, 0.0, RADIUS))
    judge = placement(engine)
    assert judge.find(engine.snapshot(), 3, pose_at(0.0, 0.0, RADIUS - 0.005))
    own = engine.world.layouts[3].geoms
    pairs = judge._data.contact.geom
    assert len(pairs) > 0
    assert np.isin(pairs, own).any(axis=1).all()
    moved = judge.find(engine.snapshot(), 3, pose_at(3.0, 0.0, RADIUS))
    assert math.dist(moved.position, (3.0, 0.0, RADIUS)) > FRONT
