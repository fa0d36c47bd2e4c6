"""Checks of the protocol reference that are seen only when a whole machine is played.

Numbers in docstrings are those of the protocol reference, section 6. Aircraft, cars and flippers
are looked at twice: by what they tell, and by where the physics has them.

The conformance checklist of the protocol reference over sockets: bytes, dialects, habits.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from itertools import pairwise

import pytest

from usarsim_server.sessions.robots import Vehicle
from usarsim_server.settings import Settings
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import (
    Rehearsal,
    RehearsedClient,
    ScriptedClient,
    ServerProcess,
    time_of,
)

FLIPPERS = ("FRFlipper", "FLFlipper", "RRFlipper", "RLFlipper")


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """An endless floor."""
    with Rehearsal(world="empty") as rehearsal:
        yield rehearsal


class Player:
    """A client with a robot, and the robot as the physics has it."""

    def __init__(self, stage: Rehearsal, robot_class: str, more: str) -> None:
        self.stage = stage
        self.client: RehearsedClient = stage.connect()
        self.client.send(f"INIT {{ClassName USARBot.{robot_class}}} {more}")
        self.vehicle: Vehicle = stage.assembly.robots.vehicles[-1]
        stage.run(0.5)

    @property
    def body(self) -> RobotBody:
        """Its state; it must not have been lost."""
        state = self.vehicle.body.look()
        assert state is not None, "lost"
        return state

    @property
    def place(self) -> tuple[float, float, float]:
        """x, y, z of the wire, m."""
        x, y, z = self.body.pose.position
        return x, -y, -z

    @property
    def yaw(self) -> float:
        """Yaw of the wire, rad: clockwise is positive."""
        x, y, _ = self.body.pose.rotate((1.0, 0.0, 0.0))
        return -math.atan2(y, x)

    def play(self, command: str, seconds: float) -> None:
        """Send one command and let time pass."""
        self.client.send(command)
        self.stage.run(seconds)

    def status(self) -> str:
        """The newest STA line; earlier lines are forgotten."""
        return self.client.take("STA")[-1]


Hire = Callable[..., Player]


@pytest.fixture
def hire(stage: Rehearsal) -> Iterator[Hire]:
    """Puts robots into the world; they leave after the test."""
    hired: list[Player] = []

    def make(robot_class: str, more: str) -> Player:
        hired.append(Player(stage, robot_class, more))
        return hired[-1]

    yield make
    for player in hired:
        player.client.close()
    stage.run(0.05)


def number(line: str, key: str) -> float:
    """The value of a segment that occurs once."""
    (text,) = re.findall(rf"\{{{key} (-?[\d.]+)\}}", line)
    return float(text)


# -- silence and time ------------------------------------------------------------------------------


def test_ten_seconds_of_silence(stage: Rehearsal) -> None:
    """Who sends no command hears nothing more, for ten simulated seconds (protocol 5)."""
    client = stage.connect()
    client.send("")
    client.take()
    stage.run(10.0)
    assert client.lines == []
    client.close()


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
def test_time_never_runs_back(hire: Hire, dialect: str) -> None:
    """All lines of a connection that tell a time tell it in order; it moves with the world
    (protocol 67).

    Kinds of lines print two to four digits, cut off: beyond two digits lines of one moment differ.
    """
    player = hire("P2AT", f"{{Location 0,0,-0.3}} {{Dialect {dialect}}}")
    player.client.take()
    begun = player.stage.time
    player.stage.run(3.0)
    texts = [re.findall(r"\{Time ([\d.]+)\}", line) for line in player.client.lines]
    times = [float(found[0]) for found in texts if found]
    assert len(times) > 30
    hundredths = [math.floor(100 * one + 1e-6) for one in times]
    assert hundredths == sorted(hundredths)
    assert begun - 0.01 <= times[0] < times[-1] <= begun + 3.0 + 1e-6
    assert times[-1] - times[0] > 2.5


# -- aircraft --------------------------------------------------------------------------------------


def test_status_of_aircraft(hire: Hire) -> None:
    """The type stands right after the head in ut2004 (protocol 87); battery and time are well
    formed."""
    player = hire("AirRobot", "{Location 0,0,-2} {Dialect ut2004}")
    line = player.status()
    assert re.match(r"STA \{Type AerialVehicle\} \{Time \d+\.\d\d\} ", line), line
    assert re.search(r" \{Battery \d+\}( |$)", line), line
    assert "Steer" not in line


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
@pytest.mark.parametrize(
    ("key", "axis"), [("AltitudeVelocity", 2), ("LinearVelocity", 0), ("LateralVelocity", 1)]
)
def test_directions_of_flight(hire: Hire, dialect: str, key: str, axis: int) -> None:
    """Positive is up, ahead and to the right of the wire, nothing else moves; zeros hover
    (protocol 151)."""
    player = hire("AirRobot", f"{{Location 0,0,-5}} {{Dialect {dialect}}}")
    before = player.place
    player.play(f"DRIVE {{{key} 1}}", 2.0)
    moved = [now - then for now, then in zip(player.place, before, strict=True)]
    way = moved.pop(axis)
    assert (-way if axis == 2 else way) == pytest.approx(1.75, abs=0.35)
    assert all(abs(other) < 0.05 for other in moved)
    assert abs(player.yaw) < 0.01
    player.play(f"DRIVE {{{key} 0}}", 1.5)
    still = player.place
    player.stage.run(2.0)
    assert math.dist(player.place, still) < 0.01


@pytest.mark.parametrize(("dialect", "value"), [("udk", "90"), ("ut2004", "1.5708")])
def test_turning_of_aircraft(hire: Hire, dialect: str, value: str) -> None:
    """A quarter turn clockwise per second: 90 in udk, 1.5708 in ut2004 (protocol 151, 152)."""
    player = hire("AirRobot", f"{{Location 0,0,-2}} {{Dialect {dialect}}}")
    player.play(f"DRIVE {{RotationalVelocity {value}}}", 1.0)
    before = player.yaw
    player.stage.run(1.0)
    turned = (player.yaw - before) % (2 * math.pi)
    assert turned == pytest.approx(math.pi / 2, rel=0.03)


# -- cars ------------------------------------------------------------------------------------------


def test_speed_alone_drives_a_car_in_ut2004(hire: Hire) -> None:
    """Speed alone is enough, and keeps the steering; angles end at the range (protocol 149)."""
    car = hire("Sedan", "{Location 0,0,-0.5} {Dialect ut2004}")
    start = car.place
    car.play("DRIVE {Speed 4}", 2.0)
    assert car.place[0] > start[0] + 1.0
    assert car.place[1] == pytest.approx(start[1], abs=0.02)
    car.play("DRIVE {FrontSteer 99}", 1.5)
    limit = number(car.status(), "FrontSteer")
    assert 0.1 < limit < 1.6
    before = car.yaw
    car.play("DRIVE {Speed 3}", 1.5)
    assert number(car.status(), "FrontSteer") == pytest.approx(limit, abs=0.02)
    assert (car.yaw - before) % (2 * math.pi) < math.pi, "positive is to the right"
    car.play("DRIVE {FrontSteer -99}", 1.5)
    assert number(car.status(), "FrontSteer") == pytest.approx(-limit, abs=0.02)


def test_a_car_of_udk_wants_all_three(hire: Hire) -> None:
    """One or two of Speed, FrontSteer and RearSteer do nothing, all three drive (protocol 149)."""
    car = hire("FrontAckerman", "{Location 0,0,-0.5} {Dialect udk}")
    start = car.place
    for part in ("{Speed 0.5}", "{Speed 0.5} {FrontSteer 0.2}", "{FrontSteer 0.2} {RearSteer 0}"):
        car.play(f"DRIVE {part}", 1.0)
        assert math.dist(car.place, start) < 2e-3
        assert number(car.status(), "FrontSteer") == 0.0
    car.play("DRIVE {Speed 0.5} {FrontSteer 99} {RearSteer 0}", 3.0)
    assert math.dist(car.place, start) > 0.1
    assert number(car.status(), "FrontSteer") == pytest.approx(0.5, abs=0.02)


# -- flippers --------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot_class", ["Kenaf", "TeleMax"])
def test_flippers_are_told_in_order(hire: Hire, robot_class: str) -> None:
    """STA of ut2004 lists FR, FL, RR and RL, between RearSteer and LightToggle (protocol 88)."""
    line = hire(robot_class, "{Location 0,0,-0.3} {Dialect ut2004}").status()
    keys = re.findall(r"\{(\w+) ", line)
    at = keys.index("RearSteer")
    assert keys[at + 1 : keys.index("LightToggle")] == list(FLIPPERS)


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
def test_several_flippers_move_at_once(hire: Hire, dialect: str) -> None:
    """Both front flippers go to 0.5 rad, the rear ones stay; names have no case (protocol 154)."""
    player = hire("Kenaf", f"{{Location 0,0,-0.1}} {{Dialect {dialect}}}")
    player.play("MULTIDRIVE {FRFlipper 0.5} {FLflipper 0.5}", 2.0)
    angles = [player.body.joint_position(name) for name in FLIPPERS]
    assert [abs(angle) for angle in angles] == pytest.approx([0.5, 0.5, 0.0, 0.0], abs=0.01)


# -- cameras ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
@pytest.mark.parametrize("robot_class", ["P3AT", "P2AT"])
def test_camera_mounts_do_not_turn_with_the_robot(
    hire: Hire, robot_class: str, dialect: str
) -> None:
    """GEO of a camera is that of the body frame whatever the spawn yaw (135; conflict 29)."""
    told = set()
    for y, yaw in ((0, 0.0), (3, 1.2), (6, -2.9)):
        more = f"{{Location 30,{y},-0.3}} {{Rotation 0,0,{yaw}}} {{Dialect {dialect}}}"
        player = hire(robot_class, more)
        player.client.take()
        player.client.send("GETGEO {Type Camera}")
        told.update(player.client.take("GEO {Type Camera}"))
    assert len(told) == 1
    (line,) = told
    assert re.search(r"Location 0\.(08|1)", line), "the camera looks ahead of the middle"


def test_zoom_of_the_player_driver(hire: Hire) -> None:
    """A nameless group after Opcode is the parameter (protocol 166), within the limits of CONF
    (protocol 138)."""
    player = hire("P2AT", "{Location 40,0,-0.3} {Dialect ut2004}")

    def view(command: str) -> float:
        player.client.send(command, "GETCONF {Type Camera}")
        return number(player.client.take("CONF {Type Camera}")[-1], "CameraFov")

    zoom = "SET {Type Camera} {Name Camera} {Opcode Zoom}"
    assert view(f"{zoom} {{0.35}}") == pytest.approx(0.35, abs=1e-3)
    assert view(f"{zoom} {{9}}") == pytest.approx(2.0944, abs=1e-3)
    assert view(f"{zoom} {{Params 0}}") == pytest.approx(1.3963, abs=1e-3)


Connect = Callable[[], ScriptedClient]


def _all_bytes(client: ScriptedClient, seconds: float) -> bytes:
    """Everything that arrives until so much simulated time has been told, as it arrives."""
    heard = b""
    times: list[float] = []
    while not times or times[-1] < times[0] + seconds:
        heard += client.socket.recv(65536)
        times = [float(text) for text in re.findall(rb"\{Time (\d+\.\d+)\}", heard)]
    return heard


def test_the_default_port() -> None:
    """Without options the server listens where every legacy client looks for it (protocol 1)."""
    assert Settings().port == 3000


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
def test_bytes_of_a_stream(connect: Connect, dialect: str) -> None:
    """Lines end in CR LF and nothing else looks like an end, blank or tab (protocol 6, 7, 8, 9)."""
    client = connect()
    client.send(f"INIT {{ClassName P3AT_real}} {{Location -60,0,-0.3}} {{Dialect {dialect}}}")
    for wire_type in ("Robot", "Sonar", "RangeScanner", "Encoder"):
        client.send(f"GETGEO {{Type {wire_type}}}")
        client.send(f"GETCONF {{Type {wire_type}}}")
    heard = _all_bytes(client, 0.9)
    lines = heard.split(b"\r\n")[:-1]
    assert len(lines) > 15
    for line in lines:
        if dialect == "udk" and line.startswith(b"CONF {Type Camera} "):
            # Side channels reference 2.10: glued as in the original.
            line = line.replace(b"}{", b"} {")
        assert re.fullmatch(rb"[A-Z]+( \{[^{}\s]+( [^{}\s]+)*\})+", line), line


def test_silence_of_strange_commands(client: ScriptedClient) -> None:
    """A connection without robot hears nothing after commands that need one (protocol 5, 28,
    41)."""
    for text in ("", "  ", "DRIVE {Left 1} {Right 1}", "GETCONF {Type Robot}", "NONSENSE {a b}"):
        client.send(text)
    client.send("CONTROL {Type GetSTA}\r\nMISPKG {Name x} {Link 1} {Value 1}\r\nTRACE {On true}")
    assert client.fence() == []
    assert client.read_for(0.5) == []


def test_an_unfinished_command_waits(client: ScriptedClient) -> None:
    """However long it takes, a command runs when its end arrives and not before (protocol 27)."""
    client.send_bytes(b"GETSTARTPOSES\r\nGETSTART")
    assert client.read_line().startswith("NFO {StartPoses")
    assert client.read_for(0.6) == []
    client.send_bytes(b"POSES\n")
    assert client.read_line().startswith("NFO {StartPoses")


def test_no_answer_for_what_does_not_exist(client: ScriptedClient) -> None:
    """Unknown types and names get no line; the next question is answered (protocol 126)."""
    client.send("INIT {ClassName P2AT} {Location -60,6,-0.3}")
    client.send("GETCONF {Type Zilch}\r\nGETGEO {Type Sonar} {Name F99}\r\nGETGEO {Type Robot}")
    assert client.read_line().startswith("GEO {Type GroundVehicle}")
    lines = client.listen(1.5)
    assert lines
    assert not [line for line in lines if line.startswith(("CONF", "GEO"))]


def test_every_streamed_item_answers_in_time(client: ScriptedClient) -> None:
    """CONF and GEO of every item that streams come, without another question (protocol 125)."""
    client.send("INIT {ClassName P2AT} {Location -60,12,-0.3}")
    items: set[tuple[str, str]] = set()
    for line in client.listen(1.0):
        kind = re.search(r"\{Type (\w+)\}", line)
        if line.startswith("MISSTA"):
            items |= {("MisPkg", name) for name in re.findall(r"\{Name (\w+)[ }]", line)}
        elif line.startswith("SEN") and kind is not None:
            items |= {(kind.group(1), name) for name in re.findall(r"\{Name (\w+)[ }]", line)}
    assert len(items) > 22
    for kind_name, name in items:
        for head in ("CONF", "GEO"):
            client.send(f"GET{head} {{Type {kind_name}}} {{Name {name}}}")
            answer = client.wait_for(head)
            assert answer.startswith(f"{head} {{Type {kind_name}}} {{Name {name}")


@pytest.mark.parametrize("speech", ["INIT", "Init", "init"])
def test_habits_of_student_controllers(client: ScriptedClient, speech: str) -> None:
    """CR LF LF after every command, any case, a decimal comma in six parts (addendum)."""
    end = "\r\n\n"
    client.send(f"{speech} {{ClassName P2AT}} {{Location 0,0000, 0,0000, 0,0000}}", end)
    client.send("Drive {Left 1,0} {Right 1,0}", end)
    client.send("MultiDrive {FRFlipper 1,0}", end)
    poses = [line for line in client.listen(3.0) if line.startswith("SEN {Type Odometry}")]
    assert re.search(r"\{Pose 0\.[1-9]", poses[-1])


def test_start_poses_on_a_connection_of_their_own(connect: Connect) -> None:
    """Asked before the greeting was read, twice, and on a connection soon closed (addendum)."""
    scout = connect()
    scout.send("GETSTARTPOSES\r\nGETSTARTPOSES")
    lines = [scout.read_line() for _ in range(3)]
    assert lines[0].startswith("NFO {Gametype")
    assert lines[1] == lines[2]
    scout.close()
    robot = connect()
    robot.send("INIT {ClassName P2AT} {Start RobotStart1}")
    assert robot.wait_for("STA")


def test_a_command_for_every_line(client: ScriptedClient) -> None:
    """A client that answers every line with a DRIVE hears every report (addendum)."""
    client.send("INIT {ClassName P3AT} {Location -60,18,-0.3}")
    times = [time_of(client.wait_for("STA")) or 0.0]
    while times[-1] < times[0] + 2.0:
        line = client.read_line()
        client.send("DRIVE {Left 0.5} {Right 0.5}")
        if line.startswith("STA"):
            times.append(time_of(line) or 0.0)
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert gaps == pytest.approx([gaps[0]] * len(gaps), abs=0.03)


# -- dialects --------------------------------------------------------------------------------------

UDK_TIME = r"\{Time \d+\.\d{4}\}"


@pytest.mark.parametrize(
    ("init", "udk"),
    [
        ("INIT {Classname USARBot.P2AT}", True),
        ("INIT {ClassName USARBot.P2AT}", False),
        ("INIT {ClassName USARBot.P2AT} {Dialect udk}", True),
        ("INIT {ClassName USARBot.P3AT_real}", True),
        ("INIT {ClassName USARBot.P3AT_real} {Dialect ut2004}", False),
        ("INIT {ClassName USARBot.P2AT}\r\nGETCONF {Type Actuator}", True),
        ("INIT {ClassName USARBot.P2AT} {Dialect ut2004}\r\nGETCONF {Type Actuator}", False),
        ("INIT {ClassName USARBot.P2AT}\r\nACT {Name x} {Link 0} {Value 0}", True),
    ],
)
def test_first_lines_have_the_dialect(connect: Connect, init: str, udk: bool) -> None:
    """From the first streamed line the shapes are those of the client's era (protocol 173 to
    176)."""
    client = connect()
    client.send(init.replace("}", "} {Location -60,30,-0.3}", 1))
    status = client.wait_for("STA")
    assert bool(re.search(UDK_TIME, status)) is udk
    sonar = client.wait_for(lambda line: "{Type Sonar}" in line)
    assert sonar.count("Range ") == (1 if udk else 16)


@pytest.mark.parametrize("fixed", ["ut2004", "udk"])
def test_a_fixed_port_never_changes(fixed: str) -> None:
    """Neither class, nor spelling, nor request, nor INIT's own wish counts there (protocol 177)."""
    with ServerProcess("--world", "empty", "--dialect", fixed) as server:
        for index, init in enumerate(
            (
                "{Classname USARBot.P3AT} {Dialect udk}",
                "{ClassName USARBot.P2AT} {Dialect ut2004}",
                "{Classname P2AT}",
            )
        ):
            client = server.client()
            client.send(f"INIT {init} {{Location {index * 4},0,-0.3}}\r\nGETCONF {{Type Actuator}}")
            client.send("ACT {Name x} {Link 0} {Value 0}")
            assert bool(re.search(UDK_TIME, client.wait_for("STA"))) is (fixed == "udk")
            client.close()


def test_the_question_after_init_is_answered_first(client: ScriptedClient) -> None:
    """INIT and GETCONF Actuator in one packet: the next line is the CONF (protocol 142)."""
    client.send("INIT {ClassName P2AT} {Location -60,36,-0.3}\r\nGETCONF {Type Actuator}")
    assert client.read_line().startswith("CONF {Type Actuator} {Name CameraPanTilt} {Link 1} ")
    assert client.read_line().startswith("CONF {Type Camera} {Name Camera}{TextureOffsetX ")
    assert client.read_line().startswith(("STA", "SEN", "ASTA"))
