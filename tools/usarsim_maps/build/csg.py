"""Brushes as a program: convex cells of the space that is solid in the end (worlds reference 4).

Boolean operations on meshes fail for level brushes, half of which are concave and not closed edge
by edge; planes that cut convex cells work for all of them, and yield what MuJoCo wants.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from usarsim_maps.build.cells import (
    TOLERANCE,
    Cell,
    Plane,
    Point,
    box_cell,
    plane_of,
    side,
    split,
    split_polygon,
)
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Array, Brush, BrushOperation, Polygon, Solidity

MAX_CELLS = 60_000
"""Convex cells of one level; 576 rooms made of 3 984 brushes give 11 808 (worlds reference 4.3)."""

MAX_BRUSH_WORK = 3_000_000
"""Comparisons of two faces that one brush may need: some 10 s; the usual brush needs 50."""

MAX_POLYGONS = 1_500
"""Faces of one brush: cutting takes time with their square."""

SHELL = 0.25
"""m of solid around the brushes of a level that begins with a subtraction."""

SAMPLE = 12
"""Splitters that are compared at one node of a brush's tree."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A polygon that gave a plane its looks."""

    polygon: Polygon  # of the brush
    brush: str  # its name
    texture: Array | None
    """(2, 4) from a point (x, y, z, 1) to texture coordinates; None if unknown."""


@dataclass(slots=True)
class Solid:
    """The result."""

    cells: list[Cell] = field(default_factory=list)  # convex, and disjoint if asked for
    owners: list[int] = field(default_factory=list)  # index of the brush that every cell belongs to
    surfaces: list[Surface] = field(default_factory=list)
    """What the `surface` of a face refers to; -1 is no polygon of any brush."""
    sheets: list[tuple[int, Polygon]] = field(default_factory=list)
    """Polygons that are seen and not felt, with the index of their brush."""


def is_filled(brushes: Sequence[Brush], filled: bool | None) -> bool:
    """Whether space is solid before the first of some brushes; None: if that one subtracts."""
    solids = (brush for brush in brushes if brush.solidity is not Solidity.NONSOLID)
    first = next(solids, None)
    if first is None or filled is not None:
        return first is not None and bool(filled)
    return first.operation is BrushOperation.SUBTRACT


def evaluate(
    brushes: Sequence[Brush],
    filled: bool | None = None,
    *,
    disjoint: bool = False,
    findings: Findings | None = None,
    progress: Callable[[float], None] = lambda part: None,
) -> Solid:
    """Carry out a level's brushes in order; `progress` is told the part that is done.

    Space is solid at first as `is_filled` says. If `disjoint`, cells never overlap, which costs
    time; contacts do not need it, volumes do.
    """
    findings = findings or Findings()
    solid = Solid()
    world = _World(disjoint)
    if is_filled(brushes, filled):
        solids = [brush for brush in brushes if brush.solidity is not Solidity.NONSOLID]
        points = np.concatenate([p.vertices for b in solids for p in b.polygons])
        lower, upper = points.min(axis=0) - SHELL, points.max(axis=0) + SHELL
        world.add([box_cell(_point(lower), _point(upper))], -1)
    late: list[tuple[int, list[Cell]]] = []
    for number, brush in enumerate(brushes):
        progress(number / len(brushes))
        if brush.solidity is Solidity.NONSOLID:
            solid.sheets += [(number, polygon) for polygon in brush.polygons]
            continue
        solid.sheets += [(number, polygon) for polygon in brush.polygons if not polygon.solid]
        cells = brush_cells(brush, solid.surfaces, findings)
        if brush.operation is BrushOperation.SUBTRACT:
            world.subtract(cells)
        elif brush.solidity is Solidity.SEMISOLID:
            late.append((number, cells))
        else:
            world.add(cells, number)
        if len(world.cells) > MAX_CELLS:
            findings.warn(
                brush.name,
                f"the level needs more than {MAX_CELLS} convex pieces; this brush and all later "
                "ones are left out: import the level in parts",
            )
            break
    for number, cells in late:
        world.add(cells, number)
    solid.cells, solid.owners = world.cells, world.owners
    return solid


