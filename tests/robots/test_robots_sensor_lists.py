"""What every shipped class announces, and whose list that is.

Clients index sensors by place or fail on one they do not know, so a sensor more is as wrong as one
less. "Robots" and "protocol" are the references; where a source calls an item uncertain, the
smaller set that clients read is the one that ships.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from machine_fakes import ROBOTS

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.catalog import load_robot
from usarsim_server.testing import Rehearsal, RehearsedClient

F = " ".join(f"F{n}" for n in range(1, 9))
R = " ".join(f"R{n}" for n in range(1, 9))

P2AT = f"""RangeScanner Scanner1 / Sonar {F} {R} / Odometry Odometry / INS INS
/ GroundTruth GroundTruth / GPS GPS / Encoder ECLeft ECRight / Touch Touch
/ VictSensor VictSensor"""
P2DX = f"""RangeScanner Scanner1 / Sonar {F} / Odometry Odometry / INS INS / GroundTruth GroundTruth
/ GPS GPS / Encoder ECLeft ECRight ECTilt ECPan / RFID RFID / VictSensor VictSensor"""
P3AT = """GroundTruth GndTruth / INS InsTest / SICK lms200 / Tachometer TachTest / Encoder W1 W2
/ Battery battery / Odometry Odometer"""
AIRROBOT = """GPS GPS / MissionTime Time / AltitudeSensor GPS / IMU IMU / MagneticCompass Compass
/ GroundTruth GroundTruth / INS INS / RangeScanner Scanner1 / Sonar F1 F2 F3 F4 F5 F6"""
WHEELS = """RangeScanner Scanner1 / Odometry Odometry / INS INS / GroundTruth GroundTruth
/ Encoder ECLeft ECRight"""
TRACKS = """RangeScanner Scanner1 / Odometry Odometry / INS INS / GroundTruth GroundTruth / GPS GPS
/ Encoder ECLeft ECRight / VictSensor VictSensor"""
CAR = "RangeScanner Scanner1 / INS INS / GPS GPS / GroundTruth GroundTruth"
BRIDGE = """RangeScanner lms200 / INS InsTest / GroundTruth GroundTruth / GPS GPS
/ Encoder Lwheel Rwheel"""
TRUTH = "GroundTruth GroundTruth"

LISTS: dict[str, tuple[str, str]] = {
    # -- lists that have come down -----------------------------------------------------------
    "P2AT": ("captured, robots 1.6; Touch: protocol B; 5.1 #68", P2AT),
    "P2AT_ATLANTA": ("P2AT, robots 1.1", P2AT),
    "StereoP2AT": ("P2AT, robots 1.1", P2AT),
    "OmniP2AT": ("P2AT, robots 1.1", P2AT),
    "P2DX": ("recorded traffic, robots 1.6, protocol addendum", P2DX),
    "OmniP2DX": ("P2DX, robots 1.1", P2DX),
    "P3DX": ("P2DX, robots 1.1", P2DX),
    "P3AT": ("source, robots 1.2.1 (5.1 #14); Odometer: protocol B", P3AT),
    "P3AT_arm": ("P3AT, robots 1.2.1", P3AT),
    "P3AT_real": ("P3AT and the ring of ARIA, robots 1.8", f"{P3AT} / Sonar {F} {R}"),
    "ATRV": (
        "configuration, robots 1.2.1; lms200: protocol B",
        "GroundTruth GndTruth / Odometry Odometer / SICK lms200",
    ),
    "ATRV2": ("ATRV, robots 1.2.1", "GroundTruth GndTruth / Odometry Odometer / SICK lms200"),
    "ATRVJr": (
        "sonars: robots 1.6; the others: protocol B",
        "RangeScanner Scanner1 / Sonar "
        + " ".join(f"S{n}" for n in range(1, 18))
        + " / Odometry Odometry / INS INS / GroundTruth GroundTruth / GPS GPS"
        " / Encoder ECLeft ECRight",
    ),
    "Nomad": (
        "sonars: robots 1.6, protocol B",
        "Sonar " + " ".join(f"Sonar{n}" for n in range(16)) + f" / {WHEELS}",
    ),
    "Kiva4Wheel": (
        "source, robots 1.2",
        "GroundTruth GroundTruth / SICK lms200 / Tachometer Tachometer",
    ),
    "AirRobot": ("source and UT2004 clients, robots 1.5", AIRROBOT),
    "ARDrone": (
        "clients, protocol addendum",
        "GroundTruth GroundTruth / Accel Accel / Sonar Sonar1",
    ),
    "Nao": (
        "source, robots 1.7",
        "GroundTruth GroundTruth / Sonar LeftSonar RightSonar / Accelerometer Accelerometer",
    ),
    "KinectBot": ("source, robots 1.9", "KinectDepth KinectDepth / GroundTruth GroundTruth"),
    "pioneer2dx_with_sensors": ("prototype, robots 1.8", BRIDGE),
    "pioneer3at_with_sensors": ("prototype, robots 1.8", BRIDGE),
    "crawler_robot": ("prototype, robots 1.8", BRIDGE),
    "turtlebot_with_sensors": (
        "prototype, robots 1.8; no sky indoors",
        BRIDGE.replace(" / GPS GPS\n", ""),
    ),
    # -- names that clients look for, protocol B; which classes had them is a starting value ---
    "Zerg": ("laser: robots 1.6", WHEELS),
    "Element": ("protocol B", WHEELS),
    "Kurt2D": ("protocol B", WHEELS),
    "Kurt3D": (
        "protocol B",
        "Odometry Odometry / INS INS / GroundTruth GroundTruth / Encoder ECLeft ECRight"
        " / RangeScanner Scanner1",
    ),
    "SegwayRMPFifty": ("protocol B", WHEELS),
    "UnitLoader": ("protocol B", WHEELS),
    "MDS": ("protocol B", WHEELS),
    "Matilda": ("protocol B", TRACKS),
    "Rugbot": ("protocol B", TRACKS),
    "Soryu": ("protocol B", TRACKS),
    "Talon": ("protocol B", TRACKS),
    "Tarantula": ("protocol B", TRACKS),
    "TeleMax": ("protocol B", TRACKS),
    "Kenaf": (
        "laser: a client, robots 1.5",
        "GroundTruth GroundTruth / INS INS / Odometry Odometry / Tachometer Tachometer"
        " / Hokuyo Hokuyo / IMU IMU / Battery battery",
    ),
    "Lisa": ("protocol B", "RangeScanner Scanner1 / INS INS / GroundTruth GroundTruth"),
    "Cooper": ("protocol B", CAR),
    "Hummer": ("protocol B", CAR),
    "Sedan": ("protocol B", CAR),
    "SnowStorm": ("protocol B", CAR),
    "ForkLift": ("protocol B", "GroundTruth GroundTruth / RangeScanner Scanner1"),
    "Passarola": ("protocol B", "GroundTruth GroundTruth / INS INS / GPS GPS / Sonar F1"),
    "Submarine": (
        "starting value",
        "GroundTruth GroundTruth / INS INS / Sonar F1 D1 / AltitudeSensor Depth",
    ),
    "ERS": (
        "starting value",
        "GroundTruth GroundTruth / INS INS / IR Chest / Accelerometer Accelerometer",
    ),
    "QRIO": (
        "starting value",
        "GroundTruth GroundTruth / INS INS / Accelerometer Accelerometer",
    ),
    "KRobot": ("protocol B", "GroundTruth GroundTruth / Odometry Odometry"),
    "quadrotor": ("AirRobot, robots 1.1", AIRROBOT),
    "PR2": (
        "starting value",
        "RangeScanner lms200 TiltScanner / INS InsTest / GroundTruth GroundTruth"
        " / Encoder Lwheel Rwheel",
    ),
    "youBot": ("starting value", BRIDGE.replace(" / GPS GPS\n", "")),
    # -- our own -------------------------------------------------------------------------------
    "RescueP2AT": (
        "P2AT with the sensors for people and tags of protocol B",
        f"{P2AT} / RFIDReader RFIDReader / VictRFID VictRFID / RFIDReleaser Gun"
        " / HumanMotion HumanMotion / Sound Sound / CO2Sensor CO2",
    ),
    "MultiView": ("no robot, robots 1.1", ""),
    "ReferenceGPSCoordinate": ("no robot, robots 1.1", ""),
} | dict.fromkeys(
    # The original gave most of these nothing (robots 1.2, 1.4, 1.9); ground truth is what they can
    # be measured by, and protocol B knows it on arms.
    [
        "BasicSkidRobot",
        "CasterSkidRobot",
        "BasicAckermanRobot",
        "FrontAckerman",
        "ComStation",
        "FanucM16",
        "Fanuc_M16iB20",
        "Fanuc_Robot_And_Rail",
        "ForkliftUDK",
        "GripperBase",
        "HandBot",
        "KR3",
        "KR5",
        "KR6",
        "KR60",
        "KUKA_LWR_BOT",
        "TwoLink",
    ],
    ("robots 1.2, 1.4, 1.9; protocol B", TRUTH),
)


def listed(name: str) -> list[tuple[str, str]]:
    """Type and name of every sensor of a list, in its order."""
    found = []
    for group in filter(None, LISTS[name][1].split("/")):
        kind, *names = group.split()
        found += [(kind, one) for one in names]
    return found


@pytest.mark.parametrize("name", ROBOTS)
def test_the_sensors_of_every_class(name: str) -> None:
    """A class has the sensors of its list, in that order, and no other (robots 5.1 #14, #68)."""
    assert [(item.type, item.name) for item in ROBOTS[name].items] == listed(name), LISTS[name][0]


def test_every_list_is_of_a_class() -> None:
    """No list outlives its class."""
    assert set(LISTS) == set(ROBOTS)


def test_a_file_may_drop_what_a_class_had_before(tmp_path: Path) -> None:
    """A file that drops the sonars that P3AT once had is as good as before; a slip is told."""
    path = tmp_path / "Mine.toml"
    path.write_text('extends = "P3AT"\nwithout = ["F1", "R8", "TachTest"]\n')
    assert [item.name for item in load_robot(path).items] == [
        *("GndTruth", "InsTest", "lms200", "W1", "W2", "battery", "Odometer")
    ]
    path.write_text('extends = "P3AT"\nwithout = ["F11"]\n')
    with pytest.raises(RobotDescriptionError, match="no inherited sensor 'F11'"):
        load_robot(path)


# -- on the wire -----------------------------------------------------------------------------------


def senses(stage: Rehearsal, client: RehearsedClient, kind: str) -> list[str]:
    """Lines of one type within a second of simulated time."""
    client.take()
    stage.run(1.0)
    return [line for line in client.take("SEN") if f"{{Type {kind}}}" in line]


def test_what_a_recording_of_p2dx_has() -> None:
    """P2DX: F1 to F8 in one line and nothing behind; all other lines as recorded (addendum)."""
    with Rehearsal(world="empty", max_robots=1) as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.P2DX} {Location 4.5,1.9,-0.2} {Name R1}")
        stage.run(1.0)
        sonars = senses(stage, client, "Sonar")
        assert sonars
        for line in sonars:
            groups = re.findall(r"\{Name (\w+) Range \d+\.\d{4}\}", line)
            assert groups == F.split()
            assert line.count("{") == 2 + 8, "Time, Type and eight sonars"
        encoders = senses(stage, client, "Encoder")
        assert re.findall(r"\{Name (\w+) Tick", encoders[0]) == [
            "ECLeft",
            "ECRight",
            "ECTilt",
            "ECPan",
        ]
        client.send("MISPKG {Name CameraPanTilt} {Link 1} {Value 0.3} {Link 2} {Value -0.2}")
        stage.run(4.0)
        ticks = dict(
            re.findall(r"\{Name (\w+) Tick (-?\d+)\}", senses(stage, client, "Encoder")[-1])
        )
        # One degree to the tick, less the noise of half a percent.
        assert int(ticks["ECPan"]) == pytest.approx(0.3 / 0.01745, abs=1.1)
        assert int(ticks["ECTilt"]) == pytest.approx(-0.2 / 0.01745, abs=1.1)
        kinds = set(re.findall(r"MISSTA \{Time [\d.]+\} \{Name (\w+)\}", "\n".join(client.take())))
        stage.run(0.5)
        kinds |= set(re.findall(r"MISSTA \{Time [\d.]+\} \{Name (\w+)\}", "\n".join(client.take())))
        assert kinds == {"CameraPanTilt"}


