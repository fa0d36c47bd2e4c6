"""How high pictures can be cut: below the ceiling, where most of a map has a low one."""

from __future__ import annotations

import numpy as np
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

__all__ = ["ceiling"]

Array = NDArray[np.float64]

PROBES = 64
"""Along each side of a map."""

ABOVE, NEAR = 0.05, 0.2
"""m above the floor whence ceilings are looked for, and below which a floor is this one."""

LEAST = 20
"""Probes that have to stand on the floor."""


def ceiling(scene: EmbreeScene, floor: float, lower: Array, upper: Array) -> float:
    """m from a floor up to what half of it lies below; inf where half of it lies below nothing.

    Args:
        scene: triangles that are seen.
        floor: m, its height.
        lower: (3,) corner of the map. upper: the other one.
    """
    parts = (np.arange(PROBES) + 0.37) / PROBES  # between the lines of a builder's grid
    x, y = np.meshgrid(*(lower[:2] + parts[:, None] * (upper - lower)[:2]).T)
    start = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, floor + ABOVE)])
    found = []
    for way in (-1.0, 1.0):
        ways = np.tile(np.array([0.0, 0.0, way], np.float32), (len(start), 1))
        answer = scene.run(start.astype(np.float32), ways, output=1)
        found.append(np.where(answer["primID"] >= 0, answer["tfar"], np.inf))
    below, above = found
    heights = above[below < NEAR]
    return ABOVE + float(np.median(heights)) if len(heights) >= LEAST else np.inf
