"""The environments that come with the benchmark, by name: kind, shape and seed of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from usarsim_exploration.environment import Environment
from usarsim_exploration.worlds.generators import CELL, Shape, draw
from usarsim_exploration.worlds.world import World, settle


@dataclass(frozen=True, slots=True)
class Recipe:
    """What makes an environment.

    Attributes:
        kind: of generator. title: for people. shape, seed: what it is given.
    """

    kind: str
    title: str
    shape: Shape
    seed: int = 1

    def make(self, name: str) -> World:
        """The same for the same recipe."""
        drawing = draw(self.kind, self.shape, self.seed)
        return settle(Environment(name, drawing.walls, CELL), self.title, drawing.base)


SHIPPED: Mapping[str, Recipe] = {
    "blocks": Recipe("blocks", "Corridors around blocks: many loops", Shape(400, 400)),
    "campus": Recipe("campus", "Six office buildings around a yard", Shape(800, 600, rooms=36)),
    "cave": Recipe("cave", "Cave with chambers and narrow ways", Shape(500, 400, rooms=60)),
    "flats": Recipe("flats", "Rooms that lead to rooms", Shape(300, 300, loops=0.1)),
    "hall": Recipe("hall", "Open hall with rubble", Shape(505, 304, clutter=0.15)),
    "hospital": Recipe("hospital", "Two wings, one passage between", Shape(800, 300, rooms=36)),
    "lab": Recipe("office", "Small office", Shape(200, 150, rooms=36)),
    "maze": Recipe("maze", "Maze without a loop", Shape(310, 226, loops=0.0)),
    "mine": Recipe("mine", "Crooked drifts between chambers", Shape(600, 500, clutter=0.02)),
    "office": Recipe("office", "Office with three corridors", Shape(400, 300)),
    "pillars": Recipe("pillars", "Mine of rooms and pillars", Shape(450, 350, clutter=0.02)),
    "school": Recipe("school", "School with long corridors", Shape(700, 350, rooms=60, loops=0.0)),
    "warren": Recipe("maze", "Maze with loops", Shape(450, 310, loops=0.9)),
    "warehouse": Recipe("warehouse", "Shelves, aisles and offices", Shape(600, 400)),
}
"""By name."""
