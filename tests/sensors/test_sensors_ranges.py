"""Infrared and plain range finders, sonar, and directions of rays (robots reference 2.2, checklist
65 to 67, 77).
"""

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

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.protocol.dialects import ANGLE_UNIT, announced_angle
from usarsim_server.sensors.base import Sensor
from usarsim_server.sensors.inertial import angle_difference, each_turn
from usarsim_server.sensors.ranges import AHEAD, cone_directions, fan_at, wire_directions
from usarsim_server.simulation.frames import Pose, pose_from_wire

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
    """Robots 77: it reads the wall behind, where the range sensor sees the pane."""
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


POLE = Pole(3.0, -0.5, 0.2)


@pytest.mark.parametrize(
    ("distance", "expected"), [(2.0, 2.0), (7.0, 5.0), (0.03, 0.1), (4.99, 4.99)]
)
def test_a_wall_ahead_reads_its_distance_within_the_limits(
    distance: float, expected: float
) -> None:
    """Robots 65: 2 m reads 2 within 1 %, 7 m reads 5.0000, 0.03 m reads 0.1000."""
    sonar = make("Sonar")
    assert read(sonar, scene=Scene(wall_ahead(distance)))
    assert float(values(sonar)["Range"]) == pytest.approx(expected, rel=0.01)


def test_limits_are_printed_with_four_digits() -> None:
    """Robots 65 and protocol 101: clamped values are exactly the limits."""
    sonar = make("Sonar")
    read(sonar, scene=Scene())
    assert sonar.data(UDK) == (("Range", "5.0000"),)
    read(sonar, scene=Scene(wall_ahead(0.03)))
    assert sonar.data(UT2004) == (("Range", "0.1000"),)


def test_a_pole_beside_the_axis_is_seen_by_the_cone_only() -> None:
    """Robots 66: 9.5 degrees off axis, seen as intended and not with the literal model."""
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
    """Protocol 101, for any wall, attitude and heading."""
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


def test_a_ring_reads_what_its_sonars_read() -> None:
    """Sonars that report together are one fan; noise is each one's own, and so are the limits."""
    robot, scene = FakeRobot(), Scene(wall_ahead(3.0), Pole(1.5, 0.4, 0.2))
    robot.place((0.2, 0.1, 0.0), (0.02, -0.03, 0.1))

    def ring() -> tuple[Sensor, ...]:
        keys = ({}, {"noise": 0.02}, {"beam_angle": 1.0, "min_range": 2.9}, {"max_incidence": 0.5})
        return tuple(
            make("Sonar", f"F{number}", rotation=(0.0, 0.0, 0.4 * number - 0.6), **key)
            for number, key in enumerate(keys)
        )

    alone, together = ring(), ring()
    for _ in range(3):
        for sonar in alone:
            read(sonar, robot, scene)
        fans, measure = together[0].begin(together, robot)
        assert len(fans) == 1
        assert measure(scene(fans)) == together
        assert [one.data(UDK) for one in together] == [one.data(UDK) for one in alone]
    assert len({one.data(UDK) for one in together}) > 2
    odd = (*ring(), make("Sonar", cones=1))
    assert len(odd[0].begin(odd, robot)[0]) == len(odd), "not alike: one after the other"


def test_the_sensor_looks_along_its_mount() -> None:
    """A sonar on the right side, turned right, measures to the right of a turned robot."""
    robot = FakeRobot()
    robot.place((1.0, 0.0, 0.0), (0.0, 0.0, -math.pi / 2))
    sonar = make("Sonar", location=(0.1, 0.13, 0.0), rotation=(0.0, 0.0, math.pi / 2))
    read(sonar, robot, Scene(wall_ahead(3.0)))
    assert sonar.range == pytest.approx(3.0 - 1.0 - 0.13)


def test_conf_of_both_dialects_sonar() -> None:
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


ANGLE = st.floats(min_value=-20.0, max_value=20.0)


def test_positive_wire_yaw_is_to_the_right() -> None:
    """A quarter turn of wire yaw points to -y of the simulation frame."""
    directions = wire_directions(np.array([0.0, math.pi / 2, -math.pi / 2]))
    assert np.allclose(directions, [[1, 0, 0], [0, -1, 0], [0, 1, 0]])


def test_positive_wire_pitch_is_up() -> None:
    """A quarter turn of wire pitch points to +z of the simulation frame."""
    assert np.allclose(wire_directions(0.0, np.array([math.pi / 2])), [[0, 0, 1]])


@given(ANGLE, st.floats(min_value=-1.5, max_value=1.5))
def test_directions_agree_with_the_pose_conversion(yaw: float, pitch: float) -> None:
    """A direction is where a sensor of that wire yaw and pitch looks."""
    looking = pose_from_wire((0, 0, 0), (0.0, pitch, yaw)).rotate((1.0, 0.0, 0.0))
    assert np.allclose(wire_directions(yaw, pitch)[0], looking, atol=1e-9)


