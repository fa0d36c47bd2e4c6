"""Unattended robots, on a floor plan: no server, no clock."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from toy_world import Plan, Toy
from virtual_station import VirtualPage, VirtualStation

from usarsim_operator import policies
from usarsim_operator.ground import Disc, Followed, Ground
from usarsim_operator.navigation import FAR, FREE, WALL, Grid, distances, way
from usarsim_operator.occupancy import CELL, OccupancyMap
from usarsim_operator.roles import Role
from usarsim_operator.view import View

ROOMS = Plan("""
####################
#........#.........#
#........#.........#
#........#.........#
#..................#
#..................#
#........#.........#
#........#.........#
#........####..#####
#........#.........#
#........#.........#
#........#.........#
####################
""")
"""Three rooms of 4.5 x 5.5 m, 4.5 x 3.5 m and 4.5 x 1.5 m."""


def _floor(grid: Grid, plan: Plan) -> float:
    """Share of the plan's floor that is known to be free."""
    rows, columns = np.nonzero(~plan.walls)
    places = [
        grid.cell(((c + 0.5) * CELL, (r + 0.5) * CELL)) for r, c in zip(rows, columns, strict=True)
    ]
    return float(np.mean([grid.cells[one] == FREE for one in places]))


def _view(toy: Toy, map: OccupancyMap, ground: Ground | None = None) -> View:
    pose = toy.x, toy.y, toy.yaw
    return View(toy.time, pose, toy.scan(), map, {}, ground or Ground(), "R")


def _go(
    policy: policies.Policy,
    toy: Toy,
    map: OccupancyMap,
    seconds: float,
    ground: Ground | None = None,
) -> list[Toy]:
    """Let a policy drive; where the robot was at each tenth of a second."""
    places, ground = [], ground or Ground()
    for count in range(round(seconds / 0.1)):
        ground.stand("R", (toy.x, toy.y), toy.time)
        view = _view(toy, map, ground)
        assert view.scan is not None
        if count % 5 == 0:
            map.add(view.pose, view.scan.bearings, view.scan.ranges, 8.0)
        toy.left, toy.right = policy.powers(view)
        toy.step()
        places.append(Toy(toy.plan, toy.x, toy.y, toy.yaw, toy.time))
    return places


def test_explore_sees_all_rooms() -> None:
    """O-56: a frontier strategy ends when everything that can be reached is known."""
    map, toy = OccupancyMap(), Toy(ROOMS, 1.0, 1.0, 0.7, speed=1.0)
    policy = policies.make("explore", ())
    _go(policy, toy, map, 90.0)
    assert _floor(Grid(map.cells(), map.corner), ROOMS) > 0.95
    assert policy.goal is None
    assert policy.powers(_view(toy, map)) == (0.0, 0.0)


@pytest.mark.slow
def test_search_goes_round_again() -> None:
    """Where `explore` stands, since all is seen, `search` comes back to every room."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 1.0, 1.0, 0.7, speed=1.0), Ground()
    explore = policies.make("explore", ())
    _go(explore, toy, map, 90.0, ground)
    assert explore.why == "all floor that it knows a way to is seen"
    search = policies.make("search", ())
    places = _go(search, toy, map, 180.0, ground)
    assert {(one.x < 4.5, one.y < 4.5) for one in places} == {
        (True, True), (False, True), (False, False), (True, False),
    }  # fmt: skip


def test_people_are_kept_clear_of() -> None:
    """Somebody who lies where no scanner sees is not touched: robots pass beside."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 1.0, 1.0, 0.7, speed=1.0), Ground()
    lies = 2.4, 2.4
    ground.keep_clear("Ada", Disc(lies, 0.5), 0.0)
    places = _go(policies.make("explore", ()), toy, map, 60.0, ground)
    assert min(math.dist((one.x, one.y), lies) for one in places) > 0.5 + 0.25
    assert max(one.x for one in places) > 5.0


