"""Shipped robots with limbs, played in a running world: the checks of the protocol reference."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from usarsim_server.protocol.numbers import fixed
from usarsim_server.testing import Rehearsal, RehearsedClient

WORLD = """<mujoco model="bench">
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" friction="1"/>
    <body name="parcel" pos="0.5 -0.043724 0.6">
      <freejoint/>
      <geom type="box" size="0.03 0.03 0.05" mass="0.3"/>
    </body>
    <geom name="table" type="box" pos="0.5 -0.043724 0.275" size="0.06 0.2 0.275"/>
    <body name="case" pos="21.8 0 0.2">
      <freejoint/>
      <geom type="box" size="0.2 0.2 0.2" mass="0.5"/>
    </body>
  </worldbody>
</mujoco>
"""
TEXT = """title = "Bench"
description = "A parcel on a table, a case on the floor."
[[start]]
tag = "Start"
position = [0.0, 0.0, 0.2]
"""
"""A parcel on a table before the arm of a P3AT_arm at the origin, and a case beside a KR60."""


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """One empty world for the tests of commands and texts."""
    with Rehearsal(world="empty", max_robots=64) as rehearsal:
        yield rehearsal


@pytest.fixture
def client(stage: Rehearsal) -> Iterator[RehearsedClient]:
    """A connection that is closed after the test."""
    connection = stage.connect()
    yield connection
    connection.close()
    stage.run(0.05)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rehearsal]:
    """A world with things to take hold of."""
    folder: Path = tmp_path_factory.mktemp("bench")
    (folder / "scene.xml").write_text(WORLD, encoding="utf-8")
    (folder / "world.toml").write_text(TEXT, encoding="utf-8")
    with Rehearsal(world=str(folder)) as rehearsal:
        yield rehearsal


def spawn(stage: Rehearsal, client: RehearsedClient, name: str, extra: str = "") -> None:
    """Spawn a robot at the origin, away from everybody, and let its quiet period pass."""
    client.send(f"INIT {{ClassName USARBot.{name}}} {{Location 0,0,-0.25}} {extra}")
    stage.run(0.5)
    client.take()


def values(client: RehearsedClient, head: str, name: str) -> dict[int, float]:
    """Position by link number in the newest status line of an actuator."""
    lines = [x for x in client.lines if x.startswith(head + " ") and f"{{Name {name}}}" in x]
    pairs = re.findall(r"\{Link (\d+)\} \{Value (-?[\d.]+)\}", lines[-1])
    return {int(link): float(value) for link, value in pairs}


def settle(stage: Rehearsal, client: RehearsedClient, seconds: float) -> None:
    """Let time pass and keep only the lines of the last half second."""
    stage.run(seconds)
    client.take()
    stage.run(0.5)


# -- texts -----------------------------------------------------------------------------------------


def test_the_answer_comes_first_after_init(stage: Rehearsal, client: RehearsedClient) -> None:
    """After INIT and GETCONF in one packet the next line is the CONF line (check 142)."""
    client.send("INIT {ClassName USARBot.KR60} {Location 0,0,0}", "GETCONF {Type Actuator}")
    stage.run(0.6)
    assert client.lines[0].startswith("CONF {Type Actuator} {Name KR60Arm} {Link 1} {JointType ")
    assert any(line.startswith("STA") for line in client.lines[1:])


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
@pytest.mark.parametrize(("name", "item"), [("P2AT", "CameraPanTilt"), ("P3AT_arm", "P3ATArm")])
def test_both_forms_are_answered(
    stage: Rehearsal, client: RehearsedClient, name: str, item: str, dialect: str
) -> None:
    """GETCONF and GETGEO of MisPkg and of Actuator, in either dialect (checks 139 to 141)."""
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
    """MISSTA keeps the period of STA, ASTA and EFF come every 0.1 s (4.9, 5.2 no. 22)."""
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
    """For every item in ASTA and EFF, GETCONF and GETGEO give one line each (check 125)."""
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
    """Mount is the link in `ut2004`, the actuator with MountLink in `udk` (4.7)."""
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


# -- commands --------------------------------------------------------------------------------------


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
    """All commands move the first link, and reports call it Link 1 (checks 155 to 159)."""
    spawn(stage, client, "P2AT", "{Dialect ut2004}")
    client.send(command)
    settle(stage, client, 3.5)
    found = values(client, "MISSTA", "CameraPanTilt")
    assert found == {1: pytest.approx(0.5, abs=1e-3), 2: pytest.approx(0.0, abs=1e-3)}


def test_all_joints(stage: Rehearsal, client: RehearsedClient) -> None:
    """AllJoints addresses both links of the pan-tilt (check 156)."""
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
    """Positions and speeds beyond the limits end at the limit (check 160)."""
    spawn(stage, client, "P2AT")
    client.send(f"MISPKG {{Name CameraPanTilt}} {{Link 2}} {{Value {value}}}")
    settle(stage, client, 5.5)
    assert values(client, "MISSTA", "CameraPanTilt")[2] == pytest.approx(stop, abs=2e-3)
    client.send(f"MISPKG {{Name CameraPanTilt}} {{Link 2}} {{Value {-value}}} {{Order 1}}")
    settle(stage, client, 10.0)
    assert values(client, "MISSTA", "CameraPanTilt")[2] == pytest.approx(-stop, abs=2e-3)


def test_speeds_and_torques(stage: Rehearsal, client: RehearsedClient) -> None:
    """Order 1 turns at a speed, never faster than announced; order 2 pushes (3.9)."""
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
    vehicle = stage.assembly.fleet.vehicles[-1].body.look()
    assert vehicle is not None
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
    before = stage.assembly.fleet.vehicles[-1].body.look()
    client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 3} {Link 2} {Value 0.7}")
    stage.run(5.0)
    after = stage.assembly.fleet.vehicles[-1].body.look()
    assert before is not None
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
    vehicle = stage.assembly.fleet.vehicles[-1].body.look()
    assert vehicle is not None
    assert vehicle.wheel_speeds == pytest.approx([1.0] * 4, abs=0.05)


def test_without_power_nothing_moves(stage: Rehearsal, client: RehearsedClient) -> None:
    """An empty battery silences the pan-tilt and leaves it where it is (3.1 column B)."""
    client.send("INIT {ClassName P2AT} {Battery 1} {Location 0,0,-0.25}")
    stage.run(1.5)
    client.take()
    client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 1}", "GETCONF {Type MisPkg}")
    stage.run(2.0)
    assert not any(line.startswith(("MISSTA", "CONF")) for line in client.lines)
    vehicle = stage.assembly.fleet.vehicles[-1].body.look()
    assert vehicle is not None
    assert vehicle.joint_position("CameraPanTilt_Joint1") == pytest.approx(0.0, abs=1e-3)


def test_arm_platforms_report_their_links(stage: Rehearsal, client: RehearsedClient) -> None:
    """KR60 moves all its joints, ASTA lists them from 1, its foot stands (5.1 #12, #13)."""
    spawn(stage, client, "KR60")
    targets = (0.5, -0.4, 0.3, -0.6, 0.4, 0.7)
    groups = " ".join(f"{{Link {i}}} {{Value {value}}}" for i, value in enumerate(targets))
    client.send(f"ACT {{Name KR60Arm}} {groups}", "DRIVE {Left 1} {Right 1}")
    settle(stage, client, 2.0)
    found = values(client, "ASTA", "KR60Arm")
    assert found == {i: pytest.approx(value, abs=1e-3) for i, value in enumerate(targets, start=1)}
    foot = stage.assembly.fleet.vehicles[-1].body.look()
    assert foot is not None
    assert foot.pose.position == pytest.approx((0.0, 0.0, 0.25), abs=1e-4)
    client.send("GETGEO {Type Robot}", "GETCONF {Type Robot}")
    assert client.lines[-2:] == [
        "GEO {Type StaticPlatform} {Name KR60}",
        "CONF {Name KR60} {Type StaticPlatform} {SteeringType None} {Mass 0}",
    ]
    assert any(
        re.match(r"STA \{Time [\d.]+\} \{Battery 99999\} \{Type Static", x) for x in client.lines
    )


def test_arms_and_pan_tilts_stand_side_by_side(stage: Rehearsal) -> None:
    """Orders to one robot do not move another one of the same class (check 178)."""
    one, other = stage.connect(), stage.connect()
    one.send("INIT {ClassName P2AT} {Location 10,0,-0.25}")
    other.send("INIT {ClassName P2AT} {Location 10,3,-0.25} {Dialect udk}")
    one.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 0.4}")
    stage.run(4.0)
    assert values(one, "MISSTA", "CameraPanTilt")[1] == pytest.approx(0.4, abs=1e-3)
    assert values(other, "ASTA", "CameraPanTilt")[1] == pytest.approx(0.0, abs=1e-3)
    one.close()
    other.close()
    stage.run(0.05)


