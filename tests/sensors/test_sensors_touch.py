"""Touch pads (robots reference 2.8, checklist 103; protocol checklist 99, 118)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from sensor_fakes import UDK, UT2004, Box, FakeRobot, Scene, make, read, text_of, wall_ahead

from usarsim_server.sensors.report import sen_lines

PAD = {"location": (0.3, 0.0, 0.0)}


def touched(scene: Scene, robot: FakeRobot | None = None, **options: object) -> bool:
    sensor = make("Touch", "FrontBumper", **{**PAD, **options})
    assert read(sensor, robot, scene)
    return bool(sensor.touched)


@pytest.mark.parametrize(
    ("gap", "expected"), [(0.001, True), (0.0029, True), (0.0031, False), (0.006, False)]
)
def test_an_object_counts_within_three_millimetres(gap: float, expected: bool) -> None:
    """Checklist 103: True at 1 mm, False at 6 mm."""
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
