"""What is below: the drop of an object to whatever it would land on."""

from __future__ import annotations

import math

import numpy as np

from usarsim_server.errors import SpawnError
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.rays.fans import RayFan
from usarsim_server.simulation.simulation import Simulation

__all__ = ["drop_below"]

GRID = 7
"""Rays along each side of an object's outline."""
INSET = 1e-3
"""m by which the outermost rays are inside, so that they pass what the object only touches."""
FARTHEST = 1000.0


def drop_below(simulation: Simulation, pose: Pose, size: Vector, body: int | None = None) -> float:
    """How far (m) an object can be lowered until something is below; negative: it has to rise.

    The object counts as its bounding box, and only what is below its middle counts.

    Args:
        simulation: the world.
        pose: of its middle.
        size: extents along its own axes, m.
        body: its number if it is in the world already.

    Raises:
        SpawnError: if there is nothing below.
    """
    half = np.abs(pose.matrix()) @ (np.array(size) / 2.0)
    x, y = (np.linspace(-1.0, 1.0, GRID) * max(0.0, extent - INSET) for extent in half[:2])
    across, along = np.meshgrid(x, y)
    offsets = np.column_stack([across.ravel(), along.ravel(), np.zeros(GRID * GRID)])
    fan = RayFan(
        np.array(pose.position) + offsets, np.tile([0.0, 0.0, -1.0], (len(offsets), 1)), FARTHEST
    )
    hits = simulation.cast([fan], simulation.look(), body)[0]
    nearest = float(hits.distances.min())
    if not math.isfinite(nearest):
        raise SpawnError("there is nothing below")
    return nearest - float(half[2])
