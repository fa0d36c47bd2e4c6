"""Joints that are no wheels: positions, speeds, torques, stops (protocol reference 3.9)."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limb_fakes import (
    ARM,
    BASE,
    LENGTH,
    LIFT_LOAD,
    arm_engine,
    build_arm,
    order,
    position,
    push,
    rate,
    spin,
    torque,
)
from sim_fakes import ROBOT, add_box, floor, run

from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.joint_servos import HOLD_STEPS, JointServos
from usarsim_server.simulation.model import PhysicsOptions, compile_world


class TestPosition:
    """Order 0."""

    def test_reaches_its_target(self) -> None:
        """Turning, raised and sliding joints stand within 0.2 mrad or mm of their targets."""
        engine = arm_engine()
        order(engine, pan=2.0, lift=0.5, slide=0.2, seconds=3.0)
        assert position(engine, "pan") == pytest.approx(2.0, abs=2e-4)
        assert position(engine, "lift") == pytest.approx(0.5, abs=2e-4)
        assert position(engine, "slide") == pytest.approx(0.2, abs=2e-4)

    @pytest.mark.parametrize("timestep", [0.001, 0.002, 0.004])
    def test_moves_at_its_largest_speed_and_does_not_overshoot(self, timestep: float) -> None:
        """A way of 1.5 rad at 1.5 rad/s takes a second and a bit, whatever the time step."""
        engine = arm_engine(timestep=timestep)
        order(engine, pan=1.5)
        seen = []
        for _ in range(round(1.6 / timestep)):
            engine.advance(1)
            seen.append((position(engine, "pan"), rate(engine, "pan")))
        way, speed = np.array(seen).T
        assert way.max() <= 1.5 + 1e-4
        assert speed.max() == pytest.approx(1.5, rel=0.02)
        arrived = timestep * float(np.argmax(way > 1.49))
        assert arrived == pytest.approx(1.1, abs=0.05)

    def test_a_new_target_on_the_way_counts_from_there(self) -> None:
        """A joint turns back at once when it is told to."""
        engine = arm_engine()
        order(engine, pan=3.0, seconds=0.6)
        far = position(engine, "pan")
        order(engine, pan=0.0, seconds=0.2)
        assert position(engine, "pan") < far + 0.1
        run(engine, 1.5)
        assert position(engine, "pan") == pytest.approx(0.0, abs=3e-4)

    @pytest.mark.parametrize(("wanted", "got"), [(5.0, 1.0), (-5.0, -1.0)])
    def test_targets_beyond_a_stop_are_the_stop(self, wanted: float, got: float) -> None:
        """A joint goes to its stop and not through it (protocol 160)."""
        engine = arm_engine()
        order(engine, lift=wanted)
        furthest = 0.0
        for _ in range(500):
            engine.advance(1)
            furthest = max(furthest, abs(position(engine, "lift")))
        assert position(engine, "lift") == pytest.approx(got, abs=2e-3)
        assert furthest < 1.003

    def test_a_joint_without_stops_turns_all_the_way_round(self) -> None:
        """Positions of an endless joint are not wrapped."""
        engine = arm_engine()
        order(engine, pan=7.0, seconds=5.5)
        assert position(engine, "pan") == pytest.approx(7.0, abs=3e-4)


class TestHolding:
    """What a joint does when nobody tells it anything."""

    def test_holds_against_gravity(self) -> None:
        """A level arm sags less than 0.1 mrad, and its drive exerts the load."""
        engine = arm_engine()
        run(engine, 1.0)
        assert position(engine, "lift") == pytest.approx(0.0, abs=1e-4)
        assert torque(engine, "lift") == pytest.approx(LIFT_LOAD, rel=0.02)
        assert torque(engine, "pan") == pytest.approx(0.0, abs=0.05)

    def test_a_load_is_felt_as_torque(self) -> None:
        """Drawing the telescope out raises the torque of the shoulder by its weight's arm."""
        engine = arm_engine()
        order(engine, slide=0.3, seconds=2.0)
        assert torque(engine, "lift") == pytest.approx(LIFT_LOAD + 9.81 * 0.1 * 0.3, rel=0.02)

    def test_returns_after_a_knock(self) -> None:
        """A held joint that was shoved away goes back to its place."""
        engine = arm_engine()
        run(engine, 0.2)
        dof = engine.world.layouts[0].joint_dof["pan_joint"]
        engine.data.qfrc_applied[dof] = 32.0
        run(engine, 0.1)
        shoved = position(engine, "pan")
        engine.data.qfrc_applied[dof] = 0.0
        assert shoved > 0.05
        run(engine, 1.0)
        assert position(engine, "pan") == pytest.approx(0.0, abs=3e-4)

    def test_falls_asleep_and_wakes(self) -> None:
        """An arm at rest sleeps, an order wakes it, and it sleeps again where it was sent."""
        engine = arm_engine()
        run(engine, 2.0)
        assert engine.data.ntree_awake == 0
        asleep = torque(engine, "lift")
        run(engine, 0.5)
        assert torque(engine, "lift") == asleep == pytest.approx(LIFT_LOAD, rel=0.02)
        order(engine, lift=0.4, seconds=0.1)
        assert engine.data.ntree_awake == 1
        run(engine, 3.0)
        assert engine.data.ntree_awake == 0
        assert position(engine, "lift") == pytest.approx(0.4, abs=3e-4)

    def test_nothing_is_computed_at_rest(self) -> None:
        """While all joints hold their places they are looked at every few steps only."""
        engine = arm_engine(count=2)
        run(engine, 2.0)
        joints, looks = engine.parts.joints, 0
        for _ in range(10 * HOLD_STEPS):
            joints.before(engine.data)
            looks += joints._waited == 1
        assert looks == 10

    def test_worlds_without_joints_cost_nothing(self) -> None:
        """Servos of a world of wheeled robots have no state and hand nothing to the solver."""
        engine = Engine(floor(), PhysicsOptions(), [ROBOT])
        joints = engine.parts.joints
        joints.before(engine.data)
        assert not joints._moving
        assert not joints.torques().any()


