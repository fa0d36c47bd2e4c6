"""Lines from sensors: SEN, GEO, CONF (protocol reference 4.5, 4.7, 4.8)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import (
    UDK,
    UT2004,
    FakeRobot,
    Scene,
    describe_robot,
    make,
    read,
    wall_ahead,
)

from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.base import sensor_types
from usarsim_server.sensors.report import conf_line, find_sensors, geo_line, sen_lines
from usarsim_server.simulation.frames import pose_from_wire

RING = [f"F{i}" for i in range(1, 9)] + [f"R{i}" for i in range(1, 9)]
P3AT = describe_robot("P3AT")


def measured(*sensors):
    """The sensors after one reading in front of a wall."""
    for sensor in sensors:
        read(sensor, scene=Scene(wall_ahead(2.0)))
    return list(sensors)


def test_ut2004_has_all_sonars_in_one_line_in_mount_order() -> None:
    """Robots 67 and 68, protocol 97 and 100: F1..F8 then R1..R8."""
    sonars = measured(*(make("Sonar", name) for name in RING))
    body = " ".join(f"{{Name {name} Range 2.0000}}" for name in RING)
    assert sen_lines(sonars, 63.4, UT2004) == [f"SEN {{Time 63.4000}} {{Type Sonar}} {body}"]


def test_udk_has_one_line_for_each_sonar_with_equal_values() -> None:
    """Robots 67, protocol 98."""
    sonars = measured(*(make("Sonar", name) for name in RING))
    assert sen_lines(sonars, 63.4021, UDK) == [
        f"SEN {{Time 63.4021}} {{Type Sonar}} {{Name {name}}} {{Range 2.0000}}" for name in RING
    ]


def test_infrared_is_batched_alike() -> None:
    """Protocol 99, the templates of protocol 4.6."""
    pair = measured(make("IR", "IR1", max_range=3.0), make("IR", "IR2"))
    assert sen_lines(pair, 63.4, UT2004) == [
        "SEN {Time 63.4000} {Type IR} {Name IR1 Range 2.0000} {Name IR2 Range 1.5000}"
    ]
    assert sen_lines(pair, 63.4021, UDK) == [
        "SEN {Time 63.4021} {Type IR} {Name IR1} {Range 2.0000}",
        "SEN {Time 63.4021} {Type IR} {Name IR2} {Range 1.5000}",
    ]


def test_a_batch_stands_where_its_first_sensor_is() -> None:
    """Lines keep the mount order of their first sensors; other types stay single."""
    sensors = measured(
        make("Sonar", "A"),
        make("GroundTruth", "T1"),
        make("IR", "I"),
        make("Sonar", "B"),
        make("GroundTruth", "T2"),
    )
    heads = [line.split("{Name ", 1)[1].split(" ")[0] for line in sen_lines(sensors, 1.0, UT2004)]
    assert [head.rstrip("}") for head in heads] == ["A", "T1", "I", "T2"]
    assert len(sen_lines(sensors, 1.0, UDK)) == 5


def test_only_the_sensors_given_are_in_the_line() -> None:
    """A batch has what just measured, not all sensors of the robot."""
    sonars = measured(*(make("Sonar", name) for name in RING))
    (line,) = sen_lines(sonars[2:4], 1.0, UT2004)
    assert line.count("{Name ") == 2
    assert sen_lines([], 1.0, UT2004) == []


TIMED = {
    "Sonar": (True, True),
    "IR": (True, True),
    "RangeScanner": (True, True),
    "SICK": (True, True),
    "Hokuyo": (True, True),
    "IRScanner": (True, True),
    "GroundTruth": (True, True),
    "Odometry": (False, True),
    "Encoder": (False, True),
    "Tachometer": (False, True),
    "Touch": (False, True),
    "INS": (False, False),
    "INU": (False, False),
    "GPS": (False, False),
    "RangeScanner3D": (True, True),
    "3DRangeScanner": (True, True),
    "RangeImager": (True, True),
    "RotatingPointCloudScanner": (True, True),
    "ExampleSonarArray": (True, True),
    "TouchArray": (False, True),
    "LineLaser": (False, False),
    "ObjectSensor": (False, False),
}


@pytest.mark.parametrize(("kind", "timed"), TIMED.items())
def test_time_is_where_the_table_has_it(kind: str, timed: tuple[bool, bool]) -> None:
    """Protocol 94 to 96 and 113: Time first, then Type, then Name, then data."""
    sensors = measured(make(kind, "W1"))
    for dialect, present in zip((UT2004, UDK), timed, strict=True):
        (line,) = sen_lines(sensors, 5.25, dialect)
        keys = [segment.split(" ")[0].strip("{}") for segment in line.split(" {")[1:]]
        expected = (["Time"] if present else []) + ["Type", "Name"]
        assert keys[: len(expected)] == expected
        assert line.startswith("SEN {")


@pytest.mark.parametrize(
    ("kind", "ut2004", "udk"),
    [
        ("Sonar", "5.2500", "5.2500"),
        ("SICK", "5.25", "5.2500"),
        ("GroundTruth", "5.2500", "5.2500"),
    ],
)
def test_digits_of_time(kind: str, ut2004: str, udk: str) -> None:
    """Protocol reference 2.2: two for range scanners of ut2004, four otherwise."""
    sensors = measured(make(kind))
    for dialect, text in ((UT2004, ut2004), (UDK, udk)):
        assert sen_lines(sensors, 5.25, dialect)[0].startswith(f"SEN {{Time {text}}} ")


@pytest.mark.parametrize("dialect", list(Dialect))
def test_lines_other_than_scans_stay_short(dialect: Dialect) -> None:
    """Protocol 107: below 1024 bytes for the sensors of the standard robots."""
    kinds = ["INS", "GPS", "GroundTruth", "Odometry", "IMU", "Tachometer"]
    sensors = [make("Sonar", name) for name in RING] + [make(kind, f"A{kind}") for kind in kinds]
    robot = FakeRobot()
    robot.place((-999.9, -999.9, -99.9), (-3.1, -1.5, -3.1))
    for _ in range(2):
        for sensor in sensors:
            read(sensor, robot)
        robot.time += 1e5
    assert max(len(line) for line in sen_lines(sensors, 1e5, dialect)) < 1024


def test_geo_of_ut2004_is_multi_pair_with_hard_mounts() -> None:
    """Protocol 134 and the template of protocol 4.7."""
    sonars = [
        make("Sonar", "F1", location=(0.115, -0.13, 0.0), rotation=(0.0, 0.0, -1.5708)),
        make("Sonar", "F2", location=(0.155, -0.115, 0.0), rotation=(0.0, 0.0, -0.8727)),
    ]
    assert geo_line(sonars, "Sonar", None, P3AT, UT2004) == (
        "GEO {Type Sonar} "
        "{Name F1 Location 0.1150,-0.1300,0.0000 Orientation 0.0000,0.0000,-1.5708 Mount HARD} "
        "{Name F2 Location 0.1550,-0.1150,0.0000 Orientation 0.0000,0.0000,-0.8727 Mount HARD}"
    )


def test_geo_of_udk_has_separate_segments_and_the_class_name() -> None:
    """Protocol 134: Name, Location, Orientation, Mount."""
    laser = make("SICK", "lms200", location=(0.18, 0.0, -0.25))
    assert geo_line([laser], "RangeScanner", "lms200", P3AT, UDK) == (
        "GEO {Type RangeScanner} {Name lms200} {Location 0.18,0.00,-0.25} "
        "{Orientation 0.00,0.00,0.00} {Mount P3AT}"
    )


def test_geo_names_the_link_that_carries_the_sensor() -> None:
    """The pose is relative to the link; on a wheel UDK gives the place on the body."""
    tilted = make("Sonar", "S", link="CameraTilt", location=(0.08, 0.0, 0.06))
    encoder = make("Encoder", "W1", link="RightFrontWheel", location=(0.0, 0.01, 0.0))
    assert geo_line([tilted], "Sonar", None, P3AT, UT2004) == (
        "GEO {Type Sonar} {Name S Location 0.0800,0.0000,0.0600 "
        "Orientation 0.0000,0.0000,0.0000 Mount CameraTilt}"
    )
    udk = geo_line([tilted], "Sonar", None, P3AT, UDK)
    assert udk is not None
    assert udk.endswith("{Location 0.08,0.00,0.06} {Orientation 0.00,0.00,0.00} {Mount CameraTilt}")
    assert geo_line([encoder], "Encoder", None, P3AT, UT2004) == (
        "GEO {Type Encoder} {Name W1 Location 0.0000,0.0100,0.0000 "
        "Orientation 0.0000,0.0000,0.0000 Mount RightFrontWheel}"
    )
    assert geo_line([encoder], "Encoder", None, P3AT, UDK) == (
        "GEO {Type Encoder} {Name W1} {Location 0.12,0.21,0.10} {Orientation 0.00,0.00,0.00} "
        "{Mount P3AT}"
    )


def test_geo_is_the_same_wherever_the_robot_stands() -> None:
    """Protocol 135: readings of a turned robot change nothing."""
    laser = make("SICK", "lms200", location=(0.18, 0.0, -0.25))
    before = geo_line([laser], "RangeScanner", None, P3AT, UDK)
    robot = FakeRobot()
    robot.place((5.0, 5.0, 0.0), (0.0, 0.0, math.pi / 2))
    read(laser, robot)
    assert geo_line([laser], "RangeScanner", None, P3AT, UDK) == before


def test_conf_has_all_instances_in_one_line() -> None:
    """Protocol 127 and the template of protocol 4.8."""
    pair = [make("Sonar", name, beam_angle=0.3491) for name in ("F1", "F2")]
    body = "{MaxRange 5.0000} {MinRange 0.1000} {BeamAngle 0.3491}"
    assert conf_line(pair, "Sonar", None, UT2004) == (
        f"CONF {{Type Sonar}} {{Name F1}} {body} {{Name F2}} {body}"
    )
    assert conf_line(pair, "Sonar", "F2", UT2004) == f"CONF {{Type Sonar}} {{Name F2}} {body}"


def test_conf_of_the_sick_in_both_dialects() -> None:
    """Robots 75 and protocol reference 4.8."""
    laser = [make("SICK", "lms200")]
    assert conf_line(laser, "RangeScanner", "lms200", UDK) == (
        "CONF {Type RangeScanner} {Name lms200} {MaxRange 20.0000} {MinRange 0.1000} "
        "{Resolution 0.0174} {Fov 3.1414} {Panning True} {Tilting False}"
    )
    assert conf_line(laser, "RangeScanner", "lms200", UT2004) == (
        "CONF {Type RangeScanner} {Name lms200} {MaxRange 20.0000} {MinRange 0.1000} "
        "{Resolution 0.0174} {Fov 3.1415} {Paning True} {Tilting False}"
    )


def test_the_answer_has_the_canonical_type() -> None:
    """Protocol 128, however the client spells it."""
    laser = [make("Hokuyo", "lms200")]
    for dialect in (UT2004, UDK):
        for line in (
            conf_line(laser, " rangescanner", " LMS200 ", dialect),
            geo_line(laser, "RANGESCANNER", "Lms200", P3AT, dialect),
        ):
            assert line is not None
            assert "{Type RangeScanner} {Name lms200" in line


@pytest.mark.parametrize("asked", [("Sonar", None), ("RangeScanner", "other"), ("SICK", None)])
def test_no_match_gives_no_line(asked: tuple[str, str | None]) -> None:
    """Protocol 126: neither for an unknown type nor for an unknown name."""
    laser = [make("SICK", "lms200")]
    for dialect in (UT2004, UDK):
        assert conf_line(laser, *asked, dialect) is None
        assert geo_line(laser, *asked, P3AT, dialect) is None


@pytest.mark.parametrize("name", ["ECRight", "ecright", "W1", "w1"])
def test_names_of_the_other_dialect_are_understood(name: str) -> None:
    """An encoder answers to its item name and to Wk in both dialects, with the dialect's own."""
    encoders = [make("Encoder", "ECLeft"), make("Encoder", "ECRight")]
    assert conf_line(encoders, "Encoder", name, UDK) == (
        "CONF {Type Encoder} {Name W1} {Resolution 0.0174}"
    )
    assert conf_line(encoders, "Encoder", name, UT2004) == (
        "CONF {Type Encoder} {Name ECRight} {Resolution 0.0174}"
    )
    assert find_sensors(encoders, "encoder", name, Dialect.UDK) == encoders[1:]


