"""Range finder, maps of robots, and what two of them make of each other's."""

import math

import numpy as np
import pytest

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.known_map import AT_BASE, FREE, KNOWN, RELAYED, SAFE, WALL, KnownMap
from usarsim_exploration.sensing import Scanner


def hall(columns: int = 500, rows: int = 500) -> Environment:
    """Nothing in it."""
    return Environment("hall", np.zeros((rows, columns), np.uint8))


def test_a_scan_looks_ahead_in_the_middle() -> None:
    """E-22: 181 values at 1 degree, index 90 along the heading."""
    world = hall()
    world.walls[250, 300:] = 1
    scans = Scanner(world, 100).scan([(250, 250)], [0.0])
    assert scans.readings.shape == (1, 181)
    assert scans.readings[0, 90] == 50.0
    turned = Scanner(world, 100).scan([(250, 250)], [math.radians(30)])
    assert turned.readings[0, 60] == 50.0


def test_readings_in_an_empty_world() -> None:
    """E-23: with a range of 200 each is more than 198 and at most 200."""
    for heading in np.linspace(0, 2 * math.pi, 9):
        readings = Scanner(hall(), 200).scan([(250, 250)], [float(heading)]).readings
        assert (readings > 198).all()
        assert (readings <= 200).all()


def test_a_wall_ahead_and_aside() -> None:
    """E-24: 50 cells ahead, and 50 / cos 30 degrees at index 60."""
    world = hall()
    world.walls[:, 300] = 1
    readings = Scanner(world, 200).scan([(250, 250)], [0.0]).readings[0]
    assert readings[90] == 50.0
    assert readings[60] == pytest.approx(50 / math.cos(math.radians(30)), abs=1.5)


def test_the_edge_of_the_world() -> None:
    """A ray that leaves it ends at the last cell inside, and hit nothing."""
    scans = Scanner(hall(60, 60), 100).scan([(50, 30)], [0.0])
    assert scans.readings[0, 90] == 9.0
    assert not scans.hits.any()
    assert not Scanner(hall(60, 60), 100).scan([(59, 30)], [0.0]).readings[0, 90]


def test_one_scan_is_a_half_disc() -> None:
    """E-26: its area within 2 % of pi R^2 / 2."""
    known = KnownMap((500, 500))
    found = known.look(1, Scanner(hall(), 100), [(250, 250)], [0.0], True)
    assert known.free == pytest.approx(math.pi * 100**2 / 2, rel=0.02)
    assert len(found) == known.free
    assert known.free == np.count_nonzero(known.bits & FREE)


def test_walls_get_thick_away_from_the_robot() -> None:
    """E-27: three cells, never over what is certain."""
    world = hall()
    world.walls[:, 300] = 1
    known = KnownMap(world.shape)
    known.bits[250, 301] = FREE | SAFE
    known.look(1, Scanner(world, 200), [(250, 250)], [0.0], True)
    row = known.bits[251]
    assert row[299] & FREE
    assert row[300] & (WALL | SAFE) == WALL | SAFE
    assert row[301] & WALL
    assert row[302] & WALL
    assert not row[301] & SAFE
    assert not row[303] & KNOWN
    assert known.bits[250, 301] == FREE | SAFE


def test_what_is_certain() -> None:
    """E-28: within a tenth of the range, where all around is known, and where it drove."""
    known = KnownMap((500, 500))
    known.look(1, Scanner(hall(), 100), [(250, 250)], [0.0], True)
    row, column = np.nonzero(known.bits & SAFE)
    away = np.hypot(column - 250, row - 250)
    assert away.max() <= 10.0
    assert known.bits[250, 250] & SAFE
    assert known.bits[250, 259] & SAFE
    assert not known.bits[250, 262] & SAFE
    assert not known.bits[240, 250] & SAFE  # behind it all is unknown


