"""Robots with many or fast sensors: their classes, what counts as arrived, the figures."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from usarsim_bench import sensors
from usarsim_bench.crowd import Behaviour, wander
from usarsim_bench.figures import Figure, Plan
from usarsim_bench.recording import Chunk
from usarsim_bench.sensors import (
    BEAMS,
    EVERYTHING,
    LASER,
    SENSOR_TYPES,
    look_around,
    measure_sensors,
    whole_images,
    whole_scans,
    write_classes,
)
from usarsim_bench.server import BenchError, Load, Server
from usarsim_bench.team import TeamTrial
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_roster
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sensors.base import Sensor, SensorContext, create_sensor, sensor_types
from usarsim_server.sensors.scanners import RangeScanner
from usarsim_server.worlds.loader import find_world, load_world


def described(folder: Path, name: str) -> RobotDescription:
    """A class of the bench, as the server reads it."""
    write_classes(folder)
    found = load_roster([folder]).find(name)
    assert found is not None
    return found


def mounted(robot: RobotDescription) -> list[Sensor]:
    """Its sensors, as the server makes them."""
    world = load_world(find_world("empty"))
    context = SensorContext(robot, world, np.random.default_rng(0))
    return [create_sensor(item, context) for item in robot.items]


class TestClasses:
    def test_the_table_has_every_type(self) -> None:
        """The table, which the tool cannot ask the server for, is the registry's."""
        assert sorted(SENSOR_TYPES, key=str.lower) == sensor_types()

    def test_every_type_is_on_board(self, tmp_path: Path) -> None:
        """The robot has what P3AT has and one sensor of each type, and all of them can be made."""
        robot = described(tmp_path, EVERYTHING)
        inherited = load_roster().find("P3AT")
        assert inherited is not None
        own = [(item.type, item.name) for item in inherited.items]
        added = [(item.type, item.name) for item in robot.items[len(own) :]]
        assert [(item.type, item.name) for item in robot.items[: len(own)]] == own
        assert [type_ for type_, _ in added] == list(SENSOR_TYPES)
        assert len({name for _, name in added}) == len(SENSOR_TYPES)
        assert len(mounted(robot)) == len(own) + len(SENSOR_TYPES)

    def test_the_laser_is_fast_and_fine(self, tmp_path: Path) -> None:
        """1081 beams over 270 degrees, 30 m, 20 times a second, in either dialect."""
        *_, laser = mounted(described(tmp_path, LASER))
        assert isinstance(laser, RangeScanner)
        assert laser.beams == BEAMS == 1081
        assert (laser.fov, laser.max_range) == (4.71, 30.0)
        assert all(laser.interval(dialect) == pytest.approx(1 / 20) for dialect in Dialect)


class Listener:
    """Stands for a controller; keeps what is sent."""

    def __init__(self) -> None:
        self.sent: list[str] = []

    def send(self, text: str) -> float:
        """Keep a command."""
        self.sent.append(text)
        return 0.0


def test_looking_around_is_driving_with_an_image_now_and_then() -> None:
    """Every call drives; one of five also has a depth image taken."""
    listener, dice = Listener(), random.Random(3)
    for _ in range(1000):
        look_around(listener, dice)  # type: ignore[arg-type]
    drives = [line for line in listener.sent if line.startswith("DRIVE ")]
    images = [line for line in listener.sent if line == "SET {Type RangeImager} {Opcode SCAN}"]
    assert len(drives) == 1000
    assert len(drives) + len(images) == len(listener.sent)
    assert 150 < len(images) < 250


def scan(name: str, beams: int) -> bytes:
    """A line of a laser."""
    ranges = ",".join(["1.50"] * beams)
    return (
        f"SEN {{Time 1.0000}} {{Type RangeScanner}} {{Name {name}}} {{Resolution 0.0044}} "
        f"{{FOV 4.7100}} {{Range {ranges}}}\r\n"
    ).encode()


def frame(number: int, frames: int = 20, kind: str = "RangeImager") -> bytes:
    """A part of a depth image."""
    return (
        f"SEN {{Time 1.0000}} {{Type {kind}}} {{Name AnyRangeImager}} {{Resolution 320,240}} "
        f"{{FOV 1.0123,0.7854}} {{Frames {frames}}} {{Frame {number}}} {{Range 1.00,2.00,}}\r\n"
    ).encode()


IDLE = (
    b"SEN {Time 1.0000} {Type RangeImager} {Name A} {Resolution 320,240} {Frames 0} {Frame 0}\r\n"
)


