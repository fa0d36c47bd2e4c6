"""Ground truth, compass, altimeter and mission clock (robots reference 2.5, 91, 92, 99,
100; protocol 117), and GPS (robots reference 2.6, 93 to 97; protocol checklist
111, 112).
"""

from __future__ import annotations

import math
import re

import mujoco
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
    describe_world,
    make,
    numbers,
    read,
    text_of,
    values,
)

from usarsim_server.protocol.values import Dialect
from usarsim_server.sensors.gps import constellation, fix_deviation, sky_directions
from usarsim_server.sensors.report import conf_line, sen_lines
from usarsim_server.simulation.frames import quaternion_from_rpy
from usarsim_server.simulation.layout import RobotLayout
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.worlds.description import GeographicOrigin

NONE = np.zeros(0, dtype=np.intp)
ANGLE = st.floats(-3.1, 3.1)


def robot_in_mujoco(position, roll: float, pitch: float, yaw: float) -> RobotBody:
    """A free body that MuJoCo itself placed; angles of the simulation frame."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[:3] = position
    data.qpos[3:] = quaternion_from_rpy(roll, pitch, yaw)
    mujoco.mj_forward(model, data)
    layout = RobotLayout(0, 1, 0, 0, {}, {}, {}, NONE, NONE, NONE, frozenset({1}), NONE)
    snapshot = Snapshot(
        data.time, 0, 0, data.qpos.copy(), data.qvel.copy(), data.xpos.copy(), data.xquat.copy()
    )
    return RobotBody(snapshot, layout)


@given(st.tuples(*[st.floats(-50, 50)] * 3), ANGLE, st.floats(-1.5, 1.5), ANGLE)
def test_it_equals_the_state_of_mujoco(position, roll: float, pitch: float, yaw: float) -> None:
    """Robots 91: within 1 mm and 0.06 degrees after y, z, pitch and yaw change sign."""
    sensor = make("GroundTruth")
    assert sensor.measure(robot_in_mujoco(position, roll, pitch, yaw), [])
    x, y, z = numbers(values(sensor)["Location"])
    assert (x, -y, -z) == pytest.approx(position, abs=1.1e-3)
    turned = numbers(values(sensor)["Orientation"])
    for angle, truth in zip(turned, (roll, -pitch, -yaw), strict=True):
        assert math.degrees(abs(math.remainder(angle - truth, math.tau))) < 0.06


def test_udk_has_three_digits_and_signed_angles() -> None:
    """Robots 92 and protocol reference 4.6."""
    sensor, robot = make("GroundTruth", "GndTruth"), FakeRobot()
    robot.place((4.5015, 1.8996, -0.1464), (0.0, -0.0012, 1.5708))
    read(sensor, robot)
    assert sen_lines([sensor], 63.4021, UDK) == [
        "SEN {Time 63.4021} {Type GroundTruth} {Name GndTruth} "
        "{Location 4.501,1.899,-0.146} {Orientation 0.000,-0.001,1.570}"
    ]


def test_ut2004_has_two_digits_and_whole_turns() -> None:
    """Protocol reference 2.2 and 2.5: a small negative angle prints 6.28."""
    sensor, robot = make("GroundTruth", "GroundTruth"), FakeRobot()
    robot.place((4.5, 1.9, 1.85), (0.0, -0.001, 1.5708))
    read(sensor, robot)
    assert sen_lines([sensor], 63.4, UT2004) == [
        "SEN {Time 63.4000} {Type GroundTruth} {Name GroundTruth} "
        "{Location 4.50,1.90,1.85} {Orientation 0.00,6.28,1.57}"
    ]


def test_intervals() -> None:
    """Robots 92: 0.1 s in UDK, 0.05 s in UT2004, and CONF says so."""
    sensor = make("GroundTruth")
    assert (sensor.interval(UDK), sensor.interval(UT2004)) == (0.1, 0.05)
    assert text_of(sensor.configuration(UDK)) == "{ScanInterval 0.1000}"
    assert text_of(sensor.configuration(UT2004)) == "{ScanInterval 0.0500}"
    assert text_of(make("GroundTruth", interval=0.2).configuration(UDK)) == "{ScanInterval 0.2000}"


def test_the_mount_does_not_matter_unless_asked_for() -> None:
    """GroundTruth is the robot's centre; of = sensor and GroundTruthMovable are the item."""
    robot = FakeRobot()
    robot.place((1.0, 2.0, 0.0), (0.0, 0.0, math.pi / 2))
    mount = {"location": (0.5, 0.0, -0.25), "rotation": (0.0, 0.0, 0.1)}
    centre = make("GroundTruth", **mount)
    itself = make("GroundTruth", of="sensor", **mount)
    movable = make("GroundTruthMovable", **mount)
    for sensor in (centre, itself, movable):
        read(sensor, robot)
    assert values(centre)["Location"] == "1.000,2.000,0.000"
    assert values(itself)["Location"] == "1.000,2.500,-0.250"
    assert values(itself)["Orientation"] == "0.000,0.000,1.670"
    assert movable.data(UDK) == itself.data(UDK)
    assert movable.wire_type == "GroundTruth"


