"""World folders of the server as environments: what stands at the height of the scanner.

A cell is a wall if its middle is within something that never moves, or if something crosses it,
however thin, on the way from its middle to one of its four sides. So is what is not connected to
the place of the base.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.worlds.pictures import CELL, Rules, fit
from usarsim_exploration.worlds.world import World, settle
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.loader import load_world

EXTRA = "exploration"
"""Table of `[extra]` in world.toml: `base` is x and y of the base, m; `cell` the width of one."""
_SIDE = 0.49
"""Cells from a middle towards a side: walls often begin exactly at the side."""


def slice_world(folder: Path, rules: Rules) -> World:
    """Cut a world.

    Args:
        folder: of the world.
        rules: `cell` and `limit` count; default width of a cell as the world says, or 0.1 m.

    Raises:
        WorldError: naming the file, what is wrong, and the cure.
    """
    from usarsim_exploration.floor import EYE, Ground

    description = load_world(folder)
    facts = description.extra.get(EXTRA)
    facts = facts if isinstance(facts, Mapping) else {}
    stated = facts.get("cell")
    cell = rules.cell or (float(stated) if isinstance(stated, int | float) and stated > 0 else CELL)
    ground = Ground(description)
    west, south, east, north = ground.box
    columns, rows = (max(1, round(size / cell)) for size in (east - west, north - south))
    floor = ground.floor
    if floor is None:
        floor = min(start.pose.position[2] for start in description.starts) - EYE
    x = west + (np.arange(columns) + 0.5) * cell
    y = north - (np.arange(rows) + 0.5) * cell
    fit(np.zeros((rows, columns), np.bool_), folder, rules)
    middles = np.stack([*np.meshgrid(x, y), np.full((rows, columns), floor + EYE)], axis=-1)
    places: NDArray[np.float64] = middles.reshape(-1, 3)
    solid = ground.inside(places)
    for side in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)):
        solid |= ~ground.clear(places, places + _SIDE * cell * np.array(side))
    walls = fit(solid.reshape(rows, columns), folder, rules)
    place = _base(description, facts.get("base"))
    wanted = int((place[0] - west) / cell), int((north - place[1]) / cell)
    _enclose(walls, wanted)
    environment = Environment(description.name, walls, cell)
    return settle(environment, description.title, wanted, scale=rules.scale(cell))


def _enclose(walls: NDArray[np.uint8], cell: Cell) -> None:
    """Wall up what is not connected to a place, such as the floor around a building."""
    _, labels = cv2.connectedComponents(1 - walls, connectivity=4)
    rows, columns = np.nonzero(walls == 0)
    if len(rows):
        nearest = np.argmin((rows - cell[1]) ** 2 + (columns - cell[0]) ** 2)
        walls[labels != labels[rows[nearest], columns[nearest]]] = 1


def _base(description: WorldDescription, stated: object) -> tuple[float, float]:
    """x and y of the base, m: as stated, else the first start."""
    if isinstance(stated, list | tuple) and len(stated) == 2:
        x, y = (float(part) for part in stated)
        return x, y
    x, y, _ = description.starts[0].pose.position
    return x, y