class TestVelocity:
    """Order 1."""

    def test_turns_on_and_on(self) -> None:
        """A speed is kept until another order comes."""
        engine = arm_engine()
        spin(engine, pan=0.8, seconds=0.5)
        start = position(engine, "pan")
        run(engine, 4.0)
        assert position(engine, "pan") - start == pytest.approx(3.2, rel=0.01)
        spin(engine, pan=0.0, seconds=0.5)
        still = position(engine, "pan")
        run(engine, 0.5)
        assert position(engine, "pan") == pytest.approx(still, abs=1e-4)

    def test_is_limited(self) -> None:
        """No joint turns faster than it can."""
        engine = arm_engine()
        spin(engine, pan=-100.0, seconds=1.0)
        assert rate(engine, "pan") == pytest.approx(-1.5, rel=0.02)

    def test_lands_softly_on_a_stop(self) -> None:
        """At a stop the joint slows down and stays there (protocol 160)."""
        engine = arm_engine()
        spin(engine, lift=0.9, seconds=2.5)
        assert position(engine, "lift") == pytest.approx(1.0, abs=3e-3)
        assert rate(engine, "lift") == pytest.approx(0.0, abs=1e-3)


class TestTorque:
    """Order 2."""

    def test_more_than_the_load_raises_and_less_lets_sink(self) -> None:
        """The arm goes up with twice its load and down with half of it."""
        for share, sign in ((2.0, 1.0), (0.5, -1.0)):
            engine = arm_engine()
            push(engine, lift=share * LIFT_LOAD, seconds=0.3)
            assert sign * position(engine, "lift") > 0.05

    def test_accelerates_by_the_torque(self) -> None:
        """A free turntable gains speed by torque over inertia, up to its largest speed."""
        engine = arm_engine()
        inertia = 0.01 + 0.2 * 0.4 * 0.03**2 + 0.5 * LENGTH**2 / 3 + 0.1 * LENGTH**2
        push(engine, pan=0.05, seconds=0.4)
        assert rate(engine, "pan") == pytest.approx(0.4 * 0.05 / inertia, rel=0.1)
        run(engine, 10.0)
        assert rate(engine, "pan") == pytest.approx(1.5, rel=0.02)

    def test_no_torque_lets_swing(self) -> None:
        """A joint that is told a torque of zero is free: the arm falls onto its stop."""
        engine = arm_engine()
        push(engine, lift=0.0, seconds=0.3)
        fallen = position(engine, "lift")
        assert fallen < -0.5
        order(engine, lift=0.0, seconds=2.5)
        assert position(engine, "lift") == pytest.approx(0.0, abs=3e-4)

    def test_never_exceeds_the_drive(self) -> None:
        """A torque beyond what the drive can exert is what it can exert."""
        engine = arm_engine(wall)
        push(engine, pan=-1e9, seconds=2.0)
        assert torque(engine, "pan") == pytest.approx(-30.0)


