"""Generators of environments: the same kind, shape and seed always give the same cells."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2
import numpy as np

from usarsim_exploration.worlds.generators import buildings, open_spaces
from usarsim_exploration.worlds.generators.shape import CELL, Drawing, Shape
from usarsim_server.base.errors import WorldError, at

__all__ = ["CELL", "KINDS", "Drawing", "Shape", "draw"]

LEAST = 0.1
"""Part of the cells that are free at the least."""

Generator = Callable[[Shape, np.random.Generator], Drawing]

KINDS: Mapping[str, Generator] = {
    "blocks": buildings.blocks,
    "campus": buildings.campus,
    "cave": open_spaces.cave,
    "flats": buildings.flats,
    "hall": open_spaces.hall,
    "hospital": buildings.hospital,
    "maze": open_spaces.maze,
    "mine": open_spaces.mine,
    "office": buildings.office,
    "pillars": open_spaces.pillars,
    "school": buildings.school,
    "warehouse": buildings.warehouse,
}
"""By name; each takes a shape and a generator of random numbers."""


def draw(kind: str, shape: Shape, seed: int) -> Drawing:
    """Run a generator, and wall up what cannot be reached from its largest part.

    Raises:
        WorldError: what was asked for does not fit together.
    """
    drawing = KINDS[kind](shape, np.random.Generator(np.random.PCG64(seed)))
    walls = drawing.walls
    walls[[0, -1]] = walls[:, [0, -1]] = 1
    _, labels, facts, _ = cv2.connectedComponentsWithStats(1 - walls, connectivity=4)
    if facts[1:, cv2.CC_STAT_AREA].max(initial=0) < LEAST * walls.size:
        problem = f"rooms = {shape.rooms} and doors = {shape.doors} leave hardly anything free"
        raise WorldError(at(f"generator {kind}", problem, "ask for other rooms, or narrower doors"))
    walls[labels != 1 + int(np.argmax(facts[1:, cv2.CC_STAT_AREA]))] = 1
    return drawing
