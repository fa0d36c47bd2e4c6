"""Brushes into convex cells (worlds reference 4 and 13, items 17 to 24)."""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_maps.build import csg
from usarsim_maps.build.cells import THINNEST, Plane, box_cell, split
from usarsim_maps.build.csg import Solid, clip_to_box, evaluate
from usarsim_maps.build.pieces import BoxPiece, HullPiece, piece_of_cell
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Brush, BrushOperation, Polygon, Solidity

ADD, SUBTRACT = BrushOperation.ADD, BrushOperation.SUBTRACT
Corner = tuple[float, float, float]


def box_faces(low: Corner, high: Corner, inward: bool = False) -> tuple[Polygon, ...]:
    """Faces of a box."""
    cell = box_cell(low, high)
    return tuple(Polygon(np.array(f.points[:: -1 if inward else 1])) for f in cell.faces)


def box(low: Corner, high: Corner, operation: BrushOperation = ADD, **more: object) -> Brush:
    """A box brush."""
    return Brush("box", box_faces(low, high), operation, **more)  # type: ignore[arg-type]


def prism(outline: Sequence[tuple[float, float]], bottom: float, top: float) -> tuple[Polygon, ...]:
    """Side faces of a prism over an outline that runs anticlockwise; no lids."""
    faces = []
    for (ax, ay), (bx, by) in zip(outline, [*outline[1:], outline[0]], strict=True):
        quad = [(ax, ay, bottom), (bx, by, bottom), (bx, by, top), (ax, ay, top)]
        faces.append(Polygon(np.array(quad, dtype=float)))
    return tuple(faces)


def volume(solid: Solid) -> float:
    """Sum over all cells."""
    return sum(cell.volume for cell in solid.cells)


def contains(solid: Solid, point: Corner) -> bool:
    """Whether a point is inside some cell."""
    return any(all(f.plane.height(point) < 0.0 for f in cell.faces) for cell in solid.cells)


def test_a_box_is_one_cell() -> None:
    """A box brush stays one box, of the right volume."""
    solid = evaluate([box((0, 0, 0), (2, 3, 4))])
    assert len(solid.cells) == 1
    assert volume(solid) == pytest.approx(24.0)
    assert isinstance(piece_of_cell(solid.cells[0]), BoxPiece)


def test_a_subtraction_alone_is_a_room() -> None:
    """A level that begins with a subtraction is a room in solid rock (worlds 19)."""
    solid = evaluate([box((0, 0, 0), (4, 4, 3), SUBTRACT)])
    assert not contains(solid, (2.0, 2.0, 1.5))
    for wall in ((-0.1, 2, 1), (4.1, 2, 1), (2, -0.1, 1), (2, 4.1, 1), (2, 2, -0.1), (2, 2, 3.1)):
        assert contains(solid, wall)


def test_order_matters() -> None:
    """Add, subtract, add in the hole gives the last add; without the last two it does not
    (worlds 20)."""
    block, hole = box((0, 0, 0), (4, 4, 4)), box((1, 1, 1), (3, 3, 3), SUBTRACT)
    core = box((1.5, 1.5, 1.5), (2.5, 2.5, 2.5))
    assert contains(evaluate([block, hole, core]), (2, 2, 2))
    assert not contains(evaluate([block, core, hole]), (2, 2, 2))
    assert volume(evaluate([block, hole, core], disjoint=True)) == pytest.approx(64 - 8 + 1)
    assert volume(evaluate([block, core, hole], disjoint=True)) == pytest.approx(64 - 8)


def hollow_with_t_junctions() -> Brush:
    """A hollow box of which the top is cut in two, so that edges meet faces in their middle."""
    outer = [f for f in box_faces((0, 0, 0), (4, 4, 3)) if f.vertices[:, 2].min() < 3.0]
    halves = [
        Polygon(np.array([(0, 0, 3), (2, 0, 3), (2, 4, 3), (0, 4, 3)], dtype=float)),
        Polygon(np.array([(2, 0, 3), (4, 0, 3), (4, 4, 3), (2, 4, 3)], dtype=float)),
    ]
    inner = box_faces((0.2, 0.2, 0.2), (3.8, 3.8, 2.8), inward=True)
    return Brush("hollow", (*outer, *halves, *inner))


