"""Buildings: office, school, hospital, flats, blocks with corridors around, campus, warehouse."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from usarsim_exploration.worlds.generators.shape import CORRIDOR, WALL, Drawing, Shape
from usarsim_exploration.worlds.generators.tiling import Rectangle, Tiling


def office(shape: Shape, random: np.random.Generator) -> Drawing:
    """Corridors with rooms on both sides, joined by one that crosses them all."""
    plan = Tiling(shape, random)
    base = _offices(plan, plan.whole)
    return plan.finish(base)


def _offices(plan: Tiling, part: Rectangle) -> tuple[int, int]:
    """Fill a part of a plan; returns a cell at one end of a corridor."""
    bands = max(1, round(part.height / (2 * plan.shape.rooms + CORRIDOR + 2 * WALL)))
    height = part.height // bands
    spine = part.left + int(part.width * (0.35 + 0.3 * plan.random.random()))
    halls = []
    for band in range(bands):
        top = part.top + band * height + (height - CORRIDOR) // 2
        halls.append(Rectangle(part.left, top, part.right, top + CORRIDOR))
    for band, hall in enumerate(halls):
        low = part.top if band == 0 else (halls[band - 1].bottom + hall.top) // 2 + WALL // 2
        high = (
            part.bottom
            if band == bands - 1
            else (hall.bottom + halls[band + 1].top) // 2 - WALL // 2
        )
        for left, right in ((part.left, spine - WALL), (spine + CORRIDOR + WALL, part.right)):
            for top, bottom in ((low, hall.top - WALL), (hall.bottom + WALL, high)):
                _row(plan, Rectangle(left, top, right, bottom))
    halls.append(Rectangle(spine, part.top, spine + CORRIDOR, part.bottom))
    plan.paint(*halls, hall=True)
    return halls[0].left + CORRIDOR, halls[0].middle[1]


def _row(plan: Tiling, part: Rectangle) -> None:
    """Rooms side by side."""
    if min(part.width, part.height) < plan.shape.doors + 2:
        return
    count = max(1, round(part.width / plan.shape.rooms))
    edges = part.left + np.arange(count + 1) * (part.width + WALL) // count
    jitter = plan.random.integers(-plan.shape.rooms // 8, plan.shape.rooms // 8 + 1, count + 1)
    jitter[[0, -1]] = 0
    edges = edges + jitter
    for left, right in pairwise(edges.tolist()):
        plan.paint(Rectangle(left, part.top, right - WALL, part.bottom))


def school(shape: Shape, random: np.random.Generator) -> Drawing:
    """One long corridor, and wings with classrooms and yards between that nobody can enter."""
    plan = Tiling(shape, random)
    whole = plan.whole
    bottom = whole.bottom - shape.rooms - WALL
    spine = Rectangle(whole.left, bottom - CORRIDOR, whole.right, bottom)
    wing = 2 * shape.rooms + 2 * WALL + CORRIDOR
    count = max(1, (whole.width + shape.rooms) // (wing + shape.rooms))
    gap = (whole.width - count * wing) // max(count - 1, 1)
    halls = [spine]
    _row(plan, Rectangle(whole.left, bottom + WALL, whole.right, whole.bottom))
    for number in range(count):
        left = whole.left + number * (wing + gap)
        hall = left + shape.rooms + WALL
        halls.append(Rectangle(hall, whole.top, hall + CORRIDOR, spine.bottom))
        for side in (left, hall + CORRIDOR + WALL):
            column = Rectangle(side, whole.top, side + shape.rooms, spine.top - WALL)
            _column(plan, column)
    plan.paint(*halls, hall=True)
    return plan.finish((spine.left + CORRIDOR, spine.middle[1]))


def _column(plan: Tiling, part: Rectangle) -> None:
    """Rooms one below another."""
    count = max(1, round(part.height / (1.3 * plan.shape.rooms)))
    edges = (part.top + np.arange(count + 1) * (part.height + WALL) // count).tolist()
    for top, bottom in pairwise(edges):
        plan.paint(Rectangle(part.left, top, part.right, bottom - WALL))


def hospital(shape: Shape, random: np.random.Generator) -> Drawing:
    """Two wings, each a corridor around a core with rooms outside; one passage joins them."""
    plan = Tiling(shape, random)
    whole = plan.whole
    width = int(0.4 * whole.width)
    halls = []
    for left in (whole.left, whole.right - width):
        ring = Rectangle(left, whole.top, left + width, whole.bottom).inset(shape.rooms + WALL)
        core = ring.inset(CORRIDOR + WALL)
        halls += _ring(ring)
        plan.rooms(core)
        _row(plan, Rectangle(left, whole.top, left + width, ring.top - WALL))
        _row(plan, Rectangle(left, ring.bottom + WALL, left + width, whole.bottom))
        for side in (left, ring.right + WALL):
            _column(plan, Rectangle(side, ring.top, side + shape.rooms, ring.bottom))
    middle = whole.middle[1]
    first = whole.left + width - shape.rooms - WALL
    passage = Rectangle(first, middle - 10, whole.right - width + shape.rooms + WALL, middle + 10)
    plan.erase(Rectangle(first, passage.top - WALL, passage.right, passage.bottom + WALL))
    plan.paint(*halls, passage, hall=True)
    return plan.finish((halls[0].left + CORRIDOR, halls[0].middle[1]))


def _ring(part: Rectangle) -> list[Rectangle]:
    """A corridor around a rectangle, inside it."""
    left, top, right, bottom = part.left, part.top, part.right, part.bottom
    return [
        Rectangle(left, top, right, top + CORRIDOR),
        Rectangle(left, bottom - CORRIDOR, right, bottom),
        Rectangle(left, top, left + CORRIDOR, bottom),
        Rectangle(right - CORRIDOR, top, right, bottom),
    ]


def flats(shape: Shape, random: np.random.Generator) -> Drawing:
    """Rooms that lead to rooms, no corridor."""
    plan = Tiling(shape, random)
    plan.rooms(plan.whole)
    return plan.finish((shape.columns // 2, shape.rows - 20))


def blocks(shape: Shape, random: np.random.Generator) -> Drawing:
    """Corridors around blocks, so that many ways lead everywhere; some blocks have rooms."""
    plan = Tiling(shape, random)
    whole = plan.whole
    pitch = 2 * shape.rooms + CORRIDOR + 2 * WALL
    across, down = (max(1, (size - CORRIDOR) // pitch) for size in (whole.width, whole.height))
    lines = [
        (whole.left + np.arange(across + 1) * (whole.width - CORRIDOR) // across).tolist(),
        (whole.top + np.arange(down + 1) * (whole.height - CORRIDOR) // down).tolist(),
    ]
    halls = [Rectangle(x, whole.top, x + CORRIDOR, whole.bottom) for x in lines[0]]
    halls += [Rectangle(whole.left, y, whole.right, y + CORRIDOR) for y in lines[1]]
    for left, right in pairwise(lines[0]):
        for top, bottom in pairwise(lines[1]):
            if random.random() < 0.7:
                block = Rectangle(left + CORRIDOR, top + CORRIDOR, right, bottom)
                plan.rooms(block.inset(WALL))
    plan.paint(*halls, hall=True)
    return plan.finish((whole.left + CORRIDOR, whole.top + CORRIDOR // 2))


def campus(shape: Shape, random: np.random.Generator) -> Drawing:
    """Office buildings around a yard."""
    plan = Tiling(shape, random)
    whole = plan.whole
    plan.paint(whole, hall=True)
    street = 2 * CORRIDOR
    across, down = (max(1, round(size / 260)) for size in (whole.width, whole.height))
    width, height = (whole.width - street) // across, (whole.height - street) // down
    for column in range(across):
        for row in range(down):
            left, top = whole.left + street + column * width, whole.top + street + row * height
            house = Rectangle(left, top, left + width - street, top + height - street)
            plan.erase(house)
            _offices(plan, house.inset(WALL))
    return plan.finish((whole.left + street // 2, whole.middle[1]))


def warehouse(shape: Shape, random: np.random.Generator) -> Drawing:
    """Long shelves with aisles between, and offices along one side."""
    plan = Tiling(shape, random)
    whole = plan.whole
    hall = Rectangle(whole.left + shape.rooms + WALL, whole.top, whole.right, whole.bottom)
    _column(plan, Rectangle(whole.left, whole.top, whole.left + shape.rooms, whole.bottom))
    plan.paint(hall, hall=True)
    drawing = plan.finish((hall.left + CORRIDOR, hall.bottom - CORRIDOR))
    deep = 12
    for top in range(hall.top + CORRIDOR + 4, hall.bottom - CORRIDOR - deep, CORRIDOR + deep):
        left = hall.left + 2 * CORRIDOR
        while left < hall.right - CORRIDOR - deep:
            length = min(int(random.integers(60, 140)), hall.right - CORRIDOR - left)
            if random.random() > 0.15:
                drawing.walls[top : top + deep, left : left + length] = 1
            left += length + CORRIDOR
    return drawing
