"""Sensors of life and tags on a robot in running worlds, from command lines to report lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from usarsim_server.testing import Rehearsal, RehearsedClient

SCENE = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="0 0 1" friction="1"/>
  <geom name="wall" type="box" pos="5 0 1" size="0.1 5 1"/>
</worldbody></mujoco>
"""

SHEET = """title = "Yard"
[[start]]
tag = "A"
position = [0.0, 0.0, 0.25]

[[victim]]
name = "MaleVictim_0"
position = [3.0, 0.0, 0.93]
yaw_degrees = 180.0
posture = "standing"
status = "Injured"
properties = { rfid = 4, motion = "wave", co2 = 0.5, sound = { delay = 0.0, period = 1.5 } }

[[rfid]]
id = 118
position = [1.0, -0.5, 0.01]
"""

TYPES = ("VictSensor", "RFID", "VictRFID", "HumanMotion", "Sound", "CO2Sensor")
ITEMS = {
    "VictSensor": "VictSensor",
    "RFID": "RFIDReader",
    "VictRFID": "VictRFID",
    "RFIDReleaser": "Gun",
    "HumanMotion": "HumanMotion",
    "Sound": "Sound",
    "CO2Sensor": "CO2",
}

Yard = Callable[..., Rehearsal]


@pytest.fixture
def yard(tmp_path: Path) -> Iterator[Yard]:
    """Makes rehearsals of a yard with a waving victim 3 m ahead, a tag, and a wall behind."""
    folder = tmp_path / "yard"
    folder.mkdir()
    (folder / "scene.xml").write_text(SCENE, encoding="utf-8")
    (folder / "world.toml").write_text(SHEET, encoding="utf-8")
    rehearsals: list[Rehearsal] = []

    def make(**settings: object) -> Rehearsal:
        rehearsals.append(Rehearsal(world=str(folder), **settings))
        return rehearsals[-1]

    yield make
    for rehearsal in rehearsals:
        rehearsal.close()


def robot(
    rehearsal: Rehearsal, location: str = "0,0,-0.25", more: str = ""
) -> tuple[RehearsedClient, list[str]]:
    """A rescue robot that has been there for two seconds, and what it said."""
    client = rehearsal.connect()
    client.send(f"INIT {{ClassName USARBot.RescueP2AT}} {{Location {location}}} {more}")
    rehearsal.run(2.0)
    return client, client.take()


def of_type(lines: list[str], kind: str) -> list[str]:
    """SEN lines of a type."""
    return [line for line in lines if line.startswith("SEN ") and f"{{Type {kind}}}" in line]


def value(line: str, key: str) -> str:
    """Text of the first segment of a key."""
    found = re.search(rf"{{{key} ([^}}]*)}}", line)
    assert found is not None, line
    return found[1]


def vector(line: str, key: str = "Location") -> tuple[float, float, float]:
    """The first vector of a key."""
    x, y, z = (float(part) for part in value(line, key).split(","))
    return x, y, z


# ---- reports ------------------------------------------------------------------------------


def test_a_rescue_robot_finds_the_victim(yard: Yard) -> None:
    """Robots 105 to 110: every sensor tells its share, at its interval."""
    _, lines = robot(yard())
    found = {kind: of_type(lines, kind) for kind in TYPES}
    assert [len(found[kind]) for kind in TYPES] == [2, 9, 9, 9, 9, 9]
    for line in found["VictSensor"]:
        parts = set(re.findall(r"{PartName (\w+)}", line))
        assert {"Chest", "Leg"} <= parts <= {"Arm", "Hand", "Chest", "Pelvis", "Leg", "Foot"}
        assert vector(line)[0] == pytest.approx(2.8, abs=0.6)
        assert "{Time " in line
    for kind in TYPES[1:]:
        assert all("{Time " not in line for line in found[kind])
    assert found["VictRFID"][0].startswith(
        "SEN {Type VictRFID} {Name VictRFID} {VictimId 4} {VictimName MaleVictim_0} "
        "{VictimStatus Injured} {Location 2.7"
    )
    assert min(float(value(line, "Prob")) for line in found["HumanMotion"]) > 0.1
    loud = [float(value(line, "Loudness")) for line in found["Sound"]]
    assert max(loud) == pytest.approx(60.0, abs=1.5)
    assert float(value(found["CO2Sensor"][-1], "Density")) == pytest.approx(0.05, abs=0.02)


