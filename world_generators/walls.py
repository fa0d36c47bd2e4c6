"""Walls, in metres: of buildings with doors and glazed windows, of mazes drawn as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from usarsim_exploration.worlds.mjcf import Scene, Vector

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
    """A hole in a wall."""

    middle: float  # coordinate along the wall, m
    width: float  # m
    bottom: float
    top: float
    glass: str | None = None  # material of the pane in it; None for a free passage


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


CELL = 1.2
"""Grid of arena mazes, m."""
HEIGHT = 1.2
THICKNESS = 0.03
POST = 0.06


@dataclass(frozen=True, slots=True)
class Maze:
    """A maze drawn with `+--+` and `|`; `oo` and `o` are panels with a hole to look through."""

    rows: tuple[str, ...]
    """Text lines; odd ones hold cells, even ones the walls between rows of cells."""
    left: float  # x of the left edge of the drawing, m
    top: float  # y of its upper edge, m

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cell rows and columns."""
        return len(self.rows) // 2, len(self.rows[0]) // 3

    def centre(self, row: int, column: int) -> tuple[float, float]:
        """Middle of a cell, m."""
        return self.left + (column + 0.5) * CELL, self.top - (row + 0.5) * CELL

    def wall(self, row: int, column: int, side: str) -> str:
        """What is drawn on a cell's side (`north`, `south`, `east`, `west`); blank if open."""
        if side in ("north", "south"):
            line = self.rows[2 * row + (2 if side == "south" else 0)]
            return line[3 * column + 1]
        return self.rows[2 * row + 1][3 * (column + (1 if side == "east" else 0))]

    def build(self, scene: Scene, prefix: str, woods: tuple[str, ...], post: str) -> None:
        """Set up all panels and the posts between them; panels take turns with the materials."""
        ends: set[tuple[int, int]] = set()
        count = 0
        for line, text in enumerate(self.rows):
            flat = line % 2 == 0
            for column in range(len(text) // 3 + (0 if flat else 1)):
                mark = text[3 * column + 1] if flat else text[3 * column]
                if mark == " ":
                    continue
                row = line // 2
                ends |= {(row, column), (row, column + 1) if flat else (row + 1, column)}
                x, y = self.left + column * CELL, self.top - row * CELL
                middle = (x + CELL / 2, y) if flat else (x, y - CELL / 2)
                place = hole_panel if mark == "o" else panel
                place(scene, prefix, middle, woods[count % len(woods)], along_x=flat)
                count += 1
        for row, column in sorted(ends):
            center = (self.left + column * CELL, self.top - row * CELL, HEIGHT / 2 + 0.01)
            scene.box(f"{prefix}_post", center, (POST, POST, HEIGHT + 0.02), post)


def panel(
    scene: Scene,
    prefix: str,
    middle: tuple[float, float],
    material: str,
    *,
    along_x: bool,
    length: float = CELL,
    height: float = HEIGHT,
) -> None:
    """Set up one wall panel on the ground."""
    size = (length, THICKNESS, height) if along_x else (THICKNESS, length, height)
    scene.box(prefix, (*middle, height / 2), size, material)


def hole_panel(
    scene: Scene,
    prefix: str,
    middle: tuple[float, float],
    material: str,
    *,
    along_x: bool,
    sill: float = 0.35,
    opening: tuple[float, float] = (0.5, 0.45),
) -> None:
    """Set up a panel with a rectangular hole (width, height) above a sill."""
    side = (CELL - opening[0]) / 2
    head = HEIGHT - sill - opening[1]
    parts = (
        (0.0, sill / 2, CELL, sill),
        (0.0, HEIGHT - head / 2, CELL, head),
        (-(CELL - side) / 2, sill + opening[1] / 2, side, opening[1]),
        ((CELL - side) / 2, sill + opening[1] / 2, side, opening[1]),
    )
    for shift, z, width, height in parts:
        if along_x:
            center, size = (middle[0] + shift, middle[1], z), (width, THICKNESS, height)
        else:
            center, size = (middle[0], middle[1] + shift, z), (THICKNESS, width, height)
        scene.box(prefix, center, size, material)
