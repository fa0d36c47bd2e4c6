"""The conformance checklist of the protocol reference: what takes a robot some time."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from itertools import pairwise

import pytest
from robot_files import DIALECTS, LEFT, RIGHT, table, values, write
from robot_files import kind as kind_of

from usarsim_server.testing import Rehearsal, RehearsedClient

# -- one robot, longer -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rehearsal]:
    """An empty world, and a robot with the sensors that no shipped one has."""
    folder = tmp_path_factory.mktemp("robots")
    sensor = [
        {"type": kind, "name": f"{kind}{side}", "position": [0.2, y, -0.1]}
        for kind in ("IR", "Touch")
        for side, y in (("Left", -0.1), ("Right", 0.1))
    ]
    wheels = [
        {"type": "Encoder", "name": "ECLeft", "wheel": "LeftWheel"},
        {"type": "Encoder", "name": "ECRight", "wheel": "RightWheel"},
        {"type": "GPS", "name": "GPS", "noise": False},
    ]
    robot = table(wheel=[LEFT, RIGHT], sensor=[*sensor, *wheels], kind="skid_steer")
    write(folder, "Probe", robot)
    with Rehearsal(world="empty", max_robots=64, robots=(folder,)) as rehearsal:
        yield rehearsal


@pytest.fixture
def connect(stage: Rehearsal) -> Iterator[Callable[[str], RehearsedClient]]:
    """Spawns robots, each far from the others; they leave after the test."""
    clients: list[RehearsedClient] = []

    def make(init: str) -> RehearsedClient:
        client = stage.connect()
        clients.append(client)
        place = f"{{Location {20 * len(clients)},-40,-0.3}}"
        client.send(f"INIT {init} {place}")
        stage.run(0.5)
        client.take()
        return client

    yield make
    for client in clients:
        client.close()
    stage.run(0.05)


Connect = Callable[[str], RehearsedClient]


def _sen(client: RehearsedClient, kind: str) -> list[str]:
    return [line for line in client.take("SEN") if kind_of(line) == kind]


@pytest.mark.parametrize("kind", ["IR", "Touch", "Encoder"])
def test_batches(stage: Rehearsal, connect: Connect, kind: str) -> None:
    """One multi-pair line in ut2004, one line each in udk (protocol 97 to 99)."""
    key = {"IR": "Range", "Touch": "Touch", "Encoder": "Tick"}[kind]
    batched = connect("{ClassName Probe} {Dialect ut2004}")
    single = connect("{ClassName Probe} {Dialect udk}")
    stage.run(0.45)
    value = r"(True|False|-?\d+(\.\d{4})?)"
    one = _sen(batched, kind)
    assert one
    for line in one:
        assert re.search(
            rf"(\{{Name \w+Left {key} {value}\}}) \{{Name \w+Right {key} {value}\}}$", line
        ), line
    each = _sen(single, kind)
    assert len(each) >= 2 * (len(one) - 1)
    for line in each:
        assert re.fullmatch(rf"SEN \{{Time [\d.]+\}} .* \{{Name \w+\}} \{{{key} {value}\}}", line)


def test_no_battery(stage: Rehearsal, connect: Connect) -> None:
    """A robot without battery reports 99999, however long (protocol 93)."""
    client = connect("{ClassName Probe}")
    stage.run(3.0)
    assert {value for line in client.take("STA") for value in values(line, "Battery")} == {"99999"}


def test_encoders_and_gps_while_driving(stage: Rehearsal, connect: Connect) -> None:
    """Ticks rise forward; going along +x latitude rises in whole degrees and minutes (protocol 110,
    111)."""
    client = connect("{ClassName Probe} {Dialect ut2004}")
    client.send("DRIVE {Left 3} {Right 3}")
    stage.run(20.0)
    said = client.take("SEN")
    ticks = [[int(t) for t in values(line, "Tick")] for line in said if kind_of(line) == "Encoder"]
    assert ticks[-1][0] > ticks[0][0] + 1000, "three turns per 2 pi seconds, not wrapped"
    assert all(later >= earlier for earlier, later in pairwise(ticks))
    north = []
    for line in (line for line in said if kind_of(line) == "GPS"):
        found = re.search(
            r"\{Latitude (\d+),(\d+\.\d{4}),[NS]\} \{Longitude \d+,\d+\.\d{4},[EW]\} \{Fix 1\}",
            line,
        )
        assert found is not None, line
        north.append(int(found.group(1)) + float(found.group(2)) / 60)
    # 20 s at 0.3 m/s, 111.2 km to the degree.
    assert north[-1] - north[0] == pytest.approx(5.9 / 111_200, rel=0.1)


def test_misses(stage: Rehearsal, connect: Connect) -> None:
    """Where nothing is, lasers and sonars report MaxRange of CONF (protocol 101, 103, 105)."""
    client = connect("{ClassName P2AT}")
    stage.run(0.5)
    said = client.take("SEN")
    client.send("GETCONF {Type RangeScanner}", "GETCONF {Type Sonar}")
    laser, sonar = client.take("CONF")
    scan = next(line for line in said if kind_of(line) == "RangeScanner")
    ranges = values(scan, "Range")[0].split(",")
    assert set(ranges) == set(values(laser, "MaxRange"))
    printed = float(values(scan, "FOV")[0]) / float(values(scan, "Resolution")[0])
    assert len(ranges) == 181 <= round(printed) + 1
    echo = next(line for line in said if kind_of(line) == "Sonar")
    assert set(values(echo, "Range")) == set(values(sonar, "MaxRange"))


def test_a_robot_beside_the_laser(stage: Rehearsal) -> None:
    """What stands to the right is in the first half of the list (protocol 101, 104)."""
    client, other = stage.connect(), stage.connect()
    client.send("INIT {ClassName P2AT} {Location -40,40,-0.3}")
    other.send("INIT {ClassName P2AT} {Location -40,41.5,-0.3}")
    stage.run(0.6)
    said = client.take("SEN")
    ranges = [float(text) for text in values(_first(said, "RangeScanner"), "Range")[0].split(",")]
    assert min(ranges[:90]) < 1.5
    assert min(ranges[91:]) == 20.0
    echoes = dict(zip(
        values(_first(said, "Sonar"), "Name"),
        map(float, values(_first(said, "Sonar"), "Range")), strict=True,
    ))  # fmt: skip
    assert min(echoes["F7"], echoes["F8"]) < 2.0 < echoes["F2"] == 5.0
    assert all(0.1 <= value <= 5.0 for value in echoes.values())
    client.close()
    other.close()


def _first(lines: list[str], kind: str) -> str:
    return next(line for line in lines if kind_of(line) == kind)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_ranges_of_angles(stage: Rehearsal, connect: Connect, dialect: str) -> None:
    """Turning round and round INS stays in [0, 2 pi), GroundTruth as its dialect (protocol 64,
    65)."""
    client = connect(f"{{ClassName P2AT}} {{Dialect {dialect}}}")
    client.send("DRIVE {Left -5} {Right 5}")
    stage.run(9.0)
    said = client.take("SEN")
    angles: dict[str, list[list[float]]] = {"INS": [], "GroundTruth": []}
    for line in said:
        if kind_of(line) in angles:
            texts = values(line, "Orientation")[0].split(",")
            angles[kind_of(line)].append([float(text) for text in texts])
    assert all(0.0 <= value < 6.2832 for row in angles["INS"] for value in row)
    truth = [row[2] for row in angles["GroundTruth"]]
    if dialect == "ut2004":
        assert all(0.0 <= value < 6.2832 for row in angles["GroundTruth"] for value in row)
        assert max(truth) > 6.0, "it passed zero"
    else:
        assert all(-3.1416 < value <= 3.1416 for value in truth)
        assert min(truth) < -2.8
        assert max(truth) > 2.8


def test_equal_steps_have_equal_times(stage: Rehearsal) -> None:
    """Robots that began together report the same times, step by step (protocol 67, 68)."""
    clients = [stage.connect() for _ in range(3)]
    for index, client in enumerate(clients):
        client.send(f"INIT {{ClassName P3AT}} {{Location {index * 3},60,-0.3}}")
    stage.run(2.0)
    times = [[values(line, "Time")[0] for line in client.take("STA")] for client in clients]
    assert len(times[0]) > 10
    assert times[0] == times[1] == times[2]
    assert [float(text) for text in times[0]] == sorted(map(float, times[0]))
    client.send("GETSTARTPOSES")
    assert not client.take("STA"), "while time stands still nothing is streamed"
    for client in clients:
        client.close()


def test_intervals_of_udk_sensors(stage: Rehearsal, connect: Connect) -> None:
    """Each sensor of a P3AT keeps the original's interval (protocol 91, 122; 4.14)."""
    client = connect("{ClassName P3AT}")
    stage.run(20.0)
    said = client.take()
    expected = {"GroundTruth": 0.1, "INS": 0.2, "RangeScanner": 0.2, "Tachometer": 0.2}
    expected |= {"Odometry": 0.1}
    for kind, interval in expected.items():
        count = sum(line.startswith("SEN") and kind_of(line) == kind for line in said)
        assert count == pytest.approx(20.0 / interval, abs=1), kind
    ticks = sum("{Name W1}" in line for line in said)
    assert ticks == pytest.approx(200, abs=1)