class _World:
    """Cells that are solid so far, and their boxes in one array for the overlap test."""

    def __init__(self, disjoint: bool) -> None:
        self.cells: list[Cell] = []
        self.owners: list[int] = []
        self._disjoint = disjoint
        self._boxes = np.zeros((64, 6))

    def add(self, cells: Iterable[Cell], owner: int) -> None:
        for cell in cells:
            pieces = [cell]
            if self._disjoint:
                for index in self._near(cell):
                    pieces = [p for piece in pieces for p in _outside(piece, self.cells[index])]
            for piece in pieces:
                self._append(piece, owner)

    def subtract(self, cells: Iterable[Cell]) -> None:
        for hole in cells:
            touched = self._near(hole)
            if not touched:
                continue
            pieces = [(p, self.owners[i]) for i in touched for p in _outside(self.cells[i], hole)]
            for index in reversed(touched):
                self._remove(index)
            for piece, owner in pieces:
                self._append(piece, owner)

    def _remove(self, index: int) -> None:
        """Take a cell away; the last one takes its number."""
        last = len(self.cells) - 1
        self._boxes[index] = self._boxes[last]
        self.cells[index] = self.cells[last]
        self.owners[index] = self.owners[last]
        self.cells.pop()
        self.owners.pop()

    def _append(self, cell: Cell, owner: int) -> None:
        count = len(self.cells)
        if count == len(self._boxes):
            self._boxes = np.concatenate([self._boxes, np.zeros_like(self._boxes)])
        self._boxes[count] = (*cell.lower, *cell.upper)
        self.cells.append(cell)
        self.owners.append(owner)

    def _near(self, cell: Cell) -> list[int]:
        boxes = self._boxes[: len(self.cells)]
        apart = (boxes[:, :3] > np.array(cell.upper) - TOLERANCE).any(axis=1)
        apart |= (boxes[:, 3:] < np.array(cell.lower) + TOLERANCE).any(axis=1)
        near: list[int] = np.flatnonzero(~apart).tolist()
        return near


def _outside(cell: Cell, hole: Cell) -> list[Cell]:
    """The parts of a cell that are not in a convex hole; new faces look like the hole's."""
    if any(side(cell, face.plane) > 0 for face in hole.faces):
        return [cell]
    pieces: list[Cell] = []
    rest: Cell | None = cell
    for face in hole.faces:
        if rest is None:
            break
        rest, piece = split(rest, face.plane, face.surface, face.surface)
        if piece is not None:
            pieces.append(piece)
    return pieces


# ---- from a brush to convex cells ----------------------------------------------------------


def brush_cells(brush: Brush, surfaces: list[Surface], findings: Findings) -> list[Cell]:
    """Convex cells of one brush, by a solid-leaf BSP tree over its own polygons.

    It need be neither closed nor convex. Its polygons are appended to the surfaces, to which faces
    of the cells refer by index.
    """
    pieces: list[_Piece] = []
    for polygon in brush.polygons:
        found = list(_flat_pieces([_point(p) for p in polygon.vertices], len(surfaces)))
        if not found:
            findings.warn(brush.name, "a polygon without area was dropped")
            continue
        if len(found) > 1:
            findings.warn(brush.name, "a polygon that is not flat was cut into triangles")
        pieces += found
        surfaces.append(Surface(polygon, brush.name, _texture(polygon)))
    if len(pieces) > MAX_POLYGONS:
        findings.warn(brush.name, f"more than {MAX_POLYGONS} faces; the brush was dropped")
        return []
    if len(pieces) < 4:
        findings.warn(brush.name, "fewer than four faces enclose no space; the brush was dropped")
        return []
    corners = [p for piece in pieces for p in piece.points]
    lower = tuple(min(axis) - 1.0 for axis in zip(*corners, strict=True))
    upper = tuple(max(axis) + 1.0 for axis in zip(*corners, strict=True))
    cells: list[Cell] = []
    todo: list[tuple[Cell, list[_Piece]]] = [(box_cell(lower, upper), pieces)]
    work = 0
    while todo:
        cell, inside = todo.pop()
        splitter, tests = _best(inside)
        back, front = split(cell, splitter.plane, splitter.surface, splitter.surface)
        behind, before = _divide(inside, splitter)
        if back is not None:
            if behind:
                todo.append((back, behind))
            else:
                cells.append(back)
        if front is not None and before:
            todo.append((front, before))
        work += tests
        if work > MAX_BRUSH_WORK:
            findings.warn(brush.name, "the brush is too complicated to be cut; it was dropped")
            return []
    if any(face.surface < 0 for cell in cells for face in cell.faces):
        findings.warn(brush.name, "the brush is not closed; it was closed at its bounding box")
        box = box_cell(
            (lower[0] + 1.0, lower[1] + 1.0, lower[2] + 1.0),
            (upper[0] - 1.0, upper[1] - 1.0, upper[2] - 1.0),
        )
        cells = [kept for cell in cells for kept in _common(cell, box)]
    return cells


