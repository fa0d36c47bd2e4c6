"""Shipped robots with limbs, played in a running world: the checks of the protocol reference."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from actuator_fakes import settle, spawn, values

from usarsim_server.protocol.numbers import fixed
from usarsim_server.testing import Rehearsal, RehearsedClient


def test_the_answer_comes_first_after_init(stage: Rehearsal, client: RehearsedClient) -> None:
    """After INIT and GETCONF in one packet the next line is the CONF line (protocol 142)."""
    client.send("INIT {ClassName USARBot.KR60} {Location 0,0,0}", "GETCONF {Type Actuator}")
    stage.run(0.6)
    assert client.lines[0].startswith("CONF {Type Actuator} {Name KR60Arm} {Link 1} {JointType ")
    assert any(line.startswith("STA") for line in client.lines[1:])


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
@pytest.mark.parametrize(("name", "item"), [("P2AT", "CameraPanTilt"), ("P3AT_arm", "P3ATArm")])
def test_both_forms_are_answered(
    stage: Rehearsal, client: RehearsedClient, name: str, item: str, dialect: str
) -> None:
    """GETCONF and GETGEO of MisPkg and of Actuator, in either dialect (protocol 139 to 141)."""
    spawn(stage, client, name, f"{{Dialect {dialect}}}")
    client.send("GETCONF {Type MisPkg}", "GETCONF {Type Actuator}")
    client.send(f"GETGEO {{Type MisPkg}} {{Name {item}}}", "GETGEO {Type Actuator}")
    package, actuator, package_geo, geo = client.take()
    assert package.startswith(f"CONF {{Type MisPkg}} {{Name {item}}} {{Link 1}} ")
    speed = "MaxSpeed" if dialect == "ut2004" else "MaxRotationSpeed"
    assert f"{{JointType Revolute}} {{{speed} " in package
    assert actuator.startswith(f"CONF {{Type Actuator}} {{Name {item}}} {{Link 1}} ")
    assert actuator.count("{MinValue ") == actuator.count("{Link ") >= 2
    assert "{Link 1} {ParentLink -1} {Location " in package_geo
    assert f"{{Mount {name}}} {{Link 1}} {{Parent 0}} {{Location " in geo


def test_udk_announces_its_own_speed(stage: Rehearsal, client: RehearsedClient) -> None:
    """Joints of the UDK generation announce 1.571 rad/s (robots reference 1.9)."""
    spawn(stage, client, "KR60")
    client.send("GETCONF {Type MisPkg}")
    assert client.take()[0].count("{MaxRotationSpeed 1.571}") == 6


@pytest.mark.parametrize(
    ("name", "dialect", "head", "period"),
    [
        ("P2AT", "ut2004", "MISSTA", 0.2),
        ("P2AT", "udk", "ASTA", 0.1),
        ("P3AT_arm", "udk", "EFF", 0.1),
        ("P3AT_arm", "ut2004", "MISSTA", 0.2),
    ],
)
def test_status_periods(
    stage: Rehearsal, client: RehearsedClient, name: str, dialect: str, head: str, period: float
) -> None:
    """MISSTA keeps the period of STA, ASTA and EFF come every 0.1 s (protocol 4.9, 5.2 no. 22)."""
    spawn(stage, client, name, f"{{Dialect {dialect}}}")
    stage.run(5.0)
    lines = client.take()
    count = sum(line.startswith(head + " ") for line in lines)
    assert count == pytest.approx(5.0 / period, rel=0.02)
    other = {"MISSTA": "ASTA", "ASTA": "MISSTA", "EFF": "MISSTA"}[head]
    assert not any(line.startswith(other + " ") for line in lines)
    if dialect == "ut2004":
        assert not any(line.startswith("EFF") for line in lines)


def test_everything_that_reports_can_be_asked(stage: Rehearsal, client: RehearsedClient) -> None:
    """For every item in ASTA and EFF, GETCONF and GETGEO give one line each (protocol 125)."""
    spawn(stage, client, "KR60")
    stage.run(0.3)
    items = {("Actuator", "KR60Arm")}
    for line in client.take("EFF"):
        found = re.search(r"\{Type (\w+)\} \{Name (\w+)\}", line)
        assert found is not None
        items.add((found[1], found[2]))
    assert items == {
        ("Actuator", "KR60Arm"),
        ("ToolChanger", "toolchange"),
        ("Gripper", "KR60gripper"),
    }
    for kind, name in sorted(items):
        client.take()
        client.send(f"GETCONF {{Type {kind}}} {{Name {name}}}")
        client.send(f"GETGEO {{Type {kind}}} {{Name {name}}}")
        conf, geo = client.take()
        assert conf.startswith(f"CONF {{Type {kind}}} {{Name {name}}}")
        assert geo.startswith(f"GEO {{Type {kind}}} {{Name {name}}}")


def test_sensors_on_links_say_so(stage: Rehearsal, client: RehearsedClient, tmp_path: Path) -> None:
    """Mount is the link in `ut2004`, the actuator with MountLink in `udk` (protocol 4.7)."""
    (tmp_path / "Eye.toml").write_text(
        'extends = "P2AT"\n[[sensor]]\ntype = "Sonar"\nname = "Eye"\n'
        'link = "camerapantilt_link2"\nposition = [0.06, 0, -0.0087]\n',
        encoding="utf-8",
    )
    with Rehearsal(world="empty", robots=[tmp_path]) as own:
        for dialect, expected in (
            (
                "ut2004",
                "GEO {Type Sonar} {Name Eye Location 0.0600,0.0000,-0.0087 "
                "Orientation 0.0000,0.0000,0.0000 Mount CameraPanTilt_Link2}",
            ),
            (
                "udk",
                "GEO {Type Sonar} {Name Eye} {Location 0.06,0.00,0.00} "
                "{Orientation 0.00,0.00,0.00} {Mount CameraPanTilt} {MountLink 2}",
            ),
        ):
            one = own.connect()
            one.send(f"INIT {{ClassName Eye}} {{Location 0,0,-0.25}} {{Dialect {dialect}}}")
            one.send("GETGEO {Type Sonar} {Name Eye}")
            assert one.lines[-1].replace("-0.00}", "0.00}") == expected
            one.close()


def test_sensors_on_links_move_with_them(tmp_path: Path) -> None:
    """A range finder on the tilt link sees the floor when the link looks down."""
    (tmp_path / "Eye.toml").write_text(
        'extends = "P2AT"\n[[sensor]]\ntype = "RangeSensor"\nname = "Eye"\nmax_range = 9\n'
        'link = "CameraPanTilt_Link2"\n',
        encoding="utf-8",
    )
    with Rehearsal(world="empty", robots=[tmp_path]) as own:
        client = own.connect()
        client.send("INIT {ClassName Eye} {Location 0,0,-0.25}")
        settle(own, client, 0.5)
        reading = re.compile(r"\{Name Eye Range ([\d.]+)\}")

        def seen() -> float:
            found = [reading.search(line) for line in client.lines if "{Type Range}" in line]
            assert found[-1] is not None
            return float(found[-1][1])

        assert seen() == 9.0
        client.send("MISPKG {Name CameraPanTilt} {Link 2} {Value -0.5}")
        settle(own, client, 4.0)
        height = 0.1993 + 0.25
        assert seen() == pytest.approx(height / 0.4794, rel=0.02)


@pytest.mark.parametrize(
    "command",
    [
        "MISPKG {Name CameraPanTilt} {Link 1} {Value 0.5}",
        "MISPKG {Name CameraPanTilt} {Link 1} {Value 0.5} {Order 0}",
        "MISPKG {Name camerapantilt} {Link 9} {Value 3} {Link 1} {Value 0.5} {Link 0} {Value 9}",
        "MISPKG {Name CameraPanTilt} {Rotation 0,0,0.5}",
        "ACT {Name CameraPanTilt} {Link 0} {Value 0.5}",
        "ACT {Name CameraPanTilt} {Link 2} {Value 3} {Link 0} {Value 0.5}",
        "MULTIDRIVE {CameraPanTilt_Joint1 0.5}",
        "DRIVE {Name CameraPanTilt_Joint1} {Value 0.5}",
        "DRIVE {Name CameraPanTilt_Link1} {Value 0.5} {Order 0}",
        "SET {Type Joint} {Name CameraPanTilt_Joint1} {Opcode Angle} {Params 0.5}",
    ],
)
def test_every_way_to_move_a_link(stage: Rehearsal, client: RehearsedClient, command: str) -> None:
    """All commands move the first link, and reports call it Link 1 (protocol 155 to 159)."""
    spawn(stage, client, "P2AT", "{Dialect ut2004}")
    client.send(command)
    settle(stage, client, 3.5)
    found = values(client, "MISSTA", "CameraPanTilt")
    assert found == {1: pytest.approx(0.5, abs=1e-3), 2: pytest.approx(0.0, abs=1e-3)}


def test_all_joints(stage: Rehearsal, client: RehearsedClient) -> None:
    """AllJoints addresses both links of the pan-tilt (protocol 156)."""
    spawn(stage, client, "P2AT")
    client.send("SET {Type Joint} {Name AllJoints} {Opcode Angle} {Params 0.3}")
    assert client.take() == [
        f"RES {{Time {fixed(stage.time, 2)}}} {{Type Joint}} {{Name AllJoints}} {{Status OK}}"
    ]
    settle(stage, client, 3.0)
    found = values(client, "MISSTA", "CameraPanTilt")
    assert found == {1: pytest.approx(0.3, abs=1e-3), 2: pytest.approx(0.3, abs=1e-3)}


@pytest.mark.parametrize(("value", "stop"), [(3.0, 0.7854), (-3.0, -0.7854)])
def test_links_stop_at_their_limits(
    stage: Rehearsal, client: RehearsedClient, value: float, stop: float
) -> None:
    """Positions and speeds beyond the limits end at the limit (protocol 160)."""
    spawn(stage, client, "P2AT")
    client.send(f"MISPKG {{Name CameraPanTilt}} {{Link 2}} {{Value {value}}}")
    settle(stage, client, 5.5)
    assert values(client, "MISSTA", "CameraPanTilt")[2] == pytest.approx(stop, abs=2e-3)
    client.send(f"MISPKG {{Name CameraPanTilt}} {{Link 2}} {{Value {-value}}} {{Order 1}}")
    settle(stage, client, 10.0)
    assert values(client, "MISSTA", "CameraPanTilt")[2] == pytest.approx(-stop, abs=2e-3)


def test_speeds_and_torques(stage: Rehearsal, client: RehearsedClient) -> None:
    """Order 1 turns at a speed, never faster than announced; order 2 pushes (protocol 3.9)."""
    spawn(stage, client, "P2AT")
    client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 0.1} {Order 1}")
    settle(stage, client, 1.0)
    first = values(client, "MISSTA", "CameraPanTilt")[1]
    settle(stage, client, 1.5)
    assert values(client, "MISSTA", "CameraPanTilt")[1] - first == pytest.approx(0.2, abs=0.01)
    client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value -99} {Order 1}")
    settle(stage, client, 0.5)
    first = values(client, "MISSTA", "CameraPanTilt")[1]
    settle(stage, client, 1.5)
    assert values(client, "MISSTA", "CameraPanTilt")[1] - first == pytest.approx(-0.349, abs=0.01)
    client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 5} {Order 2}")
    first = values(client, "MISSTA", "CameraPanTilt")[1]
    settle(stage, client, 1.0)
    assert values(client, "MISSTA", "CameraPanTilt")[1] > first


def test_pan_goes_left_and_tilt_goes_up(stage: Rehearsal, client: RehearsedClient) -> None:
    """The announced axes are the true ones: pan about up, tilt about right."""
    spawn(stage, client, "P2AT")
    client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 0.3} {Link 2} {Value 0.2}")
    stage.run(3.0)
    vehicle = stage.robot_state(-1)
    x, y, z = vehicle.link_pose("CameraPanTilt_Link2").rotate((1.0, 0.0, 0.0))
    assert x > 0.9
    assert y == pytest.approx(0.29, abs=0.01)
    assert z == pytest.approx(0.199, abs=0.01)


def test_turning_the_camera_does_not_turn_the_robot(
    stage: Rehearsal, client: RehearsedClient
) -> None:
    """A P2AT at rest stays where it is while its pan-tilt moves."""
    spawn(stage, client, "P2AT")
    stage.run(1.0)
    before = stage.robot_state(-1)
    client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 3} {Link 2} {Value 0.7}")
    stage.run(5.0)
    after = stage.assembly.robots.vehicles[-1].body.look()
    assert after is not None
    assert after.pose.position == pytest.approx(before.pose.position, abs=1e-3)
    assert after.pose.quaternion == pytest.approx(before.pose.quaternion, abs=1e-3)


def test_wheel_commands_with_a_robot_name_still_drive(
    stage: Rehearsal, client: RehearsedClient
) -> None:
    """`DRIVE {Name robot_0} {Left f} {Right f}` is a wheel command (addendum)."""
    spawn(stage, client, "P2AT")
    client.send("DRIVE {Name robot_0} {Left 1} {Right 1}")
    stage.run(1.0)
    vehicle = stage.robot_state(-1)
    assert vehicle.wheel_speeds == pytest.approx([1.0] * 4, abs=0.05)


def test_without_power_nothing_moves(stage: Rehearsal, client: RehearsedClient) -> None:
    """An empty battery silences the pan-tilt and leaves it where it is (protocol 3.1 column B)."""
    client.send("INIT {ClassName P2AT} {Battery 1} {Location 0,0,-0.25}")
    stage.run(1.5)
    client.take()
    client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 1}", "GETCONF {Type MisPkg}")
    stage.run(2.0)
    assert not any(line.startswith(("MISSTA", "CONF")) for line in client.lines)
    vehicle = stage.robot_state(-1)
    assert vehicle.joint_position("CameraPanTilt_Joint1") == pytest.approx(0.0, abs=1e-3)
