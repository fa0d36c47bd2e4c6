"""Brushes and terrain into the scene: convex cells to collide with, their faces to be seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from usarsim_maps.build.cells import Cell, Point
from usarsim_maps.build.csg import Solid, clip_to_box, evaluate
from usarsim_maps.build.emitter import Emitter
from usarsim_maps.build.light import Glow
from usarsim_maps.build.looks import looks_of_grid, looks_of_level
from usarsim_maps.build.pieces import BoxPiece, FieldPiece, piece_of_cell
from usarsim_maps.build.sheet import NameBook
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Brush, Heightfield
from usarsim_server.simulation.frames import IDENTITY

GRIP = 1.0
"""Friction of what one stands on, as in the shipped worlds."""

SMOOTH = 0.5
"""Friction of what one only runs into."""

WALL = 0.35
"""m: a cell that is higher and thinner than this is a wall."""


def add_brushes(
    emitter: Emitter,
    brushes: Sequence[Brush],
    filled: bool | None,
    limits: tuple[Point, Point] | None,
    glows: Sequence[Glow],
    names: NameBook,
    findings: Findings,
    progress: Callable[[float], None],
) -> Solid:
    """Carry out the brushes in order, see `evaluate`, and put the result into the scene.

    If there are limits, corners of a box, everything is cut to it.
    """
    solid = evaluate(brushes, filled, findings=findings, progress=progress)
    if limits is not None:
        clip_to_box(solid, *limits)
    count = boxes = 0
    for cell, owner in zip(solid.cells, solid.owners, strict=True):
        piece = piece_of_cell(cell)
        count += 1
        boxes += isinstance(piece, BoxPiece)
        name = names.take(f"{brushes[owner].name if owner >= 0 else 'rock'}.solid")
        emitter.add_solid(piece, IDENTITY, _friction(cell), name)
    looks = looks_of_level(solid, glows)
    if looks:
        emitter.mesh_files(solid, "level", looks)
        emitter.add_world(emitter.show(solid, IDENTITY, [names.take("level") for _ in looks]))
    if count:
        findings.fact("brush cells", count)
        findings.fact("brush cells that are boxes", boxes)
    return solid


def _friction(cell: Cell) -> float:
    width = min(cell.upper[0] - cell.lower[0], cell.upper[1] - cell.lower[1])
    return SMOOTH if width < WALL < cell.upper[2] - cell.lower[2] else GRIP


def materials_of(brushes: Sequence[Brush]) -> list[str]:
    """Names of materials that brushes use, and the empty name, which new faces may have."""
    return ["", *(polygon.material for brush in brushes for polygon in brush.polygons)]


def add_heightfield(
    emitter: Emitter, field: Heightfield, names: NameBook, findings: Findings
) -> None:
    """Terrain: a height field to stand on, triangles to be seen.

    Height fields are endlessly thick below, and cheap (worlds reference 9.2).
    """
    heights = np.asarray(field.heights, dtype=float)
    if heights.ndim != 2 or min(heights.shape) < 2 or not np.isfinite(heights).all():
        findings.warn(field.name, "terrain without a sound grid of heights was left out")
        return
    name = names.take(field.name)
    piece = FieldPiece(heights, field.spacing, IDENTITY)
    emitter.add_solid(piece, field.pose, GRIP, f"{name}.solid")
    look = replace(
        looks_of_grid(heights, field.spacing, field.texture_size), material=field.material
    )
    emitter.mesh_files(field, field.name, [look])
    emitter.add_world(emitter.show(field, field.pose, [name]))
