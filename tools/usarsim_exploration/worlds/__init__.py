"""Worlds to explore: those that come with the benchmark, maps of users, and world folders."""

from usarsim_exploration.worlds.finding import find, names
from usarsim_exploration.worlds.world import STARTS, World, settle

__all__ = ["STARTS", "World", "find", "names", "settle"]
