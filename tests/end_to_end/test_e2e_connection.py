"""Life of a connection over real sockets (protocol reference 6.1 and 6.2).

The sample dialogues of protocol reference 5.5, played over real sockets.

A robot in a corridor full of smoke, over real sockets: lasers suffer, sonars do not.
"""

from __future__ import annotations

import contextlib
import re
import socket
import struct
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from usarsim_server.testing import ScriptedClient, ServerProcess, eventually

Connect = Callable[[], ScriptedClient]
RESET = struct.pack("ii", 1, 0)
"""SO_LINGER with no time left: closing sends a reset."""


def _sta_time(line: str) -> float:
    found = re.search(r"\{Time ([\d.]+)\}", line)
    assert found is not None
    return float(found.group(1))


def test_silence_before_commands(connect: Connect) -> None:
    """A silent connection gets the greeting and nothing else (protocol 2, 3, 5)."""
    client = connect()
    witness = connect()
    witness.send("INIT {ClassName P2AT} {Location -10,-30,-0.3}")
    witness.listen(2.0)
    lines = client.fence()
    assert len(lines) == 1
    assert re.fullmatch(r"NFO \{Gametype \S+\} \{Level \S+\} \{TimeLimit \d+\}", lines[0])


@pytest.mark.parametrize("end", [b"\r\n", b"\n", b"\r", b"\n\r", b"\r\n\n", b"  \t \r\n"])
def test_every_line_end_is_understood(client: ScriptedClient, end: bytes) -> None:
    """GETSTARTPOSES is answered exactly once whatever ends the line (protocol 21-24, 28, 31)."""
    client.send_bytes(b"\r\n\n\r" * 5 + b"  GETSTARTPOSES" + end)
    client.send("INIT {ClassName P2AT} {Location -10,-36,-0.3}\r\nGETGEO {Type Robot}")
    heads = []
    while "GEO {Type Ground" not in heads:
        heads.append(client.read_line()[:16])
    assert heads.count("NFO {StartPoses ") == 1


def test_one_byte_per_packet(client: ScriptedClient) -> None:
    """A command sent byte by byte is executed, and not before its terminator (protocol 26, 27)."""
    for byte in b"GETSTARTPOSES":
        client.send_bytes(bytes([byte]))
        time.sleep(0.002)
    assert client.read_for(0.2) == []
    client.send_bytes(b"\n")
    assert client.read_line().startswith("NFO {StartPoses")


def test_replies_come_in_order_and_before_streams(client: ScriptedClient) -> None:
    """INIT, GETCONF and GETGEO in one packet are answered in order, streams later (protocol 25, 30,
    70)."""
    client.send(
        "INIT {ClassName P2AT} {Location 1,1,-0.3}\r\nGETCONF {Type Robot}\r\n"
        "GETGEO {Type Robot}\r\nGETSTARTPOSES"
    )
    heads = [client.read_line().split()[0] for _ in range(3)]
    assert heads == ["CONF", "GEO", "NFO"]
    client.wait_for("STA")


@pytest.mark.parametrize("how", ["close", "half-close", "reset", "mid-line"])
def test_a_robot_leaves_with_its_connection(connect: Connect, how: str) -> None:
    """After any kind of goodbye the place is free again (protocol 13, 14, 15)."""
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
    """It neither slows the world nor loses replies or line borders (protocol 16, 17, 18)."""
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
    """Two robots report equal Time for equal steps, and Time never decreases (protocol 67, 68)."""
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
    """64 robots are served at once, and a 65th connection harms nobody (protocol 12)."""
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


NUMBER = r"-?\d+\.\d+"
STA_UT2004 = re.compile(
    r"^STA \{Type GroundVehicle\} \{Time \d+\.\d\d\} \{FrontSteer -?\d+\.\d{4}\} "
    r"\{RearSteer -?\d+\.\d{4}\}( \{\w+ -?\d+\.\d{4}\})* \{LightToggle (True|False)\} "
    r"\{LightIntensity \d+\} \{Battery \d+\} \{View -?\d+\}$"
)


def _pose(line: str) -> list[float]:
    found = re.search(r"\{Pose ([^}]*)\}", line)
    assert found is not None
    return [float(part) for part in found.group(1).split(",")]


