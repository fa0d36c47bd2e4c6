"""Geometric sensors on robots in the shipped worlds, commands in, lines out."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from sensor_fakes import numbers

from usarsim_server.testing import Rehearsal, RehearsedClient

PROBE = """
extends = "P3AT"
description = "a P3AT with everything that measures geometry"
without = ["lms200"]

sensor = [
  { type = "KinectDepth", name = "KinectDepth", position = [0.2, 0, -0.3] },
  { type = "RangeScanner", name = "Fine", position = [0.2, 0, -0.2], fov = 4.7124, \
    resolution = 0.0043633, max_range = 30.0, interval = 0.05 },
  { type = "RangeScanner", name = "OnDemand", position = [0.2, 0, -0.2], interval = 0 },
  { type = "RangeScanner3D", name = "Cloud3D", position = [0.2, 0, -0.3] },
  { type = "LineLaser", name = "Line1", position = [0.2, 0, -0.3] },
  { type = "RotatingPointCloudScanner", name = "Spin1", position = [0.2, 0, -0.3] },
  { type = "ExampleSonarArray", name = "Array1", position = [0.2, 0, -0.85] },
  { type = "BumperArray", name = "Bumper", position = [0.13, 0, 0] },
  { type = "ObjectSensor", name = "Vision1", position = [0.2, 0, -0.1], fov = 0.6 },
  { type = "INU", name = "INU" },
]
"""

WALL = 1.04
"""Distance of the office corridor's wall from its middle, m: 1.1 less half a wall of 12 cm."""

ITEMS = {
    "RangeImager": "KinectDepth",
    "RangeScanner": "Fine",
    "RangeScanner3D": "Cloud3D",
    "LineLaser": "Line1",
    "PCL": "Spin1",
    "TouchArray": "Bumper",
    "ObjectSensor": "Vision1",
    "INU": "INU",
}


class Stage:
    """A world with the robots of one test."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        self.run = rehearsal.run
        self.clients: list[RehearsedClient] = []
        self._rehearsal = rehearsal

    def place(
        self, name: str, x: float, y: float, yaw: float, kind: str = "Probe"
    ) -> RehearsedClient:
        """A robot at a wire location, after its quiet period."""
        client = self._rehearsal.connect()
        self.clients.append(client)
        client.send(
            f"INIT {{ClassName USARBot.{kind}}} {{Name {name}}} {{Location {x},{y},0}} "
            f"{{Rotation 0,0,{yaw}}}"
        )
        self.run(0.3)
        client.take()
        return client


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Robot files: the probe in both dialects."""
    place = tmp_path_factory.mktemp("robots")
    (place / "Probe.toml").write_text(PROBE)
    (place / "OldProbe.toml").write_text('extends = "Probe"\ndialect = "ut2004"\n')
    return place


@pytest.fixture(scope="module")
def building(folder: Path) -> Iterator[Rehearsal]:
    """The office, loaded once."""
    with Rehearsal(world="office", robots=(folder,)) as rehearsal:
        yield rehearsal


@pytest.fixture
def office(building: Rehearsal) -> Iterator[Stage]:
    """The office, without the robots of other tests."""
    stage = Stage(building)
    yield stage
    for client in stage.clients:
        client.close()
    building.run(0.1)


def lines_of(client: RehearsedClient, name: str) -> list[str]:
    """SEN lines of one item since the last look."""
    return [line for line in client.take("SEN") if f"{{Name {name}}}" in line]


def value(line: str, key: str) -> str:
    """Value of a segment."""
    found = re.search(rf"{{{key} ([^}}]*)}}", line)
    assert found is not None, line
    return found[1]


def time_of(line: str) -> float:
    return float(value(line, "Time"))


def objects_in(line: str) -> dict[str, dict[str, str]]:
    """Segments of every object of an ObjectSensor line, by name of the object."""
    entries = line.split("{Object ")[1:]
    return {
        entry.split("}")[0]: {
            key: value(entry, key) for key in ("Location", "Orientation", "HitLoc", "Material")
        }
        for entry in entries
    }


