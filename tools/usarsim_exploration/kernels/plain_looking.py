"""A robot looks around and takes in what it sees, by numpy and OpenCV; see `looking`."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.plain import recount
from usarsim_exploration.kernels.steps import FELT, FREE, KNOWN, MARKS, SAFE, WALL

Ints = NDArray[np.int64]
SHORT = 4
"""See `looking.SHORT`."""
Bits = NDArray[np.uint8]
Floats = NDArray[np.float64]
_AROUND = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """What scans tell.

    Attributes:
        cells: (scans, 2) where the scanner was.
        readings: (scans, rays) cells.
        ends: (scans, rays, 2) cells where rays end; the wall's, where one was hit.
        free_ends: (scans, rays, 2) the last free cells.
        near_ends: (scans, rays, 2) the last free ones that are near.
        hits: (scans, rays) whether a wall was hit, well within the range.
        directions: (scans, 2, rays) cosines and sines.
    """

    cells: Ints
    readings: Floats
    ends: Ints
    free_ends: Ints
    near_ends: Ints
    hits: NDArray[np.bool_]
    directions: Floats


def cast(
    clear: NDArray[np.uint8],
    shape: tuple[int, int],
    reach: int,
    fans: NDArray[np.int16],
    offsets: NDArray[np.int32],
    directions: Floats,
    scans: Ints,
    close: int,
    tight: bool,
) -> Scans:
    """The rays of scans; arguments are those of `looking.look`. shape: rows and columns."""
    return _rays(clear, shape, reach, fans, offsets, directions, scans, close, tight)[0]


def _rays(
    clear: NDArray[np.uint8],
    shape: tuple[int, int],
    reach: int,
    fans: NDArray[np.int16],
    offsets: NDArray[np.int32],
    directions: Floats,
    scans: Ints,
    close: int,
    tight: bool,
) -> tuple[Scans, Ints]:
    """Scans, and the index of the last free cell of each of their rays, (scans, rays)."""
    height, width = shape
    stride = width + 2 * reach
    cells = scans[:, :2]
    here = (cells[:, 1] + reach) * stride + cells[:, 0] + reach
    free, corner = _free(clear, here, stride, reach, fans, offsets, scans, tight)
    turns, rays = scans[:, 2, None], np.arange(fans.shape[1])

    def at(steps: Ints) -> Ints:
        return cells[:, None] + fans[turns, rays, steps] * (steps >= 0)[..., None]

    beyond, seen = at(np.minimum(free + 1, reach - 1)), at(free)
    beyond[..., 1] = np.where(corner, seen[..., 1], beyond[..., 1])  # at the wall beside
    inside = ((beyond >= 0) & (beyond < (width, height))).all(axis=-1)
    walls = inside & (free + 1 < reach)
    ends = np.where(walls[..., None], beyond, seen)
    away = np.hypot(*np.moveaxis(ends - cells[:, None], -1, 0))
    far = reach + 1 if tight and reach <= SHORT else reach - 2
    hits, near = walls & (away < far), at(np.minimum(free, close))
    return Scans(cells, away, ends, seen, near, hits, directions[scans[:, 2]]), free


def _passed(
    clear: NDArray[np.uint8],
    shape: tuple[int, int],
    reach: int,
    fans: NDArray[np.int16],
    scans: Ints,
    free: Ints,
    margin: int,
) -> NDArray[np.int32]:
    """Cells within `margin` of walls that rays pass, flat, each once; see `looking.look`.

    Args:
        free: index of the last free cell of each ray, (scans, rays).
    """
    height, width = shape
    stride = width + 2 * reach
    seen = np.zeros(height * width, np.bool_)
    for (column, row, turn), far in zip(scans.tolist(), free, strict=True):
        along = fans[turn][np.arange(reach) <= far[:, None]].astype(np.int64)
        seen[(along[:, 1] + row) * width + along[:, 0] + column] = True
    near = clear.reshape(-1, stride)[reach:, reach:][:height, :width] <= margin
    return np.flatnonzero(seen & near.reshape(-1)).astype(np.int32)


def _free(
    clear: NDArray[np.uint8],
    here: Ints,
    stride: int,
    reach: int,
    fans: NDArray[np.int16],
    offsets: NDArray[np.int32],
    scans: Ints,
    tight: bool,
) -> tuple[Ints, NDArray[np.bool_]]:
    """Index of the last free cell of each ray, (scans, rays), and which end at a corner.

    Args:
        here: (scans,) the scanners' cells in `clear`, flat. stride: cells of a row of that.
    """
    free = np.empty((len(scans), fans.shape[1]), np.int64)
    corner = np.zeros(free.shape, np.bool_)
    for number, turn in enumerate(scans[:, 2].tolist()):
        wall = clear[offsets[turn] + here[number]] == 0
        blocked = wall | _squeezed(clear, here[number], stride, fans[turn]) if tight else wall
        first = blocked.argmax(axis=1)
        free[number] = np.where(blocked.any(axis=1), first, reach) - 1
        corner[number] = blocked.any(axis=1) & ~wall[np.arange(len(wall)), first]
    return free, corner


def _squeezed(
    clear: NDArray[np.uint8], here: np.int64, stride: int, fan: NDArray[np.int16]
) -> NDArray[np.bool_]:
    """(rays, range) whether both cells beside a diagonal move of a ray are blocked."""
    after = fan.astype(np.int64)
    before = np.concatenate([np.zeros_like(after[:, :1]), after[:, :-1]], axis=1)
    beside = here + before[..., 1] * stride + after[..., 0]
    over = here + after[..., 1] * stride + before[..., 0]
    found: NDArray[np.bool_] = (clear[beside] == 0) & (clear[over] == 0)
    return found


def look(
    bits: Bits,
    clear: NDArray[np.uint8],
    reach: int,
    fans: NDArray[np.int16],
    offsets: NDArray[np.int32],
    directions: Floats,
    scans: Ints,
    close: int,
    tight: bool,
    margin: int,
    driven: bool,
) -> tuple[NDArray[np.int32], NDArray[np.int32], Ints]:
    """See `looking.look`."""
    shape = bits.shape[0], bits.shape[1]
    one, free = _rays(clear, shape, reach, fans, offsets, directions, scans, close, tight)
    by = np.empty(0, np.int32)
    if tight:
        by = _passed(clear, shape, reach, fans, scans, free, margin)
    return take_in(
        bits, one.cells, one.ends, one.free_ends, one.near_ends, one.hits, one.directions, driven,
        by,
    )  # fmt: skip


def take_in(
    bits: Bits,
    cells: Ints,
    ends: Ints,
    free_ends: Ints,
    near_ends: Ints,
    hits: NDArray[np.bool_],
    directions: Floats,
    driven: bool,
    passed: NDArray[np.int32],
) -> tuple[NDArray[np.int32], NDArray[np.int32], Ints]:
    """See `looking.take_in`."""
    rows, columns = bits.shape
    corners = np.concatenate([ends.reshape(-1, 2) - 3, cells])
    left, top = np.maximum(corners.min(axis=0), 0)
    corners = np.concatenate([ends.reshape(-1, 2), cells])
    right, bottom = np.minimum(corners.max(axis=0) + 4, (columns, rows))
    corner = np.array([left, top])
    part = bits[top:bottom, left:right]
    before = part.copy()
    seen, near = np.zeros_like(part), np.zeros_like(part)
    for cell, far, short in zip(cells, free_ends, near_ends, strict=True):
        fill(seen, cell - corner, far - corner)
        fill(near, cell - corner, short - corner)
    _mark_walls(part, ends, hits, directions, corner)
    flat = bits.reshape(-1)
    wrong = passed[flat[passed] & (WALL | FELT) == WALL]  # what was felt is newer
    flat[wrong] = flat[wrong] & MARKS | FREE | SAFE
    part |= (part & KNOWN == 0).view(np.uint8) & seen  # 1 is FREE
    _make_safe(bits, near, corner)
    if driven:
        column, row = cells.T
        bits[row, column] = bits[row, column] & MARKS | FREE | SAFE
    changed = np.flatnonzero(part != before)
    old, new = before.reshape(-1)[changed], part.reshape(-1)[changed]
    high, wide = np.divmod(changed, right - left)
    found = ((high + top) * columns + wide + left).astype(np.int32)
    return found, found[old & KNOWN == 0], recount(old, new)


def count_first(
    team: Bits, walls: NDArray[np.uint8], bits: Bits, found: NDArray[np.int32]
) -> tuple[int, int]:
    """See `looking.count_first`."""
    old = team[found]
    fresh = found[(bits[found] & FREE != 0) & (old & FREE == 0)]
    team[found] |= SAFE | WALL
    team[fresh] |= FREE
    return int(np.count_nonzero(old == 0)), int(np.count_nonzero(walls[fresh] == 0))


def fill(mask: NDArray[np.uint8], cell: Ints, ends: Ints) -> None:
    """Fill the polygon of a scanner's cell and the ends of its rays."""
    corners = np.concatenate([cell[None], ends]).astype(np.int32)
    cv2.fillPoly(mask, [corners], 1)


