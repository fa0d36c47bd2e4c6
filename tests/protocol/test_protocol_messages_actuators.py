"""Mission packages, arms, effectors, RES (protocol reference 4.7 to 4.10, 6.8, 6.10)."""

from __future__ import annotations

import pytest

from usarsim_server.protocol.messages import (
    ActuatorItem,
    ActuatorLink,
    EffectorMount,
    actuator_configuration,
    actuator_geometry,
    actuator_status,
    configuration,
    effector_geometry,
    effector_status,
    encode,
    gripper_item,
    mission_package_configuration,
    mission_package_geometry,
    result,
    tool_changer_item,
    viewports_result,
)
from usarsim_server.protocol.values import Dialect

UT2004, UDK = Dialect.UT2004, Dialect.UDK

PAN_TILT = ActuatorItem(
    name="CameraPanTilt",
    links=(
        ActuatorLink(
            max_speed=0.17,
            max_torque=20,
            location=(0.12, 0, -0.2),
            rotation=(3.14159, 0, 0),
        ),
        ActuatorLink(
            max_speed=0.17,
            max_torque=20,
            limits=(-0.7854, 0.7854),
            parent=1,
            location=(0, 0, 0.05),
            rotation=(1.57079, 0, 0),
        ),
    ),
)
ARM = ActuatorItem(
    name="ArmA",
    location=(0.1, 0, -0.35),
    mount="P3AT",
    links=(
        ActuatorLink(max_torque=500, limits=(-1.5708, 1.5708), location=(0, 0, -0.1)),
        ActuatorLink(
            joint_type="Prismatic",
            max_torque=800,
            limits=(0, 0.35),
            parent=1,
            location=(0.05, 0, -0.08),
            rotation=(1.57079, 0, 0),
        ),
    ),
    tip=(0, 0, 0.18),
)


def test_mission_package_status() -> None:
    """Protocol 158 and 66: MISSTA with Torque, two digits of Time, links from 1."""
    assert actuator_status(UT2004, 63.4, "CameraPanTilt", [(0.5, -20), (-0.1, -20)]) == (
        "MISSTA {Time 63.40} {Name CameraPanTilt} {Link 1} {Value 0.5000} {Torque -20.00} "
        "{Link 2} {Value -0.1000} {Torque -20.00}"
    )


def test_actuator_status() -> None:
    """Protocol 158: ASTA without Torque, four digits of Time, links from 1 as well."""
    assert actuator_status(UDK, 63.4021, "ArmA", [(0.49999, 1), (0.12, 1)]) == (
        "ASTA {Time 63.4021} {Name ArmA} {Link 1} {Value 0.4999} {Link 2} {Value 0.1200}"
    )


@pytest.mark.parametrize(
    ("closed", "tool", "text"),
    [
        (False, None, "{Status OPEN}"),
        (True, None, "{Status CLOSED}"),
        (True, ("Gripper", "KR60gripper"), "{Status CLOSED} {ToolType Gripper} {Tool KR60gripper}"),
        (False, ("Gripper", "KR60gripper"), "{Status OPEN}"),
    ],
)
def test_effector_status(closed: bool, tool: tuple[str, str] | None, text: str) -> None:
    """Protocol 161, 9: OPEN or CLOSED, and the held tool one blank behind it."""
    assert effector_status(63.4021, "ToolChanger", "toolchange", closed, tool) == (
        f"EFF {{Time 63.4021}} {{Type ToolChanger}} {{Name toolchange}} {text}"
    )


def test_mission_package_geometry() -> None:
    """Protocol 140: ParentLink -1 is the body."""
    assert mission_package_geometry([PAN_TILT]) == (
        "GEO {Type MisPkg} {Name CameraPanTilt} {Link 1} {ParentLink -1} "
        "{Location 0.1200,0.0000,-0.2000} {Orientation 3.1415,0.0000,0.0000} {Link 2} "
        "{ParentLink 1} {Location 0.0000,0.0000,0.0500} {Orientation 1.5707,0.0000,0.0000}"
    )


def test_actuator_geometry() -> None:
    """Protocol 140: Parent 0 is the base; digits 3/3 for the base, 3/2 for links, 2 for the tip."""
    assert actuator_geometry([ARM]) == (
        "GEO {Type Actuator} {Name ArmA} {Location 0.100,0.000,-0.350} "
        "{Orientation 0.000,0.000,0.000} {Mount P3AT} {Link 1} {Parent 0} "
        "{Location 0.000,0.000,-0.100} {Orientation 0.00,0.00,0.00} {Link 2} {Parent 1} "
        "{Location 0.050,0.000,-0.080} {Orientation 1.57,0.00,0.00} {Tip 0.00,0.00,0.18}"
    )


def test_actuator_on_an_actuator() -> None:
    """Protocol 4.7: Mount names the carrying actuator and MountLink its link."""
    item = ActuatorItem(name="Hand", mount="ArmA", mount_link=2)
    assert "{Mount ArmA} {MountLink 2} {Tip " in actuator_geometry([item])


def test_effector_geometry() -> None:
    """Protocol 4.7: location and orientation with two digits, then Mount, MountLink, Tip."""
    mount = EffectorMount(
        name="Gripper1", location=(0.6, 0, -0.5), mount="ArmA", mount_link=2, tip=(0, 0, 0.18)
    )
    assert effector_geometry("Gripper", [mount]) == (
        "GEO {Type Gripper} {Name Gripper1} {Location 0.60,0.00,-0.50} "
        "{Orientation 0.00,0.00,0.00} {Mount ArmA} {MountLink 2} {Tip 0.00,0.00,0.18}"
    )


