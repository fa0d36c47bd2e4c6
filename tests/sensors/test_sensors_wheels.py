"""Odometry and tachometer (robots reference 2.4, 79 to 81, 85; protocol 108,
109, 119).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_fakes import (
    RADIUS,
    TRACK,
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

from usarsim_server.robots.description import Wheel
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import sen_lines


def drive(sensor, robot, left: float, right: float, steps: int = 1) -> list[float]:
    """Roll the wheels in equal steps (rad in all), read after each; the last Pose."""
    for _ in range(steps):
        robot.time += 0.1
        robot.roll_wheels(left / steps, right / steps)
        assert read(sensor, robot)
    return numbers(values(sensor)["Pose"])


def test_it_is_zero_at_spawn() -> None:
    """Protocol 108, whatever the wheels' angles are by then."""
    sensor, robot = make("Odometry"), FakeRobot()
    robot.roll_wheels(5.0, -7.0)
    assert read(sensor, robot)
    assert values(sensor)["Pose"] == "0.0000,0.0000,0.0000"


def test_two_metres_straight_read_two_metres() -> None:
    """Robots 79, within 1 %, and no sideways motion."""
    sensor, robot = make("Odometry"), FakeRobot()
    read(sensor, robot)
    x, y, theta = drive(sensor, robot, 2.0 / RADIUS, 2.0 / RADIUS, steps=20)
    assert x == pytest.approx(2.0, abs=1e-3)
    assert (y, theta) == (0.0, 0.0)


def test_reset_returns_to_zero() -> None:
    """Robots 79, protocol 109: the present place becomes the origin."""
    sensor, robot = make("Odometry"), FakeRobot()
    read(sensor, robot)
    drive(sensor, robot, 10.0, 8.0, steps=5)
    robot.roll_wheels(1.0, 1.0)
    assert sensor.set("RESET", "", robot) is SetResult.OK
    assert values(sensor)["Pose"] == "0.0000,0.0000,0.0000"
    assert drive(sensor, robot, 1.0, 1.0)[0] == pytest.approx(RADIUS, abs=1e-4)


def test_other_opcodes_are_unknown() -> None:
    """Only RESET is obeyed."""
    sensor, robot = make("Odometry"), FakeRobot()
    assert sensor.set("POSE", "1,2,3,4,5,6", robot) is SetResult.UNKNOWN


def test_a_clockwise_turn_increases_theta_without_wrapping() -> None:
    """Protocol 108; two turns read 4 pi."""
    sensor, robot = make("Odometry"), FakeRobot()
    read(sensor, robot)
    wheel = 4 * math.pi * TRACK / 2 / RADIUS
    x, y, theta = drive(sensor, robot, wheel, -wheel, steps=100)
    assert theta == pytest.approx(4 * math.pi, abs=1e-3)
    assert (x, y) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-9))


def test_turns_use_the_announced_geometric_track() -> None:
    """Robots 80: with an effective track 1/rho wider the robot truly turns rho as much."""
    rho = 0.67
    sensor, robot = make("Odometry"), FakeRobot()
    read(sensor, robot)
    wheel = 3.0
    true_turn = 2 * wheel * RADIUS / (TRACK / rho)
    theta = drive(sensor, robot, wheel, -wheel, steps=10)[2]
    assert theta / true_turn == pytest.approx(1 / rho, rel=0.03)


def test_the_heading_of_the_previous_interval_is_used() -> None:
    """Explicit Euler: way and turn of one interval move along the old heading."""
    sensor, robot = make("Odometry"), FakeRobot()
    read(sensor, robot)
    x, y, theta = drive(sensor, robot, 4.0, 2.0)
    assert (x, y) == (pytest.approx(3 * RADIUS, abs=1e-4), 0.0)
    turn = 2 * RADIUS / TRACK
    assert theta == pytest.approx(turn, abs=1e-4)
    x2, y2, _ = drive(sensor, robot, 4.0, 2.0)
    assert x2 - x == pytest.approx(3 * RADIUS * math.cos(turn), abs=2e-4)
    assert y2 - y == pytest.approx(3 * RADIUS * math.sin(turn), abs=2e-4)


