"""Touch pads and bumpers (robots reference 2.8, 103, 104; protocol 99, 118)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import (
    UDK,
    UT2004,
    Box,
    FakeRobot,
    Pole,
    Scene,
    describe_robot,
    make,
    read,
    text_of,
    wall_ahead,
)

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.sensors.report import conf_line, geo_line, sen_lines
from usarsim_server.simulation.frames import flip_point

PAD = {"location": (0.3, 0.0, 0.0)}


def touched(scene: Scene, robot: FakeRobot | None = None, **options: object) -> bool:
    sensor = make("Touch", "FrontBumper", **{**PAD, **options})
    assert read(sensor, robot, scene)
    return bool(sensor.touched)


@pytest.mark.parametrize(
    ("gap", "expected"), [(0.001, True), (0.0029, True), (0.0031, False), (0.006, False)]
)
def test_an_object_counts_within_three_millimetres(gap: float, expected: bool) -> None:
    """Robots 103: True at 1 mm, False at 6 mm."""
    assert touched(Scene(wall_ahead(0.3 + gap))) is expected


@pytest.mark.parametrize("depth", [0.0, 0.0005, 0.005])
def test_an_object_pressed_into_the_pad_counts(depth: float) -> None:
    """Contacts of the physics give way a little; the pad must not fall silent by that."""
    assert touched(Scene(wall_ahead(0.3 - depth)))


def test_nothing_there() -> None:
    """In the open, and with an object behind the robot, it is False."""
    assert not touched(Scene())
    assert not touched(Scene(Box((-2.0, -1.0, -1.0), (-0.5, 1.0, 1.0))))


@pytest.mark.parametrize("y", [-0.005, 0.0, 0.005])
def test_the_rim_of_the_disc_feels_too(y: float) -> None:
    """A thin pin in front of centre or rim is felt."""
    assert touched(Scene(Box((0.301, y - 0.0005, -0.1), (0.4, y + 0.0005, 0.1))))


def test_beside_the_disc_nothing_is_felt() -> None:
    """The pad is 1 cm wide, no more."""
    assert not touched(Scene(Box((0.301, 0.006, -0.1), (0.4, 0.5, 0.1))))


@pytest.mark.parametrize(("diameter", "probes"), [(0.01, 7), (0.02, 13), (0.1, 61)])
def test_larger_discs_have_more_probes(diameter: float, probes: int) -> None:
    """Rings of six points half a centimetre apart, all rays parallel and short."""
    sensor = make("Touch", diameter=diameter)
    (fan,) = sensor.rays(FakeRobot())
    assert fan.origin.shape == fan.directions.shape == (probes, 3)
    assert np.allclose(fan.directions, [[1.0, 0.0, 0.0]])
    assert np.hypot(fan.origin[:, 1], fan.origin[:, 2]).max() == pytest.approx(diameter / 2)
    assert fan.max_range < 0.02


def test_the_pad_turns_with_robot_and_mount() -> None:
    """A pad on the right side of a robot that looks left feels the wall ahead."""
    robot = FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, -math.pi / 2))
    side = {"location": (0.0, 0.2, 0.0), "rotation": (0.0, 0.0, math.pi / 2)}
    assert touched(Scene(wall_ahead(0.201)), robot, **side)
    assert not touched(Scene(wall_ahead(0.206)), robot, **side)


def test_sen_of_both_dialects() -> None:
    """One batched line without Time, or one line each with Time; True and False."""
    front = make("Touch", "FrontBumper", location=(0.3, 0.0, 0.0))
    rear = make("Touch", "RearBumper", location=(-0.3, 0.0, 0.0), rotation=(0.0, 0.0, math.pi))
    scene = Scene(Box((-0.5, -1, -1), (-0.301, 1, 1)))
    for sensor in (front, rear):
        read(sensor, scene=scene)
    assert sen_lines([front, rear], 63.4021, UT2004) == [
        "SEN {Type Touch} {Name FrontBumper Touch False} {Name RearBumper Touch True}"
    ]
    assert sen_lines([front, rear], 63.4021, UDK) == [
        "SEN {Time 63.4021} {Type Touch} {Name FrontBumper} {Touch False}",
        "SEN {Time 63.4021} {Type Touch} {Name RearBumper} {Touch True}",
    ]


def test_conf() -> None:
    """Diameter, in both dialects."""
    for dialect in (UT2004, UDK):
        assert text_of(make("Touch").configuration(dialect)) == "{Diameter 0.0100}"


RADIUS = 0.17


def array_touched(scene: Scene, robot: FakeRobot | None = None, **options: object) -> bool:
    sensor = make("BumperArray", "Bumper", **options)
    assert read(sensor, robot, scene)
    return bool(sensor.touched)


def pole_at(yaw: float, gap: float, radius: float = 0.02) -> Scene:
    """A thin pole that leaves a gap to the arc in a direction of wire yaw."""
    reach = RADIUS + gap + radius
    return Scene(Pole(reach * math.cos(yaw), -reach * math.sin(yaw), radius))


@given(st.floats(-1.57, 1.57))
def test_an_object_in_front_of_the_arc_is_felt_anywhere(yaw: float) -> None:
    """Robots 104: a pole of 4 cm at 1 cm, wherever on pi rad."""
    assert array_touched(pole_at(yaw, 0.01))


@pytest.mark.parametrize("yaw", [-1.57, -0.7, 0.0, 0.7, 1.57])
@pytest.mark.parametrize(("gap", "expected"), [(-0.005, True), (0.018, True), (0.023, False)])
def test_probes_are_two_centimetres_long(yaw: float, gap: float, expected: bool) -> None:
    """Robots reference 2.8; contacts that give way a little still count."""
    assert array_touched(pole_at(yaw, gap, radius=0.1)) is expected


@pytest.mark.parametrize("yaw", [1.8, 2.5, math.pi, -2.5, -1.8])
def test_behind_the_arc_nothing_is_felt(yaw: float) -> None:
    """The arc covers the front half only."""
    assert not array_touched(pole_at(yaw, 0.005))


def test_nothing_inside_the_arc_is_felt() -> None:
    """Probes look outward; what is well within the bumper is the robot's own affair."""
    assert not array_touched(Scene(Pole(0.05, 0.0, 0.04)))


