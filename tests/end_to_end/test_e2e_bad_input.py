"""Nothing a client sends may crash, stall or bloat the server, or touch another client."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

import psutil
import pytest

from usarsim_server.testing import ScriptedClient, ServerProcess, eventually

Connect = Callable[[], ScriptedClient]


def _alive(client: ScriptedClient) -> None:
    client.send("GETSTARTPOSES")
    assert client.wait_for("NFO {StartPoses")


def test_random_bytes(client: ScriptedClient) -> None:
    """After 1000 lines of random bytes a valid command works (check 19)."""
    chance = random.Random(7)
    for _ in range(1000):
        client.send_bytes(chance.randbytes(chance.randrange(1, 120)) + b"\n")
    _alive(client)


def test_long_lines(client: ScriptedClient) -> None:
    """A 65536 byte line is processed, a 1 MiB one is discarded, both live on (check 20)."""
    padding = " " * (65536 - len("GETSTARTPOSES {x}"))
    client.send("GETSTARTPOSES {x" + padding + "}")
    assert client.wait_for("NFO {StartPoses")
    client.send_bytes(b"x" * (1 << 20))
    client.send_bytes(b"\r\n")
    _alive(client)


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
    """Whatever INIT says, a proper one on the same connection works afterwards (check 71)."""
    client = connect()
    client.wait_for("NFO {Gametype")
    client.send(init)
    client.send("INIT {ClassName P2AT} {Location 50,50,-0.3}")
    assert client.wait_for("STA {Type GroundVehicle}")


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e308", "-1e308", "1e999", "x" * 300])
def test_silly_drive_values(connect: Connect, value: str) -> None:
    """The robot stays finite and where robots can be, and another one does not notice (45, 53)."""
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
