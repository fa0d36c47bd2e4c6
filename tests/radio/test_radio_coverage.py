"""Maps of coverage: cells, walls, colours, files; and the command that draws them."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from radio_fakes import Walls as Fence
from radio_fakes import model

from usarsim_exploration.coverage import (
    SILENCE,
    SOURCE,
    WALL,
    Grid,
    Walls,
    color_of,
    draw_coverage,
    find_walls,
    pixels_per_cell,
    survey,
)
from usarsim_server.cli import main
from usarsim_server.simulation.rays.query import RayFan, RayHits

GRID = Grid.over((0.0, 0.0), (4.0, 3.0), 1.0, 0.5)
SOURCE_AT = (0.5, 0.5, 0.5)


def test_grids_cover_their_rectangle() -> None:
    """Cells begin at the lower corner; a rest gets a cell of its own."""
    assert (GRID.columns, GRID.rows) == (4, 3)
    assert GRID.centre(2, 3) == (3.5, 2.5, 0.5)
    assert GRID.centres()[2, 3].tolist() == [3.5, 2.5, 0.5]
    assert Grid.over((-1.0, 0.0), (1.1, 0.1), 0.5, 0.0).columns == 5
    assert Grid.over((0.0, 0.0), (0.3, 0.3), 0.1, 0.0).columns == 3


def test_cells_hold_what_the_model_says() -> None:
    """Strength and obstacles of every cell are those of the wireless simulation."""
    made = survey(model(), Fence(1.0, 2.0), SOURCE_AT, GRID)
    assert made.obstacles[1].tolist() == [0, 1, 2, 2]
    for row in range(3):
        for column in range(4):
            distance = math.dist(SOURCE_AT, GRID.centre(row, column))
            expected = model().strength(distance, int(made.obstacles[row, column]))
            assert made.strengths[row, column] == pytest.approx(expected)
    assert math.isinf(made.strengths[0, 0])
    assert made.linked.all()
    strict = survey(model(cutoff=-55), Fence(1.0, 2.0), SOURCE_AT, GRID)
    assert strict.linked[1].tolist() == [True, True, False, False]


def test_a_model_that_counts_nothing_asks_nobody() -> None:
    """Without obstacles in the model none are counted."""
    fence = Fence(1.0)
    assert not survey(model("distance"), fence, SOURCE_AT, GRID).obstacles.any()
    assert fence.asked == 0


def test_tables_are_in_the_wire_frame() -> None:
    """One line a cell; y and z have the sign of the wire."""
    file = io.StringIO()
    survey(model(cutoff=-55), Fence(1.0, 2.0), SOURCE_AT, GRID).write_csv(file)
    rows = list(csv.DictReader(io.StringIO(file.getvalue())))
    assert len(rows) == 12
    assert rows[0]["strength"] == "inf"
    last = rows[-1]
    assert [float(last[key]) for key in ("x", "y", "z")] == [3.5, -2.5, -0.5]
    assert float(last["strength"]) == pytest.approx(-49.67 - 10 * math.log10(13**0.5 / 2) - 12.65)
    assert (last["obstacles"], last["linked"]) == ("2", "0")


def test_walls_lie_between_cells() -> None:
    """A wall across x is found between the cells that it parts, and nowhere else."""

    def cast(fans: list[RayFan]) -> list[RayHits]:
        (fan,) = fans
        assert fan.max_range == 1.0
        crossed = (fan.origin[:, 0] < 2.0) & (fan.origin[:, 0] + fan.directions[:, 0] > 2.0)
        return [RayHits(np.where(crossed, 0.5, np.inf))]

    walls = find_walls(cast, GRID)  # type: ignore[arg-type]
    assert walls.along_x.tolist() == [[False, True, False]] * 3
    assert walls.along_y.shape == (2, 4)
    assert not walls.along_y.any()
    thin = find_walls(cast, Grid(0.5, 0.5, 1, 1, 1.0, 0.0))  # type: ignore[arg-type]
    assert thin.along_x.shape == (1, 0)


def test_colours() -> None:
    """The scale runs from dark violet to yellow; what is below it is grey, infinity is yellow."""
    colors = color_of(np.array([-93.0, -43.0, -93.1, math.inf, math.nan]), -93.0, -43.0)
    assert colors.tolist() == [
        [68, 1, 84],
        [253, 231, 37],
        list(SILENCE),
        [253, 231, 37],
        list(SILENCE),
    ]


def test_pictures_show_the_map_from_above() -> None:
    """x runs to the right, y (left of x) upwards; walls, source and silent cells have colours."""
    made = survey(model(cutoff=-55), Fence(1.0, 2.0), SOURCE_AT, GRID)
    walls = Walls(np.zeros((3, 3), np.bool_), np.zeros((2, 4), np.bool_))
    walls.along_x[0, 1] = True  # in the lowest row
    image = draw_coverage(made, walls, "title")
    size = pixels_per_cell(made)
    pixels = np.asarray(image)

    def cell(row: int, column: int) -> list[int]:
        y = int((2 - row + 0.5) * size)
        found: list[int] = pixels[y, int((column + 0.5) * size)].tolist()
        return found

    assert cell(0, 0) == list(SOURCE)
    assert cell(1, 3) == list(SILENCE)
    assert cell(1, 0) != cell(1, 1)
    assert pixels[int(2.5 * size), 2 * size].tolist() == list(WALL)
    assert pixels[int(1.5 * size), 2 * size].tolist() != list(WALL)


def test_the_command_draws_the_office(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From the lobby the corridor is covered and the workshop behind six walls is not."""
    picture, table = tmp_path / "map.png", tmp_path / "map.csv"
    options = ["--world", "office", "--from=-12,0,-0.5", "--cell", "0.5", "--csv", str(table)]
    assert main(["radio-map", str(picture), *options]) == 0
    assert "a link in" in capsys.readouterr().out
    with Image.open(picture) as image:
        assert image.format == "PNG"
        pixels = np.asarray(image.convert("RGB"))
    assert (pixels == WALL).all(axis=2).sum() > 1000
    with table.open() as file:
        rows = {(float(row["x"]), float(row["y"])): row for row in csv.DictReader(file)}

    def at(x: float, y: float) -> dict[str, str]:
        return rows[min(rows, key=lambda place: math.dist(place, (x, y)))]

    assert at(5, 0)["linked"] == "1"
    assert at(5, 0)["obstacles"] == "0"
    assert at(12.5, 8)["linked"] == "0"
    assert int(at(12.5, 8)["obstacles"]) >= 6


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--from", "0,0,-1", "--model", "x"], "unknown propagation model 'x'"),
        (["--from", "0,0,-1", "--cell", "0"], "--cell: 0 does not fit"),
        (["--from", "0,0,-1", "--cell", "0.001"], "cells are too many"),
        (["--from", "0,0,-1", "--area", "1,1,1,1"], "--area: is empty"),
        (["--from", "0,0,-1", "--wireless", "/no/such.toml"], "/no/such.toml: cannot be read"),
        (["--from", "0,0,-1", "--world", "nowhere"], "nowhere"),
    ],
)
def test_mistakes_are_told(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What cannot be drawn is one line and exit code 2."""
    assert main(["radio-map", str(tmp_path / "map.png"), "--world", "empty", *options]) == 2
    assert words in capsys.readouterr().err


def test_a_world_without_walls(tmp_path: Path) -> None:
    """Around the sender there is a map even if nothing stands in the world."""
    picture = tmp_path / "map.png"
    options = ["--world", "empty", "--from", "3,4,-1", "--model", "distance", "--cell", "4"]
    assert main(["radio-map", str(picture), *options]) == 0
    assert picture.stat().st_size > 500
    assert main(["radio-map", "/no/such/folder/map.png", *options]) == 2