def test_walls_stay_walls() -> None:
    """A certain cell is what it is: driving about in rooms makes no wall free for sure."""
    random = np.random.default_rng(5)
    world = Environment("rubble", (random.random((120, 160)) < 0.02).astype(np.uint8))
    scanner, known = Scanner(world, 60), KnownMap(world.shape)
    free = [(c, r) for r in range(120) for c in range(160) if not world.walls[r, c]]
    for step in range(1, 60):
        cell: Cell = free[int(random.integers(len(free)))]
        known.look(step, scanner, [cell], [float(random.random() * 6.3)], True)
    sure_free = known.bits & (FREE | SAFE) == FREE | SAFE
    sure_wall = known.bits & (WALL | SAFE) == WALL | SAFE
    assert not world.walls[sure_free].any()
    assert world.walls[sure_wall].all()
    assert sure_free.sum() > 1000
    assert sure_wall.sum() > 50


TABLE = [
    (FREE | SAFE, own, FREE | SAFE) for own in (0, FREE, WALL, FREE | SAFE, WALL | SAFE)
] + [
    (WALL | SAFE, FREE | SAFE, FREE | SAFE),
    (WALL | SAFE, 0, WALL | SAFE),
    (WALL | SAFE, FREE, WALL | SAFE),
    (WALL | SAFE, WALL, WALL | SAFE),
    (FREE, FREE | SAFE, FREE | SAFE),
    (FREE, WALL | SAFE, WALL | SAFE),
    (FREE, 0, FREE),
    (FREE, FREE, FREE),
    (FREE, WALL, WALL),
    (WALL, FREE | SAFE, FREE | SAFE),
    (WALL, FREE, FREE),
    (WALL, 0, WALL),
    (WALL, WALL, WALL),
]  # fmt: skip


@pytest.mark.parametrize(("told", "own", "result"), TABLE)
def test_the_table_of_merging(told: int, own: int, result: int) -> None:
    """E-29: all rows of exploration 6.4, in both directions."""
    known = KnownMap((1, 2))
    known.merge(1, np.array([0]), np.array([own], np.uint8))
    if own:
        assert known.bits[0, 0] == own
    known.merge(2, np.array([0]), np.array([told], np.uint8))
    assert known.bits[0, 0] == result
    assert known.bits[0, 1] == 0


def test_marks_are_inherited() -> None:
    """At base always, relayed only by cells that were unknown (exploration 6.4)."""
    known = KnownMap((1, 2))
    known.merge(1, np.array([0]), np.array([FREE], np.uint8))
    known.merge(2, np.array([0, 1]), np.full(2, FREE | RELAYED, np.uint8))
    assert known.bits.tolist() == [[FREE, FREE | RELAYED]]
    assert (known.free, known.relayed, known.undelivered) == (2, 1, 1)
    known.merge(3, np.array([1]), np.array([FREE | AT_BASE], np.uint8))
    assert (known.at_base, known.relayed, known.undelivered) == (1, 0, 1)


def test_counters_and_journal() -> None:
    """E-31: after 500 random operations both tell what a recount tells."""
    random = np.random.default_rng(3)
    known = KnownMap((20, 20))
    copies = {0: known.bits.copy()}
    for step in range(1, 501):
        cells = np.unique(random.integers(0, 400, 12))
        if step % 3:
            bits = random.choice([0, 1, 3, 4, 6, 9, 11, 17, 19], len(cells)).astype(np.uint8)
            known.merge(step, cells, bits)
        else:
            there = cells[known.news(cells) & KNOWN != 0]
            known.mark(step, there, int(random.choice([AT_BASE, RELAYED])))
        copies[step] = known.bits.copy()
    bits = known.bits
    assert known.free == np.count_nonzero(bits & FREE)
    assert known.at_base == np.count_nonzero(bits & (FREE | AT_BASE) == FREE | AT_BASE)
    carried = bits & (FREE | AT_BASE | RELAYED) == FREE | RELAYED
    assert known.relayed == np.count_nonzero(carried)
    known.bump(501, (int(np.flatnonzero(bits & FREE)[0]) % 20, 0))  # felt walls are counted, too
    assert known.free == np.count_nonzero(bits & FREE)
    known.merge(502, np.array([5]), np.array([FREE], np.uint8))
    for since in (0, 250, 490, 500):
        differ = set(np.flatnonzero(copies[since] != bits).tolist())
        assert differ <= set(known.changed_since(since).tolist())
    assert not len(known.changed_since(502))
