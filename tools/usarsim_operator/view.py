"""What a robot that drives itself knows when it decides."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from usarsim_client import readings
from usarsim_operator.ground import Ground
from usarsim_operator.navigation import Place
from usarsim_operator.occupancy import OccupancyMap


@dataclass(frozen=True, slots=True)
class View:
    """What a robot knows; the protocol's frame, y to the right.

    Attributes:
        time: simulated s. pose: x, y (m), yaw (rad, clockwise).
        scan: its newest flat scan; None if it has none.
        map: of all robots. goals: places that others go to, by robot.
        ground: what all robots know beside the map. robot: its name.
        lean: roll and pitch, rad. height: m; nan where nothing tells it well.
    """

    time: float
    pose: tuple[float, float, float]
    scan: readings.LaserScan | None
    map: OccupancyMap
    goals: Mapping[str, Place]
    ground: Ground = field(default_factory=Ground)
    robot: str = ""
    lean: tuple[float, float] = (0.0, 0.0)
    height: float = math.nan
