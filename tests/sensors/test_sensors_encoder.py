"""Wheel encoders (robots reference 2.4, 82 to 84; protocol 99, 110)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_fakes import UDK, UT2004, FakeRobot, describe_robot, make, read, text_of, values

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import sen_lines
from usarsim_server.sensors.wheels import Encoder


def ticks(sensor: Encoder, dialect=UDK) -> int:
    return int(values(sensor, dialect)["Tick"])


def turn(sensor: Encoder, robot: FakeRobot, angles: list[float]) -> None:
    """Turn the four wheels by these angles (rad) and read."""
    robot.wheel_angles = robot.wheel_angles + np.array(angles)
    assert read(sensor, robot)


@pytest.mark.parametrize(("name", "wheel"), [("W0", 0), ("W1", 1), ("w2", 2), ("EncW3", 3)])
def test_numbers_count_driven_wheels_from_zero(name: str, wheel: int) -> None:
    """Robots 82: W1 and W2 are the second and third driven wheel in part order."""
    sensor, robot = make("Encoder", name, noise=0.0), FakeRobot()
    read(sensor, robot)
    turn(sensor, robot, [0.1 + i for i in range(4)])
    assert ticks(sensor) == int((0.1 + wheel) / 0.01745)


def test_udk_reports_under_the_wheel_number() -> None:
    """The reported name is exactly Wk in udk, the item's own in ut2004 (protocol 4.6)."""
    sensor = make("Encoder", "ECRight")
    assert sensor.wire_name(UDK) == "W1"
    assert sensor.wire_name(UT2004) == "ECRight"


@pytest.mark.parametrize(
    ("name", "options", "wheel"),
    [
        ("ECLeft", {}, 0),
        ("ECRight", {}, 1),
        ("EC", {"link": "leftrearwheel"}, 2),
        ("EC", {"wheel": "RightRearWheel"}, 3),
        ("EC", {"wheel": 2}, 2),
        ("W1", {"wheel": 0}, 0),
        ("ECLeft", {"link": "RightFrontWheel"}, 1),
    ],
)
def test_the_wheel_follows_from_key_link_or_name(
    name: str, options: dict[str, object], wheel: int
) -> None:
    """The key `wheel` wins, then the link, then the name; sides mean the front wheels."""
    assert make("Encoder", name, **options).wheel == wheel


@pytest.mark.parametrize(
    ("name", "options"),
    [("EC", {}), ("W7", {}), ("EC", {"wheel": 4}), ("EC", {"wheel": -1}), ("EC", {"wheel": True})],
)
def test_an_unclear_wheel_is_refused(name: str, options: dict[str, object]) -> None:
    """The message lists the driven wheels."""
    with pytest.raises(RobotDescriptionError, match=r"wheel: .*from 0 to 3.*leftfrontwheel"):
        make("Encoder", name, **options)


def test_a_robot_without_driven_wheels_cannot_have_one() -> None:
    """The cure is to remove the encoder."""
    with pytest.raises(RobotDescriptionError, match="remove the encoder"):
        make("Encoder", "W0", robot=describe_robot(wheels=()))


@settings(max_examples=60)
@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=20))
def test_udk_values_wrap_within_one_turn(angles: list[float]) -> None:
    """Robots 82: -360..360, with the sign of the angle."""
    sensor, robot = make("Encoder", "W0"), FakeRobot()
    read(sensor, robot)
    for angle in angles:
        turn(sensor, robot, [angle] * 4)
        assert -360 <= ticks(sensor) <= 360
        assert ticks(sensor) * sensor._reading >= 0.0


def test_ut2004_accumulates_one_tick_per_degree() -> None:
    """Robots 83: ten turns are 3600 ticks and do not wrap; udk shows what is left."""
    sensor, robot = make("Encoder", "ECLeft", noise=0.0), FakeRobot()
    read(sensor, robot)
    for _ in range(10):
        turn(sensor, robot, [math.tau] * 4)
    assert ticks(sensor, UT2004) == pytest.approx(3600, abs=2)
    assert abs(ticks(sensor, UDK)) in (0, 360)


def test_cumulative_keeps_udk_from_wrapping() -> None:
    """The option of protocol reference 5.2 number 26."""
    sensor, robot = make("Encoder", "W0", noise=0.0, cumulative=True), FakeRobot()
    read(sensor, robot)
    turn(sensor, robot, [20.0] * 4)
    assert ticks(sensor, UDK) == ticks(sensor, UT2004) == int(20.0 / 0.01745)


