"""Slots that nobody uses are given back, and nobody notices."""

from __future__ import annotations

import gc
import threading
import time
import weakref

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    RADIUS,
    ROBOT,
    WHEELS,
    Watcher,
    build_robot,
    engine_with,
    floor,
    pose_at,
    robot_model,
    simulation,
    straight,
    turn,
    watched,
    whole_state,
    yard,
)

from usarsim_server.simulation import slots
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import VACANT, PhysicsOptions, RobotModel
from usarsim_server.simulation.simulation import Simulation

OTHER = robot_model("other")
PATIENCE = 60.0
"""s of wall time after which a test gives up waiting."""


def engine() -> Engine:
    """Two kinds by turns: robot 0 drives, robot 1 sleeps, the other slots are free."""
    made = Engine(yard, PhysicsOptions(), [OTHER, ROBOT, OTHER, ROBOT, OTHER, OTHER])
    made.occupy(0, 1, pose_at(0.0, 0.0))
    made.occupy(1, 3, pose_at(0.0, 1.5))
    made.drive(0, turn(3.0))
    for _ in range(500):
        made.advance(2)
    return made


def shrink(made: Engine) -> None:
    """Give all free slots back."""
    taken = made.active.values()
    free = [slot for slot in range(len(made.world.slots)) if slot not in taken]
    made.adopt(made.grow((), dict.fromkeys(free, VACANT)))


def asleep(made: Engine) -> list[bool]:
    """Which of the robots sleep."""
    layouts = [made.world.layouts[slot] for slot in made.active.values()]
    trees = made.world.model.dof_treeid[[layout.dof for layout in layouts]]
    return [bool(state) for state in made.data.tree_asleep[trees] >= 0]


class TestCarryingOver:
    """The smaller model goes on where the larger one was."""

    def test_to_the_last_bit(self) -> None:
        """Who drives, sleeps and is pushed about does the same with and without."""
        one, other = engine(), engine()
        assert asleep(one) == [False, True]
        shrink(other)
        assert asleep(other) == [False, True]
        assert other.world.model.nv < one.world.model.nv
        for step in range(400):
            if step == 200:
                one.drive(0, straight(5.0))
                other.drive(0, straight(5.0))
            assert one.advance(2) == other.advance(2) == []
            np.testing.assert_array_equal(whole_state(one, 0), whole_state(other, 0))
        np.testing.assert_array_equal(whole_state(one, 1), whole_state(other, 1))

    def test_numbers_stay(self) -> None:
        """Slots keep their numbers; the last ones disappear, others stand empty."""
        made = engine()
        shrink(made)
        assert [kind.key for kind in made.world.slots] == ["", ROBOT.key, "", ROBOT.key]
        assert made.active == {0: 1, 1: 3}
        assert made.free_slot(OTHER.key) is None

    def test_empty_slots_are_filled_again(self) -> None:
        """A kind that comes back gets a slot that was given back."""
        made = engine()
        shrink(made)
        before = whole_state(made, 0)
        made.adopt(made.grow([OTHER], {0: OTHER}))
        np.testing.assert_array_equal(whole_state(made, 0), before)
        made.occupy(2, 0, pose_at(1.0, -1.0))
        for _ in range(200):
            assert made.advance(2) == []
        assert whole_state(made, 2)[2] == pytest.approx(0.11, abs=0.01)

    def test_who_touched_a_newcomer_at_its_parking_place(self) -> None:
        """Two large robots would touch there; one of them has long gone elsewhere."""

        def build() -> mujoco.MjSpec:
            spec = build_robot()
            base = spec.body("base")
            box, size = mujoco.mjtGeom.mjGEOM_BOX, [4.0, 0.1, 0.02]
            base.add_geom(type=box, size=size, pos=[0.0, 0.0, 0.3], mass=1.0)
            return spec

        wide = RobotModel(key="wide", build=build, driven=WHEELS, rest_height=RADIUS)
        made = Engine(floor(), PhysicsOptions(), [wide])
        made.occupy(0, 0, pose_at(0.0, 0.0))
        made.drive(0, turn(2.0))
        made.advance(100)
        made.adopt(made.grow([wide]))
        assert made.data.tree_asleep.tolist()[1] == 1
        assert made.data.tree_awake.tolist() == [1, 0]
        made.advance(10)
        made.occupy(1, 1, pose_at(0.0, 5.0))
        assert made.advance(10) == []
        assert made.data.tree_awake.tolist() == [1, 1]

    def test_who_sleeps_on_another_wakes_when_that_is_gone(self) -> None:
        """A slot that is given back leaves nobody asleep beside nothing."""
        made = Engine(yard, PhysicsOptions(), [ROBOT, ROBOT])
        made.occupy(0, 1, pose_at(0.0, 0.0))
        for _ in range(500):
            made.advance(2)
        tree = made.world.model.dof_treeid[[layout.dof for layout in made.world.layouts]]
        made.data.tree_asleep[tree] = tree[::-1]  # as if they lay on each other
        shrink(made)
        assert asleep(made) == [False]


