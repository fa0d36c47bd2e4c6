"""Nothing a client sends may crash, stall or bloat the server, or touch another client.

Names of robots, people and objects in a whole world: nobody answers for another.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator

import psutil
import pytest
from lanes import slow_but

from usarsim_server.protocol.truth import Position, positions
from usarsim_server.protocol.values import LONGEST_NAME
from usarsim_server.testing import (
    Rehearsal,
    RehearsedClient,
    ScriptedClient,
    ServerProcess,
    eventually,
)

Connect = Callable[[], ScriptedClient]


def _alive(client: ScriptedClient) -> None:
    client.send("GETSTARTPOSES")
    assert client.wait_for("NFO {StartPoses")


def test_random_bytes(client: ScriptedClient) -> None:
    """After 1000 lines of random bytes a valid command works (protocol 19)."""
    chance = random.Random(7)
    for _ in range(1000):
        client.send_bytes(chance.randbytes(chance.randrange(1, 120)) + b"\n")
    _alive(client)


def test_long_lines(client: ScriptedClient) -> None:
    """A 65536 byte line is processed, a 1 MiB one is discarded, both live on (protocol 20)."""
    padding = " " * (65536 - len("GETSTARTPOSES {x}"))
    client.send("GETSTARTPOSES {x" + padding + "}")
    assert client.wait_for("NFO {StartPoses")
    client.send_bytes(b"x" * (1 << 20))
    client.send_bytes(b"\r\n")
    _alive(client)


@pytest.mark.slow
def test_a_flood_of_unterminated_bytes_keeps_memory_bounded(
    server: ServerProcess, connect: Connect
) -> None:
    """Ten clients that send 8 MB each without a line end cost no memory that stays."""
    process = psutil.Process(server.process.pid)
    before = process.memory_info().rss
    for _ in range(10):
        client = connect()
        for _ in range(8):
            client.send_bytes(b"{" * (1 << 20))
    _alive(connect())
    assert eventually(lambda: process.memory_info().rss - before < 32 << 20)


def test_connections_that_never_read(server: ServerProcess, connect: Connect) -> None:
    """40 idle connections, half of them asking without reading, disturb nobody."""
    for index in range(40):
        client = connect()
        if index % 2:
            client.send("GETSTARTPOSES\r\n" * 200)
    _alive(connect())


@pytest.mark.parametrize(
    "init",
    [
        "INIT",
        "INIT {ClassName}",
        "INIT {ClassName USARBot.NoSuchRobot} {Location 0,0,0}",
        "INIT {ClassName P2AT} {Location 1e308,0,0}",
        "INIT {ClassName P2AT} {Location nan,inf,-inf} {Rotation nan,nan,nan} {Name x}{",
        "INIT {ClassName P2AT} {Location 0,0,-99999}",
        "INIT {ClassName ../../etc/passwd}",
        "INIT {ClassName P2AT\x00} {Location 0,0,0}",
    ],
)
def test_a_bad_init_leaves_the_connection_usable(connect: Connect, init: str) -> None:
    """Whatever INIT says, a proper one on the same connection works afterwards (protocol 71)."""
    client = connect()
    client.wait_for("NFO {Gametype")
    client.send(init)
    client.send("INIT {ClassName P2AT} {Location 50,50,-0.3}")
    assert client.wait_for("STA {Type GroundVehicle}")


@pytest.mark.parametrize(
    "value",
    slow_but(
        {"nan", "1e308"}.__contains__,
        ["nan", "inf", "-inf", "1e308", "-1e308", "1e999", "x" * 300],
    ),
)
def test_silly_drive_values(connect: Connect, value: str) -> None:
    """The robot stays finite and where robots can be, and another one does not notice (protocol 45,
    53)."""
    client, other = connect(), connect()
    client.send("INIT {ClassName P2AT} {Location 70,0,-0.3}")
    other.send("INIT {ClassName P2AT} {Location 73,0,-0.3}")
    client.wait_for("STA")
    other.listen(1.0)  # until it has come to rest
    place = other.wait_for(lambda line: "GroundTruth" in line and line.startswith("SEN"))
    client.send(f"DRIVE {{Left {value}}} {{Right -{value}}} {{Normalized true}}")
    client.send(f"SET {{Type INS}} {{Name INS}} {{Opcode POSE}} {{Params {value},0,0,0,0,{value}}}")
    client.send(f"MULTIDRIVE {{x {value}}}\r\nMISPKG {{Name x}} {{Link {value}}} {{Value {value}}}")
    lines = client.listen(1.0)
    assert any(line.startswith("STA") for line in lines)
    for line in lines:
        assert not re.search(r"nan|inf|\de[+-]?\d", line.lower())
    later = other.wait_for(lambda line: "GroundTruth" in line and line.startswith("SEN"))
    assert _location(place) == pytest.approx(_location(later), abs=0.02)


def _location(line: str) -> list[float]:
    found = re.search(r"\{Location ([^}]*)\}", line)
    assert found is not None
    return [float(part) for part in found.group(1).split(",")]


def test_robots_in_one_place(connect: Connect) -> None:
    """Robots told to start in one place all get one, and nobody is shot away."""
    clients = [connect() for _ in range(5)]
    for client in clients:
        client.send("INIT {ClassName P2AT} {Location -40,-40,-0.2}")
    places = []
    for client in clients:
        client.listen(0.1)
        line = client.wait_for(lambda line: "{Type GroundTruth}" in line)
        places.append(_location(line))
    for index, (x, y, _) in enumerate(places):
        assert abs(x + 40) < 4.0
        assert abs(y + 40) < 4.0
        for other in places[:index]:
            assert abs(x - other[0]) + abs(y - other[1]) > 0.3


def test_a_flood_of_commands(connect: Connect) -> None:
    """5000 DRIVE lines in one go are obeyed in order, if at their rate, and the last one counts."""
    client = connect()
    client.send("INIT {ClassName P2AT} {Location 80,20,-0.3}")
    client.wait_for("STA")
    flood = "".join(f"DRIVE {{Left {i % 5}}} {{Right {i % 3}}}\r\n" for i in range(5000))
    client.send_bytes(flood.encode() + b"DRIVE {Left 0} {Right 0}\r\nGETCONF {Type Robot}\r\n")
    assert client.wait_for("CONF")
    client.listen(1.0)
    first = client.wait_for("SEN {Type Encoder}")
    client.listen(0.5)
    assert client.wait_for("SEN {Type Encoder}") == first, "the wheels stand still"


@pytest.fixture
def stage() -> Iterator[Rehearsal]:
    """An empty world."""
    with Rehearsal(world="empty", max_robots=16) as rehearsal:
        yield rehearsal


def start(stage: Rehearsal, name: str, x: float, kind: str = "USARBot.P2AT") -> RehearsedClient:
    """A connection that has sent its INIT."""
    client = stage.connect()
    client.send(f"INIT {{ClassName {kind}}} {{Name {name}}} {{Location {x},0,-0.3}}")
    return client


def labels(stage: Rehearsal) -> list[str]:
    """Names of all robots, in the order of their coming."""
    return [vehicle.name for vehicle in stage.assembly.robots.vehicles]


def place(stage: Rehearsal, name: str) -> float:
    """x of a robot, m."""
    vehicle = stage.assembly.robots.find(name)
    state = None if vehicle is None else vehicle.body.look()
    assert state is not None
    return round(state.pose.position[0], 1)


def test_robots_that_differ_in_case_only_are_told_apart(
    stage: Rehearsal, caplog: pytest.LogCaptureFixture
) -> None:
    """The second gets a number, and orders for the first move the first."""
    start(stage, "Rover", 0.0)
    start(stage, "ROVER", 3.0)
    assert labels(stage) == ["Rover", "ROVER_2"]
    assert any("another name" in message for message in caplog.messages)
    controller = start(stage, "WC", 0.0, "USARBot.WorldController")
    controller.send("CONTROL {Type AbsMove} {Name rover_2} {Location 9,0,-0.3}")
    assert [place(stage, name) for name in labels(stage)] == [0.0, 9.0]
    controller.send("CONTROL {Type AbsMove} {Name rover} {Location -5,0,-0.3}")
    assert [place(stage, name) for name in labels(stage)] == [-5.0, 9.0]


def test_a_name_is_free_again_when_its_robot_has_left(stage: Rehearsal) -> None:
    """In any case of its letters."""
    start(stage, "R1", 0.0).close()
    stage.run(0.1)
    start(stage, "r1", 0.0)
    assert labels(stage) == ["r1"]


def test_a_name_with_fields_in_it_becomes_one_word(
    stage: Rehearsal, caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody forges a place in the lists that others read; the cleaned name is logged."""
    start(stage, "Evil Location 9,9,0 BatteryEmpty False", 1.0)
    start(stage, "Be\x07ll\x85", 3.0)
    assert labels(stage) == ["Evil_Location_9,9,0_BatteryEmpty_False", "Be_ll"]
    assert sum("another name" in message for message in caplog.messages) == 2
    assert stage.assembly.robots.find("Evil Location 9,9,0 BatteryEmpty False") is not None
    stations = stage.assembly.robots.stations()
    told = positions(Position(one.name, one.position) for one in stations)
    assert told.count(" Location ") == told.count(" BatteryEmpty ") == 2