@pytest.mark.parametrize("kind", ["Probe", "OldProbe"])
def test_a_depth_image_of_the_corridor_wall(office: Stage, kind: str) -> None:
    """Robots 78 and protocol 120: idle, 20 frames 0.1 s apart, idle; constant depth.

    The robot looks at the wall squarely, so every pixel has the same depth.
    """
    client = office.place("A", -1.5, 0.0, math.pi / 2, kind)
    office.run(0.3)
    idle = lines_of(client, "KinectDepth")
    assert idle
    assert all("{Frames 0} {Frame 0}" in line and "{Range " not in line for line in idle)

    client.send("SET {Type RangeImager} {Name KinectDepth} {Opcode SCAN}")
    replies = client.take("RES")
    assert len(replies) == (1 if kind == "OldProbe" else 0)
    period = time_of(idle[1]) - time_of(idle[0])
    assert period == pytest.approx(0.1, abs=0.01)
    office.run(2.5)
    lines = lines_of(client, "KinectDepth")
    frames, rest = lines[:20], lines[20:]
    assert [value(line, "Frame") for line in frames] == [str(number) for number in range(20)]
    assert {value(line, "Frames") for line in frames} == {"20"}
    steps = np.diff([time_of(line) for line in frames])
    assert np.allclose(steps, 0.1, atol=0.0101)
    depths = [numbers(value(line, "Range").removesuffix(",")) for line in frames]
    assert [len(frame) for frame in depths] == [12 * 320] * 20
    assert np.allclose(depths, WALL - 0.2, atol=0.011)
    assert np.ptp(depths) <= 0.0101
    assert rest
    assert all("{Frames 0} {Frame 0}" in line for line in rest)


def test_an_interval_of_zero_reports_on_scan_only(office: Stage) -> None:
    """Protocol 121."""
    client = office.place("A", -1.5, 0.0, 0.0)
    office.run(1.0)
    assert lines_of(client, "OnDemand") == []
    for _ in range(2):
        client.send("SET {Type RangeScanner} {Name OnDemand} {Opcode SCAN}")
        assert len(lines_of(client, "OnDemand")) == 1
    office.run(1.0)
    assert lines_of(client, "OnDemand") == []


def test_a_scanner_of_1081_beams_at_20_hz(office: Stage) -> None:
    """A TOML table makes a modern scanner: 270 degrees, a quarter of a degree, every 0.05 s.

    Robots 114 and protocol 122: 20 lines a second, each with 1081 ranges, the walls of
    the corridor where they are.
    """
    client = office.place("A", -1.5, 0.0, 0.0)
    office.run(3.0)
    lines = lines_of(client, "Fine")
    assert len(lines) == 60
    assert np.allclose(np.diff([time_of(line) for line in lines]), 0.05, atol=0.0041)
    ranges = np.array([numbers(value(line, "Range")) for line in lines])
    assert ranges.shape == (60, 1081)
    angles = 4.7124 / 2 - 0.0043633 * np.arange(1081)
    across = ranges[-1] * np.sin(angles)
    assert across[180] == pytest.approx(WALL, abs=0.02)
    assert across[900] == pytest.approx(-WALL, abs=0.02)
    assert ranges.max() <= 30.0


def test_objects_in_front_of_a_robot(office: Stage) -> None:
    """Another robot is known by its label, with its true pose and a point on its hull."""
    eye = office.place("Watcher", -1.5, 0.0, 0.0)
    other = office.place("Scout_7", 0.5, 0.2, 0.5)
    office.run(0.6)
    seen = objects_in(lines_of(eye, "Vision1")[-1])
    truth = lines_of(other, "GndTruth")[-1]
    assert "Scout_7" in seen
    assert "Watcher" not in seen
    scout = seen["Scout_7"]
    assert scout["Material"] == "None"
    assert np.allclose(numbers(scout["Location"]), numbers(value(truth, "Location")), atol=0.011)
    assert numbers(scout["Orientation"])[2] == pytest.approx(0.5, abs=0.02)
    assert math.dist(numbers(scout["HitLoc"])[:2], numbers(scout["Location"])[:2]) < 0.4