def test_tags_are_reported_relative_to_the_reader(yard: Yard) -> None:
    """Protocol 116: the tag 0.75 m ahead of the reader, 0.5 m right, 0.19 m below."""
    _, lines = robot(yard())
    line = of_type(lines, "RFID")[-1]
    pattern = r"SEN {Type RFID} {Name RFIDReader} {ID 118} {Location [^}]*} {Mem 0}"
    assert re.fullmatch(pattern, line)
    assert vector(line) == pytest.approx((0.75, 0.5, 0.19), abs=0.02)


def test_driving_up_to_the_victim(yard: Yard) -> None:
    """Robots 109: CO2 rises; the victim's parts and tag come nearer."""
    world = yard()
    client, _ = robot(world)
    client.send("DRIVE {Left 3} {Right 3}")
    world.run(4.8)
    lines = client.take()
    density = [float(value(line, "Density")) for line in of_type(lines, "CO2Sensor")]
    assert density == sorted(density)
    assert density[-1] > 2 * density[0]
    ahead = [vector(line)[0] for line in of_type(lines, "VictRFID")]
    assert ahead == sorted(ahead, reverse=True)
    assert ahead[0] - ahead[-1] == pytest.approx(4.6 * 3 * 0.13, abs=0.2)


def test_in_udk_the_lines_have_a_time(yard: Yard) -> None:
    """The data of UT2004 behind the head of UDK; SET is not answered (protocol 163)."""
    client, lines = robot(yard(), more="{Dialect udk}")
    for kind in TYPES:
        (line, *_) = of_type(lines, kind)
        assert re.match(r"SEN {Time \d+\.\d{4}} {Type \w+} {Name \w+} {", line)
    client.send("SET {Type RFID} {Name RFIDReader} {Opcode Write} {Params 118 silent}")
    client.send("SET {Type RFIDReleaser} {Name Gun} {Opcode Release}")
    assert client.take() == []


def test_every_item_answers_both_requests(yard: Yard) -> None:
    """Protocol 125: GETCONF and GETGEO of each type and name, one line each."""
    client, _ = robot(yard())
    for kind, name in ITEMS.items():
        for request, head in (("GETCONF", "CONF"), ("GETGEO", "GEO")):
            client.send(f"{request} {{Type {kind}}} {{Name {name}}}")
            (line,) = client.take()
            assert line.startswith(f"{head} {{Type {kind}}} {{Name {name}")
    client.send("GETCONF {Type VictSensor}")
    assert client.take() == [
        "CONF {Type VictSensor} {Name VictSensor} {MaxRange 6.0000} {HorizontalFOV 0.6981} "
        "{VerticalFOV 0.6981}"
    ]


def test_equal_runs_give_equal_lines(yard: Yard) -> None:
    """Robots 113 and 115: waving arm, noise and all; another seed differs."""
    runs = [robot(yard(seed=seed))[1] for seed in (1, 1, 2)]
    assert runs[0] == runs[1]
    assert of_type(runs[0], "VictSensor") != of_type(runs[2], "VictSensor")


# ---- commands -----------------------------------------------------------------------------


def replies(client: RehearsedClient, command: str) -> list[str]:
    """RES lines of a command, without their time."""
    client.take()
    client.send(command)
    return [re.sub(r"{Time \d+\.\d\d} ", "", line) for line in client.take("RES ")]


def test_memory_of_a_tag_from_the_wire(yard: Yard) -> None:
    """Protocol 40, 163 and 165: write, read, unknown number, each with one RES."""
    client, _ = robot(yard())
    head = "RES {Type RFID} {Name RFIDReader} "
    write = "SET {Type RFID} {Name RFID} {Opcode Write} {Params 118 two words}"
    assert replies(client, write) == [head + "{status OK}"]
    read = "SET {Type RFID} {Name RFID} {Opcode Read} {Params 118}"
    assert replies(client, read) == [head + "{status OK} {ID 118} {Mem two words}"]
    unknown = "SET {Type RFID} {Opcode Read} {Params 119}"
    assert replies(client, unknown) == [head + "{status Failed}"]
    assert replies(client, "SET {Type RFID} {Opcode Dance} {Params 118}") == []