def test_it_follows_the_link_that_carries_it() -> None:
    """A movable ground truth on a link reports the link's place."""
    robot = FakeRobot()
    linked = FakeRobot()
    linked.place((3.0, 0.0, -1.0))
    robot.links["hand"] = linked.pose
    sensor = make("GroundTruthMovable", link="Hand")
    read(sensor, robot)
    assert values(sensor)["Location"] == "3.000,0.000,-1.000"


def test_location_comes_before_orientation() -> None:
    """Protocol 117, in both dialects."""
    sensor = make("GroundTruth")
    for dialect in (UT2004, UDK):
        assert [key for key, _ in sensor.data(dialect)] == ["Location", "Orientation"]


@pytest.mark.parametrize(
    ("yaw", "north", "expected"),
    [(1.5708, 0.0, 1.5708), (0.0, 0.5, -0.5), (-3.0, 3.0, math.tau - 6.0), (0.2, 0.2, 0.0)],
)
def test_the_compass_reads_yaw_relative_to_north(yaw: float, north: float, expected: float) -> None:
    """Robots 100, signed, clockwise positive."""
    sensor, robot = make("MagneticCompass", world=describe_world(north=north)), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
    assert read(sensor, robot)
    assert float(values(sensor)["MagneticAngle"]) == pytest.approx(expected, abs=1.1e-4)


def test_the_literal_compass_reads_zero() -> None:
    """Robots 100: the original's double conversion."""
    sensor, robot = make("MagneticCompass", literal=True), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    read(sensor, robot)
    assert values(sensor)["MagneticAngle"] == "0.0000"


def test_altitude_is_relative_to_the_start_and_up() -> None:
    """Robots 99, protocol 123: 0 at spawn, positive above, absolute = 111 more."""
    sensor, robot = make("AltitudeSensor"), FakeRobot()
    robot.place((0.0, 0.0, -0.5))
    read(sensor, robot)
    assert sensor.data(UDK) == (("relativeAltitude", "0.0000"), ("absoluteAltitude", "111.0000"))
    robot.place((3.0, 0.0, -1.7044))
    read(sensor, robot)
    assert sensor.data(UDK) == (("relativeAltitude", "1.2044"), ("absoluteAltitude", "112.2044"))


def test_absolute_altitude_is_never_negative() -> None:
    """Far below the start the absolute value stops at zero, the relative one does not."""
    sensor, robot = make("AltitudeSensor", sea_level=10.0), FakeRobot()
    read(sensor, robot)
    robot.place((0.0, 0.0, 30.0))
    read(sensor, robot)
    assert sensor.data(UDK) == (("relativeAltitude", "-30.0000"), ("absoluteAltitude", "0.0000"))