# -- effectors -------------------------------------------------------------------------------------


def status(client: RehearsedClient, name: str) -> str:
    """What the newest EFF line of an effector says behind its name."""
    lines = [x for x in client.lines if x.startswith("EFF") and f"{{Name {name}}}" in x]
    return lines[-1].split("{Status ")[1]


@pytest.mark.parametrize(
    ("opcode", "expected"),
    [("CLOSE", "CLOSED}"), ("Grip} {Params 1", "CLOSED}"), ("OPEN", "OPEN}")],
)
def test_gripper_states(
    stage: Rehearsal, client: RehearsedClient, opcode: str, expected: str
) -> None:
    """SET changes the Status that EFF tells (check 161)."""
    spawn(stage, client, "P3AT_arm")
    stage.run(0.2)
    assert status(client, "P3ATGripper") == "OPEN}"
    client.send(f"SET {{Type Gripper}} {{Name P3ATGripper}} {{Opcode {opcode}}}")
    stage.run(0.2)
    assert status(client, "P3ATGripper") == expected


def reach(x: float, z: float) -> str:
    """ACT of P3AT_arm that brings the fingers to a place ahead (m over the floor), hand level."""
    ahead, up, upper, fore = x - 0.20, z - 0.563, 0.16, 0.17
    bend = math.acos((ahead**2 + up**2 - upper**2 - fore**2) / (2 * upper * fore))
    swing = math.atan2(fore * math.sin(bend), upper + fore * math.cos(bend))
    shoulder = math.atan2(up, ahead) + swing
    angles = {1: shoulder, 2: -bend, 4: bend - shoulder}
    groups = " ".join(f"{{Link {i}}} {{Value {angle:.4f}}}" for i, angle in angles.items())
    return f"ACT {{Name P3ATArm}} {groups}"