def test_twenty_pads_of_seven_probes_look_outward() -> None:
    """20 discs on an arc of radius 0.17 m, each a centre and a ring of six, from right to left."""
    (fan,) = make("TouchArray").rays(FakeRobot())
    assert fan.directions.shape == fan.origin.shape == (140, 3)
    centres, ways = fan.origin[::7], fan.directions[::7]
    assert np.allclose(np.cross(centres, ways), 0.0)
    assert np.allclose(np.linalg.norm(centres, axis=1), RADIUS - 0.01)
    yaws = np.arctan2(-ways[:, 1], ways[:, 0])
    assert np.allclose(yaws, np.linspace(1.57, -1.57, 20))
    rim = np.linalg.norm(fan.origin[1::7] - centres, axis=1)
    assert np.allclose(rim, 0.005)


def test_the_arc_turns_with_robot_mount_and_its_own_rotation() -> None:
    """A bumper at the back of a robot that looks right touches a wall on the robot's left."""
    robot = FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2))
    back = {"location": (-0.1, 0.0, 0.0), "rotation": (0.0, 0.0, math.pi)}
    behind = Scene(Box((-5.0, 0.28, -5.0), (5.0, 6.0, 5.0)))
    assert array_touched(behind, robot, **back)
    assert array_touched(behind, robot, location=(-0.1, 0.0, 0.0), arc_yaw=math.pi)
    assert not array_touched(behind, robot, location=(-0.1, 0.0, 0.0))


def test_pitch_and_roll_tilt_the_arc_as_wire_rotations_do() -> None:
    """Positive pitch lifts the front; positive roll lowers the right-hand end."""
    (lifted,) = make("TouchArray", arc_pitch=math.pi / 2).rays(FakeRobot())
    middle = lifted.directions[len(lifted.directions) // 2]
    assert flip_point(tuple(middle))[2] == pytest.approx(-1.0, abs=0.01)
    (rolled,) = make("TouchArray", arc_roll=0.3).rays(FakeRobot())
    assert flip_point(tuple(rolled.origin[0]))[2] > 0.04


def test_sen_of_both_dialects_array() -> None:
    """One line per bumper; like all touch sensors without Time in ut2004."""
    sensor = make("TouchArray", "Bumper")
    read(sensor, scene=Scene(wall_ahead(0.18)))
    assert sen_lines([sensor], 63.4021, UDK) == [
        "SEN {Time 63.4021} {Type TouchArray} {Name Bumper} {Touch True}"
    ]
    read(sensor)
    assert sen_lines([sensor], 63.4021, UT2004) == [
        "SEN {Type TouchArray} {Name Bumper} {Touch False}"
    ]


def test_conf_and_geo() -> None:
    """Protocol reference 4.8: the arc's rotation is one multi-pair segment."""
    sensor = make("BumperArray", "Bumper", location=(0.1, 0.0, 0.05), arc_pitch=0.1, arc_yaw=-0.2)
    assert conf_line([sensor], "toucharray", None, UDK) == (
        "CONF {Type TouchArray} {Name Bumper} {Diameter 0.0100} "
        "{ArcRotation Pitch 0.1000 Roll 0.0000 Yaw -0.2000} {ArcRadius 0.1700} {ArcAngle 3.1400}"
    )
    assert text_of(sensor.configuration(UT2004)) == text_of(sensor.configuration(UDK))
    assert geo_line([sensor], "TouchArray", None, describe_robot(), UDK) == (
        "GEO {Type TouchArray} {Name Bumper} {Location 0.10,0.00,0.05} "
        "{Orientation 0.00,0.00,0.00} {Mount P3AT}"
    )


@pytest.mark.parametrize(
    ("options", "key"),
    [({"arc_radius": 0.0}, "arc_radius"), ({"arc_angle": 180}, "arc_angle"), ({"pads": 3}, "pads")],
)
def test_impossible_bumpers_are_refused(options: dict[str, object], key: str) -> None:
    """The message names the key."""
    with pytest.raises(RobotDescriptionError, match=f"{key}: "):
        make("TouchArray", **options)