def test_a_name_too_long_is_refused_and_the_connection_lives(
    stage: Rehearsal, caplog: pytest.LogCaptureFixture
) -> None:
    """Robots and people; the next INIT of the connection works."""
    for kind in ("USARBot.P2AT", "USARAvatar.USARAvatarNewMale"):
        client = start(stage, "x" * (LONGEST_NAME + 1), 0.0, kind)
        assert labels(stage) == []
        assert sum("INIT failed: the name has 65 characters" in m for m in caplog.messages) == 1
        caplog.clear()
    client.send("INIT {ClassName USARBot.P2AT} {Name " + "x" * LONGEST_NAME + "}")
    assert labels(stage) == ["x" * LONGEST_NAME]
    start(stage, "X" * LONGEST_NAME, 3.0)
    assert labels(stage)[1] == "X" * (LONGEST_NAME - 2) + "_2"


def test_a_class_that_is_spelled_by_the_client_has_to_be_a_name(stage: Rehearsal) -> None:
    """Classes that match a pattern keep the client's spelling: it is told to scoring tools."""
    find = stage.assembly.robots.describe
    patterns = stage.assembly.robots._catalog._patterns
    assert patterns, "some class answers to a pattern"
    for pattern, _ in patterns:
        assert find(pattern.replace("*", "q7")) is not None
        for text in ("x" * 65_000, "a} {b", "a b", "a\x85b"):
            assert find(pattern.replace("*", text)) is None


