"""Tachometer (robots reference 2.4, checklist 85; protocol checklist 119)."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_fakes import (
    UDK,
    UT2004,
    FakeRobot,
    describe_robot,
    make,
    numbers,
    read,
    text_of,
    values,
)

from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import sen_lines

SPEEDS = np.array([1.3, 1.2, -0.4, 0.0])


def spin(robot: FakeRobot, seconds: float) -> None:
    robot.time += seconds
    robot.wheel_speeds = SPEEDS
    robot.wheel_angles = robot.wheel_angles + SPEEDS * seconds


def test_vel_is_the_wheel_speed_and_pos_lags_by_one_interval() -> None:
    """Checklist 85, wheels in part order."""
    sensor, robot = make("Tachometer"), FakeRobot()
    assert read(sensor, robot)
    for count in range(1, 6):
        spin(robot, 0.2)
        assert read(sensor, robot)
        assert numbers(values(sensor)["Vel"]) == pytest.approx(SPEEDS, rel=0.01)
        lagging = SPEEDS * 0.2 * (count - 1)
        assert numbers(values(sensor)["Pos"]) == pytest.approx(lagging, abs=2e-4)


def test_vel_is_the_mean_over_the_interval() -> None:
    """A change of speed within an interval shows as the mean, at any interval."""
    sensor, robot = make("Tachometer"), FakeRobot()
    read(sensor, robot)
    robot.time, robot.wheel_angles = 0.5, np.full(4, 2.0)
    robot.wheel_speeds = np.full(4, 99.0)
    read(sensor, robot)
    assert numbers(values(sensor)["Vel"]) == [4.0] * 4


def test_the_first_report_has_both_lists() -> None:
    """Protocol checklist 119 from the first line on: momentary spin, zero angles."""
    sensor, robot = make("Tachometer"), FakeRobot(wheel_speeds=SPEEDS)
    assert read(sensor, robot)
    assert numbers(values(sensor)["Vel"]) == pytest.approx(SPEEDS)
    assert numbers(values(sensor)["Pos"]) == [0.0] * 4


def test_a_second_reading_at_the_same_time_repeats_the_first() -> None:
    """No division by zero, no lost angle."""
    sensor, robot = make("Tachometer"), FakeRobot()
    read(sensor, robot)
    spin(robot, 0.2)
    read(sensor, robot)
    before = sensor.data(UDK)
    assert read(sensor, robot)
    assert sensor.data(UDK) == before
    spin(robot, 0.2)
    read(sensor, robot)
    assert numbers(values(sensor)["Pos"]) == pytest.approx(SPEEDS * 0.2, abs=2e-4)


def test_angles_count_from_the_first_reading() -> None:
    """Wheels that have already turned start at zero."""
    sensor, robot = make("Tachometer"), FakeRobot(wheel_angles=np.full(4, 50.0))
    read(sensor, robot)
    for _ in range(2):
        spin(robot, 0.2)
        read(sensor, robot)
    assert numbers(values(sensor)["Pos"]) == pytest.approx(SPEEDS * 0.2, abs=2e-4)


def test_reset_zeroes_the_angles() -> None:
    """SET RESET; other opcodes are unknown."""
    sensor, robot = make("Tachometer"), FakeRobot()
    for _ in range(3):
        spin(robot, 0.2)
        read(sensor, robot)
    assert sensor.set("RESET", "", robot) is SetResult.OK
    assert numbers(values(sensor)["Pos"]) == [0.0] * 4
    for expected in (0.0, 0.2):
        spin(robot, 0.2)
        read(sensor, robot)
        assert numbers(values(sensor)["Pos"]) == pytest.approx(SPEEDS * expected, abs=2e-4)
    assert sensor.set("SCAN", "", robot) is SetResult.UNKNOWN


def test_it_is_silent_where_there_are_no_wheels_to_watch() -> None:
    """Other kinds of robots, and robots without driven wheels."""
    assert not read(make("Tachometer", robot=describe_robot(kind="ackerman")))
    assert not read(make("Tachometer", robot=describe_robot(wheels=())))


def test_sen_and_conf() -> None:
    """Protocol reference 4.6 and 4.8: Time in udk only, Vel before Pos."""
    sensor, robot = make("Tachometer", "TachTest"), FakeRobot()
    read(sensor, robot)
    for _ in range(2):
        spin(robot, 0.5)
        read(sensor, robot)
    body = (
        "{Type Tachometer} {Name TachTest} {Vel 1.3000,1.2000,-0.4000,0.0000} "
        "{Pos 0.6500,0.6000,-0.2000,0.0000}"
    )
    assert sen_lines([sensor], 63.4021, UDK) == [f"SEN {{Time 63.4021}} {body}"]
    assert sen_lines([sensor], 63.4021, UT2004) == [f"SEN {body}"]
    assert text_of(sensor.configuration(UDK)) == "{ScanInterval 0.2000}"
