"""Commands to everything that moves and is no wheel (protocol reference 3.4.6, 3.5 to 3.10)."""

from __future__ import annotations

import pytest
from actuator_fakes import PAN_TILT, UDK, UT2004, Machine, robot

from usarsim_server.actuators.articulation import Articulation
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.requests import Act, Drive, MisPkg, MultiDrive, Set
from usarsim_server.simulation.articulation import HandState, JointOrder, Order

POSITION, VELOCITY, TORQUE = list(Order)[:3]


class Stage:
    """An articulation, its machine, and text that goes in."""

    def __init__(self, **description: object) -> None:
        self.robot = robot(**description)  # type: ignore[arg-type]
        self.machine = Machine(self.robot)
        self.limbs = Articulation(self.robot, self.machine)

    def say(self, text: str, dialect: object = UT2004) -> list[str]:
        """Carry out a command; returns the RES lines."""
        (command,) = parse_line(text.encode())
        request = interpret(command)
        match request:
            case Set():
                return self.limbs.set(request, dialect)  # type: ignore[arg-type]
            case Drive():
                self.limbs.drive(request)
            case MisPkg() | Act() | MultiDrive():
                self.limbs.obey(request)
            case _:
                raise AssertionError(request)
        return []

    @property
    def orders(self) -> dict[str, tuple[int, float]]:
        """The orders of the only command so far, kinds as numbers."""
        assert len(self.machine.orders) == 1, self.machine.orders
        orders = self.machine.orders[0].items()
        return {joint: (int(kind), value) for joint, (kind, value) in orders}


@pytest.fixture
def stage() -> Stage:
    """The robot with two arms, flippers, and four effectors."""
    return Stage()


# -- MISPKG and ACT --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "orders"),
    [
        ("MISPKG {Name ArmA} {Link 1} {Value 0.5}", {1: (0, 0.5)}),
        ("MISPKG {Name arma} {Link 1} {Value 0.5} {Order 0}", {1: (0, 0.5)}),
        ("MISPKG {Name ArmA} {Link 2} {Order 1} {Value 0.1}", {2: (1, 0.1)}),
        ("MISPKG {Name ArmA} {Link 1} {Value -3} {Order 2}", {1: (2, -3)}),
        (
            "MISPKG {Name ArmA} {Link 1} {Value 1} {Order 1} {Link 2} {Value 2} {Order 0}",
            {1: (1, 1), 2: (0, 2)},
        ),
        ("MISPKG {Name ArmA} {Link 7} {Value 1} {Link 2} {Value 0.1}", {2: (0, 0.1)}),
        ("MISPKG {Name ArmA} {Link 0} {Value 1} {Link 1} {Value 0.2}", {1: (0, 0.2)}),
        ("MISPKG {Name ArmA} {Rotation 0,0.3,-0.4}", {1: (0, -0.4), 2: (0, 0.3)}),
        ("MISPKG {Name ArmA} {Rotation 0,0.3,-0.4} {Order 1}", {1: (1, -0.4), 2: (1, 0.3)}),
        ("ACT {Name ArmA} {Link 0} {Value 0.5}", {1: (0, 0.5)}),
        ("ACT {Name ARMA} {Link 0} {Value 0.5} {Link 1} {Value 0.2}", {1: (0, 0.5), 2: (0, 0.2)}),
        ("ACT {Name ArmA} {Link 2} {Value 9} {Link 1} {Value 0.2}", {2: (0, 0.2)}),
    ],
)
def test_links_are_commanded(
    stage: Stage, command: str, orders: dict[int, tuple[int, float]]
) -> None:
    """MISPKG counts from 1, ACT from 0, the old form turns links 1 and 2 (protocol 3.6, 3.9,
    3.10)."""
    stage.say(command)
    assert stage.orders == {f"ArmA_Joint{number}": order for number, order in orders.items()}
    assert stage.machine.looks == 0


