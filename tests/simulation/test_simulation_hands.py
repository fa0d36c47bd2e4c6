"""Fingers, suction cups, tool couplings, anchors (robots reference 1.10, 13)."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from limb_fakes import (
    ARM,
    CRANE,
    CRANE_WITH_TOOL,
    arm_engine,
    close,
    height,
    holding,
    open_hand,
    order,
    position,
    storehouse,
)
from sim_fakes import (
    ROBOT,
    base_qpos,
    base_qvel,
    box,
    crate,
    floor,
    furnished,
    run,
)

from usarsim_server.simulation.articulation import HandState
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import PhysicsOptions, RobotModel


def build_thing() -> mujoco.MjSpec:
    """A light box that is no robot."""
    spec = mujoco.MjSpec()
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="free")
    base.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.06, 0.06, 0.06], mass=0.2)
    return spec


THING = RobotModel("thing", build_thing, (), 0.06, robot=False)
ANCHORED = replace(ARM, key="anchored", anchored=True)


def crane(model: RobotModel = CRANE, **masses: float) -> Engine:
    """A crane in the storehouse."""
    return arm_engine(lambda: storehouse(**masses), model)


def pull(engine: Engine, body: str, force: float) -> None:
    """Pull a body down with a force from now on."""
    engine.data.xfrc_applied[engine.data.body(body).id, 2] = -force


class TestFingers:
    """A gripper closes by force and holds what all its fingers touch."""

    def test_holds_and_lifts(self) -> None:
        """Closed on a parcel, the hand holds it and carries it up and round."""
        engine = crane()
        run(engine, 0.3)
        assert holding(engine, "grip") is None
        close(engine, seconds=1.0)
        assert holding(engine, "grip") == "parcel"
        before = height(engine, "parcel")
        order(engine, hoist=0.4, seconds=1.5)
        assert height(engine, "parcel") == pytest.approx(before + 0.4, abs=2e-3)
        assert engine.snapshot().hands[0]["grip"] == HandState(True, "parcel")

    def test_opens(self) -> None:
        """Opened, it lets the parcel fall back onto the table."""
        engine = crane()
        close(engine, seconds=1.0)
        order(engine, hoist=0.3, seconds=1.2)
        open_hand(engine, seconds=1.5)
        assert holding(engine, "grip") is None
        assert height(engine, "parcel") == pytest.approx(0.15, abs=0.01)
        assert position(engine, "left") == pytest.approx(0.0, abs=1e-3)

    def test_an_empty_hand_closes_on_nothing(self) -> None:
        """Without anything between them the fingers close all the way, and nothing is held."""
        engine = arm_engine(floor(), CRANE)
        close(engine, seconds=1.5)
        assert position(engine, "left") == pytest.approx(0.11, abs=1e-3)
        assert engine.snapshot().hands[0]["grip"] == HandState(True, None)

    def test_one_finger_is_not_enough(self) -> None:
        """A finger that pushes a parcel about does not hold it."""
        engine = crane()
        order(engine, left=0.06)
        engine.operate_hand(0, "grip", True)
        run(engine, 1.0)
        assert holding(engine, "grip") is None

    def test_a_strong_pull_takes_the_thing_away(self) -> None:
        """Friction and strength bear 100 N together; a harder pull takes the parcel for good."""
        engine = crane()
        close(engine, seconds=1.0)
        order(engine, hoist=0.4, seconds=1.2)
        pull(engine, "parcel", 25.0)
        run(engine, 0.5)
        assert holding(engine, "grip") == "parcel"
        pull(engine, "parcel", 200.0)
        run(engine, 0.5)
        assert engine.snapshot().hands[0]["grip"] == HandState(True, None)
        assert height(engine, "parcel") < 0.3

    def test_it_does_not_hold_what_stands_fixed(self) -> None:
        """A post between the fingers is squeezed, not held."""
        scenery = furnished(box("post", (0.5, 0.0, 0.2), (0.02, 0.05, 0.2)))
        engine = arm_engine(scenery, CRANE)
        close(engine, seconds=1.0)
        assert engine.snapshot().hands[0]["grip"] == HandState(True, None)

    def test_it_does_not_hold_robots(self) -> None:
        """A robot between the fingers of another is not held."""
        engine = Engine(floor(), PhysicsOptions(), [CRANE, ROBOT])
        engine.occupy(0, 0, Pose((0.0, 0.0, 0.0)))
        engine.occupy(1, 1, Pose((0.5, 0.0, 0.11), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))))
        close(engine, seconds=1.5)
        assert engine.snapshot().hands[0]["grip"] == HandState(True, None)

    def test_a_held_thing_sleeps_and_wakes_with_its_robot(self) -> None:
        """Holding costs nothing at rest, and an order wakes both."""
        engine = crane()
        close(engine, seconds=1.0)
        order(engine, hoist=0.2, seconds=5.0)
        assert engine.data.ntree_awake == 0
        order(engine, hoist=0.4, seconds=1.5)
        assert height(engine, "parcel") == pytest.approx(0.15 + 0.4, abs=5e-3)


class TestSuction:
    """A cup holds the first thing in front of it."""

    def test_catches_what_is_within_reach(self) -> None:
        """4 cm above a box, with 10 cm of reach, the cup catches it where it is and lifts it."""
        engine = crane()
        run(engine, 0.2)
        assert engine.operate_hand(0, "cup", True)
        run(engine, 0.1)
        assert holding(engine, "cup") == "box"
        order(engine, hoist=0.3, seconds=1.2)
        assert height(engine, "box") == pytest.approx(0.38, abs=3e-3)
        assert engine.operate_hand(0, "cup", False)
        run(engine, 1.0)
        assert height(engine, "box") == pytest.approx(0.08, abs=0.01)

    def test_goes_on_looking_while_it_is_closed(self) -> None:
        """Closed too high up it holds nothing; it catches what is thrown before it."""
        engine = crane()
        order(engine, hoist=0.4, seconds=1.2)
        engine.operate_hand(0, "cup", True)
        run(engine, 0.2)
        assert holding(engine, "cup") is None
        joint = engine.world.model.body("box").jntadr[0]
        engine.data.qpos[engine.world.model.jnt_qposadr[joint] + 2] = 0.47
        engine.data.qvel[engine.world.model.body("box").dofadr[0] + 2] = 0.1
        run(engine, 0.1)
        assert holding(engine, "cup") == "box"
        run(engine, 0.5)
        assert height(engine, "box") == pytest.approx(0.47, abs=0.02)

    def test_pressing_does_not_loosen(self) -> None:
        """Pushed against a cup of 30 N with 100 N a box stays, pulled with 60 N it comes off."""
        engine = crane()
        run(engine, 0.2)
        engine.operate_hand(0, "cup", True)
        run(engine, 0.1)
        order(engine, hoist=0.2, seconds=1.0)
        pull(engine, "box", -100.0)
        run(engine, 0.5)
        assert holding(engine, "cup") == "box"
        pull(engine, "box", 60.0)
        run(engine, 0.5)
        assert holding(engine, "cup") is None

    def test_does_not_lift_what_is_too_heavy(self) -> None:
        """A box of 5 kg weighs 49 N and comes off a cup of 30 N."""
        engine = crane(cup_mass=5.0)
        run(engine, 0.2)
        engine.operate_hand(0, "cup", True)
        run(engine, 0.1)
        assert holding(engine, "cup") == "box"
        order(engine, hoist=0.3, seconds=0.5)
        assert engine.snapshot().hands[0]["cup"] == HandState(False, None)
        run(engine, 1.0)
        assert height(engine, "box") == pytest.approx(0.08, abs=0.01)

    def test_nothing_is_caught_through_a_lid(self) -> None:
        """What stands in between, and is fixed, is not caught, nor what is below it."""
        scenery = furnished(
            crate("box", (0.5, 0.5, 0.05), half=0.05),
            box("lid", (0.5, 0.5, 0.13), (0.2, 0.2, 0.01)),
        )
        engine = arm_engine(scenery, CRANE)
        run(engine, 0.2)
        engine.operate_hand(0, "cup", True)
        run(engine, 0.2)
        assert engine.snapshot().hands[0]["cup"] == HandState(True, None)


class TestCoupling:
    """A tool changer takes loose tools of its robot."""

    def test_takes_a_tool_that_is_near_enough(self) -> None:
        """A tool 10 cm below is drawn to the coupling and carried from then on."""
        engine = crane()
        run(engine, 0.2)
        assert height(engine, "robot0:tool") == pytest.approx(0.1, abs=1e-3)
        assert engine.operate_hand(0, "changer", True)
        run(engine, 0.1)
        assert holding(engine, "changer") == "tool"
        assert height(engine, "robot0:tool") == pytest.approx(0.2, abs=2e-3)
        order(engine, hoist=0.3, seconds=1.2)
        assert height(engine, "robot0:tool") == pytest.approx(0.5, abs=2e-3)

    def test_refuses_what_is_too_far(self) -> None:
        """30 cm above it nothing is taken, and the hand stays open."""
        engine = crane()
        order(engine, hoist=0.2, seconds=1.0)
        assert not engine.operate_hand(0, "changer", True)
        assert engine.snapshot().hands[0]["changer"] == HandState(False, None)

    @pytest.mark.parametrize(("angle", "takes"), [(0.15, True), (0.3, False), (-0.3, False)])
    def test_refuses_what_is_turned_too_far(self, angle: float, takes: bool) -> None:
        """A tool may be turned by 0.2 rad and no more."""
        engine = crane()
        joint = engine.world.model.joint("robot0:tool").qposadr[0]
        engine.data.qpos[joint + 3 : joint + 7] = [math.cos(angle / 2), 0, 0, math.sin(angle / 2)]
        run(engine, 0.1)
        assert engine.operate_hand(0, "changer", True) is takes

    def test_opens_only_if_it_has_a_tool(self) -> None:
        """Opening drops the tool; opening again fails, and so does closing twice."""
        engine = crane()
        run(engine, 0.1)
        assert not engine.operate_hand(0, "changer", False)
        assert engine.operate_hand(0, "changer", True)
        assert not engine.operate_hand(0, "changer", True)
        assert engine.operate_hand(0, "changer", False)
        run(engine, 0.5)
        assert height(engine, "robot0:tool") == pytest.approx(0.1, abs=2e-3)

    def test_may_hold_a_tool_from_the_start(self) -> None:
        """A robot can appear with its tool in place, wherever it is put, again and again."""
        engine = crane(CRANE_WITH_TOOL)
        run(engine, 0.3)
        assert engine.snapshot().hands[0]["changer"] == HandState(True, "tool")
        assert height(engine, "robot0:tool") == pytest.approx(0.2, abs=2e-3)
        assert engine.operate_hand(0, "changer", False)
        run(engine, 0.3)
        assert height(engine, "robot0:tool") == pytest.approx(0.1, abs=2e-3)
        engine.vacate(0)
        run(engine, 0.1)
        engine.occupy(3, 0, Pose((2.0, 2.0, 0.0), (math.sqrt(0.5), 0, 0, math.sqrt(0.5))))
        run(engine, 0.3)
        assert holding(engine, "changer", 3) == "tool"
        np.testing.assert_allclose(engine.data.body("robot0:tool").xpos, [2.5, 2.5, 0.2], atol=3e-3)

    def test_tools_come_and_go_with_their_robot(self) -> None:
        """A robot that leaves takes its tools away, wherever they have got to."""
        engine = crane()
        run(engine, 0.2)
        engine.vacate(0)
        run(engine, 0.5)
        assert height(engine, "robot0:tool") > 1000.0


class TestOrders:
    """How hands are addressed."""

    def test_unknown_hands_and_robots_do_not_obey(self) -> None:
        """Nobody is there to do it."""
        engine = crane()
        assert not engine.operate_hand(0, "nose", True)
        assert not engine.operate_hand(9, "grip", True)

    def test_closing_and_opening_twice_is_no_error(self) -> None:
        """Fingers and cups obey whatever they are doing."""
        engine = crane()
        for close_it in (True, True, False, False):
            assert engine.operate_hand(0, "grip", close_it)
            assert engine.snapshot().hands[0]["grip"].closed is close_it


class TestComingAndGoing:
    """Holding ends when one of the two goes elsewhere, and survives the growth of the model."""

    def test_a_robot_that_leaves_lets_go(self) -> None:
        """The parcel stays in the world and falls."""
        engine = crane()
        close(engine, seconds=1.0)
        order(engine, hoist=0.4, seconds=1.0)
        engine.vacate(0)
        run(engine, 1.5)
        assert height(engine, "parcel") == pytest.approx(0.15, abs=0.01)

    def test_a_robot_that_is_put_elsewhere_lets_go(self) -> None:
        """A teleport does not drag things across the world."""
        engine = crane()
        close(engine, seconds=1.0)
        engine.teleport(0, Pose((-3.0, 0.0, 0.0)))
        run(engine, 0.5)
        assert holding(engine, "grip") is None
        assert abs(float(engine.data.body("parcel").xpos[0]) - 0.5) < 0.05

    def test_a_thing_that_is_taken_away_is_let_go(self) -> None:
        """Things that come and go in slots can be held, and leave without their holder."""
        engine = Engine(floor(), PhysicsOptions(), [CRANE, THING])
        engine.occupy(0, 0, Pose((0.0, 0.0, 0.0)))
        engine.occupy(1, 1, Pose((0.5, 0.5, 0.05)))
        run(engine, 0.2)
        order(engine, hoist=0.0)
        engine.operate_hand(0, "cup", True)
        run(engine, 0.1)
        assert holding(engine, "cup") == "robot1:base"
        order(engine, hoist=0.3, seconds=1.0)
        engine.vacate(1)
        run(engine, 0.5)
        assert holding(engine, "cup") is None
        assert height(engine, "robot1:base") > 1000.0
        assert height(engine, "robot0:hoist") == pytest.approx(0.5, abs=0.01)

    def test_growth_keeps_hold(self) -> None:
        """What was held before the model grew is held after it, and so is a tool."""
        engine = crane()
        close(engine)
        engine.operate_hand(0, "changer", True)
        run(engine, 1.0)
        engine.adopt(engine.grow([CRANE, ANCHORED]))
        engine.occupy(1, 1, Pose((0.0, 5.0, 0.0)))
        order(engine, hoist=0.4, seconds=1.5)
        assert height(engine, "parcel") == pytest.approx(0.55, abs=3e-3)
        assert height(engine, "robot0:tool") == pytest.approx(0.6, abs=3e-3)
        assert engine.snapshot().hands[0]["grip"] == HandState(True, "parcel")
        assert engine.snapshot().hands[1]["grip"] == HandState(False, None)

    def test_a_thing_that_diverges_is_let_go(self) -> None:
        """A held thing in a hopeless state returns to its place; the hand stays, empty."""
        engine = crane()
        close(engine, seconds=1.0)
        order(engine, hoist=0.4, seconds=1.2)
        engine.data.qvel[engine.world.model.body("parcel").dofadr[0]] = 1e7
        engine.advance(2)
        assert 0 in engine.active
        assert holding(engine, "grip") is None
        run(engine, 0.2)
        assert height(engine, "parcel") == pytest.approx(0.15, abs=0.02)
        assert height(engine, "robot0:hoist") == pytest.approx(0.6, abs=0.01)


class TestAnchors:
    """Platforms stand fixed where they are put (robots 13)."""

    def test_gravity_does_not_move_them(self) -> None:
        """Put down in mid-air it stays there, to a hundredth of a millimetre."""
        engine = Engine(floor(), PhysicsOptions(), [ANCHORED])
        pose = Pose((1.0, 2.0, 3.0), (math.cos(0.4), 0.0, 0.0, math.sin(0.4)))
        engine.occupy(0, 0, pose)
        run(engine, 2.0)
        np.testing.assert_allclose(base_qpos(engine, 0)[:3], pose.position, atol=5e-5)
        np.testing.assert_allclose(base_qpos(engine, 0)[3:], pose.quaternion, atol=5e-5)
        assert engine.data.ntree_awake == 0

    def test_its_own_arm_does_not_move_it(self) -> None:
        """Quick motions of the arm move the base by less than a millimetre."""
        engine = arm_engine(model=ANCHORED)
        furthest = 0.0
        for target in (2.0, -2.0, 2.0):
            order(engine, pan=target, lift=target / 3)
            for _ in range(100):
                engine.advance(4)
                furthest = max(furthest, float(np.abs(base_qpos(engine, 0)[:3]).max()))
        assert furthest < 1e-3

    def test_collisions_do_not_move_it(self) -> None:
        """A crate of 20 kg that hits it at 3 m/s bounces off."""
        scenery = furnished(crate("ram", (-1.0, 0.0, 0.15), mass=20.0))
        engine = arm_engine(scenery, ANCHORED)
        engine.data.qvel[engine.world.model.body("ram").dofadr[0]] = 3.0
        run(engine, 1.5)
        assert engine.data.body("ram").xpos[0] < -0.3
        np.testing.assert_allclose(base_qpos(engine, 0)[:3], 0.0, atol=1e-3)
        assert np.abs(base_qvel(engine, 0)).max() < 1e-2

    def test_it_can_be_put_elsewhere(self) -> None:
        """A teleport moves the anchor along, and growth keeps it."""
        engine = arm_engine(model=ANCHORED)
        engine.teleport(0, Pose((5.0, 0.0, 1.0)))
        run(engine, 0.3)
        engine.adopt(engine.grow([ANCHORED]))
        run(engine, 1.0)
        np.testing.assert_allclose(base_qpos(engine, 0)[:3], (5.0, 0.0, 1.0), atol=5e-5)