def test_dropping_a_tag_from_the_wire(yard: Yard) -> None:
    """Protocol 164: the line ends in {status OK}, and the tag is there for everybody."""
    world = yard()
    client, _ = robot(world)
    other, _ = robot(world, location="-1.5,1.0,-0.25")
    (line,) = replies(client, "SET {Type RFIDReleaser} {Name Gun} {Opcode Release}")
    assert line == "RES {Type RFIDReleaser} {Name Gun} {status OK}"
    other.take()
    world.run(0.4)
    seen = of_type(other.take(), "RFID")[-1]
    assert re.findall(r"{ID (\d+)}", seen) == ["119", "118"]
    assert vector(seen) == pytest.approx((-0.27 + 1.5 - 0.25, -1.0, 0.1), abs=0.1)


def test_scan_of_the_acoustic_array_is_one_of_ut2004s_results(tmp_path: Path) -> None:
    """Protocol 163: a report at once, and its RES behind it."""
    (tmp_path / "Ears.toml").write_text(
        'extends = "P2AT"\nsensor = [{ type = "Acoustic", name = "Ear", interval = 0 }]\n',
        encoding="utf-8",
    )
    with Rehearsal(world="empty", robots=(tmp_path,)) as world:
        client = world.connect()
        client.send("INIT {ClassName Ears}")
        world.run(1.0)
        client.take()
        client.send("SET {Type Acoustic} {Name Ear} {Opcode SCAN}")
        first, second = client.take()
        assert re.fullmatch(r"SEN {Time [\d.]+} {Type Acoustic} {Name Ear} {None}", first)
        assert re.fullmatch(r"RES {Time [\d.]+} {Type Acoustic} {Name Ear} {Status OK}", second)


# ---- the shipped arena --------------------------------------------------------------------


@pytest.fixture
def arena() -> Iterator[Rehearsal]:
    """The arena."""
    with Rehearsal() as world:
        yield world


def test_a_tag_of_the_arena_can_be_read(arena: Rehearsal) -> None:
    """The tag at the middle of the staging zone, from 0.8 m away."""
    client, lines = robot(arena, location="-9.5,0,-0.25")
    assert "{ID 101} " in of_type(lines, "RFID")[-1]
    read = "SET {Type RFID} {Name RFIDReader} {Opcode Read} {Params 101}"
    (line,) = replies(client, read)
    assert line.endswith("{status OK} {ID 101} {Mem gate Staging}")


def test_the_walking_victim_of_the_arena_is_seen_walking(arena: Rehearsal) -> None:
    """VictRFID aside, VictSensor and HumanMotion follow him; laser and truth agree."""
    client, _ = robot(arena, location="7.6,1.0,-0.25")
    places = []
    for _ in range(6):
        arena.run(0.8)
        for line in of_type(client.take(), "VictSensor"):
            if "NoVictims" not in line:
                places.append(vector(line)[0])
    assert len(places) >= 5
    assert max(places) < 4.5
    arena.run(2.0)
    moving = [float(value(line, "Prob")) for line in of_type(client.take(), "HumanMotion")]
    assert max(moving) > 0.05


def test_a_robot_in_the_way_is_pushed_aside_and_lives(arena: Rehearsal) -> None:
    """Somebody who walks into a robot shoves it; the world goes on."""
    client, lines = robot(arena, location="10.0,1.0,-0.25")
    start = vector(of_type(lines, "GroundTruth")[0])
    arena.run(12.0)
    lines = client.take()
    way = [vector(line) for line in of_type(lines, "GroundTruth")]
    assert len(way) > 200
    moved = [abs(here[0] - start[0]) + abs(here[1] - start[1]) for here in way]
    assert 0.1 < max(moved) < 3.0
    assert all(abs(here[2] - start[2]) < 0.3 for here in way)


def test_the_false_alarm_of_the_arena_deceives(arena: Rehearsal) -> None:
    """Robots 107: nobody is near the barrel, yet a chest is reported now and then."""
    client, _ = robot(arena, location="1.0,8.2,-0.25")
    arena.run(16.0)
    reports = of_type(client.take(), "VictSensor")
    assert len(reports) == 20
    deceived = [line for line in reports if "NoVictims" not in line]
    assert len(deceived) > 3
    assert all("{PartName Chest}" in line for line in deceived)
    assert vector(deceived[0])[0] == pytest.approx(2.8, abs=0.8)
