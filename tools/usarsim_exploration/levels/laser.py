"""What a laser sees, as points; `localisation.rasterise` makes cells of it."""

from __future__ import annotations

import numpy as np

from usarsim_exploration.localisation.poses import Pose, compose
from usarsim_exploration.localisation.surfaces import Floats


def points(ranges: Floats, angles: Floats, pose: Pose) -> Floats:
    """(n, 2) places where rays end, m.

    Args:
        ranges: (n,) m. angles: (n,) rad, to the right positive. pose: of the scanner.
    """
    turned = pose[2] + angles
    along = np.stack([np.cos(turned), np.sin(turned)], axis=1)
    return np.asarray(np.array(pose[:2]) + ranges[:, None] * along)


def scanner(pose: Pose, mount: float) -> Pose:
    """Where the scanner of a robot is; mount: how far ahead of its middle, m."""
    return compose(pose, (mount, 0.0, 0.0))