def test_a_wall_is_known_by_name_place_and_material(office: Stage) -> None:
    """The fan over the wall that is straight ahead: listed once, its hit point on its face."""
    client = office.place("A", -1.5, 0.0, math.pi / 2)
    office.run(0.6)
    seen = objects_in(lines_of(client, "Vision1")[-1])
    assert list(seen) == ["corridor_7"]
    wall = seen["corridor_7"]
    assert wall["Material"] == "brick"
    assert wall["Location"] == "-1.50,1.10,-1.25"
    assert numbers(wall["HitLoc"])[1] == pytest.approx(WALL, abs=0.011)


def test_a_movable_bin_is_seen_where_it_was_pushed(office: Stage) -> None:
    """Object, material and place of a body that a robot shoves along the corridor."""
    client = office.place("A", -7.3, -0.7, 0.0)
    office.run(0.6)
    before = objects_in(lines_of(client, "Vision1")[-1])["bin_1"]
    assert before["Material"] == "metal"
    assert numbers(before["Location"])[:2] == pytest.approx([-6.6, -0.7], abs=0.02)
    client.send("DRIVE {Left 1.3} {Right 1.3}")
    office.run(6.0)
    after = objects_in(lines_of(client, "Vision1")[-1])["bin_1"]
    assert numbers(after["Location"])[0] > numbers(before["Location"])[0] + 0.1


def test_line_laser_and_point_clouds_agree_about_the_wall(office: Stage) -> None:
    """World points of the line, sensor points of both clouds, ranges of the grid: one plane."""
    client = office.place("A", -1.5, 0.0, math.pi / 2)
    office.run(2.2)
    taken = client.take("SEN")

    def last(name: str) -> list[str]:
        return [line for line in taken if f"{{Name {name}}}" in line]

    line = value(last("Line1")[-1], "Points")
    points = np.array([numbers(point) for point in line[1:-1].split("][")])
    assert points.shape == (120, 3)
    assert np.allclose(points[:, 1], WALL, atol=0.01)
    assert np.allclose(np.diff(points[:, 0]), np.diff(points[:, 0])[0], atol=0.05)

    spins = [re.search(r"{([-0-9.,;]+)}", text) for text in last("Spin1")]
    rows = [np.array([numbers(point) for point in row[1].split(";")]) for row in spins if row]
    assert len(rows) in (11, 12)
    assert all(row.shape == (256, 3) for row in rows)
    # Four of five rows look up or level and see the wall in the middle.
    ahead = np.array([row[128, 0] for row in rows])
    assert np.isclose(ahead, WALL - 0.2, atol=0.02).sum() >= 0.75 * len(rows)
    assert len({row[128, 2] for row in rows}) >= 4

    cloud = re.search(r"{Name Array1} {([-0-9., ]+)}", last("Array1")[-1])
    assert cloud is not None
    grid = np.array([numbers(point) for point in cloud[1].split(" ")])
    assert grid.shape == (900, 3)
    assert np.allclose(grid[:, 0], WALL - 0.2, atol=0.01)


def test_a_3d_scan_of_the_wall(office: Stage) -> None:
    """31 rows of 51 beams every 0.4 s; each range times its direction lies on the wall."""
    client = office.place("A", -1.5, 0.0, math.pi / 2)
    office.run(2.0)
    lines = lines_of(client, "Cloud3D")
    assert len(lines) == 5
    ranges = np.array(numbers(value(lines[-1], "Range"))).reshape(31, 51)
    yaw = 1.0472 / 2 - 0.0209 * np.arange(51)
    pitch = 0.4363 / 2 - 0.0145 * np.arange(31)
    depth = ranges * np.cos(pitch)[:, None] * np.cos(yaw)[None]
    assert np.allclose(depth, WALL - 0.2, atol=0.02)