def test_a_hollow_brush(findings: Findings) -> None:
    """A concave brush with T-junctions has its volume to 0.1 % (worlds 21)."""
    solid = evaluate([hollow_with_t_junctions()], disjoint=True, findings=findings)
    assert volume(solid) == pytest.approx(48.0 - 3.6 * 3.6 * 2.6, rel=1e-3)
    assert not contains(solid, (2.0, 2.0, 1.5))
    assert not findings.warnings()


@given(st.randoms(use_true_random=False))
@settings(max_examples=20, deadline=None)
def test_polygon_order_does_not_matter(dice: random.Random) -> None:
    """However the faces of a brush are listed, the solid is the same (worlds 22)."""
    faces = list(hollow_with_t_junctions().polygons)
    dice.shuffle(faces)
    solid = evaluate([Brush("hollow", tuple(faces))], disjoint=True)
    assert volume(solid) == pytest.approx(48.0 - 3.6 * 3.6 * 2.6, rel=1e-6)


COORDINATE = st.integers(0, 8).map(float)


@st.composite
def programs(draw: st.DrawFn) -> list[Brush]:
    """A few boxes on a grid, added and taken away; among them walls of almost no thickness."""
    brushes = []
    for _ in range(draw(st.integers(1, 6))):
        low = [draw(COORDINATE) for _ in range(3)]
        size = [draw(st.sampled_from([1e-6, 0.01, 1.0, 2.0, 3.0])) for _ in range(3)]
        high = [a + b for a, b in zip(low, size, strict=True)]
        operation = draw(st.sampled_from([ADD, ADD, SUBTRACT]))
        brushes.append(box((low[0], low[1], low[2]), (high[0], high[1], high[2]), operation))
    return brushes


@given(programs())
@settings(max_examples=60, deadline=None)
def test_every_cell_is_sound(brushes: list[Brush]) -> None:
    """Cells are convex, have volume, and none is thinner than 0.01 mm (worlds 23)."""
    for cell in evaluate(brushes, disjoint=True).cells:
        assert cell.volume > 0.0
        assert cell.thickness >= THINNEST
        for face in cell.faces:
            assert max(face.plane.height(corner) for corner in cell.corners) < 1e-3


@given(programs(), st.tuples(*[st.floats(-1.0, 12.0)] * 3))
@settings(max_examples=80, deadline=None)
def test_points_agree_with_the_program(brushes: list[Brush], point: Corner) -> None:
    """A point is solid exactly if the last brush that covers it adds (worlds 20)."""
    margin = 2e-3
    state = brushes[0].operation is SUBTRACT
    for brush in brushes:
        corners = np.concatenate([p.vertices for p in brush.polygons])
        low, high = corners.min(axis=0), corners.max(axis=0)
        if ((np.array(point) > low - margin) & (np.array(point) < high + margin)).all():
            if not ((np.array(point) > low + margin) & (np.array(point) < high - margin)).all():
                return  # on the border of a brush both answers are right
            state = brush.operation is ADD
    shell = np.concatenate([p.vertices for b in brushes for p in b.polygons])
    inside = (np.array(point) > shell.min(axis=0)) & (np.array(point) < shell.max(axis=0))
    if state and not inside.all():
        return  # where the rock ends is nobody's business
    assert contains(evaluate(brushes), point) == state


def test_slanted_pieces_are_hulls() -> None:
    """A wedge is a hull, and cells of turned boxes are boxes (worlds 24)."""
    wedge = Brush(
        "wedge",
        (
            *prism([(0, 0), (2, 0), (0, 2)], 0.0, 1.0),
            Polygon(np.array([(0, 0, 1), (2, 0, 1), (0, 2, 1)], dtype=float)),
            Polygon(np.array([(0, 0, 0), (0, 2, 0), (2, 0, 0)], dtype=float)),
        ),
    )
    solid = evaluate([wedge])
    assert volume(solid) == pytest.approx(2.0)
    assert isinstance(piece_of_cell(solid.cells[0]), HullPiece)
    angle = np.radians(30.0)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    turned = Brush(
        "turned", tuple(Polygon(f.vertices @ turn.T) for f in box_faces((1, 1, 0), (2, 4, 1)))
    )
    piece = piece_of_cell(evaluate([turned]).cells[0])
    assert isinstance(piece, BoxPiece)
    assert sorted(piece.half) == pytest.approx([0.5, 0.5, 1.5])


