"""Finds where robots of a width can drive, and says which passages are too narrow for them."""

from __future__ import annotations

import math

import cv2
import numpy as np

from usarsim_exploration.environment import Cell, Environment

LITTLE = 0.02
"""Part of the reachable cells that may be too narrow without a message: corners always are."""


def accessible(environment: Environment, base: Cell, width: float) -> int:
    """Count the cells that robots of a width, in cells, can drive over from around a base."""
    free = np.pad((environment.walls == 0).astype(np.uint8), 1)
    need = np.float32((width + 1.0) / 2.0)  # from its middle to that of a wall's cell
    fits = cv2.distanceTransform(free, cv2.DIST_L2, 5) >= need - 0.01
    _, labels = cv2.connectedComponents(fits.astype(np.uint8), connectivity=4)
    rows, columns = np.nonzero(fits)
    if not len(rows):
        return 0
    away = np.hypot(rows - base[1] - 1, columns - base[0] - 1)
    nearest = int(away.argmin())
    if away[nearest] > 2.0 * width + 2.0:
        return 0
    middle = labels == labels[rows[nearest], columns[nearest]]
    beside = cv2.distanceTransform((~middle).astype(np.uint8), cv2.DIST_L2, 5)
    return int(np.count_nonzero((beside < need) & (free != 0)))


def _behind(environment: Environment, base: Cell, passage: int) -> int:
    """Count the cells that passages at least so many cells wide join to those around a base."""
    square = np.ones((passage, passage), np.uint8)
    free = np.pad((environment.walls == 0).astype(np.uint8), 1)
    _, labels = cv2.connectedComponents(cv2.morphologyEx(free, cv2.MORPH_OPEN, square), None, 4)
    rows, columns = np.nonzero(labels)
    if not len(rows):
        return 0
    nearest = int(np.hypot(rows - base[1] - 1, columns - base[0] - 1).argmin())
    return int(np.count_nonzero(labels == labels[rows[nearest], columns[nearest]]))


def note(environment: Environment, base: Cell, width: float, cure: str) -> str:
    """Say in one sentence which passages are too narrow for robots; empty: none that matters.

    Args:
        environment: true. base: around which they start. width: of the robots, cells.
        cure: what its author can do.
    """
    whole = int(np.count_nonzero(environment.reachable(base)))
    there = accessible(environment, base, width)
    if whole - there <= LITTLE * whole:
        return ""
    for passage in range(math.ceil(width), 1, -1):
        if _behind(environment, base, passage) - there > LITTLE * whole:
            break
    else:
        passage = 1
    lost, cell = 100 * (whole - there) / whole, environment.cell
    return (
        f"{environment.name}: robots are {width:g} cells ({width * cell:g} m) wide, and "
        f"{lost:.0f} % of the reachable cells are in or behind passages of {passage} cells "
        f"({passage * cell:g} m) or less, where they cannot drive ({cure})"
    )
