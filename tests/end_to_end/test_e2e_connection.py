"""Life of a connection over real sockets (protocol reference 6.1 and 6.2)."""

from __future__ import annotations

import contextlib
import re
import socket
import struct
import time
from collections.abc import Callable
from itertools import pairwise

import pytest

from usarsim_server.testing import ScriptedClient, eventually

Connect = Callable[[], ScriptedClient]
RESET = struct.pack("ii", 1, 0)
"""SO_LINGER with no time left: closing sends a reset."""


def _sta_time(line: str) -> float:
    found = re.search(r"\{Time ([\d.]+)\}", line)
    assert found is not None
    return float(found.group(1))


def test_silence_before_commands(connect: Connect) -> None:
    """A silent connection gets the greeting and nothing else (checks 2, 3, 5)."""
    client = connect()
    witness = connect()
    witness.send("INIT {ClassName P2AT} {Location -10,-30,-0.3}")
    witness.listen(2.0)
    lines = client.fence()
    assert len(lines) == 1
    assert re.fullmatch(r"NFO \{Gametype \S+\} \{Level \S+\} \{TimeLimit \d+\}", lines[0])


@pytest.mark.parametrize("end", [b"\r\n", b"\n", b"\r", b"\n\r", b"\r\n\n", b"  \t \r\n"])
def test_every_line_end_is_understood(client: ScriptedClient, end: bytes) -> None:
    """GETSTARTPOSES is answered exactly once whatever ends the line (checks 21-24, 28, 31)."""
    client.send_bytes(b"\r\n\n\r" * 5 + b"  GETSTARTPOSES" + end)
    client.send("INIT {ClassName P2AT} {Location -10,-36,-0.3}\r\nGETGEO {Type Robot}")
    heads = []
    while "GEO {Type Ground" not in heads:
        heads.append(client.read_line()[:16])
    assert heads.count("NFO {StartPoses ") == 1


def test_one_byte_per_packet(client: ScriptedClient) -> None:
    """A command sent byte by byte is executed, and not before its terminator (checks 26, 27)."""
    for byte in b"GETSTARTPOSES":
        client.send_bytes(bytes([byte]))
        time.sleep(0.002)
    assert client.read_for(0.2) == []
    client.send_bytes(b"\n")
    assert client.read_line().startswith("NFO {StartPoses")


def test_replies_come_in_order_and_before_streams(client: ScriptedClient) -> None:
    """INIT, GETCONF and GETGEO in one packet are answered in order, streams later (25, 30, 70)."""
    client.send(
        "INIT {ClassName P2AT} {Location 1,1,-0.3}\r\nGETCONF {Type Robot}\r\n"
        "GETGEO {Type Robot}\r\nGETSTARTPOSES"
    )
    heads = [client.read_line().split()[0] for _ in range(3)]
    assert heads == ["CONF", "GEO", "NFO"]
    client.wait_for("STA")


@pytest.mark.parametrize("how", ["close", "half-close", "reset", "mid-line"])
def test_a_robot_leaves_with_its_connection(connect: Connect, how: str) -> None:
    """After any kind of goodbye the place is free again (checks 13, 14, 15)."""
    first = connect()
    first.send("INIT {ClassName P3AT_real} {Location -5,-5,-0.3}")
    first.wait_for("STA")
    second = connect()
    second.send("INIT {ClassName P3AT_real} {Location -3.5,-5,-0.3} {Dialect udk}")
    ahead = second.wait_for(lambda line: "{Name R4}" in line)
    assert _range(ahead) < 1.6, "the sonar at the back sees the first robot"
    if how == "half-close":
        first.socket.shutdown(socket.SHUT_WR)
    elif how == "reset":
        first.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        first.close()
    else:
        if how == "mid-line":
            first.send_bytes(b"DRIVE {Left 1.0} {Ri")
        first.close()
    # The goodbye is noticed in wall time, so only that it is counts here.
    assert eventually(lambda: _range(second.wait_for(lambda line: "{Name R4}" in line)) > 4.9)


def _range(line: str) -> float:
    found = re.search(r"\{Range ([\d.]+)\}", line)
    assert found is not None
    return float(found.group(1))


def test_a_client_that_does_not_read(connect: Connect) -> None:
    """It neither slows the world nor loses replies or line borders (checks 16, 17, 18)."""
    lazy, lively = connect(), connect()
    lazy.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    lazy.send("INIT {ClassName P2AT} {Location 30,0,-0.3}")
    lively.send("INIT {ClassName P2AT} {Location 33,0,-0.3}")
    for _ in range(20):
        lazy.send("GETGEO {Type Sonar}")
    # Far more than its buffers hold is said to the lazy one meanwhile.
    times = [_sta_time(lively.wait_for("STA")) for _ in range(15)]
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert max(gaps) < 0.45, "the world and the other robot went on"
    lines = lazy.listen(0.5)
    assert sum(line.startswith("GEO {Type Sonar}") for line in lines) == 20
    assert all(re.match(r"(NFO|STA|SEN|GEO|MISSTA) \{.*\}$", line) for line in lines)


def test_lines_of_one_step_carry_one_time(connect: Connect) -> None:
    """Two robots report equal Time for equal steps, and Time never decreases (checks 67, 68)."""
    robots = [connect(), connect()]
    for index, robot in enumerate(robots):
        robot.send(f"INIT {{ClassName P3AT}} {{Location {40 + 3 * index},5,-0.3}}")
    for robot in robots:
        lines = [line for line in robot.listen(1.0) if "{Time " in line]
        times = [_sta_time(line) for line in lines]
        assert times == sorted(times)
        assert len(set(times)) < len(times), "lines of one step share their Time"


def _admitted(connect: Connect) -> ScriptedClient:
    """A connection; those of the test before may still be ending and fill the house."""
    admitted: list[ScriptedClient] = []

    def enter() -> bool:
        client = connect()
        with contextlib.suppress(ConnectionError):
            client.wait_for("NFO {Gametype")
            admitted.append(client)
        return bool(admitted)

    assert eventually(enter)
    return admitted[0]


def test_sixty_four_connections_with_a_robot_each(connect: Connect) -> None:
    """64 robots are served at once, and a 65th connection harms nobody (check 12)."""
    clients = []
    for index in range(64):
        client = _admitted(connect)
        x, y = 3.0 * (index % 8), 60.0 + 3.0 * (index // 8)
        client.send(f"INIT {{ClassName P2AT}} {{Location {x},{y},-0.3}}")
        clients.append(client)
    for client in clients:
        assert client.wait_for("STA").startswith("STA {Type GroundVehicle}")
    extra = connect()
    with contextlib.suppress(ConnectionError):
        extra.read_for(0.2)
    assert clients[0].wait_for("STA")
