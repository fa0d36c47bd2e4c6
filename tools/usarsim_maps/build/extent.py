"""How large a map is: what of it counts, and what is only a backdrop around it.

A backdrop is larger than `GIANT`, goes around the rest and over it, and is not what a start pose
stands on: a painted sky, the rock or the box that a level lies in. Ground is part of the map,
however wide it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from usarsim_maps.build.csg import is_filled
from usarsim_maps.build.looks import looks_of_grid
from usarsim_maps.build.soup import Rays
from usarsim_maps.findings import Findings
from usarsim_maps.geometry import CORNERS, FARTHEST, QUADS, box_around, points_of
from usarsim_maps.scene import (
    Array,
    Brush,
    BrushOperation,
    Heightfield,
    Mesh,
    Plane,
    Scene,
    SceneObject,
    Solidity,
)
from usarsim_maps.units import matrix_of_pose
from usarsim_server.base.errors import MapImportError, at

SMALLEST, LARGEST = 1.0, 2000.0
"""m: extents of a map that can be true where its scale is assumed (worlds reference 11)."""

FARTHEST_APART = 2e4
"""m: extent of any map at most. At its ends rays, of single precision, are true to 1 mm."""

TINIEST = 1e-3
"""m: extent of a single thing that can be true where its scale is assumed."""

GIANT = 400.0
"""m: what is larger may be a backdrop."""

MARGIN = 50.0
"""m around the rest of the map at which backdrops made of brushes are cut off; also how far below a
start pose something may be that it is to stand on."""

NEAR_START = 40.0
"""m outside of what counts at which a start pose is still believed."""

SUNK = 0.5
"""m below its floor at which a start pose may be."""

SLACK = 0.01
"""Part of the size of the rest by which it may stand out of its backdrop sideways."""

PROBES = 5
"""Along each side of the rest, from where a look upwards tells whether it is covered."""

GEOMETRY = ("file", "mesh", "model", "sublevel")
"""Kinds of missing things without which there may be no map."""

SKY = ("skydome", "sky_dome", "skybox", "sky_box", "skysphere", "sky_sphere")
"""Parts of names of what is only painted around a map."""

Corners = tuple[Array, Array]
"""Lower and upper corner (3,) of a box, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """What of a scene counts for its size."""

    corners: Corners | None  # of all that counts; None if nothing has an end
    backdrops: tuple[str, ...]  # names of objects that do not count
    rocks: tuple[str, ...]  # names of brushes that do not count, and are to be cut off
    oversized: tuple[_Item, ...]  # ground that is too large to be true; it is kept

    @property
    def size(self) -> float:
        """Longest side, m; 0 if nothing has an end."""
        return 0.0 if self.corners is None else float(np.ptp(self.corners, axis=0).max())


@dataclass(frozen=True, slots=True, eq=False)
class _Item:
    """A thing with an end."""

    name: str
    corners: Corners
    triangles: Callable[[], Array]  # (n, 3, 3) in the world
    brush: bool = False
    cuts: bool = False  # it takes away from what is solid
    sheets: Corners | None = None  # of what is seen of something that cuts, wherever it is

    @property
    def size(self) -> float:
        """Longest side, m."""
        return float(np.ptp(self.corners, axis=0).max())


# ---- what counts -------------------------------------------------------------------------------


def measure(scene: Scene) -> Extent:
    """Find out how large a scene is, without what surrounds it."""
    items = _items(scene)
    kept = list(items)
    away: list[_Item] = []
    for item in sorted(items, key=lambda one: -one.size):
        others = [other for other in kept if other is not item]
        if item.size > GIANT and others and _is_backdrop(item, others, scene):
            kept = others
            away.append(item)
    rocks = [item for item in away if item.brush]
    if not is_filled(scene.brushes, scene.filled) and not any(not rock.cuts for rock in rocks):
        # What is cut out of nothing has no size.
        left = [_without_cut(item) if item.cuts else item for item in kept]
        kept = [item for item in left if item is not None] or kept
    oversized: list[_Item] = []
    if not scene.source.stated:
        believed = [item for item in kept if item.size <= LARGEST]
        if believed and len(believed) < len(kept):
            oversized = [item for item in kept if item.size > LARGEST]
            kept = believed
    return Extent(
        _union([item.corners for item in kept]) if kept else None,
        tuple(item.name for item in away if not item.brush),
        tuple(item.name for item in rocks),
        tuple(oversized),
    )


