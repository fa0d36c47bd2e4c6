"""Grippers, vacuum grippers, tool changers: opcodes, hands, EFF, CONF, GEO (4.7 to 4.9)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from actuator_fakes import CUP, HAND, SPARE, Machine, effector, robot
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.actuators.effector import Effector, create_effectors
from usarsim_server.actuators.hands import ToolChanger
from usarsim_server.protocol.messages import configuration, effector_geometry
from usarsim_server.robots.description import EffectorDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.simulation.articulation import Grip, HandState, JointOrder, Order
from usarsim_server.simulation.frames import Vector

ARMS = robot()
OPEN, SHUT = JointOrder(Order.POSITION, 0.0), JointOrder(Order.POSITION, 0.04)


def made(name: str) -> tuple[Effector, Machine]:
    """An effector of the test robot and a machine for it."""
    found = {one.name: one for one in create_effectors(ARMS)}
    return found[name], Machine(ARMS)


@pytest.mark.parametrize(
    ("opcode", "params", "close"),
    [
        ("CLOSE", "", True),
        ("OPEN", "", False),
        ("GRIP", "1", True),
        ("GRIP", "0", False),
        ("GRIP", "", False),
        ("OPEN", "1", False),
    ],
)
def test_a_gripper_obeys(opcode: str, params: str, close: bool) -> None:
    """CLOSE, OPEN and GRIP move the fingers and tell the hand (3.7, check 161)."""
    hand, machine = made("Hand")
    assert hand.set(opcode, params, machine) is SetResult.OK
    angle = SHUT if close else OPEN
    assert machine.orders == [{"Hand_FingerJoint1": angle, "Hand_FingerJoint2": angle}]
    assert machine.hands == [("Hand", close)]


@pytest.mark.parametrize("name", ["Hand", "Cup", "Changer"])
def test_unknown_opcodes_change_nothing(name: str) -> None:
    """An opcode that the effector does not know is told apart from one that failed."""
    one, machine = made(name)
    assert one.set("DANCE", "1", machine) is SetResult.UNKNOWN
    assert machine.orders == machine.hands == []


def test_a_failure_is_reported() -> None:
    """What the hand could not do is FAILED, not UNKNOWN."""
    changer, machine = made("Changer")
    machine.obeys = False
    assert changer.set("CLOSE", "", machine) is SetResult.FAILED
    assert changer.set("GRIP", "1", machine) is SetResult.UNKNOWN


def test_a_cup_has_no_fingers_to_move() -> None:
    """Only the hand is told."""
    cup, machine = made("Cup")
    assert cup.set("CLOSE", "", machine) is SetResult.OK
    assert machine.orders == []
    assert machine.hands == [("Cup", True)]


def test_status_of_a_gripper() -> None:
    """EFF of 4.9, to the letter, while it is open and when it has closed (check 161)."""
    hand, machine = made("Hand")
    line = "EFF {{Time 63.4021}} {{Type Gripper}} {{Name Hand}} {{Status {}}}"
    assert hand.status(machine.state()) == line.format("OPEN")
    machine.held["Hand"] = HandState(closed=True)
    assert hand.status(machine.state()) == line.format("CLOSED")


def test_a_vacuum_gripper_is_a_gripper_on_the_wire() -> None:
    """Its Type is Gripper, as the sample of 4.9 shows for KR60gripper."""
    cup, machine = made("Cup")
    assert cup.status(machine.state()).startswith("EFF {Time 63.4021} {Type Gripper} {Name Cup} ")


def test_status_of_a_tool_changer() -> None:
    """OPEN without a tool; CLOSED with type and name of the tool (4.9)."""
    changer, machine = made("Changer")
    line = "EFF {Time 63.4021} {Type ToolChanger} {Name Changer} {Status "
    assert changer.status(machine.state()) == line + "OPEN}"
    machine.held["Changer"] = HandState(True, "Spare")
    assert changer.status(machine.state()) == line + "CLOSED} {ToolType Gripper} {Tool Spare}"


def test_a_loose_tool_is_not_part_of_the_robot() -> None:
    """A detached effector is attached only while a hand holds it; all others always."""
    (spare, machine), (hand, _) = made("Spare"), made("Hand")
    assert hand.attached(machine.state())
    assert not spare.attached(machine.state())
    machine.held["Changer"] = HandState(True, "Spare")
    assert spare.attached(machine.state())


def test_configuration() -> None:
    """CONF of 4.8, to the letter; several of a type share a line."""
    arms = create_effectors(ARMS)
    grippers = [one.configuration() for one in arms if one.wire_type == "Gripper"]
    opcodes = "{Opcode Grip} {MaxVal 1} {MinVal 0} {Opcode Close} {Opcode Open}"
    assert configuration("Gripper", grippers) == (
        f"CONF {{Type Gripper}} {{Name Hand}} {opcodes} {{Name Cup}} {opcodes} "
        f"{{Name Spare}} {opcodes}"
    )
    changer, _ = made("Changer")
    assert configuration("ToolChanger", [changer.configuration()]) == (
        "CONF {Type ToolChanger} {Name Changer} {PositionTolerance 0.5000} "
        "{AngleTolerance 0.5000} {Opcode Close} {Opcode Open}"
    )


def test_mounts() -> None:
    """GEO: pose on the link, the actuator and its link, or the robot's class, then the tip."""
    hand, cup = made("Hand")[0], made("Cup")[0]
    assert effector_geometry("Gripper", [hand.mount(), cup.mount()]) == (
        "GEO {Type Gripper} {Name Hand} {Location 0.10,0.00,0.00} {Orientation 0.00,0.00,0.00} "
        "{Mount ArmA} {MountLink 2} {Tip 0.05,0.00,0.00} {Name Cup} {Location 0.10,0.00,0.00} "
        "{Orientation 0.00,0.00,0.00} {Mount Arms} {Tip 0.00,0.00,0.18}"
    )


