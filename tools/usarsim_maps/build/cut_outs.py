"""Holes that the opacity of a picture makes in a surface (fences, gratings, leaves).

MuJoCo's materials have one opacity, and rays meet whole triangles. So the triangles that are seen
are cut along the picture's opaque cells. What is felt stays closed: pieces for every wire would be
thousands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from PIL import Image

from usarsim_maps.build.looks import Look
from usarsim_maps.findings import Findings
from usarsim_maps.geometry import LEAST_AREA, normals_areas
from usarsim_maps.scene import Array, Color, Integers, Mask, Opacity

GRIDS = (64, 32, 16, 8)
"""Cells along the longer side of a picture that are tried in turn."""

MOST_BOXES = 400
"""Rectangles of opaque cells that a picture may have."""

MOST_PIECES = 20_000
"""Pieces that the triangles of one material of a mesh may be cut into; 1 s."""

MOST_IN_ALL = 100_000
"""Pieces of a whole world."""

UNLIKE = 0.25
"""The cells may have so much more or less of what is opaque, or of the holes, than the picture."""

ALIKE = 0.9
"""Of a picture's pixels that cells show as they are."""

HALF_CLEAR = 0.3
"""Of a picture's pixels: where so many are partly clear, it is glass and has no holes."""

ENDLESS = 1e6
"""Texture coordinate that stands for the outside of a picture that does not repeat."""


@dataclass(frozen=True, slots=True, eq=False)
class Stencil:
    """Where a picture is opaque."""

    opaque: Mask  # (rows, columns), the first row at v = 0
    boxes: Array  # (b, 4) least and greatest u, then v, of rectangles that cover it
    repeat: bool  # outside of 0 to 1 it is there again, else its edges go on


def opacities(picture: Image.Image, opacity: Opacity) -> Array | None:
    """Opacity (rows, columns), 0 to 1, of each pixel; None: the picture has none."""
    own = opacity.picture is None
    clear = "A" in picture.getbands() or "transparency" in picture.info
    if clear and not opacity.bright:
        channel = picture.convert("RGBA").getchannel("A")
    elif own and not opacity.bright:
        return None
    else:
        channel = picture.convert("L")
    values = np.asarray(channel, dtype=float) / 255.0
    return 1.0 - values if opacity.inverse else values


def glass(values: Array) -> float | None:
    """The mean opacity of a picture that is partly clear in most places; None for others."""
    partly = (values > 0.1) & (values < 0.9)
    return float(values.mean()) if partly.mean() > HALF_CLEAR else None


def stencil_of(there: Mask, repeat: bool) -> Stencil | None:
    """A stencil of pixels (rows, columns) that are opaque, the first row on top.

    None if the holes are too fine for the cells of a grid.
    """
    rows, columns = there.shape
    picture = Image.fromarray(there.astype(np.uint8) * 255)
    share = float(there.mean())
    for cells in GRIDS:
        scale = min(1.0, cells / max(rows, columns))
        size = max(1, round(columns * scale)), max(1, round(rows * scale))
        small = np.asarray(picture.resize(size, Image.Resampling.BOX)) >= 128
        large = np.asarray(Image.fromarray(small).resize((columns, rows), Image.Resampling.NEAREST))
        off = abs(float(large.mean()) - share)
        if off > UNLIKE * min(share, 1.0 - share) or float((large == there).mean()) < ALIKE:
            continue
        opaque = small[::-1]
        boxes = _boxes(opaque)
        if len(boxes) <= MOST_BOXES:
            if not repeat:
                boxes = np.where(boxes <= 0.0, -ENDLESS, np.where(boxes >= 1.0, ENDLESS, boxes))
            return Stencil(opaque, boxes, repeat)
    return None


def _boxes(opaque: Mask) -> Array:
    """Rectangles (b, 4) that cover the opaque cells: runs of rows that equal those below."""
    rows, columns = opaque.shape
    found: list[tuple[float, float, float, float]] = []
    open_runs: dict[tuple[int, int], int] = {}
    for row in range(rows + 1):
        line = opaque[row] if row < rows else np.zeros(columns, dtype=bool)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(np.int8)))
        runs = {(int(a), int(b)) for a, b in edges.reshape(-1, 2)}
        for (a, b), first in list(open_runs.items()):
            if (a, b) not in runs:
                found.append((a / columns, b / columns, first / rows, row / rows))
                del open_runs[a, b]
        for run in sorted(runs):
            open_runs.setdefault(run, row)
    return np.array(found).reshape(-1, 4)


@dataclass(frozen=True, slots=True)
class Finish:
    """A material as it goes into the scene."""

    name: str  # unique and safe
    color: Color  # multiplies the picture
    picture: str | None  # file name below `textures/`, None without one
    stencil: Stencil | None = None  # where the surface has holes


