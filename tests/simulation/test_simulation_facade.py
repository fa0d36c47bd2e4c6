"""The simulation as the rest of the server uses it."""

from __future__ import annotations

import logging
import math
import threading
import time
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    RADIUS,
    ROBOT,
    ROGUE,
    Start,
    Watcher,
    in_parallel,
    populated,
    pose_at,
    robot_model,
    simulation,
    straight,
    wait_until,
    watched,
)

from usarsim_server.base.errors import SpawnError, UsarsimError
from usarsim_server.simulation import simulation as module
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import RobotModel
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.testing import PATIENCE


def position(world: Simulation, robot: int) -> np.ndarray:
    """Where a robot is now."""
    snapshot = world.look()
    state = world.body(robot).state(snapshot)
    assert state is not None
    return np.array(state.pose.position)


class TestSpawn:
    """Robots come."""

    def test_gives_number_and_pose(self) -> None:
        """A spawn tells the robot's number and where it really is."""
        world = simulation()
        robot, pose = world.spawn(ROBOT, pose_at(1.0, 2.0))
        assert pose == pose_at(1.0, 2.0)
        np.testing.assert_allclose(position(world, robot), (1.0, 2.0, RADIUS))

    def test_numbers_are_never_used_again(self) -> None:
        """A new robot has a new number, whatever became of the others."""
        world = simulation()
        first, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        world.remove(first)
        world.settle()
        second, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        assert second != first

    def test_first_and_later_view_agree(self) -> None:
        """Protocol 63: spawned on the floor, it is where it was put a while later."""
        world = simulation()
        robot, pose = world.spawn(ROBOT, pose_at(1.0, 2.0, RADIUS, yaw=0.7))
        world.run_until(1.0)
        np.testing.assert_allclose(position(world, robot), pose.position, atol=0.001)

    @pytest.mark.parametrize("speed", [1.0, float("inf")])
    def test_from_many_threads(self, start: Start, speed: float) -> None:
        """Robots spawned by many threads at once all arrive, apart, with numbers of their own."""
        world = start(speed=speed)
        models = [ROBOT, robot_model("other")]
        found: dict[int, Pose] = {}

        def spawn(number: int) -> None:
            robot, pose = world.spawn(models[number % 2], pose_at(0.0, 0.0))
            found[robot] = pose

        in_parallel(spawn, *range(8))
        assert sorted(found) == list(range(8))
        places = np.array([pose.position for pose in found.values()])
        apart = np.linalg.norm(places[:, None] - places[None], axis=2) + 9.0 * np.eye(8)
        assert apart.min() > 0.3
        assert set(world.look().layouts) == set(found)

    def test_world_can_be_full(self) -> None:
        """Beyond the allowed number robots are refused until one leaves."""
        world = simulation(max_robots=2)
        robots = [world.spawn(ROBOT, pose_at(0.0, 1.0 * k))[0] for k in range(2)]
        with pytest.raises(SpawnError, match="full"):
            world.spawn(robot_model("other"), pose_at(5.0, 0.0))
        world.remove(robots[0])
        world.settle()
        world.spawn(ROBOT, pose_at(0.0, 0.0))

    def test_full_world_counts_over_threads(self, start: Start) -> None:
        """Also when many threads try at once, not one robot too many gets in."""
        world = start(max_robots=3)
        refused: list[SpawnError] = []

        def spawn(number: int) -> None:
            try:
                world.spawn(ROBOT, pose_at(0.0, 1.0 * number))
            except SpawnError as error:
                refused.append(error)

        in_parallel(spawn, *range(7))
        assert len(refused) == 4
        assert len(world.look().layouts) == 3

    def test_a_class_that_cannot_be_built(self) -> None:
        """A robot that MuJoCo refuses is a spawn error; the world stays as it was."""

        def broken() -> mujoco.MjSpec:
            spec = mujoco.MjSpec()
            base = spec.worldbody.add_body(name="base")
            base.add_freejoint(name="free")
            return spec

        world = simulation()
        with pytest.raises(SpawnError, match="broken"):
            world.spawn(RobotModel("broken", broken, (), 0.1), pose_at(0.0, 0.0))
        world.spawn(ROBOT, pose_at(0.0, 0.0))
        assert len(world.look().layouts) == 1

    def test_a_failed_spawn_leaves_no_trace(self) -> None:
        """A refused pose costs neither a slot nor a number, and lockstep goes on."""
        world = simulation(max_robots=1)
        with pytest.raises(SpawnError):
            world.spawn(ROBOT, pose_at(math.inf, 0.0))
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        assert robot == 0
        world.run_until(0.1)

    @pytest.mark.parametrize("x", [-math.inf, math.inf, math.nan])
    def test_nonsense_does_not_make_the_world_larger(self, x: float) -> None:
        """Of a class that is new to the world nothing is compiled for an impossible place, be it a
        robot or a thing."""
        world = simulation()
        for robot in (True, False):
            stranger = replace(robot_model(key=f"stranger{robot}"), robot=robot)
            with pytest.raises(SpawnError, match="not finite"):
                world.spawn(stranger, pose_at(x, 0.0))
        assert world.look().generation == 0
        world.spawn(robot_model(key="stranger"), pose_at(0.0, 0.0))
        assert world.look().generation == 1

    def test_who_has_left_is_not_waited_for(self) -> None:
        """What nobody wants any more when its turn comes costs no compilation and no slot."""
        world = simulation()
        with pytest.raises(SpawnError, match="nobody"):
            world.spawn(ROBOT, pose_at(0.0, 0.0), lambda: False)
        assert world.look().generation == 0
        world.spawn(ROBOT, pose_at(0.0, 0.0), lambda: True)
        assert len(world.look().layouts) == 1

    def test_growth_does_not_disturb(self) -> None:
        """A robot that drives while others come moves as if they had not come."""
        ends = []
        for visitors in (0, 5):
            world, robot = populated()
            world.body(robot).drive(straight(3.0))
            for number in range(visitors):
                world.run_until(0.1 * number)
                world.spawn(ROBOT, pose_at(-5.0, 1.0 * number))
            world.run_until(1.0)
            ends.append(position(world, robot))
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


