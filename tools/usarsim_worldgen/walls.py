"""Walls of buildings: straight, with door openings and glazed windows, in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from usarsim_worldgen.mjcf import Scene, Vector

Range = tuple[float, float]

DOOR_WIDTH, DOOR_HEIGHT = 1.0, 2.1
PANE = 0.02
"""Thickness of window panes, m."""


@dataclass(frozen=True, slots=True)
class WallSize:
    """Thickness and height of a wall, m."""

    thickness: float
    height: float


@dataclass(frozen=True, slots=True)
class Opening:
    """A hole in a wall.

    Attributes:
        middle: coordinate along the wall, m.
        width, bottom, top: m.
        glass: material of the pane in it; None for a free passage.
    """

    middle: float
    width: float
    bottom: float
    top: float
    glass: str | None = None


def door(middle: float, width: float = DOOR_WIDTH) -> Opening:
    """A doorway without a door leaf."""
    return Opening(middle, width, 0.0, DOOR_HEIGHT)


def window(middle: float, width: float, bottom: float = 0.9, top: float = 2.1) -> Opening:
    """A window with a fixed pane."""
    return Opening(middle, width, bottom, top, glass="glass")


def wall(
    scene: Scene,
    prefix: str,
    axis: Literal["x", "y"],
    at: float,
    span: Range,
    material: str,
    size: WallSize,
    *,
    openings: Sequence[Opening] = (),
) -> None:
    """Build a wall along an axis, at a coordinate of the other axis, around its openings."""

    def piece(name: str, along: Range, z: Range, skin: str, thickness: float) -> None:
        lower, upper = _corners(axis, at, along, z, thickness)
        scene.block(name, lower, upper, skin)

    start, (thick, height) = span[0], (size.thickness, size.height)
    for hole in sorted(openings, key=lambda opening: opening.middle):
        across = (hole.middle - hole.width / 2, hole.middle + hole.width / 2)
        if across[0] > start:
            piece(prefix, (start, across[0]), (0.0, height), material, thick)
        if hole.bottom > 0.0:
            piece(f"{prefix}_sill", across, (0.0, hole.bottom), material, thick)
        if hole.top < height:
            piece(f"{prefix}_lintel", across, (hole.top, height), material, thick)
        if hole.glass is not None:
            piece(f"{prefix}_pane", across, (hole.bottom, hole.top), hole.glass, PANE)
        start = across[1]
    if start < span[1]:
        piece(prefix, (start, span[1]), (0.0, height), material, thick)


def _corners(
    axis: str, at: float, along: Range, z: Range, thickness: float
) -> tuple[Vector, Vector]:
    near, far = at - thickness / 2, at + thickness / 2
    if axis == "x":
        return (along[0], near, z[0]), (along[1], far, z[1])
    return (near, along[0], z[0]), (far, along[1], z[1])