def test_mission_package_configuration_ut2004() -> None:
    """Protocol 4.8: a link without limits has its minimum above its maximum."""
    assert mission_package_configuration(UT2004, [PAN_TILT]) == (
        "CONF {Type MisPkg} {Name CameraPanTilt} {Link 1} {JointType Revolute} {MaxSpeed 0.17} "
        "{MaxTorque 20.00} {MinRange 1} {MaxRange 0} {Link 2} {JointType Revolute} "
        "{MaxSpeed 0.17} {MaxTorque 20.00} {MinRange -0.7854} {MaxRange 0.7854}"
    )


def test_mission_package_configuration_udk() -> None:
    """Protocol 141: the old form of the other era answers the same question."""
    item = ActuatorItem(name="a", links=(ActuatorLink(max_speed=1.571, max_torque=5),))
    assert mission_package_configuration(UDK, [item]) == (
        "CONF {Type MisPkg} {Name a} {Link 1} {JointType Revolute} {MaxRotationSpeed 1.571} "
        "{MaxTorque 5.0000} {MinRange 1} {MaxRange 0}"
    )


def test_actuator_configuration() -> None:
    """Protocol 139: links from 1, each with JointType, MaxTorque, MinValue, MaxValue."""
    assert actuator_configuration([ARM]) == (
        "CONF {Type Actuator} {Name ArmA} {Link 1} {JointType Revolute} {MaxTorque 500.0000} "
        "{MinValue -1.5708} {MaxValue 1.5708} {Link 2} {JointType Prismatic} "
        "{MaxTorque 800.0000} {MinValue 0.0000} {MaxValue 0.3500}"
    )


def test_a_slider_needs_limits_in_order() -> None:
    """Protocol 139 and 183: CONF Actuator gives a link that turns for ever one turn, smaller limit
    first."""
    text = actuator_configuration([PAN_TILT])
    assert "{Link 1} {JointType Revolute} {MaxTorque 20.0000} {MinValue -3.1415} " in text
    assert "{MinValue -3.1415} {MaxValue 3.1415} {Link 2}" in text


def test_several_actuators_share_a_line() -> None:
    """Protocol 127: without Name all of them follow each other, each again beginning with Name."""
    other = ActuatorItem(name="ArmB", links=ARM.links)
    for text in (
        actuator_configuration([ARM, other]),
        actuator_geometry([ARM, other]),
        mission_package_geometry([ARM, other]),
        mission_package_configuration(UT2004, [ARM, other]),
    ):
        assert text.index("{Name ArmA}") < text.index("{Name ArmB}")
        assert text.count("{Link 1}") == 2


def test_no_actuator_gives_no_line() -> None:
    """Protocol 126: nothing asked for exists, nothing is sent."""
    assert mission_package_geometry([]) == actuator_geometry([]) == ""
    assert mission_package_configuration(UDK, []) == actuator_configuration([]) == ""
    assert effector_geometry("Gripper", []) == ""


def test_effector_configurations() -> None:
    """Protocol 4.8: the opcodes of grippers and tool changers."""
    assert configuration("Gripper", [gripper_item("Gripper1")]) == (
        "CONF {Type Gripper} {Name Gripper1} {Opcode Grip} {MaxVal 1} {MinVal 0} {Opcode Close} "
        "{Opcode Open}"
    )
    assert configuration("ToolChanger", [tool_changer_item("t", 0.05, 0.1)]) == (
        "CONF {Type ToolChanger} {Name t} {PositionTolerance 0.0500} {AngleTolerance 0.1000} "
        "{Opcode Close} {Opcode Open}"
    )


@pytest.mark.parametrize(
    ("wire_type", "ok", "text"),
    [
        ("Camera", True, "{Status OK}"),
        ("Camera", False, "{Status Failed}"),
        ("RFID", True, "{status OK}"),
        ("RFID", False, "{status Failed}"),
        ("RFIDReleaser", True, "{status OK}"),
    ],
)
def test_results(wire_type: str, ok: bool, text: str) -> None:
    """Protocol 163, 165 and 5.2 no. 19: lower case `status` for RFID and RFIDReleaser only."""
    assert result(63.41, wire_type, "n", ok) == (
        f"RES {{Time 63.41}} {{Type {wire_type}}} {{Name n}} {text}"
    )


def test_releaser_result_ends_in_ok() -> None:
    """Protocol 164: `{status OK}` directly before CR LF."""
    data = encode(result(63.41, "RFIDReleaser", "Gun", True))
    assert data == b"RES {Time 63.41} {Type RFIDReleaser} {Name Gun} {status OK}\r\n"


def test_rfid_read_result() -> None:
    """Protocol 165, 40: ID and the stored text, blanks included."""
    extra = (("ID", "118"), ("Mem", "two words"))
    assert result(63.41, "RFID", "RFID", True, extra) == (
        "RES {Time 63.41} {Type RFID} {Name RFID} {status OK} {ID 118} {Mem two words}"
    )


def test_result_without_name() -> None:
    """Protocol 4.10: Type stays the second segment behind Time."""
    assert result(1, "Effector", None, True) == "RES {Time 1.00} {Type Effector} {Status OK}"


def test_viewports_result() -> None:
    """Protocol 4.10: camera and status of every viewport, in order."""
    viewports = [("Camera1", True), ("Disabled", True), ("None", False)]
    assert viewports_result(2, viewports) == (
        "RES {Time 2.00} {Type Viewports} {Viewport1 Camera1} {Status OK} "
        "{Viewport2 Disabled} {Status OK} {Viewport3 None} {Status Failed}"
    )