@pytest.mark.parametrize(
    "command",
    [
        "MISPKG {Name Leg} {Link 1} {Value 1}",
        "MISPKG {Name ArmA} {Link 9} {Value 1}",
        "MISPKG {Name ArmA} {Link 1}",
        "MISPKG {Link 1} {Value 1}",
        "MISPKG {Name Flippers} {Link 1} {Value 1}",
        "ACT {Name Leg} {Link 0} {Value 1}",
        "ACT {Name ArmA}",
        "MULTIDRIVE {Knee 1}",
        "MULTIDRIVE",
        "DRIVE {Name Knee} {Value 1}",
        "DRIVE {Name ArmA_Joint1} {Left 1} {Right 1}",
        "DRIVE {Value 1}",
        "DRIVE {Name ArmA_Joint1} {Value 1} {Steer 1}",
        "DRIVE {Name ArmA_Joint1} {Value 1} {Order 7}",
    ],
)
def test_what_does_not_exist_is_ignored(stage: Stage, command: str) -> None:
    """Unknown names, links, orders and empty commands do nothing (protocol 3.9, 3.10, addendum)."""
    stage.say(command)
    assert stage.machine.orders == []
    assert stage.machine.hands == []


def test_actuators_on_actuators_are_found(stage: Stage) -> None:
    """ACT reaches an arm that sits on an arm (protocol 3.10)."""
    stage.say("ACT {Name wrist} {Link 0} {Value 0.3}")
    assert stage.orders == {"Wrist_Joint1": (0, 0.3)}


def test_relative_orders_look_first(stage: Stage) -> None:
    """Order 10 counts from where the joint is (robots reference 1.6)."""
    stage.machine.positions["ArmA_Joint1"] = 0.25
    stage.say("MISPKG {Name ArmA} {Link 1} {Value 0.5} {Order 10}")
    assert stage.orders == {"ArmA_Joint1": (0, 0.75)}
    assert stage.machine.looks == 1


def test_relative_orders_without_a_robot_are_lost() -> None:
    """A robot that has just left the world takes no order, and nothing breaks."""
    stage = Stage()
    stage.machine.gone = True
    stage.say("MISPKG {Name ArmA} {Link 1} {Value 0.5} {Order 10}")
    stage.say("DRIVE {Name ArmA_Joint1} {Value 0.5} {Order 11}")
    assert stage.machine.orders == []
    assert stage.say("SET {Type Gripper} {Name Spare} {Opcode CLOSE}") == []


@pytest.mark.parametrize("word", ["MISPKG", "ACT"])
@pytest.mark.parametrize(("value", "close"), [(1, True), (0, False), (2, True)])
def test_grippers_of_an_actuator(stage: Stage, word: str, value: int, close: bool) -> None:
    """Gripper closes or opens what the actuator carries, or the effector of that name."""
    stage.say(f"{word} {{Name ArmA}} {{Gripper {value}}}")
    assert stage.machine.hands == [("Hand", close)]
    stage.say(f"{word} {{Name cup}} {{Gripper {value}}}")
    assert stage.machine.hands[1:] == [("Cup", close)]


# -- joints by name --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "orders"),
    [
        ("DRIVE {Name ArmA_Joint1} {Value 0.5}", {"ArmA_Joint1": (0, 0.5)}),
        ("DRIVE {Value 0.5} {Order 1} {Name arma_joint1}", {"ArmA_Joint1": (1, 0.5)}),
        ("DRIVE {Name ArmA_Link2} {Value 0.5} {Order 2} {Steer 0}", {"ArmA_Joint2": (2, 0.5)}),
        ("DRIVE {Name FRFlipper} {Value -0.5}", {"FRFlipper": (0, -0.5)}),
        (
            "MULTIDRIVE {FRFlipper 0.5} {FLflipper 0.25}",
            {"FRFlipper": (0, 0.5), "FLFlipper": (0, 0.25)},
        ),
        ("MultiDrive {FRFlipper 0.5} {Tail 1}", {"FRFlipper": (0, 0.5)}),
        ("MULTIDRIVE {ArmA_Joint1 0.1}", {"ArmA_Joint1": (0, 0.1)}),
        (
            "SET {Type Joint} {Name ArmA_Joint1} {Opcode Angle} {Params 0.5}",
            {"ArmA_Joint1": (0, 0.5)},
        ),
        (
            "SET {Type joint} {Name FRFLIPPER} {Opcode target} {Params 0.5}",
            {"FRFlipper": (0, 0.5)},
        ),
        (
            "SET {Type Joint} {Name FRFlipper} {Opcode Stiffness} {Params 0.2}",
            {"FRFlipper": (3, 0.2)},
        ),
    ],
)
def test_joints_are_commanded_by_name(
    stage: Stage, command: str, orders: dict[str, tuple[int, float]]
) -> None:
    """DRIVE, MULTIDRIVE and SET reach joints by name, whatever its case (protocol 154 to 156)."""
    stage.say(command)
    assert stage.orders == orders


