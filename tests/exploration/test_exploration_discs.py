"""Robots on cells that take room and time to turn: they wait, keep apart, see while they turn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_exploration import run_folder
from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.levels.discs import DiscLevel, Discs
from usarsim_exploration.log_files import agents_csv, steps_csv
from usarsim_exploration.measures import measure
from usarsim_exploration.radio import Circle
from usarsim_exploration.running import run
from usarsim_exploration.scenario import read
from usarsim_exploration.strategy import Plan, Strategy, View
from usarsim_exploration.walking import line
from usarsim_server import cli

WIDTH = 6.0


@dataclass
class Ways(Strategy):
    """Each robot drives straight to a cell of its own, by its number."""

    goals: tuple[Cell, ...] = ()

    def decide(self, view: View) -> Plan | None:
        """Anew whenever nothing is left of it."""
        goal = self.goals[view.number - 1]
        near = math.dist(view.cell, goal) < 2
        return None if view.path or near else Plan(line(view.cell, goal))


def cycle_of(
    walls: NDArray[np.uint8], starts: list[Cell], goals: list[Cell], turn: float = 1e5
) -> Cycle:
    """Robots that look to the right at first and know all free cells."""
    team = [Member("base", "base", (2, 2), reach=0)]
    team += [Member(f"r{n}", "explorer", one, speed=10.0) for n, one in enumerate(starts)]
    level = DiscLevel(Discs(WIDTH, turn))
    return set_up(Environment("", walls), team, Ways(tuple(goals)), Circle(), 1, level=level)


def hall(rows: int = 60, columns: int = 100) -> NDArray[np.uint8]:
    """Free cells within walls."""
    walls = np.ones((rows, columns), np.uint8)
    walls[1:-1, 1:-1] = 0
    return walls


def gaps(cycle: Cycle, steps: int) -> list[float]:
    """Cells between the two robots after each step."""
    found = []
    for _ in range(steps):
        cycle.advance()
        one, other = (body.view.cell for body in cycle.bodies[1:])
        found.append(math.dist(one, other))
    return found


@pytest.mark.slow
def test_robots_go_around_each_other_and_keep_apart() -> None:
    """Two that meet head-on in a hall both arrive, and are never nearer than their width."""
    cycle = cycle_of(hall(), [(15, 30), (85, 30)], [(85, 30), (15, 30)])
    assert min(gaps(cycle, 14)) >= WIDTH
    ends = [body.view.cell for body in cycle.bodies[1:]]
    assert math.dist(ends[0], (85, 30)) < 9
    assert math.dist(ends[1], (15, 30)) < 9
    assert all(body.distance > 70 for body in cycle.bodies[1:])


def test_who_comes_second_through_a_door_waits() -> None:
    """Both want through at once: one is later than alone; and points would both be on time."""
    walls = hall()
    walls[:, 50] = 1
    walls[25:35, 50] = 0
    goals = [(80, 20), (80, 40)]
    both = cycle_of(walls, [(40, 26), (40, 34)], goals)
    alone = cycle_of(walls, [(40, 26), (10, 55)], [goals[0], (10, 55)])
    assert min(gaps(both, 3)) >= WIDTH - 1
    gaps(alone, 3)
    assert min(body.distance for body in both.bodies[1:]) < alone.bodies[1].distance - 4


def test_head_on_in_a_corridor_they_pass_after_some_steps() -> None:
    """Where there is no room to go around, nobody waits for ever."""
    walls = np.ones((20, 100), np.uint8)
    walls[6:14, 1:-1] = 0
    cycle = cycle_of(walls, [(20, 10), (80, 10)], [(80, 10), (20, 10)])
    found = gaps(cycle, 20)
    assert min(found[:4]) >= WIDTH
    ends = [body.view.cell for body in cycle.bodies[1:]]
    assert ends[0][0] > 70
    assert ends[1][0] < 30


@pytest.mark.parametrize(("turn", "moved"), [(1e5, True), (180.0, False), (90.0, False)])
def test_turning_takes_time_and_shows_what_is_behind(turn: float, moved: bool) -> None:
    """A robot that has to turn about is under way at once, or a step later; it scans meanwhile."""
    cycle = cycle_of(hall(), [(50, 30)], [(20, 30)], turn)
    body = cycle.bodies[1]
    seen = np.count_nonzero(body.view.known.bits[:, :45])
    assert seen < 100  # it looks the other way
    cycle.advance()
    assert (body.distance > 6) == moved
    assert np.count_nonzero(body.view.known.bits[:, :45]) > (2000 if turn > 90 else 400)
    before = body.distance
    cycle.advance()
    assert body.distance > before


def test_robots_keep_off_walls() -> None:
    """Along a wall the way is at least half a width away from it."""
    cycle = cycle_of(hall(), [(10, 10)], [(90, 2)])
    rows = []
    for _ in range(7):
        cycle.advance()
        rows += [cell[1] for cell in cycle.bodies[1].view.path[:0]] + [cycle.bodies[1].view.cell[1]]
    assert min(rows[:5]) >= WIDTH / 2


LAB = {
    "backend": "discs",
    "environment": {"name": "lab"},
    "team": {"robots": 4},
    "strategy": {"name": "frontier"},
    "end": {"steps": 60},
}


def test_a_run_repeats_and_gets_less_far_than_points() -> None:
    """E-20, E-81: equal bytes twice; discs drive less far in a step than points."""
    one, other = run(read(LAB)), run(read(LAB))
    assert steps_csv(one.history) == steps_csv(other.history)
    assert agents_csv(one.history) == agents_csv(other.history)
    points = run(read({**LAB, "backend": "grid"}))
    slow, fast = (each.history.distance[20].sum() for each in (one, points))
    assert 0.5 * fast < slow < 0.95 * fast
    assert one.scenario.resolved["discs"] == {"width": 6.0, "turn": 150.0}


def test_a_replay_does_not_compare_what_points_scan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Robots of a replay are points: they go where discs went, and scan otherwise."""
    run_folder.write(run(read({**LAB, "end": {"steps": 9}})), tmp_path, {})
    assert cli.main(["explore", "replay", str(tmp_path)]) == 0
    assert "numbers are not compared, for robots of discs scan elsewhere" in capsys.readouterr().out


def test_a_robot_that_fails_stays_in_the_way() -> None:
    """E-82: others go around it, and get home."""
    told = {**LAB, "event": [{"step": 10, "kind": "loss", "robot": "R2"}], "end": {"steps": 150}}
    result = run(read(told))
    assert [step for step, _ in result.events] == [10]
    found = measure(result.history)
    assert found["team_percent_reachable"] > 90  # type: ignore[operator]