def test_tachometer(stage: Rehearsal, connect: Connect) -> None:
    """Vel before Pos, a number for every driven wheel, and both tell of the motion
    (protocol 119)."""
    client = connect("{ClassName P3AT}")
    client.send("DRIVE {Left 1} {Right 0.5}")
    stage.run(4.0)
    lines = _sen(client, "Tachometer")
    for line in lines:
        assert re.search(r"\{Vel (-?[\d.]+,){3}-?[\d.]+\} \{Pos (-?[\d.]+,){3}-?[\d.]+\}$", line)
    speeds = [float(text) for text in values(lines[-1], "Vel")[0].split(",")]
    # Right before left, front before back (part order of the class).
    assert speeds == pytest.approx([0.5, 1.0, 0.5, 1.0], abs=0.03)


def test_udk_order_of_status() -> None:
    """With sta_order = udk STA is what the original sent, 10 Hz (protocol 86, 91)."""
    form = re.compile(
        r"STA \{Time \d+\.\d{4}\} \{Battery \d+\} \{Type GroundVehicle\} "
        r"\{LightToggle (True|False)\} \{LightIntensity 100\} \{FrontSteer 0\} \{RearSteer 0\}"
    )
    with Rehearsal(world="empty", sta_order="udk") as stage:
        client, other = stage.connect(), stage.connect()
        client.send("INIT {ClassName P3AT} {Location 0,0,-0.3}", "DRIVE {Light true}")
        other.send("INIT {ClassName P2AT} {Location 5,0,-0.3}")
        stage.run(5.3)
        lines = client.take("STA")
        assert len(lines) == pytest.approx(50, abs=2)
        assert all(form.fullmatch(line) for line in lines), lines[0]
        assert "{LightToggle True}" in lines[-1]
        assert other.take("STA")[0].startswith("STA {Type GroundVehicle} {Time "), "not in ut2004"