class TestParked:
    """Free slots cost little while they are there."""

    def test_they_are_left_out_of_the_search_for_contacts(self) -> None:
        """Once asleep; a robot that comes touches things as ever."""
        made = engine_with((0.0, 0.0), spare=1)
        made.vacate(0)
        layout = made.world.layouts[0]
        bodies = list(layout.bodies)
        assert made.world.model.body_contype[bodies].any()
        for _ in range(500):
            made.advance(2)
        assert not made.world.model.body_contype[bodies].any()
        made.occupy(1, 0, pose_at(0.0, 0.0, 0.3))
        for _ in range(300):
            assert made.advance(2) == []
        assert whole_state(made, 1)[2] == pytest.approx(0.11, abs=0.01)


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slots are given back after two simulated seconds, however few."""
    monkeypatch.setattr(slots, "KEPT_FREE", 2.0)
    monkeypatch.setattr(slots, "LOOK_INTERVAL", 0.5)
    monkeypatch.setattr(slots, "LEAST_BODIES", 1)


def kinds(world: Simulation) -> list[str]:
    """Classes of all slots."""
    return [slot.key for slot in world._slots._engine.world.slots]


def wait_for(world: Simulation, expected: list[str]) -> None:
    """Wait until the slots are so."""
    end = time.monotonic() + PATIENCE
    while kinds(world) != expected:
        assert time.monotonic() < end, kinds(world)
        time.sleep(0.02)


@pytest.mark.usefixtures("hasty")
class TestWhen:
    """It happens after a while, at a moment of simulated time."""

    def test_after_a_while(self) -> None:
        """Nobody has been in a slot for the time that it is kept."""
        world = simulation()
        stays, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        leaves, _ = world.spawn(OTHER, pose_at(2.0, 0.0))
        world.remove(leaves)
        watcher = watched(world, stays, 0.1)
        world.run_until(1.9)
        assert kinds(world) == [ROBOT.key, OTHER.key]
        world.run_until(3.0)
        assert kinds(world) == [ROBOT.key]
        world.run_until(4.0)
        times = [snapshot.time for snapshot in watcher.snapshots]
        np.testing.assert_allclose(np.diff(times)[1:], 0.1, atol=1e-9)
        assert {snapshot.generation for snapshot in watcher.snapshots} == {2, 3}

    def test_who_comes_back_in_time_finds_a_slot(self) -> None:
        """Controllers that reconnect do not make the model grow each time."""
        world = simulation()
        stays, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        world.body(stays).attach(Watcher(0.1))
        for turns in range(5):
            other, _ = world.spawn(OTHER, pose_at(2.0, 0.0))
            world.run_until(1.5 * turns + 0.5)
            world.remove(other)
            world.run_until(1.5 * turns + 1.5)
        assert world.look().generation == 2

    def test_everybody_gone(self) -> None:
        """The world is as large as at first, and published."""
        world = simulation()
        robots = [world.spawn(ROBOT, pose_at(2.0 * number, 0.0))[0] for number in range(5)]
        empty = world.look()
        for robot in robots:
            world.remove(robot)
        world.run_until(4.0)
        assert kinds(world) == []
        assert len(world.snapshot.qpos) == len(world.look().qpos) == 0 < len(empty.qpos)

    def test_runs_repeat(self) -> None:
        """The same events at the same times give the same model at every step."""

        def play() -> list[tuple[float, int, bytes]]:
            world = simulation(yard)
            stays, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
            watcher = watched(world, stays, 0.05)
            world.body(stays).drive(turn(4.0))
            for number in range(4):
                other, _ = world.spawn(robot_model(f"kind {number}"), pose_at(-1.0, 2.0))
                world.run_until(1.3 * (number + 1))
                world.remove(other)
            world.run_until(9.0)
            return [(s.time, s.generation, s.qpos.tobytes()) for s in watcher.snapshots]

        first = play()
        assert first == play()
        generations = [generation for _, generation, _ in first]
        assert generations[-1] > 5, "it never shrank"

    def test_former_models_are_let_go(self) -> None:
        """A model lives as long as snapshots of it, not longer."""
        world = simulation()
        stays, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        leaves, _ = world.spawn(OTHER, pose_at(2.0, 0.0))
        old = world.look()
        model = weakref.ref(world.compiled(old))
        world.remove(leaves)
        watcher = watched(world, stays, 0.5)
        world.run_until(4.0)
        watcher.snapshots.clear()
        gc.collect()
        assert model() is not None
        assert world.object_facts(stays, old) is not None
        del old
        gc.collect()
        assert model() is None


@pytest.mark.usefixtures("hasty")
class TestMeanwhile:
    """At a pace the smaller model is made aside."""

    def test_the_world_goes_on(self) -> None:
        """It shrinks while robots drive."""
        world = simulation(speed=4.0)
        world.start()
        try:
            stays, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
            leaves, _ = world.spawn(OTHER, pose_at(2.0, 0.0))
            world.body(stays).drive(turn(3.0))
            world.remove(leaves)
            wait_for(world, [ROBOT.key])
            assert world.body(stays).wheel_targets().tolist() == turn(3.0).tolist()
        finally:
            world.stop()

    def test_who_comes_meanwhile_keeps_the_slot(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A model that lacks a slot somebody has taken by now is dropped."""
        begun, go_on = threading.Event(), threading.Event()
        real = Engine.grow

        def slow(self: Engine, added: object, replaced: object = {}) -> object:
            if VACANT in dict(replaced).values():  # type: ignore[call-overload]
                begun.set()
                assert go_on.wait(PATIENCE)
            return real(self, added, replaced)  # type: ignore[arg-type]

        monkeypatch.setattr(Engine, "grow", slow)
        world = simulation(speed=4.0)
        world.start()
        try:
            first, _ = world.spawn(OTHER, pose_at(0.0, 0.0))
            world.remove(first)
            assert begun.wait(PATIENCE)
            second, _ = world.spawn(OTHER, pose_at(0.0, 0.0))
            go_on.set()
            thread = world._slots._shrinking
            assert thread is not None
            thread.join(PATIENCE)
            assert kinds(world) == [OTHER.key]
            snapshot = world.look()
            state = world.body(second).state(snapshot)
            assert state is not None
            assert state.pose.position[2] == pytest.approx(0.11, abs=0.05)
            assert snapshot.generation == 1
        finally:
            world.stop()
