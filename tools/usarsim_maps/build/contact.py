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

from usarsim_maps.build.convex import SLACK, convex_parts
from usarsim_maps.build.mesh_error import (
    MEDIAN,
    MOST,
    SurfaceError,
    drivable_points,
    is_open,
    surface_error,
)
from usarsim_maps.build.orientation import Oriented, orient
from usarsim_maps.build.pieces import (
    FLAT,
    BoxPiece,
    Convex,
    HullPiece,
    Piece,
    bounding_box_piece,
    box_from_axes,
    corners_of,
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

INSET = 2.0
"""Times its depth: how far from its edges the rays start that ask where a slab would stand out."""

OUT = 8e-3
"""m by which a corner of a slab may stand out."""

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

PARTS = 64
"""Convex pieces into which one closed part is cut at most; else its surface stays."""

PART_TRIANGLES = 8_000
"""Triangles of a part that is tried."""

OPENING, DEEP = 0.25, 0.1
"""m: width and height, and depth, of openings that stay open where hulls stand for many pieces."""

HOLE = 0.1
"""m: width and height of those that stay open where a hull stands for a closed part."""

MOVABLE_PIECES = 64
"""Most pieces of a thing that is pushed."""

MOVABLE_HULLS = 16
"""Most hulls of one that would have more."""

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
    pieces: list[Piece] = []
    fronts, steps = [], []
    for number, points in enumerate(polygons):
        way = ways[number] * depths[number]
        fronts.append(points - way / 2.0 if centred[number] else points)
        steps.append(_step(points, way, up))
    backs = _backs(surface, fronts, steps, ~centred)
    for number, points in enumerate(fronts):
        straight, back = points + steps[number], backs[number]
        if back is None and _is_rectangle(points):
            way = ways[number]
            edges = np.roll(points, -1, axis=0) - points
            axes = np.array([edges[0], edges[1], way])
            axes /= np.linalg.norm(axes, axis=1)[:, None]
            pieces.append(box_from_axes(np.concatenate([points, straight]), axes))
            continue
        pieces.append(HullPiece(np.concatenate([points, straight if back is None else back])))
    return pieces


def _step(points: Array, way: Array, up: Array) -> Array:
    """From the front of a slab to its back.

    What may be stood on and is no rectangle is extruded downwards, so that it stays below its
    neighbours (worlds 62).
    """
    depth = float(np.linalg.norm(way))
    return -up * depth if float(way @ up) < -WALL * depth and not _is_rectangle(points) else way


def _is_rectangle(points: Array) -> bool:
    if len(points) != 4:
        return False
    edges = np.roll(points, -1, axis=0) - points
    edges = edges / np.maximum(np.linalg.norm(edges, axis=1), 1e-12)[:, None]
    square = np.abs(np.einsum("ij,ij->i", edges, np.roll(edges, -1, axis=0))) < RIGHT_ANGLE
    return bool(square.all())


def _backs(
    surface: Oriented, fronts: list[Array], steps: list[Array], chosen: NDArray[np.bool_]
) -> list[Array | None]:
    """Corners of the backs of slabs that would stand out; None of all others.

    A ray goes from within a slab, near each corner, to the corner of its back: where it meets a
    surface the slab ends. So no slab stands out behind the back and the underside of a wedge.
    """
    found: list[Array | None] = [None] * len(fronts)
    rays = Rays(surface.soup.vertices[surface.soup.triangles])
    starts, targets, owners = [], [], []
    for number in np.flatnonzero(chosen).tolist():
        points, step = fronts[number], steps[number]
        depth = float(np.linalg.norm(step))
        middle = points.mean(axis=0)
        ways = np.roll(points, -1, axis=0) - points
        ways /= np.maximum(np.linalg.norm(ways, axis=1), 1e-12)[:, None]
        to_middle = middle - points
        along = np.einsum("ij,ij->i", to_middle, ways)
        inset = np.linalg.norm(to_middle - along[:, None] * ways, axis=1)
        least = np.minimum(inset, np.roll(inset, 1))
        share = np.clip(INSET * depth / np.maximum(least, 1e-9), 0.0, 0.5)
        starts.append(points + share[:, None] * to_middle)
        targets.append(points + step)
        owners.append(np.full(len(points), number))
    if not owners:
        return found
    start, target, owner = np.concatenate(starts), np.concatenate(targets), np.concatenate(owners)
    step = np.array(steps)[owner]
    depth = np.linalg.norm(step, axis=1)
    down = step / depth[:, None]
    room = rays.cast(start + down * 1e-3, down)[0] + 1e-3
    start = start + down * (np.minimum(depth, room) / 2.0)[:, None]
    ways = target - start
    lengths = np.linalg.norm(ways, axis=1)
    ways /= lengths[:, None]
    met, faces = rays.cast(start, ways)
    normals, _ = normals_areas(surface.soup.vertices, surface.soup.triangles)
    leaves = np.einsum("ij,ij->i", normals[faces], ways) > 0.0
    out = (met < lengths - OUT) & (leaves | ~surface.known[faces])
    ends = np.where(out, met, lengths)
    back = start + ways * ends[:, None]
    bounds = np.searchsorted(owner, np.arange(len(fronts) + 1))
    for number in np.unique(owner[out]).tolist():
        found[number] = back[bounds[number] : bounds[number + 1]]
    return found


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
            return _fewer(soup, points, MOVABLE_PIECES, name, findings)
        case Collision.SURFACE:
            return slabs(orient(soup, up), up)
    if movable:
        return _pushed(soup, points, up, name, findings)
    return _automatic(soup, up, name, findings)


def _pushed(soup: Soup, points: Array, up: Array, name: str, findings: Findings) -> list[Piece]:
    """Convex pieces for a thing that is pushed, as few as are true to what is seen.

    Slabs, which have no inside, stand for what is not closed, unless its hull does.
    """
    surface = orient(soup, up)
    level = points - np.outer(points @ up, up)
    wide = float(np.sort(np.ptp(level, axis=0))[-2]) >= GROUND
    most = MOVABLE_SURFACE if wide else MOVABLE_PIECES
    solids, rest = _solids(surface, components(surface.soup), up)
    pieces: list[Piece] = list(solids)
    if rest:
        opened = surface.only(np.sort(np.concatenate(rest)))
        hulls = _component_hulls(opened.soup)
        if _is_true(opened, hulls, up):
            pieces += hulls
        else:
            pieces += slabs(opened, up, within=True)
    if len(pieces) <= most:
        return pieces
    hulls = _component_hulls(surface.soup)
    coarse = hulls if len(hulls) <= MOVABLE_HULLS else [hull_piece(points)]
    if not _is_true(surface, coarse, up):
        error = _error(surface, coarse, up)
        findings.warn(
            name,
            f"it moves, and cannot be cut into {most} convex pieces or fewer; "
            f"{_hulls_of(coarse)}, {100.0 * error.median:.0f} cm off in the median",
        )
    return list(coarse)


def _hulls_of(pieces: Sequence[Convex]) -> str:
    return "its hull stands for it" if len(pieces) == 1 else f"{len(pieces)} hulls stand for it"


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
    solids, rest = _solids(surface, components(soup), up)
    pieces: list[Piece] = list(solids)
    if rest:
        pieces += slabs(surface.only(np.sort(np.concatenate(rest))), up)
    budget = PROP_PIECES if size < PROP else ROOM_PIECES if size < 4 * PROP else MAP_PIECES
    if len(pieces) <= budget:
        return pieces
    coarse = _within(_component_hulls(soup), points, budget)
    if _is_true(surface, coarse, up):
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
        f"for them, {100.0 * _error(surface, coarse, up).median:.0f} cm off in the median",
    )
    return list(coarse)


