"""Which side of a triangle soup is outside, whatever the windings in the file say.

Neighbours across an edge are turned until they agree. Then every such patch faces the way most of
its area did; where that says nothing, or is plainly reversed, its shape and what is seen from it
decide.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.build.soup import Rays, Soup
from usarsim_maps.geometry import normals_areas
from usarsim_maps.scene import Array, Mask

LEVEL = 0.7
"""Upward part of the normal of what may be a floor or a ceiling."""

CLEAR = 0.6
"""Part of a patch's area that has to agree for its windings to count."""

PLAINLY = 2.0
"""Times as much area that looks down as looks up: a floor that is reversed, or a ceiling."""

ROOM = 1.2
"""m: least extent of a shape that looks inwards and is a room rather than reversed."""

FLAT = 1e-3
"""Volume of a patch, as a part of the cube of its size, that says nothing."""

OPEN = 0.2
"""Part of a patch's area by which one side has to see more of the open."""

LOOKS = np.array([[0.0, 0.0, 1.0], [1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]])
"""Directions, z along the normal, in which triangles look for the open."""


@dataclass(frozen=True, slots=True, eq=False)
class Oriented:
    """A soup in which neighbours agree."""

    soup: Soup  # the triangles, turned
    closed: Mask  # (m,) whether each belongs to a patch without a rim
    known: Mask  # (m,) whether its outside is more than a guess

    def only(self, chosen: NDArray[np.intp]) -> Oriented:
        """Some of the triangles."""
        triangles, origin = self.soup.triangles[chosen], self.soup.origin[chosen]
        soup = Soup(self.soup.vertices, triangles, origin, dropped=0)
        return Oriented(soup, self.closed[chosen], self.known[chosen])


def orient(soup: Soup, up: Array) -> Oriented:
    """Turn clean triangles so that they face outside; `up` (3,) is the vertical in their frame."""
    count = len(soup.triangles)
    turned, known, closed = (np.zeros(count, dtype=bool) for _ in range(3))
    normals, areas = normals_areas(soup.vertices, soup.triangles)
    doubtful, rooms = [], []
    sheets = np.zeros(2)
    for patch, reversed_, rim in _patches(soup):
        against = float(areas[patch[reversed_]].sum()) / max(float(areas[patch].sum()), 1e-30)
        turned[patch] = reversed_ ^ (against > 0.5)
        known[patch] = max(against, 1.0 - against) >= CLEAR
        closed[patch] = not rim
        corners = soup.vertices[soup.triangles[patch]]
        facing = np.where(turned[patch][:, None], -normals[patch], normals[patch])
        room = float(np.ptp(corners.reshape(-1, 3), axis=0).min()) >= ROOM
        if not rim:
            if _volume(corners, facing, areas[patch]) < -FLAT * float(areas[patch].sum()) ** 1.5:
                if room and known[patch[0]]:
                    rooms.append(patch)
                else:
                    turned[patch] ^= True
            known[patch] = True
            continue
        other = _is_reversed_sheet(corners, facing, areas[patch], up)
        sheets[int(other)] += areas[patch].sum()
        if other:
            turned[patch] ^= True
            known[patch] = True
        elif not room:
            doubtful.append(patch)
    if sheets[1] > sheets[0]:  # the file has all of it the wrong way round
        for patch in rooms:
            turned[patch] ^= True
    if doubtful:
        chosen = np.concatenate(doubtful)
        facing = np.where(turned[chosen][:, None], -normals[chosen], normals[chosen])
        seen = _openness(soup, chosen, facing) * areas[chosen]
        starts = np.cumsum([0, *map(len, doubtful[:-1])])
        parts = np.add.reduceat(seen, starts) / np.add.reduceat(areas[chosen], starts)
        for patch, part in zip(doubtful, parts.tolist(), strict=True):
            turned[patch] ^= part < -OPEN
            known[patch] |= abs(part) > OPEN
    triangles = np.where(turned[:, None], soup.triangles[:, ::-1], soup.triangles)
    return Oriented(replace(soup, triangles=triangles), closed, known)