def test_a_player_like_client_drives_a_p2at(connect: Callable[[], ScriptedClient]) -> None:
    """The ut2004 dialogue of protocol 5.5 happens as written (protocol 2, 3, 30, 85, 134, 143, 174,
    179)."""
    client = connect()
    greeting = client.read_line()
    assert re.fullmatch(
        r"NFO \{Gametype BotDeathMatch\} \{Level [\w-]+\} \{TimeLimit \d+\}", greeting
    )
    client.send(
        "INIT {ClassName USARBot.P2AT} {Name R1} {Location 1.000000 -2.000000 1.800000} "
        "{Rotation 0.000000 0.000000 0.000000}"
    )
    client.send("GETGEO {Type RangeScanner}")
    client.send("GETCONF {Type RangeScanner}")
    assert client.read_line() == (
        "GEO {Type RangeScanner} {Name Scanner1 Location 0.1439,0.0000,-0.0920 "
        "Orientation 0.0000,0.0000,0.0000 Mount HARD}"
    )
    assert client.read_line() == (
        "CONF {Type RangeScanner} {Name Scanner1} {MaxRange 20.0000} {MinRange 0.1000} "
        "{Resolution 0.0174} {Fov 3.1415} {Paning True} {Tilting False}"
    )
    assert STA_UT2004.match(client.wait_for("STA"))
    start = _pose(client.wait_for("SEN {Type Odometry} {Name Odometry} {Pose "))
    client.send("DRIVE {Left 1.538462} {Right 1.538462}")
    end = start
    for _ in range(8):
        end = _pose(client.wait_for("SEN {Type Odometry}"))
    # 1.4 s or more at 1.538462 rad/s x 0.13 m = 0.2 m/s.
    assert 0.15 < end[0] - start[0] < 0.5
    assert abs(end[1]) < 0.01
    assert abs(end[2]) < 0.01


def test_a_ros_like_client_configures_itself(connect: Callable[[], ScriptedClient]) -> None:
    """The udk dialogue of protocol 5.5 happens as written (protocol 12, 125, 130, 173, 181)."""
    client = connect()
    assert client.read_line().startswith("NFO {Gametype BotDeathMatch}")
    client.send_bytes(
        b"GETSTARTPOSES\r\nINIT {Classname USARBot.P3AT} {Name rover} {Start RobotStart1}\r\n"
        b"GETCONF {Type RFID}\r\nGETGEO {Type RFID}\r\n"
    )
    poses = client.read_line()
    assert poses.startswith("NFO {StartPoses ")
    streamed: dict[str, str] = {}
    while len(streamed) < 6:
        line = client.read_line()
        if line.startswith("CONF {Type Camera}"):
            assert not streamed, "or it would look like the answer to a question"
            continue
        assert not line.startswith(("CONF", "GEO")), "the robot has no RFID item to answer for"
        found = re.match(r"SEN (?:\{Time [\d.]+\} )?\{Type (\w+)\} \{Name ([^}]+)\}", line)
        if found is not None:
            streamed.setdefault(found.group(1), found.group(2))
    assert streamed["RangeScanner"] == "lms200"
    for wire_type, name in streamed.items():
        client.send(f"GETCONF {{Type {wire_type}}} {{Name {name}}}")
        client.send(f"GETGEO {{Type {wire_type}}} {{Name {name}}}")
        head = f"{{Type {wire_type}}} {{Name {name}}}"
        assert client.wait_for("CONF").startswith(f"CONF {head}")
        assert client.wait_for("GEO").startswith(f"GEO {head}")
    client.send("GETCONF {Type Robot} {Name rover}")
    assert client.wait_for("CONF") == (
        "CONF {Name P3AT} {Type GroundVehicle} {SteeringType SkidSteered} {Mass 11.9000} "
        "{MaxSpeed 1.2999} {MaxTorque 50000.0000} {MaxFrontSteer 0} {MaxRearSteer 0}"
    )
    before = _location(client.wait_for(_is_ground_truth))
    client.send("Drive {Left 0.800000} {Right 0.800000}")
    for _ in range(12):
        after = _location(client.wait_for(_is_ground_truth))
    assert after[0] > before[0] + 0.05


def _is_ground_truth(line: str) -> bool:
    return "{Type GroundTruth}" in line


def _location(line: str) -> list[float]:
    found = re.search(r"\{Location ([^}]*)\}", line)
    assert found is not None
    return [float(part) for part in found.group(1).split(",")]


