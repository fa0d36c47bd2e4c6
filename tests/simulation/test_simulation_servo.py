"""Ramps, brakes and torque of the wheel servos (robots reference 4.4)."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    RADIUS,
    ROBOT,
    base_qpos,
    base_qvel,
    drive,
    engine_with,
    floor,
    pose_at,
    robot_model,
    run,
    straight,
    turn,
    whole_state,
)

from usarsim_server.simulation import growth
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions, compile_world
from usarsim_server.simulation.servos import HOLD_SPEED, WheelServos

SLOPE = np.radians(15.0)
HOVER = RADIUS / np.cos(SLOPE)
"""Height of the axles over the foot of a slope at which the wheels touch it, m."""


NO_DATA = mujoco.MjData(mujoco.MjSpec().compile())
"""Wheel servos keep nothing in the state of the physics."""


def servos(*slots: object, timestep: float = 0.004) -> WheelServos:
    """Servos of a world of test robots."""
    models = slots or (ROBOT,)
    world = compile_world(floor(), models, PhysicsOptions(timestep=timestep), 0)  # type: ignore[arg-type]
    return WheelServos(world)


def angles(value: float = 0.0) -> np.ndarray:
    """Coordinates of a world with one robot, all wheels at an angle (rad)."""
    return np.full(11, value)


class TestRamp:
    """Set points follow commands with limited acceleration."""

    def test_acceleration_is_limited(self) -> None:
        """With 10 rad/s^2 a command of 3 rad/s is reached after 0.3 s, in equal steps."""
        servo = servos()
        servo.command(0, straight(3.0))
        seen = []
        for _ in range(80):
            servo.update(angles())
            seen.append(servo.setpoints(0)[0])
        np.testing.assert_allclose(seen[:75], 0.04 * np.arange(1, 76), atol=1e-12)
        assert seen[75:] == [3.0] * 5

    def test_ramp_does_not_depend_on_the_time_step(self) -> None:
        """After 0.2 s the set point is the same at 1 and 5 ms."""
        ends = []
        for timestep in (0.001, 0.005):
            servo = servos(timestep=timestep)
            servo.command(0, straight(3.0))
            for _ in range(round(0.2 / timestep)):
                servo.update(angles())
            ends.append(servo.setpoints(0))
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)
        np.testing.assert_allclose(ends[0], 2.0)

    def test_wheels_ramp_separately(self) -> None:
        """Each wheel has its own command and reaches it exactly."""
        servo = servos()
        targets = np.array([1.0, -2.0, 0.3, 0.0])
        servo.command(0, targets)
        for _ in range(100):
            servo.update(angles())
        np.testing.assert_array_equal(servo.setpoints(0), targets)

    def test_braking_has_a_rate_of_its_own(self) -> None:
        """A class may brake harder than it accelerates, also on the way to the other direction."""
        servo = servos(replace(ROBOT, wheel_deceleration=40.0))
        servo.command(0, straight(2.0))
        for _ in range(60):
            servo.update(angles())
        servo.command(0, np.array([0.0, -2.0, 1.0, 3.0]))
        servo.update(angles())
        np.testing.assert_allclose(servo.setpoints(0), [1.84, 1.84, 1.84, 2.04])
        for _ in range(12):
            servo.update(angles())
        assert servo.setpoints(0)[0] == 0.0
        before = servo.setpoints(0)[1]
        servo.update(angles())
        assert before < 0.0
        assert servo.setpoints(0)[1] - before == pytest.approx(-0.04)

    def test_slots_are_separate(self) -> None:
        """A command to one slot does not reach another, nor its release."""
        servo = servos(ROBOT, ROBOT)
        servo.command(0, straight(1.0))
        servo.command(1, straight(-1.0))
        for _ in range(30):
            servo.update(np.zeros(22))
        servo.release(0, NO_DATA)
        servo.update(np.zeros(22))
        assert not servo.setpoints(0).any()
        np.testing.assert_array_equal(servo.setpoints(1), straight(-1.0))
        np.testing.assert_array_equal(servo.targets(1), straight(-1.0))

    def test_targets_are_copies(self) -> None:
        """Whoever reads the targets cannot change them."""
        servo = servos()
        servo.command(0, straight(1.0))
        servo.targets(0)[:] = 9.0
        np.testing.assert_array_equal(servo.targets(0), straight(1.0))


class TestBrake:
    """Wheels are held after a while of zero command."""

    def braked(self) -> WheelServos:
        """Servos whose brake has just engaged at the angle 1 rad."""
        servo = servos()
        servo.command(0, straight(0.0))
        for _ in range(74):
            servo.update(angles(1.0))
        return servo

    def test_engages_after_the_delay(self) -> None:
        """Before 0.3 s a displaced wheel is left alone, afterwards it is driven back."""
        servo = self.braked()
        servo.update(angles(1.0))
        servo.update(angles(1.0))
        servo.update(angles(1.1))
        np.testing.assert_allclose(servo.setpoints(0), -1.0)

    def test_is_gentle(self) -> None:
        """A wheel that was dragged far is not thrown back."""
        servo = self.braked()
        servo.update(angles(1.0))
        servo.update(angles(50.0))
        np.testing.assert_allclose(servo.setpoints(0), -HOLD_SPEED)

    def test_lets_go(self) -> None:
        """Any command ends the brake at once, and a new one holds the new angle."""
        servo = self.braked()
        servo.update(angles(1.0))
        servo.update(angles(1.0))
        servo.command(0, straight(0.02))
        servo.update(angles(1.2))
        np.testing.assert_allclose(servo.setpoints(0), 0.02)
        servo.command(0, straight(0.0))
        for _ in range(90):
            servo.update(angles(5.0))
        np.testing.assert_allclose(servo.setpoints(0), 0.0)

    def test_a_robot_without_commands_has_no_brake(self) -> None:
        """A robot that never got a command is not held: its wheels are at zero speed only."""
        servo = servos()
        for _ in range(200):
            servo.update(angles(1.0))
        servo.update(angles(2.0))
        assert not servo.setpoints(0).any()

    @pytest.mark.parametrize("gain", [20.0, 200.0])
    def test_holds_on_a_slope(self, gain: float) -> None:
        """V16: parked on 15 degrees it creeps less than 6 mm/s over 10 s (robots 53)."""
        engine = engine_with(
            (0.0, 0.0, HOVER), scenery=floor(slope=SLOPE), model=robot_model(gain=gain)
        )
        drive(engine, straight(0.0), 1.0)
        before = base_qpos(engine, 0)[:3]
        run(engine, 10.0)
        assert np.linalg.norm(base_qpos(engine, 0)[:3] - before) / 10.0 < 0.006

    def test_without_brake_it_creeps(self) -> None:
        """With weak servos and no brake the same robot rolls: the test before can fail."""
        model = robot_model(gain=5.0, brake_delay=1e9)
        engine = engine_with((0.0, 0.0, HOVER), scenery=floor(slope=SLOPE), model=model)
        drive(engine, straight(0.0), 1.0)
        before = base_qpos(engine, 0)[:3]
        run(engine, 2.0)
        assert np.linalg.norm(base_qpos(engine, 0)[:3] - before) / 2.0 > 0.006

    def test_drives_off_from_the_brake(self) -> None:
        """A parked robot climbs on when it is told to."""
        engine = engine_with((0.0, 0.0, HOVER), scenery=floor(slope=SLOPE))
        drive(engine, straight(0.0), 2.0)
        drive(engine, straight(3.0), 2.0)
        assert base_qpos(engine, 0)[0] > 0.4


class EveryStep(WheelServos):
    """Servos without the shortcut for steady wheels."""

    def update(self, qpos: np.ndarray) -> None:
        """Work every step."""
        self._steady = False
        super().update(qpos)


class TestShortcut:
    """Nothing is computed while every wheel runs at its commanded speed."""

    def test_gives_the_same_motion(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A drive with ramps, a stop, a brake and a removal is the same to the bit."""
        states = []
        for kind in (WheelServos, EveryStep):
            monkeypatch.setattr(growth, "WheelServos", kind)
            engine = engine_with((0.0, 0.0), (0.0, 2.0), spare=1)
            engine.drive(0, straight(2.0))
            drive(engine, turn(1.0), 0.5, robot=1)
            drive(engine, straight(0.0), 1.0, robot=1)
            engine.drive(1, straight(-1.0))
            engine.occupy(2, 2, pose_at(0.0, 4.0))
            run(engine, 0.5)
            engine.vacate(0)
            run(engine, 0.5)
            states.append(np.concatenate([engine.data.qpos, engine.data.qvel]))
        np.testing.assert_array_equal(states[0], states[1])

    def test_is_taken(self) -> None:
        """A steadily driving robot needs no work in the servos."""
        engine = engine_with((0.0, 0.0), (2.0, 0.0))
        drive(engine, straight(2.0), 0.5)
        assert engine.parts.wheels._steady


