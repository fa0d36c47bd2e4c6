"""Sonar (robots reference 2.2, checklist 65 to 67)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import (
    UDK,
    UT2004,
    FakeRobot,
    Pole,
    Scene,
    make,
    read,
    text_of,
    values,
    wall_ahead,
)

from usarsim_server.errors import RobotDescriptionError

POLE = Pole(3.0, -0.5, 0.2)


@pytest.mark.parametrize(
    ("distance", "expected"), [(2.0, 2.0), (7.0, 5.0), (0.03, 0.1), (4.99, 4.99)]
)
def test_a_wall_ahead_reads_its_distance_within_the_limits(
    distance: float, expected: float
) -> None:
    """Checklist 65: 2 m reads 2 within 1 %, 7 m reads 5.0000, 0.03 m reads 0.1000."""
    sonar = make("Sonar")
    assert read(sonar, scene=Scene(wall_ahead(distance)))
    assert float(values(sonar)["Range"]) == pytest.approx(expected, rel=0.01)


def test_limits_are_printed_with_four_digits() -> None:
    """Checklist 65 and protocol checklist 101: clamped values are exactly the limits."""
    sonar = make("Sonar")
    read(sonar, scene=Scene())
    assert sonar.data(UDK) == (("Range", "5.0000"),)
    read(sonar, scene=Scene(wall_ahead(0.03)))
    assert sonar.data(UT2004) == (("Range", "0.1000"),)


def test_a_pole_beside_the_axis_is_seen_by_the_cone_only() -> None:
    """Checklist 66: 9.5 degrees off axis, seen as intended and not with the literal model."""
    intended, literal = make("Sonar"), make("Sonar", literal=True)
    read(intended, scene=Scene(POLE))
    read(literal, scene=Scene(POLE))
    centre = math.hypot(3.0, 0.5) - 0.2
    assert centre <= float(values(intended)["Range"]) <= centre + 0.02
    assert values(literal)["Range"] == "5.0000"


def test_an_oblique_wall_gives_no_echo_off_the_axis() -> None:
    """Specular reflection: a wall beside a sensor that looks along it is not heard."""
    corridor = Scene(wall_ahead(4.0))
    sonar = make("Sonar", max_incidence=0.02, beam_angle=1.0)
    read(sonar, scene=corridor)
    assert float(values(sonar)["Range"]) == pytest.approx(4.0)
    turned = FakeRobot()
    turned.place((0.0, 0.0, 0.0), (0.0, 0.0, 0.3))
    wide = make("Sonar", max_incidence=0.02, beam_angle=0.2)
    read(wide, turned, corridor)
    assert float(values(wide)["Range"]) == pytest.approx(4.0 / math.cos(0.3), abs=1e-3)


def test_the_centre_ray_counts_at_any_incidence() -> None:
    """The axis has no incidence limit, so a slanted wall straight ahead is read."""
    turned = FakeRobot()
    turned.place((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(60.0)))
    sonar = make("Sonar")
    read(sonar, turned, Scene(wall_ahead(2.0)))
    assert float(values(sonar)["Range"]) == pytest.approx(4.0, abs=1e-3)


def test_the_nearest_surface_that_faces_the_sensor_wins() -> None:
    """A turned sensor hears the wall where its normal points back, nearer than along the axis."""
    turned = FakeRobot()
    turned.place((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(10.0)))
    sonar = make("Sonar")
    read(sonar, turned, Scene(wall_ahead(2.0)))
    assert float(values(sonar)["Range"]) == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize(
    ("options", "rays"),
    [
        ({}, 17),
        ({"cones": 10, "rays_per_cone": 16}, 161),
        ({"literal": True}, 1),
        ({"cones": 0}, 1),
    ],
)
def test_the_number_of_rays_is_configurable(options: dict[str, object], rays: int) -> None:
    """17 rays by default, up to the original's 161."""
    (fan,) = make("Sonar", **options).rays(FakeRobot())
    assert len(fan.directions) == rays
    assert fan.normals