def test_mission_time_counts_whole_minutes() -> None:
    """Minutes since the first reading."""
    sensor, robot = make("MissionTime"), FakeRobot(time=1000.0)
    for time, minutes in ((1000.0, "0"), (1059.9, "0"), (1060.0, "1"), (1199.0, "3")):
        robot.time = time
        read(sensor, robot)
        assert values(sensor)["Minutes"] == minutes


def test_lines() -> None:
    """The templates of protocol reference 4.6; CONF has nothing but the name (protocol 4.8)."""
    robot = FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, 1.5708))
    sensors = [
        make("MagneticCompass", "Compass"),
        make("AltitudeSensor", "Altimeter"),
        make("MissionTime", "Time"),
    ]
    for sensor in sensors:
        read(sensor, robot)
    assert sen_lines(sensors, 12.3047, UDK) == [
        "SEN {Time 12.3047} {Type MagneticCompass} {Name Compass} {MagneticAngle 1.5708}",
        "SEN {Time 12.3047} {Type AltitudeSensor} {Name Altimeter} {relativeAltitude 0.0000} "
        "{absoluteAltitude 111.0000}",
        "SEN {Time 12.3047} {Type MissionTime} {Name Time} {Minutes 0}",
    ]
    assert conf_line(sensors, "missiontime", "time", UDK) == "CONF {Type MissionTime} {Name Time}"


HOUSE = Scene(Box((-50, -50, 3), (50, 50, 4)), Box((-50, -50, -1), (50, -49, 4)))
FIELD = Scene(Box((-9000, -9000, -2), (9000, 9000, -1)))


def degrees(text: str) -> float:
    """`d,m.mmmm,X` as signed degrees."""
    whole, minutes, letter = text.split(",")
    return (int(whole) + float(minutes) / 60.0) * (-1.0 if letter in "SW" else 1.0)


def seeing(count: int) -> list[RayHits]:
    """Answers to the rays by which exactly this many satellites are in sight."""
    distances = np.full(11, 10.0)
    distances[:count] = math.inf
    return [RayHits(distances)]


def fixes(sensor, satellites: int, count: int) -> np.ndarray:
    """North and east errors (m) of reports at the origin."""
    rows = []
    for _ in range(count):
        sensor.measure(FakeRobot(), seeing(satellites))
        latitude, longitude = sensor._position
        origin = GeographicOrigin()
        rows.append(
            ((latitude - origin.latitude) * 111200.0, (longitude - origin.longitude) * 71670.0)
        )
    return np.array(rows)


def test_the_default_origin() -> None:
    """Robots 93: 39,8.0273,N and 77,12.9980,W with the noise off."""
    sensor = make("GPS", noise=False)
    read(sensor, scene=FIELD)
    assert values(sensor)["Latitude"] == "39,8.0273,N"
    assert values(sensor)["Longitude"] == "77,12.9980,W"


def test_metres_to_degrees() -> None:
    """Robots 94: 1112 m north is 0.01 degree of latitude, 716.7 m east one of longitude."""
    sensor, robot = make("GPS", noise=False), FakeRobot()
    robot.place((1112.0, 716.7, 0.0))
    read(sensor, robot, FIELD)
    origin = GeographicOrigin()
    assert degrees(values(sensor)["Latitude"]) == pytest.approx(origin.latitude + 0.01, abs=2e-6)
    assert degrees(values(sensor)["Longitude"]) == pytest.approx(origin.longitude + 0.01, abs=2e-6)