class TestArrivals:
    def test_whole_scans_of_the_laser_count(self) -> None:
        """Neither other scanners nor a scan that lacks a beam."""
        chunks = [
            (1.0, scan(LASER, BEAMS)),
            (2.0, scan("lms200", BEAMS)),
            (3.0, scan(LASER, BEAMS - 1)),
            (4.0, scan(LASER, BEAMS) + scan(LASER, BEAMS)),
        ]
        assert whole_scans(chunks) == [1.0, 4.0, 4.0]

    def test_a_scan_arrives_with_its_last_byte(self) -> None:
        """Scans are longer than what one read takes."""
        line = scan(LASER, BEAMS)
        assert whole_scans([(1.0, line[:3000]), (1.5, line[3000:])]) == [1.5]

    def test_an_image_counts_with_its_last_frame(self) -> None:
        """Frames before it do not, nor the reports of an idle camera."""
        chunks = [
            (1.0, frame(0)),
            (2.0, frame(18)),
            (3.0, frame(19)),
            (4.0, IDLE),
            (5.0, frame(19, kind="RangeScanner")),
            (6.0, frame(4, frames=5)),
        ]
        assert whole_images(chunks) == [3.0, 6.0]


def trial(robots: int, factor: float) -> TeamTrial:
    """A trial of 2 s, from 10 to 12."""
    load = Load(0.5, 0.1, 0.0)
    return TeamTrial(robots, factor, factor - 0.01, load, 100.0, 1e4, 2**20, 10.0, 12.0)


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Behaviour, int, float]]:
    """Scans come every 0.1 s, to the second robot every 0.05 s; images every second, to both."""
    seen: list[tuple[str, Behaviour, int, float]] = []

    def fake(
        plan: Plan,
        folder: Path,
        robot_class: str,
        behaviour: Behaviour,
        robots: int,
        seconds: float,
    ) -> tuple[TeamTrial, list[list[Chunk]]]:
        assert (folder / f"{robot_class}.toml").is_file()
        seen.append((robot_class, behaviour, robots, seconds))
        if robot_class == LASER:
            moments = [[10.05 + 0.1 * n / pace for n in range(60)] for pace in (1, 2)]
            chunks = [[(moment, scan(LASER, BEAMS)) for moment in one] for one in moments]
            return trial(robots, 0.9985), chunks
        status = (9.0, b"STA {Time 1.0}\r\n")
        images = [(9.5 + n, frame(19)) for n in range(4)]
        return trial(robots, 0.9995), [[status, *images], images]

    monkeypatch.setattr(sensors, "_watch", fake)
    return seen


def by_name(plan: Plan) -> dict[str, Figure]:
    """The figures of the section by name."""
    return {figure.name: figure for figure in measure_sensors(plan).figures}


class TestMeasurement:
    def test_both_teams_are_watched(self, watched: list[tuple[str, Behaviour, int, float]]) -> None:
        """Four robots for half a minute each, or what is asked for; one team takes images."""
        measure_sensors(Plan())
        measure_sensors(Plan(robots=2, seconds=3.0))
        assert watched == [
            (EVERYTHING, look_around, 4, 30.0),
            (LASER, wander, 4, 30.0),
            (EVERYTHING, look_around, 2, 3.0),
            (LASER, wander, 2, 3.0),
        ]

    @pytest.mark.usefixtures("watched")
    def test_figures_and_aims(self) -> None:
        """Time kept is judged for each team, and the scans of the robot that got the fewest."""
        figures = by_name(Plan(robots=2))
        assert figures["All types: real-time factor, lowest of all robots"].met is True
        assert figures["Lasers: real-time factor, lowest of all robots"].met is False
        scans = figures["Lasers: whole scans of a robot, fewest"]
        assert (scans.value, scans.met) == (10.0, False)
        assert figures["All types: streams of a robot, fewest"].value == 1
        assert figures["All types: depth images of all robots"].value == 2.0
        assert figures["Lasers: processor use of the server"].value == 0.5

    def test_a_class_that_cannot_be_read_is_an_error(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A type that the server does not know ends the measurement with what the server said."""
        monkeypatch.setattr(sensors, "SENSOR_TYPES", ("Crystal Ball",))
        with pytest.raises(BenchError, match="the server did not start"):
            measure_sensors(Plan(robots=1, seconds=1.0, world="empty"))

    def test_the_folder_is_gone_afterwards(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Nothing is left on the disk, even if no server starts."""
        folders: list[Path] = []

        def refuse(world: str, robots: int, command: tuple[str, ...]) -> Server:
            folders.append(Path(command[-1]))
            assert sorted(file.stem for file in folders[-1].iterdir()) == [EVERYTHING, LASER]
            raise BenchError("no server today")

        monkeypatch.setattr(sensors, "Server", refuse)
        with pytest.raises(BenchError, match="today"):
            measure_sensors(Plan())
        assert not folders[0].exists()