def test_the_bumper_meets_the_wall(office: Stage) -> None:
    """Robots 104: False in the open, True once the robot has driven into the wall."""
    client = office.place("A", -1.5, 0.6, math.pi / 2)
    office.run(0.3)
    assert {value(line, "Touch") for line in lines_of(client, "Bumper")} == {"False"}
    client.send("DRIVE {Left 1.3} {Right 1.3}")
    office.run(2.0)
    assert value(lines_of(client, "Bumper")[-1], "Touch") == "True"


def test_the_inu_turns_with_the_robot(office: Stage) -> None:
    """Orientation follows the truth within the drift of some degrees."""
    client = office.place("A", -1.5, 0.0, 0.3)
    office.run(1.0)
    client.send("DRIVE {Left 1.0} {Right -1.0}")
    office.run(3.0)
    taken = client.take("SEN")
    truth = [line for line in taken if "{Name GndTruth}" in line][-1]
    unit = [line for line in taken if "{Type INU}" in line][-1]
    assert "Time" not in unit
    assert "Location" not in unit
    turned = numbers(value(truth, "Orientation"))[2]
    assert turned > 0.5
    assert numbers(value(unit, "Orientation"))[2] == pytest.approx(turned, abs=0.25)


@pytest.mark.parametrize("kind", ["Probe", "OldProbe"])
def test_every_streamed_item_answers_both_requests(office: Stage, kind: str) -> None:
    """Protocol 125: one CONF and one GEO line each."""
    client = office.place("A", -1.5, 0.0, 0.0, kind)
    for wire_type, name in ITEMS.items():
        client.take()
        client.send(f"GETCONF {{Type {wire_type}}} {{Name {name}}}")
        client.send(f"GETGEO {{Type {wire_type}}} {{Name {name}}}")
        assert [line.split(" ")[0] for line in client.lines] == ["CONF", "GEO"]
        assert all(f"{{Type {wire_type}}} {{Name {name}" in line for line in client.lines)


@pytest.mark.parametrize("wire_type", ["RangeImager", "ObjectSensor"])
def test_asking_for_a_udk_type_makes_a_udk_client(office: Stage, wire_type: str) -> None:
    """Protocol reference 5.3 signal 3: the answer is already in the other dialect."""
    client = office.place("A", -1.5, 0.0, 0.0, "OldProbe")
    client.send(f"GETGEO {{Type {wire_type}}}")
    (line,) = client.take("GEO")
    assert "{Location " in line
    office.run(0.6)
    assert all(
        line.startswith("SEN {Time ") for line in client.take("SEN") if "{Type Touch" in line
    )


def test_equal_runs_in_the_arena_give_equal_text(folder: Path) -> None:
    """Robots 113: points, depths and objects repeat to the last digit, also while driving."""
    runs = []
    for _ in range(2):
        with Rehearsal(world="arena", robots=(folder,), seed=5) as rehearsal:
            arena = Stage(rehearsal)
            client = arena.place("A", -1.0, 0.0, 0.0)
            other = arena.place("B", 0.5, 0.1, 0.0, "P3AT")
            client.send("DRIVE {Left 1.2} {Right 0.9}")
            other.send("DRIVE {Left -1.0} {Right -1.0}")
            client.send("SET {Type RangeImager} {Opcode SCAN}")
            arena.run(0.9)
            runs.append(client.take("SEN"))
    assert runs[0] == runs[1]
    kinds = {value(line, "Type") for line in runs[0]}
    assert set(ITEMS) <= kinds
    assert any("{Object B}" in line for line in runs[0])