def test_who_waits_for_somebody_says_so() -> None:
    """It turns before who stands in its way, and tells why it does not get on."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 2.0, 2.4, 0.0), Ground()
    policy = policies.make("patrol", ((2.0, 2.4), (4.0, 2.4)))
    policy.powers(_view(toy, map, ground))
    ground.keep_clear("Ada", Disc((2.9, 2.4), 0.5), 0.0)
    toy.time = 0.1
    left, right = policy.powers(_view(toy, map, ground))
    assert left == -right
    assert policy.why == "somebody, or another robot, is in its way"


def _walk(ground: Ground, time: float, x: float, y: float = 4.7) -> None:
    """Ada is seen on her way to the left, at 0.5 m/s."""
    ground.keep_clear("Ada", Disc((x - 0.5 * time, y), 0.5), time)


def test_who_walks_is_expected_to_go_on() -> None:
    """Where she was is kept clear, and where she is by now although no camera sees her."""
    ground = Ground()
    for count in range(6):
        _walk(ground, 0.4 * count, 9.0)
    xs = [disc.place[0] for disc in ground.people(5.0)]
    for x in (9.0, 8.6, 8.0, 7.0, 6.5, 6.1):  # she is at 6.5
        assert min(abs(one - x) for one in xs) < 0.25
    assert [walker.place[0] for walker in ground.walkers(5.0)] == [pytest.approx(6.5)]
    assert not list(ground.walkers(12.0))  # nobody knows
    assert [disc.place[0] for disc in ground.people(30.0)] == [8.0]  # she may be back


@pytest.mark.parametrize(("yaw", "way"), [(math.pi / 2.0, 1.0), (0.2, -1.0), (math.pi, 1.0)])
def test_who_slid_too_near_goes_away_before_it_turns(yaw: float, way: float) -> None:
    """Its corners would touch somebody if it turned where it stands; then it turns."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 2.4, 2.4, yaw), Ground()
    view = _view(toy, map, ground)
    assert view.scan is not None
    map.add(view.pose, view.scan.bearings, view.scan.ranges, 8.0)
    policy = policies.make("patrol", ((1.0, 4.7), (1.0, 4.7)))
    for far, straight in ((1.24, True), (1.3, False)):
        ground = Ground()
        ground.keep_clear("Ada", Disc((2.4 + far, 2.4), 0.95), 0.0)
        policy._wanted = lambda _: (-0.59, 0.9)  # type: ignore[attr-defined]
        left, right = policy.powers(replace(view, ground=ground))
        assert (left == right) == straight
        assert not straight or math.copysign(1.0, left) == way


def test_a_mark_of_who_walks_shuts_no_corridor() -> None:
    """She was marked where she stood, and has gone on since; marks of others keep their places."""
    ground = Ground()
    _walk(ground, 0.0, 2.0)
    ground.mark([(2.0, 4.4), (7.0, 4.4)])
    assert {disc.place for disc in ground.still(0.0)} == {(2.0, 4.7), (2.0, 4.4), (7.0, 4.4)}
    _walk(ground, 0.8, 2.0)
    ground.mark([(2.0, 4.4), (7.0, 4.4)])
    assert [disc.place for disc in ground.still(0.8)] == [(7.0, 4.4)]
    assert [disc.place for disc in ground.left()] == [(2.0, 4.4)]


@pytest.mark.parametrize("corridor", [True, False])
def test_ways_keep_clear_of_where_somebody_walked_unless_that_shuts_them(corridor: bool) -> None:
    """In a door the mark would shut a robot in; in a room it is gone round."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 1.0, 2.4, 0.0, speed=1.0), Ground()
    x, y = (4.7, 2.4) if corridor else (2.5, 2.1)
    for count, time in enumerate((0.0, 1.0)):
        ground.keep_clear("Ada", Disc((x, y + 0.4 * count), 0.1), time)
    ground.mark([(x, y)])
    toy.time = 100.0
    ground.keep_clear("Ada", Disc((0.7, 5.6), 0.1), 99.0)  # she is elsewhere
    places = _go(policies.make("explore", ()), toy, map, 60.0, ground)
    assert max(one.x for one in places) > 6.0
    near = min(math.dist((one.x, one.y), (x, y)) for one in places)
    assert (near < 0.6) == corridor


def test_it_gets_out_of_the_way_of_who_walks() -> None:
    """Who walks does not stop for a robot; it does more than to stop before her."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 2.0, 2.4, 0.0), Ground()
    policy = policies.make("patrol", ((2.0, 2.4), (4.0, 2.4)))
    nearest = math.inf
    for count in range(100):
        if count % 4 == 0:
            _walk(ground, toy.time, 5.0, 2.4)
        _go(policy, toy, map, 0.1, ground)
        nearest = min(nearest, math.dist((toy.x, toy.y), (5.0 - 0.5 * toy.time, 2.4)))
    assert nearest > 0.65