def test_an_arm_takes_a_parcel_and_puts_it_down(bench: Rehearsal) -> None:
    """P3AT_arm reaches for the parcel, grips it, lifts it aside and lets it fall."""
    client = bench.connect()
    client.send("INIT {ClassName P3AT_arm} {Location 0,0,-0.146} {Dialect udk}")
    bench.run(0.5)

    def parcel() -> list[float]:
        snapshot = bench.assembly.simulation.look()
        model = bench.assembly.simulation._engine.world.model
        return [float(value) for value in snapshot.xpos[model.body("parcel").id]]

    start = parcel()
    assert start == pytest.approx([0.5, -0.0437, 0.6], abs=0.01)
    client.send(reach(0.38, 0.60))
    bench.run(2.0)
    for step in range(1, 13):
        client.send(reach(0.38 + 0.01 * step, 0.60))
        bench.run(0.1)
    bench.run(0.5)
    assert parcel() == pytest.approx(start, abs=0.015), "it was not touched"
    client.send("SET {Type Gripper} {Opcode CLOSE}")
    bench.run(1.5)
    vehicle = bench.assembly.fleet.vehicles[-1]
    state = vehicle.body.look()
    assert state is not None
    assert state.hand("P3ATGripper").holding == "parcel"
    news = "NFO {Status ItemAttached} {Time "
    (told,) = [line for line in client.lines if line.startswith(news)]
    assert told.endswith("{Type Gripper} {Name P3ATGripper}")
    client.send(reach(0.45, 0.72))
    bench.run(1.5)
    client.send("ACT {Name P3ATArm} {Link 0} {Value 0.8}")
    bench.run(1.5)
    lifted = parcel()
    assert lifted[2] == pytest.approx(0.72, abs=0.02)
    assert lifted[1] > 0.15, "positive turns are to the left"
    assert status(client, "P3ATGripper") == "CLOSED}"
    client.send("SET {Type Gripper} {Opcode OPEN}")
    bench.run(1.5)
    assert parcel()[2] < 0.4
    assert len([line for line in client.lines if "{Status ItemReleased}" in line]) == 1
    assert status(client, "P3ATGripper") == "OPEN}"
    client.close()
    bench.run(0.05)


