"""Occupancy maps of ROS: YAML file and picture."""

from __future__ import annotations

from pathlib import Path

from usarsim_exploration.environment import Environment
from usarsim_exploration.worlds.pictures import Rules, fit
from usarsim_exploration.worlds.world import World, settle
from usarsim_maps.grids.occupancy import load_grid
from usarsim_maps.reader import Context
from usarsim_server.files import Folders


def ros_map(path: Path, rules: Rules) -> World:
    """What is not known to be free is wall; the base stands near the map's origin, if that is free.

    Raises:
        WorldError: naming the file, what is wrong, and the cure.
    """
    grid = load_grid(path, Context(folders=Folders([path.parent])))
    free = grid.free[::-1]
    walls = fit(~free, path, rules)
    wanted = None
    if grid.wanted is not None:
        column, row = (int(part // grid.size) for part in grid.wanted)
        row = free.shape[0] - 1 - row
        if 0 <= column < free.shape[1] and 0 <= row < free.shape[0]:
            margin = (walls.shape[1] - free.shape[1]) // 2, (walls.shape[0] - free.shape[0]) // 2
            wanted = column + margin[0], row + margin[1]
    return settle(Environment(path.stem, walls, rules.cell or grid.size), path.stem, wanted)
