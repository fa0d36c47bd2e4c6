"""Spaces without a floor plan: maze, cave, mine, hall with rubble, room and pillar."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.worlds.generators.clutter import scatter
from usarsim_exploration.worlds.generators.shape import PASSABLE, WALL, Drawing, Shape

_PITCH = 14
"""Cells from one way of a maze to the next."""
_COARSE = 4
"""Cells of a cave that are decided together."""


def maze(shape: Shape, random: np.random.Generator) -> Drawing:
    """Narrow ways, a tree at first; loops are dead ends that were opened."""
    rows, columns = (size // _PITCH for size in (shape.rows, shape.columns))
    walls = np.ones((shape.rows, shape.columns), np.uint8)
    seen = np.zeros((rows, columns), bool)
    trail, seen[0, 0] = [(0, 0)], True
    links = {(row, column): 0 for row in range(rows) for column in range(columns)}
    moves = ((0, 1), (1, 0), (0, -1), (-1, 0))

    def beside(row: int, column: int) -> list[tuple[int, int]]:
        near = [(row + down, column + right) for down, right in moves]
        return [(r, c) for r, c in near if 0 <= r < rows and 0 <= c < columns]

    def carve(one: tuple[int, int], other: tuple[int, int]) -> None:
        (top, left), (bottom, right) = sorted((one, other))
        low, first = top * _PITCH + WALL, left * _PITCH + WALL
        walls[low : (bottom + 1) * _PITCH, first : (right + 1) * _PITCH] = 0
        links[one] += 1
        links[other] += 1

    while trail:
        fresh = [cell for cell in beside(*trail[-1]) if not seen[cell]]
        if not fresh:
            trail.pop()
            continue
        chosen = fresh[int(random.integers(len(fresh)))]
        carve(trail[-1], chosen)
        seen[chosen] = True
        trail.append(chosen)
    for cell in sorted(links):
        if links[cell] == 1 and random.random() < shape.loops:
            near = beside(*cell)
            carve(cell, near[int(random.integers(len(near)))])
    return Drawing(walls, (_PITCH // 2 + 1, _PITCH // 2 + 1))


def cave(shape: Shape, random: np.random.Generator) -> Drawing:
    """Random rock worn down by its neighbours; what was left apart is dug to.

    Whole numbers only, so that every machine makes the same cave.
    """
    rows, columns = (-(-size // _COARSE) for size in (shape.rows, shape.columns))
    rock = (random.random((rows, columns)) < 0.497).astype(np.int32)
    reach = max(1, min(shape.rooms // 20, rows // 16, columns // 16))
    for _ in range(5):
        rock = (_around(rock, reach) * 2 > (2 * reach + 1) ** 2).astype(np.int32)
    fine = np.kron(rock, np.ones((_COARSE, _COARSE), np.int32))[: shape.rows, : shape.columns]
    walls = (_around(fine, 3) * 2 > 49).astype(np.uint8)
    _join(walls, random)
    scatter(walls, walls == 0, shape.clutter, random, rubble=True)
    return Drawing(_roomy(walls), (shape.columns // 8, shape.rows // 2))


def mine(shape: Shape, random: np.random.Generator) -> Drawing:
    """Crooked drifts between chambers."""
    pitch = 2 * shape.rooms
    down, across = (max(2, size // pitch) for size in (shape.rows, shape.columns))
    walls = np.ones((shape.rows, shape.columns), np.uint8)
    row, column = np.indices((down, across))
    x = (column + 0.5) * shape.columns / across + random.uniform(-0.25, 0.25, row.shape) * pitch
    y = (row + 0.5) * shape.rows / down + random.uniform(-0.25, 0.25, row.shape) * pitch
    nodes = np.stack([x, y], axis=-1).reshape(-1, 2)
    edges = [(n, n + 1) for n in range(len(nodes)) if (n + 1) % across]
    edges += [(n, n + across) for n in range(len(nodes) - across)]
    group = np.arange(len(nodes))
    for index in random.permutation(len(edges)).tolist():
        one, other = edges[index]
        if group[one] == group[other] and random.random() >= shape.loops:
            continue
        group[group == group[other]] = group[one]
        bend = (nodes[one] + nodes[other]) / 2 + random.uniform(-0.2, 0.2, 2) * pitch
        line = np.stack([nodes[one], bend, nodes[other]]).astype(np.int32)
        cv2.polylines(
            walls, [line], False, 0, int(random.integers(shape.doors, max(20, shape.doors + 10)))
        )
    for place in nodes.astype(int).tolist():
        if random.random() < 0.4:
            axes = random.integers(shape.rooms // 4, shape.rooms // 2 + 1, 2).tolist()
            cv2.ellipse(walls, place, axes, 0, 0, 360, 0, -1)
    scatter(walls, walls == 0, shape.clutter, random, rubble=True)
    return Drawing(_roomy(walls), (int(nodes[0, 0]), int(nodes[0, 1])))


def hall(shape: Shape, random: np.random.Generator) -> Drawing:
    """One open space with rubble."""
    walls = np.zeros((shape.rows, shape.columns), np.uint8)
    walls[:WALL] = walls[-WALL:] = walls[:, :WALL] = walls[:, -WALL:] = 1
    scatter(walls, walls == 0, shape.clutter, random, rubble=True)
    return Drawing(walls, (30, shape.rows // 2))


def pillars(shape: Shape, random: np.random.Generator) -> Drawing:
    """Room and pillar, as coal is mined: a grid of ways around thick pillars, some of them fallen
    into one another."""
    walls = np.zeros((shape.rows, shape.columns), np.uint8)
    walls[:WALL] = walls[-WALL:] = walls[:, :WALL] = walls[:, -WALL:] = 1
    way = 2 * PASSABLE
    pitch = max(shape.rooms, 2 * way)
    for top in range(way, shape.rows - way, pitch):
        for left in range(way, shape.columns - way, pitch):
            wide, high = random.integers(pitch // 3, pitch - way + 1, 2).tolist()
            fallen = random.random()
            wide = pitch if fallen < 0.12 * (1 - shape.loops) else wide
            high = pitch if fallen > 1 - 0.12 * (1 - shape.loops) else high
            walls[
                top : min(top + high, shape.rows - way),
                left : min(left + wide, shape.columns - way),
            ] = 1
    scatter(walls, walls == 0, shape.clutter, random, rubble=True)
    return Drawing(walls, (way // 2 + WALL, way // 2 + WALL))


def _around(cells: NDArray[np.int32], reach: int) -> NDArray[np.int32]:
    """Sums over the square of so many cells around each; beyond the edge all is rock."""
    padded = np.pad(cells, reach, constant_values=1).cumsum(axis=0).cumsum(axis=1)
    total = np.pad(padded, ((1, 0), (1, 0)))
    side = 2 * reach + 1
    found = total[side:, side:] - total[:-side, side:] - total[side:, :-side]
    return np.asarray(found + total[:-side, :-side], np.int32)


def _join(walls: NDArray[np.uint8], random: np.random.Generator) -> None:
    """Dig from each larger pocket to the nearest cell of the largest."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats(1 - walls, connectivity=4)
    areas = facts[:, cv2.CC_STAT_AREA]
    largest = 1 + int(np.argmax(areas[1:]))
    goals = np.argwhere(labels == largest)
    for pocket in range(1, count):
        if pocket == largest or areas[pocket] < 400:
            continue
        cells = np.argwhere(labels == pocket)
        start = cells[int(random.integers(len(cells)))]
        goal = goals[np.argmin(((goals - start) ** 2).sum(axis=1))]
        ends = (int(start[1]), int(start[0])), (int(goal[1]), int(goal[0]))
        cv2.line(walls, *ends, 0, PASSABLE + 4)


def _roomy(walls: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Only what a robot can drive through stays open."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (PASSABLE + 1, PASSABLE + 1))
    return (1 - cv2.morphologyEx(1 - walls, cv2.MORPH_OPEN, kernel)).astype(np.uint8)
