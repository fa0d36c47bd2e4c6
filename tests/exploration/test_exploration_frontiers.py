"""Where the unknown begins, and who goes there."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from usarsim_exploration.bidding import Bidding
from usarsim_exploration.cycle import Member, set_up
from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.frontiers import find_frontiers
from usarsim_exploration.known_map import FREE, SAFE, WALL, KnownMap
from usarsim_exploration.planning import Planner
from usarsim_exploration.radio import RadioEstimate
from usarsim_exploration.radio.families.ranges import Circle
from usarsim_exploration.strategies.frontier import FrontierStrategy
from usarsim_exploration.strategies.nearest import Nearest
from usarsim_exploration.strategy import Teammate, View


def room(*doors: slice, rows: int = 20, columns: int = 41) -> KnownMap:
    """A room with walls around; doors: rows of the left and the right wall that are open."""
    known = KnownMap((rows, columns))
    known.bits[2 : rows - 2, 2 : columns - 2] = FREE | SAFE
    for side in (slice(2, 3), slice(columns - 3, columns - 2)):
        known.bits[2 : rows - 2, side] = WALL | SAFE
    known.bits[2], known.bits[rows - 3] = WALL | SAFE, WALL | SAFE
    for column, door in zip((2, columns - 3), doors, strict=False):
        known.bits[door, column] = FREE
    return known


def view(known: KnownMap, cell: Cell, number: int = 1, **mates: Cell) -> View:
    """What a robot sees at step 1000; mates: `r2=(column, row)`, heard right now."""
    found = View(
        number, f"r{number}", "explorer", 0, None, 3.0, 100, (10, 10), cell, 0.0, known,
        Planner(known), RadioEstimate(Circle(), known, 200.0, 0.1), np.random.default_rng(1),
        step=1000,
    )  # fmt: skip
    for name, place in mates.items():
        mate = Teammate(int(name[1:]), name, "explorer", 3.0, place, heard=1000)
        found.teammates[mate.number] = mate
    return found


def chosen(bidding: Bidding, one: View) -> Cell | None:
    """Where a robot goes."""
    aim = bidding.choose(one, bidding.aims(one, find_frontiers(one.known)))
    return aim and aim.cell


@pytest.mark.parametrize("uncertain", [False, True])
def test_a_door_is_a_frontier(uncertain: bool) -> None:
    """E-50: its five cells, once up and once down: no area, a length of 8, centre in the middle."""
    known = room(slice(0, 0), slice(8, 13))
    found = find_frontiers(known, uncertain=uncertain)
    assert [(one.centre, one.size) for one in found] == [((38, 10), 8.0)]
    assert set(map(tuple, found[0].outline.tolist())) == {(38, row) for row in range(8, 13)}
    assert set(map(tuple, found[0].openings.tolist())) == {(38, row) for row in range(8, 13)}


def test_a_closed_room_has_none() -> None:
    """E-51; and a gap of one cell is too small to go there."""
    assert not find_frontiers(room())
    assert not find_frontiers(room(slice(8, 9)))


def test_what_was_only_seen_may_count() -> None:
    """In a room that was seen from a door, by MRESim's rule only."""
    known = room(slice(0, 0), slice(8, 13))
    known.bits[3:17, 20:38] = FREE
    assert find_frontiers(known)[0].size == 8.0
    assert find_frontiers(known, uncertain=True)[0].size > 200.0


def test_two_robots_two_doors() -> None:
    """E-52: each to the nearer one, whoever plans first; one that is alone to its own."""
    known = room(slice(8, 13), slice(8, 13))
    left, right = (8, 10), (35, 10)
    for one, other in ((left, right), (right, left)):
        first = chosen(Bidding(), view(known, one, 1, r2=other))
        second = chosen(Bidding(), view(known, other, 2, r1=one))
        assert (first, second) == tuple((2, 10) if at == left else (38, 10) for at in (one, other))
    assert chosen(Bidding(), view(known, (12, 10), 2, r1=left)) == (38, 10)
    assert chosen(Bidding(), view(known, (12, 10))) == (2, 10)


def test_two_in_one_place_part() -> None:
    """E-52: by ways, not by distances, so that each expects of the other what that one does."""
    known = room(slice(8, 13), slice(8, 13), rows=60)
    known.bits[2:50, 10] = WALL | SAFE  # a long way round to the left door
    cell = (20, 10)
    assert chosen(Bidding(), view(known, cell, 1, r2=cell)) == (38, 10)
    assert chosen(Bidding(), view(known, cell, 2, r1=cell)) == (2, 10)