def test_hands_of_the_types() -> None:
    """How each type takes hold, with the defaults of robots reference 1.10."""
    hands = {one.name: one.hand() for one in create_effectors(ARMS)}
    assert hands["Hand"].grip is Grip.PINCH
    assert hands["Hand"].fingers == ("Hand_Finger1", "Hand_Finger2")
    assert hands["Hand"].strength == 100.0
    assert hands["Cup"].grip is Grip.SUCTION
    assert (hands["Cup"].reach, hands["Cup"].strength) == (0.125, 10.0)
    assert hands["Changer"].grip is Grip.COUPLING
    assert hands["Changer"].tolerance == (0.5, 0.5)
    assert hands["Changer"].tools == ("Spare",)
    assert math.isinf(hands["Changer"].strength)
    assert all(hand.body == hand.name for hand in hands.values())


def test_parameters_of_the_types() -> None:
    """Every parameter of the how-to page reaches the hand."""
    effectors = (
        effector("GRIPPER", "A", fingers=HAND.fingers, strength=7.0),
        effector("vacuumgripper", "B", suction_length=0.02, force=100.0),
        effector("ToolChanger", "C", position_tolerance=0.1, angle_tolerance=0.2, tool="spare"),
        SPARE,
    )
    one, two, three, _ = create_effectors(robot(effectors=effectors))
    assert one.hand().strength == 7.0
    assert (two.hand().reach, two.hand().strength) == (0.02, 100.0)
    assert three.hand().tolerance == (0.1, 0.2)
    assert isinstance(three, ToolChanger)
    assert three.first_tool == "Spare"
    assert one.first_tool is None


@given(st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_suction_faces_away_from_the_mount(tip: Vector) -> None:
    """Whatever the tip, the cup looks from the mount through the tip; ahead if there is none."""
    description = EffectorDescription(CUP.item, CUP.shapes, tip=tip)
    (cup,) = create_effectors(robot(effectors=(description,)))
    pose = cup.hand().tip
    length = math.hypot(*tip)
    ahead = np.array(tip) / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    assert pose.position == tip
    if length > 1e-6 or length == 0.0:
        np.testing.assert_allclose(pose.rotate((1.0, 0.0, 0.0)), ahead, atol=1e-4)
    assert math.hypot(*pose.quaternion) == pytest.approx(1.0)
