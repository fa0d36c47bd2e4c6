"""Robots that are told to move and do not: when they count as stuck, and what the log says."""

from __future__ import annotations

import logging

import pytest
from lanes import slow_but

from usarsim_server.base.logs import ROOT
from usarsim_server.sessions.stuck import PATIENCE, PAUSE, StuckWatch
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.testing import Rehearsal, RehearsedClient


def told(watch: StuckWatch, speed: float, seconds: float, start: float, way: float = 0.0) -> int:
    """How often it is told while a robot that goes `way` m/s is seen five times a second."""
    times = [start + 0.2 * n for n in range(round(seconds / 0.2))]
    return sum(watch.see(speed, Pose((way * time, 0.0, 0.0)), time) for time in times)


@pytest.mark.parametrize(
    ("speed", "way", "count"),
    [
        pytest.param(0.1, 0.0, 1, id="wheels turn in front of a wall"),
        pytest.param(0.0, 0.0, 0, id="it rests"),
        pytest.param(0.04, 0.0, 0, id="too slow to say"),
        pytest.param(0.1, 0.02, 0, id="it moves 6 cm in 3 s"),
        pytest.param(0.1, 0.005, 1, id="it moves 1.5 cm in 3 s"),
    ],
)
def test_stuck_means_told_to_move_and_still_there(speed: float, way: float, count: int) -> None:
    """2 cm in 3 s at 0.05 m/s or more."""
    assert told(StuckWatch(), speed, 5.0, 0.0, way) == count


def test_turning_is_a_motion() -> None:
    """A robot that turns on the spot by 3 degrees in 3 s is not stuck."""
    watch = StuckWatch()
    for n in range(50):
        turned = Pose((0.0, 0.0, 0.0), quaternion_from_rpy(0.0, 0.0, 0.02 * n))
        assert not watch.see(0.5, turned, 0.2 * n)


def test_it_is_told_once_a_minute_and_again_when_it_is_over() -> None:
    """A robot that stays stuck is told of every 60 simulated s; `stuck` ends with the DRIVE."""
    watch = StuckWatch()
    assert told(watch, 0.1, PAUSE + PATIENCE, 0.0) == 1
    assert watch.stuck
    assert told(watch, 0.1, PAUSE, PAUSE + PATIENCE) == 1
    watch.see(0.0, Pose(), 3 * PAUSE)
    assert not watch.stuck


class Yard:
    """A server without sockets, and what it logs of robots that are stuck."""

    def __init__(self, stage: Rehearsal, records: list[logging.LogRecord]) -> None:
        self.stage, self._records = stage, records

    def robot(self, kind: str, place: str) -> RehearsedClient:
        """A new robot, two seconds after its INIT."""
        client = self.stage.connect()
        client.send(f"INIT {{ClassName {kind}}} {{Name {kind}}} {{Location {place}}}")
        self.stage.run(2.0)
        return client

    def said(self) -> int:
        """How many log lines tell of robots that do not move."""
        return sum("does not move the robot" in one.getMessage() for one in self._records)


@pytest.mark.parametrize(
    ("kind", "place", "line"),
    slow_but(
        lambda one: one[0] == "P2AT",
        [
            ("P2AT", "0,0,-0.3", "DRIVE {Left 5} {Right 5}"),
            ("Sedan", "-2,0,-0.6", "DRIVE {Speed 3} {FrontSteer 0} {RearSteer 0}"),
            ("Talon", "0,0,-0.3", "DRIVE {Left 5} {Right 5}"),
            ("AirRobot", "0,0,-0.5", "DRIVE {LinearVelocity 1}"),
        ],
    ),
)
def test_a_robot_in_front_of_a_wall_is_told_of(
    kind: str, place: str, line: str, caplog: pytest.LogCaptureFixture
) -> None:
    """A robot that drives into a wall of the office is told of within 5 s, then once a minute."""
    caplog.set_level(logging.WARNING, ROOT)
    with Rehearsal(world="office", max_robots=1) as stage:
        yard = Yard(stage, caplog.records)
        client = yard.robot(kind, place)
        assert yard.said() == 0
        client.send(line)
        for _ in range(40):
            stage.run(1.0)
            client.send(line)
        assert yard.said() == 1
        robots = stage.assembly.robots
        number = robots.vehicles[0].body.number
        assert robots.marks(number) == {"stuck"}


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        ("P3AT", "DRIVE {Left 1} {Right -1}"),
        ("P3AT", "DRIVE {Left 0} {Right 0}"),
        ("P3AT", "DRIVE {Left 0.3} {Right 0.3}"),
        ("AirRobot", "DRIVE {AltitudeVelocity 0} {LinearVelocity 0} {RotationalVelocity 20}"),
        ("AirRobot", "DRIVE {AltitudeVelocity 0} {LinearVelocity 0}"),
        ("KR60", "DRIVE {Left 1} {Right 1}"),
    ],
)
def test_a_robot_that_turns_hovers_or_rests_is_not_stuck(
    kind: str, line: str, caplog: pytest.LogCaptureFixture
) -> None:
    """No false alarm in 20 simulated s."""
    caplog.set_level(logging.WARNING, ROOT)
    with Rehearsal(world="empty", max_robots=1) as stage:
        yard = Yard(stage, caplog.records)
        client = yard.robot(kind, "0,0,-0.5")
        client.send(line)
        stage.run(20.0)
        assert yard.said() == 0
