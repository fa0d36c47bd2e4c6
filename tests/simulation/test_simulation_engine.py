"""Slots, sleep, growth and snapshots of the physics engine."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    RADIUS,
    ROBOT,
    add_box,
    add_crate,
    base_qpos,
    base_qvel,
    crate,
    drive,
    engine_with,
    floor,
    furnished,
    pose_at,
    robot_model,
    run,
    straight,
    turn,
    whole_state,
    yard,
)

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import SHELF_HEIGHT, PhysicsOptions

OTHER = robot_model("other", center_of_mass=0.06)


def driving_engine(spare: int = 2) -> Engine:
    """Two robots on their way, far from each other, and spare slots."""
    engine = engine_with((0.0, 0.0), (0.0, 3.0), scenery=yard, spare=spare)
    engine.drive(0, straight(2.0))
    drive(engine, turn(2.0), 0.5, robot=1)
    return engine


class TestSlots:
    """Taking and leaving slots."""

    def test_free_slots_are_taken_lowest_first(self) -> None:
        """The lowest free slot of the class is offered; None when the class has run out."""
        engine = Engine(floor(), PhysicsOptions(), [ROBOT, OTHER, ROBOT])
        assert engine.free_slot(ROBOT.key) == 0
        assert engine.free_slot(OTHER.key) == 1
        engine.occupy(7, 0, pose_at(0.0, 0.0))
        assert engine.free_slot(ROBOT.key) == 2
        engine.occupy(8, 2, pose_at(1.0, 0.0))
        assert engine.free_slot(ROBOT.key) is None
        engine.vacate(7)
        assert engine.free_slot(ROBOT.key) == 0
        assert engine.free_slot("unheard of") is None

    def test_occupy_puts_the_robot_at_its_pose_at_rest(self) -> None:
        """An occupied slot stands where it was told, with every velocity and wheel angle zero."""
        engine = engine_with((0.0, 0.0))
        drive(engine, straight(3.0), 0.5)
        engine.vacate(0)
        engine.occupy(1, 0, pose_at(1.0, -2.0, 0.3, yaw=0.5))
        expected = [1.0, -2.0, 0.3, np.cos(0.25), 0.0, 0.0, np.sin(0.25)]
        np.testing.assert_allclose(base_qpos(engine, 1), expected)
        state = whole_state(engine, 1)
        assert not state[7:].any()

    def test_a_used_slot_forgets_its_commands(self) -> None:
        """A robot in a slot that was driven before stands still."""
        engine = engine_with((0.0, 0.0))
        drive(engine, straight(3.0), 0.5)
        engine.vacate(0)
        engine.occupy(1, 0, pose_at(0.0, 0.0))
        run(engine, 0.5)
        assert np.linalg.norm(base_qpos(engine, 1)[:2]) < 1e-4
        assert not engine.wheel_targets(1).any()

    def test_vacate_parks_and_is_forgiving(self) -> None:
        """A vacated slot is back on the shelf; a robot that is not there is no error."""
        engine = engine_with((0.0, 0.0))
        engine.vacate(0)
        engine.vacate(0)
        engine.vacate(99)
        assert engine.active == {}
        layout = engine.world.layouts[0]
        np.testing.assert_array_equal(
            engine.data.qpos[layout.qpos : layout.qpos + 7], engine.world.parking[0]
        )

    def test_commands_to_absent_robots_are_ignored(self) -> None:
        """Driving a robot that has left does nothing."""
        engine = engine_with((0.0, 0.0))
        engine.drive(5, straight(1.0))
        assert not engine.wheel_targets(0).any()

    def test_too_few_targets_are_refused(self) -> None:
        """They change nothing."""
        engine = engine_with((0.0, 0.0), (2.0, 0.0))
        engine.drive(0, straight(1.0))
        with pytest.raises(ValueError, match="broadcast"):
            engine.drive(0, np.ones(3))
        np.testing.assert_array_equal(engine.wheel_targets(0), straight(1.0))

    @pytest.mark.parametrize("method", ["occupy", "teleport"])
    def test_poses_must_be_finite(self, method: str) -> None:
        """A pose with a value that is not finite is refused and changes nothing."""
        engine = engine_with((0.0, 0.0), spare=1)
        before = engine.data.qpos.copy()
        arguments = (1, 1) if method == "occupy" else (0,)
        with pytest.raises(ValueError, match="finite"):
            getattr(engine, method)(*arguments, Pose((0.0, np.nan, 0.0)))
        np.testing.assert_array_equal(engine.data.qpos, before)
        assert engine.active == {0: 0}

    def test_teleport_moves_at_rest(self) -> None:
        """A teleported robot is at the new pose at once, without its former speed."""
        engine = driving_engine()
        engine.teleport(0, pose_at(5.0, 5.0))
        np.testing.assert_array_equal(base_qpos(engine, 0)[:3], (5.0, 5.0, RADIUS))
        assert not base_qvel(engine, 0).any()
        snapshot = engine.snapshot()
        np.testing.assert_array_equal(snapshot.xpos[snapshot.layouts[0].base], (5.0, 5.0, RADIUS))


class TestOthersAreLeftAlone:
    """What happens to one robot does not touch the state of another."""

    def test_occupy_and_vacate(self) -> None:
        """Coming and going changes not one bit of the others, then or later."""
        quiet, busy = driving_engine(), driving_engine()
        for moment in range(6):
            before = [whole_state(busy, robot) for robot in (0, 1)]
            if moment % 2 == 0:
                busy.occupy(2 + moment, 2, pose_at(-6.0, -6.0))
            else:
                busy.vacate(1 + moment)
            for robot in (0, 1):
                np.testing.assert_array_equal(whole_state(busy, robot), before[robot])
            run(busy, 0.1)
            run(quiet, 0.1)
        for robot in (0, 1):
            np.testing.assert_array_equal(whole_state(busy, robot), whole_state(quiet, robot))

    def test_teleport(self) -> None:
        """Moving one robot does not disturb another; later they differ by rounding at most."""
        quiet, busy = driving_engine(), driving_engine()
        busy.teleport(1, pose_at(-6.0, 3.0))
        np.testing.assert_array_equal(whole_state(busy, 0), whole_state(quiet, 0))
        run(busy, 0.4)
        run(quiet, 0.4)
        np.testing.assert_allclose(whole_state(busy, 0), whole_state(quiet, 0), atol=1e-12)

    def test_growth(self) -> None:
        """Growing keeps every coordinate and velocity exactly, also of crates and doors."""
        engine = driving_engine(spare=0)
        hinge = engine.data.joint("hinge")
        hinge.qvel[0] = 0.5
        run(engine, 0.1)
        states = [whole_state(engine, robot) for robot in (0, 1)]
        door = (hinge.qpos[0], hinge.qvel[0])
        crate = engine.data.body("crate1").xpos.copy()
        engine.adopt(engine.grow([OTHER, ROBOT]))
        for robot in (0, 1):
            np.testing.assert_array_equal(whole_state(engine, robot), states[robot])
        hinge = engine.data.joint("hinge")
        assert (hinge.qpos[0], hinge.qvel[0]) == door
        np.testing.assert_allclose(engine.data.body("crate1").xpos, crate, atol=1e-12)
        assert engine.world.generation == 1
        assert [slot.key for slot in engine.world.slots] == ["P3AT_real"] * 2 + [
            "other",
            "P3AT_real",
        ]

    def test_motion_continues_after_growth(self) -> None:
        """A world that grew goes on as one that did not, commands included."""
        quiet, grown = driving_engine(spare=0), driving_engine(spare=0)
        quiet.drive(0, straight(4.0))
        grown.drive(0, straight(4.0))
        quiet.advance(2)
        grown.advance(2)  # in the middle of the ramp
        grown.adopt(grown.grow([ROBOT]))
        run(quiet, 1.0)
        run(grown, 1.0)
        # The solver stops a little earlier or later in a larger model.
        for robot in (0, 1):
            np.testing.assert_allclose(
                whole_state(grown, robot), whole_state(quiet, robot), atol=1e-5
            )
        assert grown.time == quiet.time
        np.testing.assert_array_equal(grown.wheel_targets(0), straight(4.0))

    def test_growth_happens_aside(self) -> None:
        """The running world may go on while the larger one is compiled."""
        engine = driving_engine(spare=0)
        growth = engine.grow([ROBOT])
        run(engine, 0.3)
        states = [whole_state(engine, robot) for robot in (0, 1)]
        engine.adopt(growth)
        for robot in (0, 1):
            np.testing.assert_array_equal(whole_state(engine, robot), states[robot])


class TestSleep:
    """Robots that do nothing cost nothing, and wake when they have to."""

    def test_parked_robots_sleep_from_the_start(self) -> None:
        """In a fresh world of parked robots no tree is awake."""
        engine = Engine(floor(), PhysicsOptions(), [ROBOT] * 8)
        engine.advance(2)
        assert engine.data.ntree_awake == 0
        assert engine.data.nefc == 0

    def test_only_the_driven_robot_is_awake(self) -> None:
        """Seven parked robots beside one that drives are not simulated."""
        engine = engine_with((0.0, 0.0), spare=7)
        drive(engine, straight(2.0), 0.5)
        assert engine.data.ntree_awake == 1

    def test_idle_robots_fall_asleep(self) -> None:
        """A robot without commands sleeps within two seconds, and a vacated one again."""
        engine = engine_with((0.0, 0.0), (1.0, 0.0), spare=1)
        run(engine, 2.0)
        assert engine.data.ntree_awake == 0
        engine.vacate(0)
        engine.advance(1)
        assert engine.data.ntree_awake == 1
        run(engine, 2.0)
        assert engine.data.ntree_awake == 0

    @pytest.mark.parametrize("speed", [0.0, 5e-324, -1e-310, 1e-30, -9e-7])
    def test_a_speed_that_moves_nothing_lets_sleep(self, speed: float) -> None:
        """A command of nearly nothing costs no more than that of nothing."""
        engine = engine_with((0.0, 0.0))
        engine.drive(0, straight(speed))
        run(engine, 2.0)
        assert engine.data.ntree_awake == 0

    def test_drive_wakes(self) -> None:
        """A sleeping robot obeys the next command, and only it wakes."""
        engine = engine_with((0.0, 0.0), (5.0, 0.0))
        run(engine, 2.0)
        assert engine.data.ntree_awake == 0
        engine.drive(1, straight(3.0))
        engine.advance(1)
        assert engine.data.ntree_awake == 1
        run(engine, 1.0)
        assert base_qpos(engine, 1)[0] > 5.2
        assert base_qpos(engine, 0)[0] == pytest.approx(0.0, abs=1e-6)

    def test_teleport_wakes(self) -> None:
        """A sleeping robot that is put into the air falls."""
        engine = engine_with((0.0, 0.0))
        run(engine, 2.0)
        engine.teleport(0, pose_at(0.0, 0.0, 1.0))
        run(engine, 1.0)
        assert base_qpos(engine, 0)[2] == pytest.approx(RADIUS, abs=0.01)

    @pytest.mark.parametrize("grown", [False, True])
    def test_a_crawling_robot_stays_awake(self, grown: bool) -> None:
        """A robot that is told to crawl slower than what counts as rest does crawl, then sleeps."""
        engine = engine_with((0.0, 0.0))
        run(engine, 2.0)
        engine.drive(0, straight(0.0008))
        if grown:
            engine.adopt(engine.grow([ROBOT]))
        start = base_qpos(engine, 0)[0]
        run(engine, 20.0)
        assert base_qpos(engine, 0)[0] - start == pytest.approx(20.0 * 0.0008 * RADIUS, rel=0.01)
        drive(engine, straight(0.0), 2.0)
        assert engine.data.ntree_awake == 0

    def test_a_stalled_robot_goes_on(self) -> None:
        """A robot too weak to push what blocks it goes on as soon as that is taken away."""
        weak = robot_model("weak", torque=1.0)
        engine = Engine(floor(), PhysicsOptions(), [weak, ROBOT])
        engine.occupy(0, 0, pose_at(0.0, 0.0))
        engine.occupy(1, 1, pose_at(0.52, 0.0))
        engine.drive(1, straight(0.0))  # parks with its brake on
        drive(engine, straight(2.0), 4.0)
        stalled = base_qpos(engine, 0)[0]
        assert np.abs(base_qvel(engine, 0)[:3]).max() < 0.005
        engine.vacate(1)
        run(engine, 1.0)
        assert base_qpos(engine, 0)[0] > stalled + 0.1

    @pytest.mark.parametrize("grown", [False, True])
    def test_a_crate_falls_when_its_robot_leaves(self, grown: bool) -> None:
        """What slept on a robot wakes when the robot is taken away, also in a model that grew."""
        scenery = furnished(crate("load", (0.0, 0.0, 0.30), half=0.08, mass=1.0))
        engine = engine_with((0.0, 0.0), scenery=scenery)
        run(engine, 3.0)
        assert engine.data.ntree_awake == 0
        if grown:
            engine.adopt(engine.grow([ROBOT]))
            run(engine, 3.0)
            assert engine.data.ntree_awake == 0
        assert engine.data.body("load").xpos[2] > 0.2
        engine.vacate(0)
        run(engine, 2.0)
        assert engine.data.body("load").xpos[2] == pytest.approx(0.08, abs=0.005)


class TestSnapshot:
    """Pictures of one instant."""

    def test_time_and_step(self) -> None:
        """Time is steps times the time step, without accumulated rounding."""
        engine = engine_with((0.0, 0.0), timestep=0.001)
        for _ in range(1000):
            engine.advance(1)
        snapshot = engine.snapshot()
        assert (snapshot.step, snapshot.time) == (1000, 1.0)

    def test_arrays_are_copies_and_read_only(self) -> None:
        """A snapshot does not change with the world and cannot be written to."""
        engine = driving_engine()
        snapshot = engine.snapshot()
        kept = snapshot.qpos.copy()
        run(engine, 0.1)
        np.testing.assert_array_equal(snapshot.qpos, kept)
        for array in (snapshot.qpos, snapshot.qvel, snapshot.xpos, snapshot.xquat):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0

    def test_bodies_belong_to_the_same_instant_as_coordinates(self) -> None:
        """Body poses in a snapshot are those of its coordinates, not of half a step earlier."""
        engine = driving_engine()
        snapshot = engine.snapshot()
        layout = snapshot.layouts[0]
        np.testing.assert_array_equal(
            snapshot.xpos[layout.base], snapshot.qpos[layout.qpos : layout.qpos + 3]
        )

    def test_only_active_robots_have_layouts(self) -> None:
        """Parked slots do not show up among the robots."""
        engine = driving_engine(spare=2)
        assert set(engine.snapshot().layouts) == {0, 1}


class TestRest:
    """Robots that stand still (robots reference 5.3)."""

    def test_resting_robot_hardly_sinks(self) -> None:
        """Robots 63: a resting 12 kg robot penetrates the floor by less than 1 mm."""
        engine = engine_with((0.0, 0.0))
        run(engine, 1.0)
        engine.data.qvel[:] = 1e-3  # awake, so that its contacts are listed
        engine.advance(1)
        assert -0.001 < engine.data.contact.dist.min() <= 0.0

    @pytest.mark.parametrize("sleep", [True, False])
    def test_resting_robot_stays(self, sleep: bool) -> None:
        """Robots 64: at rest it stays within 1 mm and 0.1 degrees for 60 s."""
        engine = engine_with((0.0, 0.0))
        if not sleep:
            engine.world.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        run(engine, 1.0)
        before = base_qpos(engine, 0)
        run(engine, 60.0 if sleep else 20.0)
        after = base_qpos(engine, 0)
        assert np.linalg.norm(after[:3] - before[:3]) < 0.001
        assert 2 * np.arccos(min(1.0, abs(after[3:] @ before[3:]))) < np.radians(0.1)

    def test_no_body_jumps(self) -> None:
        """Robots 62: driving over a curb into crates moves no body 0.1 m in a step."""

        def scenery() -> mujoco.MjSpec:
            spec = yard()
            add_box(spec, "curb", (1.2, 0.0, 0.03), (0.1, 1.0, 0.03))
            add_crate(spec, "crate2", (2.0, 0.0, 0.15))
            return spec

        engine = engine_with((0.0, 0.0), (-2.0, 0.2), scenery=scenery)
        engine.drive(0, straight(6.0))
        engine.drive(1, straight(6.0))
        last = engine.snapshot().xpos
        longest = 0.0
        for _ in range(1000):
            assert engine.advance(1) == []
            now = engine.snapshot().xpos
            longest = max(longest, float(np.linalg.norm(now - last, axis=1).max()))
            last = now
        assert 0.0 < longest < 0.1
        assert base_qpos(engine, 0)[0] > 1.2

    def test_parking_places_are_apart_and_high(self) -> None:
        """Any number of parked robots stands on the shelf, each clear of the next."""
        engine = Engine(floor(), PhysicsOptions(), [ROBOT] * 40)
        places = engine.world.parking[:, :3]
        apart = np.linalg.norm(places[:, None] - places[None], axis=2)
        assert apart[~np.eye(len(places), dtype=bool)].min() >= 6.0
        engine.data.qvel[:] = -0.0  # wakes everybody
        run(engine, 0.4)
        heights = [engine.data.qpos[layout.qpos + 2] for layout in engine.world.layouts]
        np.testing.assert_allclose(heights, SHELF_HEIGHT + RADIUS, atol=0.001)
