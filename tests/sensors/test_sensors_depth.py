"""Depth images and point clouds in both shapes (robots reference 2.3, robots 78; protocol
120; protocol reference 4.6: RangeImager, PCL).
"""

from __future__ import annotations

import math
import re

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
    make,
    numbers,
    read,
    text_of,
    values,
    wall_ahead,
)

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.ranges import point_texts, wire_points
from usarsim_server.sensors.report import conf_line, sen_lines

TINY = {"width": 4, "height": 6, "frames": 3}


def scan(sensor, scene: Scene, dialect=UDK) -> list[dict[str, str]]:
    """One whole image, frame by frame."""
    assert sensor.set("SCAN", "", FakeRobot()) is SetResult.OK
    frames = []
    for _ in range(sensor.frames):
        assert read(sensor, scene=scene)
        frames.append(values(sensor, dialect))
    return frames


def image(frames: list[dict[str, str]], width: int) -> np.ndarray:
    """Rows of an image from its frames."""
    text = ",".join(frame["Range"].removesuffix(",") for frame in frames)
    return np.array(numbers(text)).reshape(-1, width)


def test_it_is_idle_until_it_is_asked() -> None:
    """Protocol 120, the template of protocol 4.6; no ray is cast meanwhile."""
    sensor = make("KinectDepth", "KinectDepth")
    scene = Scene()
    for _ in range(3):
        assert read(sensor, scene=scene)
    assert not scene.asked
    assert sen_lines([sensor], 70.0, UDK) == [
        "SEN {Time 70.0000} {Type RangeImager} {Name KinectDepth} {Resolution 320,240} "
        "{FOV 1.0122,0.7853} {Frames 0} {Frame 0}"
    ]


@pytest.mark.parametrize("dialect", [UT2004, UDK])
def test_a_scan_gives_twenty_frames_and_ends(dialect) -> None:
    """Protocol 120: Frame 0..19, 12 rows of 320 pixels each, then idle again."""
    sensor = make("KinectDepth")
    frames = scan(sensor, Scene(wall_ahead(2.0)), dialect)
    assert [frame["Frame"] for frame in frames] == [str(i) for i in range(20)]
    assert {frame["Frames"] for frame in frames} == {"20"}
    for frame in frames:
        assert len(numbers(frame["Range"].removesuffix(","))) == 12 * 320
    for _ in range(2):
        read(sensor)
        idle = values(sensor, dialect)
        assert (idle["Frames"], idle["Frame"]) == ("0", "0")
        assert "Range" not in idle


def test_each_frame_casts_its_own_rows_only() -> None:
    """3840 rays per report, together the whole image without overlap."""
    sensor, scene = make("KinectDepth"), Scene()
    scan(sensor, scene)
    assert [len(fan.directions) for fan in scene.asked] == [12 * 320] * 20
    pitch = np.concatenate([np.arcsin(fan.directions[::320, 2]) for fan in scene.asked])
    assert len(np.unique(pitch.round(9))) == 240
    assert (np.diff(pitch) < 0.0).all()


def test_a_wall_square_to_the_axis_has_constant_depth() -> None:
    """Robots 78: a wall at 3 m gives 3.00 in every pixel, not the way along the ray."""
    sensor = make("KinectDepth")
    assert set(image(scan(sensor, Scene(wall_ahead(3.0))), 320).ravel()) == {3.0}


@given(st.floats(0.3, 12.0), st.floats(-0.4, 0.4))
def test_depth_is_the_way_along_the_axis(distance: float, lean: float) -> None:
    """A wall that leans sideways gives depths that change across the image as a plane does."""
    sensor, robot = make("RangeImager", **TINY, fov=0.8), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, lean))
    sensor.set("SCAN", "", robot)
    read(sensor, robot, Scene(wall_ahead(distance)))
    depths = np.array(numbers(values(sensor)["Range"].removesuffix(","))).reshape(2, 4)
    yaw = 0.8 * (np.arange(4) / 4 - 0.5)
    expected = distance * np.cos(yaw) / np.cos(yaw + lean)
    # Rows differ in pitch only, which a vertical wall does not show in the depth.
    assert np.allclose(depths, expected, atol=0.0101)


def test_rows_run_from_top_to_bottom_and_from_left_to_right() -> None:
    """A pole on the left is in the first half of each row, a bar above in the first rows."""
    sensor = make("KinectDepth")
    left = image(scan(sensor, Scene(Pole(2.0, 0.5, 0.1), wall_ahead(5.0))), 320)
    assert left[:, :160].min() < 2.0
    assert left[:, 160:].min() == 5.0
    above = image(scan(sensor, Scene(Box((2.0, -5, 0.2), (2.1, 5, 0.3)), wall_ahead(5.0))), 320)
    assert above[:120].min() == 2.0
    assert above[120:].min() == 5.0


def test_the_field_of_view_is_that_of_the_original() -> None:
    """Rays from -FOV/2 in steps of FOV/320, rows from +FOV/2 in steps of FOV/240."""
    sensor, scene = make("KinectDepth"), Scene()
    scan(sensor, scene)
    first, last = scene.asked[0].directions, scene.asked[-1].directions
    yaw = np.arctan2(-first[:320, 1], first[:320, 0])
    assert np.allclose(yaw, -0.50613 + 1.01226 / 320 * np.arange(320))
    assert np.arcsin(first[0, 2]) == pytest.approx(0.3927)
    assert np.arcsin(last[-1, 2]) == pytest.approx(-0.3927 + 0.7854 / 240)


