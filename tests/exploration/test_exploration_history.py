"""What is noted of a run: latencies by hand, counts again by brute force."""

from dataclasses import dataclass

import numpy as np

from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.history import NOWHERE, Recorder
from usarsim_exploration.known_map import FREE
from usarsim_exploration.radio import Circle
from usarsim_exploration.strategies.frontier import FrontierStrategy
from usarsim_exploration.strategy import Plan, Strategy, View


@dataclass
class ThereAndBack(Strategy):
    """Drives so many cells to the right, then back."""

    away: int

    def decide(self, view: View) -> Plan | None:
        """One plan, at the first step."""
        if view.step != 1:
            return None
        column, row = view.cell
        out: list[Cell] = [(column + step, row) for step in range(1, self.away + 1)]
        return Plan([*out, *reversed(out[:-1]), view.cell], "explore")


def corridor(strategy: Strategy, reach: int = 5) -> Cycle:
    """Base and one robot, one cell a step, a radio that reaches 2 cells."""
    walls = np.zeros((5, 60), np.uint8)
    walls[[0, -1]] = 1
    team = [
        Member("Base", "base", (5, 2), reach=0, radio_range=2.5),
        Member("R1", "explorer", (5, 2), speed=1.0, reach=reach, radio_range=2.5),
    ]
    return set_up(Environment("corridor", walls), team, strategy, Circle(), 1)


def test_latency_of_a_way_out_and_back() -> None:
    """E-74: out 30 steps, back 30: the hand value."""
    cycle = corridor(ThereAndBack(30))
    recorder = Recorder(cycle)
    for _ in range(60):
        cycle.advance()
        recorder.note()
    history = recorder.history()
    # linked up to 2 cells away: heard of steps 0 to 2 at once, of 3 to 58 at step 58
    assert history.linked_base[:, 1].sum() == 3 + 3
    assert history.latency[57, 1] == 57 - 2
    assert history.latency[58, 1] == 0
    longest, total = history.message_latencies()
    assert longest[-1].tolist() == [0, 55]
    assert total[-1].tolist() == [0, sum(range(56))]
    assert total[57].tolist() == [0, 0]
    assert history.distance[-1, 1] == 60.0
    assert [len(pairs) for pairs in history.links] == [1] * 3 + [0] * 55 + [1] * 3


def test_counts_are_those_of_the_maps() -> None:
    """E-73: areas equal a recount of all grids; a robot that fails finds nothing more."""
    walls = np.zeros((40, 50), np.uint8)
    walls[[0, -1]] = 1
    walls[:, [0, -1]] = 1
    walls[:30, 25] = 1
    walls[10:13, 30:33] = 1
    walls[11, 31] = 0  # nobody gets in
    team = [Member("Base", "base", (3, 3), reach=0, radio_range=12)]
    team += [Member(f"R{n}", "explorer", (3 + n, 3), reach=9, radio_range=12) for n in (1, 2)]
    cycle = set_up(Environment("two rooms", walls), team, FrontierStrategy(), Circle(), 3)
    recorder, union = Recorder(cycle), np.zeros(walls.shape, bool)
    for step in range(31):
        if step == 20:
            cycle.bodies[2].works = False
        if step:
            cycle.advance()
            recorder.note()
        grids = [(body.view.known.bits & FREE != 0) & (walls == 0) for body in cycle.bodies]
        union |= np.logical_or.reduce(grids)
        history = recorder.history()
        assert history.area[-1].tolist() == [np.count_nonzero(grid) for grid in grids]
        assert history.free_base[-1] == history.area[-1, 0]
        assert history.free_team[-1] == np.count_nonzero(union)
    assert history.steps == 30
    assert history.free[-1] == np.count_nonzero(walls == 0) == history.reachable[-1] + 1
    assert history.own[-1, 1] + history.at_base[-1, 1] == history.believed[-1, 1]
    assert not history.found[20:, 2].any()
    assert history.works[:, 2].sum() == 20
    assert history.cell.shape == (31, 3, 2)
    assert tuple(history.goal[0, 0]) == NOWHERE
    assert history.role[0].tolist() == ["base", "explorer", "explorer"]