def _solids(
    surface: Oriented, parts: list[NDArray[np.intp]], up: Array
) -> tuple[list[Convex], list[NDArray[np.intp]]]:
    """Convex pieces for the parts that are closed or small, and all the other parts."""
    soup = surface.soup
    pieces: list[Convex] = []
    rest: list[NDArray[np.intp]] = []
    doubtful: list[tuple[NDArray[np.intp], Convex]] = []
    rooms = [_box_around(soup, part) for part in parts if _is_room(surface, part)]
    for part in parts:
        corners = soup.vertices[np.unique(soup.triangles[part])]
        low, high = corners.min(axis=0), corners.max(axis=0)
        extents = np.sort(high - low)
        small = extents[2] < SMALL and extents[1] < OPENING
        hull = hull_piece(corners)
        if isinstance(hull, BoxPiece) and 2.0 * min(hull.half) < 1.01 * FLAT:
            rest.append(part)  # all in one plane
        elif any((low <= a).all() and (b <= high).all() for a, b in rooms):
            rest.append(part)  # a room, or what is around it
        elif small or (surface.closed[part].all() and _before(soup, part, hull) < SLACK):
            pieces.append(hull)
        else:
            doubtful.append((part, hull))
    if not doubtful:
        return pieces, rest
    depths = depths_inside(
        [hull for _, hull in doubtful], [_samples(soup, part) for part, _ in doubtful]
    )
    filled = volumes([hull for _, hull in doubtful])
    for (part, hull), depth, volume in zip(doubtful, depths, filled, strict=True):
        own = surface.only(part)
        if (
            surface.closed[part].all()
            and _enclosed(soup, part) > FULL * volume
            and depth < MEDIAN
            and is_open(_corners(own), triangles_of([hull]), up, HOLE, MOST)
        ):
            pieces.append(hull)
            continue
        found = convex_parts(own, PARTS) if len(part) <= PART_TRIANGLES else None
        if found is None:
            rest.append(part)
        else:
            pieces += found
    return pieces, rest


def _before(soup: Soup, part: NDArray[np.intp], hull: Convex) -> float:
    """m by which the hull of a part stands before its faces."""
    points = corners_of(hull)
    triangles = soup.triangles[part]
    normals, _ = normals_areas(soup.vertices, triangles)
    offsets = np.einsum("ij,ij->i", normals, soup.vertices[triangles[:, 0]])
    return max(float((normals @ point - offsets).max()) for point in points)


def _is_room(surface: Oriented, part: NDArray[np.intp]) -> bool:
    return bool(surface.closed[part].all()) and _enclosed(surface.soup, part) < 0.0


def _box_around(soup: Soup, part: NDArray[np.intp]) -> tuple[Array, Array]:
    corners = soup.vertices[soup.triangles[part]].reshape(-1, 3)
    return corners.min(axis=0), corners.max(axis=0)


def _corners(surface: Oriented) -> Array:
    """Triangles (n, 3, 3)."""
    return np.asarray(surface.soup.vertices[surface.soup.triangles])


def _is_true(surface: Oriented, pieces: Sequence[Convex], up: Array) -> bool:
    """Whether pieces are as true to a surface from all sides as from above."""
    if not _error(surface, pieces, up).is_small:
        return False
    return is_open(_corners(surface), triangles_of(pieces), up, OPENING, DEEP)


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
