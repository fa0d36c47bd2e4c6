"""Compass, altimeter and mission clock (robots reference 2.5, checklist 99 and 100)."""

from __future__ import annotations

import math

import pytest
from sensor_fakes import UDK, FakeRobot, describe_world, make, read, values

from usarsim_server.sensors.report import conf_line, sen_lines


@pytest.mark.parametrize(
    ("yaw", "north", "expected"),
    [(1.5708, 0.0, 1.5708), (0.0, 0.5, -0.5), (-3.0, 3.0, math.tau - 6.0), (0.2, 0.2, 0.0)],
)
def test_the_compass_reads_yaw_relative_to_north(yaw: float, north: float, expected: float) -> None:
    """Checklist 100, signed, clockwise positive."""
    sensor, robot = make("MagneticCompass", world=describe_world(north=north)), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
    assert read(sensor, robot)
    assert float(values(sensor)["MagneticAngle"]) == pytest.approx(expected, abs=1.1e-4)


def test_the_literal_compass_reads_zero() -> None:
    """Checklist 100: the original's double conversion."""
    sensor, robot = make("MagneticCompass", literal=True), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    read(sensor, robot)
    assert values(sensor)["MagneticAngle"] == "0.0000"


def test_altitude_is_relative_to_the_start_and_up() -> None:
    """Checklist 99, protocol checklist 123: 0 at spawn, positive above, absolute = 111 more."""
    sensor, robot = make("AltitudeSensor"), FakeRobot()
    robot.place((0.0, 0.0, -0.5))
    read(sensor, robot)
    assert sensor.data(UDK) == (("relativeAltitude", "0.0000"), ("absoluteAltitude", "111.0000"))
    robot.place((3.0, 0.0, -1.7044))
    read(sensor, robot)
    assert sensor.data(UDK) == (("relativeAltitude", "1.2044"), ("absoluteAltitude", "112.2044"))


def test_absolute_altitude_is_never_negative() -> None:
    """Far below the start the absolute value stops at zero, the relative one does not."""
    sensor, robot = make("AltitudeSensor", sea_level=10.0), FakeRobot()
    read(sensor, robot)
    robot.place((0.0, 0.0, 30.0))
    read(sensor, robot)
    assert sensor.data(UDK) == (("relativeAltitude", "-30.0000"), ("absoluteAltitude", "0.0000"))


def test_mission_time_counts_whole_minutes() -> None:
    """Minutes since the first reading."""
    sensor, robot = make("MissionTime"), FakeRobot(time=1000.0)
    for time, minutes in ((1000.0, "0"), (1059.9, "0"), (1060.0, "1"), (1199.0, "3")):
        robot.time = time
        read(sensor, robot)
        assert values(sensor)["Minutes"] == minutes


def test_lines() -> None:
    """The templates of protocol reference 4.6; CONF has nothing but the name (4.8)."""
    robot = FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, 1.5708))
    sensors = [
        make("MagneticCompass", "Compass"),
        make("AltitudeSensor", "Altimeter"),
        make("MissionTime", "Time"),
    ]
    for sensor in sensors:
        read(sensor, robot)
    assert sen_lines(sensors, 12.3047, UDK) == [
        "SEN {Time 12.3047} {Type MagneticCompass} {Name Compass} {MagneticAngle 1.5708}",
        "SEN {Time 12.3047} {Type AltitudeSensor} {Name Altimeter} {relativeAltitude 0.0000} "
        "{absoluteAltitude 111.0000}",
        "SEN {Time 12.3047} {Type MissionTime} {Name Time} {Minutes 0}",
    ]
    assert conf_line(sensors, "missiontime", "time", UDK) == "CONF {Type MissionTime} {Name Time}"