@pytest.mark.parametrize(("cones", "rays"), [(0, 8), (1, 1), (2, 8), (10, 16)])
def test_a_cone_has_its_axis_and_all_rays(cones: int, rays: int) -> None:
    """1 + cones x rays unit vectors, the axis first."""
    directions = cone_directions(0.2, cones, rays)
    assert directions.shape == (1 + cones * rays, 3)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert np.array_equal(directions[0], AHEAD[0])


def test_half_angles_grow_in_equal_steps_to_the_rim() -> None:
    """The original's ten cones open by one degree each up to ten degrees."""
    directions = cone_directions(math.radians(10.0), 10, 16)
    opening = np.degrees(np.arccos(directions[1:, 0])).reshape(10, 16)
    assert np.allclose(opening, np.arange(1, 11)[:, None])


def test_every_cone_has_rays_in_the_horizontal_plane() -> None:
    """Upright obstacles beside the axis meet a ray square on."""
    rings = cone_directions(0.2, 2, 8)[1:].reshape(2, 8, 3)
    for ring in rings:
        flat = ring[np.abs(ring[:, 2]) < 1e-12]
        assert sorted(np.sign(flat[:, 1])) == [-1.0, 1.0]


def test_a_fan_starts_at_the_sensor_and_turns_with_it() -> None:
    """Directions are rotated into the world, the origin is the sensor's place."""
    pose = pose_from_wire((1.0, 2.0, -0.5), (0.0, 0.0, math.pi / 2))
    fan = fan_at(pose, wire_directions(np.array([0.0, math.pi / 2])), 7.0, normals=True)
    assert np.allclose(fan.origin, [1.0, -2.0, 0.5])
    assert np.allclose(fan.directions, [[0, -1, 0], [-1, 0, 0]])
    assert (fan.max_range, fan.normals, fan.through_glass) == (7.0, True, False)


def test_a_fan_does_not_spoil_the_precomputed_directions() -> None:
    """The shared constant of a single ray stays as it is."""
    fan_at(Pose((1.0, 2.0, 3.0), (0.0, 1.0, 0.0, 0.0)), AHEAD, 1.0)
    assert np.array_equal(AHEAD, [[1.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("angle", "udk"), [(3.14159, 3.1414), (math.pi, 3.1415), (0.349, 0.3489), (0.01745, 0.0174)]
)
def test_udk_announces_whole_angle_units(angle: float, udk: float) -> None:
    """Pi as 3.14159 prints 3.1414, the sonar cone 0.3489 (protocol reference 4.6, 4.8)."""
    assert math.floor(announced_angle(angle, UDK) * 1e4) / 1e4 == pytest.approx(udk)
    assert announced_angle(angle, UT2004) == angle


@given(st.floats(min_value=0.0, max_value=7.0))
def test_announced_angles_are_at_most_one_unit_short(angle: float) -> None:
    """Truncation never exceeds the angle and loses less than one unit."""
    assert -1e-12 <= angle - announced_angle(angle, UDK) < ANGLE_UNIT + 1e-12


@given(ANGLE, ANGLE)
def test_differences_take_the_short_way_round(new: float, old: float) -> None:
    """A difference is within half a turn and leads from old to new."""
    turn = angle_difference((new, 0.0, 0.0), (old, 0.0, 0.0))[0]
    assert -math.pi <= turn <= math.pi
    assert math.cos(old + turn) == pytest.approx(math.cos(new), abs=1e-9)
    assert math.sin(old + turn) == pytest.approx(math.sin(new), abs=1e-9)


@given(ANGLE, ANGLE, ANGLE)
def test_each_turn_stays_below_a_whole_turn(x: float, y: float, z: float) -> None:
    """All three angles come to lie in [0, 2 pi)."""
    for before, after in zip((x, y, z), each_turn((x, y, z)), strict=True):
        assert 0.0 <= after < math.tau
        assert math.cos(after) == pytest.approx(math.cos(before), abs=1e-9)


@given(st.floats(-3.0, 3.0))
def test_start_points_move_and_turn_with_the_sensor(yaw: float) -> None:
    """Two rays beside each other stay beside each other wherever the sensor looks."""
    pose = pose_from_wire((1.0, 2.0, -0.5), (0.0, 0.0, yaw))
    starts = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.2]])
    fan = fan_at(pose, np.repeat(AHEAD, 2, axis=0), 3.0, starts=starts)
    assert fan.origin.shape == (2, 3)
    back = (fan.origin - np.array(pose.position)) @ pose.matrix()
    assert np.allclose(back, starts)
    assert np.allclose(fan.directions[0], fan.directions[1])


def test_a_fan_asks_for_no_more_than_it_is_told_to() -> None:
    """Normals, glass and names are extra."""
    pose = pose_from_wire((0.0, 0.0, 0.0))
    plain = fan_at(pose, AHEAD, 3.0)
    assert plain.origin.shape == (3,)
    assert (plain.normals, plain.through_glass, plain.identify) == (False, False, False)
    assert fan_at(pose, AHEAD, 3.0, identify=True).identify
