"""Effectors: their types are found; opcodes, hands, EFF, CONF, GEO (protocol 4.7 to 4.9); what
hands take and let go is told once, tools are where they are held.
"""

from __future__ import annotations

import logging
import math
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
from actuator_fakes import CUP, HAND, SPARE, Machine, effector, robot
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.actuators import effectors as registry
from usarsim_server.actuators.articulation import Articulation
from usarsim_server.actuators.effectors import (
    GROUP,
    Change,
    Effector,
    ToolChanger,
    create_effector,
    create_effectors,
    effector_types,
    register_effector,
)
from usarsim_server.base import plugins
from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.protocol.messages import configuration, effector_geometry
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.articulation import Grip, HandModel, HandState, JointOrder, Order
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
    """CLOSE, OPEN and GRIP move the fingers and tell the hand (protocol 3.7, 161)."""
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
    """EFF of protocol 4.9, to the letter, while it is open and when it has closed
    (protocol 161)."""
    hand, machine = made("Hand")
    line = "EFF {{Time 63.4021}} {{Type Gripper}} {{Name Hand}} {{Status {}}}"
    assert hand.status(machine.state()) == line.format("OPEN")
    machine.held["Hand"] = HandState(closed=True)
    assert hand.status(machine.state()) == line.format("CLOSED")


def test_a_vacuum_gripper_is_a_gripper_on_the_wire() -> None:
    """Its Type is Gripper, as the sample of protocol 4.9 shows for KR60gripper."""
    cup, machine = made("Cup")
    assert cup.status(machine.state()).startswith("EFF {Time 63.4021} {Type Gripper} {Name Cup} ")


def test_status_of_a_tool_changer() -> None:
    """OPEN without a tool; CLOSED with type and name of the tool (protocol 4.9)."""
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
    """CONF of protocol 4.8, to the letter; several of a type share a line."""
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


class Stage:
    """The robot with four effectors, one of them a loose tool."""

    def __init__(self) -> None:
        kind = robot()
        self.machine = Machine(kind)
        self.limbs = Articulation(kind, self.machine)

    def look(self, **held: str | None) -> list[Change]:
        """Changes when hands hold these things; the others keep what they have."""
        for name, thing in held.items():
            self.machine.held[name] = HandState(thing is not None, thing)
        return self.limbs.changes(self.machine.state())


def test_the_first_look_tells_nothing() -> None:
    """What is held from the start is no change, and neither is what stays."""
    stage = Stage()
    assert stage.look(Changer="Spare") == []
    assert stage.look() == []


def test_things_are_told_by_the_hand() -> None:
    """A crate has no type of its own, so the hand is named that took it."""
    stage = Stage()
    stage.look()
    assert stage.look(Hand="crate") == [Change("ItemAttached", "Gripper", "Hand")]
    assert stage.look() == []
    assert stage.look(Hand=None) == [Change("ItemReleased", "Gripper", "Hand")]


def test_tools_are_told_by_themselves() -> None:
    """A tool is a part of the robot, with type and name; an exchange is told in order."""
    stage = Stage()
    stage.look()
    assert stage.look(Changer="Spare") == [Change("ToolAttached", "Gripper", "Spare")]
    assert stage.look(Changer=None, Spare="case") == [
        Change("ToolReleased", "Gripper", "Spare"),
        Change("ItemAttached", "Gripper", "Spare"),
    ]
    assert stage.look(Spare="parcel") == [
        Change("ItemReleased", "Gripper", "Spare"),
        Change("ItemAttached", "Gripper", "Spare"),
    ]


def test_a_robot_without_hands_has_no_changes() -> None:
    """Most robots have none."""
    kind = robot(effectors=())
    machine = Machine(kind)
    limbs = Articulation(kind, machine)
    assert limbs.changes(machine.state()) == limbs.changes(machine.state()) == []