@pytest.mark.parametrize("name", ["AllJoints", "allangles"])
def test_all_joints_at_once(stage: Stage, name: str) -> None:
    """AllJoints addresses every joint but fingers (protocol 156)."""
    stage.say(f"SET {{Type Joint}} {{Name {name}}} {{Opcode Angle}} {{Params 0.1}}")
    joints = ("ArmA_Joint1", "ArmA_Joint2", "Wrist_Joint1", "FRFlipper", "FLFlipper")
    assert stage.orders == dict.fromkeys(joints, (0, 0.1))


# -- SET and RES -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "result"),
    [
        ("{Type Gripper} {Name Hand} {Opcode CLOSE}", "{Type Gripper} {Name Hand} {Status OK}"),
        ("{Type gripper} {Name hand} {Opcode open} ", "{Type Gripper} {Name Hand} {Status OK}"),
        (
            "{Type VacuumGripper} {Name Cup} {Opcode CLOSE}",
            "{Type Gripper} {Name Cup} {Status OK}",
        ),
        (
            "{Type Joint} {Name ArmA_Joint1} {Opcode Angle} {Params 1}",
            "{Type Joint} {Name ArmA_Joint1} {Status OK}",
        ),
    ],
)
def test_set_gives_one_result_in_ut2004_and_none_in_udk(
    stage: Stage, command: str, result: str
) -> None:
    """Every SET with a known opcode gives one RES in `ut2004`, `udk` has none (protocol 163)."""
    assert stage.say(f"SET {command}") == [f"RES {{Time 63.40}} {result}"]
    assert stage.say(f"SET {command}", UDK) == []


@pytest.mark.parametrize(
    "command",
    [
        "{Type Gripper} {Name Hand} {Opcode DANCE}",
        "{Type Gripper} {Name Nobody} {Opcode CLOSE}",
        "{Type Gripper} {Name Hand}",
        "{Type Joint} {Name Knee} {Opcode Angle} {Params 1}",
        "{Type Joint} {Name ArmA_Joint1} {Opcode DANCE} {Params 1}",
        "{Type Joint} {Opcode Angle} {Params 1}",
        "{Type Actuator} {Name ArmA} {Opcode CLOSE}",
    ],
)
def test_set_without_addressee_or_opcode_gives_nothing(stage: Stage, command: str) -> None:
    """Nothing happens and nothing is said (protocol 3.7)."""
    assert stage.say(f"SET {command}") == []
    assert stage.machine.orders == stage.machine.hands == []


def test_set_without_name_reaches_all_of_the_type(stage: Stage) -> None:
    """Name is optional; loose tools do not obey (protocol 3.7)."""
    lines = stage.say("SET {Type Gripper} {Opcode CLOSE}")
    assert [name for name, _ in stage.machine.hands] == ["Hand", "Cup"]
    assert [line.split("{Status ")[1] for line in lines] == ["OK}", "OK}", "Failed}"]


def test_a_tool_obeys_while_it_is_held(stage: Stage) -> None:
    """A loose effector fails; on the tool changer it works."""
    command = "SET {Type Gripper} {Name Spare} {Opcode CLOSE}"
    assert stage.say(command)[0].endswith("{Status Failed}")
    stage.machine.held["Changer"] = HandState(True, "Spare")
    assert stage.say(command)[0].endswith("{Status OK}")
    assert stage.machine.hands == [("Spare", True)]


def test_a_tool_changer_that_finds_nothing_fails(stage: Stage) -> None:
    """RES says Failed if there was no tool to take (protocol 4.10)."""
    stage.machine.obeys = False
    (line,) = stage.say("SET {Type ToolChanger} {Name Changer} {Opcode CLOSE}")
    assert line == "RES {Time 63.40} {Type ToolChanger} {Name Changer} {Status Failed}"


