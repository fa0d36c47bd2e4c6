"""What is seen: triangles with one material each, and MuJoCo's mesh files for them."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_maps.build.csg import Solid, Surface
from usarsim_maps.build.light import Glow, cut_for_light
from usarsim_maps.geometry import FARTHEST, LEAST_AREA, normals_areas
from usarsim_maps.scene import Array, Mesh, Polygon

LEAST_VERTICES = 4
"""MuJoCo refuses meshes of fewer; a single triangle gets one that nobody uses."""

TILE = 32.0
"""m: level surfaces are cut into tiles of this size, one mesh per tile and material."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Triangles of one material."""

    material: str  # its name in the map
    corners: Array  # (m, 3, 3) m
    uvs: Array | None  # texture coordinates (m, 3, 2), or None
    flat: bool = False
    """Every triangle is lit as the plane that it is; else MuJoCo rounds shallow edges off."""


def looks_of_mesh(mesh: Mesh, linear: Array) -> Iterator[tuple[int, Look]]:
    """Slot number and triangles of every material slot of a mesh.

    A linear map (3, 3) is applied to its vertices; where it mirrors, triangles are turned round.
    """
    with np.errstate(all="ignore"):
        corners = (mesh.vertices @ linear.T)[mesh.triangles]
    uvs = mesh.uvs
    if np.linalg.det(linear) < 0.0:
        corners = corners[:, ::-1]
        uvs = None if uvs is None else uvs[:, ::-1]
    sound = np.asarray((np.abs(corners) < FARTHEST).all(axis=(1, 2)))
    flat = np.where(sound[:, None, None], corners, 0.0).reshape(-1, 3)
    _, areas = normals_areas(flat, np.arange(len(flat)).reshape(-1, 3))
    sound &= areas > LEAST_AREA
    slots = np.zeros(len(corners), dtype=np.int32) if mesh.slots is None else mesh.slots
    for slot in np.unique(slots[sound]).tolist():
        chosen = sound & (slots == slot)
        name = mesh.materials[slot] if 0 <= slot < len(mesh.materials) else ""
        yield slot, Look(name, corners[chosen], None if uvs is None else _finite(uvs[chosen]))


def looks_of_level(solid: Solid, glows: Sequence[Glow] = ()) -> list[Look]:
    """The faces of all cells and sheets, by material and tile, in the order of appearance.

    Near lamps that fade they are cut small.
    """
    twins = _twins(solid.surfaces)
    parts: dict[tuple[str, int, int], list[tuple[Array, Array | None]]] = defaultdict(list)
    for cell in solid.cells:
        for face in cell.faces:
            points = np.array(face.points)
            surface = _surface_at(solid.surfaces, twins, face.surface, points)
            material = surface.polygon.material if surface else ""
            for piece in cut_for_light(points, glows):
                uvs = None
                if surface and surface.texture is not None:
                    uvs = np.column_stack([piece, np.ones(len(piece))]) @ surface.texture.T
                _add_fan(parts, material, piece, uvs)
    for _, polygon in solid.sheets:
        _add_fan(parts, polygon.material, polygon.vertices, polygon.uvs)
    answer = []
    for (material, _, _), fans in parts.items():
        complete = all(uvs is not None for _, uvs in fans)
        answer.append(
            Look(
                material,
                np.concatenate([corners for corners, _ in fans]),
                np.concatenate([uvs for _, uvs in fans if uvs is not None]) if complete else None,
                flat=True,
            )
        )
    return answer


