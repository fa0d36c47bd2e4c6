"""How far robots drive in a step, what stops them, and what noise does to their maps."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from lanes import slow_but
from numpy.typing import NDArray
from small_world import small

from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.known_map import AT_BASE, FREE, KNOWN, SAFE, WALL
from usarsim_exploration.log_files import agents_csv
from usarsim_exploration.noise import disturb
from usarsim_exploration.radio import Circle
from usarsim_exploration.running import run
from usarsim_exploration.scenario import read
from usarsim_exploration.sensing import Scanner
from usarsim_exploration.strategy import Plan, Strategy, View

NEAR = {"robots": 2, "base": "drawn at a wall", "reach": 40, "radio": 2000}


@dataclass
class Along(Strategy):
    """Drives through these cells, whatever it knows."""

    path: tuple[Cell, ...] = ()

    def decide(self, view: View) -> Plan | None:
        """The whole way at the first step."""
        return Plan(list(self.path)) if view.step == 1 else None


def drive(walls: NDArray[np.uint8], path: list[Cell], speed: float = 10.0) -> Cycle:
    """One robot at the first cell of a path, which it is told to drive."""
    team = [
        Member("base", "base", path[0], reach=0),
        Member("r1", "explorer", path[0], speed=speed, reach=30),
    ]
    return set_up(Environment("", walls), team, Along(tuple(path[1:])), Circle(), 1)


def test_ten_cells_straight_seven_across() -> None:
    """E-14: what is left of the speed after seven diagonals is too little for an eighth."""
    free = np.zeros((60, 60), np.uint8)
    straight = drive(free, [(column, 30) for column in range(5, 50)])
    across = drive(free, [(at, at) for at in range(5, 50)])
    for step in range(1, 4):
        straight.advance()
        across.advance()
        assert straight.bodies[1].view.cell == (5 + 10 * step, 30)
        assert across.bodies[1].view.cell == (5 + 7 * step, 5 + 7 * step)
    assert across.bodies[1].distance == pytest.approx(21 * math.sqrt(2))


def test_a_supposed_wall_that_turns_out_free_counts() -> None:
    """E-73: what the team knows to be free, whatever it took a cell for before."""
    cycle = drive(np.zeros((40, 40), np.uint8), [(5, 20), (6, 20)])
    before, maps = cycle.team_free, [body.view.known.bits for body in cycle.bodies]
    row, column = np.argwhere(maps[1] & (FREE | WALL) == FREE)[0]
    for change, count in ((WALL, before - 1), (FREE, before)):
        for bits in maps:
            bits[row, column] = change
        assert cycle.team_free == count


@pytest.mark.parametrize("strategy", ["frontier", "random-walk", "wall-follow", "role-based"])
def test_nobody_drives_more_than_its_speed(tmp_path: Path, strategy: str) -> None:
    """E-13: in each step of a whole run, at a speed that is no whole number."""
    one = run(small(tmp_path, f"strategy.name='{strategy}'", "team.speed=2.5", "end.base=off"))
    steps = np.diff(one.history.distance, axis=0)
    assert steps.max() <= 2.5 + 1e-9
    assert one.history.distance[-1].max() > 10


def test_nobody_squeezes_between_two_corners() -> None:
    """E-15: walls that touch at a corner stop a diagonal; with one of them gone still."""
    walls = np.zeros((20, 20), np.uint8)
    walls[9, 10] = walls[10, 9] = 1
    for gone in (None, (9, 10), (10, 9)):
        there = walls.copy()
        if gone is not None:
            there[gone] = 0
        cycle = drive(there, [(7, 7), (8, 8), (9, 9), (10, 10)])
        cycle.advance()
        body = cycle.bodies[1]
        assert (body.view.cell, body.view.blocked) == ((9, 9), True)
    free = drive(np.zeros((20, 20), np.uint8), [(7, 7), (8, 8), (9, 9), (10, 10)])
    free.advance()
    assert free.bodies[1].view.cell == (10, 10)


def test_all_that_is_traded_with_the_base_is_known_there() -> None:
    """E-30: on both sides, right after the contact."""
    walls = np.zeros((40, 90), np.uint8)
    walls[[0, -1]] = walls[:, [0, -1]] = 1
    cycle = drive(walls, [(column, 20) for column in range(5, 80)])
    cycle.advance()
    base, robot = (body.view.known for body in cycle.bodies)
    for known in (base, robot):
        shared = known.bits & KNOWN != 0
        assert shared.sum() > 500
        assert (known.bits[shared] & AT_BASE).all()
        assert known.undelivered == 0
    assert np.array_equal(base.bits & KNOWN != 0, robot.bits & KNOWN != 0)


@pytest.mark.slow
def test_noise_is_off_and_repeats(tmp_path: Path) -> None:
    """E-25: without it maps hold no wall where none is; with it equal seeds err alike."""
    found = {}
    for seed, noise in ((1, 0.0), (1, 1.5), (2, 1.5)):
        options = f"seed={seed}", f"team.noise={noise}", "end.base=off", "end.steps=30"
        first, again = run(small(tmp_path, *options)), run(small(tmp_path, *options))
        assert agents_csv(first.history) == agents_csv(again.history)
        known = [body.view.known.bits for body in first.cycle.bodies]
        for one, other in zip(known, (b.view.known.bits for b in again.cycle.bodies), strict=True):
            assert np.array_equal(one, other)
        free = first.scenario.world.environment.walls == 0
        measured = known[1] & (WALL | SAFE) == WALL | SAFE
        found[seed, noise] = known[1], measured & free
    assert not found[1, 0.0][1].any()
    assert found[1, 1.5][1].any()
    assert not np.array_equal(found[1, 1.5][0], found[2, 1.5][0])


def test_noise_is_as_large_as_it_is_said() -> None:
    """Readings of walls err by a normal distribution; rays that meet nothing read as before."""
    walls = np.zeros((200, 60), np.uint8)
    walls[80:100, 40:] = 1
    scans = Scanner(Environment("", walls), 30).scan([(20, 100)] * 50, [0.0] * 50)
    noisy = disturb(scans, 1.0, 30, walls.shape, np.random.default_rng(1))
    errors = noisy.readings - scans.readings
    assert not errors[~scans.hits].any()
    assert abs(errors[scans.hits].mean()) < 0.1
    assert 0.9 < errors[scans.hits].std() < 1.1
    off = np.hypot(*np.moveaxis(noisy.ends - scans.cells[:, None], 2, 0)) - noisy.readings
    assert abs(off[scans.hits]).max() < 1.5
    assert (noisy.free_ends[~scans.hits] == scans.free_ends[~scans.hits]).all()


@pytest.mark.parametrize(
    ("world", "name", "team", "radio", "seed", "steps", "least"),
    slow_but(
        lambda one: one[0] == "hall",
        [
            ("blocks", "range-constrained", {"robots": 4}, "path-loss", 5, 560, 0.5),
            ("cave", "leader-follower", {"robots": 8}, "path-loss", 1, 420, 0.75),
            ("hall", "leader-follower", {"robots": 2}, "circle", 3, 300, 0.95),
            ("warren", "range-constrained", {"robots": 4}, "path-loss", 4, 330, 0.1),
            ("hall", "wall-follow", NEAR, "circle", 9, 160, 0.3),
        ],
    ),
)
def test_nobody_stands_about(
    world: str,
    name: str,
    team: dict[str, object],
    radio: str,
    seed: int,
    steps: int,
    least: float,
) -> None:
    """EXP-18: starts where robots stood though there was something to find.

    A relay stood for robots that had gone home; no link let go; each of two minded a link that was
    as long as it may be; one had gone home for good before others found more; one went round in
    seven moves that were too few to be a lap.
    """
    scenario = read(
        {
            "seed": seed,
            "environment": {"name": world},
            "team": {"base": "drawn"} | team,
            "strategy": {"name": name},
            "radio": {"model": radio},
            "end": {"steps": steps},
        }
    )
    result = run(scenario)
    assert result.history.idle.max() <= 60
    assert result.history.free_team[-1] >= least * result.cycle.environment.free
