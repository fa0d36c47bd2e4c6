"""What a referee knows of a world survives `world.json`, and damaged files are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from usarsim_mission.errors import MissionError
from usarsim_mission.grid import FREE, UNKNOWN, WALL, Grid
from usarsim_mission.model import (
    Fan,
    Mission,
    Start,
    Victim,
    World,
    Zone,
    read_world,
    world_json,
)


def world() -> tuple[Mission, World]:
    cells = np.zeros((3, 4), np.uint8)
    cells[1, :] = FREE
    cells[2, 3] = WALL
    return Mission("search", 7, 1200.0, 0.5, True, 2), World(
        "Office",
        (-1.0, -2.0, -3.0),
        (1.0, 2.0, 3.0),
        (Victim("Anna", (1.0, 2.0, 0.2), "conscious"), Victim("Ben", (4.0, 5.0, 0.0))),
        (Zone("cellar", "yellow", ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0))),),
        (Start("R1", "P3AT", (1.0, 0.0, 0.1), 1.5, (Fan(20.0, 3.14, 0.1),)),),
        Grid(-1.0, -2.0, 0.5, cells),
    )


def test_world_json_tells_all_of_it(tmp_path: Path) -> None:
    mission, told = world()
    path = tmp_path / "world.json"
    path.write_text(world_json(mission, told))
    again, read = read_world(path)
    assert again == mission
    assert (read.title, read.low, read.high) == (told.title, told.low, told.high)
    assert (read.victims, read.zones, read.starts) == (told.victims, told.zones, told.starts)
    assert read.floor is not None
    assert told.floor is not None
    assert np.array_equal(read.floor.cells, told.floor.cells)
    assert (read.floor.x, read.floor.y, read.floor.cell) == (-1.0, -2.0, 0.5)
    assert world_json(again, read) == world_json(mission, told)


def test_a_grid_tells_what_is_at_a_place() -> None:
    _, told = world()
    assert told.floor is not None
    assert told.floor.at(-0.9, -1.4) == FREE
    assert told.floor.at(0.9, -0.6) == WALL
    assert told.floor.at(-1.1, -1.4) == UNKNOWN
    assert told.floor.at(5.0, 5.0) == UNKNOWN


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"zone": []}, "did you mean zones?"),
        ({"title": 3}, "is not text"),
        ({"victims": [{"name": "A"}]}, "[[victims]] 1 (A): pos: is missing"),
        ({"zones": [{"name": "Z", "colour": "yelow", "points": []}]}, "did you mean yellow?"),
        ({"zones": [{"name": "Z", "colour": "red", "points": [[0, 0]]}]}, "at least three points"),
        ({"floor": {"x": 0}}, "the grid has no y"),
        ({"mission": {"time_limit": -1}}, "is out of range"),
    ],
)
def test_a_world_that_cannot_be_is_refused(
    tmp_path: Path, change: dict[str, object], problem: str
) -> None:
    content = {**json.loads(world_json(*world())), **change}
    path = tmp_path / "world.json"
    path.write_text(json.dumps(content))
    with pytest.raises(MissionError) as refusal:
        read_world(path)
    assert problem in str(refusal.value)
    assert str(path) in str(refusal.value)


def test_damaged_cells_are_refused(tmp_path: Path) -> None:
    plain = Grid(0.0, 0.0, 0.1, np.ones((4, 4), np.uint8)).packed()
    for bad in ({"cells": "%%"}, {"cells": "AAAA"}, {"rows": 5}, {"rows": 0}, {"cell": 0.0}):
        with pytest.raises(ValueError, match="grid"):
            Grid.unpacked({**plain, **bad})
    with pytest.raises(ValueError, match="0, 1 or 2"):
        Grid.unpacked(Grid(0.0, 0.0, 0.1, np.full((4, 4), 3, np.uint8)).packed())