def looks_of_grid(heights: Array, spacing: tuple[float, float], size: float) -> Look:
    """Triangles of terrain in the frame of its first corner; `size` m per picture."""
    rows, columns = heights.shape
    x, y = np.meshgrid(np.arange(columns) * spacing[0], np.arange(rows) * spacing[1])
    grid = np.stack([x, y, heights], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    corners = np.concatenate(
        [np.stack([a, b, c], 2).reshape(-1, 3, 3), np.stack([a, c, d], 2).reshape(-1, 3, 3)]
    )
    return Look("", corners, corners[:, :, :2] / size)


def _add_fan(
    parts: dict[tuple[str, int, int], list[tuple[Array, Array | None]]],
    material: str,
    points: Array,
    uvs: Array | None,
) -> None:
    middle = points.mean(axis=0)
    key = (material, int(middle[0] // TILE), int(middle[1] // TILE))
    parts[key].append((_fan(points), None if uvs is None else _finite(_fan(uvs))))


def _fan(points: Array) -> Array:
    count = len(points) - 2
    return np.stack(
        [np.broadcast_to(points[0], (count, points.shape[1])), points[1:-1], points[2:]], 1
    )


def _finite(uvs: Array) -> Array:
    return np.nan_to_num(uvs, nan=0.0, posinf=0.0, neginf=0.0)


def _twins(surfaces: Iterable[Surface]) -> dict[int, list[int]]:
    """For every surface all those of its brush in the same plane, itself included."""
    groups: dict[tuple[object, ...], list[int]] = defaultdict(list)
    keys = []
    for number, surface in enumerate(surfaces):
        points = surface.polygon.vertices
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal = normal / max(float(np.linalg.norm(normal)), 1e-30)
        offset = float(normal @ points[0])
        key = (surface.brush, *np.round(normal, 3).tolist(), round(offset, 3))
        keys.append(key)
        groups[key].append(number)
    return {number: groups[key] for number, key in enumerate(keys)}


def _surface_at(
    surfaces: list[Surface], twins: dict[int, list[int]], number: int, points: Array
) -> Surface | None:
    """Of coplanar polygons the one that covers the middle of a face."""
    if number < 0:
        return None
    candidates = twins[number]
    if len(candidates) > 1:
        middle = points.mean(axis=0)
        for candidate in candidates:
            if _covers(surfaces[candidate].polygon, middle):
                return surfaces[candidate]
    return surfaces[number]


def _covers(polygon: Polygon, point: Array) -> bool:
    corners = polygon.vertices
    edges = np.roll(corners, -1, axis=0) - corners
    crosses = np.cross(edges, point - corners)
    return bool((crosses @ crosses.sum(axis=0) >= 0.0).all())


def msh(look: Look, middle: Array) -> bytes:
    """MuJoCo's binary mesh format: counts, then vertices, normals, texture coordinates, faces.

    Corners with equal place, normal and texture are shared. Texture coordinates count downwards
    there.
    """
    places = (look.corners.reshape(-1, 3) - middle).astype(np.float32)
    columns = [places]
    if look.flat:
        normals, _ = normals_areas(
            look.corners.reshape(-1, 3), np.arange(len(places)).reshape(-1, 3)
        )
        # Rounded, so that triangles of one plane share their corners.
        columns.append(np.repeat(np.round(normals, 5).astype(np.float32), 3, axis=0))
    if look.uvs is not None:
        texture = look.uvs.reshape(-1, 2).astype(np.float32)
        texture[:, 1] = 1.0 - texture[:, 1]
        columns.append(texture)
    rows = np.ascontiguousarray(np.concatenate(columns, axis=1))
    unique, inverse = np.unique(rows, axis=0, return_inverse=True)
    faces = inverse.reshape(-1, 3).astype(np.int32)
    if len(unique) < LEAST_VERTICES:
        unique = np.concatenate([unique, np.repeat(unique[:1], LEAST_VERTICES - len(unique), 0)])
    normal_count = len(unique) if look.flat else 0
    textured = len(unique) if look.uvs is not None else 0
    head = struct.pack("<4i", len(unique), normal_count, textured, len(faces))
    parts = np.split(unique, np.cumsum([column.shape[1] for column in columns])[:-1], axis=1)
    arrays = b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
    return head + arrays + np.ascontiguousarray(faces).tobytes()
