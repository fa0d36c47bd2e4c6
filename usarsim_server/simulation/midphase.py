"""Better trees for MuJoCo's search for contacts between two bodies.

MuJoCo looks for the geoms of two bodies that may touch by descending two trees of boxes, one for
each body. Those that it compiles halve the geoms by their middles: planes, which reach everywhere,
end up among walls, and so every wheel is taken down a long path of boxes without end at every step.
Here planes stand at the top, and the rest is divided by the surface area heuristic. Found are the
same contacts in the same order, since MuJoCo sorts them; only the search is shorter, by half in
`arena`.
"""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.mailbox import yield_interpreter

FEWEST, MOST = 4, 5000
"""Geoms of a body that has a tree worth the work, and of one whose tree takes too long (0.1 ms a
geom)."""
_AT_ONCE = 16
"""Divisions or bodies between two moments in which others get on."""

_Tree = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], Array]


def improve_trees(model: mujoco.MjModel, apart: int) -> None:
    """Replace the trees of boxes of all bodies with some geoms.

    Args:
        model: just compiled.
        apart: the number of a geom, far from all others, that stands at the top like a plane.
    """
    top = model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)
    top[apart] = True
    chosen = (model.body_geomnum >= FEWEST) & (model.body_geomnum <= MOST)
    for number, body in enumerate(np.flatnonzero(chosen).tolist(), start=1):
        if number % _AT_ONCE == 0:
            yield_interpreter()
        start, count = int(model.body_bvhadr[body]), int(model.body_bvhnum[body])
        span = slice(start, start + count)
        geoms = model.bvh_nodeid[span]
        leaves = np.flatnonzero(geoms >= 0)
        if count != 2 * leaves.size - 1:
            continue  # no tree that is known here
        geoms, boxes = geoms[leaves], model.bvh_aabb[span][leaves]
        high = top[geoms]
        order = np.argsort(~high, kind="stable")
        rest = boxes[~high]
        children, numbers, depths, around = _chain(
            boxes[high], _divided(rest.tobytes()) if rest.size else None
        )
        model.bvh_child[span], model.bvh_depth[span] = children, depths
        model.bvh_aabb[span] = around
        model.bvh_nodeid[span] = np.where(numbers < 0, -1, geoms[order[numbers]])


def _chain(boxes: Array, rest: _Tree | None) -> _Tree:
    """A tree with some leaves, at the top, before those of another tree.

    A tree: for every node its two children or -1, its leaf or -1, its depth, its box (6: middle,
    half size). The first node is the root.
    """
    if rest is None:
        last, boxes = boxes[-1:], boxes[:-1]
        rest = np.full((1, 2), -1, np.int32), np.zeros(1, np.int32), np.zeros(1, np.int32), last
    children, numbers, depths, around = rest[0].copy(), rest[1].copy(), rest[2], rest[3]
    numbers[numbers >= 0] += len(boxes)
    for leaf in range(len(boxes) - 1, -1, -1):
        children[children >= 0] += 2
        children = np.concatenate((np.array([[1, 2], [-1, -1]], np.int32), children))
        numbers = np.concatenate((np.array([-1, leaf], np.int32), numbers))
        depths = np.concatenate((np.array([0, 1], np.int32), depths + 1))
        both = _around(np.array([boxes[leaf], around[0]]))
        around = np.concatenate((np.array([both, boxes[leaf]]), around))
    return children, numbers, depths, around


@lru_cache(maxsize=64)
def _divided(boxes: bytes) -> _Tree:
    """A tree of boxes (n, 6)."""
    parts = np.frombuffer(boxes).reshape(-1, 6)
    low, high = parts[:, :3] - parts[:, 3:], parts[:, :3] + parts[:, 3:]
    count = 2 * len(parts) - 1
    children = np.full((count, 2), -1, np.int32)
    numbers, depths = np.full(count, -1, np.int32), np.zeros(count, np.int32)
    around = np.zeros((count, 6))
    waiting = [(np.arange(len(parts)), -1, 0, 0)]
    for node in range(count):
        members, parent, side, depth = waiting.pop()
        depths[node] = depth
        if parent >= 0:
            children[parent, side] = node
        if members.size == 1:
            numbers[node], around[node] = members[0], parts[members[0]]
            continue
        around[node] = _around(parts[members])
        first, second = _halves(low, high, members)
        waiting += [(second, node, 1, depth + 1), (first, node, 0, depth + 1)]
        if node % _AT_ONCE == _AT_ONCE - 1:
            yield_interpreter()
    return children, numbers, depths, around


def _around(boxes: Array) -> Array:
    """The box (6,) around boxes (n, 6)."""
    low, high = (boxes[:, :3] - boxes[:, 3:]).min(axis=0), (boxes[:, :3] + boxes[:, 3:]).max(axis=0)
    return np.concatenate(((low + high) / 2.0, (high - low) / 2.0))


def _halves(low: Array, high: Array, members: Numbers) -> tuple[Numbers, Numbers]:
    """Divide so that the surfaces of both halves, times what is in them, are least."""
    if members.size == 2:
        return members[:1], members[1:]
    counts = np.arange(1, members.size)
    best, found = np.inf, (members[:1], members[1:])
    for axis in range(3):
        order = members[np.argsort(low[members, axis] + high[members, axis], kind="stable")]
        lows, highs = low[order], high[order]
        before = _surface(np.minimum.accumulate(lows), np.maximum.accumulate(highs))
        lows, highs = lows[::-1], highs[::-1]
        behind = _surface(np.minimum.accumulate(lows), np.maximum.accumulate(highs))[::-1]
        costs = before[:-1] * counts + behind[1:] * counts[::-1]
        cut = int(costs.argmin())
        if costs[cut] < best:
            best, found = costs[cut], (order[: cut + 1], order[cut + 1 :])
    return found


def _surface(low: Array, high: Array) -> Array:
    """Half the surfaces of boxes."""
    size = high - low
    area: Array = size[:, 0] * size[:, 1] + (size[:, 0] + size[:, 1]) * size[:, 2]
    return area
