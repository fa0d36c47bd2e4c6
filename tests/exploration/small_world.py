"""Scenarios in a small world of two rooms, for tests of runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from usarsim_exploration.scenario import Scenario, load
from usarsim_server.base.toml import toml_text

ROOMS = """\
##############################
#............#...............#
#............#...............#
#............#...............#
#............................#
#............................#
#............................#
#............#...............#
#............#.........##....#
#............#.........##....#
#............#...............#
##############################
"""
SEALED = ROOMS.replace("............................", "............#...............")


def text_map(picture: str) -> str:
    """As the loader of text maps takes it."""
    rows = picture.split()
    digits = [row.replace("#", "1").replace(".", "0") for row in rows]
    return "\n".join([str(len(rows)), str(len(rows[0])), *digits, ""])


def small(
    folder: Path, *options: str, picture: str = ROOMS, tables: dict[str, object] | None = None
) -> Scenario:
    """Two robots, range finders of 8 cells and radios of 6; options and tables change it."""
    (folder / "rooms.txt").write_text(text_map(picture))
    content: dict[str, object] = {
        "environment": {"name": "rooms.txt"},
        "team": {"robots": 2, "base": [3, 3], "speed": 2.0, "reach": 8, "radio": 6.0},
        "radio": {"model": "circle"},
        "end": {"steps": 200},
    }
    path = folder / "small.toml"
    path.write_text(toml_text(content | (tables or {})))
    return load(path, options)


def walls(picture: str = ROOMS) -> np.ndarray:
    """1 where a wall is."""
    return np.array([[one == "#" for one in row] for row in picture.split()], np.uint8)
