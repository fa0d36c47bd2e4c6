"""Worlds to explore: those that come with the benchmark, maps of users, and world folders."""

from usarsim_exploration.worlds.catalogue import find, names
from usarsim_exploration.worlds.world import (
    DRAWS,
    STARTS,
    Draw,
    World,
    draw_places,
    scale_of,
    settle,
    start_around,
)

__all__ = [
    "DRAWS", "STARTS", "Draw", "World", "draw_places", "find", "names", "scale_of", "settle",
    "start_around",
]  # fmt: skip