def test_airrobot_has_the_sensors_of_its_dialect() -> None:
    """AirRobot: GroundTruth and GPS for clients of ut2004, all of its sensors for those of udk."""
    with Rehearsal(world="empty", max_robots=1) as stage:
        client = stage.connect()
        client.send("INIT {ClassName AirRobot} {Dialect ut2004} {Location 0,0,-1} {Name R1}")
        stage.run(1.0)

        def kinds() -> set[str]:
            client.take()
            stage.run(1.0)
            return set(re.findall(r"\{Type (\w+)\}", "\n".join(client.take("SEN"))))

        assert kinds() == {"GroundTruth", "GPS"}
        for question in ("GETGEO {Type Sonar}", "GETCONF {Type RangeScanner} {Name Scanner1}"):
            client.send(question)
            stage.run(0.1)
            assert not [line for line in client.take() if line[:4] in ("GEO ", "CONF")], question
        client.send("GETGEO {Type GPS}")
        stage.run(0.1)
        assert client.take("GEO")
    with Rehearsal(world="empty", max_robots=1) as stage:
        client = stage.connect()
        client.send("INIT {ClassName AirRobot} {Dialect udk} {Location 0,0,-1} {Name R1}")
        stage.run(1.0)
        assert kinds() == {kind for kind, _ in listed("AirRobot")}


