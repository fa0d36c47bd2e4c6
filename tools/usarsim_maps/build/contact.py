"""Which convex pieces a shape collides with (worlds reference 9.2 to 9.4).

MuJoCo collides a mesh as its convex hull, which would fill every room. So coplanar triangles are
merged into convex polygons, each with a thin slab behind it, which keeps the surface exact. What
may be driven on is exact from above even where nobody can tell which side of it is outside: there
the slab lies below. Props, solid blocks and rolling ground get something cheaper that is as true.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.build.mesh_error import MEDIAN, SurfaceError, drivable_points, surface_error
from usarsim_maps.build.orientation import Oriented, orient
from usarsim_maps.build.pieces import (
    FLAT,
    BoxPiece,
    Convex,
    HullPiece,
    Piece,
    bounding_box_piece,
    box_from_axes,
    depths_inside,
    hull_piece,
    triangles_of,
    volumes,
)
from usarsim_maps.build.soup import Rays, Soup, components, convex_polygons
from usarsim_maps.build.terrain import as_terrain, is_rolling
from usarsim_maps.findings import Findings
from usarsim_maps.geometry import normals_areas
from usarsim_maps.scene import Array, Collision

THICKNESS = 0.05
"""m of slab behind a wall: nothing up to 5 m/s tunnels (worlds reference 9.3)."""

FLOOR = 0.1
"""m of slab below a floor."""

UNDER = 0.008
"""m of slab of what looks down: it may be an underside, a ceiling, or a floor that is reversed."""

LEAST = 0.004
"""m: thickness where another surface lies closely behind."""

STEEP = 0.7
"""Upward part of the normal of what counts as a floor."""

WALL = 0.35
"""Upward part of the normal of what nothing can stand on."""

PLATE = 0.3
"""m: what looks down with a surface so near above it is the underside of something."""

RIGHT_ANGLE = 1e-3
"""Cosine of the angles of what counts as a rectangle."""


SMALL = 0.35
"""m: a component without a larger extent becomes a hull."""

FULL = 0.9
"""A closed component that fills this part of its hull may become a hull."""

PROP = 3.0
"""m: what is smaller is a prop."""

PROP_PIECES = 64
ROOM_PIECES = 4_000
MAP_PIECES = 50_000
"""Pieces of a prop, of something below 12 m, and of a whole building that are not yet many: beyond
them something coarser stands for the surface, if it is true to it. Beyond `MAP_PIECES`, always."""

MOVABLE_PIECES = 16
"""Most hulls of a thing that is pushed, where nothing drives on it."""

MOVABLE_SURFACE = 1_000
"""Most pieces of one that is driven on."""

GROUND = 1.1
"""m along and across from which on a thing that could be pushed is rather driven on."""

GRID = 60
"""Rays along each side of a thing with which what is coarser is compared with it."""

LEAST_DRIVABLE = 0.25
"""m^2: on less than this nothing drives."""


def slabs(surface: Oriented, up: Array, *, within: bool = False) -> list[Piece]:
    """Slabs of all polygons of a soup; floors, `up` (3,) in its frame, get thicker ones.

    `within`: nothing comes out below the lowest point, on which the thing may stand.
    """
    found = convex_polygons(surface.soup)
    if not found:
        return []
    first = np.array([index for index, _ in found])
    closed, known = surface.closed[first], surface.known[first]
    polygons = [surface.soup.vertices[list(ring)] for _, ring in found]
    normals = np.array([_normal(points) for points in polygons])
    rise = normals @ up
    behind, tightest = _room_behind(surface, polygons, normals)
    before, _ = _room_behind(surface, polygons, -normals)
    # A slab of what looks down lies in the solid above it, if there is one, else below it.
    below = (rise < -WALL) & ~closed & (behind > PLATE)
    ways = np.where(below[:, None], normals, -normals)
    # The underside of a wedge must not come out at its thin end.
    room = np.where(below, before, np.where(rise < -WALL, tightest, behind))
    centred = ~known & (np.abs(rise) <= WALL)
    room = np.where(centred, 2.0 * np.minimum(before, behind), room)
    wanted = np.where(rise < -WALL, UNDER, np.where(rise > STEEP, FLOOR, THICKNESS))
    depths = np.maximum(LEAST, np.minimum(wanted, room))
    if within:
        lowest = float((surface.soup.vertices[surface.soup.triangles] @ up).min())
        least = np.array([float((points @ up).min()) for points in polygons])
        down = np.where((rise > WALL) | below, least - lowest, np.inf)
        depths = np.maximum(LEAST, np.minimum(depths, down))
    pieces = []
    for number, points in enumerate(polygons):
        way = ways[number] * depths[number]
        front = points - way / 2.0 if centred[number] else points
        pieces.append(_slab(front, way, up))
    return pieces


def _slab(points: Array, way: Array, up: Array) -> Piece:
    """A polygon extruded: a box if it is a rectangle (item 62).

    Others that may be stood on are extruded downwards, so that they stay below their neighbours.
    """
    solid = np.concatenate([points, points + way])
    depth = float(np.linalg.norm(way))
    if len(points) == 4:
        edges = np.roll(points, -1, axis=0) - points
        lengths = np.linalg.norm(edges, axis=1)
        edges = edges / np.maximum(lengths, 1e-12)[:, None]
        if (np.abs(np.einsum("ij,ij->i", edges, np.roll(edges, -1, axis=0))) < RIGHT_ANGLE).all():
            return box_from_axes(solid, np.array([edges[0], edges[1], way / depth]))
    if float(way @ up) < -WALL * depth:
        solid = np.concatenate([points, points - up * depth])
    return HullPiece(solid)


def _normal(points: Array) -> Array:
    """Unit normal of a polygon (Newell's method)."""
    cross = np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0]).sum(axis=0)
    return np.asarray(cross / max(float(np.linalg.norm(cross)), 1e-30))


