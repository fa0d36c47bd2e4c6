"""Rules of runs: each flag alone makes the difference that it says, in a small world."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usarsim_exploration import rules
from usarsim_exploration.rules import NEWEST, OLDEST, RULES, RunRules
from usarsim_exploration.running import Result, run
from usarsim_exploration.scenario import load, read

CASES = Path(__file__).parent / "cases"
Content = dict[str, Any]

LAB: Content = {"environment": {"name": "lab"}, "team": {"robots": 2}, "end": {"steps": 60}}


def case(name: str, **tables: Any) -> Content:
    """A scenario with the map of a case."""
    return {"environment": {"name": str(CASES / name)}, "end": {"steps": 60}, **tables}


def sees_behind_a_corner(result: Result) -> bool:
    """Free cells are known that a wall of touching corners parts from the base."""
    return bool((result.history.free_team > result.history.reachable).any())


def explores_lanes(result: Result) -> bool:
    """The run does not end at once."""
    return result.ended == "base knows"


def starts_in_metres(result: Result) -> bool:
    """Robots start as far from the base at 0.05 m a cell as at 0.1 m."""
    base, one, _ = result.history.cell[0].tolist()
    return math.dist(base, one) == 16.0


def is_home_with_data(result: Result) -> bool:
    """All went home while most of the map was still on its way."""
    return result.ended == "all home"


def counts_more_than_all(result: Result) -> bool:
    """A share of more than 100 %."""
    return bool((result.history.known_team > result.history.reachable).any())


def shares_a_cell(result: Result) -> bool:
    """Two robots are in one cell at each step."""
    cells = [{tuple(one) for one in row} for row in result.history.cell[1:, 1:].tolist()]
    return all(len(one) < result.history.robots for one in cells)


def sees_next_to_nothing(result: Result) -> bool:
    """Of a hall, by robots with a view of one line."""
    return bool(result.history.known_team[-1] < 0.02 * result.history.reachable[-1])


def relays_explore(result: Result) -> bool:
    """Though the scenario says that they do not."""
    history = result.history
    relay = history.role == "relay"
    return bool((np.char.startswith(history.state, "explore") & relay).any())


FLAGS: dict[str, tuple[Content | str, Callable[[Result], bool], bool]] = {
    "sight": (case("16/slanted.txt", team={"robots": 1}), sees_behind_a_corner, False),
    "narrow": (case("15/maze1.txt", team={"robots": 1}), explores_lanes, True),
    "starts": (
        case("23/m05.yaml", team={"robots": 2}, backend="discs", end={"steps": 1}),
        starts_in_metres,
        True,
    ),
    "ends": (LAB | {"radio": {"bandwidth": 100}, "end": {"steps": 400}}, is_home_with_data, False),
    "ties": ("22/tie.toml", shares_a_cell, False),
    "shares": ("21/open2.toml", counts_more_than_all, False),
    "short": (LAB | {"team": {"robots": 2, "view": 1}}, sees_next_to_nothing, False),
    "relays": (
        LAB | {"strategy": {"name": "role-based", "relay_explores": False}},
        relays_explore,
        False,
    ),
}
"""Of each flag: a scenario, what is asked of its run, and the answer by today's rules."""


def test_every_flag_is_tried() -> None:
    """A new one needs a world of its own here; rules 1 have none of them."""
    names = {one.name for one in fields(RunRules)} - {"number", "mresim"}
    assert names == set(FLAGS)
    assert not any(getattr(RULES[OLDEST], name) for name in names)
    assert all(getattr(RULES[NEWEST], name) for name in names)


@pytest.mark.parametrize("flag", FLAGS)
def test_a_flag_alone_makes_the_difference(flag: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Today's rules without it answer otherwise; and so do the oldest."""
    scenario, asked, today = FLAGS[flag]

    def answer(number: int) -> bool:
        if isinstance(scenario, str):
            option = "strategy.name=minpos" if flag == "ties" else "team.robots=2"
            return asked(run(load(CASES / scenario, [option, f"rules={number}"])))
        return asked(run(read(scenario | {"rules": number})))

    assert answer(NEWEST) is today
    assert answer(OLDEST) is not today
    without: Any = {flag: False}
    monkeypatch.setitem(rules.RULES, NEWEST, replace(RULES[NEWEST], **without))
    assert answer(NEWEST) is not today
