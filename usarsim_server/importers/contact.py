"""Which convex pieces a shape collides with (worlds reference 9.4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_server.importers.findings import Findings
from usarsim_server.importers.pieces import (
    FLAT,
    BoxPiece,
    Piece,
    bounding_box_piece,
    hull_piece,
    volumes,
)
from usarsim_server.importers.scene import Collision
from usarsim_server.importers.slabs import slabs
from usarsim_server.importers.soup import Soup, components, normals_areas

__all__ = ["SMALL", "collide"]

Array = NDArray[np.float64]

SMALL = 0.35
"""m: a component without a larger extent becomes a hull."""

FULL = 0.9
"""A closed component that fills this part of its hull becomes a hull."""

PROP = 3.0
"""m: what is smaller is a prop and has a small budget of pieces."""

PROP_PIECES = 64
ROOM_PIECES = 4_000
MAP_PIECES = 50_000
"""Most pieces of a prop, of something below 12 m, and of a whole building."""

MOVABLE_PIECES = 16
"""Most hulls of a thing that is pushed."""


def collide(
    soup: Soup,
    mode: Collision,
    up: Array,
    *,
    hulls: tuple[Array, ...] = (),
    movable: bool = False,
    name: str = "",
    findings: Findings | None = None,
) -> list[Piece]:
    """Pieces of a mesh, in its own (scaled) frame.

    Args:
        soup: clean triangles.
        mode: what the map or the user asks for.
        up: (3,) the vertical in the mesh's frame.
        hulls: collision pieces of the artist.
        movable: only hulls and boxes will do.
        name: for the findings.
        findings: told when a budget forces a coarser shape.
    """
    findings = findings or Findings()
    points = soup.vertices[np.unique(soup.triangles)] if len(soup.triangles) else np.zeros((0, 3))
    match mode:
        case Collision.NONE:
            return []
        case Collision.AUTO if hulls:
            return [hull_piece(np.asarray(hull, dtype=float)) for hull in hulls]
        case _ if not len(points):
            return []
        case Collision.BOX:
            return [bounding_box_piece(points)]
        case Collision.HULL:
            return [hull_piece(points)]
        case Collision.HULLS:
            return _within(_component_hulls(soup), points, MOVABLE_PIECES * 4, name, findings)
        case Collision.SURFACE:
            return slabs(soup, up)
    if movable:
        return _within(_component_hulls(soup), points, MOVABLE_PIECES, name, findings)
    return _automatic(soup, points, up, name, findings)


def _automatic(soup: Soup, points: Array, up: Array, name: str, findings: Findings) -> list[Piece]:
    size = float(np.ptp(points, axis=0).max())
    parts = components(soup)
    hulls: list[Piece] = []
    rest: list[NDArray[np.intp]] = []
    doubtful: list[tuple[NDArray[np.intp], Piece, float]] = []
    for part in parts:
        corners = soup.vertices[np.unique(soup.triangles[part])]
        if _is_flat(corners):
            rest.append(part)
        elif np.ptp(corners, axis=0).max() < SMALL:
            hulls.append(hull_piece(corners))
        elif _is_closed(soup, part):
            doubtful.append((part, hull_piece(corners), _enclosed(soup, part)))
        else:
            rest.append(part)
    if doubtful:
        filled = volumes([piece for _, piece, _ in doubtful])
        for (part, piece, volume), hull in zip(doubtful, filled, strict=True):
            if volume > FULL * hull:
                hulls.append(piece)
            else:
                rest.append(part)
    pieces = hulls
    if rest:
        chosen = np.sort(np.concatenate(rest))
        pieces = hulls + slabs(
            Soup(soup.vertices, soup.triangles[chosen], soup.origin[chosen], 0), up
        )
    budget = PROP_PIECES if size < PROP else ROOM_PIECES if size < 4 * PROP else MAP_PIECES
    if len(pieces) <= budget:
        return pieces
    findings.warn(
        name,
        f"{len(pieces)} pieces of its surface are more than the {budget} for its size; hulls of "
        "its parts stand for them",
    )
    return _within(_component_hulls(soup), points, budget, name, findings)


def _component_hulls(soup: Soup) -> list[Piece]:
    return [hull_piece(soup.vertices[np.unique(soup.triangles[part])]) for part in components(soup)]


def _within(
    pieces: list[Piece], points: Array, budget: int, name: str, findings: Findings
) -> list[Piece]:
    if len(pieces) <= budget:
        return pieces
    findings.warn(name, f"{len(pieces)} hulls are more than {budget}; one hull stands for all")
    return [hull_piece(points)]


def _is_flat(points: Array) -> bool:
    piece = hull_piece(points)
    return isinstance(piece, BoxPiece) and 2.0 * min(piece.half) < 1.01 * FLAT


def _is_closed(soup: Soup, part: NDArray[np.intp]) -> bool:
    """Every edge belongs to exactly two triangles."""
    tri = soup.triangles[part]
    edges = np.sort(np.concatenate([tri[:, [0, 1]], tri[:, [1, 2]], tri[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return bool((counts == 2).all())


def _enclosed(soup: Soup, part: NDArray[np.intp]) -> float:
    """m^3 that a closed component encloses; negative for a room, whose faces look inwards."""
    corners = soup.vertices[soup.triangles[part]]
    normals, areas = normals_areas(soup.vertices, soup.triangles[part])
    middle = corners.mean(axis=(0, 1))
    heights = np.einsum("ij,ij->i", corners[:, 0] - middle, normals)
    return float(heights @ areas) / 3.0