class TestFree:
    """Wheels whose target is not a number roll along."""

    def test_the_other_wheels_move_the_robot(self) -> None:
        """Driven in front only, the robot runs as fast as those wheels, and none drags."""
        engine = engine_with((0.0, 0.0))
        drive(engine, np.array([2.0, 2.0, np.nan, np.nan]), 1.5)
        assert base_qvel(engine, 0)[0] == pytest.approx(2.0 * RADIUS, rel=0.005)

    def test_braked_where_it_is(self) -> None:
        """A free wheel that is told to stop stays where it then is; so does the whole robot."""
        engine = engine_with((0.0, 0.0))
        drive(engine, np.array([2.0, 2.0, np.nan, np.nan]), 1.5)
        drive(engine, straight(0.0), 0.5)
        there = base_qpos(engine, 0)[0]
        run(engine, 1.0)
        assert base_qpos(engine, 0)[0] == pytest.approx(there, abs=1e-3)

    def test_they_are_free_in_a_larger_generation_too(self) -> None:
        """Growing carries it over, leaving ends it."""
        engine = engine_with((0.0, 0.0))
        engine.drive(0, np.array([2.0, 2.0, np.nan, np.nan]))
        engine.adopt(engine.grow([ROBOT]))
        wheels = engine.world.layouts[0].wheel_dof
        assert (engine.world.model.dof_frictionloss[wheels] > 0.0).tolist() == [True, True, 0, 0]
        engine.vacate(0)
        assert (engine.world.model.dof_frictionloss[wheels] > 0.0).all()


