"""IMU and accelerometers (robots reference 2.5, checklist 98; protocol reference 4.6)."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_fakes import UDK, FakeRobot, make, numbers, read, values

from usarsim_server.sensors.report import sen_lines

KEYS = ["XYZAcceleration", "AngularVel", "AngularAccel", "Rotation"]


def accelerate(sensor, robot: FakeRobot, change: tuple[float, float, float]) -> None:
    """Change the world velocity (simulation frame, m/s) within 0.1 s."""
    read(sensor, robot)
    robot.time += 0.1
    robot.linear_velocity = tuple(a + b for a, b in zip(robot.linear_velocity, change, strict=True))
    assert read(sensor, robot)


def test_at_rest_everything_is_zero() -> None:
    """Checklist 98: no gravity in the IMU."""
    sensor, robot = make("IMU"), FakeRobot()
    accelerate(sensor, robot, (0.0, 0.0, 0.0))
    assert [key for key, _ in sensor.data(UDK)] == KEYS
    assert {text for _, text in sensor.data(UDK)} == {"0.0000,0.0000,0.0000"}


def test_the_accelerometer_at_rest_reads_gravity() -> None:
    """Checklist 98: plus g on z, which points down; the Accel type reads zero."""
    robot = FakeRobot()
    proper, plain = make("Accelerometer"), make("Acceleration")
    accelerate(proper, robot, (0.0, 0.0, 0.0))
    accelerate(plain, robot, (0.0, 0.0, 0.0))
    assert proper.data(UDK) == (("ProperAcceleration", "0.0000,0.0000,9.8100"),)
    assert plain.data(UDK) == (("Acceleration", "0.0000,0.0000,0.0000"),)
    assert (proper.wire_type, plain.wire_type) == ("AcceleroMeter", "Accel")


def test_a_tilted_accelerometer_feels_the_gravity_component() -> None:
    """Nose up by 30 degrees: half of g acts toward the tail."""
    sensor, robot = make("Accelerometer"), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, math.radians(30.0), 0.0))
    accelerate(sensor, robot, (0.0, 0.0, 0.0))
    assert numbers(values(sensor)["ProperAcceleration"]) == pytest.approx(
        [-9.81 * 0.5, 0.0, 9.81 * math.cos(math.radians(30.0))], abs=1e-3
    )


@pytest.mark.parametrize(
    ("change", "imu", "accel"),
    [
        ((0.2, 0.0, 0.0), [2.0, 0.0, 0.0], [2.0, 0.0, 0.0]),
        ((0.0, 0.2, 0.0), [0.0, -2.0, 0.0], [0.0, -2.0, 0.0]),
        ((0.0, 0.0, 0.2), [0.0, 0.0, 2.0], [0.0, 0.0, -2.0]),
    ],
)
def test_signs_of_the_axes(change, imu: list[float], accel: list[float]) -> None:
    """Forward, right, and up in the IMU but down in the accelerometer."""
    for kind, key, expected in (
        ("IMU", "XYZAcceleration", imu),
        ("Acceleration", "Acceleration", accel),
    ):
        sensor = make(kind)
        accelerate(sensor, FakeRobot(), change)
        assert numbers(values(sensor)[key]) == pytest.approx(expected, abs=1e-3)


def test_acceleration_is_in_the_frame_of_the_sensor() -> None:
    """A robot that looks right and speeds up along its nose reads forward acceleration."""
    for kind, key in (("IMU", "XYZAcceleration"), ("Acceleration", "Acceleration")):
        robot, sensor = FakeRobot(), make(kind)
        robot.place((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2))
        accelerate(sensor, robot, (0.0, -0.1, 0.0))
        assert numbers(values(sensor)[key]) == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)
        backward = make(kind, rotation=(0.0, 0.0, math.pi))
        accelerate(backward, robot, (0.0, -0.1, 0.0))
        assert numbers(values(backward)[key]) == pytest.approx([-1.0, 0.0, 0.0], abs=1e-3)


def test_rates_are_differences_of_wire_angles() -> None:
    """A turn to the right has positive yaw rate; its change is the angular acceleration."""
    sensor, robot = make("IMU"), FakeRobot()
    read(sensor, robot)
    for yaw in (0.05, 0.15):
        robot.time += 0.1
        robot.place((0.0, 0.0, 0.0), (0.0, -0.0872, yaw))
        assert read(sensor, robot)
    assert numbers(values(sensor)["AngularVel"]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)
    assert numbers(values(sensor)["AngularAccel"])[2] == pytest.approx(5.0, abs=1e-3)
    assert numbers(values(sensor)["Rotation"]) == pytest.approx([0.0, -0.0872, 0.15], abs=1e-3)


def test_a_turn_past_half_a_turn_has_no_jump() -> None:
    """Yaw from 179 to -179 degrees is a small turn."""
    sensor, robot = make("IMU"), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(179.0)))
    read(sensor, robot)
    robot.time += 0.1
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(-179.0)))
    read(sensor, robot)
    assert numbers(values(sensor)["AngularVel"])[2] == pytest.approx(math.radians(20.0), abs=1e-3)


@pytest.mark.parametrize("kind", ["IMU", "Acceleration", "Accelerometer"])
def test_the_first_reading_reports_nothing(kind: str) -> None:
    """There is no interval to differentiate over; the second reading reports."""
    sensor, robot = make(kind), FakeRobot(linear_velocity=(9.0, 0.0, 0.0))
    assert not read(sensor, robot)
    assert not read(sensor, robot)
    robot.time += 0.1
    assert read(sensor, robot)
    assert float(sensor.data(UDK)[0][1].split(",")[0]) == 0.0


@pytest.mark.parametrize("kind", ["IMU", "Acceleration"])
def test_a_reading_at_the_same_time_repeats_the_last(kind: str) -> None:
    """No division by zero, and nothing is forgotten."""
    sensor, robot = make(kind), FakeRobot()
    accelerate(sensor, robot, (0.2, 0.0, 0.0))
    before = sensor.data(UDK)
    assert read(sensor, robot)
    assert sensor.data(UDK) == before


@settings(max_examples=40)
@given(st.floats(0.001, 5.0), st.floats(-3.0, 3.0))
def test_any_interval_gives_the_same_acceleration(interval: float, acceleration: float) -> None:
    """Differences are divided by the true time between calls."""
    sensor, robot = make("IMU"), FakeRobot()
    read(sensor, robot)
    for _ in range(3):
        robot.time += interval
        vx = robot.linear_velocity[0] + acceleration * interval
        robot.linear_velocity = (vx, 0.0, 0.0)
        read(sensor, robot)
    assert sensor._acceleration[0] == pytest.approx(acceleration, abs=1e-6)


def test_sen_of_the_imu() -> None:
    """The template of protocol reference 4.6."""
    sensor, robot = make("IMU", "IMU"), FakeRobot()
    read(sensor, robot)
    robot.time = 12.3047
    robot.place((0.0, 0.0, 0.0), (0.0, -0.0872, 1.5708))
    read(sensor, robot)
    (line,) = sen_lines([sensor], robot.time, UDK)
    assert line.startswith(
        "SEN {Time 12.3047} {Type IMU} {Name IMU} {XYZAcceleration 0.0000,0.0000,0.0000} "
        "{AngularVel 0.0000,-0.0070,0.1276} {AngularAccel "
    )
    assert line.endswith("{Rotation 0.0000,-0.0872,1.5708}")
