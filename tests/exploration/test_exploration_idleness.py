"""Robots that stand although there is something to find."""

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from small_world import small

from usarsim_exploration.idleness import has_frontier
from usarsim_exploration.measures import measure
from usarsim_exploration.running import Run, run
from usarsim_exploration.strategy import Plan, Strategy, View


@dataclass
class Stands(Strategy):
    """Never moves."""

    state: str

    def decide(self, view: View) -> Plan | None:
        """Stay."""
        return Plan([], self.state)


@pytest.mark.parametrize(("state", "idle"), [("explore", 30), ("return", 30), ("wait", 0)])
def test_who_stands_beside_a_frontier_is_idle(state: str, idle: int, tmp_path: Path) -> None:
    """EXP-18: looked at every ten steps; who waits for others is not idle."""
    scenario = small(tmp_path, "end.base=off", "end.home=false", "end.steps=35")
    result = run(replace(scenario, strategy=Stands(state)))
    assert measure(result.history)["longest_idle"] == idle
    assert not result.history.idle[:, 0].any()


def test_who_drives_or_has_nothing_to_find_is_not_idle(tmp_path: Path) -> None:
    """EXP-18: robots that explored all and are home; a frontier with a wall behind is none."""
    one = Run(small(tmp_path, "end.base=off", "end.home=false", "end.steps=90"))
    environment = one.cycle.environment
    assert all(has_frontier(body.view, environment) for body in one.cycle.bodies[1:])
    while one.step():
        pass
    history = one.result().history
    assert measure(history)["longest_idle"] == 0
    assert (history.cell[-1] == history.cell[-20]).all()
    start = Run(small(tmp_path)).cycle.bodies[1].view
    assert not has_frontier(start, replace(environment, walls=environment.walls | 1))