def test_who_follows_somebody_stays_near_them() -> None:
    """It goes to where it sees her, faces her and says why it stands; it comes after her as she
    goes on, never touches her, and searches again when it is to follow nobody any more."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 1.0, 1.0, 0.7, speed=1.0), Ground()
    policy = policies.make("search", ())
    ground.keep_clear("Ada", Disc((8.2, 5.7), 0.5), 0.0)  # in the third room
    ground.follow("R", "Ada", 2.0)
    _go(policy, toy, map, 20.0, ground)
    assert policy.why.startswith("no way leads to Ada")  # nobody has looked there
    ground.follow("R", None, 0.0)
    _go(policy, toy, map, 60.0, ground)
    ground.follow("R", "Ada", 2.0)
    places = _go(policy, toy, map, 60.0, ground)
    for one in places[-100:]:
        assert math.dist((one.x, one.y), (8.2, 5.7)) < 2.0
        assert abs(math.remainder(math.atan2(5.7 - one.y, 8.2 - one.x) - one.yaw, math.tau)) < 0.35
    part = np.linspace(0.0, 1.0, 100)
    assert not ROOMS.wall(toy.x + (8.2 - toy.x) * part, toy.y + (5.7 - toy.y) * part).any()
    assert policy.why == "it is to stay near Ada"
    for count in range(40):  # she walks to the left
        ground.keep_clear("Ada", Disc((8.2 - 0.1 * count, 5.7), 0.5), toy.time)
        for one in _go(policy, toy, map, 0.5, ground):
            assert math.dist((one.x, one.y), (8.2 - 0.1 * count, 5.7)) > 0.75
    places = _go(policy, toy, map, 20.0, ground)
    assert math.dist((toy.x, toy.y), (4.3, 5.7)) < 2.0
    ground.follow("R", None, 0.0)
    places = _go(policy, toy, map, 30.0, ground)
    assert max(math.dist((one.x, one.y), (4.3, 5.7)) for one in places) > 3.0


async def test_a_page_says_whom_a_robot_follows() -> None:
    """Of whom `avoid` tells; null ends it; the place of somebody unknown is none."""
    station = VirtualStation()
    page, ground = VirtualPage(station, "Ada", Role.OPERATOR), station.autonomy.ground
    station.spawned("R")
    page.say("follow", robot="R", name="Eve", within=2.0)
    assert ground.followed("R", 0.0) is None
    page.say("avoid", name="Eve", place=[3.0, 1.0, 0.0], radius=0.5)
    assert ground.followed("R", 0.0) == Followed("Eve", (3.0, 1.0), 2.0)
    page.say("follow", robot="R", name=None, within=0.0)
    assert ground.followed("R", 0.0) is None
    await station.end()


def test_who_is_lifted_stands_and_others_keep_away() -> None:
    """Nothing tells where a platform ends: it stands until that is down; no other gets on."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 2.0, 2.4, 0.0), Ground()
    policy = policies.make("patrol", ((2.0, 2.4), (8.0, 2.4)))
    told = {}
    for count in range(60):
        up = min(max(0, count - 3), max(0, 50 - count), 20) * 0.03  # up, it waits, down again
        powers = policy.powers(replace(_view(toy, map, ground), height=0.17 + up))
        told[count] = powers != (0.0, 0.0), policy.why, policy.carried
        toy.time += 0.1
    assert told[2] == (True, "", False)
    assert told[6] == told[30] == told[47] == (False, "the floor under it has risen", True)
    assert not told[51][2]
    other = Toy(ROOMS, 1.0, 1.0, 0.7, speed=1.0)
    places = _go(policies.make("explore", ()), other, map, 30.0, ground)
    assert min(math.dist((one.x, one.y), (2.0, 2.4)) for one in places) > 1.4


