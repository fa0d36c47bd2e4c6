"""The simple strategies: what each promises, on small worlds, and that all of them finish."""

import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.known_map import AT_BASE, FREE, RELAYED, SAFE, WALL
from usarsim_exploration.radio import Circle, PathLoss, Radio, Sight
from usarsim_exploration.relays import chain, ways_within
from usarsim_exploration.strategies.hungarian import assign
from usarsim_exploration.strategies.periodic import Periodic
from usarsim_exploration.strategies.random_walk import draw_turn
from usarsim_exploration.strategies.ratio import Ratio
from usarsim_exploration.strategies.wall_follow import WallFollow
from usarsim_exploration.strategy import TYPES, Strategy
from usarsim_exploration.tether import held

SIMPLE = ("frontier", "greedy", "hungarian", "minpos", "nearest", "periodic", "ratio")


def rooms(columns: int = 72, rows: int = 46) -> Environment:
    """Four rooms around two crossing walls, each with doors."""
    walls = np.zeros((rows, columns), np.uint8)
    walls[[0, -1]] = walls[:, [0, -1]] = 1
    walls[rows // 2, :] = walls[:, columns // 2] = 1
    walls[rows // 2, [8, 9, 10, 11, 12, 55, 56, 57, 58, 59]] = 0
    walls[[8, 9, 10, 11, 12, 35, 36, 37, 38, 39], columns // 2] = 0
    return Environment("rooms", walls)


def begin(
    strategy: Strategy,
    world: Environment,
    starts: list[Cell],
    radio: Radio | None = None,
    reach: float = 40.0,
    speed: float = 3.0,
    seed: int = 1,
) -> Cycle:
    """A team, the base at its first start."""
    team = [Member("base", "base", starts[0], reach=0, radio_range=reach)]
    team += [
        Member(f"r{number}", "explorer", cell, speed=speed, reach=30, radio_range=reach)
        for number, cell in enumerate(starts[1:], 1)
    ]
    return set_up(world, team, strategy, radio or PathLoss(), seed)


def finish(cycle: Cycle, limit: int = 800) -> float:
    """Run until all are home; what part of the free cells the base knows then."""
    for _ in range(limit):
        cycle.advance()
        if all(body.home and not body.view.path for body in cycle.bodies[1:]):
            break
    else:
        pytest.fail(f"not home after {limit} steps")
    return cycle.bodies[0].view.known.free / cycle.environment.free


@pytest.mark.parametrize("name", SIMPLE)
def test_a_team_maps_four_rooms_and_comes_home(name: str) -> None:
    """EXP-01: each by its own way, and the base knows it then."""
    strategy = TYPES.find(name, "here")()
    assert finish(begin(strategy, rooms(), [(20, 15), (22, 15), (20, 17)])) > 0.93


def test_turns_are_drawn_as_documented() -> None:
    """E-56: 1:2:20:2:1 of 26,000 draws, within 5 % of all."""
    random = np.random.default_rng(3)
    drawn = Counter(round(math.degrees(draw_turn(random)), 1) for _ in range(26_000))
    for turn, share in ((-45.0, 1), (-22.5, 2), (0.0, 20), (22.5, 2), (45.0, 1)):
        assert drawn.pop(turn) == pytest.approx(1000 * share, abs=0.05 * 1000 * max(share, 2))
    assert not drawn


def test_a_random_walk_keeps_away_from_walls_and_moves_on() -> None:
    """E-56: two walkers leave their room, and never stand for long."""
    cycle = begin(TYPES.find("random-walk", "here")(), rooms(), [(20, 15), (22, 15), (20, 17)])
    stood = 0
    for _ in range(200):
        before = cycle.bodies[1].view.cell
        cycle.advance()
        stood = stood + 1 if cycle.bodies[1].view.cell == before else 0
        assert stood < 10
    assert cycle.bodies[1].distance > 400
    assert cycle.team_free > 0.3 * cycle.environment.free


def test_the_wall_stays_at_the_right_hand() -> None:
    """E-71: within its band for a full lap of a rectangular room."""
    walls = np.zeros((50, 70), np.uint8)
    walls[[0, -1]] = walls[:, [0, -1]] = 1
    strategy = WallFollow()
    cycle = begin(strategy, Environment("room", walls), [(30, 10), (32, 10)])
    body, places, sides = cycle.bodies[1], list[Cell](), set[str]()
    for _ in range(200):
        cycle.advance()
        column, row = body.view.cell
        away = {"top": row, "left": column, "bottom": 49 - row, "right": 69 - column}
        side = min(away, key=lambda one: away[one])
        if body.state == "follow" and (sides or away[side] < 5):
            assert 2.5 <= away[side] <= 4.5
            sides.add(side)
            places.append(body.view.cell)
        if len(sides) == 4 and math.dist(places[0], places[-1]) < 4:
            break
    assert sides == {"top", "left", "bottom", "right"}
    x, y = np.array(places, float).T - np.array([[34.5], [24.5]])
    turned = np.diff(np.unwrap(np.arctan2(y, x)))
    assert abs(turned.sum()) > 2 * math.pi * 0.95
    assert (turned <= 1e-9).all()  # against the clock, y down: the wall is at the right


def test_shares_are_those_with_the_least_sum() -> None:
    """Hungarian: not each for itself; a second robot only where all have one."""
    assert assign(np.array([[1.0, 2.0], [1.5, 9.0]])).tolist() == [1, 0]
    assert sorted(assign(np.array([[1.0, 5.0], [1.0, 5.0], [1.0, 5.0]])).tolist()) == [0, 0, 1]
    assert assign(np.array([[np.inf, 4.0]])).tolist() == [1]


def test_periodic_returns_after_ever_longer_times() -> None:
    """E-60: explores for 10 steps, then 20, then 30."""
    walls = np.zeros((20, 400), np.uint8)
    walls[[0, -1]] = walls[:, [0, -1]] = 1
    cycle = begin(Periodic(), Environment("hall", walls), [(10, 10), (12, 10)], Circle(), 6.0)
    states = []
    for _ in range(130):
        cycle.advance()
        states.append(cycle.bodies[1].state)
    runs = [len(part) for part in "".join(one[0] for one in states).split("r") if part]
    assert runs[:3] == [10, 20, 30]


def test_periodic_may_wait_for_something_to_tell() -> None:
    """E-60: with `outward` off, the time stands still on the way through what the base knows."""
    cycle = begin(Periodic(outward=False), rooms(), [(10, 10), (12, 10)], Circle(), 6.0)
    view, strategy = cycle.bodies[1].view, cycle.bodies[1].strategy
    assert isinstance(strategy, Periodic)
    free = np.flatnonzero(view.known.bits & FREE)
    view.linked = frozenset()
    view.known.mark(0, free, AT_BASE)
    for view.step in range(1, 31):
        assert not strategy.turns_back(view)
    view.known.unmark(0, free, AT_BASE)
    for view.step in range(31, 41):
        assert not strategy.turns_back(view)
    view.step = 41
    assert strategy.turns_back(view)


def visits(target: float, seed: int) -> tuple[int, float]:
    """How often robots came back into the range of the base, and the mean share of the base."""
    starts: list[Cell] = [(20, 15), (22, 15), (20, 17)]
    cycle = begin(Ratio(target=target), rooms(), starts, Sight(), 12.0, seed=seed)
    count, shares, near = 0, [], {1: True, 2: True}
    for _ in range(100):
        cycle.advance()
        shares.append(cycle.bodies[0].view.known.free / cycle.team_free)
        for number in near:
            now = bool(cycle.links.direct[0, number])
            count += now and not near[number]
            near[number] = now
    return count, float(np.mean(shares))


def test_a_low_ratio_returns_less() -> None:
    """E-58: fewer visits, and a lower mean share of the base."""
    often, well = visits(0.9, 1)
    seldom, badly = visits(0.5, 1)
    assert seldom < often
    assert badly < well


def test_one_of_those_who_meet_owns_each_cell() -> None:
    """E-59: also when what one carries had been given to a third one before."""
    walls = np.zeros((30, 300), np.uint8)
    starts: list[Cell] = [(5, 15), (150, 15), (210, 15), (270, 15)]
    cycle = begin(Ratio(), Environment("hall", walls), starts, Circle(), 20.0)
    one, other, third = (body.view for body in cycle.bodies[1:])
    cells = np.flatnonzero(third.known.bits & FREE)
    one.known.merge(0, cells, third.known.news(cells))
    one.known.mark(0, cells, RELAYED)
    meeting = (180, 15)
    for view in (one, other):
        view.cell = meeting
        view.path.clear()
    cycle.advance()
    free = one.known.bits & FREE != 0
    assert (free == (other.known.bits & FREE != 0)).all()
    owned = [view.known.bits & (AT_BASE | RELAYED) == 0 for view in (one, other, third)]
    both = (owned[0] & free).astype(int) + (owned[1] & free)
    kept = np.zeros(walls.size, bool)
    kept[cells] = True
    assert (both[free & ~kept.reshape(walls.shape)] == 1).all()
    assert both.max() == 1


@pytest.mark.parametrize(("radio", "reach"), [(Circle(), 30.0), (PathLoss(), 45.0)])
def test_range_constrained_never_leaves_the_base(radio: Radio, reach: float) -> None:
    """E-61: the base knows all that anybody knows, in every step, and more than one reaches."""
    starts: list[Cell] = [(10, 8), (12, 8), (12, 10)]
    cycle = begin(TYPES.find("range-constrained", "here")(), rooms(), starts, radio, reach)
    base, farthest = cycle.bodies[0].view, 0.0
    for _ in range(400):
        cycle.advance()
        assert cycle.links.closed.all()
        for body in cycle.bodies[1:]:
            assert (body.view.known.bits == base.known.bits).all()
            farthest = max(farthest, math.dist(body.view.cell, base.cell))
        if all(body.home and not body.view.path for body in cycle.bodies[1:]):
            break
    else:
        pytest.fail("not home")
    assert farthest > 30.0
    assert base.known.free > 0.7 * cycle.environment.free


@pytest.mark.parametrize("seed", [1, 2])
def test_a_chain_keeps_its_links(seed: int) -> None:
    """E-62: over several hops to the base, in at least 99 % of steps under a circle."""
    starts: list[Cell] = [(10, 8), (12, 8), (12, 10), (14, 8)]
    strategy = TYPES.find("leader-follower", "here")()
    cycle = begin(strategy, rooms(), starts, Circle(), 24.0, speed=float(seed + 2), seed=seed)
    held, steps, hops = 0, 0, 0
    while not all(body.home and not body.view.path for body in cycle.bodies[1:]):
        cycle.advance()
        steps += 1
        assert steps < 500
        held += bool(cycle.links.closed[0].all())
        hops += bool(cycle.links.closed[0, 3] and not cycle.links.direct[0, 3])
    assert held >= 0.99 * steps
    assert hops > 20
    assert cycle.bodies[0].view.known.free > 0.7 * cycle.environment.free


@pytest.mark.parametrize(("name", "most"), [("leader-follower", 10), ("range-constrained", 60)])
def test_a_team_on_a_tether_does_not_stand_about(name: str, most: int) -> None:
    """EXP-18: somebody drives, though most is out of reach; and each relay has its own place."""
    starts: list[Cell] = [(10, 8), (12, 8), (12, 10), (14, 8)]
    cycle = begin(TYPES.find(name, "here")(), rooms(), starts, Circle(), 14.0)
    still = 0
    while not all(body.home and not body.view.path for body in cycle.bodies[1:]):
        before = [body.view.cell for body in cycle.bodies]
        cycle.advance()
        assert cycle.step < 400
        still = still + 1 if before == [body.view.cell for body in cycle.bodies] else 0
        assert still <= most
        robots = [body for body in cycle.bodies[1:] if body.state == "relay"]
        parked = [body.view.cell for body in robots if not body.view.path]
        assert len(set(parked)) == len(parked)
    assert all(body.view.cell == body.view.base for body in cycle.bodies[1:])
    assert cycle.bodies[0].view.known.free > 0.2 * cycle.environment.free


@pytest.mark.parametrize("name", ["leader-follower", "range-constrained"])
def test_one_robot_explores_as_far_as_the_base_hears(name: str) -> None:
    """EXP-18: without anybody to be its relay it does not give up at the start."""
    cycle = begin(TYPES.find(name, "here")(), rooms(), [(10, 8), (12, 8)], Circle(), 24.0)
    assert finish(cycle, 300) > 0.25


def test_a_way_within_reach_goes_round() -> None:
    """EXP-18: who cannot go back the short way without losing its link goes another one."""
    cycle = begin(TYPES.find("nearest", "here")(), rooms(), [(20, 15), (22, 15)], Circle(), 20.0)
    view = cycle.bodies[1].view
    view.known.bits[1:45, 1:71] = FREE
    view.known.version += 1
    view.cell, others = (4, 4), [(4, 14), (14, 20), (20, 10)]
    assert not held(view, view.planner.path(view.cell, (30, 4)) or [], others[:2]).all()
    way = ways_within(view, [(30, 4)], others[:2])[30, 4]
    assert held(view, way, others[:2]).all()
    assert way[-1] != (30, 4)
    way = ways_within(view, [(30, 4)], others)[30, 4]
    assert way[-1] == (30, 4)
    assert held(view, way, others).all()


def test_relays_are_as_few_as_it_takes() -> None:
    """EXP-18: each is in reach of the one before, the goal of the last; too few are none."""
    walls = np.zeros((30, 130), np.uint8)
    walls[[0, -1]] = walls[:, [0, -1]] = 1
    walls[1:20, 60] = 1
    world = Environment("hall", walls)
    cycle = begin(TYPES.find("nearest", "here")(), world, [(5, 5), (6, 5)], Circle(), 30.0)
    view = cycle.bodies[1].view
    view.known.bits[:] = np.where(walls, WALL | SAFE, FREE | SAFE)
    view.known.version += 1
    goal = (100, 8)
    assert chain(view, [(5, 5)], [goal], [1.0], 2) is None
    places = chain(view, [(5, 5)], [goal], [1.0], 5)
    assert places is not None
    assert len(places) == 3
    ends = [(5, 5), *places, goal]
    assert all(math.dist(one, other) <= 36.0 for one, other in pairwise(ends))
    assert chain(view, [(5, 5), *places[:2]], [goal], [1.0], 1) is not None


def test_links_through_the_unknown_count_for_the_worst() -> None:
    """E-61: as many walls as there are cells that nobody has seen; near enough it still holds."""
    cycle = begin(TYPES.find("nearest", "here")(), rooms(), [(4, 4), (5, 4)], PathLoss(), 200.0)
    view = cycle.bodies[1].view
    view.known.bits[:] = FREE
    view.known.version += 1
    ends = np.array([[4, 4]]), np.array([[70, 4], [14, 4]])
    assert view.radio.reaches(*ends, unknown=3).all()
    view.known.bits[:, 8:13] = 0
    view.known.version += 1
    assert view.radio.reaches(*ends).all()
    assert view.radio.reaches(*ends, unknown=3).tolist() == [[False, True]]


def test_who_stands_with_its_back_to_the_base_turns() -> None:
    """EXP-18: robots that do not see the base at the start would count on no link."""
    starts: list[Cell] = [(5, 8), (20, 8), (20, 12)]
    cycle = begin(TYPES.find("range-constrained", "here")(), rooms(), starts, PathLoss(), 60.0)
    view = cycle.bodies[1].view
    assert not view.planner.field(view.cell).reaches(view.base)
    for _ in range(3):
        cycle.advance()
    assert view.planner.field(view.cell).reaches(view.base)