class TestForceLimit:
    """What blocks a joint feels its largest force and no more."""

    def test_a_blocked_joint_pushes_with_all_it_has(self) -> None:
        """Against a wall the drive exerts its limit; freed, the joint goes on at its own speed."""
        engine = arm_engine(wall)
        order(engine, pan=-3.0, seconds=2.0)
        blocked = position(engine, "pan")
        assert blocked > -1.5
        assert torque(engine, "pan") == pytest.approx(-30.0)
        order(engine, pan=0.0, seconds=0.5)
        assert rate(engine, "pan") < 1.55
        run(engine, 1.5)
        assert position(engine, "pan") == pytest.approx(0.0, abs=3e-4)

    def test_a_weak_drive_cannot_lift_its_load(self) -> None:
        """Stiffness scales the largest force: with a fiftieth of it the arm sinks."""
        engine = arm_engine()
        engine.command_joints(0, {"lift_joint": JointOrder(Order.STIFFNESS, 0.02)})
        run(engine, 0.6)
        assert position(engine, "lift") < -0.05
        engine.command_joints(0, {"lift_joint": JointOrder(Order.STIFFNESS, 1.0)})
        run(engine, 2.0)
        assert position(engine, "lift") == pytest.approx(0.0, abs=3e-4)


class TestOrders:
    """How orders are addressed."""

    def test_names_are_found_in_any_case_and_unknown_ones_ignored(self) -> None:
        """An order to an unknown joint does not disturb the others (protocol 159)."""
        engine = arm_engine()
        orders = {"PAN_Joint": JointOrder(Order.POSITION, 0.3), "knee": JointOrder(Order(0), 1.0)}
        engine.command_joints(0, orders)
        run(engine, 1.0)
        assert position(engine, "pan") == pytest.approx(0.3, abs=3e-4)

    def test_unknown_robots_are_ignored(self) -> None:
        """An order to a robot that has left does nothing."""
        engine = arm_engine()
        order(engine, 7, pan=1.0)

    def test_robots_do_not_share_orders(self) -> None:
        """Two robots of one class move on their own."""
        engine = arm_engine(count=2)
        order(engine, 0, pan=0.5)
        order(engine, 1, pan=-0.5, seconds=1.0)
        assert position(engine, "pan", 0) == pytest.approx(0.5, abs=3e-4)
        assert position(engine, "pan", 1) == pytest.approx(-0.5, abs=3e-4)

    def test_a_slot_forgets_its_orders(self) -> None:
        """The next robot in a slot appears at home, strong and still."""
        engine = arm_engine()
        order(engine, pan=1.0, lift=0.5)
        push(engine, slide=0.0, seconds=0.5)
        engine.vacate(0)
        run(engine, 0.1)
        engine.occupy(1, 0, Pose((0.0, 0.0, 0.0)))
        run(engine, 0.5)
        for joint in ("pan", "lift", "slide"):
            assert position(engine, joint, 1) == pytest.approx(0.0, abs=3e-4)
        assert torque(engine, "lift", 1) == pytest.approx(LIFT_LOAD, rel=0.02)

    def test_targets_can_be_asked_for(self) -> None:
        """The position that a joint is told to take; None for a speed."""
        engine = arm_engine()
        order(engine, pan=0.7)
        joints = engine.parts.joints
        assert joints.target(0, "pan_joint") == 0.7
        spin(engine, pan=0.1)
        assert joints.target(0, "pan_joint") is None

    @settings(max_examples=15)
    @given(
        st.lists(
            st.tuples(
                st.sampled_from(["pan", "lift", "slide"]),
                st.sampled_from(list(Order)[:3]),
                st.floats(-100.0, 100.0),
            ),
            max_size=6,
        )
    )
    def test_whatever_is_ordered_limits_are_kept(
        self, orders: list[tuple[str, Order, float]]
    ) -> None:
        """No sequence of orders drives a joint through its stops or beyond its speed."""
        engine = arm_engine()
        for name, kind, value in orders:
            engine.command_joints(0, {f"{name}_joint": JointOrder(kind, value)})
            run(engine, 0.2)
            assert -1.02 <= position(engine, "lift") <= 1.02
            assert -0.01 <= position(engine, "slide") <= 0.31
            assert abs(rate(engine, "pan")) <= 1.55


