"""Robots that see only a few cells: they explore on and on, and results say if they do not."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from lanes import slow_but
from small_world import small

from usarsim_exploration import run_folder
from usarsim_exploration.frontiers import find_frontiers
from usarsim_exploration.history import History
from usarsim_exploration.known_map import FREE, KnownMap
from usarsim_exploration.measures import measure
from usarsim_exploration.running import Result, Run, run
from usarsim_exploration.scenario import read
from usarsim_exploration.strategy import TYPES, Plan, Strategy, View
from usarsim_exploration.walking import into_unknown

SEEKING = sorted(set(TYPES.names()) - {"random-walk"})


def vain(history: History) -> int:
    """Steps of the longest search in vain."""
    found = measure(history)["longest_without_news"]
    assert isinstance(found, int)
    return found


def explored(strategy: str, steps: int, **team: object) -> Result:
    """Two robots in `lab`, 200 x 150 cells."""
    content = {
        "environment": {"name": "lab"},
        "team": {"robots": 2, **team},
        "strategy": {"name": strategy},
        "end": {"steps": steps},
    }
    return run(read(content))


@pytest.mark.parametrize("strategy", slow_but({"frontier", "market"}.__contains__, SEEKING))
@pytest.mark.parametrize(("reach", "least"), slow_but((1, 3).__eq__, [(1, 3), (2, 6), (3, 8)]))
def test_short_ranges(strategy: str, reach: int, least: int) -> None:
    """Robots that see one to three cells find more all the time, with any strategy."""
    slower = strategy in ("leader-follower", "range-constrained", "wall-follow")
    history = explored(strategy, 100, reach=reach).history
    share = 100 * history.known_team[-1] / history.reachable[-1]
    assert share >= (least / 4 if slower else least)
    assert history.known_team[-1] > 1.1 * history.known_team[-40]
    assert vain(history) < 20


@pytest.mark.parametrize(
    "strategy",
    slow_but("role-based".__eq__, ["frontier", "nearest", "next-best-view", "role-based"]),
)
@pytest.mark.parametrize("view", [1, 2])
def test_narrow_views(strategy: str, view: int) -> None:
    """Robots that see one line drive beside it, and see others from there."""
    history = explored(strategy, 100, view=view).history
    assert history.known_team[-1] >= 0.1 * history.reachable[-1]
    assert vain(history) < 30


def test_old_rules_leave_them_in_place() -> None:
    """By rules 1 robots shuttle between two sides of what they know; results stay as they were."""
    content = {
        "rules": 1,
        "environment": {"name": "lab"},
        "team": {"robots": 2, "view": 1},
        "end": {"steps": 100},
    }
    result = run(read(content))
    assert result.history.known_team[-1] < 0.02 * result.history.reachable[-1]
    assert "longest_without_news" not in measure(result.history)


@dataclass
class Shuttles(Strategy):
    """Goes one cell to and fro."""

    def decide(self, view: View) -> Plan | None:
        """To the other cell."""
        column, row = view.cell
        return Plan([(column + (1 if view.step % 2 else -1), row)])


def test_a_search_in_vain_is_told(tmp_path: Path) -> None:
    """Robots that drive and find nothing do not stand idle, so another measure tells it."""
    scenario = small(tmp_path, "end.base=off", "end.home=false", "end.steps=150")
    result = run(replace(scenario, strategy=Shuttles()))
    found = measure(result.history)
    assert found["longest_idle"] == 0
    assert vain(result.history) >= 145
    told = run_folder.line(result, {"processor_ms_per_step": 1.0})
    assert f"nothing new for {found['longest_without_news']} steps" in told


def test_a_run_that_ends_well_says_nothing_of_it(tmp_path: Path) -> None:
    """Whoever drives home does not search."""
    result = run(small(tmp_path))
    assert vain(result.history) < 20
    assert "nothing new" not in run_folder.line(result, {"processor_ms_per_step": 1.0})


def test_a_frontier_all_around_is_parted() -> None:
    """Each part has a middle of its own, all cells are in one, and none is wider than asked."""
    known = KnownMap((60, 80))
    known.bits[20:40, 30:50] = FREE
    (whole,) = find_frontiers(known)
    parts = find_frontiers(known, across=8)
    assert len(parts) >= 9
    assert all(np.ptp(one.outline, axis=0).max() < 8 for one in parts)
    cells = {tuple(cell) for one in parts for cell in one.outline.tolist()}
    assert cells == {tuple(cell) for cell in whole.outline.tolist()}
    assert len(find_frontiers(known, across=100)) == 1


def test_a_thin_frontier_is_parted_once() -> None:
    """It is traced there and back, and each of its cells is in one part."""
    known = KnownMap((10, 60))
    known.bits[5, 5:45] = FREE
    parts = find_frontiers(known, across=10)
    cells = [tuple(cell) for one in parts for cell in one.outline.tolist()]
    assert len(cells) == len(set(cells)) == 40


def test_the_way_into_the_unknown(tmp_path: Path) -> None:
    """It leads where most is unknown, around no known corner, and ends at what is known."""
    scenario = small(tmp_path, "team.reach=2")
    view = Run(scenario).cycle.bodies[1].view
    view.known.bits[:] = 0
    view.known.bits[2:7, 2:8] = FREE
    way = into_unknown(view, (7, 4), 0.0, 5.0)
    assert way == [(8, 4), (9, 4), (10, 4), (11, 4), (12, 4)]
    view.known.bits[4, 10] = FREE
    assert into_unknown(view, (7, 4), 0.0, 5.0)[0] != (8, 4)
    assert into_unknown(view, (4, 4), 0.0, 5.0) == []