def test_a_world_may_lie_askew() -> None:
    """With north at wire yaw 90 degrees, wire y leads north and wire -x leads east."""
    sensor, robot = make("GPS", noise=False, world=describe_world(north=math.pi / 2)), FakeRobot()
    robot.place((-716.7, 1112.0, 0.0))
    read(sensor, robot, FIELD)
    origin = GeographicOrigin()
    assert degrees(values(sensor)["Latitude"]) == pytest.approx(origin.latitude + 0.01, abs=2e-6)
    assert degrees(values(sensor)["Longitude"]) == pytest.approx(origin.longitude + 0.01, abs=2e-6)


@pytest.mark.parametrize(
    ("satellites", "sigma"), [(4, 0.833), (6, 0.688), (8, 0.542), (10, 0.396), (11, 0.323)]
)
def test_noise_follows_the_number_of_satellites(satellites: int, sigma: float) -> None:
    """Robots 95: the deviation of 1000 fixes is sigma(n) within 10 %, white, per axis."""
    errors = fixes(make("GPS", seed=11), satellites, 1000)
    assert np.std(errors, axis=0) == pytest.approx([sigma, sigma], rel=0.1)
    for axis in (0, 1):
        assert abs(np.corrcoef(errors[:-1, axis], errors[1:, axis])[0, 1]) < 0.1
    assert abs(np.corrcoef(errors[:, 0], errors[:, 1])[0, 1]) < 0.1


@pytest.mark.parametrize(("n", "sigma"), [(4, 2.5 / 3), (12, 0.25), (30, 0.0)])
def test_the_line_of_the_deviation(n: int, sigma: float) -> None:
    """A third of 2.5 m at four and of 0.75 m at twelve satellites, never negative."""
    assert fix_deviation(n) == pytest.approx(sigma)


def test_indoors_there_is_no_position() -> None:
    """Robots 96, protocol 112: Fix 0 and the count, nothing else."""
    sensor = make("GPS", "GPS")
    assert read(sensor, scene=HOUSE)
    assert sensor.satellites < 4
    for dialect in (UT2004, UDK):
        assert sen_lines([sensor], 1.0, dialect) == [
            f"SEN {{Type GPS}} {{Name GPS}} {{Fix 0}} {{Satellites {sensor.satellites}}}"
        ]


@pytest.mark.parametrize(("count", "fix"), [(3, "0"), (4, "1")])
def test_a_fix_needs_four_satellites(count: int, fix: str) -> None:
    """Three are too few."""
    sensor = make("GPS")
    sensor.measure(FakeRobot(), seeing(count))
    assert values(sensor)["Fix"] == fix
    assert values(sensor)["Satellites"] == str(count)
    assert ("Latitude" in values(sensor)) == (fix == "1")


def test_a_street_canyon_hides_satellites() -> None:
    """Robots 97: between high walls fewer are in sight than in the open, more than indoors."""
    canyon = Scene(Box((-500, 8, -1), (500, 9, 12)), Box((-500, -9, -1), (500, -8, 12)))
    counts = []
    for scene in (FIELD, canyon, HOUSE):
        sensor = make("GPS")
        read(sensor, scene=scene)
        counts.append(sensor.satellites)
    assert counts[0] == 11
    assert counts[0] > counts[1] > counts[2]


@pytest.mark.parametrize(
    ("origin", "visible"), [(GeographicOrigin(), 11), (GeographicOrigin(0.0, 0.0), 12)]
)
def test_the_sky_is_as_full_as_the_original_one(origin: GeographicOrigin, visible: int) -> None:
    """robots 2.6: 31 satellites, 11 above 5 degrees at the default origin, 12 at 0, 0."""
    assert constellation().shape == (31, 3)
    assert len(np.unique(constellation().round(), axis=0)) == 31
    directions = sky_directions(describe_world(origin=origin))
    assert len(directions) == visible
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    elevation = np.degrees(np.arcsin(directions[:, 2]))
    assert elevation.min() > 5.0 + 4.0