def tell(extent: Extent, findings: Findings) -> None:
    """Note what does not count for the size."""
    for name in extent.backdrops:
        findings.warn(name, "a backdrop around the map: it is kept, and no part of the extents")
    for name in extent.rocks:
        findings.warn(name, f"a backdrop around the map: it was cut off {MARGIN:g} m around it")
    for item in extent.oversized:
        text = f"it is {item.size:,.0f} m large: it is kept, and no part of the extents"
        findings.warn(item.name, text)


def without_sky(scene: Scene, findings: Findings) -> Scene:
    """The scene without skies that are painted on something around and over the rest."""
    skies = [thing for thing in scene.objects if _is_sky(thing)]
    if not skies:
        return scene
    rest = measure(replace(scene, objects=tuple(t for t in scene.objects if not _is_sky(t))))
    left: list[SceneObject] = []
    for thing in skies:
        item = _item_of_object(thing)
        if item is None:
            continue
        around = rest.corners is None or _is_around(item, rest.corners)
        if around and not _lies_below_a_start(item, _items(scene, without=thing), scene):
            findings.warn(thing.name, "a painted sky was left out")
            left.append(thing)
    return replace(scene, objects=tuple(t for t in scene.objects if all(t is not s for s in left)))


def with_starts(scene: Scene, extent: Extent, corners: Corners) -> Corners:
    """Corners moved apart so that start poses near what counts, or above large ground, are inside.

    Starts within `NEAR_START` are near.
    """
    lower, upper = corners
    boxes = [corners, *(item.corners for item in extent.oversized)]
    places = [np.array(start.pose.position) for start in scene.starts]
    near = [
        place
        for place in places
        if any(
            ((place > low - NEAR_START) & (place < high + NEAR_START)).all() for low, high in boxes
        )
    ]
    return np.min([lower, *near], axis=0), np.max([upper, *near], axis=0)


def bounds_of_object(thing: SceneObject) -> Corners | None:
    """Lower and upper corner in the world; None for what has no size."""
    base = matrix_of_pose(thing.pose)
    boxes = [box for part in thing.parts for box in [box_around(part, base)] if box is not None]
    if not boxes:
        return None
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)


def extent_of_planes(scene: Scene, findings: Findings) -> Corners:
    """The playable part of a map of endless planes: what is drawn of them, and the start poses.

    Raises:
        MapImportError: there are no planes, or they are only what is left of a map whose meshes
            and models are all missing.
    """
    source = scene.source.path
    lost = [name for kind, name, _ in findings.missing_list() if kind in GEOMETRY]
    files = [Path(name).name for name in lost]
    notes = (f"; {note.subject}: {note.text}" for note in findings.warnings())
    if lost:
        names = ", ".join(name[:80] for name in lost[:3])
        more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
        why = next((note for note in notes if any(file in note for file in files)), "")
        problem = f"none of the meshes and models that it names can be had: {names}{more}{why}"
        cure = "import it with --assets DIR for the folder in which they lie, or --placeholders"
        raise MapImportError(at(source, problem, cure))
    corners = [np.array(start.pose.position) for start in scene.starts]
    for thing in scene.objects:
        for part in thing.parts:
            if isinstance(part.shape, Plane):
                matrix = matrix_of_pose(thing.pose) @ part.matrix
                across = np.abs(matrix[:3, :2]) @ (np.minimum(part.shape.size, LARGEST) / 2.0)
                corners += [matrix[:3, 3] - across, matrix[:3, 3] + across]
    if len(corners) == len(scene.starts):
        cure = "check that the export contains geometry; meshes are found with --assets"
        problem = f"there is no geometry in this map{next(notes, '')}"
        raise MapImportError(at(source, problem, cure))
    return np.min(corners, axis=0), np.max(corners, axis=0)