@dataclass(slots=True)
class CutOuts:
    """Cuts what is seen of one world."""

    finishes: Mapping[str, Finish]  # materials by the map's names
    findings: Findings
    _cut: int = 0
    _told: set[tuple[str, str]] = field(default_factory=set)

    def has_holes(self, material: str) -> bool:
        """Whether a material's picture has holes that can be cut."""
        return self.finishes[material].stencil is not None

    def cut(self, look: Look, material: str) -> Look:
        """Triangles with the holes of the picture of their material, which need not be the look's.

        Where they would be too many pieces the triangles stay whole. Either is told once.
        """
        stencil = self.finishes[material].stencil
        if stencil is None or look.uvs is None:
            return look
        found = _cut(look.corners, look.uvs, stencil)
        if found is None or self._cut + len(found[0]) > MOST_IN_ALL:
            text = "the holes of its picture are too many to be cut: cameras and lasers see no hole"
        elif not len(found[0]):
            text = "nothing of it is opaque in its picture: it was left whole"
        else:
            self._cut += len(found[0])
            look = replace(look, corners=found[0], uvs=found[1])
            text = "cameras and lasers see through the holes of its picture; robots feel it closed"
        self._tell(material, text)
        return look

    def _tell(self, material: str, text: str) -> None:
        if (material, text) not in self._told:
            self._told.add((material, text))
            self.findings.warn(material, text)


def _cut(corners: Array, uvs: Array, stencil: Stencil) -> tuple[Array, Array] | None:
    """What is opaque of triangles (m, 3, 3) and their coordinates (m, 3, 2); None: too much."""
    base = np.floor(uvs.min(axis=1)) if stencil.repeat else np.zeros((len(uvs), 2))
    local = uvs - base[:, None]
    low, high = local.min(axis=1), local.max(axis=1)
    tiles = np.ceil(high).clip(1.0) if stencil.repeat else np.ones((len(uvs), 2))
    count = tiles.prod(axis=1)
    if count.sum() > MOST_PIECES + len(uvs):
        return None
    owner = np.repeat(np.arange(len(uvs)), count.astype(np.int64))
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count.astype(np.int64))
    shift = np.column_stack([place % tiles[owner, 0], place // tiles[owner, 0]])
    # Cells that the rectangle around each triangle touches, in each copy of the picture.
    inside = _opaque_cells(stencil, low[owner] - shift, high[owner] - shift)
    edges = local[:, 1:] - local[:, :1]
    flat = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]) < 1e-12
    single = count[owner] == 1
    whole = single & ((inside == 1.0) | (flat[owner] & (inside > 0.5)))
    mixed = np.flatnonzero((inside > 0.0) & ~whole & ~flat[owner])
    kept = [(corners[owner[whole]], uvs[owner[whole]])]
    pairs = _pairs(low[owner[mixed]] - shift[mixed], high[owner[mixed]] - shift[mixed], stencil)
    if pairs is None:
        return None
    for number, box in zip(mixed[pairs[0]].tolist(), pairs[1].tolist(), strict=True):
        triangle = owner[number]
        weights = _clipped(local[triangle] - shift[number], stencil.boxes[box])
        if len(weights) >= 3:
            fan = [(0, k, k + 1) for k in range(1, len(weights) - 1)]
            kept.append(((weights @ corners[triangle])[fan], (weights @ uvs[triangle])[fan]))
    pieces, places = np.concatenate([c for c, _ in kept]), np.concatenate([t for _, t in kept])
    _, areas = normals_areas(pieces.reshape(-1, 3), np.arange(3 * len(pieces)).reshape(-1, 3))
    return pieces[areas > LEAST_AREA], places[areas > LEAST_AREA]


def _opaque_cells(stencil: Stencil, low: Array, high: Array) -> Array:
    """Share of opaque cells, 0 to 1, in rectangles (n, 2) each of texture coordinates."""
    rows, columns = stencil.opaque.shape
    size = np.array([columns, rows])
    first = np.floor(low * size + 1e-9).clip(0, size - 1).astype(np.int64)
    last = np.ceil(high * size - 1e-9).clip(first + 1, size).astype(np.int64)
    sums = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    sums[1:, 1:] = stencil.opaque.cumsum(axis=0).cumsum(axis=1)
    (a, b), (c, d) = first.T, last.T
    found = sums[d, c] - sums[b, c] - sums[d, a] + sums[b, a]
    return np.asarray(found / ((c - a) * (d - b)))


def _pairs(low: Array, high: Array, stencil: Stencil) -> tuple[Integers, Integers] | None:
    """Numbers of rectangles (n, 2) and of boxes that they overlap; None if these are too many."""
    first, second, total = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0
    u0, u1, v0, v1 = stencil.boxes.T
    for start in range(0, len(low), 4096):
        a, b = low[start : start + 4096, :, None], high[start : start + 4096, :, None]
        over = (a[:, 0] < u1) & (b[:, 0] > u0) & (a[:, 1] < v1) & (b[:, 1] > v0)
        rows, boxes = np.nonzero(over)
        total += len(rows)
        if total > MOST_PIECES:
            return None
        first.append(rows + start)
        second.append(boxes)
    return np.concatenate(first), np.concatenate(second)


def _clipped(uvs: Array, box: Array) -> Array:
    """Weights (k, 3) of a triangle's corners, (3, 2), at the corners of its part in a box."""
    points = [(u, v, *weights) for (u, v), weights in zip(uvs.tolist(), np.eye(3), strict=True)]
    for axis, limit, sign in (
        (0, box[0], 1.0), (0, box[1], -1.0), (1, box[2], 1.0), (1, box[3], -1.0),
    ):  # fmt: skip
        kept = []
        for number, here in enumerate(points):
            before = points[number - 1]
            one, other = sign * (before[axis] - limit), sign * (here[axis] - limit)
            if (one < 0.0) != (other < 0.0):
                part = one / (one - other)
                kept.append(tuple(x + part * (y - x) for x, y in zip(before, here, strict=True)))
            if other >= 0.0:
                kept.append(here)
        points = kept
    return np.array([point[2:] for point in points]).reshape(-1, 3)