# -- answers and reports ---------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["Actuator", "MisPkg", "ACTUATOR", "mispkg"])
@pytest.mark.parametrize("dialect", [UT2004, UDK])
def test_both_forms_are_answered_in_both_dialects(stage: Stage, kind: str, dialect: object) -> None:
    """CONF and GEO of Actuator and MisPkg, canonical Type, all or one (protocol 127, 128, 141)."""
    canonical = {"actuator": "Actuator", "mispkg": "MisPkg"}[kind.lower()]
    for answer in (
        stage.limbs.configuration(kind, None, dialect),  # type: ignore[arg-type]
        stage.limbs.geometry(kind, None),
    ):
        assert f"{{Type {canonical}}}" in answer
        assert "{Name ArmA}" in answer
        assert "{Name Wrist}" in answer
        assert "Flippers" not in answer
    one = stage.limbs.geometry(kind, " wrist ")
    assert "{Name Wrist}" in one
    assert "ArmA_" not in one
    assert one.count("{Name ") == 1


@pytest.mark.parametrize("kind", ["Gripper", "VacuumGripper", "ToolChanger"])
def test_effectors_answer(stage: Stage, kind: str) -> None:
    """CONF and GEO of effectors (protocol 3.8, 125)."""
    for answer in (stage.limbs.configuration(kind, None, UDK), stage.limbs.geometry(kind, None)):
        assert "{Type ToolChanger}" in answer or "{Type Gripper}" in answer


@pytest.mark.parametrize(
    ("kind", "name"), [("Actuator", "Leg"), ("MisPkg", "Leg"), ("Gripper", "Nose"), ("Foot", None)]
)
def test_no_match_no_answer(stage: Stage, kind: str, name: str | None) -> None:
    """Unknown types and names are not answered (protocol 126)."""
    assert stage.limbs.configuration(kind, name, UDK) == ""
    assert stage.limbs.geometry(kind, name) == ""


def test_a_robot_without_arms_answers_nothing() -> None:
    """Nor does it report anything."""
    stage = Stage(actuators=(), effectors=())
    for kind in ("Actuator", "MisPkg", "Gripper"):
        assert stage.limbs.configuration(kind, None, UDK) == ""
        assert stage.limbs.geometry(kind, None) == ""
    state = stage.machine.state()
    assert stage.limbs.actuator_lines(UDK, state) == stage.limbs.effector_lines(state) == []
    assert stage.limbs.joints(state) == ()


def test_status_lines(stage: Stage) -> None:
    """One line per actuator and per attached effector, in the order of the file."""
    state = stage.machine.state()
    lines = stage.limbs.actuator_lines(UDK, state)
    assert [line.split("{Name ")[1].split("}")[0] for line in lines] == ["ArmA", "Wrist"]
    assert all(line.startswith("ASTA {Time 63.4021} ") for line in lines)
    assert stage.limbs.actuator_lines(UT2004, state)[0].startswith("MISSTA {Time 63.40} ")
    names = [line.split("{Name ")[1].split("}")[0] for line in stage.limbs.effector_lines(state)]
    assert names == ["Hand", "Cup", "Changer"]
    stage.machine.held["Changer"] = HandState(True, "Spare")
    assert len(stage.limbs.effector_lines(stage.machine.state())) == 4


def test_bare_joints_are_told_in_sta(stage: Stage) -> None:
    """Flippers appear in STA by name, and nowhere else (protocol 3.5, 4.3)."""
    stage.machine.positions = {"FRFlipper": 0.7, "FLFlipper": -0.2}
    state = stage.machine.state()
    assert stage.limbs.joints(state) == (("FRFlipper", 0.7), ("FLFlipper", -0.2))
    assert not any("Flipper" in line for line in stage.limbs.actuator_lines(UDK, state))


def test_the_pan_tilt_of_player() -> None:
    """Player's old command reaches pan by the third and tilt by the second number
    (protocol 3.6)."""
    stage = Stage(actuators=(PAN_TILT,), effectors=(), name="P2AT")
    stage.say("MISPKG {Name CameraPanTilt} {Rotation 0,0.250000,-0.500000} {Order 0}")
    assert stage.machine.orders == [
        {
            "CameraPanTilt_Joint1": JointOrder(POSITION, -0.5),
            "CameraPanTilt_Joint2": JointOrder(POSITION, 0.25),
        }
    ]