def test_a_vacuum_gripper_on_a_tool_changer(bench: Rehearsal) -> None:
    """KR60 starts with its gripper, lifts a case with it, drops it, drops and misses its tool."""
    client = bench.connect()
    client.send("INIT {ClassName KR60} {Location 20,0,0} {Dialect udk}")
    bench.run(0.5)
    assert status(client, "toolchange") == "CLOSED} {ToolType Gripper} {Tool KR60gripper}"
    assert status(client, "KR60gripper") == "OPEN}"
    assert not [line for line in client.lines if line.startswith("NFO {Status")]
    client.send("GETGEO {Type Gripper}")
    assert client.lines[-1].startswith(
        "GEO {Type Gripper} {Name KR60gripper} {Location 0.06,0.00,0.00} "
        "{Orientation 0.00,1.57,0.00} {Mount KR60Arm} {MountLink 6} {Tip "
    )
    vehicle = bench.assembly.fleet.vehicles[-1]

    def holding(hand: str) -> str | None:
        state = vehicle.body.look()
        assert state is not None
        return state.hand(hand).holding

    # The cup looks down at the case, 0.1 m above it.
    client.send("ACT {Name KR60Arm} {Link 1} {Value -0.638} {Link 2} {Value -0.315}")
    client.send("ACT {Name KR60Arm} {Link 4} {Value 0.618}")
    bench.run(2.5)
    client.send("SET {Type Gripper} {Name KR60gripper} {Opcode CLOSE}")
    bench.run(0.3)
    assert holding("KR60gripper") == "case"
    client.send("MISPKG {Name KR60Arm} {Link 2} {Value 0.2} {Order 1}")
    bench.run(1.5)
    client.send("MISPKG {Name KR60Arm} {Link 2} {Value 0} {Order 1}")
    bench.run(0.5)
    assert holding("KR60gripper") == "case"
    state = vehicle.body.look()
    assert state is not None
    assert state.pose.position == pytest.approx((20.0, 0.0, 0.0), abs=1e-3)
    client.take()
    client.send("SET {Type Gripper} {Name KR60gripper} {Opcode OPEN}")
    client.send("SET {Type ToolChanger} {Opcode OPEN}")
    bench.run(1.5)
    assert holding("KR60gripper") is None
    assert status(client, "toolchange") == "OPEN}"
    news = [line.split("} {")[0] for line in client.lines if line.startswith("NFO {Status")]
    assert sorted(news) == ["NFO {Status ItemReleased", "NFO {Status ToolReleased"]
    client.take()
    client.send("SET {Type ToolChanger} {Opcode CLOSE}")
    bench.run(0.3)
    assert status(client, "toolchange") == "OPEN}"
    assert not any("{Name KR60gripper}" in line for line in client.take("EFF"))
    client.close()
    bench.run(0.05)


# -- flippers --------------------------------------------------------------------------------------


def test_flippers_are_driven_by_name_and_told_in_sta(tmp_path: Path) -> None:
    """MULTIDRIVE moves bare joints whatever the case of their names; STA tells them (check 154)."""
    side = {"FR": 0.2, "FL": -0.2}
    links = "".join(
        f'[[actuator.link]]\nname = "{name}Flipper"\nparent = 0\nposition = [0.2, {y}, 0]\n'
        "axis = [0, 1, 0]\n"
        'shape = [{ kind = "capsule", size = [0.03, 0.2], rotation = [0, 1.5708, 0], '
        "position = [0.1, 0, 0], mass = 0.3, collides = false }]\n"
        for name, y in side.items()
    )
    (tmp_path / "Crawler.toml").write_text(
        'extends = "P3AT"\n[[actuator]]\nname = "Flippers"\npackage = false\n' + links,
        encoding="utf-8",
    )
    with Rehearsal(world="empty", robots=[tmp_path]) as own:
        client = own.connect()
        client.send("INIT {ClassName Crawler} {Location 0,0,-0.25} {Dialect ut2004}")
        client.send("MULTIDRIVE {FRFlipper 0.5} {FLflipper -0.25}", "GETCONF {Type MisPkg}")
        own.run(2.0)
        newest = [line for line in client.lines if line.startswith("STA")][-1]
        found = re.search(r"\{FRFlipper ([\d.-]+)\} \{FLFlipper ([\d.-]+)\}", newest)
        assert found is not None
        assert float(found[1]) == pytest.approx(0.5, abs=1e-3)
        assert float(found[2]) == pytest.approx(-0.25, abs=1e-3)
        assert not any(line.startswith(("MISSTA", "CONF")) for line in client.lines)
