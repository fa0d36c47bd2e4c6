"""Where a robot is, from its odometry and its range finder, and what it then sees.

`Localiser` knows no server: it is told where odometry thinks the robot is and what the scanner
read, and answers with a pose. `rasterise` makes of readings in metres what maps take in.

The frame is that of the environment: x to the right along columns, y down along rows, m; the
middle of cell (column, row) is at ((column + 0.5) cell, (row + 0.5) cell). Headings are rad from x
towards y. A server that runs a world of `usarsim_exploration.worlds.physics` tells poses in the
wire frame: x and heading are the same, and y is less by the height of the world.
"""

from usarsim_exploration.localisation.evidence import Evidence
from usarsim_exploration.localisation.localiser import (
    INERTIAL,
    MODES,
    WHEELS,
    Localiser,
    Mode,
    Motion,
)
from usarsim_exploration.localisation.poses import Disc, Pose, compose, relative
from usarsim_exploration.localisation.rasterising import rasterise

__all__ = [
    "INERTIAL", "MODES", "WHEELS", "Disc", "Evidence", "Localiser", "Mode", "Motion", "Pose",
    "compose", "rasterise", "relative",
]  # fmt: skip
