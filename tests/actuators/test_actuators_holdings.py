"""What hands take and let go is told once; tools are where they are held."""

from __future__ import annotations

from actuator_fakes import Machine, robot

from usarsim_server.actuators.articulation import Articulation
from usarsim_server.actuators.holdings import Change
from usarsim_server.simulation.articulation import HandState


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
    """Loose it is where the file lays it, held it sits on the link of the changer (4.7)."""
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