@pytest.mark.parametrize(
    ("heights", "pitch"),
    [([0.03 * count for count in range(20)], 0.08), ([math.nan, 0.2, 0.13, 1.4, 1.4, 1.4], 0.0)],
)
def test_a_ramp_is_no_lift(heights: list[float], pitch: float) -> None:
    """What climbs by itself leans; one that is put elsewhere is there at once."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 2.0, 2.4, 0.0), Ground()
    policy = policies.make("patrol", ((2.0, 2.4), (8.0, 2.4)))
    for height in heights:
        policy.powers(replace(_view(toy, map, ground), height=height, lean=(0.0, pitch)))
        toy.time += 0.1
    assert not policy.carried
    assert not list(ground.risen())


def test_explore_leaves_from_what_its_scanner_never_saw() -> None:
    """O-56: a scanner at the front sees neither the floor under the robot nor what is behind."""
    map, toy = OccupancyMap(), Toy(ROOMS, 1.05, 1.05, ahead=0.2)
    scan = toy.scan()
    map.add((toy.x + toy.ahead, toy.y, toy.yaw), scan.bearings, scan.ranges, 8.0)
    grid = Grid(map.cells(), map.corner)
    assert grid.cells[grid.cell((1.05, 1.05))] == grid.cells[grid.cell((1.15, 1.05))] == 0
    explore = policies.make("explore", ())
    assert explore.powers(_view(toy, map)) != (0.0, 0.0)
    assert explore.goal is not None
    assert math.dist(explore.goal, (toy.x, toy.y)) > 0.7


def test_explorers_do_not_go_to_the_same_place() -> None:
    """O-56: what another robot goes to is worth less."""
    map, toy = OccupancyMap(), Toy(ROOMS, 2.5, 2.4, 0.0)
    view = _view(toy, map)
    assert view.scan is not None
    map.add(view.pose, view.scan.bearings, view.scan.ranges, 8.0)
    first, second = policies.make("explore", ()), policies.make("explore", ())
    first.powers(view)
    assert first.goal is not None
    second.powers(View(view.time, view.pose, view.scan, map, {"other": first.goal}))
    assert second.goal is not None
    assert math.dist(first.goal, second.goal) > 2.0


def test_patrol_goes_to_and_fro() -> None:
    """O-56: both ends of a route through a door are reached again and again."""
    map, toy = OccupancyMap(), Toy(ROOMS, 1.0, 1.0, speed=1.2)
    ends = (1.0, 1.0), (8.5, 2.4)
    places = _go(policies.make("patrol", ends), toy, map, 50.0)
    visits = []
    for one in places:
        for number, end in enumerate(ends):
            if math.dist((one.x, one.y), end) < 0.5 and visits[-1:] != [number]:
                visits.append(number)
    assert visits[:4] == [0, 1, 0, 1]
    with pytest.raises(ValueError, match="two places or more"):
        policies.make("patrol", ends[:1])


def test_a_robot_that_hangs_tries_something_else() -> None:
    """O-56: wheels that hang over something low turn freely; it backs off in both curves, goes
    straight back, and straight on."""
    map, toy = OccupancyMap(), Toy(ROOMS, 2.0, 2.0)
    policy, tried = policies.make("patrol", ((2.0, 2.0), (4.0, 2.0))), set()
    told: dict[str, float] = {}
    for _ in range(250):
        tried.add(policy.powers(_view(toy, map)))
        told.setdefault(policy.why, toy.time)
        toy.time += 0.1
    assert {(-1.0, -1.0), (1.0, 1.0)} <= tried
    assert any(left < right < 0.0 for left, right in tried)
    assert any(right < left < 0.0 for left, right in tried)
    assert list(told) == ["", "it is caught on something and tries to get free"]
    assert max(told.values()) < 2.0  # the first time, too


def test_who_pushes_and_turns_is_stuck() -> None:
    """Wheels that slip turn it to and fro before a pallet: that is no way."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 2.0, 2.4, 0.0), Ground()
    policy = policies.make("patrol", ((2.0, 2.4), (3.7, 2.4)))
    for count in range(25):
        policy.powers(_view(toy, map, ground))
        toy.yaw, toy.time = 0.15 * (count // 5 % 2), toy.time + 0.1
    assert len(list(ground.felt(0.0))) == 1


def test_to_and_fro_is_not_being_stuck() -> None:
    """Where it passes again after 6 s nothing has held it."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 2.0, 2.4, 0.0, speed=1.0), Ground()
    policy = policies.make("patrol", ((2.0, 2.4), (3.7, 2.4)))
    places = _go(policy, toy, map, 40.0, ground)
    assert list(ground.felt(0.0)) == []
    assert max(one.x for one in places) > 3.2


def test_what_its_scanner_sees_is_not_felt() -> None:
    """It slows down before the frame of a door and backs off: the door stays open."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 1.0, 1.0, 0.7, speed=1.0), Ground()
    _go(policies.make("explore", ()), toy, map, 90.0, ground)
    assert list(ground.felt(0.0)) == []


def test_it_goes_carefully_beside_what_was_felt() -> None:
    """At less power: at full speed it would be on a pipe before it leans."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 1.0, 2.4, 0.0), Ground()
    ground.feel(0.0, (2.5, 3.4))
    policy, fastest = policies.make("patrol", ((1.0, 2.4), (4.0, 2.4))), [0.0, 0.0]
    for _ in range(60):
        toy.left, toy.right = policy.powers(_view(toy, map, ground))
        near = math.dist((toy.x, toy.y), (2.5, 3.4)) < 1.2
        fastest[near] = max(fastest[near], (toy.left + toy.right) / 2.0)
        toy.step()
    assert fastest == pytest.approx([1.0, 0.7], abs=0.01)


def test_what_is_felt_twice_is_one_thing() -> None:
    """Between two places of a pipe there is the pipe, and not between two things far apart."""
    ground = Ground()
    for place in ((0.0, 0.0), (0.8, 0.0), (3.0, 0.0)):
        ground.feel(1.0, place)
    assert set(ground.felt(0.0)) == {(0.0, 0.0), (0.4, 0.0), (0.8, 0.0), (3.0, 0.0)}


def test_it_leaves_by_the_way_it_came() -> None:
    """Shut in by what it has felt all around, in a pocket in which it could go to and fro."""
    map, toy, ground = OccupancyMap(), Toy(ROOMS, 1.0, 3.0, 0.0, speed=1.0), Ground()
    search = policies.make("search", ())
    _go(search, toy, map, 60.0, ground)
    here = toy.x, toy.y
    for step in range(24):
        turn = math.tau * step / 24
        ground.feel(toy.time, (here[0] + 2.1 * math.cos(turn), here[1] + 2.1 * math.sin(turn)))
    places = _go(search, toy, map, 30.0, ground)
    assert max(math.dist((one.x, one.y), here) for one in places) > 2.5


@pytest.mark.slow
def test_a_place_that_was_looked_at_again_counts_as_visited() -> None:
    """It need not stand on it: two corners that no robot has stood in do not keep it for ever."""
    map, toy = OccupancyMap(), Toy(ROOMS, 1.0, 1.0, 0.7, speed=1.0)
    _go(policies.make("explore", ()), toy, map, 90.0)
    search, ground = policies.make("search", ()), Ground()
    for x in range(10):
        for y in range(7):
            if (x, y) not in ((0, 3), (4, 0)):
                ground.visit((x + 0.5, y + 0.5), toy.time)
    places = _go(search, toy, map, 120.0, ground)
    assert max(one.y for one in places) > 4.0


def test_hold_stops_before_the_wall() -> None:
    """O-56: the heading stays within 2 degrees; nothing is touched."""
    map, toy = OccupancyMap(), Toy(ROOMS, 1.0, 2.3, 0.05)
    policy = policies.make("hold", ())
    places = _go(policy, toy, map, 30.0)
    assert max(abs(one.yaw - 0.05) for one in places) < math.radians(2.0)
    assert toy.x > 8.0  # through the door
    assert 0.5 < 9.5 - toy.x < 1.2
    assert policy.powers(_view(toy, map)) == (0.0, 0.0)


def test_names() -> None:
    assert policies.names()[:4] == ["stop", "hold", "patrol", "explore"]
    with pytest.raises(ValueError, match="no policy expolre"):
        policies.make("expolre", ())


def test_ways_lead_around_walls() -> None:
    """Distances by sides and corners in turn are within a tenth of the true ones."""
    cells = np.full((60, 80), FREE, np.uint8)
    cells[:50, 40] = WALL
    grid = Grid(cells, (0.0, 0.0))
    steps = distances(grid.passable((0.5, 0.5), 0.2, unknown=False), grid.cell((0.5, 0.5)))
    assert 0.9 < steps[grid.cell((3.05, 4.05))] * CELL / math.dist((0.5, 0.5), (3.05, 4.05)) < 1.1
    found = way(steps, grid.cell((7.5, 0.5)))
    assert found[0] == grid.cell((0.5, 0.5))
    assert max(row for row, _ in found) >= 52  # around the end, with room
    assert all(cells[one] == FREE for one in found)
    shut = cells.copy()
    shut[:, 40] = WALL
    closed = Grid(shut, (0.0, 0.0))
    steps = distances(closed.passable((0.5, 0.5), 0.2, unknown=False), closed.cell((0.5, 0.5)))
    assert way(steps, closed.cell((7.5, 0.5))) == []


def test_a_wave_ends_where_all_else_is_dearer() -> None:
    """What it has reached until then is as far as ever, and the cheapest goal is among it."""
    chance = np.random.default_rng(1)
    for _ in range(20):
        passable = chance.random((40, 50)) < 0.75
        start = 20, 25
        more = np.where(chance.random((40, 50)) < 0.02, 3.0 * chance.random((40, 50)), np.inf)
        whole, part = distances(passable, start), distances(passable, start, more)
        assert ((part == whole) | (part == FAR)).all()
        costs = [np.where(one < FAR, CELL * one + more, np.inf) for one in (whole, part)]
        assert costs[1].min() == costs[0].min()
    assert (part < FAR).sum() < (whole < FAR).sum()


async def test_switching() -> None:
    """O-56: taken and driven, the robot obeys; handed back, it goes on to explore."""
    station = VirtualStation()
    page = VirtualPage(station, "Ada", Role.OPERATOR)
    station.spawned("R")
    toy = Toy(ROOMS, 1.0, 1.0, 0.7)

    def report() -> None:
        found = re.findall(
            rb"Left (\S+)\} \{Right (\S+)\}", b"".join(d for _, d in station.told("R"))
        )
        if found:
            toy.left, toy.right = (float(one) / 100.0 for one in found[-1])
        toy.step()
        if round(toy.time * 10) % 5 == 0:
            station.hear("R", toy.scan_line())
        station.hear("R", toy.pose_line())

    async def drive(seconds: float) -> float:
        """How far it comes."""
        way, last = 0.0, (toy.x, toy.y)
        for _ in range(round(seconds / 0.1)):
            report()
            station.clock += 0.1
            page.say("ping", clock=0.0)
            await station.settle()
            way += math.dist(last, (toy.x, toy.y))
            last = toy.x, toy.y
        return way

    try:
        assert await drive(1.0) == 0.0
        assert (await page.ask("policy", robot="R", policy="explore"))["ok"]
        assert await drive(10.0) > 1.0
        assert station.autonomy.mode(station.robots["R"]) == "autonomous"
        assert (await page.ask("take", robot="R"))["ok"]
        await drive(0.3)  # it stops
        assert await drive(2.0) == 0.0
        assert station.autonomy.mode(station.robots["R"]) == "operator"
        assert (await page.ask("hand_back", robot="R"))["ok"]
        assert await drive(10.0) > 1.0
        modes = [one["value"]["mode"] for one in page.texts if one.get("kind") == "mode"]
        assert modes == ["autonomous", "operator", "autonomous"]
        page.say("estop")
        await drive(0.3)
        assert await drive(1.0) == 0.0
        page.say("estop_reset")
        assert await drive(5.0) > 0.5
        assert (await page.ask("policy", robot="R", policy="stop"))["ok"]
        await drive(0.3)
        assert await drive(1.0) == 0.0
        answer = await page.ask("policy", robot="R", policy="expolre")
        assert "known: stop, hold, patrol, explore" in answer["why"]
    finally:
        await station.end(page)
