"""The robot classes that the measurements write: what the server makes of them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from usarsim_bench.robot_files import (
    BEAMS,
    CAMERA_RATE,
    CAMERA_SCOUT,
    LASER_NAME,
    LASER_PERIOD,
    SCOUT,
    SURVEYOR,
    SURVEYOR_CAMERAS,
    scouts,
    write_scouts,
)
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_roster
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sensors.base import SensorContext, create_sensor
from usarsim_server.sensors.scanners import RangeScanner
from usarsim_server.worlds.loader import find_world, load_world


def described(folder: Path, name: str) -> RobotDescription:
    """A class of the bench, as the server reads it."""
    write_scouts(folder)
    found = load_roster([folder]).find(name)
    assert found is not None
    return found


@pytest.mark.parametrize("name", [SCOUT, CAMERA_SCOUT])
def test_scouts_carry_what_they_are_said_to(tmp_path: Path, name: str) -> None:
    """A laser, eight sonars, odometry, INS and ground truth, and no other sensor."""
    types = Counter(item.type for item in described(tmp_path, name).items)
    assert types == {"SICK": 1, "Sonar": 8, "Odometry": 1, "INS": 1, "GroundTruth": 1}


def test_the_laser_has_its_beams_and_its_period(tmp_path: Path) -> None:
    """The scanner is the one that the section names, also to the server."""
    robot = described(tmp_path, SCOUT)
    world = load_world(find_world("empty"))
    context = SensorContext(robot, world, np.random.default_rng(0))
    (laser,) = (create_sensor(item, context) for item in robot.items if item.type == "SICK")
    assert isinstance(laser, RangeScanner)
    assert (laser.name, laser.beams) == (LASER_NAME, BEAMS)
    assert {laser.interval(dialect) for dialect in Dialect} == {LASER_PERIOD}


def test_cameras(tmp_path: Path) -> None:
    """A scout has none, a camera scout one of the rate told, a surveyor looks all around."""
    assert described(tmp_path, SCOUT).cameras == ()
    (camera,) = described(tmp_path, CAMERA_SCOUT).cameras
    assert camera.rate == CAMERA_RATE
    surveyor = described(tmp_path, SURVEYOR)
    assert surveyor.items == ()
    assert len(surveyor.cameras) == SURVEYOR_CAMERAS
    ahead = [np.array(one.pose.rotate((1.0, 0.0, 0.0))) for one in surveyor.cameras]
    assert np.abs(sum(ahead)).max() < 1e-3
    assert {one.rate for one in surveyor.cameras} == {None}


def test_the_folder_is_gone_afterwards() -> None:
    """The words for the command line name a folder that exists while they are needed."""
    with scouts() as (flag, folder):
        assert flag == "--robots"
        assert {file.stem for file in Path(folder).iterdir()} == {SCOUT, CAMERA_SCOUT, SURVEYOR}
    assert not Path(folder).exists()
