"""Line lasers (robots reference 2.3, protocol reference 4.6: LineLaser)."""

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
    Scene,
    make,
    numbers,
    read,
    text_of,
    values,
    wall_ahead,
)

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.sensors.report import conf_line, sen_lines


def points(sensor) -> np.ndarray:
    """Points (n, 3) of the last reading, wire frame."""
    text = values(sensor)["Points"]
    assert text.startswith("[")
    assert text.endswith("]")
    return np.array([numbers(point) for point in text[1:-1].split("][")])


def test_120_points_from_left_to_right() -> None:
    """-FOV/2 first, +FOV/2 last, both included: 90 degrees."""
    sensor = make("LineLaser")
    read(sensor, scene=Scene(wall_ahead(2.0)))
    found = points(sensor)
    assert found.shape == (120, 3)
    assert found[0] == pytest.approx([2.0, -2.0, 0.0], abs=0.002)
    assert found[-1] == pytest.approx([2.0, 2.0, 0.0], abs=0.002)
    assert (np.diff(found[:, 1]) > 0.0).all()
    assert np.allclose(found[:, 0], 2.0, atol=0.002)


@given(
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    st.floats(-0.3, 0.3),
    st.floats(-0.3, 0.3),
)
def test_points_are_in_the_world_frame(place, pitch: float, yaw: float) -> None:
    """Wherever robot and mount stand and look, points on a wall have the wall's x."""
    sensor, robot = make("LineLaser", location=(0.2, 0.1, -0.3), rotation=(0.1, 0.0, 0.2)), None
    robot = FakeRobot()
    robot.place(place, (0.0, pitch, yaw))
    read(sensor, robot, Scene(wall_ahead(2.0)))
    found = points(sensor)
    hit = np.linalg.norm(found - np.array(numbers(values(sensor)["Location"])), axis=1) < 4.99
    assert hit.sum() > 60
    assert np.allclose(found[hit, 0], 2.0, atol=0.002)


def test_a_miss_gives_the_point_at_the_maximum_range() -> None:
    """The number of points does not depend on what is there."""
    sensor = make("LineLaser")
    read(sensor, scene=Scene(Box((2.0, 0.0, -1.0), (3.0, 5.0, 1.0))))
    away = np.linalg.norm(points(sensor), axis=1)
    assert len(away) == 120
    assert (away[:59] < 3.0).all()
    assert np.allclose(away[61:], 5.0, atol=0.003)


def test_sen_has_no_time_in_either_dialect() -> None:
    """The template of protocol 4.6: true pose with four digits, points with three."""
    sensor = make("LineLaser", "Line1", location=(0.2, 0.0, -0.3), beams=2, fov=math.pi / 2)
    read(sensor, scene=Scene(wall_ahead(2.1)))
    for dialect in (UT2004, UDK):
        assert sen_lines([sensor], 5.0, dialect) == [
            "SEN {Type LineLaser} {Name Line1} {Location 0.2000,0.0000,-0.3000} "
            "{Orientation 0.0000,0.0000,0.0000} {Points [2.100,-1.900,-0.300][2.100,1.900,-0.300]}"
        ]


def test_conf() -> None:
    """Limits, FOV in rad, number of beams (protocol reference 4.8)."""
    sensor = make("LineLaser", "Line1")
    assert conf_line([sensor], "LineLaser", None, UDK) == (
        "CONF {Type LineLaser} {Name Line1} {MaxRange 5.0000} {MinRange 0.1000} {FOV 1.5707} "
        "{Resolution 120}"
    )
    assert "{Resolution 120}" in text_of(sensor.configuration(UT2004))


def moved(sensor) -> list[str]:
    """Texts of the readings at two places, and at the second place once more."""
    robot, texts = FakeRobot(), []
    for x in (0.0, 1.0, 1.0):
        robot.place((x, 0.0, 0.0))
        assert read(sensor, robot, Scene(wall_ahead(3.0)))
        texts.append(text_of(sensor.data(UDK)))
    return texts


def test_it_measures_every_time() -> None:
    """The points and the pose follow the robot."""
    first, second, third = moved(make("LineLaser"))
    assert first != second == third


def test_the_literal_sensor_repeats_its_first_text_for_ever() -> None:
    """As UDK did (protocol reference 4.6); it casts no rays after that."""
    sensor = make("LineLaser", literal=True)
    first, second, third = moved(sensor)
    assert first == second == third
    assert first.startswith("{Location 0.0000,")
    assert not sensor.rays(FakeRobot())


def test_intervals_are_those_of_the_class() -> None:
    """0.1 s in udk (appendix C), 0.2 s in ut2004."""
    sensor = make("LineLaser")
    assert (sensor.interval(UT2004), sensor.interval(UDK)) == (0.2, 0.1)


@pytest.mark.parametrize(
    ("options", "key"),
    [({"beams": 1}, "beams"), ({"beams": 119.5}, "beams"), ({"fov": 90}, "fov")],
)
def test_impossible_lasers_are_refused(options: dict[str, object], key: str) -> None:
    """The message names the key."""
    with pytest.raises(RobotDescriptionError, match=f"{key}: "):
        make("LineLaser", **options)