def test_objects_and_people_have_clean_names_too(
    stage: Rehearsal, caplog: pytest.LogCaptureFixture
) -> None:
    """CONTROL Create and avatars: one word each, unique; the memory of an object is bounded."""
    caplog.set_level("INFO", "usarsim")
    controller = start(stage, "WC", 0.0, "USARBot.WorldController")
    create = "CONTROL {Type Create} {ClassName USARPhysObj.Box} {Location %d,5,-0.5} {Name %s}"
    controller.send(create % (0, "my box"), create % (2, "MY_BOX"), create % (4, "y" * 65_000))
    controller.send((create % (6, "fat")) + " {Memory " + "m" * 5000 + "}")
    controller.take()
    controller.send("CONTROL {Type GetSTA}")
    (told,) = controller.take("STA")
    assert told.count("{Name ") == 1
    assert "{Name my_box}" in told
    controller.send("CONTROL {Type GetSTA} {Name my box}")
    assert "{Name my_box}" in controller.take("STA")[0]
    assert any("the name has 65000 characters" in message for message in caplog.messages)
    assert any("the memory has 5000 characters" in message for message in caplog.messages)
    kind = "USARAvatar.USARAvatarNewMale"
    start(stage, "Bob Location 1,1,1", 8.0, kind)
    start(stage, "bob_location_1,1,1", 10.0, kind)
    names = [avatar.name for avatar, _ in stage.assembly.roles.avatars.present()]
    assert names == ["Bob_Location_1,1,1", "bob_location_1,1,1_2"]