class TestState:
    """Copies of everything that changes."""

    def test_round_trip(self) -> None:
        """After `restore` the servos go on as they would have gone on from `state`."""
        one, other = servos(), servos()
        for servo in (one, other):
            servo.command(0, np.array([3.0, 0.0, -1.0, 2.0]))
            for _ in range(20):
                servo.update(angles(0.5))
        kept = other.state(NO_DATA)
        other.command(0, straight(9.0))
        for _ in range(50):
            other.update(angles(3.0))
        other.restore(NO_DATA, kept)
        for _ in range(90):
            one.update(angles(0.7))
            other.update(angles(0.7))
        np.testing.assert_array_equal(one.setpoints(0), other.setpoints(0))

    def test_moves_into_a_larger_generation(self) -> None:
        """The state of few slots becomes that of the first slots of many."""
        few, many = servos(), servos(ROBOT, ROBOT)
        few.command(0, straight(2.0))
        for _ in range(10):
            few.update(np.zeros(11))
        many.inherit(few, [0], NO_DATA, NO_DATA)
        few.update(np.zeros(11))
        many.update(np.zeros(22))
        np.testing.assert_array_equal(many.setpoints(0), few.setpoints(0))
        assert not many.setpoints(1).any()


class TestRolling:
    """What the torque does to the robot."""

    @pytest.mark.parametrize("timestep", [0.001, 0.002, 0.004, 0.005])
    @pytest.mark.parametrize("gain", [20.0, 200.0])
    def test_wheels_roll_while_speeding_up(self, timestep: float, gain: float) -> None:
        """While accelerating and braking the body moves with its wheels, at every time step."""
        engine = engine_with((0.0, 0.0), model=robot_model(gain=gain), timestep=timestep)
        engine.drive(0, straight(3.0))
        slip = []
        for step in range(round(0.8 / timestep)):
            if step == round(0.4 / timestep):
                engine.drive(0, straight(0.0))
            engine.advance(1)
            wheels = engine.data.qvel[engine.world.layouts[0].wheel_dof]
            slip.append(base_qvel(engine, 0)[0] - RADIUS * wheels.mean())
        assert np.abs(slip).max() < 0.004

    def test_stopping_distance_does_not_depend_on_the_time_step(self) -> None:
        """V13 with hard brakes: from 0.33 m/s it stops within 2 cm, the same at 1 to 5 ms."""
        ways = []
        for timestep in (0.001, 0.002, 0.004, 0.005):
            model = replace(ROBOT, wheel_deceleration=40.0)
            engine = engine_with((0.0, 0.0), model=model, timestep=timestep)
            drive(engine, straight(3.0), 1.0)
            start = base_qpos(engine, 0)[0]
            drive(engine, straight(0.0), 1.0)
            ways.append(base_qpos(engine, 0)[0] - start)
        assert max(ways) < 0.02
        assert np.ptp(ways) < 0.002

    def test_reaches_its_speed_quickly(self) -> None:
        """The wheels follow the set point within 0.04 s (robots reference 4.4)."""
        model = replace(ROBOT, wheel_acceleration=1e6)
        engine = engine_with((0.0, 0.0), model=model)
        drive(engine, straight(1.0), 0.04)
        assert engine.data.qvel[engine.world.layouts[0].wheel_dof].min() > 0.9

    def test_other_friction_losses_are_left_alone(self) -> None:
        """Doors and tendons with friction of their own do not feel the wheels' set points."""
        ends = []
        for speed in (0.0, 3.0):
            engine = Engine(rusty_things, PhysicsOptions(), [ROBOT])
            engine.occupy(0, 0, pose_at(0.0, 0.0))
            drive(engine, straight(speed), 0.5)
            ends.append([engine.data.joint(name).qpos[0] for name in ("rusty", "hanging")])
        assert base_qpos(engine, 0)[0] > 0.05
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)

    def test_a_stopped_robot_stands_where_a_pushed_one_does(self) -> None:
        """Wheels at zero speed resist with no more than the servo's torque."""
        engine = engine_with((0.0, 0.0), model=robot_model(torque=0.5))
        run(engine, 0.2)
        base = engine.world.layouts[0].base
        held, dragged = 10.0, 30.0  # N; four wheels of 0.5 N m at 0.11 m hold 18 N
        for force, moves in ((held, False), (dragged, True)):
            before = whole_state(engine, 0)[0]
            engine.data.xfrc_applied[base, 0] = force
            run(engine, 0.5)
            assert bool(whole_state(engine, 0)[0] - before > 0.05) is moves


def rusty_things() -> mujoco.MjSpec:
    """A floor with a door that sticks, and a weight on ropes that stick."""
    spec = floor()()
    for name, kind in (
        ("rusty", mujoco.mjtJoint.mjJNT_HINGE),
        ("hanging", mujoco.mjtJoint.mjJNT_SLIDE),
    ):
        body = spec.worldbody.add_body(name=name, pos=[0.0, 3.0, 1.0])
        body.add_joint(name=name, type=kind, axis=[0.0, 0.0, 1.0], frictionloss=5.0)
        body.add_geom(size=[0.2, 0.0, 0.0], mass=0.3, contype=0, conaffinity=0)
    for number in range(14):  # so many that their numbers are those of wheels, too
        rope = spec.add_tendon(name=f"rope{number}", frictionloss=1.0)
        rope.wrap_joint("hanging", 1.0)
    return spec
