"""Ways through what a robot knows; one planner per robot, which knows only that robot's map."""

from usarsim_exploration.planning.fields import UNIT, Field, Floods, Planner, length
from usarsim_exploration.planning.search import Path, Search, a_star, jump_points
from usarsim_exploration.planning.skeleton import degrees, key_cells, skeleton, thin
from usarsim_exploration.planning.topology import TopologicalMap

__all__ = [
    "UNIT", "Field", "Floods", "Path", "Planner", "Search", "TopologicalMap", "a_star", "degrees",
    "jump_points", "key_cells", "length", "skeleton", "thin",
]  # fmt: skip
