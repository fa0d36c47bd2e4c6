"""Portraits: where to put a camera so that one robot fills the picture, and how large it is."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.stage import Stage
from usarsim_server.cameras.viewpoint import View, looking
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.snapshot import RobotLayout

__all__ = ["extent", "portrait_view"]

Array = NDArray[np.float64]

FOV = math.radians(32.0)
"""Narrow, so that what is near does not look larger than it is."""
FROM = (0.80, -0.62, 0.52)
"""Direction from the robot to the camera in its own frame: ahead, to the right, above."""
MARGIN = 1.06
"""How much more than the robot is in the picture."""
CLOSEST = 0.3
"""m; nearer, a camera would cut off what is in front of its near plane."""
_SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def extent(stage: Stage, layout: RobotLayout) -> tuple[Array, Array]:
    """Lowest and highest coordinates of the visible parts of a robot, in its own frame, m.

    Args:
        stage: posed as in a snapshot with the robot.
        layout: of the robot.

    Returns:
        Two arrays (3,), x forward, y left, z up; both zero if nothing of it can be seen.
    """
    corners = _corners(stage, layout)
    if not corners.size:
        return np.zeros(3), np.zeros(3)
    turn = stage.data.xmat[layout.base].reshape(3, 3)
    own = (corners - stage.data.xpos[layout.base]) @ turn
    return own.min(axis=0), own.max(axis=0)


def portrait_view(stage: Stage, layout: RobotLayout, width: int, height: int) -> View:
    """A view from ahead, above and the right, just far enough to see all of a robot.

    Args:
        stage, layout: as in `extent`.
        width, height: of the picture, pixels.
    """
    corners = _corners(stage, layout)
    if not corners.size:
        corners = stage.data.xpos[layout.base] + 0.5 * _SIGNS
    turn = stage.data.xmat[layout.base].reshape(3, 3)
    towards = turn @ (np.array(FROM) / np.linalg.norm(FROM))
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    seen = looking(_point(middle + towards), _point(middle))
    apart = (corners - middle) @ seen.matrix()
    across = math.tan(FOV / 2.0)
    upward = across * height / width
    needed = np.maximum(np.abs(apart[:, 1]) / across, np.abs(apart[:, 2]) / upward)
    distance = max(CLOSEST, MARGIN * float((needed - apart[:, 0]).max()))
    pose = Pose(_point(middle + distance * towards), seen.quaternion)
    return View(pose, FOV, width, height)


def _corners(stage: Stage, layout: RobotLayout) -> Array:
    """Corners (n, 3) of the boxes around all visible geoms of a robot, in the world."""
    model, data = stage.model, stage.data
    visible = stage.visible()
    corners = []
    for geom in layout.geoms:
        if visible[geom]:
            turn = data.geom_xmat[geom].reshape(3, 3)
            middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
            corners.append(data.geom_xpos[geom] + (middle + _SIGNS * half) @ turn.T)
    return np.concatenate(corners) if corners else np.zeros((0, 3))


def _point(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
