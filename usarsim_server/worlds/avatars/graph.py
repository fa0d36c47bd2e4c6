"""Shortest ways along the path nodes of a world."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence

from usarsim_server.worlds.description import PathNode

__all__ = ["distances_to", "find_node", "way_to"]


def find_node(nodes: Sequence[PathNode], tag: str) -> PathNode | None:
    """The node of a tag, whatever its case; None if there is none."""
    wanted = tag.strip().lower()
    return next((node for node in nodes if node.tag.lower() == wanted), None)


def distances_to(nodes: Sequence[PathNode], goal: str) -> dict[str, float]:
    """Length (m) of the shortest way from each node to a goal; nodes without a way are left out.

    A connection can be walked both ways, whichever of its ends names the other.

    Args:
        nodes: the graph.
        goal: tag of a node.
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
