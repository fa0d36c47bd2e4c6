"""Passages of one to three cells: explored by who fits, and told once to who does not."""

from pathlib import Path

import numpy as np
import pytest
from lanes import slow_but
from small_world import text_map

from usarsim_exploration.running import Result, run
from usarsim_exploration.scenario import read
from usarsim_exploration.strategy import TYPES
from usarsim_exploration.worlds.fitting import accessible
from usarsim_server.cli import main

MAZE = str(Path(__file__).parent / "cases" / "15" / "maze1.txt")
SEEKING = sorted(set(TYPES.names()) - {"random-walk"})
TRIED = slow_but({"frontier", "market", "role-based"}.__contains__, SEEKING)
"""Others by which robots seek are slow tests."""


def crossed(folder: Path) -> str:
    """A corridor of one cell, four ways that cross it, and no room."""
    walls = np.ones((21, 41), np.uint8)
    walls[10, 1:40] = 0
    walls[1:20, (1, 13, 27, 39)] = 0
    picture = "\n".join("".join(".#"[one] for one in row) for row in walls)
    (folder / "crossed.txt").write_text(text_map(picture))
    return str(folder / "crossed.txt")


def wide(folder: Path, cells: int) -> str:
    """Two rooms of 30 cells, joined by a passage so wide."""
    walls = np.ones((32, 82), np.uint8)
    walls[1:31, 1:31] = walls[1:31, 51:81] = 0
    walls[16 : 16 + cells, 31:51] = 0
    picture = "\n".join("".join(".#"[one] for one in row) for row in walls)
    (folder / f"wide{cells}.txt").write_text(text_map(picture))
    return str(folder / f"wide{cells}.txt")


def explored(world: str, backend: str, width: float | None = None, robots: int = 1) -> Result:
    """With `frontier`, and an angle of view that misses nothing."""
    content: dict[str, object] = {
        "backend": backend,
        "environment": {"name": world},
        "team": {"robots": robots},
        "end": {"steps": 80},
    }
    if width is not None:
        content["discs"] = {"width": width}
    return run(read(content))


@pytest.mark.parametrize("robots", [1, 3])
@pytest.mark.parametrize("strategy", TRIED)
def test_lanes_of_one_cell(strategy: str, robots: int) -> None:
    """Any strategy explores them, on the grid."""
    content = {
        "environment": {"name": MAZE},
        "team": {"robots": robots},
        "strategy": {"name": strategy},
        "end": {"steps": 40},
    }
    assert run(read(content)).ended == "base knows"


@pytest.mark.parametrize("robots", [1, 2])
def test_lanes_of_one_cell_for_discs_that_fit(robots: int) -> None:
    """A robot of one cell drives in a passage of one."""
    result = explored(MAZE, "discs", 1.0, robots)
    assert result.ended == "base knows"
    assert not result.scenario.world.notes


@pytest.mark.parametrize("cells", [1, 2, 3])
@pytest.mark.parametrize("backend", ["grid", "discs"])
def test_a_narrow_passage_between_rooms(backend: str, cells: int, tmp_path: Path) -> None:
    """Of one to three cells, for robots that fit: their middle is in the middle of a cell."""
    width = float(cells - (cells == 2)) if backend == "discs" else None
    result = explored(wide(tmp_path, cells), backend, width)
    assert result.ended == "base knows"
    assert result.history.cell[:, 1, 0].max() > 40 or cells > 1


@pytest.mark.parametrize("strategy", TRIED)
def test_robots_that_meet_in_a_corridor_part(strategy: str, tmp_path: Path) -> None:
    """Four, of which two meet at each end of a corridor of one cell: none follows another on."""
    starts = {"A": 18, "B": 19, "C": 21, "D": 22}
    content = {
        "environment": {"name": crossed(tmp_path)},
        "team": {"base": [20, 10], "reach": 6, "speed": 2, "view": 360},
        "robot": [{"name": name, "start": [column, 10]} for name, column in starts.items()],
        "strategy": {"name": strategy},
        "end": {"steps": 160},
    }
    result = run(read(content))
    history = result.history
    assert result.ended == "base knows"
    if strategy.startswith("role-based") or strategy == "leader-follower":
        return  # a pair drives together, and a chain stands in one place
    explores = history.state[:, 1:] == "explore"
    longest = 0
    for one in range(4):
        for other in range(one):
            same = (history.cell[:, 1 + one] == history.cell[:, 1 + other]).all(axis=1)
            same &= (history.goal[:, 1 + one] == history.goal[:, 1 + other]).all(axis=1)
            same &= explores[:, one] & explores[:, other]
            run_of = 0
            for holds in same.tolist():
                run_of = run_of + 1 if holds else 0
                longest = max(longest, run_of)
    assert longest <= 8


@pytest.mark.parametrize(
    ("strategy", "most"),
    slow_but(
        lambda pair: pair[0] in {"frontier", "next-best-view"},
        [
            *((name, 0.2) for name in ("frontier", "minpos", "voronoi", "market", "nearest")),
            *((name, 0.2) for name in ("greedy", "hungarian")),
            ("next-best-view", 0.35),
        ],
    ),
)
def test_robots_that_meet_in_a_maze_part(strategy: str, most: float) -> None:
    """Four in `maze` are seldom in one cell, though its corridors lead all of them along."""
    content = {
        "environment": {"name": "maze"},
        "team": {"robots": 4},
        "strategy": {"name": strategy},
        "end": {"steps": 300},
    }
    history = run(read(content)).history
    cells = [{tuple(one) for one in row} for row in history.cell[1:, 1:].tolist()]
    assert np.mean([len(one) < history.robots for one in cells]) <= most


@pytest.mark.parametrize("backend", ["discs", "server"])
def test_what_a_width_forbids_is_told(backend: str, tmp_path: Path) -> None:
    """In one sentence, with the width, that of the passage, and a cure; else nothing is said."""
    (told,) = read({"backend": backend, "environment": {"name": wide(tmp_path, 3)}}).world.notes
    assert "robots are 6 cells (0.6 m) wide" in told
    assert "52 % of the reachable cells" in told
    assert "passages of 3 cells (0.3 m)" in told
    assert "cure:" in told
    assert "discs.width" in told
    for world, cell in ((wide(tmp_path, 7), 0.1), (wide(tmp_path, 3), 0.3), ("lab", None)):
        place = {"name": world} | ({"cell": cell} if cell else {})
        assert not read({"backend": backend, "environment": place}).world.notes
    assert not read({"environment": {"name": wide(tmp_path, 3)}}).world.notes


def test_the_command_tells_it_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At the start of the run."""
    world = wide(tmp_path, 2)
    command = ["explore", "run", "--world", world, "--backend", "discs", "--steps", "5"]
    assert main(command) == 0
    assert capsys.readouterr().err.count("robots are 6 cells (0.6 m) wide") == 1


def test_where_a_width_gets_to(tmp_path: Path) -> None:
    """By hand: all of a room but nothing behind a door that is too narrow."""
    environment = read({"environment": {"name": wide(tmp_path, 4)}}).world.environment
    assert accessible(environment, (10, 10), 3.0) == environment.free
    there = accessible(environment, (10, 10), 5.0)
    assert 880 <= there <= 900 + 4 * 3
    assert accessible(environment, (10, 10), 31.0) == 0