# -- driving ---------------------------------------------------------------------------------------


def _speeds(stage: Rehearsal, client: RehearsedClient, *commands: str) -> list[float]:
    client.send(*commands)
    stage.run(1.5)
    return [float(text) for text in values(_sen(client, "Tachometer")[-1], "Vel")[0].split(",")]


@pytest.mark.parametrize(("dialect", "next_speed"), [("ut2004", 1.0), ("udk", 0.013)])
def test_percent_and_limit(
    stage: Rehearsal, connect: Connect, dialect: str, next_speed: float
) -> None:
    """Too much is MaxSpeed, 100 percent is, then rad/s or still percent (protocol 131, 146,
    147)."""
    client = connect(f"{{ClassName P3AT}} {{Dialect {dialect}}}")
    full = [1.3] * 4
    assert _speeds(stage, client, "DRIVE {Left 50} {Right 50}") == pytest.approx(full, abs=0.02)
    assert _speeds(stage, client, "DRIVE {Left 0} {Right 0}") == pytest.approx([0] * 4, abs=0.005)
    command = "DRIVE {Left 100} {Right 100} {Normalized true}"
    assert _speeds(stage, client, command) == pytest.approx(full, abs=0.02)
    after = _speeds(stage, client, "DRIVE {Left 1} {Right 1}")
    assert after == pytest.approx([next_speed] * 4, abs=0.02)