def test_what_is_too_far_prints_the_maximum_range() -> None:
    """A pixel without hit is 20.00, also at the edge of the image."""
    sensor = make("KinectDepth")
    assert set(image(scan(sensor, Scene()), 320).ravel()) == {20.0}
    assert set(image(scan(sensor, Scene(wall_ahead(19.99))), 320).ravel()) == {19.99, 20.0}


def test_sen_of_udk() -> None:
    """The template of protocol 4.6: size, angles, frame numbers, padded depths, a comma at the
    end."""
    sensor = make("KinectDepth", "KinectDepth", **TINY)
    sensor.set("SCAN", "", FakeRobot())
    read(sensor, scene=Scene(wall_ahead(3.05)))
    assert sen_lines([sensor], 71.2, UDK) == [
        "SEN {Time 71.2000} {Type RangeImager} {Name KinectDepth} {Resolution 4,6} "
        "{FOV 1.0122,0.7853} {Frames 3} {Frame 0} "
        "{Range 3.05,3.05,3.05,3.05,3.05,3.05,3.05,3.05,}"
    ]


def test_sen_of_ut2004() -> None:
    """The form that MOAST quotes: one resolution and one field of view in rad, no comma."""
    sensor = make("RangeImager", "Scanner1", **TINY)
    sensor.set("SCAN", "", FakeRobot())
    read(sensor)
    read(sensor, scene=Scene(wall_ahead(11.305)))
    assert sen_lines([sensor], 5608.85, UT2004) == [
        "SEN {Time 5608.85} {Type RangeImager} {Name Scanner1} {Frames 3} {Frame 1} "
        "{Resolution 0.2530} {FOV 1.0122} "
        "{Range 11.30,11.30,11.30,11.30,11.30,11.30,11.30,11.30}"
    ]


def test_conf_of_both_dialects() -> None:
    """Protocol reference 4.8: pairs in udk, as a RangeScanner in ut2004."""
    sensor = make("KinectDepth", "K")
    assert conf_line([sensor], "RangeImager", "K", UDK) == (
        "CONF {Type RangeImager} {Name K} {MaxRange 20.0000} {MinRange 0.1000} "
        "{Resolution 320,240} {Fov 1.0122,0.7853}"
    )
    assert text_of(sensor.configuration(UT2004)) == (
        "{MaxRange 20.0000} {MinRange 0.1000} {Resolution 0.0031} {Fov 1.0122} "
        "{Paning True} {Tilting False}"
    )


def test_a_scan_during_an_image_changes_nothing() -> None:
    """The image goes on and still has all its frames, once."""
    sensor = make("RangeImager", **TINY)
    seen = []
    for step in range(6):
        if step < 2:
            assert sensor.set("SCAN", "", FakeRobot()) is SetResult.OK
        read(sensor)
        seen.append((values(sensor)["Frames"], values(sensor)["Frame"]))
    assert seen == [("3", "0"), ("3", "1"), ("3", "2"), ("0", "0"), ("0", "0"), ("0", "0")]


def test_a_second_image_begins_with_its_first_frame() -> None:
    """Asked for after the last frame of the one before."""
    sensor = make("RangeImager", **TINY)
    for _ in range(2):
        frames = scan(sensor, Scene(wall_ahead(2.0)))
        assert [frame["Frame"] for frame in frames] == ["0", "1", "2"]


def test_with_an_interval_of_zero_each_scan_sends_one_frame() -> None:
    """Protocol 121: nothing is periodic, so a report has to be asked for."""
    sensor = make("RangeImager", **TINY, interval=0.0)
    seen = []
    for _ in range(4):
        assert sensor.set("SCAN", "", FakeRobot()) is SetResult.SCAN
        read(sensor)
        seen.append(values(sensor)["Frame"])
    assert seen == ["0", "1", "2", "0"]


def test_noise_blurs_hits_only() -> None:
    """A standard deviation of 2 cm on a wall, none on the sky."""
    sensor = make("KinectDepth", noise=0.02)
    depths = image(scan(sensor, Scene(Box((3.0, -9, -9), (4.0, 9, 0.0)))), 320)
    assert set(depths[:119].ravel()) == {20.0}
    assert depths[121:].std() == pytest.approx(0.02, rel=0.1)
    assert depths[121:].mean() == pytest.approx(3.0 - 0.005, abs=0.002)


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"height": 240, "frames": 7}, "frames"),
        ({"width": 0}, "width"),
        ({"height": 5000}, "height"),
        ({"fov": 60}, "fov"),
        ({"resolution": 0.1}, "resolution"),
    ],
)
def test_impossible_images_are_refused(options: dict[str, object], key: str) -> None:
    """Frames that do not divide the rows, absurd sizes, degrees, keys of other sensors."""
    with pytest.raises(RobotDescriptionError, match=f"{key}: "):
        make("RangeImager", **options)


def test_other_opcodes_are_unknown() -> None:
    """And start nothing."""
    sensor, scene = make("RangeImager"), Scene()
    assert sensor.set("RESET", "", FakeRobot()) is SetResult.UNKNOWN
    read(sensor, scene=scene)
    assert not scene.asked
    assert math.isclose(sensor.interval(UDK), 0.1)


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
    """The template of protocol 4.6: points joined by semicolons, two digits, no key."""
    sensor = make("RotatingPointCloudScanner", "Spin1", beams=2, fov=0.02)
    robot = at(5.5)
    read(sensor, robot, Scene(wall_ahead(1.9)))
    for dialect in (UT2004, UDK):
        assert sen_lines([sensor], 5.0, dialect) == [
            "SEN {Time 5.0000} {Type PCL} {Name Spin1} {1.90,-0.01,0.00;1.90,0.01,0.00}"
        ]


def test_sen_of_the_array() -> None:
    """The template of protocol 4.6 with one blank between segments: points joined by blanks, four
    digits."""
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