def test_scan_lines_suit_index_based_readers(connect: Callable[[], ScriptedClient]) -> None:
    """A UvA reader finds pose and sonars at its fixed places (protocol 97, 100, 103, 106, 186)."""
    client = connect()
    client.send("INIT {ClassName USARBot.P2AT} {Location 20,20,-0.3}")
    odometry = re.findall(r"\{[^\}]+\}|\S+", client.wait_for("SEN {Type Odometry}"))
    assert odometry[1] == "{Type Odometry}"
    assert odometry[3].startswith("{Pose ")
    sonar = re.findall(r"\{[^\}]+\}|\S+", client.wait_for(lambda line: "{Type Sonar}" in line))
    assert sonar[1].startswith("{Time ")
    assert sonar[2] == "{Type Sonar}"
    names = [group.split()[1] for group in sonar[3:]]
    assert names == [f"F{i}" for i in range(1, 9)] + [f"R{i}" for i in range(1, 9)]
    scan = client.wait_for(lambda line: "{Type RangeScanner}" in line)
    assert len(scan) < 2000
    found = re.search(r"\{Range ([^}]*)\}$", scan)
    assert found is not None, "Range is the last segment"
    assert len(found.group(1).split(",")) == 181


def test_two_dialects_side_by_side(connect: Callable[[], ScriptedClient]) -> None:
    """Robots of one class speak different dialects at the same time (protocol 98, 176, 178)."""
    first, second = connect(), connect()
    first.send("INIT {ClassName P3AT_real} {Dialect ut2004} {Location 10,10,-0.3}")
    second.send("INIT {ClassName P3AT_real} {Dialect udk} {Location 12,10,-0.3}")
    batched = first.wait_for(lambda line: "{Type Sonar}" in line)
    single = second.wait_for(lambda line: "{Type Sonar}" in line)
    assert batched.count("Range") == 16
    assert re.fullmatch(
        rf"SEN \{{Time {NUMBER}\}} \{{Type Sonar\}} \{{Name F1\}} "
        rf"\{{Range {NUMBER}\}}",
        single,
    )


SCOUT = """
name = "SmokeScout"
extends = "P3AT_real"
dialect = "udk"
sensor = [
    { type = "Hokuyo", name = "urg", position = [0.2, 0, -0.3] },
    { type = "SICK", name = "fogged", position = [0.2, 0, -0.3], smoke = "scatter" },
]
"""


def _ahead(client: ScriptedClient, name: str) -> float:
    """Middle beam of a scanner."""
    line = client.wait_for(
        lambda line: "{Type RangeScanner}" in line and f"{{Name {name}}}" in line
    )
    found = re.search(r"\{Range ([^}]*)\}", line)
    assert found is not None
    ranges = [float(text) for text in found.group(1).split(",")]
    return ranges[len(ranges) // 2]


def _sonar_ahead(client: ScriptedClient) -> float:
    line = client.wait_for(lambda line: "{Type Sonar} {Name F4}" in line)
    found = re.search(r"\{Range ([\d.]+)\}", line)
    assert found is not None
    return float(found.group(1))


def test_lasers_suffer_from_smoke_and_sonars_do_not(tmp_path: Path) -> None:
    """In smoke a Hokuyo reads 0, a scattering laser reads short, the SICK and sonars go on."""
    (tmp_path / "SmokeScout.toml").write_text(SCOUT)
    with ServerProcess("--world", "smoke_corridor", "--robots", str(tmp_path)) as server:
        inside, outside = server.client(), server.client()
        inside.send("INIT {ClassName SmokeScout} {Location 8.0,0,-0.3}")
        outside.send("INIT {ClassName SmokeScout} {Location 1.5,0,-0.3} {Rotation 0,0,3.14159}")
        for client in (inside, outside):
            client.wait_for("STA")
        assert _ahead(inside, "urg") == 0.0
        clear = _ahead(outside, "lms200")
        assert abs(_ahead(outside, "fogged") - clear) < 0.03
        assert _ahead(outside, "urg") > 0.0
        shorter = [_ahead(inside, "fogged") < _ahead(inside, "lms200") - 0.1 for _ in range(8)]
        assert any(shorter), "some echoes come back from the smoke itself"
        assert _sonar_ahead(inside) > 0.5
