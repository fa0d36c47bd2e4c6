"""Shortest ways along the path nodes of a world.

Where one can walk: the height of the ground along a line, walls, steps that are too high.

Only the fixed scenery counts. What can move, robots and objects, is no obstacle for a plan: the
walking person pushes it aside.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_server.simulation.frames import Vector
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.worlds.description import PathNode


def find_node(nodes: Sequence[PathNode], tag: str) -> PathNode | None:
    """The node of a tag, whatever its case; None if there is none."""
    wanted = tag.strip().lower()
    return next((node for node in nodes if node.tag.lower() == wanted), None)


def distances_to(nodes: Sequence[PathNode], goal: str) -> dict[str, float]:
    """Length (m) of the shortest way from each node to a goal; nodes without a way are left out.

    A connection can be walked both ways, whichever of its ends names the other.
    """
    return {tag: length for tag, (length, _) in _search(nodes, goal).items()}


def way_to(nodes: Sequence[PathNode], start: str, goal: str) -> list[PathNode]:
    """The nodes of the shortest way, both ends included; nothing if there is no way."""
    found = _search(nodes, goal)
    if start not in found:
        return []
    table = {node.tag: node for node in nodes}
    way = [table[start]]
    while way[-1].tag != goal:
        way.append(table[found[way[-1].tag][1]])
    return way


def _search(nodes: Sequence[PathNode], goal: str) -> dict[str, tuple[float, str]]:
    """Length of the shortest way to the goal, and the next node on it, by tag (Dijkstra)."""
    places = {node.tag: node.position for node in nodes}
    edges = _edges(nodes)
    found: dict[str, tuple[float, str]] = {}
    waiting = [(0.0, goal, goal)]
    while waiting:
        length, tag, following = heapq.heappop(waiting)
        if tag in found:
            continue
        found[tag] = length, following
        for other in edges[tag]:
            if other not in found:
                step = math.dist(places[tag], places[other])
                heapq.heappush(waiting, (length + step, other, tag))
    return found


def _edges(nodes: Sequence[PathNode]) -> Mapping[str, set[str]]:
    edges: dict[str, set[str]] = {node.tag: set() for node in nodes}
    for node in nodes:
        for neighbour in node.neighbours:
            edges[node.tag].add(neighbour)
            edges[neighbour].add(node.tag)
    return edges


SPACING = 0.1
"""m between points of the profile."""
STRETCH = 5
"""Points that are looked at together; the next stretch begins from the height found there."""
CLIMB = 0.3
"""m: a higher step cannot be taken."""
EYES = (0.45, 1.0, 1.5)
"""m above the ground: where walls are looked for, the lowest above what is stepped on."""
BREADTH = 0.2
"""m to both sides of the middle."""
DISTANCE = 0.35
"""m that is kept from walls."""
OVERHEAD = 0.6
"""m above the last ground: what is higher is passed under, not climbed."""
DEEPEST = 100.0
FARTHEST = 300.0
"""m that are looked at; a way is walked so far. It takes 0.1 s of processor time."""


@dataclass(frozen=True, slots=True)
class Survey:
    """How far a straight way can be walked."""

    profile: tuple[Vector, ...]  # points of the ground from the start on, m
    obstacle: str | None = None  # what ends the way before its goal; None if nothing does


def ground_below(simulation: Simulation, points: Sequence[Vector]) -> list[float]:
    """Height of the fixed ground below each point, m; minus infinity where there is none."""
    if not points:
        return []
    start = np.array(points, dtype=float)
    fan = RayFan(start, np.tile([0.0, 0.0, -1.0], (len(points), 1)), DEEPEST)
    heights: list[float] = (start[:, 2] - simulation.cast_scenery([fan])[0].distances).tolist()
    return heights


def survey(simulation: Simulation, start: Vector, goal: tuple[float, float]) -> Survey:
    """Look at the straight way from a point of the ground to a place (x and y), m."""
    length = math.dist(start[:2], goal)
    profile = [start]
    if length < 1e-6:
        return Survey((start, start))
    ahead = ((goal[0] - start[0]) / length, (goal[1] - start[1]) / length)
    reach = min(length, FARTHEST)
    marks = [min(reach, SPACING * n) for n in range(1, math.ceil(reach / SPACING - 1e-9) + 1)]
    for first in range(0, len(marks), STRETCH):
        part = marks[first : first + STRETCH]
        here = profile[-1]
        walked = math.dist(start[:2], here[:2])
        free = _free_way(simulation, here, ahead, part[-1] - walked + DISTANCE) - DISTANCE
        above = here[2] + OVERHEAD
        places = [(start[0] + ahead[0] * way, start[1] + ahead[1] * way, above) for way in part]
        for way, (x, y, _), height in zip(
            part, places, ground_below(simulation, places), strict=True
        ):
            if way - walked > free + 1e-9:
                return Survey(_at_least_two(profile), "a wall")
            if abs(height - profile[-1][2]) > CLIMB:
                return Survey(_at_least_two(profile), "a step")
            profile.append((x, y, height))
    return Survey(_at_least_two(profile), None if reach == length else "its length")


def _free_way(
    simulation: Simulation, here: Vector, ahead: tuple[float, float], reach: float
) -> float:
    """How far (m) a person can look ahead with the whole body."""
    x, y, z = here
    starts = [
        (x - shift * ahead[1], y + shift * ahead[0], z + eye)
        for eye in EYES
        for shift in (-BREADTH, 0.0, BREADTH)
    ]
    fan = RayFan(np.array(starts), np.tile([*ahead, 0.0], (len(starts), 1)), reach)
    return float(simulation.cast_scenery([fan])[0].distances.min())


def _at_least_two(profile: list[Vector]) -> tuple[Vector, ...]:
    return tuple(profile) if len(profile) > 1 else (profile[0], profile[0])