def test_rolling_forward_increases_and_backward_decreases() -> None:
    """Protocol 110; the count is truncated toward zero."""
    sensor, robot = make("Encoder", "W0"), FakeRobot()
    read(sensor, robot)
    turn(sensor, robot, [1.0] * 4)
    assert ticks(sensor) > 0
    turn(sensor, robot, [-2.0] * 4)
    assert ticks(sensor) < 0


def test_the_error_is_a_fraction_of_the_increment() -> None:
    """Robots 84: standard deviation 0.005/sqrt(3) of what was turned since the last report."""
    sensor, robot, errors = make("Encoder", "W0", seed=7), FakeRobot(), []
    read(sensor, robot)
    before = 0.0
    for _ in range(4000):
        turn(sensor, robot, [2.0] * 4)
        errors.append((sensor._reading - before - 2.0) / 2.0)
        before = sensor._reading
    assert np.std(errors) == pytest.approx(0.005 / math.sqrt(3), rel=0.05)
    assert np.max(np.abs(errors)) <= 0.005 + 1e-9
    assert abs(np.corrcoef(errors[:-1], errors[1:])[0, 1]) < 0.06


def test_a_standing_wheel_has_no_noise() -> None:
    """Errors come with motion; ticks do not flicker at rest."""
    sensor, robot = make("Encoder", "W0"), FakeRobot()
    read(sensor, robot)
    turn(sensor, robot, [100.0] * 4)
    first = ticks(sensor)
    for _ in range(20):
        turn(sensor, robot, [0.0] * 4)
        assert ticks(sensor) == first


def test_the_literal_noise_multiplies_the_whole_angle() -> None:
    """robots 2.4: after 100 turns the original's encoder flickers by half a turn at rest."""
    sensor, robot, readings = make("Encoder", "W0", udk_literal=True), FakeRobot(), []
    read(sensor, robot)
    turn(sensor, robot, [200 * math.pi] * 4)
    for _ in range(500):
        turn(sensor, robot, [0.0] * 4)
        readings.append(sensor._reading)
    assert np.std(readings) == pytest.approx(200 * math.pi * 0.005 / math.sqrt(3), rel=0.1)
    assert np.max(np.abs(np.array(readings) - 200 * math.pi)) > math.pi / 2


def test_reset_counts_from_here() -> None:
    """SET RESET zeroes the count and forgets what was turned since the last report."""
    sensor, robot = make("Encoder", "W0", noise=0.0), FakeRobot()
    read(sensor, robot)
    turn(sensor, robot, [5.0] * 4)
    robot.roll_wheels(1.0, 1.0)
    assert sensor.set("RESET", "", robot) is SetResult.OK
    assert ticks(sensor, UT2004) == 0
    turn(sensor, robot, [0.5] * 4)
    assert ticks(sensor, UT2004) == int(0.5 / 0.01745)
    assert sensor.set("SCAN", "", robot) is SetResult.UNKNOWN


def test_it_is_silent_on_other_kinds_of_robots() -> None:
    """Encoders are a matter of skid-steered vehicles (protocol reference 4.6)."""
    sensor = make("Encoder", "W0", robot=describe_robot(kind="ackerman"))
    assert not read(sensor)
    assert sensor.set("RESET", "", FakeRobot()) is SetResult.OK


def test_sen_of_both_dialects() -> None:
    """One batched line without Time, or one line each with Time (protocol reference 4.6)."""
    robot = FakeRobot()
    pair = [make("Encoder", name, noise=0.0) for name in ("ECLeft", "ECRight")]
    for sensor in pair:
        read(sensor, robot)
        robot.wheel_angles = np.zeros(4)
    robot.roll_wheels(412.5 * 0.01745, 405.5 * 0.01745)
    for sensor in pair:
        read(sensor, robot)
    assert sen_lines(pair, 63.4021, UT2004) == [
        "SEN {Type Encoder} {Name ECLeft Tick 412} {Name ECRight Tick 405}"
    ]
    assert sen_lines(pair, 63.4021, UDK) == [
        "SEN {Time 63.4021} {Type Encoder} {Name W0} {Tick 52}",
        "SEN {Time 63.4021} {Type Encoder} {Name W1} {Tick 45}",
    ]


def test_conf() -> None:
    """Resolution in both dialects."""
    for dialect in (UT2004, UDK):
        assert text_of(make("Encoder", "W0").configuration(dialect)) == "{Resolution 0.0174}"
