"""Point clouds in both shapes (robots reference 2.3, protocol reference 4.6: PCL)."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import UDK, UT2004, Box, FakeRobot, Pole, Scene, make, numbers, read, wall_ahead

from usarsim_server.errors import RobotDescriptionError
from usarsim_server.sensors.ranges import point_texts, wire_points
from usarsim_server.sensors.report import conf_line, sen_lines

KINDS = ["RotatingPointCloudScanner", "ExampleSonarArray"]


def points(sensor) -> np.ndarray:
    """Points (n, 3) of the last reading."""
    ((text, value),) = sensor.data(UDK)
    assert value == ""
    return np.array([numbers(point) for point in re.split("[; ]", text)])


def at(time: float) -> FakeRobot:
    """A robot at a simulated time."""
    return FakeRobot(time=time)


def test_a_row_of_the_rotating_scanner_runs_from_left_to_right() -> None:
    """256 beams over 120 degrees; time 0.5 of a turn of one second is the level row."""
    sensor = make("RotatingPointCloudScanner")
    read(sensor, at(0.5), Scene(wall_ahead(3.0)))
    found = points(sensor)
    assert found.shape == (256, 3)
    assert np.allclose(found[:, 0], 3.0, atol=0.011)
    assert found[0, 1] == pytest.approx(-3.0 * math.tan(1.0471975), abs=0.02)
    assert found[-1, 1] == pytest.approx(3.0 * math.tan(1.0471975), abs=0.02)
    assert (np.diff(found[:, 1]) > 0.0).all()
    assert np.allclose(found[:, 2], 0.0)


@pytest.mark.parametrize(
    ("time", "pitch"), [(0.0, -0.3927), (0.25, -0.19635), (0.5, 0.0), (7.75, 0.19635)]
)
def test_the_row_rises_with_time(time: float, pitch: float) -> None:
    """From -FOV/2 to +FOV/2 of wire pitch in one second, then from the bottom again."""
    sensor = make("RotatingPointCloudScanner")
    (fan,) = sensor.rays(at(time))
    assert np.allclose(np.arcsin(fan.directions[:, 2]), pitch, atol=1e-4)


def test_a_turn_ends_where_the_next_begins() -> None:
    """Clocks that fall short of a full second by rounding belong to the new turn."""
    sensor = make("RotatingPointCloudScanner")
    ways = [sensor.rays(at(time))[0].directions for time in (3.0, 3.0 - 1e-12, 2.999)]
    assert np.allclose(ways[0], ways[1], atol=1e-6)
    assert ways[2][0, 2] > 0.3


def test_the_period_of_a_turn_can_be_set() -> None:
    """Half a turn of 4 s lasts 2 s."""
    (fan,) = make("PCL", spin_period=4.0).rays(at(2.0))
    assert np.allclose(fan.directions[:, 2], 0.0)


def test_the_grid_has_30_by_30_parallel_rays() -> None:
    """Spacing 5 cm, columns from left to right, each from bottom to top."""
    sensor = make("ExampleSonarArray")
    read(sensor, scene=Scene(wall_ahead(2.0)))
    found = points(sensor)
    assert found.shape == (900, 3)
    assert np.allclose(found[:, 0], 2.0)
    assert found[0] == pytest.approx([2.0, -0.725, 0.725])
    assert found[1] == pytest.approx([2.0, -0.725, 0.675])
    assert found[30] == pytest.approx([2.0, -0.675, 0.725])
    assert found[-1] == pytest.approx([2.0, 0.725, -0.725])


def test_the_grid_sees_the_shape_of_things() -> None:
    """A box of 20 cm in front of the lower right quarter gives 4 x 4 nearer points there."""
    sensor = make("ExampleSonarArray")
    box = Box((1.0, -0.5, -0.5), (1.2, -0.3, -0.3))
    read(sensor, scene=Scene(box, wall_ahead(2.0)))
    near = points(sensor)[points(sensor)[:, 0] < 1.5]
    assert len(near) == 16
    assert (near[:, 1:] > 0.3).all()
    assert (near[:, 1:] < 0.5).all()


@pytest.mark.parametrize("kind", KINDS)
def test_points_are_in_the_frame_of_the_sensor(kind: str) -> None:
    """Wherever the robot stands: one pole, seen 1 m ahead, is at x = 1."""
    sensor, robot = make(kind, location=(0.0, 0.0, -0.3)), at(0.5)
    robot.place((4.0, 5.0, 0.0), (0.0, 0.0, math.pi / 2))
    read(sensor, robot, Scene(Pole(4.0, -6.1, 0.1)))
    found = points(sensor)
    nearest = found[np.argmin(found[:, 0] ** 2 + found[:, 1] ** 2)]
    assert nearest[:2] == pytest.approx([1.0, 0.0], abs=0.05)


@pytest.mark.parametrize(("kind", "count"), [(KINDS[0], 256), (KINDS[1], 900)])
def test_without_echo_points_are_at_the_maximum_range(kind: str, count: int) -> None:
    """40 m, as the sonars that the original built them of; the count stays."""
    sensor = make(kind)
    read(sensor, at(0.5))
    found = points(sensor)
    assert len(found) == count
    way = found[:, 0] if kind == KINDS[1] else np.linalg.norm(found, axis=1)
    assert np.allclose(way, 40.0, atol=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_echoes_are_clamped_to_the_minimum_range(kind: str) -> None:
    """0.1 m (robots reference 2.2)."""
    sensor = make(kind)
    read(sensor, at(0.5), Scene(wall_ahead(0.03)))
    assert points(sensor)[len(points(sensor)) // 2, 0] == pytest.approx(0.1, abs=0.01)


def test_sen_of_the_rotating_scanner() -> None:
    """The template of 4.6: points joined by semicolons, two digits, no key."""
    sensor = make("RotatingPointCloudScanner", "Spin1", beams=2, fov=0.02)
    robot = at(5.5)
    read(sensor, robot, Scene(wall_ahead(1.9)))
    for dialect in (UT2004, UDK):
        assert sen_lines([sensor], 5.0, dialect) == [
            "SEN {Time 5.0000} {Type PCL} {Name Spin1} {1.90,-0.01,0.00;1.90,0.01,0.00}"
        ]


def test_sen_of_the_array() -> None:
    """The template of 4.6 with one blank between segments: points joined by blanks, four digits."""
    sensor = make("ExampleSonarArray", "Array1", grid=2, spacing=0.1)
    read(sensor, scene=Scene(wall_ahead(1.9)))
    for dialect in (UT2004, UDK):
        assert sen_lines([sensor], 5.0, dialect) == [
            "SEN {Time 5.0000} {Type PCL} {Name Array1} {1.9000,-0.0500,0.0500 "
            "1.9000,-0.0500,-0.0500 1.9000,0.0500,0.0500 1.9000,0.0500,-0.0500}"
        ]


def test_conf_has_the_name_only() -> None:
    """Protocol reference 4.8, all others; both shapes answer to PCL in one line."""
    pair = [make(kind, f"P{n}") for n, kind in enumerate(KINDS)]
    assert conf_line(pair, "pcl", None, UDK) == "CONF {Type PCL} {Name P0} {Name P1}"
    assert {sensor.interval(dialect) for sensor in pair for dialect in (UT2004, UDK)} == {0.2}


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 3), max_size=20), st.integers(0, 4))
def test_point_texts_are_the_numbers_of_each_point(rows, digits: int) -> None:
    """Every point is a vector of its own; nothing is lost or mixed up."""
    texts = point_texts(np.array(rows).reshape(-1, 3), digits)
    assert len(texts) == len(rows)
    for text, row in zip(texts, rows, strict=True):
        assert np.allclose(numbers(text), row, atol=10.0**-digits)


def test_wire_points_look_right_and_down() -> None:
    """x forward, y right, z down."""
    assert wire_points(np.array([[1.0, 2.0, 3.0]])).tolist() == [[1.0, -2.0, -3.0]]


@pytest.mark.parametrize(
    ("kind", "options", "key"),
    [
        ("PCL", {"beams": 1}, "beams"),
        ("PCL", {"spin_period": 0.0}, "spin_period"),
        ("ExampleSonarArray", {"grid": 1000}, "grid"),
        ("ExampleSonarArray", {"spacing": -1.0}, "spacing"),
        ("ExampleSonarArray", {"beams": 3}, "beams"),
    ],
)
def test_impossible_clouds_are_refused(kind: str, options: dict[str, object], key: str) -> None:
    """The message names the key."""
    with pytest.raises(RobotDescriptionError, match=f"{key}: "):
        make(kind, **options)
