"""The shipped robots say what the robots reference says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from machine_fakes import ROBOTS

from usarsim_server.protocol.messages import ground_configuration, ground_geometry
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sensors.base import SensorContext, create_sensor
from usarsim_server.simulation.frames import wire_from_pose
from usarsim_server.worlds.description import WorldDescription

WORLD = WorldDescription("test", "Test", "", "", Path(), Path("scene.xml"), ())


AT_FRONT = [(0.145, 0.130, 90), (0.185, 0.115, 50), (0.220, 0.080, 30), (0.240, 0.025, 10)]


DX_FRONT = [(0.115, 0.130, 90), (0.155, 0.115, 50), (0.190, 0.080, 30), (0.210, 0.025, 10)]


RING = [*(f"F{n}" for n in range(1, 9)), *(f"R{n}" for n in range(1, 9))]


def geo(name: str) -> str:
    robot = ROBOTS[name]
    report = robot.report
    return ground_geometry(
        robot.name,
        report.dimensions,
        report.center_of_gravity,
        report.wheel_radius,
        report.track_width,
        report.wheel_base,
    )


def conf(name: str, dialect: Dialect) -> str:
    robot = ROBOTS[name]
    report = robot.report
    return ground_configuration(
        dialect,
        robot.name,
        report.steering_type,
        report.mass,
        report.max_speed,
        report.max_torque,
        report.max_front_steer,
        report.max_rear_steer,
    )


def mounts(robot: RobotDescription) -> list[tuple[str, str, tuple[float, ...], tuple[float, ...]]]:
    """Type, name, wire location and wire rotation of every item."""
    return [
        (
            item.type,
            item.name,
            tuple(round(value, 4) + 0.0 for value in wire_from_pose(item.pose)[0]),
            tuple(round(value, 4) + 0.0 for value in wire_from_pose(item.pose)[1]),
        )
        for item in robot.items
    ]


def test_p3at_geo_prints_as_captured() -> None:
    """P3AT GEO: Dimensions 0.2480,0.3600,0; 0.0980; 0.3600; 0.2480 (robots 4)."""
    line = geo("P3AT")
    assert "{Dimensions 0.2480,0.3600,0" in line
    assert "{WheelRadius 0.0980}" in line
    assert "{WheelSeparation 0.3600}" in line
    assert "{WheelBase 0.2480}" in line


def test_p3at_conf_prints_as_captured() -> None:
    """P3AT CONF: SkidSteered, Mass 11.9000, MaxSpeed 1.2999, MaxTorque 50000 (robots 5)."""
    line = conf("P3AT", Dialect.UDK)
    assert "{SteeringType SkidSteered}" in line
    assert "{Mass 11.9000}" in line
    assert "{MaxSpeed 1.2999}" in line
    assert "{MaxTorque 50000.0000}" in line
    assert ROBOTS["P3AT"].drive.max_wheel_speed == 1.3


def test_p2at_geo_and_conf_print_as_captured() -> None:
    """P2AT GEO and CONF carry the captured figures (robots 6)."""
    line = geo("P2AT")
    assert "{Dimensions 0.5238,0.4968,0.2913} {COG 0.0000,0.0000,0.0000}" in line
    assert "{WheelRadius 0.1300} {WheelSeparation 0.4712} {WheelBase 0.2884}" in line
    line = conf("P2AT", Dialect.UT2004)
    assert "{SteeringType SkidSteered} {Mass 14.0000} {MaxSpeed 5.3850}" in line
    assert "{MaxTorque 60.0000} {MaxFrontSteer 0.0000} {MaxRearSteer 0.0000}" in line


def test_p2at_top_speed() -> None:
    """P2AT's wheel limit times its radius is the 0.700 m/s of robots 1.2."""
    robot = ROBOTS["P2AT"]
    assert robot.drive.max_wheel_speed * robot.report.wheel_radius == pytest.approx(0.700, abs=5e-4)


def test_p3at_default_items_in_order() -> None:
    """P3AT carries the items of robots 1.2.1 with their poses in that order (robots 14)."""
    assert mounts(ROBOTS["P3AT"])[:7] == [
        ("GroundTruth", "GndTruth", (0, 0, 0), (0, 0, 0)),
        ("INS", "InsTest", (0, 0, -0.2), (0, 0, 0)),
        ("SICK", "lms200", (0.2085, 0, -0.2), (0, 0, 0)),
        ("Tachometer", "TachTest", (0, 0, 0), (0, 0, 0)),
        ("Encoder", "W1", (0, 0, 0), (0, 0, 0)),
        ("Encoder", "W2", (0, 0, 0), (0, 0, 0)),
        ("Battery", "battery", (0.15, 0, -0.2), (0, 0, 0)),
    ]
    assert [mount[:2] for mount in mounts(ROBOTS["P3AT"])[7:]] == [("Odometry", "Odometer")]