def test_semisolid_brushes_are_not_cut() -> None:
    """A later subtraction leaves a semisolid brush alone; a nonsolid one is only seen."""
    post = box((1, 1, 0), (2, 2, 2), solidity=Solidity.SEMISOLID)
    ghost = box((3, 3, 0), (4, 4, 2), solidity=Solidity.NONSOLID)
    floor, cut = box((0, 0, -1), (5, 5, 0)), box((0, 0, 0), (5, 5, 3), SUBTRACT)
    solid = evaluate([floor, post, ghost, cut])
    assert contains(solid, (1.5, 1.5, 1.0))
    assert not contains(solid, (3.5, 3.5, 1.0))
    assert len(solid.sheets) == 6


def test_open_brushes_are_closed_and_told(findings: Findings) -> None:
    """A brush without its lid becomes solid up to its box, and the report says so."""
    faces = [f for f in box_faces((0, 0, 0), (1, 1, 1)) if f.vertices[:, 2].min() < 1.0]
    solid = evaluate([Brush("open", tuple(faces))], findings=findings)
    assert volume(solid) == pytest.approx(1.0)
    assert "not closed" in findings.warnings()[0].text


def test_flat_and_broken_brushes_are_dropped(findings: Findings) -> None:
    """A brush of too few or of flat faces encloses nothing; the rest of the level stays."""
    line = Polygon(np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0)], dtype=float))
    sheet = Polygon(np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0)], dtype=float))
    solid = evaluate(
        [
            box((5, 5, 5), (6, 6, 6)),
            Brush("flat", (line, line, line, line)),
            Brush("few", (sheet,)),
        ],
        findings=findings,
    )
    assert volume(solid) == pytest.approx(1.0)
    assert {w.subject for w in findings.warnings()} == {"flat", "few"}


def test_levels_have_a_budget(monkeypatch: pytest.MonkeyPatch, findings: Findings) -> None:
    """A level of too many cells is cut off with a warning, never endless."""
    monkeypatch.setattr(csg, "MAX_CELLS", 5)
    boxes = [box((2 * n, 0, 0), (2 * n + 1, 1, 1)) for n in range(20)]
    assert len(evaluate(boxes, findings=findings).cells) == 6
    assert "left out" in findings.warnings()[0].text


def test_clipping_to_a_box() -> None:
    """Backdrops are cut at the border of the playground."""
    solid = evaluate([box((-1000, -1000, -1), (1000, 1000, 0))])
    clip_to_box(solid, (-10, -10, -10), (10, 10, 10))
    assert volume(solid) == pytest.approx(400.0)


def test_materials_follow_the_plane() -> None:
    """New faces look like the brush that cut them: a room has the room's walls (worlds 4.3)."""
    room = Brush(
        "room",
        tuple(
            Polygon(f.vertices, f"side{n}") for n, f in enumerate(box_faces((0, 0, 0), (4, 4, 3)))
        ),
        SUBTRACT,
    )
    solid = evaluate([room])
    inner = {
        solid.surfaces[face.surface].polygon.material
        for cell in solid.cells
        for face in cell.faces
        if face.surface >= 0
    }
    assert inner == {f"side{n}" for n in range(6)}


@given(st.floats(-2.0, 2.0), st.tuples(*[st.floats(-1.0, 1.0)] * 3))
@settings(max_examples=100, deadline=None)
def test_splitting_keeps_the_volume(offset: float, normal: Corner) -> None:
    """Both halves of a cut cell have together what the whole had."""
    length = float(np.linalg.norm(normal))
    if length < 1e-3:
        return
    x, y, z = (part / length for part in normal)
    cell = box_cell((-1, -1, -1), (1, 1, 1))
    parts = split(cell, Plane(x, y, z, offset), 1, 2)
    assert sum(part.volume for part in parts if part) == pytest.approx(8.0, abs=2e-3)
