"""Cars: Speed, FrontSteer and RearSteer (protocol reference 3.4.2, robots reference 1.4, 4.9)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_fakes import ROBOTS, UDK, Driver, angles_of, steering, wild_drives

from usarsim_server.base.logs import overheard
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.families.steered import (
    Ackerman,
    SteeredWheel,
    joint_ranges,
    turn,
    wire_range,
)
from usarsim_server.robots.mjcf import build_spec

CARS = sorted(name for name, robot in ROBOTS.items() if robot.kind == "ackerman")
SEDAN, FRONT, BASIC = ROBOTS["Sedan"], ROBOTS["FrontAckerman"], ROBOTS["BasicAckermanRobot"]


SIZES = st.tuples(
    st.floats(0.5, 4.0), st.floats(0.3, 2.0), st.floats(0.3, 2.0), st.floats(0.05, 0.6)
)


def car(
    base: float, front: float, rear: float, radius: float, steered: tuple[bool, bool]
) -> list[SteeredWheel]:
    """Four wheels; tracks may differ, and the reference point lies a third behind the middle."""
    ahead, behind = base * 2.0 / 3.0, -base / 3.0
    places = ((ahead, front), (ahead, -front), (behind, rear), (behind, -rear))
    return [
        SteeredWheel(
            x,
            y / 2.0,
            joint=f"{number}" if steered[x < 0.0] else None,
            front=x > 0.0,
            radius=radius * (1.0 if x > 0.0 else 1.3),
        )
        for number, (x, y) in enumerate(places)
    ]


@settings(max_examples=200)
@given(
    SIZES,
    st.floats(-0.8, 0.8),
    st.floats(-0.8, 0.8),
    st.sampled_from([(True, False), (False, True), (True, True)]),
)
def test_all_axles_meet_in_the_centre_of_the_turn(
    size: tuple[float, float, float, float],
    front: float,
    rear: float,
    steered: tuple[bool, bool],
) -> None:
    """Every wheel stands square to its line to the centre, and rolls as far from it as it is.

    The centre is where the axles of two imagined wheels in the middle of both axles meet.
    """
    wheels = car(*size, steered)
    front, rear = front * steered[0], rear * steered[1]
    angles, speeds = turn(wheels, front, rear, literal=False)
    ahead, behind = wheels[0].x, wheels[2].x
    curvature = (math.tan(front) - math.tan(rear)) / (ahead - behind)
    for wheel, angle, speed in zip(wheels, angles, speeds, strict=True):
        if wheel.joint is None:
            assert angle == 0.0
        assert abs(angle) <= math.pi / 2.0
        # Velocity of the wheel in the rigid motion with unit speed ahead in the middle.
        flow = (1.0 - curvature * wheel.y, math.tan(rear) + curvature * (wheel.x - behind))
        rolls = speed * wheel.radius / wheels[0].radius
        along = (rolls * math.cos(angle), rolls * math.sin(angle))
        assert along == pytest.approx(flow, abs=1e-9 * (1.0 + math.hypot(*flow)))


@pytest.mark.parametrize("name", CARS)
def test_straight_ahead_all_wheels_roll_alike(name: str) -> None:
    """Without steering every wheel points ahead, and treads run alike whatever their radius."""
    wheels = steering(name).wheels
    angles, speeds = turn(wheels, 0.0, 0.0, literal=False)
    assert angles == [0.0] * len(wheels)
    treads = [speed * wheel.radius for speed, wheel in zip(speeds, wheels, strict=True)]
    assert treads == pytest.approx([wheels[0].radius] * len(wheels))


def test_inside_of_a_tight_turn_a_wheel_rolls_backwards() -> None:
    """With the centre between the wheels, the inner one turns the other way, not about."""
    wheels = [
        SteeredWheel(0.5, 0.5, joint="l"),
        SteeredWheel(0.5, -0.5, joint="r"),
        SteeredWheel(-0.5, 0.5),
        SteeredWheel(-0.5, -0.5),
    ]
    angles, speeds = turn(wheels, 1.2, 0.0, literal=False)
    assert speeds[0] < 0.0 < speeds[1]
    assert angles[0] < 0.0 < angles[1]
    assert speeds[2] < 0.0 < speeds[3]


def test_literal_steering_is_the_same_for_all() -> None:
    """As in the original: one angle for all wheels of an axle, one speed for all wheels
    (robots 4.9)."""
    wheels = car(1.0, 0.6, 0.6, 0.1, (True, True))
    angles, speeds = turn(wheels, 0.3, -0.2, literal=True)
    assert angles == [0.3, 0.3, -0.2, -0.2]
    assert speeds == [1.0] * 4


@pytest.mark.parametrize("name", CARS)
def test_joints_have_room_for_the_inner_wheel(name: str) -> None:
    """Within the limits of the file no wheel is stopped by its joint, so every turn is true."""
    robot, family = ROBOTS[name], steering(name)
    model = build_spec(robot).compile()
    for front in np.linspace(*wire_range(family.wheels, True), 9):
        for rear in np.linspace(*wire_range(family.wheels, False), 9):
            for wheel, angle in zip(
                family.wheels, turn(family.wheels, -front, -rear, False)[0], strict=True
            ):
                if wheel.joint is not None:
                    low, high = model.joint(wheel.joint).range
                    assert low - 1e-9 <= wheel.sense * angle <= high + 1e-9


def test_literal_joints_keep_their_limits() -> None:
    """In literal mode no wheel goes beyond the limits of the file."""
    family = Ackerman(True, steering("Sedan").wheels)
    for limits in joint_ranges(family).values():
        assert limits == pytest.approx((-0.5236, 0.5236))


def test_absent_members_keep_their_values_in_ut2004() -> None:
    """`ut2004`: Speed alone, or without RearSteer, is obeyed; the rest stays (protocol 149)."""
    driver = Driver(SEDAN)
    assert driver.send(speed=5.0)
    assert driver.machine.wheels == pytest.approx([5.0] * 4)
    assert driver.send(front_steer=0.2)
    mean = np.mean(driver.machine.wheels)
    assert mean == pytest.approx(5.0, rel=0.02)
    assert all(0.18 < angle < 0.23 for angle in angles_of(driver).values())
    assert driver.send(speed=1.0)
    assert all(0.18 < angle < 0.23 for angle in angles_of(driver).values())
    assert np.mean(driver.machine.wheels) == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("missing", ["speed", "front_steer", "rear_steer"])
def test_udk_wants_all_three(missing: str) -> None:
    """`udk`: a command without one of the three changes nothing, nor does one with nonsense."""
    full = {"speed": 0.4, "front_steer": 0.1, "rear_steer": 0.0}
    driver = Driver(FRONT, UDK)
    assert not driver.send(**{**full, missing: None})
    assert not driver.send(**{**full, missing: math.nan})
    assert driver.send(**full)
    wheels = driver.machine.wheels
    assert wheels is not None
    assert not driver.send(**{**full, "speed": 0.1, missing: None})
    assert driver.machine.wheels is wheels


def test_the_percent_flag_sticks_in_udk_only() -> None:
    """Normalized holds for one command in `ut2004`, until it is sent again in `udk`
    (protocol 3.4)."""
    whole = {"front_steer": 0.0, "rear_steer": 0.0}
    driver = Driver(FRONT, UDK)
    driver.send(speed=50.0, normalized=True, **whole)
    assert driver.machine.wheels is not None
    assert driver.machine.wheels[0] == pytest.approx(0.28)
    driver.send(speed=25.0, **whole)
    assert driver.machine.wheels[0] == pytest.approx(0.14)
    driver.send(speed=0.3, normalized=False, **whole)
    assert driver.machine.wheels[0] == pytest.approx(0.3)
    driver = Driver(FRONT)
    driver.send(speed=50.0, normalized=True)
    driver.send(speed=0.2)
    assert driver.machine.wheels is not None
    assert driver.machine.wheels[0] == pytest.approx(0.2)


@pytest.mark.parametrize("dialect", Dialect)
def test_steering_is_never_a_percentage(dialect: Dialect) -> None:
    """Angles stay in radians whatever Normalized says (protocol reference 3.4.2)."""
    driver = Driver(SEDAN, dialect)
    driver.send(speed=10.0, front_steer=0.2, rear_steer=0.0, normalized=True)
    assert all(0.18 < angle < 0.23 for angle in angles_of(driver).values())


@pytest.mark.parametrize("dialect", Dialect)
@pytest.mark.parametrize("value", [1e9, math.inf, 1e308])
def test_values_beyond_the_range_are_the_limit(dialect: Dialect, value: float) -> None:
    """Speed and steering stop at their limits, in both directions (robots 41, protocol 149)."""
    for sign in (1.0, -1.0):
        driver = Driver(SEDAN, dialect)
        driver.send(speed=sign * value, front_steer=0.0, rear_steer=sign * value)
        assert driver.machine.wheels == pytest.approx([sign * 96.8] * 4)
        driver.send(speed=0.0, front_steer=sign * value, rear_steer=0.0)
        inner, outer = sorted(map(abs, angles_of(driver).values()))[::-1]
        assert outer < 0.5236 < inner
        limit = math.atan(2.0 / (1.0 / math.tan(inner) + 1.0 / math.tan(outer)))
        assert limit == pytest.approx(0.5236, abs=1e-6)


def test_rear_steer_turns_the_tail() -> None:
    """Positive RearSteer turns rear wheels to the right; a car without them ignores it."""
    driver = Driver(BASIC, UDK)
    assert driver.send(speed=1.0, front_steer=0.5, rear_steer=0.3)
    assert set(angles_of(driver)) == {"BRRearSteer", "BLRearSteer"}
    assert all(angle > 0.0 for angle in angles_of(driver).values())
    turned = dict(driver.machine.positions)
    driver.send(speed=1.0, front_steer=-0.5, rear_steer=0.3)
    assert driver.machine.positions == turned


def test_no_tread_is_faster_than_the_limit() -> None:
    """In a turn at full speed all wheels slow down together, so that the turn stays true."""
    driver = Driver(SEDAN)
    driver.send(speed=96.8, front_steer=0.5)
    wheels = driver.machine.wheels
    assert wheels is not None
    assert np.abs(wheels).max() == pytest.approx(96.8)
    slow = Driver(SEDAN)
    slow.send(speed=1.0, front_steer=0.5)
    assert slow.machine.wheels is not None
    assert wheels / wheels[0] == pytest.approx(slow.machine.wheels / slow.machine.wheels[0])


def test_a_turn_that_slows_a_car_says_so() -> None:
    """As every other limit does; within it nothing is said."""
    with overheard() as said:
        Driver(SEDAN).send(speed=50.0, front_steer=0.5)
        assert not said
        Driver(SEDAN).send(speed=96.8, front_steer=0.5)
    (line,) = said
    assert "Speed in this turn 96.8: clamped to " in str(line)


@pytest.mark.parametrize("dialect", Dialect)
def test_members_of_other_families_do_nothing(dialect: Dialect) -> None:
    """Left and Right, aerial and joint members and an empty DRIVE leave a car alone."""
    driver = Driver(SEDAN, dialect)
    assert not driver.send()
    assert not driver.send(left=1.0, right=1.0)
    assert not driver.send(linear_velocity=1.0, rotational_velocity=1.0, flip=True)
    assert not driver.send(light=True)
    assert driver.drive_controller.light


def test_stopping_leaves_the_steering() -> None:
    """A car without power rolls to a halt with its wheels where they are."""
    driver = Driver(SEDAN)
    driver.send(speed=5.0, front_steer=0.2)
    before = dict(driver.machine.positions)
    driver.drive_controller.stop()
    assert driver.machine.wheels == pytest.approx([0.0] * 4)
    assert driver.machine.positions == before


@settings(max_examples=150)
@given(st.lists(wild_drives, max_size=6), st.sampled_from(CARS), st.sampled_from(Dialect))
def test_no_command_leaves_the_limits(drives: list[Drive], name: str, dialect: Dialect) -> None:
    """Whatever is sent, treads and joints stay within what the car can do."""
    robot = ROBOTS[name]
    ranges = joint_ranges(steering(name))
    driver = Driver(robot, dialect)
    for drive in drives:
        driver.obey(drive)
        driver.status(dict.fromkeys(ranges, 0.1))
    wheels = driver.machine.wheels
    if wheels is not None:
        radii = np.array([wheel.radius for wheel in robot.driven_wheels])
        top = robot.drive.max_wheel_speed * steering(name).wheels[0].radius
        assert np.all(np.abs(wheels * radii) <= top * (1 + 1e-9))
    for joint, position in driver.machine.positions.items():
        low, high = ranges[joint]
        # Two steered axles may ask for angles between those that were tried.
        assert low - 0.01 <= position <= high + 0.01


def test_front_ackerman_announces_the_width_of_its_range() -> None:
    """FrontAckerman: MaxFrontSteer 1.0, MaxRearSteer 0; BasicAckermanRobot 0 and 1.6 (robots 9)."""
    for robot, front, rear in ((FRONT, "1.0000", "0.0000"), (BASIC, "0.0000", "1.6000")):
        line = robot.family.configuration(robot, UDK)
        assert "{SteeringType AckermanSteered}" in line
        assert f"{{MaxFrontSteer {front}}} {{MaxRearSteer {rear}}}" in line


def test_figures_of_the_udk_cars() -> None:
    """Masses, limits, places and ranges of both UDK classes (robots reference 1.4)."""
    assert FRONT.report.mass == pytest.approx(147.0)
    assert FRONT.report.max_speed == 0.56
    fork = next(one for one in BASIC.actuators if one.name == "ForkliftArm")
    arm = sum(link.mass for link in fork.links)
    assert BASIC.report.mass - arm == pytest.approx(16.0)
    assert (BASIC.report.track_width, BASIC.report.wheel_base) == (1.152, 0.6)
    assert [link.limits for link in fork.links] == [(-0.2, 0.2), (-0.3, 0.3)]
    assert {link.max_torque for link in fork.links} == {50.0}
    assert {link.damping for link in fork.links} == {5.0}
    assert {wheel.radius for wheel in BASIC.wheels} == {0.128}
    assert BASIC.drive.max_wheel_speed == 1.4
    places = {(round(wheel.x, 3), round(wheel.y, 3)) for wheel in steering("FrontAckerman").wheels}
    assert places == {(0.54, 0.204), (0.54, -0.204), (-0.416, 0.248), (-0.416, -0.248)}


def test_status_tells_the_commanded_angle_in_udk() -> None:
    """`udk` STA has what was last told, within the limits, before any wheel has moved
    (protocol 4.3)."""
    driver = Driver(FRONT, UDK)
    joints = {"FLFrontSteer": 0.0, "FRFrontSteer": 0.0}
    assert "{FrontSteer 0.0000} {RearSteer 0.0000}" in driver.status(joints)
    driver.send(speed=0.1, front_steer=0.25, rear_steer=0.4)
    line = driver.status(joints)
    assert "{FrontSteer 0.2500} {RearSteer 0.0000}" in line
    assert "FLFrontSteer" not in line


@pytest.mark.parametrize("angle", [-0.5, -0.2, 0.0, 0.1, 0.5])
def test_status_tells_the_measured_angle_in_ut2004(angle: float) -> None:
    """`ut2004` STA has the angle of an imagined wheel in the middle, from where both are
    (protocol 4.3)."""
    driver = Driver(SEDAN)
    driver.send(speed=1.0, front_steer=angle)
    line = driver.status(driver.machine.positions)
    found = float(line.split("{FrontSteer ")[1].split("}")[0])
    assert found == pytest.approx(angle, abs=2e-4)
    still = driver.status(dict.fromkeys(driver.machine.positions, 0.0))
    assert "{FrontSteer 0.0000} {RearSteer 0.0000}" in still


@pytest.mark.parametrize("angle", [0.3, 0.0, 1.5])
def test_status_survives_wheels_that_disagree(angle: float) -> None:
    """Wheels turned against each other, joint by joint, still give a number."""
    driver = Driver(SEDAN)
    line = driver.status({"LeftFrontSteer": angle, "RightFrontSteer": -angle})
    assert "{FrontSteer " in line