def test_the_drone_says_what_its_client_reads() -> None:
    """ARDrone: Accel with Acceleration and Orientation, one sonar called Sonar1 that looks down,
    ground truth; lines below the 400 bytes of the client; Viewports accepted (addendum)."""
    with Rehearsal(world="empty", max_robots=1) as stage:
        client = stage.connect()
        client.send(
            "INIT {ClassName USARBot.ARDrone} {Name ARDrone} {Location 0.0,0.0,-1.1}",
            "SET {Type Viewports} {Config SingleView} {Viewport1 Camera2}",
            "DRIVE {AltitudeVelocity 0.0} {LinearVelocity 0.0} {LateralVelocity 0.0}"
            " {RotationalVelocity 0.0} {Normalized false}",
        )
        stage.run(1.0)
        said = client.take()
        assert any(line.startswith("STA {Type AerialVehicle} ") for line in said), "ut2004"
        battery = [int(one) for one in re.findall(r"\{Battery (\d+)\}", "\n".join(said))]
        assert max(battery) == pytest.approx(720, abs=1)
        assert max(map(len, said)) < 400
        number = r"-?\d+\.\d{4}"
        vector = f"{number},{number},{number}"
        accel = [line for line in said if "{Type Accel}" in line]
        for line in accel:
            assert re.search(
                rf"\{{Name Accel\}} \{{Acceleration {vector}\}} \{{Orientation {vector}\}}$", line
            ), line
        sonar = [line for line in said if "{Type Sonar}" in line]
        # 1.1 m above the floor.
        heights = [re.search(r"\{Name Sonar1 Range ([\d.]+)\}$", line) for line in sonar]
        assert all(one and float(one[1]) == pytest.approx(1.1, abs=0.02) for one in heights)
        assert accel
        assert sonar
        assert any("{Type GroundTruth}" in line for line in said)
        client.send("DRIVE {RotationalVelocity 0.5}")
        stage.run(2.0)
        last = [line for line in client.take() if "{Type Accel}" in line][-1]
        roll, pitch, yaw = map(float, re.search(r"Orientation ([^}]*)", last)[1].split(","))  # type: ignore[index]
        assert (roll % 6.2832, pitch % 6.2832) == pytest.approx((0.0, 0.0), abs=0.01)
        assert yaw == pytest.approx(1.0, abs=0.06), "rad per second, clockwise"
        client.send("GETCONF {Type Camera}")
        (line,) = client.take("CONF")
        assert re.findall(r"\{Name (\w+)\}", line) == ["Camera", "Camera2"]
