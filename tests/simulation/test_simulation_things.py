"""Things that are no robots: slots, places that are free or blocked, ways, other bodies, belts."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from limb_fakes import CRANE, close, holding
from sim_fakes import (
    ROBOT,
    Geom,
    Watcher,
    add_box,
    base_qpos,
    box,
    crate,
    furnished,
    pose_at,
    run,
    simulation,
    straight,
)

from usarsim_server.base.errors import SpawnError
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import PhysicsOptions, RobotModel
from usarsim_server.simulation.placement import TOLERATED
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.simulation import Simulation

HALF = 0.2


def thing(
    rigid: bool = False, half: float = HALF, key: str = "cube", limb: bool = False
) -> RobotModel:
    """A cube; with a limb a second one stands on it."""

    def build() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        base = spec.worldbody.add_body(name="base", mocap=not rigid)
        if rigid:
            base.add_freejoint(name="free")
        base.add_geom(type=Geom.mjGEOM_BOX, size=[half] * 3, mass=2.0)
        if limb:
            other = spec.worldbody.add_body(name="limb", mocap=True, pos=(0, 0, 2 * half))
            other.add_geom(type=Geom.mjGEOM_BOX, size=[half / 2] * 3, pos=(0, 0, half / 2))
        return spec

    full = f"{key}:{half}:{rigid}:{limb}"
    return RobotModel(full, build, driven=(), rest_height=half, kinematic=not rigid, robot=False)


def at(x: float, y: float = 0.0, z: float = HALF) -> Pose:
    """A level pose."""
    return Pose((x, y, z))


def where(world: Simulation, number: int) -> np.ndarray:
    """Present position of a robot or thing."""
    state = world.body(number).state(world.look())
    assert state is not None
    return np.array(state.pose.position)


def leave(world: Simulation, number: int) -> None:
    """Take something out of the world, at once."""
    world.remove(number)
    world.settle()


def look(world: Simulation, y: float = 0.0, z: float = 0.2) -> float:
    """What a ray along +x from x = -5 m sees, m."""
    fan = RayFan(np.array([-5.0, y, z]), np.array([[1.0, 0.0, 0.0]]), 50.0)
    return float(world.cast([fan], world.look(), None)[0].distances[0])


class TestPlaces:
    """Where a thing may be."""

    @pytest.mark.parametrize("rigid", [False, True])
    def test_a_free_place_is_taken_as_it_is(self, rigid: bool) -> None:
        """A thing is exactly where it was asked for, and rays see it there at once."""
        world = simulation()
        number, placed = world.spawn(thing(rigid), at(1.0, 0.3))
        assert placed.position == (1.0, 0.3, HALF)
        assert where(world, number) == pytest.approx([1.0, 0.3, HALF])
        assert look(world, y=0.3) == pytest.approx(6.0 - HALF, abs=1e-6)
        world.run_until(1.0)
        assert where(world, number) == pytest.approx([1.0, 0.3, HALF], abs=1e-3)

    def test_a_placed_thing_hangs_in_the_air(self) -> None:
        """Nothing pulls down what forces do not move."""
        world = simulation()
        number, _ = world.spawn(thing(), at(0.0, z=1.5))
        falling, _ = world.spawn(thing(rigid=True), at(3.0, z=1.5))
        world.run_until(1.0)
        assert where(world, number) == pytest.approx([0.0, 0.0, 1.5])
        assert where(world, falling)[2] == pytest.approx(HALF, abs=2e-3)

    @pytest.mark.parametrize("rigid", [False, True])
    @pytest.mark.parametrize(
        ("pose", "by"),
        [
            (at(3.0), "wall"),
            (at(2.9 - HALF + TOLERATED + 0.005), "wall"),
            (at(3.0, 4.0 + HALF / 2), "wall"),
            (at(0.0, -3.0), "crate"),
            (at(-2.0), "robot0"),
            (at(5.0, 5.0), "robot1"),
            (at(math.nan), "finite"),
            (at(5000.0), "outside"),
            (at(0.0, z=-60.0 + 5000), "outside"),
        ],
    )
    def test_a_blocked_place_is_refused(self, rigid: bool, pose: Pose, by: str) -> None:
        """Scenery, crates, robots, other things: whatever is deeper than 2 cm inside blocks."""
        scene = furnished(
            box("wall", (3.0, 0.0, 0.5), (0.1, 4.0, 0.5)), crate("crate", (0.0, -3.0, 0.15))
        )
        world = simulation(scene)
        world.spawn(ROBOT, pose_at(-2.0, 0.0))
        world.spawn(thing(), at(5.0, 5.0))
        with pytest.raises(SpawnError, match=by):
            world.spawn(thing(rigid), pose)
        assert len(world.look().layouts) == 2

    def test_touching_is_no_blocking(self) -> None:
        """Things may stand side by side and on each other."""
        world = simulation()
        numbers = [world.spawn(thing(rigid=True), at(2 * HALF * n))[0] for n in range(3)]
        numbers.append(world.spawn(thing(rigid=True), at(0.0, z=3 * HALF))[0])
        world.run_until(1.0)
        for n, number in enumerate(numbers[:3]):
            assert where(world, number) == pytest.approx([2 * HALF * n, 0.0, HALF], abs=2e-3)
        assert where(world, numbers[3])[2] == pytest.approx(3 * HALF, abs=3e-3)

    def test_what_is_sunk_in_a_floor_is_lifted(self) -> None:
        """A client that gives the foot instead of the middle gets its thing on the floor."""
        world = simulation()
        _, placed = world.spawn(thing(), at(0.0, z=0.0))
        assert placed.position == pytest.approx((0.0, 0.0, HALF), abs=2e-3)

    def test_two_with_one_centre_do_not_fit(self) -> None:
        """The very same place is blocked, also where distances between geoms are ill defined."""
        world = simulation()
        world.spawn(thing(), at(1.0))
        with pytest.raises(SpawnError, match="blocked"):
            world.spawn(thing(), at(1.0))
        with pytest.raises(SpawnError, match="blocked"):
            world.spawn(thing(rigid=True, half=0.1), at(1.0))

    def test_robots_keep_away_from_things(self) -> None:
        """A robot that is spawned inside a thing gets a place beside it."""
        world = simulation()
        world.spawn(thing(), at(1.0))
        number, _ = world.spawn(ROBOT, pose_at(1.0, 0.0))
        assert math.dist(where(world, number)[:2], (1.0, 0.0)) > 0.25


class TestMoving:
    """Putting things elsewhere."""

    @pytest.mark.parametrize("rigid", [False, True])
    def test_a_thing_is_moved(self, rigid: bool) -> None:
        """It is at the new place, at rest, and not at the old one, which is no hindrance."""
        world = simulation()
        number, _ = world.spawn(thing(rigid), at(1.0))
        world.move(number, at(1.1))
        assert where(world, number) == pytest.approx([1.1, 0.0, HALF])
        world.move(number, at(1.1, 3.0))
        assert look(world) == math.inf
        assert look(world, y=3.0) == pytest.approx(6.1 - HALF, abs=1e-6)

    def test_a_blocked_move_changes_nothing(self) -> None:
        """Like creating, moving into something is refused."""
        world = simulation()
        one, _ = world.spawn(thing(), at(1.0))
        other, _ = world.spawn(thing(), at(3.0))
        with pytest.raises(SpawnError, match="blocked"):
            world.move(one, at(3.1))
        assert where(world, one) == pytest.approx([1.0, 0.0, HALF])
        assert where(world, other) == pytest.approx([3.0, 0.0, HALF])

    def test_a_robot_is_moved_to_the_nearest_place(self) -> None:
        """A robot moved into a thing stands beside it."""
        world = simulation()
        robot, _ = world.spawn(ROBOT, pose_at(-1.0, 0.0))
        world.spawn(thing(), at(3.0))
        placed = world.move(robot, pose_at(3.0, 0.0))
        assert 0.2 < math.dist(placed.position[:2], (3.0, 0.0)) < 1.5
        assert where(world, robot) == pytest.approx(placed.position)

    def test_what_has_left_cannot_be_moved(self) -> None:
        """A thing that is gone is told apart from one that is blocked."""
        world = simulation()
        number, _ = world.spawn(thing(), at(1.0))
        leave(world, number)
        with pytest.raises(SpawnError, match="not in the world"):
            world.move(number, at(2.0))
        with pytest.raises(SpawnError, match="not in the world"):
            world.reseat(number, thing(rigid=True))

    def test_what_stood_on_a_thing_falls_when_it_goes(self) -> None:
        """Neither a sleeping crate nor a sleeping robot stays in the air."""
        world = simulation()
        for rigid in (False, True):
            below, _ = world.spawn(thing(rigid), at(4.0 * rigid))
            above, _ = world.spawn(thing(rigid=True), at(4.0 * rigid, z=3 * HALF))
            world.run_until(world.look().time + 4.0)
            assert where(world, above)[2] == pytest.approx(3 * HALF, abs=3e-3)
            leave(world, below)
            world.run_until(world.look().time + 1.0)
            assert where(world, above)[2] == pytest.approx(HALF, abs=3e-3)


class TestWays:
    """Things that go their own way, and change their bodies."""

    def test_a_thing_follows_its_way(self) -> None:
        """The way begins at the moment it is given, from the pose the thing has."""
        world = simulation()
        number, _ = world.spawn(thing(), at(1.0))
        world.run_until(0.5)
        seen = []

        def plan(time: float, pose: Pose) -> list:
            seen.append((time, pose))
            x, y, z = pose.position
            return [lambda now: Pose((x + 0.5 * (now - time), y, z))]

        world.body(number).follow(plan)
        assert seen == [(pytest.approx(0.5), at(1.0))]
        world.run_until(2.5)
        assert where(world, number) == pytest.approx([2.0, 0.0, HALF], abs=1e-9)
        world.body(number).follow(lambda time, pose: [])
        world.run_until(3.0)
        assert where(world, number) == pytest.approx([2.0, 0.0, HALF], abs=1e-9)

    def test_moving_ends_a_way(self) -> None:
        """What was put somewhere stays there."""
        world = simulation()
        number, _ = world.spawn(thing(), at(1.0))
        world.body(number).follow(lambda time, pose: [lambda now: at(1.0 + now)])
        world.run_until(0.5)
        world.move(number, at(0.0, 4.0))
        world.run_until(1.5)
        assert where(world, number) == pytest.approx([0.0, 4.0, HALF])

    def test_ways_go_on_in_a_larger_model(self) -> None:
        """Growth in the middle of a way does not show."""
        world = simulation()
        number, _ = world.spawn(thing(), at(0.0))
        world.body(number).follow(lambda time, pose: [lambda now: at(now)])
        world.run_until(1.0)
        world.spawn(thing(key="other"), at(0.0, 5.0))
        assert where(world, number)[0] == pytest.approx(1.0, abs=1e-9)
        world.run_until(2.0)
        assert where(world, number)[0] == pytest.approx(2.0, abs=1e-9)

    def test_limbs_go_along_and_ways_of_their_own(self) -> None:
        """All bodies of a thing keep together when it is put somewhere, turned too."""
        world = simulation()
        number, _ = world.spawn(thing(limb=True), at(1.0))
        turned = Pose((0.0, 2.0, 1.0), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0))
        world.move(number, turned)
        state = world.body(number).state(world.look())
        assert state is not None
        assert state.link_pose("limb").position == pytest.approx((0.0, 2.0 - 2 * HALF, 1.0))
        ways = [lambda now: at(0.0), lambda now: at(0.0, z=1.0 + now)]
        world.body(number).follow(lambda time, pose: ways)
        world.run_until(0.5)
        state = world.body(number).state(world.look())
        assert state is not None
        assert state.link_pose("LIMB").position == pytest.approx((0.0, 0.0, 1.5))

    def test_a_thing_gets_another_body_and_keeps_its_number(self) -> None:
        """A hanging thing that becomes a rigid one falls; turned back it stays where it lies."""
        world = simulation()
        number, _ = world.spawn(thing(), at(1.0, z=1.0))
        world.reseat(number, thing(rigid=True))
        assert where(world, number) == pytest.approx([1.0, 0.0, 1.0])
        world.run_until(1.0)
        lying = where(world, number)
        assert lying[2] == pytest.approx(HALF, abs=3e-3)
        world.reseat(number, thing())
        world.run_until(1.5)
        assert where(world, number) == pytest.approx(lying, abs=1e-9)
        assert len(world.look().layouts) == 1


class TestSlots:
    """How many there may be."""

    def test_things_are_no_robots(self) -> None:
        """A world full of things has room for its robots, and the other way round."""
        world = simulation(max_robots=1, max_things=2)
        for n in range(2):
            world.spawn(thing(), at(2.0 * n))
        with pytest.raises(SpawnError, match="--max-objects"):
            world.spawn(thing(), at(6.0))
        world.spawn(ROBOT, pose_at(0.0, 3.0))
        with pytest.raises(SpawnError, match="--max-robots"):
            world.spawn(ROBOT, pose_at(0.0, 6.0))

    def test_slots_are_used_again(self) -> None:
        """Creating and removing alike things costs one compilation."""
        world = simulation()
        for _ in range(5):
            number, _ = world.spawn(thing(rigid=True), at(0.0))
            leave(world, number)
        assert world.look().generation == 1

    def test_slots_of_things_that_are_gone_become_others(self) -> None:
        """A hundred different things one after the other do not make the model a hundred larger."""
        world = simulation(max_things=4)
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 5.0))
        kept, _ = world.spawn(thing(rigid=True, key="kept"), at(0.0))
        before = where(world, robot), where(world, kept)
        for n in range(40):
            model = thing(rigid=bool(n % 2), half=0.1 + 0.01 * n, key=f"kind{n}")
            number, placed = world.spawn(model, at(3.0, z=1.0))
            assert placed.position == (3.0, 0.0, 1.0)
            world.run_until(world.look().time + 0.02)
            assert where(world, number)[0] == pytest.approx(3.0, abs=1e-6)
            leave(world, number)
        bodies = world.look().xpos.shape[0]
        assert bodies <= 1 + 5 + 4 + 8
        assert where(world, robot) == pytest.approx(before[0], abs=2e-3)
        assert where(world, kept) == pytest.approx(before[1], abs=2e-3)

    def test_a_thing_that_falls_out_of_the_world_is_gone(self) -> None:
        """Like a robot it leaves when it is below the bounds."""

        def hole() -> mujoco.MjSpec:
            spec = mujoco.MjSpec()
            add_box(spec, "slab", (0.0, 0.0, -0.5), (2.0, 2.0, 0.5))
            return spec

        world = simulation(hole, lower=(-50.0, -50.0, -5.0))
        number, _ = world.spawn(thing(rigid=True), at(3.0))
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        world.body(robot).attach(Watcher(0.1))
        world.run_until(2.0)
        assert number not in world.look().layouts
        assert robot in world.look().layouts

    def test_runs_repeat_bit_for_bit(self) -> None:
        """Robots that push things about do so in the same way in every run."""
        ends = []
        for _ in range(2):
            world = simulation()
            robot, _ = world.spawn(ROBOT, pose_at(-1.0, 0.0))
            world.spawn(thing(rigid=True), at(0.0, 0.05))
            mover, _ = world.spawn(thing(), at(0.0, 3.0))
            world.body(robot).drive(straight(4.0))
            world.body(mover).follow(lambda time, pose: [lambda now: at(0.0, 3.0 - now)])
            world.run_until(2.5)
            ends.append(world.look())
        assert np.array_equal(ends[0].qpos, ends[1].qpos)
        assert np.array_equal(ends[0].xpos, ends[1].xpos)


class TestHeld:
    """Things in the hands of robots."""

    @staticmethod
    def engine() -> Engine:
        """A crane that holds a thing of 14 cm half a metre before it, and room for another."""
        scene = furnished(box("table", (0.5, 0.0, 0.04), (0.3, 0.3, 0.04)))
        parcel = thing(rigid=True, half=0.07, key="parcel")
        engine = Engine(scene, PhysicsOptions(), [CRANE, parcel, thing(half=0.07, key="parcel")])
        engine.occupy(0, 0, Pose((0.0, 0.0, 0.0)))
        engine.occupy(1, 1, at(0.5, z=0.15))
        close(engine, seconds=1.0)
        assert holding(engine, "grip") == "robot1:base"
        return engine

    @pytest.mark.parametrize("how", ["vacate", "teleport", "reseat"])
    def test_what_is_taken_away_is_let_go(self, how: str) -> None:
        """A held thing that is removed, moved or turned into another leaves the robot in peace."""
        engine = self.engine()
        before = base_qpos(engine, 0)
        if how == "vacate":
            engine.vacate(1)
        elif how == "teleport":
            engine.teleport(1, at(5.0))
        else:
            engine.reseat(1, 2)
        assert holding(engine, "grip") is None
        run(engine, 1.0)
        assert base_qpos(engine, 0) == pytest.approx(before, abs=5e-3)
        if how == "teleport":
            assert engine.pose(1).position == pytest.approx((5.0, 0.0, 0.07), abs=2e-3)
