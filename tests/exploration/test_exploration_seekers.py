"""Strategies that spread a team over frontiers: how they share, and that they come to an end."""

from dataclasses import replace

import numpy as np
import pytest

from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.exploring import way_to
from usarsim_exploration.frontiers import find_frontiers
from usarsim_exploration.gain import Outlook
from usarsim_exploration.known_map import FREE, SAFE, WALL, KnownMap
from usarsim_exploration.radio import create_radio
from usarsim_exploration.strategies.market import sell
from usarsim_exploration.strategies.schedule import Schedule
from usarsim_exploration.strategies.voronoi import lateness
from usarsim_exploration.strategy import create_strategy
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.tables import Table

SEEKERS = ["market", "voronoi", "next-best-view", "schedule"]


def flat() -> Environment:
    """Six rooms along a corridor, with doors to that."""
    walls = np.zeros((44, 62), np.uint8)
    walls[[0, 1, 2, 41, 42, 43]] = 1
    walls[:, [0, 1, 2, 59, 60, 61]] = 1
    walls[16:19], walls[26:29] = 1, 1
    walls[:17, [21, 22, 40, 41]] = walls[28:, [21, 22, 40, 41]] = 1
    for column in (8, 30, 50):
        walls[16:19, column : column + 5] = walls[26:29, column : column + 5] = 0
    return Environment("flat", walls)


