"""A team whose cameras are all watched: every tile has its viewer, and the worst one counts."""

from __future__ import annotations

import pytest

from usarsim_bench.camera_client import ViewerTrial
from usarsim_bench.cameras import TILE_SIZE, grid, tiles_of, watched_figures
from usarsim_bench.server import Load
from usarsim_bench.team import TeamTrial


@pytest.mark.parametrize(
    ("cameras", "columns", "rows"), [(1, 1, 1), (2, 2, 1), (6, 6, 1), (7, 6, 2), (24, 6, 4)]
)
def test_every_camera_has_a_tile(cameras: int, columns: int, rows: int) -> None:
    """The grid has room for all, and no two viewers look at the same place."""
    assert grid(cameras) == (columns, rows)
    tiles = tiles_of(cameras)
    assert len(set(tiles)) == len(tiles) == cameras
    width, height = TILE_SIZE
    for x, y, w, h in tiles:
        assert (w, h) == TILE_SIZE
        assert x % width == y % height == 0
        assert x + w <= columns * width
        assert y + h <= rows * height


def seen(pictures: float, news: float, wait: float) -> ViewerTrial:
    """What a viewer got."""
    return ViewerTrial(pictures, news, wait, 2.0 * wait, 3.0 * wait, 1e4)


def test_the_worst_viewer_counts() -> None:
    """One client that is kept waiting is not hidden by the others."""
    trial = TeamTrial(3, 0.9995, 0.98, Load(1.0, 0.1, 0.0), 1.0, 1.0, 2**20, 0.0, 1.0)
    viewers = [seen(5.0, 4.9, 0.01), seen(4.0, 3.0, 0.05), seen(5.0, 4.8, 0.02)]
    figures = {one.name: one for one in watched_figures(trial, viewers)}
    assert figures["Real-time factor, lowest of all robots"].met is True
    fewest = figures["Pictures of a camera, fewest"]
    assert (fewest.value, fewest.met) == (4.0, False)
    news = figures["New pictures of a camera, median"]
    assert (news.value, news.met) == (4.8, True)
    assert figures["New pictures of all cameras"].value == pytest.approx(12.7)
    assert figures["Time to answer, median"].value == pytest.approx(20.0)
    assert figures["Time to answer, largest 99th percentile"].value == pytest.approx(100.0)
