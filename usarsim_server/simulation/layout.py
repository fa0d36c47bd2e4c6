"""Where a robot lies inside the arrays of a compiled model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class RobotLayout:
    """Where one robot slot lies inside the arrays of one compiled model.

    A layout belongs to one model generation; in the next one it is looked up again.
    """

    slot: int
    base: int  # body id of the chassis; its origin is the robot's reference point
    qpos: int  # first of the seven free-joint coordinates
    dof: int  # first of the six free-joint velocities
    links: Mapping[str, int]  # body ids by link name (lower case), chassis excluded
    joint_qpos: Mapping[str, int]
    """Coordinate index by joint name (lower case): wheels, steering, arm links."""
    joint_dof: Mapping[str, int]  # velocity index by joint name (lower case)
    wheel_qpos: Indices
    """Coordinates of the driven wheels in part order (the order of the robot file)."""
    wheel_dof: Indices  # velocities of the driven wheels in part order
    wheel_actuators: Indices  # actuators of the driven wheels in part order
    bodies: frozenset[int]  # all body ids of the robot
    geoms: Indices  # all geom ids of the robot (hidden from its own rays)
    mocap: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Bodies that are placed, not simulated, the base first; then `qpos` and `dof` are -1."""
