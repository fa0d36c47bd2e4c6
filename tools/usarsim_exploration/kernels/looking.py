"""A robot looks around and takes in what it sees: compiled by numba, all in one call.

`plain_looking` says the same by numpy and OpenCV; a test compares them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.compiled import Ints, compiled
from usarsim_exploration.kernels.steps import AT_BASE, FELT, FREE, KNOWN, MARKS, RELAYED, SAFE, WALL

Bits = NDArray[np.uint8]
Floats = NDArray[np.float64]
SHORT = 4
"""Cells of range up to which a wall is seen however near to its end it is."""
_ONE = 16
"""Columns of edges of polygons are counted in 2^-16 cells."""


@compiled
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
    """Take what scans from several cells tell into a map (exploration reference 6.3).

    Args:
        bits: (rows, columns) the map; changed.
        clear: flat, the world with a margin as wide as the range: cells to the nearest blocked
            one, the longer side counts; 0: blocked. Beyond the edge all is blocked.
        reach: range, cells.
        fans: (headings, rays, range, 2) column and row of cell m of a ray from the scanner's.
        offsets: (headings, rays, range) the same in `clear`.
        directions: (headings, 2, rays) cosines and sines.
        scans: (n, 3) column, row and number of the heading of each.
        close: index of the last cell of a ray that is near.
        tight: rays end between two blocked cells that touch at a corner, and what they pass is no
            wall. margin: cells from blocked ones within which maps may take it for one.
        driven: the cells of the scans were driven over.

    Returns:
        Cells that changed, flat and sorted; those of them that were unknown; and how many more
        are free, at base, relayed.
    """
    count = fans.shape[1]
    ends = np.empty((len(scans), count, 2), np.int64)
    free_ends, near_ends = np.empty_like(ends), np.empty_like(ends)
    hits = np.empty((len(scans), count), np.bool_)
    lengths = np.empty((len(scans), count), np.int64)
    for scan in range(len(scans)):
        column, row, turn = scans[scan]
        cast(clear, bits.shape, reach, column, row, fans[turn], offsets[turn], close, tight,
             ends[scan], free_ends[scan], near_ends[scan], hits[scan], lengths[scan])  # fmt: skip
    turned = directions[scans[:, 2]]
    passed = np.empty(lengths.sum() if tight else 0, np.int32)
    if tight:
        total = 0
        for scan in range(len(scans)):
            column, row, turn = scans[scan]
            total = pass_by(clear, bits.shape, reach, column, row, fans[turn], offsets[turn],
                            lengths[scan], margin, passed, total)  # fmt: skip
        passed = passed[:total]
    return take_in(bits, scans[:, :2], ends, free_ends, near_ends, hits, turned, driven, passed)


@compiled
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
    """Take scans into a map; `look` says more.

    Args:
        cells: (scans, 2) where the scanner was.
        ends, free_ends, near_ends: (scans, rays, 2) where rays end, the last free cells, and the
            last free ones that are near.
        hits: (scans, rays) whether at a wall. directions: (scans, 2, rays).
        passed: cells near walls that rays passed, flat; maybe more than once.
    """
    height, width = bits.shape
    left = max(min(cells[:, 0].min(), ends[:, :, 0].min() - 3), 0)
    top = max(min(cells[:, 1].min(), ends[:, :, 1].min() - 3), 0)
    right = min(max(cells[:, 0].max(), ends[:, :, 0].max()) + 4, width)
    bottom = min(max(cells[:, 1].max(), ends[:, :, 1].max()) + 4, height)
    part = bits[top:bottom, left:right]
    before = part.copy()
    for scan in range(len(cells)):
        mark_walls_behind(part, ends[scan], hits[scan], directions[scan], left, top)
    for scan in range(len(cells)):
        for ray in range(ends.shape[1]):
            column, row = ends[scan, ray, 0] - left, ends[scan, ray, 1] - top
            if hits[scan, ray] and not part[row, column] & SAFE:
                part[row, column] = part[row, column] & MARKS | WALL | SAFE
    flat = bits.ravel()
    for cell in passed:
        if flat[cell] & (WALL | FELT) == WALL:  # what was felt is newer
            flat[cell] = flat[cell] & MARKS | FREE | SAFE
    mask = np.zeros(part.shape, np.uint8)
    for scan in range(len(cells)):
        fill(mask, cells[scan], free_ends[scan], left, top)
    for row in range(bottom - top):
        for column in range(right - left):
            unknown = np.uint8(part[row, column] & KNOWN == 0)  # no branch: many cells at once
            part[row, column] |= mask[row, column] & unknown
    mask[:] = 0
    for scan in range(len(cells)):
        fill(mask, cells[scan], near_ends[scan], left, top)
    columns, rows = near_ends[:, :, 0], near_ends[:, :, 1]
    left_, right_ = min(columns.min(), cells[:, 0].min()), max(columns.max(), cells[:, 0].max())
    top_, bottom_ = min(rows.min(), cells[:, 1].min()), max(rows.max(), cells[:, 1].max())
    for row in range(top_, bottom_ + 1):
        for column in range(left_, right_ + 1):
            old, inside = bits[row, column], mask[row - top, column - left]
            supposed = old & (WALL | SAFE) != WALL | SAFE  # no point of a wall that was measured
            new = old & ~MARKS != FREE | SAFE
            if inside and supposed and new and surrounded(bits, row, column):
                bits[row, column] = old & MARKS | FREE | SAFE
    if driven:
        for scan in range(len(cells)):
            column, row = cells[scan, 0], cells[scan, 1]
            bits[row, column] = bits[row, column] & MARKS | FREE | SAFE
    return changes(bits, before, left, top)


@compiled
def cast(
    clear: NDArray[np.uint8],
    shape: tuple[int, int],
    reach: int,
    column: int,
    row: int,
    fan: NDArray[np.int16],
    offsets: NDArray[np.int32],
    close: int,
    tight: bool,
    ends: Ints,
    free_ends: Ints,
    near_ends: Ints,
    hits: NDArray[np.bool_],
    lengths: Ints,
) -> None:
    """The rays of one scan, in leaps over what is known to hold no wall.

    Args:
        clear, reach, close, tight: as `look` has them. shape: rows and columns of the world.
        column, row: of the scanner. fan, offsets: of its heading.
        ends, free_ends, near_ends: (rays, 2) get what `take_in` takes.
        hits: gets whether at a wall, well within the range. lengths: gets how many cells are free.
    """
    height, width = shape
    stride, far = width + 2 * reach, max(reach - 2, 0)
    if tight and reach <= SHORT:
        far = reach + 1
    here = (row + reach) * stride + column + reach
    for ray in range(len(fan)):
        index, corner = 0, False
        while index < reach:
            room = clear[here + offsets[ray, index]]
            if room == 0:
                break
            if tight and squeezes(clear, here, stride, fan[ray], index):
                corner = True
                break
            index += room
        index = min(index, reach)
        lengths[ray] = index
        right = down = 0
        if index > 0:
            right, down = int(fan[ray, index - 1, 0]), int(fan[ray, index - 1, 1])
        free_ends[ray, 0], free_ends[ray, 1] = column + right, row + down
        if index - 1 > close:
            right, down = int(fan[ray, close, 0]), int(fan[ray, close, 1])
        near_ends[ray, 0], near_ends[ray, 1] = column + right, row + down
        hits[ray] = False
        ends[ray, 0], ends[ray, 1] = free_ends[ray, 0], free_ends[ray, 1]
        if index < reach:
            right, down = int(fan[ray, index, 0]), int(fan[ray, index, 1])
            if corner:  # at the wall beside
                down = int(fan[ray, index - 1, 1]) if index > 0 else 0
            if 0 <= column + right < width and 0 <= row + down < height:
                ends[ray, 0], ends[ray, 1] = column + right, row + down
                hits[ray] = right * right + down * down < far * far


@compiled
def pass_by(
    clear: NDArray[np.uint8],
    shape: tuple[int, int],
    reach: int,
    column: int,
    row: int,
    fan: NDArray[np.int16],
    offsets: NDArray[np.int32],
    lengths: Ints,
    margin: int,
    passed: NDArray[np.int32],
    total: int,
) -> int:
    """Note the cells that the rays of one scan pass within `margin` of walls; see `cast`.

    Args:
        passed: of the map, flat; changed from `total` on. total: how many there are.

    Returns:
        How many there are then.
    """
    width = shape[1]
    here = (row + reach) * (width + 2 * reach) + column + reach
    for ray in range(len(fan)):
        index = 0
        while index < lengths[ray]:
            room = clear[here + offsets[ray, index]]
            last = min(index + room, lengths[ray])
            for at in range(max(index, index + room - margin), last):
                if clear[here + offsets[ray, at]] <= margin:
                    passed[total] = (row + fan[ray, at, 1]) * width + column + fan[ray, at, 0]
                    total += 1
            index = last
    return total


@compiled
def squeezes(
    clear: NDArray[np.uint8], here: int, stride: int, ray: NDArray[np.int16], index: int
) -> bool:
    """Whether a ray comes to a free cell between two blocked ones that touch at a corner.

    Args:
        clear: see `look`; stride: cells of a row of it. here: the scanner's cell in it, flat.
        ray: (range, 2) column and row of each cell from the scanner's. index: of the free cell.
    """
    right, down = int(ray[index, 0]), int(ray[index, 1])
    before = below = 0
    if index > 0:
        before, below = int(ray[index - 1, 0]), int(ray[index - 1, 1])
    beside, over = here + below * stride + right, here + down * stride + before
    return bool(clear[beside] == 0 and clear[over] == 0)


@compiled
def mark_walls_behind(
    part: Bits, ends: Ints, hits: NDArray[np.bool_], directions: Floats, left: int, top: int,
) -> None:  # fmt: skip
    """Write the wall that a scan has seen, where nothing is certain: between ends of rays.

    Only between ends of neighbouring rays that are nearer than 5 cells to each other, and two
    cells behind them (exploration reference 6.3).

    Args:
        part: of a map, changed. left, top: its corner.
        ends: (rays, 2) cells where rays end. hits: whether at a wall.
        directions: (2, rays) their cosines and sines.
    """
    height, width = part.shape
    for ray in range(len(ends) - 1):
        if not (hits[ray] and hits[ray + 1]):
            continue
        right, down = ends[ray + 1, 0] - ends[ray, 0], ends[ray + 1, 1] - ends[ray, 1]
        if right * right + down * down >= 25:
            continue
        parts = max(abs(right), abs(down), 1)
        for number in range(parts + 1 if right or down else 1):
            column, row = ends[ray + number // parts, 0], ends[ray + number // parts, 1]
            if 0 < number < parts:
                share = number / parts
                column = math.floor(ends[ray, 0] + right * share + 0.5)
                row = math.floor(ends[ray, 1] + down * share + 0.5)
            for outward in range(3):
                c, r = column - left, row - top
                if outward > 0:
                    c = math.floor(column + outward * directions[0, ray] + 0.5) - left
                    r = math.floor(row + outward * directions[1, ray] + 0.5) - top
                if 0 <= c < width and 0 <= r < height and not part[r, c] & SAFE:
                    part[r, c] = part[r, c] & MARKS | WALL


@compiled
def surrounded(bits: Bits, row: int, column: int) -> bool:
    """Whether all is known about a cell; beyond the edge there is nothing to know."""
    height, width = bits.shape
    for r in range(max(row - 1, 0), min(row + 2, height)):
        for c in range(max(column - 1, 0), min(column + 2, width)):
            if not bits[r, c] & KNOWN:
                return False
    return True


@compiled
def changes(
    bits: Bits, before: Bits, left: int, top: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], Ints]:
    """What `look` returns, of a map and what part of it was before. left, top: corner of that."""
    height, width = before.shape
    changed, found = np.empty(before.size, np.int32), np.empty(before.size, np.int32)
    more = np.zeros(3, np.int64)
    total = news = 0
    for row in range(height):
        first = (top + row) * bits.shape[1] + left
        after, then = bits[top + row, left : left + width], before[row]
        for column in range(width):
            if after[column] == then[column]:
                continue
            changed[total] = first + column
            total += 1
            if not then[column] & KNOWN:
                found[news] = first + column
                news += 1
            count_cell(more, then[column], after[column])
    return changed[:total].copy(), found[:news].copy(), more


@compiled
def count_first(
    team: Bits, walls: NDArray[np.uint8], bits: Bits, found: NDArray[np.int32]
) -> tuple[int, int]:
    """What a robot found that nobody of the team knew; the team knows it now.

    Args:
        team: flat, what anybody knows; changed. walls: of the world, flat. bits: of the robot's
            map, flat. found: flat cells that were unknown to it.

    Returns:
        How many cells nobody knew; and how many, truly free, nobody knew to be free.
    """
    first = free = 0
    for cell in found:
        first += not team[cell]
        if bits[cell] & FREE and not team[cell] & FREE:
            team[cell] |= FREE
            free += not walls[cell]
        team[cell] |= SAFE | WALL
    return first, free


@compiled
def count_cell(more: Ints, old: int, new: int) -> None:
    """Add to numbers of free cells, those at base and relayed ones what one cell changes."""
    for value, sign in ((new, 1), (old, -1)):
        if value & FREE:
            more[0] += sign
            if value & AT_BASE:
                more[1] += sign
            elif value & RELAYED:
                more[2] += sign


@compiled
def fill(mask: NDArray[np.uint8], cell: Ints, ends: Ints, left: int, top: int) -> None:
    """Set the cells of a polygon to 1: its outline, and what is inside by even and odd.

    The same cells as `cv2.fillPoly` sets, so that maps do not depend on which form is used.

    Args:
        mask: (rows, columns). left, top: its corner.
        cell, ends: (2,) and (n, 2) corners of the polygon, inside the mask.
    """
    corners = np.empty((len(ends) + 2, 2), np.int64)  # back to the first
    corners[1:-1] = ends
    corners[0] = corners[-1] = cell
    corners[:, 0] -= left
    corners[:, 1] -= top
    first = np.zeros(mask.shape[0] + 1, np.int64)  # of the crossings of each row
    mask[corners[0, 1], corners[0, 0]] = 1
    count = 1  # of corners that differ from the one before: most rays end beside each other
    for index in range(1, len(corners)):
        x, y, x1, y1 = (
            corners[count - 1, 0],
            corners[count - 1, 1],
            corners[index, 0],
            corners[index, 1],
        )
        if x == x1 and y == y1:
            continue
        corners[count, 0], corners[count, 1] = x1, y1
        count += 1
        draw_line(mask, x, y, x1, y1)
        for row in range(min(y, y1), max(y, y1)):
            first[row + 1] += 1
    first = np.cumsum(first)
    crossings, held = np.empty(first[-1], np.int64), first.copy()
    for index in range(count - 1):
        x, y, x1, y1 = edge(corners, index)
        if y > y1:
            x, y, x1, y1 = x1, y1, x, y
        if y == y1:
            continue
        slope = (abs(x1 - x) << _ONE) // (y1 - y)
        if x1 < x:
            slope = -slope
        for row in range(y, y1):
            here = (x << _ONE) + (row - y) * slope
            at = held[row]
            while at > first[row] and crossings[at - 1] > here:  # sorted as they come
                crossings[at] = crossings[at - 1]
                at -= 1
            crossings[at] = here
            held[row] += 1
    for row in range(mask.shape[0]):
        for at in range(first[row], first[row + 1] - 1, 2):
            inside = (crossings[at] + (1 << _ONE) - 1) >> _ONE  # the first whole column
            mask[row, inside : (crossings[at + 1] >> _ONE) + 1] = 1


@compiled
def edge(corners: Ints, index: int) -> tuple[int, int, int, int]:
    """From one corner to the next: column and row, column and row."""
    one, other = corners[index], corners[index + 1]
    return one[0], one[1], other[0], other[1]


@compiled
def draw_line(mask: NDArray[np.uint8], x: int, y: int, x1: int, y1: int) -> None:
    """Set the cells of a line to 1, as Bresenham does, from the left to the right."""
    if x1 < x:
        x, y, x1, y1 = x1, y1, x, y
    right, down = x1 - x, abs(y1 - y)
    turn = 1 if y1 > y else -1
    if down > right:
        error = down - 2 * right
        for _ in range(down + 1):
            mask[y, x] = 1
            y += turn
            if error < 0:
                x += 1
                error += 2 * down
            error -= 2 * right
    else:
        error = right - 2 * down
        for _ in range(right + 1):
            mask[y, x] = 1
            x += 1
            if error < 0:
                y += turn
                error += 2 * right
            error -= 2 * down
