"""Explorers and relays: states, where and when they meet, and what happens if one stays away."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_exploration_seekers import flat, run

from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.known_map import FREE, SAFE, WALL
from usarsim_exploration.radio import create_radio
from usarsim_exploration.rendezvous import Meeting, candidates, ranked, sampled, single_point
from usarsim_exploration.strategies.role_based import TRANSITIONS, RoleBased, State
from usarsim_exploration.strategies.switching import choose_pair
from usarsim_exploration.strategy import View, create_strategy
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.tables import Table

ROLES = ["role-based-single-point", "role-based-multi-point"]


def start(name: str, robots: int, reach: float = 14.0, **parameters: object) -> Cycle:
    """Pairs in the flat, with radios that reach a room or so."""
    strategy = create_strategy(name, Table(parameters, "here", UsarsimError), "here")
    team = [Member("base", "base", (4, 22), reach=0, radio_range=reach)]
    for number in range(1, robots + 1):
        cell = (5 + number // 4, 20 + number % 4)
        relay = number % 2 == 1 and number < robots
        parent = number - 1 if number % 2 == 0 else 0
        team.append(
            Member(
                f"r{number}", "relay" if relay else "explorer", cell, reach=10, radio_range=reach,
                parent=parent, child=number + 1 if relay else None,
            )
        )  # fmt: skip
    radio = create_radio(Table({"model": "circle"}, "here", UsarsimError))
    return set_up(flat(), team, strategy, radio, 1)


def mind(cycle: Cycle, number: int) -> RoleBased:
    """The strategy of a robot."""
    strategy = cycle.bodies[number].strategy
    assert isinstance(strategy, RoleBased)
    return strategy


@pytest.mark.parametrize(("name", "robots"), [(ROLES[0], 2), (ROLES[1], 2), (ROLES[0], 3)])
def test_states_change_as_the_reference_says(
    name: str, robots: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """E-63: over a whole run, at whose end the base has it all; EXP-18: nobody stands about."""
    seen = set[tuple[State, State]]()
    enter = RoleBased._enter

    def noted(self: RoleBased, state: State, view: View) -> None:
        seen.add((self.state, state))
        enter(self, state, view)

    monkeypatch.setattr(RoleBased, "_enter", noted)
    cycle = start(name, robots)
    assert run(cycle, 900) <= 60
    base, reachable = cycle.bodies[0].view, cycle.environment.reachable((4, 22))
    assert np.count_nonzero(reachable & (base.known.bits & FREE != 0)) > 0.93 * reachable.sum()
    assert seen <= {(one, other) for one, after in TRANSITIONS.items() for other in after}
    assert {("explore", "give-parent-info"), ("explore", "return-to-parent")} <= seen


@pytest.mark.parametrize("seed", range(4))
def test_pairs_that_start_together_get_going(seed: int) -> None:
    """EXP-14: two pairs know half of the flat soon, from wherever, and explorers part."""
    cycle = start(ROLES[0], 4)
    free = np.argwhere(cycle.environment.reachable((4, 22)))
    row, column = free[np.random.default_rng(seed).integers(len(free))]
    for body in cycle.bodies:
        body.view.cell = body.view.base = (int(column), int(row))
    together = 0
    while cycle.team_free < 0.5 * cycle.environment.free:
        cycle.advance()
        together += cycle.bodies[2].view.cell == cycle.bodies[4].view.cell
        assert cycle.step <= 80
    assert together < cycle.step / 2


def meet(relay: tuple[int, int] = (6, 22)) -> tuple[View, View]:
    """An explorer and its relay in the flat that both know."""
    cycle = start(ROLES[0], 2)
    truth = cycle.environment.walls != 0
    for body in cycle.bodies:
        body.view.known.bits[:] = np.where(truth, WALL | SAFE, FREE | SAFE)
        body.view.known.version += 1
    one, other = cycle.bodies[1].view, cycle.bodies[2].view
    one.cell = relay
    other.teammates[1] = replace(other.teammates[1], cell=relay)
    other.cell = (50, 22)
    return other, one


def test_the_best_of_four_places_is_chosen() -> None:
    """E-64: on the skeleton, off walls, the highest degree^2 x 10000 / way of the four nearest."""
    explorer, _ = meet()
    goal = (50, 35)
    cells, degree = candidates(explorer)
    walls = np.argwhere(explorer.known.bits & WALL != 0)[:, ::-1]
    for cell in cells:
        assert np.hypot(*(walls - cell).T).min() >= 3.0
    nearest = sorted(range(len(cells)), key=lambda i: (math.dist(cells[i], goal), i))[:4]
    ways = explorer.planner.field(goal).distances(cells)
    best = max(nearest, key=lambda i: float(degree[i] ** 2 * 1e4 / np.maximum(ways[i], 1.0)))
    assert ranked(explorer, goal)[0] == tuple(cells[best])


@pytest.mark.parametrize("speed", [0.25, 3.0])
def test_they_meet_when_both_can_be_there(speed: float) -> None:
    """E-65: a slow relay decides, else the explorer with 75 steps at its frontier."""
    explorer, _ = meet()
    relay, goal = replace(explorer.teammates[1], speed=speed), (50, 35)
    meeting = single_point(explorer, relay, goal)
    base, frontier = explorer.planner.field(explorer.base), explorer.planner.field(goal)
    shuttle = (base.distance(relay.cell) + base.distance(meeting.place)) / speed
    visit = (frontier.distance(explorer.cell) + frontier.distance(meeting.place)) / 3.0 + 75
    assert meeting.time == math.ceil(max(60, shuttle, visit))
    assert (meeting.time > visit + 1) is (speed < 1)


def test_a_missed_meeting_leads_to_the_backup() -> None:
    """E-66: 60 steps after its time both are to meet at the other place; then each is alone."""
    cycle = start(ROLES[0], 2, reach=3.0)
    place, other = (50, 22), (30, 22)
    for number, state in ((1, "wait-for-child"), (2, "wait-for-parent")):
        robot = mind(cycle, number)
        robot.meeting, robot.state = Meeting(place, place, 20, other, 110), state  # type: ignore
        view = cycle.bodies[number].view
        view.known.bits[21:24, 3:59] = FREE | SAFE
        view.known.version += 1
        view.linked = frozenset()
        for step in (80, 81):
            view.step = step
            robot.decide(view)
            assert robot.state == (state if step == 80 else TRANSITIONS[state][1])  # type: ignore
        assert robot.meeting == Meeting(other, other, 110)


def test_two_places_hear_each_other() -> None:
    """E-67: and no other sampled cell that hears the explorer's is nearer to the base's zone."""
    explorer, _ = meet()
    strategy = create_strategy(ROLES[1], Table({"density": 30.0}, "here", UsarsimError), "here")
    assert isinstance(strategy, RoleBased)
    meeting = strategy.arrange(explorer, explorer.teammates[1], (50, 35))
    assert meeting.place == ranked(explorer, (50, 35))[0]
    assert meeting.relay_place != meeting.place

    def near(cell: tuple[int, int], other: tuple[int, int]) -> bool:
        return bool(explorer.radio.reaches(np.array([cell]), np.array([other]))[0, 0])

    assert near(meeting.relay_place, meeting.place)
    cells = [(int(c), int(r)) for c, r in sampled(explorer, 30.0)]
    zone = [cell for cell in cells if near(cell, explorer.base)]
    ways = explorer.planner.field(*zone)
    least = min(ways.distance(cell) for cell in cells if near(cell, meeting.place))
    assert ways.distance(meeting.relay_place) == least


def test_samples_are_even_and_repeat() -> None:
    """E-68: one per so many free cells, and the base; the same again."""
    explorer, _ = meet()
    found = sampled(explorer, 50.0)
    assert len(found) == _free(explorer) // 50 + 1
    assert (found == sampled(explorer, 50.0)).all()
    assert tuple(found[-1]) == explorer.base
    left = np.count_nonzero(found[:, 0] < 31)
    assert left == pytest.approx(len(found) / 2, rel=0.2)


def _free(view: View) -> int:
    return int(np.count_nonzero(view.known.bits & FREE))


def test_the_longer_way_decides_who_switches() -> None:
    """E-69: only if it shrinks, one pair a step, never in an exchange or 4 steps after the last."""

    def letter(state: str, ways: dict[int, float], switched: int = 0) -> dict[str, Any]:
        return {"part": {"state": state, "complete": False}, "ways": ways, "switched": switched}

    one = letter("explore", {1: 50.0, 2: 20.0, 3: 90.0})
    two = letter("go-to-child", {1: 45.0, 2: 60.0, 3: 90.0})
    three = letter("explore", {1: 5.0, 2: 5.0, 3: 90.0})
    assert choose_pair({1: one, 2: two, 3: three}, 15) == (1, 2)
    assert choose_pair({1: one, 2: {**two, "ways": {1: 60.0, 2: 60.0}}}, 15) is None
    assert choose_pair({1: one, 2: {**two, "switched": 12}}, 15) is None
    assert choose_pair({1: one, 2: {**two, "switched": 11}}, 15) == (1, 2)
    for state in ("give-parent-info", "wait-for-child"):
        assert choose_pair({1: one, 2: letter(state, two["ways"])}, 15) is None


def test_switches_leave_everybody_with_whom_they_belong_to() -> None:
    """E-70: 1,000 among 6 robots, of which some hear of it only later."""
    cycle = start(ROLES[0], 6, reach=1000.0)
    random = np.random.default_rng(1)
    views = {number: cycle.bodies[number].view for number in range(1, 7)}
    for number in views:
        mind(cycle, number).switch = True
    for step in range(1, 1001):
        pair = sorted(random.choice(6, 2, replace=False) + 1)
        away = set(random.choice(6, 2, replace=False) + 1) - set(pair)
        letters = {number: {"part": mind(cycle, number).part(views[number])} for number in views}
        for number, view in views.items():
            view.step = step
            if number not in away:
                mind(cycle, number).swap(view, int(pair[0]), int(pair[1]), letters)
        for number, view in views.items():
            for other, mate in views.items():
                if other != number:
                    about = {"parent": mate.parent, "child": mate.child}
                    letter = {**about, "bond": mind(cycle, other).bond}
                    known = view.teammates[other]
                    view.teammates[other] = replace(known, letter=letter, role=mate.role)
        for number, view in views.items():
            mind(cycle, number)._rebind(view)
        relays = [view for view in views.values() if view.role == "relay"]
        assert len(relays) == 3
        assert len({view.child for view in relays}) == 3
        for relay in relays:
            assert relay.parent == 0
            assert views[relay.child or 0].parent == relay.number
            assert views[relay.child or 0].role == "explorer"


def test_a_team_that_switches_comes_home() -> None:
    """E-69 over a run: roles did change, and the base has it all."""
    cycle = start(ROLES[0], 4, reach=20.0, switch=True)
    assert run(cycle, 900) <= 60
    assert max(mind(cycle, number).switched for number in range(1, 5)) > 0
