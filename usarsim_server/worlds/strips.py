"""Strips of colour that show to cameras in which zone they are, as tape does in an arena.

In a zone with a strip every wall has a band of the zone's colour at the height that robots look
at, and the floor a line along the border, on the inner side. A zone is one mesh without collision,
a few millimetres in front of what it is painted on; rays do not see it (`PAINT`), so neither scans
nor radio change.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array
from usarsim_server.simulation.rays.scenery import PAINT, is_visible
from usarsim_server.simulation.rays.triangles import triangles_of_all
from usarsim_server.worlds.description import Zone
from usarsim_server.worlds.polygons import contains, sides

COLOURS = {
    "yellow": (0.95, 0.85, 0.05),
    "orange": (0.98, 0.50, 0.05),
    "red": (0.85, 0.06, 0.06),
    "blue": (0.08, 0.25, 0.90),
}
"""Red, green, blue of the kinds of zones that can have strips."""
GLOW = 0.6
"""Part of its colour that a strip shows in the dark, so that it keeps its hue in any light."""

HEIGHT = (0.35, 0.47)
"""m above the floor of a zone: what the cameras of wheeled robots see of a wall from near by."""
LIFT = 0.003
"""m by which a strip stands out."""
SAMPLE = 0.05
"""m between two looks for the zone that a piece of wall is in."""
BEFORE = 0.15
"""m in front of a wall: the place whose zone the wall shows."""
LINE = (0.04, 0.14)
"""m from the border, inwards: the line on the floor."""
PIECE = 0.25
"""m of a line on the floor that lies flat in one piece."""
HEADROOM, DEPTH = 0.6, 0.3
"""m above and below the floor of a zone between which the ground for its line is looked for."""
STEEP = 0.5
"""Largest upward part of the normal of what counts as a wall."""


def add_strips(spec: mujoco.MjSpec, zones: Sequence[Zone]) -> None:
    """Paint the strips of all zones that want one, on what never moves in a scene.

    Raises:
        ValueError: if the scene does not compile.
    """
    if not any(zone.strip and zone.kind in COLOURS for zone in zones):
        return
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    still = [
        geom
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]] == 0 and is_visible(model, geom)
    ]
    faces, _ = triangles_of_all(model, still, data.geom_xpos, data.geom_xmat)
    for number, zone in enumerate(zones):
        if not zone.strip or zone.kind not in COLOURS:
            continue
        quads = [*_on_walls(faces, zones, number), *_on_floor(model, data, zone)]
        if quads:
            _add_mesh(spec, f"{PAINT}zone:{zone.name}", zone.kind, np.array(quads))


def _on_walls(faces: Array, zones: Sequence[Zone], number: int) -> Iterator[Array]:
    """Upright quads (4, 3) on the walls of a zone, seen from within it."""
    zone = zones[number]
    low, high = zone.floor + HEIGHT[0], zone.floor + HEIGHT[1]
    pieces = list(_joined(*_sliced(faces, (low + high) / 2.0)))
    if not pieces:
        return
    rows, places = [], []
    for normal, offset, begin, end in pieces:
        marks = np.linspace(begin, end, max(1, round((end - begin) / SAMPLE)) + 1)
        middles = (marks[:-1] + marks[1:]) / 2.0
        rows.append(marks)
        places.append(middles[:, None] * _along(normal) + (offset + BEFORE) * normal)
    owns = _first(zones, np.concatenate(places)) == number  # all at once: few large arrays
    parts = np.split(owns, np.cumsum([len(one) for one in places])[:-1])
    for (normal, offset, _, _), marks, own in zip(pieces, rows, parts, strict=True):
        for first, last in _runs(own) if own.any() else ():
            foot = marks[[first, last]][:, None] * _along(normal) + (offset + LIFT) * normal
            (ax, ay), (bx, by) = foot
            yield np.array([[ax, ay, low], [bx, by, low], [bx, by, high], [ax, ay, high]])


def _along(normal: Array) -> Array:
    """The way (2,) along a wall, to the left of its normal."""
    return np.array([-normal[1], normal[0]])


def _first(zones: Sequence[Zone], places: Array) -> NDArray[np.intp]:
    """The number of the zone that each place (n, 2) belongs to; -1: none."""
    found = np.full(len(places), -1, dtype=np.intp)
    for number, zone in reversed(list(enumerate(zones))):
        found[contains(zone.corners, places)] = number
    return found


def _sliced(faces: Array, height: float) -> tuple[Array, Array, Array]:
    """Where steep triangles (n, 3, 3) cross a height: ends (k, 2), (k, 2) and normals (k, 2)."""
    above = faces[:, :, 2] > height
    cut = faces[(above.any(axis=1)) & (~above.all(axis=1))]
    normals = np.cross(cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    steep = (lengths > 1e-12) & (np.abs(normals[:, 2]) < STEEP * lengths)
    cut, normals = cut[steep], normals[steep][:, :2]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    above = cut[:, :, 2] > height
    # The corner that is alone on its side comes first.
    lone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    rows = np.arange(len(cut))
    a, b, c = (cut[rows, (lone + turn) % 3] for turn in range(3))
    ends = []
    for other in (b, c):
        share = ((height - a[:, 2]) / (other[:, 2] - a[:, 2]))[:, None]
        ends.append((a + share * (other - a))[:, :2])
    return ends[0], ends[1], normals


def _joined(
    starts: Array, ends: Array, normals: Array
) -> Iterator[tuple[Array, float, float, float]]:
    """Pieces on one line as one: normal (2,), its distance from the origin, from and to, m."""
    lines: dict[tuple[int, int, int], list[int]] = defaultdict(list)
    offsets = np.einsum("ij,ij->i", starts, normals)
    for row, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
        lines[round(normal[0] * 500), round(normal[1] * 500), round(offset * 500)].append(row)
    for rows in lines.values():
        normal, offset = normals[rows[0]], float(offsets[rows[0]])
        along = _along(normal)
        spans = np.sort(np.stack([starts[rows] @ along, ends[rows] @ along], axis=1), axis=1)
        begin = end = None
        for low, high in spans[np.argsort(spans[:, 0])].tolist():
            if end is None or begin is None or low > end + 1e-3:
                if begin is not None and end is not None:
                    yield normal, offset, begin, end
                begin, end = low, high
            end = max(end, high)
        if begin is not None and end is not None:
            yield normal, offset, begin, end


def _runs(wanted: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """From and to (past the last) of each row of trues."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]]).astype(np.int8)))
    yield from ((int(first), int(last)) for first, last in edges.reshape(-1, 2))