def _patches(soup: Soup) -> Iterator[tuple[NDArray[np.intp], Mask, bool]]:
    """Triangles connected by edges of exactly two; which to turn; whether there is a rim.

    At edges of four, where blocks touch, there is none.
    """
    count = len(soup.triangles)
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in range(count)]
    rims = np.zeros(count, dtype=bool)
    for one, other, same in zip(*_joints(soup, rims), strict=True):
        neighbours[one].append((other, same))
        neighbours[other].append((one, same))
    seen = bytearray(count)
    rim = rims.tolist()
    for first in range(count):
        if seen[first]:
            continue
        seen[first] = True
        patch, ways, at = [first], [False], 0
        while at < len(patch):
            for other, same in neighbours[patch[at]]:
                if not seen[other]:
                    seen[other] = True
                    patch.append(other)
                    ways.append(ways[at] ^ same)
            at += 1
        yield np.array(patch), np.array(ways), any(rim[index] for index in patch)


def _joints(soup: Soup, rims: Mask) -> tuple[list[int], list[int], list[bool]]:
    """Pairs of triangles that alone share an edge, and whether they run along it the same way;
    marks those at an edge of an odd number."""
    tri = soup.triangles.astype(np.int64)
    starts, ends = tri.reshape(-1), tri[:, [1, 2, 0]].reshape(-1)
    faces = np.repeat(np.arange(len(tri)), 3)
    key = np.minimum(starts, ends) * (len(soup.vertices) + 1) + np.maximum(starts, ends)
    order = np.argsort(key, kind="stable")
    _, first, counts = np.unique(key[order], return_index=True, return_counts=True)
    pairs = first[counts == 2]
    a, b = order[pairs], order[pairs + 1]
    rims[faces[order[np.repeat(counts % 2 == 1, counts)]]] = True
    return faces[a].tolist(), faces[b].tolist(), (starts[a] == starts[b]).tolist()


def _is_reversed_sheet(corners: Array, normals: Array, areas: Array, up: Array) -> bool:
    """A floor, ground or open hall that looks down. What looks down at its top is a ceiling."""
    slope = normals @ up
    down, top = areas[slope < -LEVEL], areas[slope > LEVEL]
    if float(down.sum()) <= PLAINLY * float(top.sum()):
        return False
    heights = corners.mean(axis=1) @ up
    every = corners @ up
    middle = (float(every.min()) + float(every.max())) / 2.0
    level = float(heights[slope < -LEVEL] @ down / down.sum())
    return level <= middle or float(np.ptp(every)) < ROOM


def _volume(corners: Array, normals: Array, areas: Array) -> float:
    """Three times the m^3 that a closed patch encloses; negative if it looks inwards."""
    middle = corners.mean(axis=(0, 1))
    return float(np.einsum("ij,ij->i", corners[:, 0] - middle, normals) @ areas)


def _openness(soup: Soup, chosen: NDArray[np.intp], normals: Array) -> Array:
    """Per triangle the part of its looks to the front that meet nothing, less that to the back."""
    rays = Rays(soup.vertices[soup.triangles])
    sideways = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    sideways /= np.linalg.norm(sideways, axis=1)[:, None]
    frames = np.stack([sideways, np.cross(normals, sideways), normals], axis=1)
    middles = soup.vertices[soup.triangles[chosen]].mean(axis=1)
    seen = np.zeros(len(chosen))
    for sign in (1.0, -1.0):
        ways = np.einsum("kj,nji->nki", LOOKS * [1.0, 1.0, sign], frames).reshape(-1, 3)
        starts = np.repeat(middles + sign * 1e-3 * normals, len(LOOKS), axis=0)
        _, found = rays.cast(starts, ways)
        seen += sign * (found.reshape(-1, len(LOOKS)) < 0).mean(axis=1)
    return seen