class TestRequests:
    """Commands to robots."""

    def test_drive_and_teleport(self) -> None:
        """A robot drives from where it was put, and its commands can be read back."""
        world, robot = populated()
        world.body(robot).drive(straight(3.0))
        world.settle()
        np.testing.assert_array_equal(world.body(robot).wheel_targets(), straight(3.0))
        world.run_until(1.0)
        assert position(world, robot)[0] > 0.2
        world.body(robot).teleport(pose_at(-3.0, 1.0))
        world.settle()
        np.testing.assert_allclose(position(world, robot), (-3.0, 1.0, RADIUS))

    def test_absent_robots_are_ignored(self) -> None:
        """Requests for a robot that is not there do nothing."""
        world = simulation()
        world.body(3).drive(straight(1.0))
        world.body(3).teleport(pose_at(0.0, 0.0))
        world.remove(3)
        world.run_until(0.1)
        assert world.body(3).state(world.look()) is None

    def test_senseless_requests_are_refused_at_once(self) -> None:
        """Numbers that are not finite are refused where they are given."""
        world, robot = populated()
        with pytest.raises(ValueError, match="finite"):
            world.body(robot).drive(np.array([1.0, np.inf, 1.0, 1.0]))
        with pytest.raises(ValueError, match="finite"):
            world.body(robot).teleport(Pose((0.0, 0.0, float("inf"))))
        for value in (math.nan, math.inf):
            with pytest.raises(ValueError, match="finite"):
                world.body(robot).command_law(np.array([value, 0.0]))
            lift = {"pan": JointOrder(Order(0), 0.3), "lift": JointOrder(Order(0), value)}
            with pytest.raises(ValueError, match="finite"):
                world.body(robot).command_joints(lift)

    def test_a_bad_request_does_not_stop_the_world(
        self, start: Start, caplog: pytest.LogCaptureFixture
    ) -> None:
        """A command with the wrong number of wheels is logged, and everything goes on."""
        world = start()
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        with caplog.at_level(logging.ERROR, "usarsim"):
            world.body(robot).drive(np.ones(3))
            world.body(robot).drive(straight(2.0))
            np.testing.assert_array_equal(world.body(robot).wheel_targets(), straight(2.0))
        assert "request" in caplog.text


class TestLosses:
    """Robots that the world cannot keep."""

    def test_a_fallen_robot_is_removed(self, caplog: pytest.LogCaptureFixture) -> None:
        """A robot below the world is taken out; its listener is told and not woken any more."""
        world = simulation(mujoco.MjSpec, lower=(-10.0, -10.0, -3.0))
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0, 1.0))
        watcher, other = Watcher(0.02), Watcher(0.02)
        world.body(robot).attach(watcher)
        with caplog.at_level(logging.WARNING, "usarsim"):
            world.run_until(2.0)
        assert watcher.reasons == ["it fell out of the world"]
        assert robot not in world.look().layouts
        assert "robot removed" in caplog.text
        again, _ = world.spawn(ROBOT, pose_at(0.0, 0.0, 1.0))
        world.body(again).attach(other)
        world.run_until(2.1)
        assert other.snapshots

    def test_a_robot_that_goes_mad_is_removed(self) -> None:
        """A robot that diverges leaves; its listener is told, the others go on."""
        world = simulation()
        rogue, _ = world.spawn(ROGUE, pose_at(0.0, 0.0))
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 2.0))
        watchers = Watcher(0.1), Watcher(0.1)
        world.body(rogue).attach(watchers[0])
        world.body(robot).attach(watchers[1])
        world.body(rogue).drive(straight(5.0))
        world.body(robot).drive(straight(2.0))
        world.run_until(2.0)
        assert len(watchers[0].reasons) == 1
        assert watchers[1].reasons == []
        assert position(world, robot)[0] > 0.3
        times = [snapshot.time for snapshot in watchers[1].snapshots]
        assert (np.diff(times) > 0.0).all()
        assert len(times) == 21


