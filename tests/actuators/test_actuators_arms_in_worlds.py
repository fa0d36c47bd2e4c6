"""Arms and hands in worlds: what they report, take and put down."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from actuator_fakes import settle, spawn, values

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
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rehearsal]:
    """A world with things to take hold of."""
    folder: Path = tmp_path_factory.mktemp("bench")
    (folder / "scene.xml").write_text(WORLD, encoding="utf-8")
    (folder / "world.toml").write_text(TEXT, encoding="utf-8")
    with Rehearsal(world=str(folder)) as rehearsal:
        yield rehearsal


def test_arm_platforms_report_their_links(stage: Rehearsal, client: RehearsedClient) -> None:
    """KR60 moves all its joints, ASTA lists them from 1, its foot stands (robots 12, 13)."""
    spawn(stage, client, "KR60")
    targets = (0.5, -0.4, 0.3, -0.6, 0.4, 0.7)
    groups = " ".join(f"{{Link {i}}} {{Value {value}}}" for i, value in enumerate(targets))
    client.send(f"ACT {{Name KR60Arm}} {groups}", "DRIVE {Left 1} {Right 1}")
    settle(stage, client, 2.0)
    found = values(client, "ASTA", "KR60Arm")
    assert found == {i: pytest.approx(value, abs=1e-3) for i, value in enumerate(targets, start=1)}
    foot = stage.robot_state(-1)
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
    """Orders to one robot do not move another one of the same class (protocol 178)."""
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
    """SET changes the Status that EFF tells (protocol 161)."""
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
    state = bench.robot_state(-1)
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

    def holding(hand: str) -> str | None:
        state = bench.robot_state(-1)
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
    state = bench.robot_state(-1)
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


def test_flippers_are_driven_by_name_and_told_in_sta(tmp_path: Path) -> None:
    """MULTIDRIVE moves bare joints whatever the case of their names; STA tells them
    (protocol 154)."""
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
