"""Infrared and plain range finders (robots reference 2.2, checklist 77)."""

from __future__ import annotations

import pytest
from sensor_fakes import UDK, UT2004, FakeRobot, Pole, Scene, make, read, text_of, wall_ahead

GLASS = wall_ahead(0.5, glass=True)


@pytest.mark.parametrize(
    ("distance", "expected"), [(1.0, "1.0000"), (0.05, "0.2000"), (2.0, "1.5000")]
)
def test_infrared_keeps_to_both_limits(distance: float, expected: str) -> None:
    """0.2 to 1.5 m, whatever stands there."""
    sensor = make("IR")
    assert read(sensor, scene=Scene(wall_ahead(distance)))
    assert sensor.data(UDK) == (("Range", expected),)


@pytest.mark.parametrize(
    ("distance", "expected"), [(1.0, "1.0000"), (0.05, "0.0500"), (4.0, "3.0000")]
)
def test_the_range_sensor_does_not_apply_its_minimum(distance: float, expected: str) -> None:
    """MinRange 0.1 is only announced, a miss reads MaxRange 3."""
    sensor = make("RangeSensor")
    assert read(sensor, scene=Scene(wall_ahead(distance)))
    assert sensor.data(UDK) == (("Range", expected),)


def test_infrared_looks_through_glass() -> None:
    """Checklist 77: it reads the wall behind, where the range sensor sees the pane."""
    scene = Scene(GLASS, wall_ahead(1.2))
    infrared, plain = make("IR"), make("RangeSensor")
    read(infrared, scene=scene)
    read(plain, scene=scene)
    assert infrared.data(UDK) == (("Range", "1.2000"),)
    assert plain.data(UDK) == (("Range", "0.5000"),)


def test_one_ray_only() -> None:
    """A pole just beside the axis is not seen."""
    sensor = make("IR")
    (fan,) = sensor.rays(FakeRobot())
    assert fan.directions.shape == (1, 3)
    read(sensor, scene=Scene(Pole(1.0, 0.3, 0.2)))
    assert sensor.data(UDK) == (("Range", "1.5000"),)


def test_a_sensor_on_a_link_moves_with_the_link() -> None:
    """The ray starts at the link's pose, not at the chassis."""
    robot = FakeRobot()
    robot.place((2.0, 0.0, 0.0))
    robot.links["tilt"] = robot.pose
    sensor = make("RangeSensor", link="Tilt", location=(0.1, 0.0, 0.0))
    read(sensor, robot, Scene(wall_ahead(3.0)))
    assert sensor.range == pytest.approx(0.9)


def test_a_noisy_miss_stays_a_miss() -> None:
    """Noise belongs to echoes; no echo is exactly MaxRange."""
    sensor = make("RangeSensor", noise=0.5)
    for _ in range(50):
        read(sensor, scene=Scene())
        assert sensor.range == 3.0


def test_noise_never_leaves_the_range() -> None:
    """A noisy distance is neither negative nor beyond MaxRange."""
    sensor = make("RangeSensor", noise=2.0)
    readings = []
    for _ in range(200):
        read(sensor, scene=Scene(wall_ahead(1.0)))
        readings.append(sensor.range)
    assert min(readings) == 0.0
    assert max(readings) == 3.0


def test_conf_of_both_dialects() -> None:
    """The range pair; UDK's IR has it twice (protocol reference 4.8)."""
    pair = "{MaxRange 1.5000} {MinRange 0.2000}"
    assert text_of(make("IR").configuration(UT2004)) == pair
    assert text_of(make("IR").configuration(UDK)) == f"{pair} {pair}"
    assert text_of(make("RangeSensor").configuration(UDK)) == (
        "{MaxRange 3.0000} {MinRange 0.1000}"
    )


def test_types_on_the_wire_and_intervals() -> None:
    """IR is IR; the plain range sensor is Range, as its source says."""
    assert (make("IR").wire_type, make("RangeSensor").wire_type) == ("IR", "Range")
    assert (make("IR").interval(UT2004), make("IR").interval(UDK)) == (0.2, 0.1)