@pytest.mark.parametrize("kind", sensor_types())
def test_every_type_answers_both_requests(kind: str) -> None:
    """Protocol 125: what is streamed, and the battery, has GEO and CONF."""
    sensor = make(kind, "W1")
    for dialect in (UT2004, UDK):
        for line in (
            conf_line([sensor], sensor.wire_type, sensor.wire_name(dialect), dialect),
            geo_line([sensor], sensor.wire_type, sensor.wire_name(dialect), P3AT, dialect),
        ):
            assert line is not None
            assert f"{{Type {sensor.wire_type}}}" in line


@pytest.mark.parametrize("kind", sensor_types())
def test_every_type_keeps_the_rules_of_all_sensors(kind: str) -> None:
    """Readings at repeated, late and early times work; unknown opcodes change nothing."""
    sensor, robot, scene = make(kind, "W1"), FakeRobot(), Scene(wall_ahead(2.0))
    for pause in (0.0, 0.1, 0.0, 5.0, 0.001):
        robot.time += pause
        reported = read(sensor, robot, scene)
    for dialect in (UT2004, UDK):
        assert sensor.interval(dialect) >= 0.0
        if reported:
            assert sen_lines([sensor], robot.time, dialect)[0].startswith("SEN {")
        before = sensor.data(dialect)
        assert sensor.set("NO SUCH OPCODE", "1,2,3", robot) is SetResult.UNKNOWN
        assert sensor.data(dialect) == before


def test_the_battery_is_silent_but_listed() -> None:
    """robots 2.10: no SEN; GEO has its place and CONF its name."""
    battery = make("Battery", "battery", location=(0.15, 0.0, -0.2))
    assert not read(battery)
    assert battery.interval(UDK) == 0.0
    assert conf_line([battery], "Battery", None, UDK) == "CONF {Type Battery} {Name battery}"
    assert geo_line([battery], "Battery", None, P3AT, UDK) == (
        "GEO {Type Battery} {Name battery} {Location 0.15,0.00,-0.20} "
        "{Orientation 0.00,0.00,0.00} {Mount P3AT}"
    )


@given(
    st.tuples(*[st.floats(-9, 9)] * 3),
    st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)),
)
def test_the_pose_of_a_sensor_is_carrier_times_mount(place, turn) -> None:
    """A sensor one metre ahead of its carrier is where the carrier's nose points."""
    sensor, robot = make("GroundTruthMovable", location=(1.0, 0.0, 0.0)), FakeRobot()
    robot.place(place, turn)
    expected = (pose_from_wire(place, turn) @ pose_from_wire((1.0, 0.0, 0.0))).position
    assert np.allclose(sensor.world_pose(robot).position, expected)