def test_it_looks_at_the_front_wheels() -> None:
    """Left front and right front by position, whatever the part order."""
    wheels = tuple(
        Wheel(f"w{i}", side, (x, y, 0.0), RADIUS, 0.05, 0.5)
        for i, (side, x, y) in enumerate(
            [("right", -0.2, -0.2), ("right", 0.2, -0.2), ("left", -0.2, 0.2), ("left", 0.2, 0.2)]
        )
    )
    sensor, robot = make("Odometry", robot=describe_robot(wheels=wheels)), FakeRobot()
    read(sensor, robot)
    robot.wheel_angles = np.array([9.0, 1.0, 9.0, 1.0])
    read(sensor, robot)
    assert numbers(values(sensor)["Pose"])[0] == pytest.approx(RADIUS, abs=1e-4)


def test_free_wheels_do_not_count() -> None:
    """The index is among driven wheels, as the state's wheel angles are."""
    wheels = (
        Wheel("free", "left", (0.5, 0.0, 0.0), 0.05, 0.02, 0.1, driven=False),
        Wheel("l", "left", (0.0, 0.2, 0.0), RADIUS, 0.05, 0.5),
        Wheel("r", "right", (0.0, -0.2, 0.0), RADIUS, 0.05, 0.5),
    )
    sensor, robot = make("Odometry", robot=describe_robot(wheels=wheels)), FakeRobot()
    read(sensor, robot)
    robot.wheel_angles = np.array([2.0, 2.0])
    read(sensor, robot)
    assert numbers(values(sensor)["Pose"])[0] == pytest.approx(2 * RADIUS, abs=1e-4)


def test_it_is_silent_on_other_kinds_of_robots() -> None:
    """Robots 81; RESET does no harm there."""
    sensor = make("Odometry", robot=describe_robot(kind="ackerman"))
    assert not read(sensor)
    assert sensor.set("RESET", "", FakeRobot()) is SetResult.OK
    assert not read(sensor)


def test_it_is_silent_without_wheels() -> None:
    """A robot without driven wheels has no odometry."""
    assert not read(make("Odometry", robot=describe_robot(wheels=())))


def test_quantised_wheels_move_in_whole_steps() -> None:
    """With quantisation the pose is a multiple of one encoder step; without it is exact."""
    robot, step = FakeRobot(), 0.0099
    coarse, fine = make("Odometry", quantised=True), make("Odometry")
    for sensor in (coarse, fine):
        read(sensor, robot)
    robot.roll_wheels(step * 100.6, step * 100.6)
    for sensor in (coarse, fine):
        read(sensor, robot)
    assert coarse._pose[0] == pytest.approx(100 * step * RADIUS)
    assert fine._pose[0] == pytest.approx(100.6 * step * RADIUS)


@settings(max_examples=50)
@given(st.lists(st.floats(0.0, 3.0), min_size=1, max_size=8))
def test_call_times_do_not_matter_on_a_straight(pauses: list[float]) -> None:
    """Reading often or seldom gives the same distance."""
    sensor, robot = make("Odometry"), FakeRobot()
    read(sensor, robot)
    for pause in pauses:
        robot.time += pause
        robot.roll_wheels(3.0 * pause, 3.0 * pause)
        read(sensor, robot)
        read(sensor, robot)
    assert sensor._pose[0] == pytest.approx(3.0 * sum(pauses) * RADIUS)


def test_conf_and_sen_of_both_dialects() -> None:
    """Protocol reference 4.6 and 4.8; Time in udk only (protocol 96)."""
    sensor = make("Odometry", "Odometry")
    assert text_of(sensor.configuration(UT2004)) == (
        "{ScanInterval 0.2000} {EncoderResolution 0.0099}"
    )
    assert text_of(sensor.configuration(UDK)) == "{ScanInterval 0.1000}"
    read(sensor)
    assert sen_lines([sensor], 63.4021, UT2004) == [
        "SEN {Type Odometry} {Name Odometry} {Pose 0.0000,0.0000,0.0000}"
    ]
    assert sen_lines([sensor], 63.4021, UDK) == [
        "SEN {Time 63.4021} {Type Odometry} {Name Odometry} {Pose 0.0000,0.0000,0.0000}"
    ]


SPEEDS = np.array([1.3, 1.2, -0.4, 0.0])


def spin(robot: FakeRobot, seconds: float) -> None:
    robot.time += seconds
    robot.wheel_speeds = SPEEDS
    robot.wheel_angles = robot.wheel_angles + SPEEDS * seconds


def test_vel_is_the_wheel_speed_and_pos_lags_by_one_interval() -> None:
    """Robots 85, wheels in part order."""
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
    """Protocol 119 from the first line on: momentary spin, zero angles."""
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