def test_p3at_part_order() -> None:
    """W1 and W2 are the front left and the back right wheel: part order of the UDK class."""
    wheels = ROBOTS["P3AT"].driven_wheels
    assert [wheel.name for wheel in wheels] == ["FRWheel", "FLWheel", "BRWheel", "BLWheel"]
    for wheel in wheels:
        assert wheel.side == ("right" if wheel.name[1] == "R" else "left")
        assert (wheel.position[0] > 0) == (wheel.name[0] == "F")
    encoders = [item.parameters["wheel"] for item in ROBOTS["P3AT"].items if item.type == "Encoder"]
    assert encoders == [1, 2]


def test_p2at_part_order() -> None:
    """UT2004 robots count left before right, front before rear."""
    wheels = ROBOTS["P2AT"].driven_wheels
    assert [wheel.name for wheel in wheels] == [
        "LeftFWheel",
        "RightFWheel",
        "LeftRWheel",
        "RightRWheel",
    ]
    assert [wheel.side for wheel in wheels] == ["left", "right", "left", "right"]
    assert [wheel.position[0] for wheel in wheels] == [0.1442, 0.1442, -0.1442, -0.1442]


@pytest.mark.parametrize(
    ("name", "front", "names"),
    [("P2AT", AT_FRONT, RING), ("P2DX", DX_FRONT, RING[:8]), ("P3DX", DX_FRONT, RING[:8])],
)
def test_sonar_rings(name: str, front: list[tuple[float, float, float]], names: list[str]) -> None:
    """Sonars F1..F8, on P2AT then R1..R8, are where robots 1.6 says; left ones have negative y
    (robots 15)."""
    left = [(x, -y, -yaw) for x, y, yaw in front]
    right = [(x, y, yaw) for x, y, yaw in reversed(front)]
    # Clockwise from the left: the rear starts on the right.
    rear = [(-x, y, math.copysign(180, yaw) - yaw) for x, y, yaw in reversed([*left, *right])]
    sonars = [mount for mount in mounts(ROBOTS[name]) if mount[0] == "Sonar"]
    assert [sonar[1] for sonar in sonars] == names
    places = [*left, *right, *rear][: len(names)]
    for (_, _, location, rotation), (x, y, yaw) in zip(sonars, places, strict=True):
        assert location[:2] == pytest.approx((x, y))
        assert rotation == pytest.approx((0, 0, math.radians(yaw)), abs=1e-4)


def test_sonar_ring_of_the_real_3at() -> None:
    """P3AT_real has the ring of the ARIA file, numbered clockwise from the left."""
    sonars = {mount[1]: mount for mount in mounts(ROBOTS["P3AT_real"]) if mount[0] == "Sonar"}
    for name, x, y, yaw in [
        ("F1", 0.147, -0.136, -90),
        ("F2", 0.193, -0.119, -50),
        ("F3", 0.227, -0.079, -30),
        ("F4", 0.245, -0.027, -10),
        ("F8", 0.147, 0.136, 90),
        ("R1", -0.144, 0.136, 90),
        ("R4", -0.241, 0.027, 170),
        ("R5", -0.241, -0.027, -170),
        ("R8", -0.144, -0.136, -90),
    ]:
        assert sonars[name][2][:2] == pytest.approx((x, y))
        assert sonars[name][3][2] == pytest.approx(math.radians(yaw), abs=1e-4)


def test_every_sonar_looks_away_from_the_middle() -> None:
    """No level sonar looks inward, and none lacks its mirror image."""
    for robot in ROBOTS.values():
        sonars = [mount for mount in mounts(robot) if mount[0] == "Sonar" and mount[3][1] == 0.0]
        seen = {(m[2][0], m[2][1], m[3][2]) for m in sonars}
        for x, y, yaw in seen:
            assert (x, y) == (0, 0) or x * math.cos(yaw) + y * math.sin(yaw) > 0, robot.name
            # Half a turn to the left and half a turn to the right are the same.
            mirrored = {-yaw, yaw} if abs(yaw) > 3.14 else {-yaw}
            assert seen & {(x, -y, angle) for angle in mirrored}, robot.name


def test_p2at_item_names_that_clients_look_for() -> None:
    """P2AT and P2DX carry names of protocol reference appendix B, at captured intervals."""
    for name in ("P2AT", "P2DX"):
        items = {item.name: item for item in ROBOTS[name].items}
        assert {"Scanner1", "Odometry", "ECLeft", "ECRight", "VictSensor"} <= set(items)
        assert items["GroundTruth"].parameters["interval"] == 0.05
        assert items["INS"].parameters["interval"] == 0.2
        assert items["GPS"].parameters["interval"] == 0.2
    assert {item.name: item for item in ROBOTS["P2AT"].items}["ECRight"].link == "RightFWheel"


