"""What the shipped robots carry, and objects of maps (robots reference 1.6 to 1.10)."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest
from machine_fakes import ROBOTS

from usarsim_server.base.files import data_directory
from usarsim_server.simulation.frames import wire_from_pose
from usarsim_server.testing import Rehearsal

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
    """Arms and pan-tilts have the ranges, forces and damping of robots 1.9 and 1.10 (robots 12)."""
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
    """0.1745 rad/s in UT2004, 1.571 rad/s in UDK (robots 1.10)."""
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
    """The joints of KR60 stand where robots 1.9 has them, with its masses, tool changer and
    gripper."""
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
    """Pan-tilt at (0.12, 0, -0.2), tilt 0.05 above, 14 kg with it (robots 1.6, 1.10)."""
    robot = ROBOTS["P2AT"]
    (actuator,) = robot.actuators
    assert actuator.name == "CameraPanTilt"
    assert [link.body for link in actuator.links] == ["CameraPanTilt_Link1", "CameraPanTilt_Link2"]
    tilt = wire_from_pose(robot.home_pose("CameraPanTilt_Link2"))
    assert tilt[0] == pytest.approx((0.12, 0, -0.25))
    assert tilt[1] == pytest.approx((0, 0, 0))
    assert robot.report.mass == 14.0


def test_p3at_arm_is_a_p3at_with_an_arm() -> None:
    """The arm stands at (0.1, 0.043724, -0.357424) (robots 1.2.1); everything else is P3AT's."""
    robot, plain = ROBOTS["P3AT_arm"], ROBOTS["P3AT"]
    (actuator,) = robot.actuators
    assert wire_from_pose(actuator.pose)[0] == pytest.approx((0.1, 0.043724, -0.357424))
    assert len(actuator.links) == 5
    assert (robot.shapes, robot.wheels, robot.items) == (plain.shapes, plain.wheels, plain.items)
    assert robot.report.mass == pytest.approx(plain.report.mass + 1.7)


@pytest.mark.parametrize("name", ["MultiView", "ReferenceGPSCoordinate"])
def test_map_objects_are_motionless_and_out_of_the_way(name: str) -> None:
    """What was no robot stands where it is put, measures nothing and is in nobody's way
    (robots 1.1)."""
    robot = ROBOTS[name]
    assert robot.kind == "static"
    assert not robot.items
    assert not robot.cameras
    assert all(not shape.collides and shape.color[3] == 0.0 for shape in robot.shapes)


def test_youbot_and_pr2_are_driven_by_sides() -> None:
    """The manipulators of the bridge obey Left and Right as every robot there did (robots 1.1)."""
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
        *markers, robot = rehearsal.assembly.robots.vehicles
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