class TestSnapshots:
    """Pictures of the world."""

    def test_old_snapshots_can_still_be_looked_at(self) -> None:
        """Rays through a snapshot of former generations hit what was there then."""
        world, robot = populated()
        target, _ = world.spawn(ROBOT, pose_at(2.0, 0.0))
        old = world.look()
        for number in range(3):
            world.spawn(robot_model(f"class {number}"), pose_at(0.0, 3.0 + number))
        world.remove(target)
        world.settle()
        fan = RayFan(np.array([0.3, 0.0, 0.15]), np.array([[1.0, 0.0, 0.0]]), 20.0)
        (then,) = world.cast([fan], old, robot)
        (now,) = world.cast([fan], world.look(), robot)
        assert old.generation < world.look().generation
        assert then.distances[0] == pytest.approx(1.5, abs=0.01)
        assert np.isinf(now.distances[0])

    def test_published_snapshots_are_of_wakes(self) -> None:
        """The published snapshot is the one that the last listener was woken with."""
        world, robot = populated()
        watcher = watched(world, robot, 0.1)
        world.run_until(0.55)
        assert world.snapshot is watcher.snapshots[-1]
        assert world.look().time == pytest.approx(0.552)


class TestRunning:
    """Starting, pacing and stopping."""

    @pytest.mark.parametrize("speed", [1.0, 4.0])
    def test_paced_time_never_runs_ahead_of_wall_time(self, start: Start, speed: float) -> None:
        """At a paced speed simulated time follows the wall clock; how fast the machine decides."""
        started = time.monotonic()
        world = start(speed=speed)
        wait_until(lambda: world.look().time > 0.5 * speed)
        assert world.look().time < (time.monotonic() - started + 0.1) * speed

    def test_lockstep_knows_no_pace(self, start: Start) -> None:
        """In lockstep time passes although nobody looks at a clock."""
        world = start()
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        watched(world, robot, 0.5)
        wait_until(lambda: world.look().time > 5.0)

    def test_run_until_stops_at_the_step(self) -> None:
        """Advancing by hand ends at the first step that is not before the moment."""
        world = simulation(timestep=0.004)
        world.run_until(0.25)
        assert world.look().time == pytest.approx(0.252)
        world.run_until(0.252)
        assert world.look().time == pytest.approx(0.252)

    def test_spawn_before_the_start(self) -> None:
        """Who made the world may look and spawn before its thread runs, without waiting."""
        world, robot = populated()
        assert robot in world.look().layouts

    def test_nobody_waits_after_the_stop(self, start: Start) -> None:
        """After the stop every question is refused at once instead of timing out."""
        world = start()
        world.stop()
        with pytest.raises(UsarsimError, match="ended"):
            world.spawn(ROBOT, pose_at(0.0, 0.0))
        with pytest.raises(UsarsimError, match="ended"):
            world.look()
        world.body(0).drive(straight(1.0))
        world.remove(0)

    def test_stop_by_hand(self) -> None:
        """A world that is run by hand does not run on after its stop."""
        world = simulation()
        world.stop()
        world.run_until(5.0)
        assert world.snapshot.time == 0.0

    def test_a_dead_physics_thread_is_reported(
        self, start: Start, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """If the physics thread dies the log says why, and nobody waits for it."""
        monkeypatch.setattr(threading, "excepthook", lambda _: None)
        world = start(speed=1.0)

        def fail(steps: int) -> list[int]:
            raise RuntimeError("out of order")

        with caplog.at_level(logging.ERROR, "usarsim"):
            monkeypatch.setattr(world._engine, "advance", fail)
            assert world._stepper._thread is not None
            world._stepper._thread.join(PATIENCE)
        assert "out of order" in caplog.text
        with pytest.raises(UsarsimError, match="ended"):
            world.look()

    def test_a_wrong_release_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """No world is made with a MuJoCo that is known to be wrong."""

        def refuse() -> None:
            raise UsarsimError("not this one")

        monkeypatch.setattr(module, "check_mujoco_version", refuse)
        with pytest.raises(UsarsimError, match="not this one"):
            simulation()

    def test_mujoco_warnings_go_to_the_log(self, caplog: pytest.LogCaptureFixture) -> None:
        """What MuJoCo has to say appears in our log, in one line, not in a file."""
        world, robot = populated()
        world._engine.data.qvel[world.look().layouts[robot].dof] = np.nan
        with caplog.at_level(logging.WARNING, "usarsim"):
            world.run_until(0.1)
        lines = [record.getMessage() for record in caplog.records]
        assert any("unstable" in line for line in lines)
        assert not any("\n" in line for line in lines)