# ---- whether it can be true --------------------------------------------------------------------


def check_size(scene: Scene, corners: Corners, findings: Findings) -> None:
    """Refuse what cannot be true where the scale was assumed; a single thing may be small.

    Raises:
        MapImportError: with a scale that would make sense.
    """
    lower, upper = corners
    extent = float((upper - lower).max())
    source = scene.source
    guess = source.units_per_metre * extent / 30.0 if extent > 0.0 else 1.0
    cure = f"give the true scale, for example --scale {_plain(guess)} for a map of 30 m"
    size = " x ".join(_plain(value) for value in (upper - lower).tolist())
    if source.stated and extent <= FARTHEST_APART:
        if extent > LARGEST:
            findings.warn(source.path.name, f"{size} m are much; if this is wrong {cure}")
        return
    a_map = source.whole_map or bool(scene.starts or scene.brushes)
    if TINIEST <= extent < SMALLEST and not a_map:
        findings.warn(source.path.name, f"{size} m are little; if this is a map {cure}")
        return
    if SMALLEST <= extent <= LARGEST and math.isfinite(extent):
        return
    problem = (
        f"the map would be {size} m large; absurd at {source.units_per_metre:g} units per metre"
    )
    raise MapImportError(at(source.path, problem, cure))


def _plain(value: float) -> str:
    """Three digits and, unless it is absurd, no exponent, as people write `--scale`."""
    if value and not 1e-9 < abs(value) < 1e9:
        return f"{value:.3g}"
    return np.format_float_positional(float(f"{value:.3g}"), trim="-")


# ---- things with an end ------------------------------------------------------------------------


def _items(scene: Scene, without: SceneObject | None = None) -> list[_Item]:
    """All things of a scene with an end, but one."""
    found = [_item_of_object(thing) for thing in scene.objects if thing is not without]
    found += [_item_of_field(field) for field in scene.heightfields]
    found += [_item_of_brush(brush) for brush in scene.brushes]
    return [item for item in found if item is not None and np.isfinite(item.corners).all()]


def _item_of_object(thing: SceneObject) -> _Item | None:
    corners = bounds_of_object(thing)
    return corners and _Item(thing.name, corners, lambda: _triangles_of_object(thing))


def _item_of_field(field: Heightfield) -> _Item:
    rows, columns = np.shape(field.heights)[:2]
    x, y = (columns - 1) * field.spacing[0], (rows - 1) * field.spacing[1]
    low, high = float(np.min(field.heights)), float(np.max(field.heights))
    corners = np.array([[a, b, c] for a in (0.0, x) for b in (0.0, y) for c in (low, high)])
    world = corners @ field.pose.matrix().T + np.array(field.pose.position)

    def triangles() -> Array:
        found = looks_of_grid(np.asarray(field.heights, dtype=float), field.spacing, 1.0).corners
        return np.asarray(found @ field.pose.matrix().T + np.array(field.pose.position))

    return _Item(field.name, _corners(world), triangles)


def _item_of_brush(brush: Brush) -> _Item | None:
    polygons = [polygon.vertices for polygon in brush.polygons]
    if not polygons:
        return None
    cuts = brush.operation is BrushOperation.SUBTRACT and brush.solidity is not Solidity.NONSOLID
    sheets = [polygon.vertices for polygon in brush.polygons if not polygon.solid]

    def triangles() -> Array:
        fans = [
            np.stack([np.broadcast_to(p[0], (len(p) - 2, 3)), p[1:-1], p[2:]], axis=1)
            for p in polygons
        ]
        return np.concatenate(fans)

    return _Item(
        brush.name,
        _corners(np.concatenate(polygons)),
        triangles,
        brush=True,
        cuts=cuts,
        sheets=_corners(np.concatenate(sheets)) if sheets else None,
    )


def _without_cut(item: _Item) -> _Item | None:
    """What is seen of something that cuts nothing."""
    return None if item.sheets is None else replace(item, corners=item.sheets)