def test_p2at_scanner() -> None:
    """Scanner1 is mounted at (0.1439, 0, -0.0920) (robots 1.6)."""
    mount = next(mount for mount in mounts(ROBOTS["P2AT"]) if mount[1] == "Scanner1")
    assert mount[2:] == ((0.1439, 0, -0.092), (0, 0, 0))


def test_gazebo_robots() -> None:
    """The 2015 robots have the prototype's wheels, masses, laser and encoder names (robots 1.8)."""
    at, dx = ROBOTS["pioneer3at_with_sensors"], ROBOTS["pioneer2dx_with_sensors"]
    assert (at.report.wheel_radius, at.report.track_width, at.report.wheel_base) == (
        0.110,
        0.402,
        0.25,
    )
    assert at.report.mass == 20.0
    assert (dx.report.wheel_radius, dx.report.track_width) == (0.11, 0.34)
    assert dx.report.mass == 8.67
    for robot in (at, dx):
        items = {item.name: item for item in robot.items}
        assert items["lms200"].parameters["max_range"] == 10.0
        assert items["lms200"].parameters["min_range"] == 0.08
        assert {"Lwheel", "Rwheel"} <= set(items)
        assert robot.battery is not None
        assert robot.battery.life == 3600


def test_real_p3at_is_the_model_of_the_validation() -> None:
    """P3AT_real has the anchors, masses and limit of robots 4.1."""
    robot = ROBOTS["P3AT_real"]
    assert robot.report.track_width == pytest.approx(2 * 0.197)
    assert robot.report.wheel_base == pytest.approx(2 * 0.1331)
    assert {wheel.radius for wheel in robot.wheels} == {0.11}
    assert {wheel.mass for wheel in robot.wheels} == {0.75}
    assert robot.report.mass == 12.0
    assert robot.drive.max_wheel_speed == robot.report.max_speed == 6.4
    assert robot.model == "P3AT_real"


UDK = {
    *("P3AT", "P3AT_arm", "P3AT_real", "Kenaf", "Nao", "AirRobot"),
    *("BasicSkidRobot", "CasterSkidRobot"),
    *("Kiva4Wheel", "BasicAckermanRobot", "FrontAckerman", "KR60", "KR3", "KR5", "KR6"),
    *("FanucM16", "Fanuc_M16iB20", "Fanuc_Robot_And_Rail", "KUKA_LWR_BOT", "TwoLink"),
    *("ForkliftUDK", "GripperBase", "HandBot", "KinectBot", "ComStation"),
    "ReferenceGPSCoordinate",
}
"""Classes that speak udk at first (protocol reference, addendum); all others speak ut2004."""


DRIVEN = {"skid_steer": {4, 6}, "differential": {2}, "ackerman": {4}, "omni": {4}, "tracked": {2}}
"""How many driven wheels robots on wheels or tracks have."""


@pytest.mark.parametrize("name", ROBOTS)
def test_eras_kinds_and_batteries(name: str) -> None:
    """Every class speaks as its era did, has wheels as its kind needs, and power enough.

    Platforms have neither wheels nor a battery, and the original's Nao has none among its items
    (robots 1.7); STA shows 99999 for them.
    """
    robot = ROBOTS[name]
    assert robot.dialect is (Dialect.UDK if name in UDK else Dialect.UT2004)
    assert robot.description
    assert len(robot.description) <= 110, "one line of a listing"
    assert len(robot.driven_wheels) in DRIVEN.get(robot.kind, {0})
    assert (robot.battery is None) is (robot.kind == "static" or name == "Nao")
    if robot.battery is not None:
        # A client takes 720 s for the full charge of an ARDrone.
        assert robot.battery.life >= (720 if name == "ARDrone" else 1200)
    if robot.wheels:
        assert 0.0 < robot.report.max_speed <= robot.drive.max_wheel_speed
    assert 0.001 <= robot.report.mass < 4000


@pytest.mark.parametrize("name", ["P2AT", "P2DX", "P3AT", "P3DX", "Kenaf", "ATRVJr", "Talon"])
def test_batteries_of_the_original(name: str) -> None:
    """1200 s, unless a source says otherwise (robots 1.6, 2.10)."""
    battery = ROBOTS[name].battery
    assert battery is not None
    assert battery.life == 1200


def test_casters_belong_to_differential_robots() -> None:
    """A pair of driven wheels stands by itself with casters, or balances; others need none."""
    for robot in ROBOTS.values():
        assert bool(robot.casters) is (robot.kind == "differential"), robot.name


@pytest.mark.parametrize("name", ROBOTS)
def test_every_sensor_of_every_robot_can_be_made(name: str) -> None:
    """No shipped file names a sensor type or a parameter that does not exist (robots 1)."""
    robot = ROBOTS[name]
    for item in robot.items:
        context = SensorContext(robot, WORLD, np.random.default_rng(0))
        assert create_sensor(item, context).name == item.name
