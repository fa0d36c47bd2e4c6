"""Every robot class over sockets: it appears, tells what it is, drives in its own words, leaves.

The catalog is that of the robots reference 1.1, with its aliases and spellings; every further
shipped class is put through the same. Robots checks 1, 2, 3, 13, 42 and 48 are among them.

A robot with an arm and a gripper, over real sockets.

Arms over sockets: the slider tool of the original, and a camera that is turned.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from lanes import SLOW
from sharing import shipped_robots
from side_clients import WirelessModel

from usarsim_server.actuators.effectors import create_effectors
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sensors.base import SensorContext, create_sensor
from usarsim_server.testing import ScriptedClient, eventually, running_server
from usarsim_server.worlds.description import WorldDescription

ROSTER = {
    "skid_steer": (
        *("P2AT", "StereoP2AT", "P2AT_ATLANTA", "OmniP2AT", "P3AT", "ATRVJr", "ATRV", "ATRV2"),
        *("Zerg", "Kurt2D", "KURT2D", "Kurt", "Kurt3D", "Element", "BasicSkidRobot", "KRobot"),
        *("pioneer3at_with_sensors", "pioneer3at_with_sensors_R", "youBot"),
    ),
    "differential": (
        *("P2DX", "OmniP2DX", "P3DX", "SegwayRMPFifty", "UnitLoader", "MDS", "Nomad"),
        *("CasterSkidRobot", "Kiva4Wheel", "pioneer2dx_with_sensors", "turtlebot", "PR2"),
    ),
    "tracked": (
        *("Tarantula", "TarantulaSIED", "Talon", "TeleMax", "Kenaf", "kenaf", "Soryu", "Rugbot"),
        *("Matilda", "crawler_robot"),
    ),
    "ackerman": (
        *("Hummer", "HMMWV", "SnowStorm", "Sedan", "Cooper", "ForkLift", "BasicAckermanRobot"),
        "FrontAckerman",
    ),
    "omni": ("Lisa",),
    "aerial": ("AirRobot", "Passarola", "quadrotor"),
    "underwater": ("Submarine",),
    "legged": ("ERS", "QRIO", "Nao"),
    "static": (
        *("KR60", "KR3", "KR5", "KR6", "FanucM16", "Fanuc_M16iB20", "Fanuc_Robot_And_Rail"),
        *("KUKA_LWR_BOT", "TwoLink", "Forklift", "GripperBase", "HandBot", "KinectBot"),
        *("ComStation", "MultiView", "ReferenceGPSCoordinate"),
    ),
}
"""Kinds by the DRIVE family of the reference, and the names under which clients ask for them."""

SHIPPED = shipped_robots()
CASES = [(name, kind) for kind, names in ROSTER.items() for name in names]
CASES += [
    (robot.name, robot.kind)
    for robot in SHIPPED.descriptions()
    if robot.name not in {name for name, _ in CASES}
]

WHEELED = ("skid_steer", "differential", "tracked", "ackerman", "omni")
DRIVES = {
    **dict.fromkeys(
        ("skid_steer", "differential", "tracked"), "{Left 100} {Right 100} {Normalized True}"
    ),
    "ackerman": "{Speed 100} {FrontSteer 0.0} {RearSteer 0.0} {Normalized True}",
    "omni": " ".join(f"{{WheelNumber {n}}} {{WheelSpeed 100}} {{WheelSteer 0}}" for n in range(4))
    + " {Normalized True}",
    "aerial": "{AltitudeVelocity 0} {LinearVelocity 100} {LateralVelocity 0} "
    "{RotationalVelocity 0} {Normalized True}",
    "underwater": "{Propeller 100} {Rudder 0} {SternPlane 0} {Normalized True}",
}
"""Straight ahead at full speed."""
NONSENSE = "DRIVE {Left 100} {Right 100} {Speed 100} {Propeller 100} {LinearVelocity 5}"
"""What machines that do not drive must not care about."""

GROUND = {"FrontSteer", "RearSteer", "LightToggle", "LightIntensity", "Battery"}
LIT = {"LightToggle", "LightIntensity", "Battery"}
STATUS: dict[str, tuple[tuple[str, set[str]], tuple[str, set[str]]]] = {
    **dict.fromkeys(WHEELED, (("GroundVehicle", GROUND | {"View"}), ("GroundVehicle", GROUND))),
    "aerial": (("AerialVehicle", LIT | {"View"}), ("AerialVehicle", LIT)),
    "underwater": (
        ("NauticVehicle", {"RudderAngle", "SternPlaneAngle", "View"} | LIT),
        ("NauticVehicle", {"RudderAngle", "SternPlaneAngle"} | LIT),
    ),
    "legged": (("LeggedRobot", LIT | {"View"}), ("LeggedVehicle", {"Battery"})),
    "static": (("BaseMachine", set()), ("StaticPlatform", {"Battery"})),
}
"""Type and further fields of STA by kind, in ut2004 and in udk (protocol reference 4.3, 4.4)."""

DIALECTS = ("ut2004", "udk")
LONGEST = 30.0
"""Simulated s within which a robot does what it is told."""


def fields(line: str) -> dict[str, str]:
    """Keys and values of the segments of a line."""
    return dict(re.findall(r"\{(\w+) ([^{}]*)\}", line))


def item_types(robot: RobotDescription, dialect: str) -> dict[str, list[str]]:
    """Names of all items that a class carries, by the type that clients ask for."""
    world = WorldDescription("test", "Test", "", "", Path(), Path("scene.xml"), ())
    context = SensorContext(robot, world, np.random.default_rng(0))
    found: dict[str, list[str]] = {}
    for item in robot.items:
        sensor = create_sensor(item, context)
        if sensor.known_in(Dialect(dialect)):
            found.setdefault(sensor.wire_type, []).append(item.name)
    packages = [one.name for one in robot.actuators if one.package]
    if packages:
        found["MisPkg" if dialect == "ut2004" else "Actuator"] = packages
    for effector in create_effectors(robot):
        found.setdefault(effector.wire_type, []).append(effector.name)
    if robot.cameras:
        found["Camera"] = [camera.name for camera in robot.cameras]
    return found


class Track:
    """A robot of one client, and where the scoring side sees it."""

    def __init__(
        self, client: ScriptedClient, truth: WirelessModel, name: str, dialect: str, kind: str
    ) -> None:
        self.client, self.dialect, self.kind = client, dialect, kind
        self.label = f"{name}_{dialect}"
        self._truth = truth
        client.wait_for("NFO {Gametype")
        y = 12.0 if dialect == "udk" else -12.0
        client.send(
            f"INIT {{ClassName USARBot.{name}}} {{Name {self.label}}} {{Location 0,{y},-0.4}} "
            f"{{Rotation 0,0,0}} {{Dialect {dialect}}}"
        )

    def ask(self, head: str, kind: str) -> str:
        """The answer to GETCONF or GETGEO."""

        def answers(line: str) -> bool:
            unasked = line.startswith("CONF {Type Camera}") and kind != "Camera"
            return line.startswith(f"{head} ") and not unasked

        self.client.send(f"GET{head} {{Type {kind}}}")
        return self.client.wait_for(answers)

    def place(self) -> list[float]:
        """Where it is, m."""
        return self._truth.positions()[self.label][0]

    def status(self) -> dict[str, str]:
        """Fields of the next STA."""
        return fields(self.client.wait_for("STA"))

    def until(self, true: Callable[[], bool], what: str) -> None:
        """Wait for something, reading what comes meanwhile."""
        begun = float(self.status()["Time"])
        while not true():
            assert float(self.status()["Time"]) < begun + LONGEST, f"{self.label}: {what}"


@pytest.fixture
def pair(request: pytest.FixtureRequest) -> Iterator[tuple[RobotDescription, list[Track]]]:
    """A server of its own with two robots of a class, one for a client of either dialect."""
    name, kind = request.param
    robot = SHIPPED.find(name)
    assert robot is not None
    server = running_server(
        world="empty", speed=20.0, max_robots=4, quiet_period=0.01, groundtruth_port=0
    )
    with ExitStack() as stack:
        _, ports = stack.enter_context(server)
        truth = WirelessModel(ports["groundtruth"].port)
        stack.callback(truth.client.close)
        tracks = []
        for dialect in DIALECTS:
            client = stack.enter_context(ScriptedClient(ports["control"].port))
            tracks.append(Track(client, truth, name, dialect, kind))
        yield robot, tracks
        for number, track in enumerate(tracks):
            track.client.close()
            left = 1 - number
            assert eventually(lambda left=left: len(truth.positions()) <= left), track.label


FIRST = {kind: name for name, kind in reversed(CASES)}
"""One class of each kind: the others are slow."""


@pytest.mark.parametrize(
    "pair",
    [
        pytest.param(case, id=case[0], marks=() if case[0] in FIRST.values() else SLOW)
        for case in CASES
    ],
    indirect=True,
)
def test_a_class_from_init_to_its_end(pair: tuple[RobotDescription, list[Track]]) -> None:
    """It says what it is and carries, drives ahead, reports by its kind, and is gone in the end."""
    robot, tracks = pair
    for track in tracks:
        assert robot.kind == track.kind
        introduces_itself(robot, track)
        shows_what_it_carries(robot, track)
        reports(track)
        if track.kind in DRIVES:
            drives(track)
        else:
            stays(track)
        if track.kind == "legged":
            moves_a_joint(robot, track)


def introduces_itself(robot: RobotDescription, track: Track) -> None:
    """CONF and GEO of the robot name the class as it was asked for, and its kind."""
    configuration, geometry = track.ask("CONF", "Robot"), track.ask("GEO", "Robot")
    asked = track.label.rpartition("_")[0]
    (told, _), (told_udk, _) = STATUS[track.kind]
    if track.dialect == "ut2004":
        wire_type = told
        assert configuration.startswith(f"CONF {{Type {wire_type}}} {{Name "), configuration
        assert "Dimensions" in fields(geometry)
    else:
        wire_type = "LeggedRobot" if track.kind == "legged" else told_udk
        assert configuration.startswith(f"CONF {{Name {robot.name}}} {{Type "), configuration
    for line in (configuration, geometry):
        assert fields(line)["Type"] == wire_type
        assert fields(line)["Name"] == robot.name
        assert robot.name.lower() == asked.lower()
    if track.kind in WHEELED:
        assert float(fields(configuration)["MaxSpeed"]) > 0.0
        assert float(fields(geometry)["WheelRadius"]) > 0.0


def shows_what_it_carries(robot: RobotDescription, track: Track) -> None:
    """CONF and GEO of every type of item name all of its items."""
    track.status()  # before it comes what `udk` tells of cameras unasked, in a CONF for each
    for kind, names in item_types(robot, track.dialect).items():
        for head in ("CONF", "GEO"):
            line = track.ask(head, kind)
            assert line.startswith(f"{head} {{Type {kind}}}"), line
            told = re.findall(r"\{Name ([^ {}]+)", line)
            assert len(told) == len(names), line
            if kind != "Encoder":  # udk calls them W0, W1, ...
                assert told == names


def reports(track: Track) -> None:
    """STA has the type and the fields of its kind."""
    wire_type, wanted = STATUS[track.kind][DIALECTS.index(track.dialect)]
    told = track.status()
    assert told["Type"] == wire_type
    assert wanted <= set(told)
    if track.kind == "static":
        assert told.get("Battery", "99999") == "99999"


def drives(track: Track) -> None:
    """It goes straight ahead, and not into the ground or the sky."""
    x, y, z = track.place()
    track.client.send(f"DRIVE {DRIVES[track.kind]}")
    track.until(lambda: track.place()[0] > x + 0.05, "does not go ahead")
    _, aside, below = track.place()
    assert abs(aside - y) < 0.1
    assert abs(below - z) < 0.5, "0.4 m of fall at most"


def stays(track: Track) -> None:
    """It does not drive, whatever it is told."""
    track.status()
    before = track.place()
    track.client.send(NONSENSE)
    for _ in range(3):
        track.status()
    if track.kind == "static":
        # The digits are cut off, so a place may print as the one below it.
        assert track.place() == pytest.approx(before, abs=2e-4)
    else:
        assert abs(track.place()[0] - before[0]) < 0.02


def moves_a_joint(robot: RobotDescription, track: Track) -> None:
    """A joint that takes orders goes where it is told, and STA tells so."""
    link = next(one for one in robot.links if one.follows is None)
    low, high = link.limits or (-1.0, 1.0)
    target = link.home + (0.2 if link.home + 0.2 < high else -0.2)
    assert low <= target <= high
    if track.dialect == "ut2004":
        track.client.send(f"MULTIDRIVE {{{link.joint} {target}}}")
    else:
        joint = f"{{Name {link.joint}}} {{Opcode Angle}} {{Params {target}}}"
        track.client.send(f"SET {{Type Joint}} {joint}")
    track.until(lambda: abs(float(track.status()[link.joint]) - target) < 0.05, "joint stays")


Connect = Callable[[], ScriptedClient]


def _links(line: str) -> dict[int, float]:
    """Positions by link number of a MISSTA or ASTA line."""
    found = re.findall(r"\{Link (\d+)\} \{Value (-?[\d.]+)\}", line)
    return {int(link): float(value) for link, value in found}


def _settled(client: ScriptedClient, head: str, link: int, target: float) -> bool:
    states = (_links(client.wait_for(head)) for _ in range(150))
    return any(abs(state[link] - target) < 0.02 for state in states)


def test_a_slider_client_moves_an_arm(connect: Connect) -> None:
    """CONF is the line after INIT; ACT counts links from 0, ASTA from 1 (protocol 139, 142, 158,
    183)."""
    client = connect()
    client.wait_for("NFO {Gametype")
    client.send("INIT {ClassName P3AT_arm} {Location -60,0,-0.3}\r\nGETCONF {Type Actuator}")
    conf = client.read_line()
    assert conf.startswith("CONF {Type Actuator} {Name ")
    name = re.search(r"\{Name (\w+)\}", conf)
    assert name is not None
    links = re.findall(r"\{Link (\d+)\} \{JointType (\w+)\} \{MaxTorque [\d.]+\}", conf)
    assert [int(number) for number, _ in links] == list(range(1, len(links) + 1))
    start = _links(client.wait_for("ASTA {Time"))[1]
    client.send(f"ACT {{Name {name.group(1)}}} {{Link 0}} {{Value {start + 0.4:.3f}}} {{Link 77}}")
    assert _settled(client, "ASTA", 1, start + 0.4)


def test_a_gripper_closes_and_opens(connect: Connect) -> None:
    """SET CLOSE and OPEN show in EFF (protocol 161)."""
    client = connect()
    client.send("INIT {ClassName P3AT_arm} {Location -60,5,-0.3}\r\nGETCONF {Type Gripper}")
    conf = client.wait_for("CONF {Type Gripper}")
    name = re.search(r"\{Name (\w+)\}", conf)
    assert name is not None
    for opcode, status in (("CLOSE", "CLOSED"), ("OPEN", "OPEN")):
        client.send(f"SET {{Type Gripper}} {{Name {name.group(1)}}} {{Opcode {opcode}}}")
        assert client.wait_for(lambda line, end=status: line.endswith(f"{{Status {end}}}"))


@pytest.mark.parametrize("order", ["", " {Order 0}"])
def test_a_pan_tilt_of_the_old_generation(connect: Connect, order: str) -> None:
    """MISPKG counts links from 1, MISSTA reports them, GETGEO names the carrier (protocol 140, 141,
    157)."""
    client = connect()
    client.send(f"INIT {{ClassName P2AT}} {{Location -70,{5 + len(order)},-0.3}}")
    client.send("GETGEO {Type MisPkg}")
    assert "{ParentLink -1}" in client.wait_for("GEO {Type MisPkg} {Name CameraPanTilt}")
    client.send(f"MISPKG {{Name CameraPanTilt}} {{Link 1}} {{Value 0.15}}{order}")
    assert _settled(client, "MISSTA", 1, 0.15)


REPORTS = 200
"""Until when a link has to be where it was told to go, 20 s of simulated time or more."""


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """The control port of a server with an empty world, at ten times real time."""
    with running_server(world="empty", speed=10.0) as (_, endpoints):
        yield endpoints["control"].port


def test_sliders_for_an_arm(port: int) -> None:
    """The SliderController finds its links in the first line after the greeting (protocol 142,
    183).

    It sends INIT and GETCONF at once, reads exactly one line, cuts it at blanks, and moves links
    that it counts from 0.
    """
    with ScriptedClient(port) as client:
        client.send_bytes(
            b"INIT {ClassName USARBot.KR60} {Location 0,0,0}\nGETCONF {Type Actuator}\n"
        )
        assert client.read_line().startswith("NFO {Gametype")
        tokens = client.read_line().split(" ")
        assert tokens[:5] == ["CONF", "{Type", "Actuator}", "{Name", "KR60Arm}"]
        keys = ("{Link", "{JointType", "{MinValue", "{MaxValue")
        fields: dict[str, list[str]] = {key: [] for key in keys}
        for key, value in itertools.pairwise(tokens):
            if key in fields:
                fields[key].append(value.rstrip("}"))
        assert fields["{Link"] == ["1", "2", "3", "4", "5", "6"]
        assert set(fields["{JointType"]) == {"Revolute"}
        assert [float(low) for low in fields["{MinValue"]][1] == pytest.approx(-2.356)
        assert [float(high) for high in fields["{MaxValue"]][1] == pytest.approx(0.61)
        client.send("ACT {Name KR60Arm} {Link 0} {Value 0.50} {Link 1} {Value -0.25}", "\n")
        for _ in range(REPORTS):
            line = client.wait_for("ASTA")
            found = re.match(
                r"ASTA \{Time [\d.]+\} \{Name KR60Arm\} \{Link 1\} \{Value ([\d.-]+)\} "
                r"\{Link 2\} \{Value ([\d.-]+)\} ",
                line,
            )
            assert found is not None
            if abs(float(found[1]) - 0.5) < 1e-3 and abs(float(found[2]) + 0.25) < 1e-3:
                return
        pytest.fail(f"the arm did not arrive: {line}")


def test_a_camera_is_turned(port: int) -> None:
    """A client of the other generation reads MISSTA of the pan-tilt that it moves."""
    with ScriptedClient(port) as client:
        client.send("INIT {ClassName USARBot.P2AT} {Location 5,0,-0.25}")
        client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 0.20} {Link 2} {Value -0.10}")
        for _ in range(REPORTS):
            line = client.wait_for("MISSTA")
            found = re.fullmatch(
                r"MISSTA \{Time \d+\.\d\d\} \{Name CameraPanTilt\} \{Link 1\} "
                r"\{Value (-?\d\.\d{4})\} \{Torque -?\d+\.\d\d\} \{Link 2\} "
                r"\{Value (-?\d\.\d{4})\} \{Torque -?\d+\.\d\d\}",
                line,
            )
            assert found is not None, line
            if abs(float(found[1]) - 0.2) < 1e-3 and abs(float(found[2]) + 0.1) < 1e-3:
                return
        pytest.fail(f"the camera did not arrive: {line}")
