"""The garage: robots that are let down, watched and driven straight ahead."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from sharing import shipped_robots

from usarsim_doctor.test_drive import Rest, TestDrive, full_speed
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription

ROSTER = shipped_robots()


def robot(name: str) -> RobotDescription:
    """A shipped class."""
    found = ROSTER.find(name)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("name", "speed"),
    [
        ("P2AT", 0.700),  # robots reference 5.2 #22
        ("P3AT", 0.127),  # robots 23
        ("Sedan", 30.0),
        ("Lisa", 0.5),
        ("Kenaf", 0.565),
        ("AirRobot", 2.0),  # robots 1.5
    ],
)
def test_top_speed(name: str, speed: float) -> None:
    """Each kind is told in its own words to go ahead, and watched until it gains no more."""
    with TestDrive(robot(name)) as drive:
        drive.rest()
        assert drive.top_speed() == pytest.approx(speed, rel=0.02)


@pytest.mark.parametrize("name", ["KR60", "Nao", "ERS", "MultiView"])
def test_some_go_nowhere(name: str) -> None:
    """Platforms and machines on legs have no speed, and nothing is wrong with that."""
    with TestDrive(robot(name)) as drive:
        rest = drive.rest()
        assert full_speed(drive.robot) == ""
        assert drive.top_speed() is None
        assert drive.problems(rest, None) == []


def test_rest() -> None:
    """A P2AT stands upright, still, at the height of its file, hardly in the floor (robots 63)."""
    with TestDrive(robot("P2AT")) as drive:
        rest = drive.rest()
    assert rest.height == pytest.approx(0.1993, abs=1e-3)
    assert rest.tilt < math.radians(0.5)
    assert rest.drift < 1e-4
    assert 0.0 < rest.depth < 1e-3


def test_what_floats_stays_where_it_is() -> None:
    """Aircraft and submarines hover at their rest height."""
    for name in ("AirRobot", "Submarine"):
        with TestDrive(robot(name)) as drive:
            assert drive.rest().height == pytest.approx(drive.robot.rest_height, abs=0.01)


@pytest.mark.parametrize(
    ("change", "speed", "words"),
    [
        ({"tilt": 0.5}, 0.7, "leans by 29 degrees"),
        ({"drift": 0.02}, 0.7, "20 mm/s"),
        ({"depth": 0.03}, 0.7, "sinks 30 mm"),
        ({"height": 0.3}, 0.7, "101 mm above"),
        ({"height": 0.1}, 0.7, "99 mm below"),
        ({}, 0.0, "does not move"),
    ],
)
def test_problems(change: dict[str, float], speed: float, words: str) -> None:
    """Each is one line, with a cure."""
    fine = Rest(height=0.1993, tilt=0.0, drift=0.0, depth=0.0003)
    with TestDrive(robot("P2AT")) as drive:
        assert drive.problems(fine, 0.7) == []
        (problem,) = drive.problems(replace(fine, **change), speed)
    assert words in problem.text
    assert problem.cure


def test_all_that_is_carried_answers() -> None:
    """CONF and GEO of robot, sensors, packages, effectors and cameras, in both dialects."""
    with TestDrive(robot("P3AT_arm")) as drive:
        for dialect, package in ((Dialect.UT2004, "MisPkg"), (Dialect.UDK, "Actuator")):
            lines = list(drive.lines(dialect))
            for kind in ("RangeScanner", "Encoder", package, "Gripper", "Camera"):
                for head in ("CONF", "GEO"):
                    found = [line for line in lines if line.startswith(f"{head} {{Type {kind}}}")]
                    assert len(found) == 1, (head, kind)
            reports = drive.reports(dialect)
            assert reports[0].startswith("STA {Type GroundVehicle}")
            assert any(line.startswith("SEN {") for line in reports)


def test_size_and_portrait() -> None:
    """A Sedan is as large as its file says; its picture is not of one colour."""
    with TestDrive(robot("Sedan")) as drive:
        drive.rest()
        assert drive.size() == pytest.approx((4.6, 1.8, 1.45), abs=0.1)
        assert drive.visible()
        picture = drive.portrait(80, 60, "rays")
    assert picture.shape == (60, 80, 3)
    blue = (picture[..., 2].astype(int) > picture[..., 0].astype(int) + 20).mean()
    assert 0.1 < float(blue) < 0.8
    assert np.unique(picture.reshape(-1, 3), axis=0).shape[0] > 20
    with TestDrive(robot("MultiView")) as drive:
        assert not drive.visible()