def _triangles_of_object(thing: SceneObject) -> Array:
    """(n, 3, 3) in the world; of round shapes those of their boxes, which is enough here."""
    found = [np.zeros((0, 3, 3))]
    for part in thing.parts:
        if isinstance(part.shape, Plane):
            continue
        points = points_of(part)
        if isinstance(part.shape, Mesh):
            matrix = part.matrix
            with np.errstate(all="ignore"):
                points = part.shape.vertices @ matrix[:3, :3].T + matrix[:3, 3]
            corners = points[part.shape.triangles]
            found.append(corners[(np.abs(corners) < FARTHEST).all(axis=(1, 2))])
        elif len(points):
            low, high = _corners(points)
            box = (low + high) / 2.0 + CORNERS * (high - low) / 2.0
            quads = np.array(QUADS)
            found += [box[quads[:, [0, 1, 2]]], box[quads[:, [0, 2, 3]]]]
    triangles = np.concatenate(found)
    return np.asarray(triangles @ thing.pose.matrix().T + np.array(thing.pose.position))


def _is_sky(thing: SceneObject) -> bool:
    words = [thing.name.lower()]
    words += [part.shape.name.lower() for part in thing.parts if isinstance(part.shape, Mesh)]
    return any(sky in word for sky in SKY for word in words)


# ---- backdrops ---------------------------------------------------------------------------------


def _is_backdrop(item: _Item, others: Sequence[_Item], scene: Scene) -> bool:
    """Whether something goes around and over all others, and carries no start pose."""
    return _is_around(item, _union([other.corners for other in others])) and not (
        _lies_below_a_start(item, others, scene)
    )


def _is_around(item: _Item, rest: Corners) -> bool:
    """Whether something goes around a box, and over most of it."""
    (low, high), (below, above) = item.corners, rest
    slack = SLACK * (above - below)[:2]
    if (low[:2] > below[:2] + slack).any() or (high[:2] < above[:2] - slack).any():
        return False
    if high[2] <= above[2]:
        return False
    parts = (np.arange(PROBES) + 0.5) / PROBES
    x, y = np.meshgrid(*(below[:2] + parts[:, None] * (above - below)[:2]).T)
    start = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, above[2])])
    return bool(np.isfinite(_distances([item], start, 1.0)).mean() >= 0.5)


def _lies_below_a_start(item: _Item, others: Sequence[_Item], scene: Scene) -> bool:
    """Whether something is the first thing below a start pose, so that robots stand on it."""
    if not scene.starts:
        return False
    places = np.array([start.pose.position for start in scene.starts], dtype=float)
    places += np.array([0.0, 0.0, SUNK])
    own = _distances([item], places, -1.0)
    if not (own < MARGIN).any():
        return False
    nearest = np.minimum(_distances(others, places, -1.0), _planes_below(scene, places))
    return bool(((own < MARGIN) & (own < nearest)).any())


def _distances(items: Sequence[_Item], start: Array, way: float) -> Array:
    """m from places (n, 3) straight up (1) or down (-1) to the first of some things."""
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(item.triangles() for item in items)])
    if not len(triangles):
        return np.full(len(start), np.inf)
    # Relative to a place nearby: rays are of single precision.
    middle = start.mean(axis=0)
    return Rays(triangles - middle).cast(start - middle, (0.0, 0.0, way))[0].astype(float)


def _planes_below(scene: Scene, places: Array) -> Array:
    """m from places (n, 3) down to the first endless plane."""
    nearest = np.full(len(places), np.inf)
    for origin, normal in _planes(scene):
        if normal[2] > 1e-6:
            away = (places - origin) @ normal / normal[2]
            nearest = np.where(away >= 0.0, np.minimum(nearest, away), nearest)
    return nearest


def _planes(scene: Scene) -> Iterator[Corners]:
    """A place on every endless plane, and its normal."""
    for thing in scene.objects:
        for part in thing.parts:
            if isinstance(part.shape, Plane):
                matrix = matrix_of_pose(thing.pose) @ part.matrix
                yield matrix[:3, 3], matrix[:3, 2]


def _corners(points: Array) -> Corners:
    return points.min(axis=0), points.max(axis=0)


def _union(boxes: Sequence[Corners]) -> Corners:
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
