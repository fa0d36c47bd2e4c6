"""The shipped robots say what the robots reference says."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest

from usarsim_server.data import data_directory
from usarsim_server.protocol.messages import ground_configuration, ground_geometry
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_roster
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sensors.base import SensorContext, create_sensor
from usarsim_server.simulation.frames import wire_from_pose
from usarsim_server.testing import Rehearsal
from usarsim_server.worlds.description import WorldDescription

ROBOTS = {robot.name: robot for robot in load_roster().descriptions()}
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
    """P3AT GEO: Dimensions 0.2480,0.3600,0; 0.0980; 0.3600; 0.2480 (5.1 #4)."""
    line = geo("P3AT")
    assert "{Dimensions 0.2480,0.3600,0" in line
    assert "{WheelRadius 0.0980}" in line
    assert "{WheelSeparation 0.3600}" in line
    assert "{WheelBase 0.2480}" in line


def test_p3at_conf_prints_as_captured() -> None:
    """P3AT CONF: SkidSteered, Mass 11.9000, MaxSpeed 1.2999, MaxTorque 50000 (5.1 #5)."""
    line = conf("P3AT", Dialect.UDK)
    assert "{SteeringType SkidSteered}" in line
    assert "{Mass 11.9000}" in line
    assert "{MaxSpeed 1.2999}" in line
    assert "{MaxTorque 50000.0000}" in line
    assert ROBOTS["P3AT"].drive.max_wheel_speed == 1.3


def test_p2at_geo_and_conf_print_as_captured() -> None:
    """P2AT GEO and CONF carry the captured figures (5.1 #6)."""
    line = geo("P2AT")
    assert "{Dimensions 0.5238,0.4968,0.2913} {COG 0.0000,0.0000,0.0000}" in line
    assert "{WheelRadius 0.1300} {WheelSeparation 0.4712} {WheelBase 0.2884}" in line
    line = conf("P2AT", Dialect.UT2004)
    assert "{SteeringType SkidSteered} {Mass 14.0000} {MaxSpeed 5.3850}" in line
    assert "{MaxTorque 60.0000} {MaxFrontSteer 0.0000} {MaxRearSteer 0.0000}" in line


def test_p2at_top_speed() -> None:
    """P2AT's wheel limit times its radius is the 0.700 m/s of 1.2."""
    robot = ROBOTS["P2AT"]
    assert robot.drive.max_wheel_speed * robot.report.wheel_radius == pytest.approx(0.700, abs=5e-4)


def test_p3at_default_items_in_order() -> None:
    """P3AT carries the items of 1.2.1 with their poses in that order (5.1 #14)."""
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
    """Sonars F1..F8, on P2AT then R1..R8, are where 1.6 says; left ones have negative y (#15)."""
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
    """Scanner1 is mounted at (0.1439, 0, -0.0920) (1.6)."""
    mount = next(mount for mount in mounts(ROBOTS["P2AT"]) if mount[1] == "Scanner1")
    assert mount[2:] == ((0.1439, 0, -0.092), (0, 0, 0))


def test_gazebo_robots() -> None:
    """The 2015 robots have the prototype's wheels, masses, laser and encoder names (1.8)."""
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
    """P3AT_real has the anchors, masses and limit of 4.1."""
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
    (1.7); STA shows 99999 for them.
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
    """1200 s, unless a source says otherwise (1.6, 2.10)."""
    battery = ROBOTS[name].battery
    assert battery is not None
    assert battery.life == 1200


def test_casters_belong_to_differential_robots() -> None:
    """A pair of driven wheels stands by itself with casters, or balances; others need none."""
    for robot in ROBOTS.values():
        assert bool(robot.casters) is (robot.kind == "differential"), robot.name


@pytest.mark.parametrize("name", ROBOTS)
def test_every_sensor_of_every_robot_can_be_made(name: str) -> None:
    """No shipped file names a sensor type or a parameter that does not exist (5.1 #1)."""
    robot = ROBOTS[name]
    for item in robot.items:
        context = SensorContext(robot, WORLD, np.random.default_rng(0))
        assert create_sensor(item, context).name == item.name


SHIPPED = sorted(data_directory("robots").glob("*.toml"), key=lambda path: path.name.lower())
SOURCE = re.compile(r"reference|starting value|\[[A-Z]\]", re.IGNORECASE)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_files_state_their_frame_and_sources(path: Path) -> None:
    """A file says at its head what it is, in which frame its poses are, whence its figures come."""
    text = path.read_text(encoding="utf-8")
    head = "\n".join(itertools.takewhile(lambda line: line.startswith("#"), text.splitlines()))
    assert head.startswith("# "), "a comment stands first"
    if "position" in text:
        assert "Frame of this file: x forward, y right, z down" in head
        assert "metres, radians" in head
    if re.search(r"^[^#]*= *[\[{]* *-?\d", text, re.MULTILINE):
        assert SOURCE.search(text), "figures without a source"


LIMITS = {
    "KR60": [
        ("Revolute", (-3.14, 3.14), 600, 100),
        ("Revolute", (-2.356, 0.61), 1500, 200),
        ("Revolute", (-2.094, 2.757), 700, 100),
        ("Revolute", (-3.14, 3.14), 100, 10),
        ("Revolute", (-2.076, 2.076), 60, 5),
        ("Revolute", (-3.14, 3.14), 25, 5),
    ],
    "TwoLink": [("Revolute", (-2.967, 2.967), 50000, 0.25)],
    "P2AT": [("Revolute", None, 20, 0), ("Revolute", (-0.7854, 0.7854), 20, 0)],
}


@pytest.mark.parametrize("name", LIMITS)
def test_joints_have_the_ranges_of_the_reference(name: str) -> None:
    """Arms and pan-tilts have the ranges, forces and damping of 1.9 and 1.10 (5.1 #12)."""
    (actuator,) = ROBOTS[name].actuators
    assert [
        (link.type.value, link.limits, link.max_torque, link.damping) for link in actuator.links
    ] == LIMITS[name]


@pytest.mark.parametrize(
    ("name", "speed"),
    [("P2AT", 0.1745), ("AirRobot", 1.571), ("KR60", 1.571), ("TwoLink", 1.571)]
    + [(name, 1.571) for name in ("Fanuc_M16iB20", "KUKA_LWR_BOT", "KinectBot", "Kiva4Wheel")],
)
def test_packages_move_as_fast_as_their_era_announced(name: str, speed: float) -> None:
    """0.1745 rad/s in UT2004, 1.571 rad/s in UDK (1.10)."""
    links = [link for one in ROBOTS[name].actuators if one.package for link in one.links]
    assert {link.max_speed for link in links} == {speed}


def test_every_joint_can_move() -> None:
    """Joints have speed, force and room to move; where they appear is within their limits."""
    for robot in ROBOTS.values():
        for link in robot.links:
            assert link.max_speed > 0.0, (robot.name, link.joint)
            assert link.max_torque > 0.0, (robot.name, link.joint)
            low, high = link.limits or (-math.inf, math.inf)
            assert low < high, (robot.name, link.joint)
            assert low <= link.home <= high, (robot.name, link.joint)


def test_kr60_anchors_and_masses() -> None:
    """The joints of KR60 stand where 1.9 has them, with its masses, tool changer and gripper."""
    robot = ROBOTS["KR60"]
    links = robot.actuators[0].links
    anchors = [wire_from_pose(robot.home_pose(link.body))[0] for link in links]
    assert np.round(anchors, 3).tolist() == [
        [0.070, 0.01, -0.413],
        [0.494, -0.2, -0.796],
        [0.490, -0.14, -1.801],
        [0.981, 0.022, -1.97],
        [1.473, 0.09, -1.97],
        [1.625, 0.02, -1.97],
    ]
    masses = [link.mass for link in links]
    assert masses == pytest.approx([1, 0.5, 0.2, 0.1, 0.05, 0.025])
    changer, gripper = robot.effectors
    place = robot.home_pose(changer.item.link) @ changer.item.pose
    assert wire_from_pose(place)[0] == pytest.approx((1.69, 0.02, -1.97))
    assert wire_from_pose(place)[1][1] == pytest.approx(1.5708, abs=1e-3)
    assert (changer.name, gripper.name) == ("toolchange", "KR60gripper")
    assert gripper.detached
    assert gripper.mass == 1.5


def test_p2at_carries_its_camera_on_the_pan_tilt() -> None:
    """Pan-tilt at (0.12, 0, -0.2), tilt 0.05 above, 14 kg with it (1.6, 1.10)."""
    robot = ROBOTS["P2AT"]
    (actuator,) = robot.actuators
    assert actuator.name == "CameraPanTilt"
    assert [link.body for link in actuator.links] == ["CameraPanTilt_Link1", "CameraPanTilt_Link2"]
    tilt = wire_from_pose(robot.home_pose("CameraPanTilt_Link2"))
    assert tilt[0] == pytest.approx((0.12, 0, -0.25))
    assert tilt[1] == pytest.approx((0, 0, 0))
    assert robot.report.mass == 14.0


def test_p3at_arm_is_a_p3at_with_an_arm() -> None:
    """The arm stands at (0.1, 0.043724, -0.357424) (1.2.1); everything else is P3AT's."""
    robot, plain = ROBOTS["P3AT_arm"], ROBOTS["P3AT"]
    (actuator,) = robot.actuators
    assert wire_from_pose(actuator.pose)[0] == pytest.approx((0.1, 0.043724, -0.357424))
    assert len(actuator.links) == 5
    assert (robot.shapes, robot.wheels, robot.items) == (plain.shapes, plain.wheels, plain.items)
    assert robot.report.mass == pytest.approx(plain.report.mass + 1.7)


@pytest.mark.parametrize("name", ["MultiView", "ReferenceGPSCoordinate"])
def test_map_objects_are_motionless_and_out_of_the_way(name: str) -> None:
    """What was no robot stands where it is put, measures nothing and is in nobody's way (1.1)."""
    robot = ROBOTS[name]
    assert robot.kind == "static"
    assert not robot.items
    assert not robot.cameras
    assert all(not shape.collides and shape.color[3] == 0.0 for shape in robot.shapes)


def test_youbot_and_pr2_are_driven_by_sides() -> None:
    """The manipulators of the bridge obey Left and Right as every robot there did (1.1)."""
    youbot, pr2 = ROBOTS["youBot"], ROBOTS["PR2"]
    assert (youbot.report.wheel_radius, youbot.report.track_width) == (0.0475, 0.30)
    assert youbot.report.wheel_base == 0.471
    assert youbot.report.dimensions[:2] == (0.58, 0.376)
    assert [len(arm.links) for arm in youbot.actuators] == [5]
    assert pr2.report.dimensions[:2] == (0.65, 0.65)
    assert {one.name: len(one.links) for one in pr2.actuators} == {
        "Torso": 1,
        "Head": 2,
        "LaserTilt": 1,
        "LeftArm": 7,
        "RightArm": 7,
    }


def test_nobody_notices_a_map_object() -> None:
    """A robot spawns in the middle of one, drives through it, and its laser looks through it."""
    with Rehearsal(world="empty", max_robots=4) as rehearsal:
        for place in ("0,0,-0.1", "1.0,0,-0.26", "2.0,0,-0.26"):
            rehearsal.connect().send(f"INIT {{ClassName USARBot.MultiView}} {{Location {place}}}")
        client = rehearsal.connect()
        client.send("INIT {ClassName USARBot.P2AT} {Location 0,0,-0.25}")
        rehearsal.run(1.0)
        *markers, robot = rehearsal.assembly.fleet.vehicles
        before = [marker.body.look() for marker in markers]
        scan = next(line for line in client.take("SEN") if "{Type RangeScanner}" in line)
        ranges = re.search(r"\{Range ([^}]+)\}", scan)
        assert ranges is not None
        assert len(set(ranges[1].split(","))) == 1, "nothing but the largest range"
        client.send("DRIVE {Left 5} {Right 5}")
        rehearsal.run(4.0)
        state = robot.body.look()
        assert state is not None
        assert state.pose.position[0] > 2.3
        assert abs(state.pose.position[1]) < 0.01
        for marker, old in zip(markers, before, strict=True):
            new = marker.body.look()
            assert old is not None
            assert new is not None
            assert new.pose == old.pose
