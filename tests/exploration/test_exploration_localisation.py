"""Where robots think they are, and what they draw from there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import cv2
import numpy as np
import pytest
from float_rays import FAN, drive, read

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.known_map import FREE, SAFE, WALL, KnownMap
from usarsim_exploration.localisation import (
    Evidence,
    Localiser,
    Mode,
    Pose,
    compose,
    rasterise,
    relative,
)
from usarsim_exploration.localisation.matching import match
from usarsim_exploration.localisation.point_map import PointMap
from usarsim_exploration.localisation.surfaces import surfaces
from usarsim_exploration.worlds import find

OFFICE: list[Cell] = [(22, 51), (126, 80), (136, 140), (210, 148), (210, 51), (22, 51)]
"""60 m through rooms and all along two corridors, and back to where it began."""
REACH = 15.0
Seen = Callable[[int, Pose], Sequence[tuple[float, float]]]


def follow(
    world: Environment,
    poses: Iterable[Pose],
    mode: Mode = "scan-matching",
    *,
    reach: float = REACH,
    turns: float = 1.0,
    every: int = 1,
    robots: Seen = lambda number, pose: (),
    known: int = 9,
    about: float = 0.6,
) -> list[tuple[Pose, Pose]]:
    """True and believed poses; odometry tells 5 % too much way and turns 2 degrees by m.

    Args:
        turns: part of the turns that odometry tells. every: so many updates have one scan.
        robots: in sight. known: how many of these the robot has heard of. about: m around where
            these are for all that it knows.
    """
    random = np.random.Generator(np.random.PCG64(1))
    rows, columns = world.shape
    way: list[tuple[Pose, Pose]] = []
    odometry, last = (0.0, 0.0, 0.0), None
    for number, pose in enumerate(poses):
        if last is None:
            size = columns * world.cell, rows * world.cell
            localiser, last = Localiser(mode, pose, size, reach), pose
        x, y, turn = relative(last, pose)
        far, noise = math.hypot(x, y), random.normal(0.0, 1.0, 3)
        wrong = turn * turns + math.radians(2) * far + 0.03 * far * noise[2]
        moved = x * 1.05 + 0.1 * far * noise[0], y + 0.02 * far * noise[1], wrong
        odometry, last = compose(odometry, moved), pose
        seen = robots(number, pose)
        if number % every:
            way.append((pose, localiser.update(odometry)))
            continue
        ranges = read(world, pose, reach, seen)
        ranges += (ranges < reach) * random.normal(0.0, 0.01, len(ranges))
        believed = localiser.update(odometry, ranges, FAN, [(*one, about) for one in seen[:known]])
        way.append((pose, believed))
    return way


def errors(way: list[tuple[Pose, Pose]]) -> np.ndarray:
    """Distances between true and believed places, m."""
    return np.array([math.dist(pose[:2], other[:2]) for pose, other in way])


def test_a_closed_loop() -> None:
    """EXP-16: below 0.2 m at the end where odometry alone is 24 m off."""
    world = find("office").environment
    poses = list(drive(world, OFFICE, 0.3))
    found = errors(follow(world, poses))
    assert found[-1] < 0.1
    assert found.max() < 0.2
    assert errors(follow(world, poses, "odometry"))[-1] > 5.0


def test_wheels_that_skid() -> None:
    """Odometry of a skidding robot tells half as much turn again, 8 degrees in an update."""
    world = find("lab").environment
    start = find("lab").base
    poses = list(drive(world, [start, *find("lab").starts[-3:-1], start], 0.2))
    assert errors(follow(world, poses, turns=1.49)).max() < 0.2
    assert errors(follow(world, poses, turns=1.49, every=3))[::3].max() < 0.2


def corridor(columns: int, rows: int = 24) -> Environment:
    """Nothing but walls around."""
    walls = np.ones((rows, columns), np.uint8)
    walls[2:-2, 2:-2] = 0
    return Environment("corridor", walls)


def test_along_a_corridor_odometry_counts() -> None:
    """Where walls tell nothing of how far it came; across it and in heading they tell all."""
    poses = [(20 + 0.2 * step, 1.2, 0.0) for step in range(100)]
    way = follow(corridor(900), poses, reach=8.0)
    (x, y, heading), believed = way[-1]
    assert believed[0] - x == pytest.approx(0.05 * 19.8, abs=0.3)
    assert believed[1] == pytest.approx(y, abs=0.1)
    assert believed[2] == pytest.approx(heading, abs=0.02)


def test_in_an_open_hall_odometry_counts() -> None:
    """No wall is in sight."""
    poses = [(20 + 0.2 * step, 30.0, 0.0) for step in range(50)]
    world = corridor(600, 600)
    matched, driven = (
        follow(world, poses, mode, reach=8.0) for mode in ("scan-matching", "odometry")
    )
    assert matched == driven


def test_moving_robots() -> None:
    """One drives ahead all the way and has told where it is; another one that has not crosses."""
    world = find("office").environment
    poses = list(drive(world, OFFICE[:4], 0.2))

    def robots(number: int, pose: Pose) -> list[tuple[float, float]]:
        ahead = poses[min(number + 7, len(poses) - 1)][:2]
        crossing = compose(pose, (2.5, 1.5 * math.sin(number / 6), 0.0))[:2]
        return [ahead, crossing]

    assert errors(follow(world, poses, robots=robots, known=1)).max() < 0.3


def test_robots_that_go_along() -> None:
    """One drives ahead along a corridor, somewhere within 2 m of where it was heard to be.

    What is seen there never becomes a wall: such walls would go along, and say that nothing moves.
    """
    world = find("office").environment
    poses = list(drive(world, [(60, 51), (190, 51)], 0.16))

    def ahead(number: int, pose: Pose) -> list[tuple[float, float]]:
        return [compose(pose, (1.2, 0.4, 0.0))[:2]]

    assert errors(follow(world, poses, robots=ahead, about=2.0)).max() < 0.15


def test_found_again() -> None:
    """Blind while it turns, by odometry that is 40 degrees off then, it knows where it is after."""
    world, base = find("lab").environment, find("lab").base
    x, y = ((place + 0.5) * world.cell for place in base)
    poses = [(x, y, 0.1 * step) for step in range(35)]
    ranges = [read(world, pose, REACH) for pose in poses]
    localiser = Localiser("scan-matching", poses[0], (20.0, 15.0), REACH)
    for number, (pose, one) in enumerate(zip(poses, ranges, strict=True)):
        seen = np.full_like(one, math.nan) if 15 <= number < 30 else one
        believed = localiser.update((0.0, 0.0, 1.49 * pose[2]), seen, FAN)
    assert believed[:2] == pytest.approx(pose[:2], abs=0.05)
    assert math.remainder(believed[2] - pose[2], 2 * math.pi) == pytest.approx(0.0, abs=0.02)


def test_a_post_before_a_wall() -> None:
    """No line goes from one to the other: such a wall would turn the robot that sees it."""
    ranges = 1.0 / np.cos(FAN[60:121])
    ranges[30:32] = 0.6
    _, normals = surfaces(ranges, FAN[60:121], REACH)
    known = np.isfinite(normals[:, 0])
    assert known[:30].all()
    assert known[32:].all()
    assert normals[known] == pytest.approx(np.tile([-1.0, 0.0], (known.sum(), 1)), abs=0.01)


def test_what_fits_elsewhere() -> None:
    """A place that odometry rules out is not taken, however well the scan fits there."""
    across = np.arange(-2.0, 2.0, 0.05)
    points = np.column_stack([np.full(len(across), 2.0), across])
    normals = np.tile([-1.0, 0.0], (len(across), 1))
    walls = PointMap((20.0, 20.0))
    walls.add(points + 10.0, normals)
    walls.prepare(np.array([0.0, 0.0]), np.array([20.0, 20.0]))
    guess = (10.3, 10.0, 0.0)
    near = match(walls, points, normals, guess, (0.1, 0.05))
    assert near.pose == pytest.approx((10.0, 10.0, 0.0), abs=0.02)
    assert near.beams > 70
    assert match(walls, points, normals, guess, (0.05, 0.05)).pose == guess


def test_a_short_wall_tells_how_it_turned() -> None:
    """20 beams on 1 m of a wall, 1 m ahead: robots around hide the rest. Motion is 0.06 rad off."""
    along = np.linspace(-0.5, 0.5, 20)
    points, normals = np.stack([np.ones(20), along], axis=1), np.tile([-1.0, 0.0], (20, 1))
    walls = PointMap((20.0, 20.0))
    walls.add(points + 10.0, normals)
    walls.prepare(np.full(2, 8.0), np.full(2, 12.0))
    found = match(walls, points, normals, (10.0, 10.0, 0.06), (0.017, 0.07))
    assert abs(found.pose[2]) < 0.006


def test_truth_is_taken_as_it_is() -> None:
    """And scans need not be told; the same calls give the same poses."""
    localiser = Localiser("truth", (1.0, 2.0, 0.5), (10.0, 10.0), 8.0)
    assert localiser.update((3.0, 4.0, 1.0)) == (3.0, 4.0, 1.0)
    blind = Localiser("scan-matching", (1.0, 2.0, math.pi / 2), (10.0, 10.0), 8.0)
    blind.update((5.0, 5.0, 0.0))
    assert blind.update((6.0, 5.0, 0.1)) == pytest.approx((1.0, 3.0, math.pi / 2 + 0.1))
    world = find("lab").environment
    poses = list(drive(world, [find("lab").base, find("lab").starts[9]], 0.2))
    assert follow(world, poses) == follow(world, poses)


def test_a_scanner_beside_the_middle() -> None:
    """It looks from where it is mounted."""
    mounted = Localiser("truth", (5.0, 5.0, math.pi / 2), (9.0, 9.0), 8.0, mount=(0.2, 0.1, 0.0))
    assert mounted.scanner == pytest.approx((4.9, 5.2, math.pi / 2))


@pytest.mark.slow
def test_walls_are_drawn_where_they_are() -> None:
    """EXP-16: with noise off no wall that was measured is a cell away from a true one."""
    world = find("lab").environment
    known = KnownMap(world.shape)
    lab = find("lab")
    wrong = beams = 0
    for number, pose in enumerate(drive(world, [lab.base, *lab.starts[-3:]], 0.35)):
        scans = rasterise(pose, read(world, pose, 8.0), FAN, 8.0, 0.1, world.shape)
        known.take_in(number, scans, True)
        for cells, wall in ((scans.free_ends[0], 1), (scans.ends[0, scans.hits[0]], 0)):
            wrong += np.count_nonzero(world.walls[cells[:, 1], cells[:, 0]] == wall)
            beams += len(cells)
    assert wrong < 0.003 * beams
    walls = world.walls != 0
    free, drawn = known.bits & FREE != 0, known.bits & (WALL | SAFE) == WALL | SAFE
    assert np.count_nonzero(free & walls) < 0.005 * np.count_nonzero(free)
    assert np.count_nonzero(drawn & ~walls) < 0.03 * np.count_nonzero(drawn)
    assert not (drawn & ~cv2.dilate(world.walls, np.ones((3, 3), np.uint8)).astype(bool)).any()


def test_what_a_beam_hits() -> None:
    """Nothing beyond the reach, nothing unknown, nobody whose place is known, no edge."""
    ranges = np.full(181, 3.0)
    ranges[[10, 20, 30]] = math.nan, math.inf, 8.0
    scans = rasterise((4.0, 4.0, 0.0), ranges, FAN, 8.0, 0.1, (80, 120), [(7.2, 4.1, 0.5)])
    assert scans.hits[0, [0, 60, 120, 180]].all()
    assert not scans.hits[0, [10, 20, 30, 88, 90, 92]].any()
    assert scans.free_ends[0, 90].tolist() == [70, 40]  # free as far as the robot there
    assert scans.ends[0, 10].tolist() == [40, 40]
    assert scans.ends[0, 20, 1] == 0
    assert scans.readings[0, 60] == pytest.approx(30, abs=1)
    out = rasterise((4.0, 4.0, 0.0), np.full(181, 6.0), FAN, 8.0, 0.1, (80, 120))
    assert not out.hits[0, 0]
    assert out.ends[0, 0].tolist() == [40, 0]
    assert out.hits[0, 90]


def test_walls_that_are_not_there() -> None:
    """EXP-16: beams go through what was seen from a wrong place, soon; through no true wall."""
    world = find("lab").environment
    base = find("lab").base
    known, evidence = KnownMap(world.shape), Evidence(world.shape)
    here = (base[0] + 0.5) * 0.1, (base[1] + 0.5) * 0.1
    ranges = read(world, (*here, 0.0), 8.0)

    def look(x: float) -> np.ndarray:
        """Scan from there and believe to be at x; walls that are certain, then."""
        scans = rasterise((x, here[1], 0.0), ranges, FAN, 8.0, 0.1, world.shape)
        known.take_in(1, scans, True)
        evidence.correct(known, 1, scans)
        return known.bits & (WALL | SAFE) == WALL | SAFE

    assert not look(here[0] - 0.3).any()
    for _ in range(9):
        drawn = look(here[0] - 0.3) & (world.walls == 0)
    assert np.count_nonzero(drawn) > 20
    for number in range(20):
        now = look(here[0])
        if number == 11:
            assert now[drawn].all()
    assert np.count_nonzero(now & drawn) < 0.1 * np.count_nonzero(drawn)
    assert np.count_nonzero(now & (world.walls != 0)) > 40
    rows, columns = np.nonzero(now)
    known.bump(2, (int(columns[0]), int(rows[0])))  # it felt that one
    for _ in range(40):
        look(here[0] + 0.3)
    assert known.bits[rows[0], columns[0]] & WALL
