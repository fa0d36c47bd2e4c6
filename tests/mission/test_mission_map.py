"""The quality of a map: error of its walls and share of walls after the best alignment (O-53)."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_mission.grid import FREE, UNKNOWN, WALL, Grid
from usarsim_mission.map_quality import judge
from usarsim_mission.scoring import MapRule

RULE = MapRule()
CELL = 0.1


def office() -> Grid:
    """Three rooms of different sizes along a corridor, 16 by 9 m, with doors and a pillar."""
    cells = np.full((92, 162), FREE, np.uint8)
    cells[[0, -1], :] = WALL
    cells[:, [0, -1]] = WALL
    cells[50, :] = WALL
    cells[50:, 55] = WALL
    cells[50:, 110] = WALL
    for door in (20, 80, 140):
        cells[50, door : door + 9] = FREE
    cells[20:24, 40:44] = WALL
    return Grid(-3.0, 2.0, CELL, cells)


TRUE = office()


def placed(dx: float, dy: float, degrees: float, cell: float = CELL) -> Grid:
    """The true walls as a map whose frame is shifted and turned, drawn anew in its own cells."""
    row, column = np.nonzero(TRUE.cells == WALL)
    fine = (np.arange(4) + 0.5) / 4.0
    x = TRUE.x + (column[:, None, None] + fine[None, :, None]) * CELL + 0.0 * fine
    y = TRUE.y + (row[:, None, None] + fine[None, None, :]) * CELL + 0.0 * fine[:, None]
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    places = np.column_stack(
        (c * x.ravel() - s * y.ravel() + dx, s * x.ravel() + c * y.ravel() + dy)
    )
    return drawn(places, cell)


def drawn(places: NDArray[np.float64], cell: float) -> Grid:
    low = places.min(0) - 1.5 * cell
    columns, rows = np.ceil((places.max(0) - low) / cell).astype(int) + 1
    cells = np.full((rows, columns), UNKNOWN, np.uint8)
    column, row = np.floor((places - low) / cell).astype(int).T
    cells[row, column] = WALL
    return Grid(float(low[0]), float(low[1]), cell, cells)


def test_the_true_map_scores_1() -> None:
    """O-53."""
    quality = judge(TRUE, TRUE)
    assert quality.error == pytest.approx(0.0, abs=1e-9)
    assert quality.share == 1.0
    assert quality.points(RULE) == 1.0


def test_a_map_shifted_by_1_m_scores_1_after_alignment() -> None:
    """O-53."""
    for dx, dy in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (-0.7, 0.7)):
        moved = Grid(TRUE.x + dx, TRUE.y + dy, CELL, TRUE.cells)
        quality = judge(moved, TRUE)
        assert quality.points(RULE) == 1.0
        assert quality.shift == pytest.approx((-dx, -dy, 0.0), abs=0.05)


def test_an_empty_map_scores_0() -> None:
    """O-53: all unknown, or all free."""
    for what in (UNKNOWN, FREE):
        empty = Grid(0.0, 0.0, CELL, np.full((10, 10), what, np.uint8))
        assert judge(empty, TRUE).points(RULE) == 0.0


@pytest.mark.parametrize(
    ("dx", "dy", "degrees", "cell"),
    [
        (30.0, -20.0, 0.0, 0.1),
        (0.0, 0.0, 10.0, 0.1),
        (5.0, 5.0, 90.0, 0.1),
        (-4.0, 12.3, 180.0, 0.1),
        (1.0, 2.0, -37.0, 0.05),
        (-8.0, 3.0, 123.0, 0.2),
    ],
)
def test_any_frame_and_raster_is_as_good(dx: float, dy: float, degrees: float, cell: float) -> None:
    """O-53: a map in a frame of its own, shifted and turned, finer or coarser."""
    quality = judge(placed(dx, dy, degrees, cell), TRUE)
    assert quality.points(RULE) > 0.97, quality
    turn = math.degrees(quality.shift[2])
    assert math.remainder(turn + degrees, 360.0) == pytest.approx(0.0, abs=1.0)


def test_half_a_map_has_half_of_the_walls() -> None:
    half = TRUE.cells.copy()
    half[:, 81:] = UNKNOWN
    quality = judge(Grid(TRUE.x, TRUE.y, CELL, half), TRUE)
    assert quality.error == pytest.approx(0.0, abs=0.01)
    assert quality.share == pytest.approx(0.5, abs=0.04)
    assert quality.points(RULE) == pytest.approx(quality.share)


def test_the_error_is_the_mean_distance_to_true_walls() -> None:
    """All true walls, and a wall of 4 m that is 1.45 m from the next true one."""
    row, column = np.nonzero(TRUE.cells == WALL)
    true = np.column_stack((column, row)) * CELL + (TRUE.x, TRUE.y) + CELL / 2
    along = TRUE.x + 8.05 + np.linspace(-2.0, 2.0, 41)
    wrong = np.column_stack((along, np.full(41, TRUE.y + 1.55)))
    quality = judge(drawn(np.concatenate((true, wrong)), CELL), TRUE)
    assert quality.error == pytest.approx(41 * 1.45 / (len(true) + 41), abs=0.005)
    assert quality.share == 1.0


def test_noise_costs_what_the_rule_says() -> None:
    random = np.random.default_rng(1)
    row, column = np.nonzero(TRUE.cells == WALL)
    true = np.column_stack((column, row)) * CELL + (TRUE.x, TRUE.y) + CELL / 2
    points = [
        judge(drawn(true + random.normal(0.0, sigma, true.shape), CELL), TRUE).points(RULE)
        for sigma in (0.02, 0.2, 0.4)
    ]
    assert points[0] > 0.95
    assert points[0] > points[1] > points[2]


def test_floor_that_keeps_away_from_walls_is_as_good() -> None:
    """Where robots get their middles are at least 0.3 m away; what nobody gets near is no wall."""
    row, column = np.indices(TRUE.cells.shape)
    near = cv2.erode((TRUE.cells == FREE).astype(np.uint8), np.ones((7, 7), np.uint8))
    cells = np.where(near > 0, FREE, np.where(TRUE.cells == WALL, WALL, UNKNOWN)).astype(np.uint8)
    cells[(row > 52) & (column > 112) & (TRUE.cells != WALL)] = UNKNOWN
    room = TRUE.cells.copy()
    room[(row > 65) & (column > 125)] = UNKNOWN
    quality = judge(Grid(TRUE.x, TRUE.y, CELL, room), Grid(TRUE.x, TRUE.y, CELL, cells))
    assert quality.points(RULE) == pytest.approx(1.0, abs=0.02)


def test_a_world_without_walls_has_no_map() -> None:
    free = Grid(0.0, 0.0, CELL, np.full((10, 10), FREE, np.uint8))
    assert judge(TRUE, free).points(RULE) == 0.0