@pytest.mark.parametrize("options", [{"cones": 11}, {"rays_per_cone": 17}, {"beam_angle": 0.0}])
def test_sampling_beyond_the_original_is_refused(options: dict[str, object]) -> None:
    """Errors name the key."""
    with pytest.raises(RobotDescriptionError, match=next(iter(options))):
        make("Sonar", **options)


def test_limits_in_the_wrong_order_are_refused() -> None:
    """The maximum range must exceed the minimum range."""
    with pytest.raises(RobotDescriptionError, match=r"max_range: 0\.2 is out of range .*0\.5"):
        make("Sonar", min_range=0.5, max_range=0.2)


@given(st.floats(0.01, 9.0), st.floats(-0.25, 0.25), st.floats(-math.pi, math.pi))
def test_readings_stay_within_the_limits(distance: float, pitch: float, yaw: float) -> None:
    """Protocol checklist 101, for any wall, attitude and heading."""
    robot = FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, pitch, yaw))
    sonar = make("Sonar")
    read(sonar, robot, Scene(wall_ahead(distance), POLE))
    assert 0.1 <= float(values(sonar)["Range"]) <= 5.0


def test_a_flat_wall_reads_nearly_the_same_with_all_rays() -> None:
    """The default sampling changes a flat-wall reading by less than 1.5 % (robots 2.2)."""
    robot = FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.05, 0.07))
    few, many = make("Sonar"), make("Sonar", cones=10, rays_per_cone=16)
    for sonar in (few, many):
        read(sonar, robot, Scene(wall_ahead(3.0)))
    assert few.range == pytest.approx(many.range, rel=0.015)


def test_noise_is_off_by_default_and_gaussian_when_asked_for() -> None:
    """A standard deviation of 2 cm gives readings scattered by 2 cm around the truth."""
    plain, noisy = make("Sonar"), make("Sonar", noise=0.02)
    scene, readings = Scene(wall_ahead(2.0)), []
    for _ in range(600):
        read(noisy, scene=scene)
        readings.append(noisy.range)
    assert np.mean(readings) == pytest.approx(2.0, abs=0.004)
    assert np.std(readings) == pytest.approx(0.02, rel=0.1)
    read(plain, scene=scene)
    assert plain.range == pytest.approx(2.0, abs=1e-9)


def test_the_sensor_looks_along_its_mount() -> None:
    """A sonar on the right side, turned right, measures to the right of a turned robot."""
    robot = FakeRobot()
    robot.place((1.0, 0.0, 0.0), (0.0, 0.0, -math.pi / 2))
    sonar = make("Sonar", location=(0.1, 0.13, 0.0), rotation=(0.0, 0.0, math.pi / 2))
    read(sonar, robot, Scene(wall_ahead(3.0)))
    assert sonar.range == pytest.approx(3.0 - 1.0 - 0.13)


def test_conf_of_both_dialects() -> None:
    """CONF as in protocol reference 4.8; the cone passes through UDK's angle units."""
    sonar = make("Sonar", cones=10, rays_per_cone=16)
    assert text_of(sonar.configuration(UDK)) == (
        "{MaxRange 5.0000} {MinRange 0.1000} {ScanInterval 0.2000} {beamAngle 0.3489} "
        "{maxAngleOfIncidence 0.1745} {tracesPerCone 16} {numberOfCones 10}"
    )
    captured = make("Sonar", beam_angle=0.3491)
    assert text_of(captured.configuration(UT2004)) == (
        "{MaxRange 5.0000} {MinRange 0.1000} {BeamAngle 0.3491}"
    )


def test_intervals_are_those_of_the_class() -> None:
    """0.2 s in both generations (protocol reference appendix C)."""
    sonar = make("Sonar")
    assert (sonar.interval(UT2004), sonar.interval(UDK)) == (0.2, 0.2)