def test_wheels_by_number(stage: Rehearsal, connect: Connect) -> None:
    """WheelNumber 0 and 1 drive these two; the others stand against it (protocol 150)."""
    client = connect("{ClassName P3AT}")
    groups = "{WheelNumber 0} {WheelSpeed 1} {WheelNumber 1} {WheelSpeed 1}"
    speeds = _speeds(stage, client, f"DRIVE {groups}")
    assert speeds == pytest.approx([1, 1, 0, 0], abs=0.15)


@pytest.mark.parametrize("spelling", ["drive {left 1} {RIGHT 1}", "DRIVE{Left 1}{Right 1}"])
def test_spellings_drive_alike(stage: Rehearsal, connect: Connect, spelling: str) -> None:
    """Case of names and blanks around segments do not matter (protocol 32, 33)."""
    client = connect("{ClassName P3AT}")
    assert _speeds(stage, client, spelling) == pytest.approx([1.0] * 4, abs=0.02)


def test_geometry_predicts_motion(stage: Rehearsal, connect: Connect) -> None:
    """Radius and separation of GEO give straight and turning speed of a P3DX (protocol 132)."""
    client = connect("{ClassName P3DX} {Dialect ut2004}")
    client.send("GETGEO {Type Robot}")
    geo = client.take("GEO")[0]
    radius, track = (float(values(geo, key)[0]) for key in ("WheelRadius", "WheelSeparation"))

    def pose() -> list[float]:
        client.take()
        stage.run(0.1)
        line = _sen(client, "GroundTruth")[-1]
        numbers = [values(line, key)[0].split(",") for key in ("Location", "Orientation")]
        return [float(text) for text in numbers[0] + numbers[1]]

    client.send("DRIVE {Left 3} {Right 3}")
    stage.run(1.0)
    start = pose()
    stage.run(4.0)
    end = pose()
    assert end[0] - start[0] == pytest.approx(radius * 3 * 4.1, rel=0.1)
    client.send("DRIVE {Left 1} {Right -1}")
    stage.run(1.0)
    start = pose()
    stage.run(2.0)
    turned = (pose()[5] - start[5]) % math.tau
    assert turned == pytest.approx(radius * 2 / track * 2.1, rel=0.1)


def test_no_flip_in_udk(stage: Rehearsal, connect: Connect) -> None:
    """Flip is of the UT2004 generation: in udk an overturned robot stays so (robots 50)."""
    client = connect("{ClassName P2AT} {Dialect udk} {Rotation 3.14159,0,0}")
    client.send("DRIVE {Flip True}")
    stage.run(1.5)
    roll = float(values(_sen(client, "GroundTruth")[-1], "Orientation")[0].split(",")[0])
    assert abs(roll) > 2.8


# -- links -----------------------------------------------------------------------------------------


def _links(client: RehearsedClient) -> list[float]:
    line = [line for line in client.take() if line.startswith(("MISSTA", "ASTA"))][-1]
    return [float(text) for text in values(line, "Value")]