@dataclass(frozen=True, slots=True)
class _Piece:
    points: tuple[Point, ...]
    plane: Plane
    surface: int


def _flat_pieces(points: list[Point], surface: int) -> Iterator[_Piece]:
    """A polygon if it is flat, else its triangles."""
    plane = plane_of(points)
    if plane is not None and max(abs(plane.height(p)) for p in points) <= TOLERANCE * 10.0:
        yield _Piece(tuple(points), plane, surface)
        return
    for second, third in itertools.pairwise(points[1:]):
        plane = plane_of((points[0], second, third))
        if plane is not None:
            yield _Piece((points[0], second, third), plane, surface)


def _best(pieces: Sequence[_Piece]) -> tuple[_Piece, int]:
    """Of a sample of polygons the one whose plane cuts fewest others, and the comparisons made."""
    if len(pieces) <= 2:
        return pieces[0], 1
    step = max(1, len(pieces) // SAMPLE)
    best, least, tests = pieces[0], math.inf, 0
    for candidate in pieces[::step]:
        tests += len(pieces)
        plane = candidate.plane
        cuts = 0
        for other in pieces:
            heights = [plane.height(p) for p in other.points]
            cuts += max(heights) > TOLERANCE and min(heights) < -TOLERANCE
        if cuts < least:
            best, least = candidate, cuts
            if cuts == 0:
                break
    return best, tests


def _divide(pieces: Sequence[_Piece], splitter: _Piece) -> tuple[list[_Piece], list[_Piece]]:
    """Polygons behind and before a splitter's plane, cut where needed; those in it are done."""
    behind: list[_Piece] = []
    before: list[_Piece] = []
    for piece in pieces:
        if piece is splitter:
            continue
        inner, outer = split_polygon(piece.points, splitter.plane)
        if inner:
            behind.append(_Piece(inner, piece.plane, piece.surface))
        if outer:
            before.append(_Piece(outer, piece.plane, piece.surface))
    return behind, before


def _common(cell: Cell, other: Cell) -> list[Cell]:
    rest: Cell | None = cell
    for face in other.faces:
        if rest is not None:
            rest = split(rest, face.plane, face.surface, face.surface)[0]
    return [] if rest is None else [rest]


def clip_to_box(solid: Solid, lower: Point, upper: Point) -> None:
    """Cut everything to a box."""
    box = box_cell(lower, upper)
    kept: list[Cell] = []
    owners: list[int] = []
    for cell, owner in zip(solid.cells, solid.owners, strict=True):
        for rest in _common(cell, box):
            kept.append(rest)
            owners.append(owner)
    solid.cells, solid.owners = kept, owners


def _texture(polygon: Polygon) -> Array | None:
    """The affine map from points to texture coordinates that a polygon's corners define."""
    if polygon.uvs is None:
        return None
    known = np.column_stack([polygon.vertices, np.ones(len(polygon.vertices))])
    answer, _, rank, _ = np.linalg.lstsq(known, polygon.uvs, rcond=None)
    if rank < 2 or not np.isfinite(answer).all():
        return None
    return np.asarray(answer.T, dtype=np.float64)


def _point(values: Sequence[float] | Array) -> Point:
    return float(values[0]), float(values[1]), float(values[2])
