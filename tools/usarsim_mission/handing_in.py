"""Makes the hand-in files of a run from its logs: the last map, the marks that stand, the paths."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_mission.grid import FREE, Grid
from usarsim_mission.hand_in import Reported, write_hand_in
from usarsim_mission.model import Point
from usarsim_mission.referee import Referee

FOLDER = "map"
_STEP = 0.1
"""m between two places of a path."""


class HandIn:
    """Collects what is handed in."""

    def __init__(self) -> None:
        self._grid: Grid | None = None
        self._paths: dict[str, list[Point]] = {}

    def take(self, record: Mapping[str, Any], referee: Referee) -> None:
        """A record, which the referee has been told."""
        if record["kind"] == "map":
            self._grid = Grid.unpacked(record)
        for robot in referee.visits.robots.values() if record["kind"] == "truth" else ():
            path, pos = self._paths.setdefault(robot.name, []), robot.pos
            if pos is not None and (not path or math.dist(path[-1], pos[:2]) >= _STEP):
                path.append((pos[0], pos[1]))

    def write(self, folder: Path, name: str, referee: Referee) -> list[Path]:
        """Write the files.

        Args:
            folder: of the run. name: of the mission. referee: who has been told all.

        Returns:
            The files; none if the run has no map.

        Raises:
            RunLogError: a file cannot be written.
        """
        grid = self._grid
        if grid is None:
            return []
        places = [(one, one.place) for one in referee.marks.standing() if one.place is not None]
        victims = [
            Reported(number, place[0], place[1], mark.status)
            for number, (mark, place) in enumerate(places, start=1)
        ]
        base = "".join(c if c.isalnum() or c in "-_" else "_" for c in name) or "run"
        searched = _searched(grid, referee.area.seen())
        return write_hand_in(folder / FOLDER, base, grid, victims, self._paths, searched)


def _searched(grid: Grid, seen: Grid | None) -> NDArray[np.bool_] | None:
    """Which cells of a map have been seen, by the raster of another grid."""
    if seen is None:
        return None
    rows, columns = grid.cells.shape
    row = np.floor((grid.y + (np.arange(rows) + 0.5) * grid.cell - seen.y) / seen.cell).astype(int)
    column = np.floor((grid.x + (np.arange(columns) + 0.5) * grid.cell - seen.x) / seen.cell)
    column = column.astype(int)
    good_row = (row >= 0) & (row < seen.cells.shape[0])
    good_column = (column >= 0) & (column < seen.cells.shape[1])
    found = np.zeros(grid.cells.shape, np.bool_)
    inside = np.ix_(good_row, good_column)
    found[inside] = seen.cells[np.ix_(row[good_row], column[good_column])] == FREE
    return found
