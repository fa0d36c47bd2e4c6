"""What lines of both dialects become, after the examples of the protocol reference, 4.2 to 4.13."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from usarsim_client import DepthPicture, decode, readings, reports
from usarsim_client.state import MOST_KEPT, RobotState
from usarsim_server.protocol.values import Dialect

CASES: list[tuple[str, type, dict[str, Any]]] = [
    (
        "SEN {Time 63.4021} {Type Sonar} {Name LeftSonar} {Range 1.9820}",
        readings.Sonar,
        {"name": "LeftSonar", "range": 1.982, "time": 63.4021},
    ),
    ("SEN {Type IR} {Name IR1 Range 0.4411}", readings.IR, {"name": "IR1", "range": 0.4411}),
    (
        "SEN {Type Encoder} {Name ECLeft Tick -412}",
        readings.Encoder,
        {"name": "ECLeft", "ticks": -412, "time": 7.0},
    ),
    (
        "SEN {Time 1.0} {Type Tachometer} {Name T} {Vel 1.3,1.2} {Pos 40.1,40.0}",
        readings.Tachometer,
        {"speeds": (1.3, 1.2), "angles": (40.1, 40.0)},
    ),
    ("SEN {Type Tachometer} {Name T}", readings.Tachometer, {"speeds": (), "angles": ()}),
    (
        "SEN {Type Odometry} {Name Odometry} {Pose 1.2044,-0.0310,6.2518}",
        readings.Odometry,
        {"x": 1.2044, "y": -0.031, "theta": 6.2518},
    ),
    (
        "SEN {Type INS} {Name INS} {Location 4.51,1.88,1.84} {Orientation 0.00,6.28,1.57}",
        readings.INS,
        {
            "location": (4.51, 1.88, 1.84),
            "orientation": pytest.approx((0.0, 6.28 - math.tau, 1.57)),
        },
    ),
    (
        "SEN {Time 63.4} {Type GroundTruth} {Name GT} {Location 4,1,-0.1} {Orientation 0,0,1}",
        readings.GroundTruth,
        {"location": (4.0, 1.0, -0.1), "orientation": (0.0, 0.0, 1.0)},
    ),
    (
        "SEN {Type INU} {Name INU} {Orientation 0.00,0.01,1.57}",
        readings.Attitude,
        {"orientation": (0.0, 0.01, 1.57)},
    ),
    (
        "SEN {Time 1} {Type IMU} {Name IMU} {XYZAcceleration 0.01,-0.02,0.03} "
        "{AngularVel 0,0,0.5} {AngularAccel 0,0,0.01} {Rotation 0,-0.08,1.5}",
        readings.IMU,
        {"acceleration": (0.01, -0.02, -0.03), "angular_velocity": (0.0, 0.0, 0.5)},
    ),
    (
        "SEN {Time 1} {Type AcceleroMeter} {Name A} {ProperAcceleration 0.1,0,9.81}",
        readings.Acceleration,
        {"acceleration": (0.1, 0.0, 9.81), "orientation": None},
    ),
    (
        "SEN {Type GPS} {Name GPS} {Latitude 39,30.0,N} {Longitude 77,12.0,W} {Fix 1} "
        "{Satellites 9}",
        readings.GPS,
        {"degrees": pytest.approx((39.5, -77.2)), "fix": True, "satellites": 9},
    ),
    (
        "SEN {Time 1}{Type GPS}{Name n}{Latitude 39,30,N}{Lonitude 77,12,E}{Satellites 8}{Fix 1}",
        readings.GPS,
        {"degrees": pytest.approx((39.5, 77.2))},
    ),
    ("SEN {Type GPS} {Name GPS} {Fix 0} {Satellites 2}", readings.GPS, {"fix": False}),
    (
        "SEN {Type Touch} {Name FrontBumper Touch True}",
        readings.Touch,
        {"name": "FrontBumper", "touched": True},
    ),
    (
        "SEN {Type RFID} {Name R} {ID 118} {Location 0.44,-0.2,0.04} {Mem 0} {ID 131} "
        "{Location 1,0,0} {Mem 1}",
        readings.Tags,
        {
            "tags": (
                readings.Tag(118, (0.44, -0.2, 0.04), False),
                readings.Tag(131, (1.0, 0.0, 0.0), True),
            )
        },
    ),
    ("SEN {Time 6} {Type VictSensor} {Status NoVictims}", readings.Victims, {"parts": ()}),
    (
        "SEN {Time 6} {Type VictSensor} {Name V} {PartName Chest} {Location 2.1,0,0.1} "
        "{PartName Arm} {Location 2,1,0}",
        readings.Victims,
        {
            "parts": (
                readings.BodyPart("Chest", (2.1, 0.0, 0.1)),
                readings.BodyPart("Arm", (2.0, 1.0, 0.0)),
            )
        },
    ),
    (
        "SEN {Type VictRFID} {Name V} {VictimId 4} {VictimName Victim4} {VictimStatus Alive} "
        "{Location 0.8,0.1,0}",
        readings.VictimTag,
        {"id": "4", "victim": "Victim4", "status": "Alive"},
    ),
    (
        "SEN {Type HumanMotion} {Name H} {Prob 0.0133}",
        readings.HumanMotion,
        {"probability": 0.0133},
    ),
    (
        "SEN {Type Sound} {Name S} {Loudness 12.5} {Duration 1.2}",
        readings.Sound,
        {"loudness": 12.5},
    ),
    ("SEN {Type CO2Sensor} {Name C} {Gas CO2} {Density 0.04}", readings.Gas, {"density": 0.04}),
    ("SEN {Time 6} {Type Acoustic} {Name A_0} {None}", readings.Acoustic, {"noises": ()}),
    (
        "SEN {Time 6} {Type Acoustic} {Name A} {Direction 0.7,-0.7,0} {Volume 51} {Duration 1.5} "
        "{Delay 0.01}",
        readings.Acoustic,
        {"noises": (readings.Heard((0.7, -0.7, 0.0), 51.0, 1.5, 0.01),)},
    ),
    (
        "SEN {Time 1} {Type MagneticCompass} {Name C} {MagneticAngle 1.5}",
        readings.Compass,
        {"angle": 1.5},
    ),
    (
        "SEN {Time 1} {Type AltitudeSensor} {Name A} {relativeAltitude 1.2} {absoluteAltitude 112}",
        readings.Altitude,
        {"relative": 1.2, "absolute": 112.0},
    ),
    ("SEN {Time 1} {Type MissionTime} {Name T} {Minutes 3}", readings.MissionTime, {"minutes": 3}),
    (
        "SEN {Type ObjectSensor} {Name V} {Object Box3}{Location 3,0,0}{Orientation 0,0,0}"
        "{HitLoc 2.9,0,0}{Material M_Wood} {Object Wall}{Location 5,0,0}{HitLoc 4,0,0}",
        readings.Objects,
        {},
    ),
    (
        "SEN {Time 1} {Type Helper} {Name B} {Pos3D 1,2,3} {Visible true}",
        readings.Ball,
        {"visible": True},
    ),
    (
        "SEN {Type Thermometer} {Name T} {Celsius 21.5}",
        readings.Unknown,
        {"name": "T", "segments": (("Celsius", "21.5"),)},
    ),
    ("SEN {Type Odometry} {Name broken}", readings.Unknown, {"type": "Odometry"}),
    (
        "STA {Type GroundVehicle} {Time 63.40} {FrontSteer 0.1} {RearSteer 0.0} {FRFlipper 0.78} "
        "{LightToggle True} {LightIntensity 100} {Battery 1188} {View 0}",
        reports.Status,
        {
            "battery": 1188,
            "light": True,
            "joints": {"FRFlipper": 0.78},
            "front_steer": 0.1,
            "view": 0,
        },
    ),
    ("STA {Time 12.3047} {Battery 99999}", reports.Status, {"type": "", "battery": 99999}),
    (
        "STA {Time 12.3} {Type USARAvatarNewMale} {Name Worker1} {Location 2,1.5,-0.9} "
        "{Orientation 0,0,1.5} {Walking True}",
        reports.AvatarStatus,
        {"name": "Worker1", "walking": True},
    ),
    (
        "MISSTA {Time 63.40} {Name PT} {Link 1} {Value 0.5} {Torque -20} {Link 2} {Value -0.1} "
        "{Torque -20}",
        reports.MissionState,
        {"links": (reports.LinkState(1, 0.5, -20.0), reports.LinkState(2, -0.1, -20.0))},
    ),
    ("ASTA {Time 63.4021} {Name Arm} {Link 1} {Value 0.5}", reports.MissionState, {"name": "Arm"}),
    (
        "EFF {Time 63.4021} {Type ToolChanger} {Name t} {Status CLOSED}{ToolType Gripper} {Tool g}",
        reports.EffectorState,
        {"closed": True, "tool": "g", "tool_type": "Gripper"},
    ),
    ("EFF {Time 6} {Type Effector} {Name n} {On}", reports.EffectorState, {"closed": True}),
    (
        "BSTA {Time 1.0} {Name W} {Bone Arm} {Rotation 0,1,0}",
        reports.AvatarBones,
        {"bones": {"Arm": (0.0, 1.0, 0.0)}},
    ),
    (
        "CONF {Name P3AT} {Type GroundVehicle} {SteeringType SkidSteered} {Mass 12} {MaxSpeed 1.3} "
        "{MaxTorque 50000} {MaxFrontSteer 0} {MaxRearSteer 0}",
        reports.VehicleConfiguration,
        {"class_name": "P3AT", "steering": "SkidSteered", "max_speed": 1.3},
    ),
    ("CONF {Name AirRobot}", reports.VehicleConfiguration, {"class_name": "AirRobot", "type": ""}),
    (
        "GEO {Type GroundVehicle} {Name P2AT} {Dimensions 0.52,0.49,0.29} {COG 0,0,0} "
        "{WheelRadius 0.13} {WheelSeparation 0.47} {WheelBase 0.288}",
        reports.VehicleGeometry,
        {"wheel_radius": 0.13, "dimensions": (0.52, 0.49, 0.29)},
    ),
    (
        "RES {Time 63.41} {Type RFID} {Name RFID} {status OK} {ID 118} {Mem victim seen here}",
        reports.Result,
        {"ok": True, "segments": (("ID", "118"), ("Mem", "victim seen here"))},
    ),
    (
        "NFO {Gametype BotDeathMatch} {Level RescueHall} {TimeLimit 20}",
        reports.Greeting,
        {"level": "RescueHall", "time_limit": 20},
    ),
    ("NFO {Status Tick} {Time 0.4000}", reports.Tick, {"time": 0.4}),
    (
        "NFO {Status BatteryEmpty} {Time 9.0} {Type Battery} {Name B}",
        reports.Event,
        {"event": "BatteryEmpty", "name": "B"},
    ),
    ("NFO {Pathnode P_0} {Location 3,1,-0.4}", reports.ClosestNode, {"tag": "P_0"}),
    ("DIE {Killer None} {DamageType DmgType_Fell}", reports.Death, {"damage_type": "DmgType_Fell"}),
    ("HELLO {World 1}", reports.Other, {"head": "HELLO", "segments": (("World", "1"),)}),
]


@pytest.mark.parametrize(("line", "kind", "fields"), CASES, ids=[case[0][:40] for case in CASES])
def test_lines_of_both_dialects(line: str, kind: type, fields: dict[str, Any]) -> None:
    (value,) = decode(line.encode(), 7.0)
    assert type(value) is kind
    assert {key: getattr(value, key) for key in fields} == fields


def test_batches_are_a_value_for_each_item() -> None:
    """`ut2004` tells all sonars in one line, `udk` each in its own."""
    values = decode(b"SEN {Time 1.5} {Type Sonar} {Name F1 Range 1.25} {Name F2 Range 5.0}")
    assert values == [
        readings.Sonar("F1", "Sonar", 1.5, 1.25),
        readings.Sonar("F2", "Sonar", 1.5, 5.0),
    ]


def test_scans() -> None:
    """A scan goes from the right, where y is positive, to the left."""
    line = (
        b"SEN {Time 1.0} {Type RangeScanner} {Name L} {Resolution 1.57} {FOV 3.1415} {Range 1,2,3}"
    )
    (scan,) = decode(line)
    assert isinstance(scan, readings.LaserScan)
    assert scan.points == pytest.approx(np.array([[0.0, 1.0], [2.0, 0.0], [0.0, -3.0]]), abs=1e-3)
    with pytest.raises(ValueError, match="read-only"):
        scan.ranges[0] = 0.0
    (broken,) = decode(line.replace(b"1,2,3", b"1,x,3,"))
    assert isinstance(broken, readings.LaserScan)
    assert np.array_equal(broken.ranges, [1.0, math.nan, 3.0], equal_nan=True)


def test_pictures_of_depth() -> None:
    """A strip of two rows; the comma of `udk` behind the last range is no range."""
    (strip,) = decode(
        b"SEN {Time 71.2} {Type RangeImager} {Name K} {Resolution 3,240} {FOV 1,0.7} {Frames 20}"
        b" {Frame 3} {Range 1,2,3,4,5,6,}"
    )
    assert isinstance(strip, readings.DepthStrip)
    assert (strip.frame, strip.frames) == (3, 20)
    assert np.array_equal(strip.rows, [[1, 2, 3], [4, 5, 6]])
    (scan,) = decode(
        b"SEN {Type RangeScanner3D} {Name K} {Resolution 0.1,0.5} {FOV 0.1,1.0} {Range 1,2,3,4,5,6}"
    )
    assert isinstance(scan, readings.Scan3D)
    assert np.array_equal(scan.rows, [[1, 2, 3], [4, 5, 6]])


def _strip(frame: int, frames: int = 3, wide: int = 2, name: str = "K") -> bytes:
    told = ",".join(str(10 * frame + place) for place in range(2 * wide))
    return (
        f"SEN {{Time {70 + frame}.2}} {{Type RangeImager}} {{Name {name}}} {{Resolution {wide},6}} "
        f"{{FOV 1,0.7}} {{Frames {frames}}} {{Frame {frame}}} {{Range {told}}}"
    ).encode()


def test_whole_pictures_of_depth() -> None:
    """Strips become a picture with its last one, of each sensor by itself."""
    state = RobotState()
    lines = [_strip(n, name=name) for n in range(3) for name in ("K", "Left")]
    pictures = [one for line in lines for one in state.feed(line) if isinstance(one, DepthPicture)]
    assert [(one.name, one.time) for one in pictures] == [("K", 72.2), ("Left", 72.2)]
    expected = [[0, 1], [2, 3], [10, 11], [12, 13], [20, 21], [22, 23]]
    assert np.array_equal(pictures[0].rows, expected)
    assert state.newest(DepthPicture, "left") is pictures[1]


@pytest.mark.parametrize(
    "lines",
    [
        [_strip(0), _strip(2)],
        [_strip(1), _strip(2)],
        [_strip(0), _strip(1, wide=3), _strip(2)],
        [_strip(0), _strip(1, frames=4), _strip(2)],
        [_strip(0, frames=10**9), _strip(0, frames=0), _strip(0, frames=-1)],
        [_strip(0), _strip(1), *(_strip(0, name=f"N{n}") for n in range(16)), _strip(2)],
    ],
)
def test_pictures_that_lack_a_strip_are_left_out(lines: list[bytes]) -> None:
    """No picture comes of them, and the next one is whole; a server cannot bloat the client."""
    state = RobotState()
    for line in lines:
        state.feed(line)
    assert state.newest(DepthPicture) is None
    for frame in range(3):
        state.feed(_strip(frame))
    assert state.newest(DepthPicture) is not None


@pytest.mark.parametrize(
    "data",
    [
        "{Type PCL} {Name S} {1.90,0.00,-0.10;1.91,0.02,-0.10}",
        "{Type PCL}{Name A}{1.90,0.00,-0.10 1.91,0.02,-0.10}",
        "{Type LineLaser} {Name L} {Location 0,0,0} {Points [1.90,0.00,-0.10][1.91,0.02,-0.10]}",
    ],
)
def test_points_in_all_spellings(data: str) -> None:
    (cloud,) = decode(f"SEN {data}".encode())
    assert isinstance(cloud, readings.PointCloud)
    assert cloud.points == pytest.approx(np.array([[1.9, 0.0, -0.1], [1.91, 0.02, -0.1]]))


@pytest.mark.parametrize(
    "form",
    [
        "{StartPoses 2} {A 1,2,3 0,0,1.5 B 4,5,6 0,0,0}",
        "{StartPoses 2} {Name A Location 1,2,3 Orientation 0,0,1.5} "
        "{Name B Location 4,5,6 Orientation 0,0,0}",
        "{StartPoses 2}{A 1,2,3 0,0,1.5}{B 4,5,6 0,0,0}",
    ],
)
def test_start_poses_in_all_forms(form: str) -> None:
    assert decode(f"NFO {form}".encode()) == [
        reports.StartPoses(
            (
                reports.StartPose("A", (1.0, 2.0, 3.0), (0.0, 0.0, 1.5)),
                reports.StartPose("B", (4.0, 5.0, 6.0), (0.0, 0.0, 0.0)),
            )
        )
    ]


@pytest.mark.parametrize(
    "line",
    [
        "STA {Name B} {Size 1,2,3} {Location 3,0,0} {Memory red} {Rotation 0,0,0.7} {Name C} "
        "{Size 1,1,1} {Location 0,0,0} {Memory } {Rotation 0,0,0}",
        "STA {Name B} {Size 1,2,-3} {Location 3,0,0 {Memory {red} {Rotation 0,0,0.7} {Name C} "
        "{Size 1,1,1} {Location 0,0,0 {Memory {} {Rotation 0,0,0}",
    ],
)
def test_objects_also_with_the_braces_of_udk(line: str) -> None:
    """Protocol reference 4.11."""
    (listed,) = decode(line.encode())
    assert isinstance(listed, reports.ObjectList)
    assert [(one.name, one.memory, one.size) for one in listed.objects] == [
        ("B", "red", (1.0, 2.0, 3.0)),
        ("C", "", (1.0, 1.0, 1.0)),
    ]
    assert listed.objects[0].rotation == (0.0, 0.0, 0.7)
    assert decode(b"STA") == [reports.ObjectList(())]


def test_cameras_of_both_dialects() -> None:
    """Degrees and a tile in `udk`, radians and none in `ut2004` (side channels reference 2.10)."""
    udk = (
        b"CONF {Type Camera} {Name Camera}{TextureOffsetX 320}{TextureOffsetY 0}"
        b"{TextureResolutionX 320}{TextureResolutionY 240}{CameraDefFov 80.0}{CameraMinFov 20.0}"
        b"{CameraMaxFov 120.0}{CameraFov 90.0}"
    )
    ((one,), (other,)) = (
        value.cameras
        for line in (udk, b"CONF {Type Camera} {Name C} {CameraDefFov 1.39} {CameraFov 1.5}")
        for value in decode(line)
        if isinstance(value, reports.CameraConfigurations)
    )
    assert one.tile == (320, 0, 320, 240)
    assert one.fov == pytest.approx(math.pi / 2)
    assert (other.tile, other.fov) == (None, 1.5)


def test_geometry_of_both_dialects() -> None:
    """Mounts of sensors, links of arms."""
    for line in (
        b"GEO {Type Sonar} {Name F1 Location 0.1,-0.2,0 Orientation 0,0,-1.57 Mount HARD}",
        b"GEO {Type Sonar} {Name F1} {Location 0.1,-0.2,0} {Orientation 0,0,-1.57}{Mount HARD}",
    ):
        (found,) = decode(line)
        assert isinstance(found, reports.Geometry)
        assert found.items == (
            reports.ItemGeometry("F1", (0.1, -0.2, 0.0), (0.0, 0.0, -1.57), "HARD", None, None, ()),
        )
    (arm,) = decode(
        b"GEO {Type Actuator} {Name A} {Location 0.1,0,-0.3} {Orientation 0,0,0}{Mount M} {Link 1}"
        b" {Parent 0} {Location 0,0,-0.1} {Orientation 0,0,0}{Tip 0,0,0.18}"
    )
    assert isinstance(arm, reports.Geometry)
    assert arm.items[0].location == (0.1, 0.0, -0.3)
    assert arm.items[0].tip == (0.0, 0.0, 0.18)
    assert arm.items[0].links[0].parent == 0
    (conf,) = decode(b"CONF {Type MisPkg} {Name P} {Link 1} {MinRange 1} {Link 2} {MinRange -0.7}")
    assert isinstance(conf, reports.Configuration)
    assert [link["minrange"] for link in conf.items[0].links] == ["1", "-0.7"]


def test_state_keeps_the_newest() -> None:
    """Of each item, and not more than it may; the dialect is told by the digits of Time."""
    state = RobotState()
    assert state.dialect is None
    state.feed(b"STA {Time 1.50} {Type GroundVehicle} {Battery 9}")
    assert (state.dialect, state.time) == (Dialect.UT2004, 1.5)
    state.feed(b"STA {Time 1.6000} {Type GroundVehicle} {Battery 8}")
    assert state.dialect is Dialect.UDK
    state.feed(b"SEN {Type Odometry} {Name Odometry} {Pose 1,2,3}")
    found = state.newest(readings.Odometry)
    assert found is not None
    assert found.time == 1.6
    for number in range(2 * MOST_KEPT):
        state.feed(b"SEN {Type Sonar} {Name S%d} {Range 1.0}" % number)
    assert state.newest(readings.Sonar, f"s{2 * MOST_KEPT - 1}") is not None
    assert state.newest(readings.Sonar, "S5") is None
    assert len(state._newest) <= MOST_KEPT