def _mark_walls(
    part: Bits, ends: Ints, hits: NDArray[np.bool_], directions: Floats, corner: Ints
) -> None:
    """Write into part of a map what walls scans have seen; certain cells stay as they are."""
    found = []
    for one, hit, (cosines, sines) in zip(ends, hits, directions, strict=True):
        found.append(_walls_behind(one, hit, cosines, sines))
    height, width = part.shape
    behind = np.concatenate(found) - corner
    behind = behind[(behind >= 0).all(axis=1) & (behind < (width, height)).all(axis=1)]
    for cells, what in ((behind, WALL), (ends[hits] - corner, WALL | SAFE)):
        column, row = cells.T
        old = part[row, column]
        part[row, column] = np.where(old & SAFE, old, old & MARKS | what)


def _walls_behind(
    ends: Ints, hit: NDArray[np.bool_], cosines: NDArray[np.float64], sines: NDArray[np.float64]
) -> Ints:
    """The cells that `looking.mark_walls_behind` marks, some of them twice."""
    near = hit[:-1] & hit[1:]
    step = ends[1:] - ends[:-1]
    near &= (step * step).sum(axis=1) < 25
    which = np.flatnonzero(near)
    if not len(which):
        return np.empty((0, 2), np.int64)
    begin, step = ends[which], step[which]
    cosine, sine = cosines[which], sines[which]
    parts = np.maximum(np.abs(step).max(axis=1), 1)
    found = []
    for part in range(5):
        share = part / parts
        column = np.floor(begin[:, 0] + step[:, 0] * share + 0.5)
        row = np.floor(begin[:, 1] + step[:, 1] * share + 0.5)
        for outward in range(3):
            cells = np.stack(
                [np.floor(column + outward * cosine + 0.5), np.floor(row + outward * sine + 0.5)],
                axis=1,
            )
            found.append(cells[part <= parts])
    return np.concatenate(found).astype(np.int64)


def _make_safe(bits: Bits, near: NDArray[np.uint8], corner: Ints) -> None:
    """What is very near, and around which all is known, is certainly free.

    Points of walls that were measured stay; what was only supposed to be behind them goes.
    """
    left, top, width, height = cv2.boundingRect(near)
    inner = near[top : top + height, left : left + width]
    column, row = int(corner[0]) + left, int(corner[1]) + top
    above, before = max(row - 1, 0), max(column - 1, 0)
    around = bits[above : row + height + 1, before : column + width + 1]
    whole = cv2.erode((around & KNOWN != 0).view(np.uint8), _AROUND)
    whole = whole[row - above :, column - before :][:height, :width]
    part = bits[row : row + height, column : column + width]
    safe = (inner != 0) & (whole != 0) & (part & (WALL | SAFE) != WALL | SAFE)
    part[safe] = part[safe] & MARKS | FREE | SAFE