def test_geometry_of_a_tool_follows_its_holder() -> None:
    """Loose it is where the file lays it, held it sits on the link of the changer
    (protocol 4.7)."""
    stage = Stage()

    def told() -> str:
        return stage.limbs.geometry("Gripper", "Spare")

    resting = (
        "GEO {Type Gripper} {Name Spare} {Location 0.10,0.00,0.00} {Orientation 0.00,0.00,0.00} "
        "{Mount Arms} {Tip 0.10,0.00,0.00}"
    )
    assert told() == resting
    stage.look(Changer="Spare")
    assert told() == resting.replace("{Mount Arms}", "{Mount Wrist} {MountLink 1}")
    stage.look(Changer=None)
    assert told() == resting
    stage.machine.gone = True
    assert told() == resting


@pytest.fixture
def types(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The registry for the length of a test."""
    effector_types()
    table: dict[str, Any] = dict(registry.TYPES._types)
    monkeypatch.setattr(registry.TYPES, "_types", table)
    return table


class Magnet(Effector):
    """What somebody might add: one class in one file."""

    wire_type: ClassVar[str] = "Magnet"

    def __init__(self, description: EffectorDescription, robot: RobotDescription) -> None:
        super().__init__(description, robot)
        self.gap = self.parameters.number("gap", 1.0)

    def hand(self) -> HandModel:
        """A cup without limits."""
        return HandModel(self.name, Grip.SUCTION, self.name, reach=self.gap)

    def configuration(self) -> Item:
        """A name only."""
        return Item(self.name)


def test_built_in_types() -> None:
    """The types of the robots reference, and the names that the original's files have for them."""
    assert set(effector_types()) == {
        "Gripper",
        "GripperEffector",
        "ToolChanger",
        "Vacuum",
        "VacuumCup",
        "VacuumGripper",
    }


@pytest.mark.usefixtures("types")
def test_a_new_type_is_one_class() -> None:
    """A registered class can be mounted, commanded and configured under any case of its name."""
    register_effector("Magnet")(Magnet)
    arms = robot(effectors=(effector("MAGNET", "M", gap=0.3),))
    (magnet,) = create_effectors(arms)
    machine = Machine(arms)
    assert magnet.set("CLOSE", "", machine) is SetResult.OK
    assert machine.hands == [("M", True)]
    assert robot_model(arms).hands[0].reach == 0.3
    assert "Magnet" in effector_types()


@pytest.mark.usefixtures("types")
def test_two_classes_of_one_name_are_refused() -> None:
    """A name stands for one class; registering it again for the same class is no error."""
    register_effector("Magnet")(Magnet)
    register_effector("MAGNET")(Magnet)

    class Other(Magnet):
        pass

    with pytest.raises(ValueError, match="'magnet' is already registered by"):
        register_effector("magnet")(Other)


def test_unknown_types_and_parameters_are_one_clear_error() -> None:
    """The error names the item, what is known, and the likely meaning."""
    with pytest.raises(RobotDescriptionError, match=r"test: type: unknown.*did you mean ToolC"):
        create_effector(effector("ToolChnager", "T"), robot())
    with pytest.raises(RobotDescriptionError, match="known types: Gripper, "):
        create_effector(effector("Qqq", "T"), robot())
    with pytest.raises(RobotDescriptionError, match="colour: unknown key of a Gripper"):
        create_effector(effector("Gripper", "T", fingers=HAND.fingers, colour=1), robot())


def test_types_of_other_packages(
    types: dict[str, Any], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Entry points add types; a broken one is logged and does not keep the others away."""

    class Point(EntryPoint):
        def load(self) -> Any:
            if self.name == "Magnet":
                return Magnet
            raise ImportError("no such module")

    points = [Point(name, "x:y", GROUP) for name in ("Broken", "Magnet")]
    monkeypatch.setattr(plugins, "entry_points", lambda group: points if group == GROUP else [])
    monkeypatch.setattr(registry.TYPES, "_discovered", False)
    monkeypatch.setattr(registry.TYPES, "_broken", {})
    types.clear()
    monkeypatch.setattr(plugins, "importlib", _NoImports)
    with caplog.at_level(logging.WARNING):
        assert effector_types() == ["Magnet"]
    assert "Broken" in caplog.text


class _NoImports:
    """Stands for importlib: the built-in modules have been imported already."""

    @staticmethod
    def import_module(name: str) -> ModuleType:
        """A package without modules."""
        package = ModuleType(name)
        package.__path__ = []
        return package
