"""The sample dialogues of protocol reference 5.5, played over real sockets."""

from __future__ import annotations

import re
from collections.abc import Callable

from usarsim_server.testing import ScriptedClient

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
    """The ut2004 dialogue of 5.5 happens as written (checks 2, 3, 30, 85, 134, 143, 174, 179)."""
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
    """The udk dialogue of 5.5 happens as written (checks 12, 125, 130, 173, 181)."""
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
    """A UvA reader finds pose and sonars at its fixed places (checks 97, 100, 103, 106, 186)."""
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
    """Robots of one class speak different dialects at the same time (checks 98, 176, 178)."""
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
