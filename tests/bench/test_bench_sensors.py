"""Classes that the measurements write, teams of every kind of robot and sensor, what counts as
arrived.
"""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bench_fakes import FakeServer, Nobody, StandIn, a_trial, by_name

from usarsim_bench import sensors, team
from usarsim_bench import team as garage
from usarsim_bench.crowd import Behaviour, Crowd, wander
from usarsim_bench.figures import Plan
from usarsim_bench.recording import Chunk
from usarsim_bench.robot_files import (
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
from usarsim_bench.server import BenchError, Server
from usarsim_bench.team import MIXED, TeamTrial, measure_garage, roam
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sensors.base import Sensor, SensorContext, create_sensor, sensor_types
from usarsim_server.sensors.scanners import RangeScanner
from usarsim_server.testing import Rehearsal
from usarsim_server.testing.sharing import shipped_robots
from usarsim_server.worlds.loader import find_world, load_world

KINDS = {"skid_steer", "differential", "tracked", "ackerman", "omni", "aerial", "legged", "static"}


def test_the_team_is_mixed() -> None:
    """Sixteen shipped classes of all kinds that a land world has room for, some with arms."""
    catalog = shipped_robots()
    robots = [catalog.find(name) for name in MIXED]
    assert len(robots) == team.ROBOTS
    assert {robot.kind for robot in robots if robot is not None} == KINDS
    assert sum(any(one.package for one in robot.actuators) for robot in robots if robot) >= 3


@pytest.mark.parametrize("name", MIXED)
def test_commands_move_the_robot(name: str) -> None:
    """What the measurement sends is obeyed: wheels, rotors, legs, flippers or arms move."""
    dice = random.Random(1)
    with Rehearsal(world="empty", max_robots=1) as rehearsal:
        client = rehearsal.connect()
        client.send(f"INIT {{ClassName USARBot.{name}}} {{Location 0,0,-1.0}}")
        rehearsal.run(1.5)
        (vehicle,) = rehearsal.assembly.robots.vehicles
        before = vehicle.body.look()
        assert before is not None
        for _ in range(3):
            client.send(MIXED[name](dice))
            rehearsal.run(0.3)
        after = vehicle.body.look()
        assert after is not None
        moved = np.abs(after.snapshot.qpos - before.snapshot.qpos).max()
    assert moved > 0.02


def test_classes_join_in_turn_and_are_told_their_own_words(monkeypatch: pytest.MonkeyPatch) -> None:
    """More robots than classes begin anew; the words go to the robots of the class."""
    monkeypatch.setattr(team, "SETTLE", 1.5)
    monkeypatch.setattr(team, "WINDOW", 0.3)
    with FakeServer() as server, Crowd(server.port, 0, roam) as crowd:
        classes = ("Lisa", "KUKA_LWR_BOT", "Unknown")
        team.try_team(StandIn(), crowd, 4, 0.6, classes)  # type: ignore[arg-type]
        inits = server.commands("INIT")
        told = server.commands("DRIVE") + server.commands("MISPKG")
    assert [line.split("USARBot.")[1].split("}")[0] for line in inits] == [*classes, "Lisa"]
    assert any("WheelNumber" in line for line in told)
    assert any(line.startswith("MISPKG {Name kuka_lwr}") for line in told)
    assert any("{Left " in line for line in told), "strangers are told what most understand"


def test_it_is_a_measurement_with_aims(monkeypatch: pytest.MonkeyPatch) -> None:
    """`bench garage` asks for real time with the mixed classes, and reports against aims."""
    asked: list[object] = []

    def fake(
        server: object, crowd: Crowd, robots: int, seconds: float, classes: tuple[str, ...]
    ) -> team.TeamTrial:
        asked.append((robots, seconds, classes))
        return a_trial(robots, 0.9995)

    monkeypatch.setattr(garage, "try_team", fake)
    monkeypatch.setattr(garage, "Server", Nobody)
    monkeypatch.setattr(garage, "Crowd", Nobody)
    section = measure_garage(Plan(seconds=5.0))
    assert asked == [(16, 5.0, tuple(MIXED))]
    assert section.key == "garage"
    assert section.figures[0].value == 0.9995
    assert section.figures[0].met


def described(folder: Path, name: str) -> RobotDescription:
    """A class of the bench, as the server reads it."""
    write_classes(folder)
    write_scouts(folder)
    found = load_catalog([folder]).find(name)
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
        inherited = shipped_robots().find("P3AT")
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


def test_looking_around_is_driving_with_an_image_now_and_then() -> None:
    """Every call drives; one of five also has a depth image taken."""
    sent: list[str] = []
    listener, dice = SimpleNamespace(send=sent.append), random.Random(3)
    for _ in range(1000):
        look_around(listener, dice)  # type: ignore[arg-type]
    drives = [line for line in sent if line.startswith("DRIVE ")]
    images = [line for line in sent if line == "SET {Type RangeImager} {Opcode SCAN}"]
    assert len(drives) == 1000
    assert len(drives) + len(images) == len(sent)
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
            return a_trial(robots, 0.9985), chunks
        status = (9.0, b"STA {Time 1.0}\r\n")
        images = [(9.5 + n, frame(19)) for n in range(4)]
        return a_trial(robots, 0.9995), [[status, *images], images]

    monkeypatch.setattr(sensors, "_watch", fake)
    return seen


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
        figures = by_name(measure_sensors(Plan(robots=2)))
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


@pytest.mark.parametrize("name", [SCOUT, CAMERA_SCOUT])
def test_scouts_carry_what_they_are_said_to(tmp_path: Path, name: str) -> None:
    """A laser, eight sonars, odometry, INS and ground truth, and no other sensor."""
    types = Counter(item.type for item in described(tmp_path, name).items)
    assert types == {"SICK": 1, "Sonar": 8, "Odometry": 1, "INS": 1, "GroundTruth": 1}


def test_the_laser_has_its_beams_and_its_period(tmp_path: Path) -> None:
    """The scanner is the one that the section names, also to the server."""
    (laser,) = (one for one in mounted(described(tmp_path, SCOUT)) if isinstance(one, RangeScanner))
    assert (laser.name, laser.beams) == (LASER_NAME, 181)
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