@pytest.mark.parametrize(
    ("command", "pan", "tilt"),
    [
        ("MISPKG {Name CameraPanTilt} {Link 1} {Value 0.3}", 0.3, 0.0),
        ("MISPKG {Name camerapantilt} {Link 2} {Value 0.3} {Order 0}", 0.0, 0.3),
        ("ACT {Name CameraPanTilt} {Link 0} {Value 0.3}", 0.3, 0.0),
        ("MISPKG {Name CameraPanTilt} {Link 9} {Value 1} {Link 1} {Value 0.3}", 0.3, 0.0),
        ("MISPKG {Name CameraPanTilt} {Link 2} {Value 3}", 0.0, 0.7854),
        ("MISPKG {Name CameraPanTilt} {Rotation 0,0.2,0.3}", 0.3, 0.2),
        ("DRIVE {Name CameraPanTilt_Link2} {Value 0.2}", 0.0, 0.2),
        ("DRIVE {Order 0} {Value 0.2} {Steer 0} {Name camerapantilt_link1}", 0.2, 0.0),
        ("SET {Type Joint} {Name CameraPanTilt_Link2} {Opcode Angle} {Params 0.2}", 0.0, 0.2),
        ("SET {Type joint} {Name AllJoints} {Opcode Target} {Params 0.2}", 0.2, 0.2),
        ("SET {Type Joint} {Name Nobody} {Opcode Angle} {Params 0.2}", 0.0, 0.0),
        ("MISPGK {Name CameraPanTilt} {Link 1} {Value 0.3}", 0.0, 0.0),
    ],
)
def test_links_move(
    stage: Rehearsal, connect: Connect, command: str, pan: float, tilt: float
) -> None:
    """Links obey by number, limits hold, unknown ones do no harm (protocol 155 to 160; 3.6)."""
    client = connect("{ClassName P2AT}")
    client.send(command)
    stage.run(6.0)
    assert _links(client) == pytest.approx([pan, tilt], abs=0.02)


# -- commands that do nothing ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "command",
    [
        "TRACE {On true} {Interval 0.1} {Color Red}",
        "PAUSE",
        "KILL {Name x}",
        "Zilch {a b}",
        "CONTROL {Type KillAll}",
        "CONTROL {Type GetSTA}",
        "SET {Type Viewports} {Config SingleView} {Viewport1 Camera2}",
        "SET {Type Camera} {Robot x} {Name Camera} {Client 10.0.0.1}",
        "MOVE {Type Run} {Action New} {Location 1,2}",
        "DRIVE {Zilch 5} {Bad}",
    ],
)
def test_no_answer_and_no_effect(stage: Rehearsal, connect: Connect, command: str) -> None:
    """What a robot does not know makes no line and no motion (protocol 41, 42, 167)."""
    client = connect("{ClassName P3AT}")
    client.send(command)
    assert client.take() == []
    assert _speeds(stage, client) == [0.0] * 4


def test_names_with_other_letters(stage: Rehearsal, connect: Connect) -> None:
    """Bytes beyond ASCII in a Name leave the segments behind it readable (protocol 52)."""
    client = connect("{ClassName P2AT} {Name B\xe9la \xfc} {Battery 77}")
    stage.run(0.3)
    assert "{Battery 76}" in client.take("STA")[-1]


def test_questions_about_the_world() -> None:
    """Path nodes and the nearest one are told, start poses before and after INIT (protocol 80, 81,
    84)."""
    with Rehearsal(world="office") as stage:
        client = stage.connect()
        client.send("GETSTARTPOSES", "GETPATHNODES", "GETCLOSESTPATHNODE")
        poses, nodes = client.take()
        tag, location = re.findall(r"[{ ](\w+) (-?[\d.]+,-?[\d.]+,\S+) ", nodes)[2]
        client.send(f"GETCLOSESTPATHNODE {{Location {location}}}")
        assert client.take() == [f"NFO {{Pathnode {tag}}} {{Location {location}}}"]
        count = int(values(poses, "StartPoses")[0])
        assert poses.count(" ") == 2 + 3 * count
        assert nodes.count(" ") == 2 + 3 * int(values(nodes, "PathNodes")[0]) > 5
        client.send("INIT {ClassName P2AT} {Start RobotStart1}", "GETSTARTPOSES")
        assert client.take() == [poses]