class TestState:
    """Orders outlive what happens to the model."""

    def test_growth_carries_orders_over(self) -> None:
        """A joint on its way goes on when the model grows, and the new slot is at home."""
        engine = arm_engine()
        order(engine, pan=1.5)
        push(engine, slide=15.0, seconds=0.5)
        before = position(engine, "pan")
        engine.adopt(engine.grow([ARM]))
        engine.occupy(1, 1, Pose((0.0, 5.0, 0.0)))
        assert position(engine, "pan") == before
        run(engine, 1.5)
        assert position(engine, "pan") == pytest.approx(1.5, abs=3e-4)
        assert position(engine, "slide") > 0.29
        assert position(engine, "pan", 1) == pytest.approx(0.0, abs=3e-4)

    def test_growth_carries_fresh_orders_over(self) -> None:
        """Also those that came after the last step: all goes on as without growth."""
        states = []
        for grows in (False, True):
            engine = arm_engine()
            order(engine, pan=1.0, seconds=2.008)
            order(engine, pan=-1.0)
            push(engine, lift=0.1)
            if grows:
                engine.adopt(engine.grow([ARM]))
            dof = engine.world.layouts[0].joint_dof["lift_joint"]
            engine.advance(1)
            assert engine.world.model.dof_frictionloss[dof] == 0.1
            run(engine, 0.1)
            states.append([position(engine, name) for name in ("pan", "lift", "slide")])
        np.testing.assert_allclose(states[0], states[1], atol=1e-9)

    def test_round_trip(self) -> None:
        """After `restore` the set points go on as they would have gone on from `state`."""
        engine = arm_engine()
        order(engine, pan=1.0, seconds=0.2)
        joints = engine.parts.joints
        data = engine.data
        kept = joints.state(data)
        joints.before(data)
        wanted = joints._speed.copy()
        spin(engine, pan=-1.0)
        push(engine, lift=0.1)
        joints.before(data)
        joints.restore(data, kept)
        joints.before(data)
        np.testing.assert_array_equal(joints._speed, wanted)
        dof = engine.world.layouts[0].joint_dof["lift_joint"]
        assert engine.world.model.dof_frictionloss[dof] == 30.0

    def test_runs_repeat_bit_by_bit(self) -> None:
        """Equal orders at equal times give equal states, in batches of any size."""
        states = []
        for batch in (1, 4):
            engine = arm_engine()
            order(engine, pan=1.0, lift=0.3)
            for _ in range(200 // batch):
                engine.advance(batch)
            spin(engine, pan=-0.5)
            for _ in range(200 // batch):
                engine.advance(batch)
            states.append(engine.data.qpos.copy())
        np.testing.assert_array_equal(states[0], states[1])

    def test_homes_are_where_the_model_has_them(self) -> None:
        """A joint that is built away from zero appears there and holds it."""
        engine = arm_engine(model=replace(ARM, key="raised", build=_build_raised))
        run(engine, 0.5)
        assert position(engine, "lift") == pytest.approx(0.6, abs=3e-4)
        tip = engine.data.body("robot0:slide").xpos
        assert tip[2] == pytest.approx(BASE + LENGTH * math.sin(0.6), abs=1e-3)


def wall() -> mujoco.MjSpec:
    """A floor and a wall to the right of the arm."""
    spec = floor()()
    add_box(spec, "wall", (0.2, -0.35, 0.5), (0.5, 0.02, 0.5))
    return spec


def _build_raised() -> mujoco.MjSpec:
    spec = build_arm()
    lift = spec.body("lift")
    lift.quat = [math.cos(0.3), 0.0, -math.sin(0.3), 0.0]
    lift.joints[0].ref = 0.6
    return spec


def test_servos_know_their_joints_by_slot() -> None:
    """A world with wheeled and jointed robots gives each its own joints."""
    world = compile_world(floor(), (ROBOT, ARM, ARM), PhysicsOptions(), 0)
    joints = JointServos(world)
    joints.command(2, {"pan_joint": JointOrder(Order.POSITION, 0.5)})
    assert joints.target(1, "pan_joint") == 0.0
    assert joints.target(2, "pan_joint") == 0.5
    with pytest.raises(KeyError):
        joints.target(0, "pan_joint")
