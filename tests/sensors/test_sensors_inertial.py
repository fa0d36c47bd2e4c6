"""INS, INU, IMU and accelerometers (robots reference 2.5, 86 to 90, 98; protocol
113; protocol reference 4.5, 4.6).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_fakes import UDK, UT2004, FakeRobot, make, numbers, read, text_of, values

from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import conf_line, sen_lines


def aligned(sensor, robot: FakeRobot | None = None) -> FakeRobot:
    """Rest for one interval, so that the estimate follows from now on."""
    robot = robot or FakeRobot()
    for _ in range(2):
        assert read(sensor, robot)
        robot.time += 0.2
    return robot


def walk(sensor, robot: FakeRobot, distance: float, steps: int) -> None:
    """Move along the wire x axis, reading after each step."""
    x, y, z = robot.pose.position
    for step in range(1, steps + 1):
        robot.time += 0.2
        robot.place((x + distance * step / steps, y, z))
        read(sensor, robot)


def rotate(sensor, robot: FakeRobot, angle: float, steps: int) -> None:
    """Turn about the vertical axis, reading after each step."""
    for step in range(1, steps + 1):
        robot.time += 0.2
        robot.place((0.0, 0.0, 0.0), (0.0, 0.0, angle * step / steps))
        read(sensor, robot)


def estimate(sensor) -> tuple[np.ndarray, np.ndarray]:
    """Location and orientation at full precision."""
    return np.array(sensor._location), np.array(sensor._orientation)


def test_position_error_after_ten_metres() -> None:
    """Robots 86: 0.050 m per axis within 15 % over many runs of 10 m in 0.1 m steps."""
    errors = []
    for seed in range(400):
        sensor = make("INS", seed=seed)
        walk(sensor, aligned(sensor), 10.0, 100)
        errors.append(estimate(sensor)[0] - [10.0, 0.0, 0.0])
    assert np.std(errors, axis=0) == pytest.approx([0.05] * 3, rel=0.15)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.01


def test_yaw_error_after_a_full_turn() -> None:
    """Robots 87: 4.0 degrees within 20 % at 18 degrees per report, 2.3 at 6 degrees."""
    for steps, degrees in ((20, 4.0), (60, 2.3)):
        errors = []
        for seed in range(300):
            sensor = make("INS", seed=seed)
            rotate(sensor, aligned(sensor), math.tau, steps)
            yaw = estimate(sensor)[1][2]
            errors.append(math.degrees((yaw + math.pi) % math.tau - math.pi))
        assert np.std(errors) == pytest.approx(degrees, rel=0.2)


def test_a_standing_robot_does_not_drift() -> None:
    """Robots 88: not at all, however long."""
    sensor, robot = make("INS"), FakeRobot()
    robot.place((4.5, 1.9, -0.2), (0.0, 0.0, 1.57))
    aligned(sensor, robot)
    before = sensor.data(UDK)
    for _ in range(500):
        robot.time += 0.2
        read(sensor, robot)
    assert sensor.data(UDK) == before
    assert before[0] == ("Location", "4.50,1.90,-0.20")


def test_pose_sets_the_estimate_exactly() -> None:
    """Robots 89: also when the robot moved since the last report."""
    sensor = make("INS")
    robot = aligned(sensor)
    robot.place((3.0, 1.0, 0.0))
    assert sensor.set("POSE", "1.0,2.0,0.0,0,0,1.57", robot) is SetResult.OK
    assert values(sensor)["Location"] == "1.00,2.00,0.00"
    assert values(sensor)["Orientation"] == "0.00,0.00,1.57"
    read(sensor, robot)
    location, orientation = estimate(sensor)
    assert location.tolist() == [1.0, 2.0, 0.0]
    assert orientation.tolist() == [0.0, 0.0, 1.57]


def test_pose_removes_the_means_of_the_drift() -> None:
    """Robots 89: with sigma 0 only the means make an error, and afterwards none is left."""
    drifting, corrected = (
        make("INS", sigma=0.0, precision=10.0),
        make("INS", sigma=0.0, precision=10.0),
    )
    robot = aligned(drifting)
    aligned(corrected)
    corrected.set("POSE", "0,0,0,0,0,0", robot)
    walk(drifting, robot, 10.0, 100)
    robot.place((0.0, 0.0, 0.0))
    corrected.set("POSE", "0,0,0,0,0,0", robot)
    walk(corrected, robot, 10.0, 100)
    assert np.abs(estimate(drifting)[0] - [10.0, 0.0, 0.0]).max() > 0.01
    assert estimate(corrected)[0] == pytest.approx([10.0, 0.0, 0.0], abs=1e-9)


def test_the_means_are_small() -> None:
    """robots 2.5: at most 5 mm per 10 m from the means; drifting = false has none."""
    for seed in range(50):
        sensor = make("INS", seed=seed, sigma=0.0)
        walk(sensor, aligned(sensor), 10.0, 50)
        error = np.abs(estimate(sensor)[0] - [10.0, 0.0, 0.0])
        assert 0.0 < error.max() <= 0.005 + 1e-9
    ideal = make("INS", sigma=0.0, drifting=False)
    walk(ideal, aligned(ideal), 10.0, 50)
    assert estimate(ideal)[0] == pytest.approx([10.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    "params", ["", "1,2,3,4,5", "1,2,3,4,5,6,7", "a,b,c,d,e,f", "1,2,3,4,5,nan", "inf,0,0,0,0,0"]
)
def test_pose_needs_six_numbers(params: str) -> None:
    """Anything else fails and changes nothing."""
    sensor = make("INS")
    robot = aligned(sensor)
    before = sensor.data(UDK)
    assert sensor.set("POSE", params, robot) is SetResult.FAILED
    assert sensor.data(UDK) == before


def test_pose_accepts_blanks_after_commas() -> None:
    """Clients write vectors with and without blanks; other opcodes are unknown."""
    sensor, robot = make("INS"), FakeRobot()
    assert sensor.set("POSE", " 1.0, 2.0, 3.0, 0, 0, -0.5 ", robot) is SetResult.OK
    assert estimate(sensor)[1][2] == pytest.approx(math.tau - 0.5)
    assert sensor.set("RESET", "", robot) is SetResult.UNKNOWN


@settings(max_examples=40)
@given(st.lists(st.floats(-math.pi, math.pi), min_size=3, max_size=12))
def test_angles_lie_within_one_turn(turns: list[float]) -> None:
    """Robots 90: in [0, 2 pi), in print as well."""
    sensor = make("INS")
    robot = aligned(sensor)
    for yaw in turns:
        robot.time += 0.2
        robot.place((0.0, 0.0, 0.0), (yaw / 7, yaw / 3, yaw))
        read(sensor, robot)
        assert all(0.0 <= angle < math.tau for angle in estimate(sensor)[1])
        assert all(0.0 <= angle <= 6.28 for angle in numbers(values(sensor)["Orientation"]))


def test_it_starts_at_the_place_of_the_sensor() -> None:
    """The first estimate is the pose of the mount in the world, in the wire frame."""
    robot = FakeRobot()
    robot.place((1.0, 2.0, -0.5), (0.0, 0.0, math.pi / 2))
    sensor = make("INS", location=(0.1, 0.0, -0.2), rotation=(0.0, 0.0, -math.pi))
    read(sensor, robot)
    assert values(sensor)["Location"] == "1.00,2.10,-0.70"
    assert values(sensor)["Orientation"] == "0.00,0.00,4.71"


def test_it_follows_only_after_one_interval_without_turning() -> None:
    """robots 2.5: while the robot turns from the start, the estimate stands still."""
    sensor, robot = make("INS", sigma=0.0, drifting=False), FakeRobot()
    read(sensor, robot)
    rotate(sensor, robot, 0.5, 5)
    assert estimate(sensor)[1].tolist() == [0.0, 0.0, 0.0]
    read(sensor, robot)
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, 0.7))
    read(sensor, robot)
    assert estimate(sensor)[1][2] == pytest.approx(0.2)


def test_the_error_of_the_way_is_on_all_axes() -> None:
    """The whole way times the noise goes to every axis, also those without motion."""
    sensor = make("INS")
    walk(sensor, aligned(sensor), 1.0, 10)
    assert np.all(np.abs(estimate(sensor)[0] - [1.0, 0.0, 0.0]) > 1e-6)


def test_equal_seeds_give_equal_estimates() -> None:
    """Robots 113."""
    results = []
    for seed in (3, 3, 4):
        sensor = make("INS", seed=seed)
        walk(sensor, aligned(sensor), 5.0, 25)
        results.append(estimate(sensor)[0].tolist())
    assert results[0] == results[1] != results[2]


def test_sen_and_conf() -> None:
    """Protocol 113: never Time; two digits (protocol reference 4.6, 4.8)."""
    sensor, robot = make("INS", "InsTest"), FakeRobot()
    robot.place((4.51, 1.88, 1.84), (0.0, -0.001, 1.57))
    read(sensor, robot)
    for dialect in (UT2004, UDK):
        assert sen_lines([sensor], 63.4, dialect) == [
            "SEN {Type INS} {Name InsTest} {Location 4.51,1.88,1.84} {Orientation 0.00,6.28,1.57}"
        ]
        assert text_of(sensor.configuration(dialect)) == "{ScanInterval 0.2000}"
        assert sensor.interval(dialect) == 0.2


TURN = math.radians(18.0)


def turned(sensor, steps: int) -> FakeRobot:
    """Stand still for two readings, then turn right on the spot."""
    robot = FakeRobot()
    robot.place((3.0, 4.0, 0.0), (0.0, 0.01, 1.57))
    read(sensor, robot)
    for step in range(steps + 1):
        robot.time += 0.2
        robot.place((3.0, 4.0, 0.0), (0.0, 0.01, 1.57 + step * TURN))
        read(sensor, robot)
    return robot


@pytest.mark.parametrize("dialect", [UT2004, UDK])
def test_sen_is_orientation_without_time(dialect) -> None:
    """The template of protocol reference 4.6."""
    sensor = make("INU", "INU")
    turned(sensor, 0)
    assert sen_lines([sensor], 5.0, dialect) == [
        "SEN {Type INU} {Name INU} {Orientation 0.00,0.01,1.57}"
    ]


def test_angles_are_whole_turns() -> None:
    """Like those of the INS they are within [0, 2 pi)."""
    sensor, robot = make("INU", sigma=0.0, drifting=False), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (-0.1, -0.2, -0.3))
    read(sensor, robot)
    expected = [math.tau - 0.1, math.tau - 0.2, math.tau - 0.3]
    assert numbers(values(sensor, UT2004)["Orientation"]) == pytest.approx(expected, abs=0.01)


def test_it_drifts_as_the_ins_does() -> None:
    """Equal seeds give the angles of an INS: about 4 degrees off after a turn (robots 87)."""
    inu, ins = make("INU", seed=7), make("INS", seed=7)
    turned(inu, 20)
    turned(ins, 20)
    assert values(inu)["Orientation"] == values(ins)["Orientation"]
    yaw = numbers(values(inu)["Orientation"])[2]
    assert 0.001 < abs(yaw - 1.57) < 0.3


def test_there_is_nothing_to_set_and_nothing_to_configure() -> None:
    """POSE is unknown; CONF has the name only (protocol reference 4.8, all others)."""
    sensor = make("INU", "INU")
    turned(sensor, 0)
    before = sensor.data(UT2004)
    assert sensor.set("POSE", "0,0,0,1,1,1", FakeRobot()) is SetResult.UNKNOWN
    assert sensor.data(UT2004) == before
    assert conf_line([sensor], "INU", None, UT2004) == "CONF {Type INU} {Name INU}"


KEYS = ["XYZAcceleration", "AngularVel", "AngularAccel", "Rotation"]


def accelerate(sensor, robot: FakeRobot, change: tuple[float, float, float]) -> None:
    """Change the world velocity (simulation frame, m/s) within 0.1 s."""
    read(sensor, robot)
    robot.time += 0.1
    robot.linear_velocity = tuple(a + b for a, b in zip(robot.linear_velocity, change, strict=True))
    assert read(sensor, robot)


def test_at_rest_everything_is_zero() -> None:
    """Robots 98: no gravity in the IMU."""
    sensor, robot = make("IMU"), FakeRobot()
    accelerate(sensor, robot, (0.0, 0.0, 0.0))
    assert [key for key, _ in sensor.data(UDK)] == KEYS
    assert {text for _, text in sensor.data(UDK)} == {"0.0000,0.0000,0.0000"}


def test_the_accelerometer_at_rest_reads_gravity() -> None:
    """Robots 98: plus g on z, which points down; the Accel type reads zero."""
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