def start(name: str, robots: int, reach: int = 20, **parameters: object) -> Cycle:
    """A run in the flat; the base is at the left end of the corridor."""
    here = "here"
    strategy = create_strategy(name, Table(parameters, here, UsarsimError), here)
    team = [Member("base", "base", (4, 22), reach=0, radio_range=30.0)]
    for number in range(robots):
        cell = (5 + number // 4, 20 + number % 4)
        team.append(Member(f"r{number + 1}", "explorer", cell, reach=reach, radio_range=30.0))
    radio = create_radio(Table({"model": "circle"}, here, UsarsimError))
    return set_up(flat(), team, strategy, radio, 1)


def run(cycle: Cycle, limit: int = 600) -> int:
    """Advance until all are home; the most steps that one stood still with something to find."""
    still, most = [0] * len(cycle.bodies), 0
    while cycle.step < limit:
        before = [body.view.cell for body in cycle.bodies]
        cycle.advance()
        for number, body in enumerate(cycle.bodies[1:], 1):
            view = body.view
            moved = view.cell != before[number]
            still[number] = 0 if moved else still[number] + 1
            if still[number] > most:
                field = view.planner.field(view.cell)
                if any(field.reaches(one.centre) for one in find_frontiers(view.known)):
                    most = still[number]
        if all(body.home and body.view.cell == body.view.base for body in cycle.bodies[1:]):
            return most
    raise AssertionError(f"not home after {limit} steps")


@pytest.mark.parametrize("name", SEEKERS)
@pytest.mark.parametrize("robots", [1, 3])
def test_a_team_maps_all_and_comes_home(name: str, robots: int) -> None:
    """EXP-18: nobody stands still for 60 steps before a frontier, and the base has it all."""
    cycle = start(name, robots)
    assert run(cycle) <= 60
    base, world = cycle.bodies[0].view, cycle.environment
    reachable = world.reachable((4, 22))
    assert np.count_nonzero(reachable & (base.known.bits & FREE != 0)) > 0.95 * reachable.sum()


def test_an_auction_gives_everybody_the_nearest_that_is_left() -> None:
    """By cost; the robot without a frontier buys before others fill their bundles."""
    near, far = (10, 10), (50, 10)
    assert sell({1: {near: 5.0, far: 9.0}, 2: {near: 6.0, far: 30.0}}, 3, 4.0) == {
        1: [near],
        2: [far],
    }
    assert sell({1: {near: 5.0, far: 9.0}, 2: {near: 6.0}}, 3, 4.0) == {1: [near, far], 2: []}


def test_a_bundle_is_a_tour() -> None:
    """Each next frontier costs the way so far and on; places that are close are sold once."""
    bids: dict[int, dict[Cell, float]] = {
        1: {(10, 0): 10.0, (20, 0): 20.0, (0, 40): 41.0},
        2: {(21, 1): 90.0, (0, 40): 25.0},
    }
    assert sell(bids, 3, 4.0) == {1: [(10, 0), (20, 0)], 2: [(0, 40)]}
    assert sell(bids, 1, 4.0) == {1: [(10, 0)], 2: [(0, 40)]}
    assert sell({1: {}}, 3, 4.0) == {1: []}


def test_parts_are_divided_by_way() -> None:
    """A cell is of whom has the shortest way; of the lower number where two have the same."""
    cycle = start("voronoi", 2)
    for body in cycle.bodies:
        body.view.known.bits[3:41, 3:59] = FREE | SAFE
        body.view.known.version += 1
    one, two = (body.view for body in cycle.bodies[1:])
    one.cell, two.cell = (10, 22), (50, 22)
    one.teammates[2] = replace(one.teammates[2], cell=two.cell, heard=0)
    two.teammates[1] = replace(two.teammates[1], cell=one.cell, heard=0)
    cells = np.array([[20, 22], [30, 22], [40, 22]])
    ours = lateness(one, cells, one.planner.field(one.cell).distances(cells), 500)
    theirs = lateness(two, cells, two.planner.field(two.cell).distances(cells), 500)
    assert ours.tolist() == pytest.approx([-20.0, 0.0, 20.0])
    assert theirs.tolist() == pytest.approx([20.0, 0.0, -20.0], abs=1e-6)
    assert ours[1] <= 0.0 < theirs[1]


def test_a_team_meets_as_it_was_fixed() -> None:
    """All know of the first meeting; there one robot fixes the next, and all of them take it."""
    cycle = start("schedule", 2, reach=8, interval=30)
    times = []
    for _ in range(100):
        cycle.advance()
        minds = [body.strategy for body in cycle.bodies[1:]]
        fixed = {one.next for one in minds if isinstance(one, Schedule)}
        meeting = fixed.pop()
        if not fixed and meeting is not None and not meeting.over:
            times.append(meeting.time)
    assert times[0] == 30
    assert len(set(times)) >= 2
    assert times == sorted(times)


def half_known(*walls: int) -> KnownMap:
    """Known up to column 50, with walls of columns there or beyond that."""
    known = KnownMap((101, 120))
    known.bits[:, :50] = FREE
    for column in walls:
        known.bits[:, column] = WALL
    return known


def test_a_view_is_worth_what_is_unknown_in_sight() -> None:
    """Half a disc at the edge of the known; nothing where somebody else will look, or a wall is."""
    cells = np.array([[49, 50], [29, 50]])
    edge, behind = Outlook(half_known(), 30).gains(cells)
    assert edge == pytest.approx(np.pi * 30**2 / 2, rel=0.05)
    assert 0.0 < behind < 0.3 * edge
    assert Outlook(half_known(49), 30).gains(cells - np.array([1, 0])).tolist() == [0.0, 0.0]
    promised = Outlook(half_known(), 30)
    promised.promise(cells[:1])
    assert promised.gains(cells)[0] < 0.05 * edge


def test_walls_are_predicted_to_go_on() -> None:
    """Across an unknown gap that is short enough; not across known space."""
    known = half_known()
    known.bits[:, 60] = WALL
    known.bits[45:56, 60] = 0
    cells = np.array([[49, 50]])
    plain, none, closed = (Outlook(known, 30, gap).gains(cells)[0] for gap in (0, 10, 12))
    assert plain == none
    assert closed == pytest.approx(589, rel=0.05)  # of the disc, what is before the wall
    assert plain > 1.5 * closed


def test_a_supposed_wall_keeps_nobody_from_home() -> None:
    """Scans may close a door in the map that the robot came through."""
    view = start("voronoi", 1).bodies[1].view
    view.known.bits[3:41, 3:59] = FREE | SAFE
    view.known.bits[3:41, 30] = WALL
    view.known.version += 1
    view.cell = (50, 22)
    assert len(way_to(view, view.base)) == 46
    view.known.bits[3:41, 30] = WALL | SAFE
    view.known.version += 1
    assert way_to(view, view.base) == []