def _on_floor(model: mujoco.MjModel, data: mujoco.MjData, zone: Zone) -> Iterator[Array]:
    """Quads (4, 3) of the line along the border, on the ground as far as it is near the floor."""
    for start, end in sides(zone.corners):
        way = np.subtract(end, start)
        length = float(np.hypot(*way))
        if length < 2.0 * LINE[1]:
            continue
        way /= length
        inward = np.array([-way[1], way[0]])
        count = max(1, round(length / PIECE))
        marks = np.linspace(LINE[0], length - LINE[0], count + 1)
        middle = sum(LINE) / 2.0
        heights = [
            _ground(model, data, start + mark * way + middle * inward, zone.floor) for mark in marks
        ]
        for number in range(count):
            low, high = heights[number], heights[number + 1]
            if low is None or high is None:
                continue
            quad = []
            for mark, aside, z in (
                (marks[number], LINE[0], low),
                (marks[number + 1], LINE[0], high),
                (marks[number + 1], LINE[1], high),
                (marks[number], LINE[1], low),
            ):
                x, y = start + mark * way + aside * inward
                quad.append([x, y, z + LIFT])
            yield np.array(quad)


def _ground(model: mujoco.MjModel, data: mujoco.MjData, place: Array, floor: float) -> float | None:
    """Height of the ground at a place (2,) near the floor of a zone; None: there is none."""
    origin = np.array([*place, floor + HEADROOM])
    geom = np.full(1, -1, dtype=np.int32)
    down = np.array([0.0, 0.0, -1.0])
    way = mujoco.mj_ray(model, data, origin, down, None, 1, -1, geom, None)
    return float(origin[2] - way) if geom[0] >= 0 and way <= HEADROOM + DEPTH else None


def _add_mesh(spec: mujoco.MjSpec, name: str, kind: str, quads: Array) -> None:
    material = f"{PAINT}{kind}"
    if spec.material(material) is None:
        spec.add_material(name=material, rgba=[*COLOURS[kind], 1.0], emission=GLOW, specular=0.0)
    numbers = 4 * np.arange(len(quads))[:, None]
    faces = (numbers[:, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    spec.add_mesh(
        name=name,
        uservert=quads.reshape(-1).tolist(),
        userface=faces.reshape(-1).tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        material=material,
        contype=0,
        conaffinity=0,
    )