def test_a_robot_keeps_to_its_frontier() -> None:
    """EXP-18: until another one is nearer than half of what is left of the way."""
    one, strategy = view(room(slice(8, 13), slice(8, 13)), (18, 10)), Nearest()
    for cell, goal in (((18, 10), (2, 10)), ((22, 10), (2, 10)), ((30, 10), (38, 10))):
        one.cell, one.step = cell, one.step + strategy.replan
        plan = strategy.decide(one)
        assert plan is not None
        assert plan.goal == goal


def test_three_robots_one_door() -> None:
    """E-53: all go. With two doors the third one goes where nobody of the next round goes,
    or, without keep_assigning, to the one that is best for itself.
    """
    one_door = room(slice(0, 0), slice(8, 13))
    places: Mapping[str, Cell] = {"r1": (30, 10), "r2": (20, 10), "r3": (10, 10)}
    for keep in (True, False):
        for name, cell in places.items():
            mates = {mate: at for mate, at in places.items() if mate != name}
            seen = view(one_door, cell, int(name[1:]), **mates)
            assert chosen(Bidding(keep_assigning=keep), seen) == (38, 10)
    two_doors = room(slice(8, 13), slice(8, 13))
    at_doors = {"r1": (36, 10), "r2": (4, 10), "r3": (24, 10)}
    seen = view(two_doors, (22, 10), 4, **at_doors)
    assert chosen(Bidding(keep_assigning=True), seen) == (2, 10)
    assert chosen(Bidding(keep_assigning=False), seen) == (38, 10)


def test_silent_teammates_stop_bidding() -> None:
    """E-54: after 500 steps, not after 499."""
    known = room(slice(8, 13), slice(8, 13))
    seen = view(known, (12, 10), 1, r2=(8, 10))
    seen.teammates[2] = replace(seen.teammates[2], heard=seen.step - 499)
    assert chosen(Bidding(500), seen) == (38, 10)
    seen.teammates[2] = replace(seen.teammates[2], heard=seen.step - 500)
    assert chosen(Bidding(500), seen) == (2, 10)


def test_what_cannot_be_reached_is_told() -> None:
    """E-55: until a way there is known."""
    known = room(slice(8, 13), slice(8, 13))
    known.bits[:, 30] = WALL | SAFE
    bidding, other = Bidding(), Bidding()
    assert chosen(bidding, view(known, (20, 10))) == (2, 10)
    assert bidding.unreachable == {(38, 10)}
    other.hear([bidding.letter()])
    assert other.unreachable == {(38, 10)}
    known.bits[10, 30] = FREE
    assert chosen(other, view(known, (20, 10))) == (2, 10)
    assert not other.unreachable


def test_a_frontier_that_stays_is_left() -> None:
    """EXP-18: who stands there turns to it once, and then tells others that it is for nothing."""
    known = room(slice(8, 13))
    bidding, seen = Bidding(), view(known, (2, 10))
    aim = bidding.choose(seen, bidding.aims(seen, find_frontiers(known)))
    assert aim is not None
    assert bidding.look(seen, aim) == [(3, 10), (2, 10)]  # so that it faces the left
    assert bidding.look(seen, aim) == [(1, 10)]
    assert bidding.look(seen, aim) is None
    assert chosen(bidding, seen) is None
    assert set(bidding.letter()["fruitless"]) == {(2, row) for row in range(8, 13)}


def test_a_team_ends_at_home() -> None:
    """E-55, EXP-18: letters travel, all that can be reached is known, and nobody stays outside."""
    walls = np.zeros((60, 90), np.uint8)
    walls[[0, -1]], walls[:, [0, -1]], walls[:, 45] = 1, 1, 1
    walls[25:33, 45] = 0
    walls[4:14, 70:80] = 1  # a block, hollow
    walls[6:12, 72:78] = 0
    world = Environment("two rooms", walls)
    team = [Member("base", "base", (8, 30), reach=0)]
    team += [Member(f"r{n}", "explorer", (8 + 2 * n, 30), reach=30) for n in (1, 2, 3)]
    cycle = set_up(world, team, FrontierStrategy(), Circle(), 1)
    robots = cycle.bodies[1:]
    while not all(one.home and one.view.cell == one.view.base for one in robots):
        cycle.advance()
        assert cycle.step < 150
    # thin walls are thought to be thicker than they are: that costs two of a hundred cells here
    assert cycle.team_free >= 0.97 * world.reachable((8, 30)).sum()