def test_satellites_stand_where_north_and_east_are() -> None:
    """Turning the map turns the sky with it."""
    plain, turned = sky_directions(describe_world()), sky_directions(describe_world(math.pi / 2))
    # A quarter turn of wire yaw is clockwise: x goes to -y of the simulation frame.
    assert np.allclose(turned, np.column_stack((plain[:, 1], -plain[:, 0], plain[:, 2])))


@pytest.mark.parametrize("longitude", range(-180, 180, 30))
def test_near_the_poles_no_satellite_stands_high(longitude: int) -> None:
    """Orbits inclined by 55 degrees rise to 57.6 degrees at most at latitude 80, by geometry."""
    away = math.radians(80.0 - 55.0)
    highest = math.atan2(math.cos(away) - 6378137.0 / 26559700.0, math.sin(away))
    directions = sky_directions(describe_world(origin=GeographicOrigin(80.0, float(longitude))))
    assert 4 <= len(directions) <= 31
    assert np.arcsin(directions[:, 2]).max() <= highest + 1e-9


@given(st.floats(-80.0, 80.0), st.floats(-179.0, 179.0))
def test_coordinates_are_well_formed_and_exact(latitude: float, longitude: float) -> None:
    """Protocol 111: whole degrees, four digits of minutes below 60, hemisphere letter."""
    world = describe_world(origin=GeographicOrigin(latitude, longitude))
    sensor = make("GPS", noise=False, world=world)
    sensor.measure(FakeRobot(), seeing(11))
    for key, truth, letters in (("Latitude", latitude, "NS"), ("Longitude", longitude, "EW")):
        text = values(sensor)[key]
        match = re.fullmatch(rf"(\d+),(\d+\.\d{{4}}),([{letters}])", text)
        assert match
        assert 0.0 <= float(match[2]) < 60.0
        assert degrees(text) == pytest.approx(truth, abs=1.01e-4 / 60)


def test_longitude_wraps_at_the_date_line() -> None:
    """East of 180 degrees comes 180 west."""
    world = describe_world(origin=GeographicOrigin(0.0, 179.999))
    sensor, robot = make("GPS", noise=False, world=world), FakeRobot()
    robot.place((0.0, 716.7, 0.0))
    sensor.measure(robot, seeing(11))
    text = values(sensor)["Longitude"]
    assert text.startswith("179,59.")
    assert text.endswith(",W")


def test_driving_along_x_increases_the_latitude() -> None:
    """Protocol 111."""
    sensor, robot = make("GPS", noise=False), FakeRobot()
    readings = []
    for x in (0.0, 50.0, 100.0):
        robot.place((x, 0.0, 0.0))
        read(sensor, robot, FIELD)
        readings.append(degrees(values(sensor)["Latitude"]))
    assert readings == sorted(set(readings))


def test_the_antenna_is_where_the_mount_is() -> None:
    """Rays start at the sensor and reach far; directions do not turn with the robot."""
    robot = FakeRobot()
    robot.place((1.0, 2.0, 0.0), (0.3, 0.4, 1.0))
    sensor = make("GPS", location=(0.0, 0.0, -1.0))
    (fan,) = sensor.rays(robot)
    assert np.allclose(fan.origin, sensor.world_pose(robot).position)
    assert np.allclose(fan.directions, sky_directions(describe_world()))
    assert fan.max_range >= 1000.0


@pytest.mark.parametrize("dialect", list(Dialect))
def test_sen_and_conf(dialect: Dialect) -> None:
    """Protocol reference 4.6 and 5.3: no Time in either dialect; 0.2 s."""
    sensor = make("GPS", "GPS", noise=False)
    read(sensor, scene=FIELD)
    assert sen_lines([sensor], 63.4, dialect) == [
        "SEN {Type GPS} {Name GPS} {Latitude 39,8.0273,N} {Longitude 77,12.9980,W} "
        "{Fix 1} {Satellites 11}"
    ]
    assert text_of(sensor.configuration(dialect)) == "{ScanInterval 0.2000}"
    assert sensor.interval(dialect) == 0.2