def _room_behind(surface: Oriented, polygons: list[Array], normals: Array) -> tuple[Array, Array]:
    """Distance (m) behind each polygon to the next surface: median and least over points of it."""
    rays = Rays(surface.soup.vertices[surface.soup.triangles])
    starts, owners = [], []
    for number, points in enumerate(polygons):
        middle = points.mean(axis=0)
        inner = middle + 0.8 * (points[:8] - middle)
        starts.append(np.concatenate([middle[None], inner]))
        owners.append(np.full(len(inner) + 1, number))
    owner = np.concatenate(owners)
    origin = np.concatenate(starts) - normals[owner] * 1e-3
    ways = rays.cast(origin, -normals[owner])[0] + 1e-3
    ends = np.searchsorted(owner, np.arange(len(polygons) + 1))
    each = [ways[a:b] for a, b in itertools.pairwise(ends)]
    return np.array([np.median(some) for some in each]), np.minimum.reduceat(ways, ends[:-1])


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
    """Pieces of a mesh, in its own (scaled) frame, in which `up` (3,) is the vertical.

    The map or the user asks for a mode; the artist may have given hulls. For movable things only
    hulls and boxes will do. The findings are told when a budget forces a coarser shape.
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
            return _fewer(soup, points, 4 * MOVABLE_PIECES, name, findings)
        case Collision.SURFACE:
            return slabs(orient(soup, up), up)
    if movable:
        return _pushed(soup, points, up, name, findings)
    return _automatic(soup, up, name, findings)


def _pushed(soup: Soup, points: Array, up: Array, name: str, findings: Findings) -> list[Piece]:
    """Hulls for a thing that is pushed, as few as are true to what may be driven on.

    Slabs, which have no inside, come last: ground that the map does not say to be fixed.
    """
    hulls = _component_hulls(soup)
    coarse = _within(hulls, points, MOVABLE_PIECES)
    level = points - np.outer(points @ up, up)
    if float(np.sort(np.ptp(level, axis=0))[-2]) < GROUND:
        return _fewer(soup, points, MOVABLE_PIECES, name, findings)
    surface = orient(soup, up)
    error = _error(surface, coarse, up)
    if error.is_small:
        return list(coarse)
    if len(hulls) <= MOVABLE_SURFACE and _error(surface, hulls, up).is_small:
        return list(hulls)
    shell = slabs(surface, up, within=True)
    if len(shell) <= MOVABLE_SURFACE:
        return shell
    findings.warn(
        name,
        f"{len(shell)} pieces of its surface are too many for a thing that is pushed; "
        f"{len(coarse)} hulls stand for it, {100.0 * error.median:.0f} cm off in the median",
    )
    return list(coarse)


def _fewer(soup: Soup, points: Array, most: int, name: str, findings: Findings) -> list[Piece]:
    """Hulls of the components, or one of all."""
    pieces = _component_hulls(soup)
    if len(pieces) <= most:
        return list(pieces)
    findings.warn(name, f"{len(pieces)} hulls are more than {most}; one hull stands for all")
    return [hull_piece(points)]


def _automatic(soup: Soup, up: Array, name: str, findings: Findings) -> list[Piece]:
    surface = orient(soup, up)
    soup = surface.soup
    points = soup.vertices[np.unique(soup.triangles)]
    size = float(np.ptp(points, axis=0).max())
    if is_rolling(soup):
        terrain = as_terrain(surface, up)
        if terrain is not None:
            return [terrain]
    parts = components(soup)
    hulls: list[Convex] = []
    rest: list[NDArray[np.intp]] = []
    doubtful: list[tuple[NDArray[np.intp], Convex]] = []
    for part in parts:
        corners = soup.vertices[np.unique(soup.triangles[part])]
        hull = hull_piece(corners)
        if isinstance(hull, BoxPiece) and 2.0 * min(hull.half) < 1.01 * FLAT:
            rest.append(part)  # all in one plane
        elif np.ptp(corners, axis=0).max() < SMALL:
            hulls.append(hull)
        elif surface.closed[part].all():
            doubtful.append((part, hull))
        else:
            rest.append(part)
    if doubtful:
        filled = volumes([piece for _, piece in doubtful])
        depths = depths_inside(
            [piece for _, piece in doubtful], [_samples(soup, part) for part, _ in doubtful]
        )
        for (part, piece), volume, depth in zip(doubtful, filled, depths, strict=True):
            if _enclosed(soup, part) > FULL * volume and depth < MEDIAN:
                hulls.append(piece)
            else:
                rest.append(part)
    pieces: list[Piece] = list(hulls)
    if rest:
        pieces += slabs(surface.only(np.sort(np.concatenate(rest))), up)
    budget = PROP_PIECES if size < PROP else ROOM_PIECES if size < 4 * PROP else MAP_PIECES
    if len(pieces) <= budget:
        return pieces
    coarse = _within(_component_hulls(soup), points, budget)
    error = _error(surface, coarse, up)
    if error.is_small:
        return list(coarse)
    if len(pieces) > ROOM_PIECES:
        terrain = as_terrain(surface, up)
        if terrain is not None:
            return [terrain]
    if len(pieces) <= MAP_PIECES:
        return pieces
    findings.warn(
        name,
        f"{len(pieces)} pieces of its surface are too many; {len(coarse)} hulls of its parts stand "
        f"for them, {100.0 * error.median:.0f} cm off in the median",
    )
    return list(coarse)


def _error(surface: Oriented, pieces: Sequence[Convex], up: Array) -> SurfaceError:
    """How far pieces are from a surface where it may be driven on; none if that is nowhere."""
    x = np.eye(3)[int(np.argmin(np.abs(up)))]
    x = np.cross(up, x) / np.linalg.norm(np.cross(up, x))
    turn = np.column_stack([x, np.cross(up, x), up])
    soup = surface.soup
    seen = soup.vertices[soup.triangles] @ turn
    low, high = seen.min(axis=(0, 1)), seen.max(axis=(0, 1))
    x, y = np.meshgrid((np.arange(GRID) + 0.37) / GRID, (np.arange(GRID) + 0.53) / GRID)
    places = low[:2] + np.column_stack([x.ravel(), y.ravel()]) * (high - low)[:2]
    found, rooms, _ = drivable_points(seen, places)
    if len(found) * float((high - low)[:2].prod()) / len(places) < LEAST_DRIVABLE:
        return SurfaceError(0, 0.0, 0.0, 0.0)
    return SurfaceError.of(surface_error(found, rooms, triangles_of(pieces) @ turn))


def _samples(soup: Soup, part: NDArray[np.intp]) -> Array:
    """Corners, middles and middles of edges of some triangles."""
    a, b, c = (soup.vertices[soup.triangles[part, k]] for k in range(3))
    return np.concatenate([a, b, c, (a + b + c) / 3.0, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0])


def _component_hulls(soup: Soup) -> list[Convex]:
    return [hull_piece(soup.vertices[np.unique(soup.triangles[part])]) for part in components(soup)]


def _within(pieces: list[Convex], points: Array, budget: int) -> list[Convex]:
    return pieces if len(pieces) <= budget else [hull_piece(points)]


def _enclosed(soup: Soup, part: NDArray[np.intp]) -> float:
    """m^3 that a closed component encloses; negative for a room, whose faces look inwards."""
    corners = soup.vertices[soup.triangles[part]]
    normals, areas = normals_areas(soup.vertices, soup.triangles[part])
    middle = corners.mean(axis=(0, 1))
    heights = np.einsum("ij,ij->i", corners[:, 0] - middle, normals)
    return float(heights @ areas) / 3.0
