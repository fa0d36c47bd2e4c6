"""Ground truth, compass, altimeter and mission clock (robots reference 2.5, checklist 91, 92, 99,
100; protocol checklist 117).
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_fakes import (
    UDK,
    UT2004,
    FakeRobot,
    describe_world,
    make,
    numbers,
    read,
    text_of,
    values,
)

from usarsim_server.sensors.report import conf_line, sen_lines
from usarsim_server.simulation.frames import quaternion_from_rpy
from usarsim_server.simulation.snapshot import RobotBody, RobotLayout, Snapshot

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
    """Checklist 91: within 1 mm and 0.06 degrees after y, z, pitch and yaw change sign."""
    sensor = make("GroundTruth")
    assert sensor.measure(robot_in_mujoco(position, roll, pitch, yaw), [])
    x, y, z = numbers(values(sensor)["Location"])
    assert (x, -y, -z) == pytest.approx(position, abs=1.1e-3)
    turned = numbers(values(sensor)["Orientation"])
    for angle, truth in zip(turned, (roll, -pitch, -yaw), strict=True):
        assert math.degrees(abs(math.remainder(angle - truth, math.tau))) < 0.06


def test_udk_has_three_digits_and_signed_angles() -> None:
    """Checklist 92 and protocol reference 4.6."""
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
    """Checklist 92: 0.1 s in UDK, 0.05 s in UT2004, and CONF says so."""
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
    """Protocol checklist 117, in both dialects."""
    sensor = make("GroundTruth")
    for dialect in (UT2004, UDK):
        assert [key for key, _ in sensor.data(dialect)] == ["Location", "Orientation"]


@pytest.mark.parametrize(
    ("yaw", "north", "expected"),
    [(1.5708, 0.0, 1.5708), (0.0, 0.5, -0.5), (-3.0, 3.0, math.tau - 6.0), (0.2, 0.2, 0.0)],
)
def test_the_compass_reads_yaw_relative_to_north(yaw: float, north: float, expected: float) -> None:
    """Checklist 100, signed, clockwise positive."""
    sensor, robot = make("MagneticCompass", world=describe_world(north=north)), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
    assert read(sensor, robot)
    assert float(values(sensor)["MagneticAngle"]) == pytest.approx(expected, abs=1.1e-4)


def test_the_literal_compass_reads_zero() -> None:
    """Checklist 100: the original's double conversion."""
    sensor, robot = make("MagneticCompass", literal=True), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    read(sensor, robot)
    assert values(sensor)["MagneticAngle"] == "0.0000"


def test_altitude_is_relative_to_the_start_and_up() -> None:
    """Checklist 99, protocol checklist 123: 0 at spawn, positive above, absolute = 111 more."""
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
    """The templates of protocol reference 4.6; CONF has nothing but the name (4.8)."""
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
