"""Pictures of an imported world, made with rays: they need no graphics card.

A view from above, a slice at the height of a laser, and four views from the corners.
"""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_server.simulation.tessellation import triangles
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.picture import png
from usarsim_server.worlds.scene import build_scene

__all__ = ["Preview", "write_previews"]

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

WIDTH, HEIGHT = 800, 600
LASER = 0.3
"""m above the floor: where the slice is made."""

SKY = np.array([0.93, 0.95, 0.98])
SUN = np.array([0.35, 0.25, 0.9]) / np.linalg.norm([0.35, 0.25, 0.9])
MARK = np.array([0.05, 0.60, 0.30])
PERSON = np.array([0.85, 0.25, 0.15])
PLANE = 200.0
"""m: half of what is drawn of an endless floor."""


class Preview:
    """The visible triangles of a world with their colours."""

    def __init__(self, world: WorldDescription) -> None:
        self._world = world
        model = build_scene(world).compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        corners, colors = [], []
        for geom in range(model.ngeom):
            if model.geom_group[geom] > 2:
                continue
            mat = data.geom_xmat[geom].reshape(3, 3)
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
                found = _plane(data.geom_xpos[geom], mat)
            else:
                found = triangles(model, geom, data.geom_xpos[geom], mat)
            corners.append(found)
            colors.append(np.tile(_color(model, geom), (len(found), 1)))
        self._corners = np.concatenate([np.zeros((0, 3, 3)), *corners])
        self._colors = np.concatenate([np.zeros((0, 3)), *colors])
        sides = np.cross(
            self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0]
        )
        self._normals = sides / np.maximum(np.linalg.norm(sides, axis=1), 1e-12)[:, None]
        self._scene = rtcore_scene.EmbreeScene()
        TriangleMesh(self._scene, self._corners.astype(np.float32))
        lower, upper = _playable(world)
        self.lower, self.upper = lower, upper

    def top(self, width: int = WIDTH, height: int = HEIGHT) -> Image:
        """From above, without roofs: what is more than 2 m above the floor is cut off."""
        x, y, scale = self._grid(width, height)
        level = self._floor() + 2.0
        start = np.stack([x, y, np.full(x.shape, level)], axis=-1).reshape(-1, 3)
        down = np.tile([0.0, 0.0, -1.0], (len(start), 1))
        colors, depths = self._shade(start, down)
        # What is higher is lighter, so that walls stand out from the floor.
        colors *= 1.0 - 0.2 * np.clip(np.nan_to_num(depths, posinf=0.0), 0.0, 2.5)[:, None]
        image = colors.reshape(height, width, 3)
        for places, color in (
            ([s.pose.position for s in self._world.starts], MARK),
            ([v.pose.position for v in self._world.victims], PERSON),
        ):
            for place in places:
                _dot(image, x[0], y[:, 0], place, color, max(0.15, 2.5 / scale))
        return _bytes(image)

    def slice(self, width: int = WIDTH, height: int = HEIGHT) -> Image:
        """What a laser at `LASER` above the floor can meet, black on white."""
        level = self._floor() + LASER
        low, high = self._corners[:, :, 2].min(axis=1), self._corners[:, :, 2].max(axis=1)
        image = np.ones((height, width, 3))
        x, y, _ = self._grid(width, height)
        for corners in self._corners[(low <= level) & (high >= level) & (low < high)]:
            ends = _cut(corners, level)
            if ends is None:
                continue
            steps = max(2, int(np.linalg.norm(ends[1] - ends[0]) / (x[0, 1] - x[0, 0]) * 2))
            way = ends[0] + np.linspace(0.0, 1.0, min(steps, 20_000))[:, None] * (ends[1] - ends[0])
            columns = np.round((way[:, 0] - x[0, 0]) / (x[0, 1] - x[0, 0])).astype(int)
            rows = np.round((way[:, 1] - y[0, 0]) / (y[1, 0] - y[0, 0])).astype(int)
            inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
            image[rows[inside], columns[inside]] = 0.0
        return _bytes(image)

    def view(self, corner: int, width: int = WIDTH, height: int = HEIGHT) -> Image:
        """From above one of the four corners towards the middle; near walls are cut away."""
        middle = (self.lower + self.upper) / 2.0
        size = float(np.linalg.norm((self.upper - self.lower)[:2])) + 1.0
        azimuth = math.pi / 4.0 + corner * math.pi / 2.0
        floor = self._floor()
        middle[2] = min(middle[2], floor + 1.0)
        eye = middle + size * np.array([0.7 * math.cos(azimuth), 0.7 * math.sin(azimuth), 0.75])
        ahead = (middle - eye) / np.linalg.norm(middle - eye)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, ahead)
        u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(1, -1, height) * height / width)
        ways = ahead + 0.55 * (u[..., None] * right + v[..., None] * up)
        ways = (ways / np.linalg.norm(ways, axis=-1, keepdims=True)).reshape(-1, 3)
        # Begin below the ceiling, so that one looks into rooms.
        drop = np.minimum(ways[:, 2], -1e-3)
        skip = np.maximum(0.0, (floor + 2.2 - eye[2]) / drop)
        start = eye + ways * skip[:, None]
        return _bytes(self._shade(start, ways)[0].reshape(height, width, 3))

    def _floor(self) -> float:
        """m: height of the lowest start pose's floor."""
        heights = [start.pose.position[2] for start in self._world.starts]
        start = self._world.starts[int(np.argmin(heights))].pose.position
        down = np.array([[0.0, 0.0, -1.0]], np.float32)
        answer = self._scene.run(np.array([start], np.float32), down, output=1)
        way = float(answer["tfar"][0]) if answer["primID"][0] >= 0 else 0.25
        return start[2] - (way if way < 5.0 else 0.25)

    def _grid(self, width: int, height: int) -> tuple[Array, Array, float]:
        """Places (m) of all pixels of a plan, and pixels per metre; +x is to the right, +y up."""
        size = self.upper - self.lower
        scale = 0.92 * min(width / max(size[0], 0.1), height / max(size[1], 0.1))
        middle = (self.lower + self.upper) / 2.0
        columns = middle[0] + (np.arange(width) - width / 2.0 + 0.5) / scale
        rows = middle[1] - (np.arange(height) - height / 2.0 + 0.5) / scale
        x, y = np.meshgrid(columns, rows)
        return x, y, scale

    def _shade(self, start: Array, ways: Array) -> tuple[Array, Array]:
        colors = np.tile(SKY, (len(start), 1))
        distances = np.full(len(start), np.inf)
        for begin in range(0, len(start), 100_000):
            part = slice(begin, begin + 100_000)
            answer = self._scene.run(
                start[part].astype(np.float32), ways[part].astype(np.float32), output=1
            )
            faces = answer["primID"]
            hit = faces >= 0
            normals = self._normals[faces[hit]]
            away = np.einsum("ij,ij->i", normals, ways[part][hit]) > 0.0
            normals = np.where(away[:, None], -normals, normals)
            light = 0.45 + 0.55 * np.clip(normals @ SUN, 0.0, 1.0)
            colors[part][hit] = self._colors[faces[hit]] * light[:, None]
            distances[part][hit] = answer["tfar"][hit]
        return colors, distances


def write_previews(world: WorldDescription, folder: Path) -> list[Path]:
    """Draw all six pictures into a folder; returns their paths.

    Raises:
        WorldError: the scene cannot be built.
        OSError: a file cannot be written.
    """
    preview = Preview(world)
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {"top": preview.top(), "slice": preview.slice()}
    pictures |= {f"view{corner + 1}": preview.view(corner) for corner in range(4)}
    paths = []
    for name, image in pictures.items():
        path = folder / f"{name}.png"
        path.write_bytes(png(image))
        paths.append(path)
    return paths


def _playable(world: WorldDescription) -> tuple[Array, Array]:
    """The bounds without the room around and above that robots have."""
    lower, upper = np.array(world.lower), np.array(world.upper)
    margin = np.minimum(20.0, (upper - lower)[:2] * 0.45)
    return lower + np.array([*margin, 10.0]), upper - np.array([*margin, 100.0])


def _plane(position: Array, turn: Array) -> Array:
    quad = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * PLANE @ turn.T + position
    answer: Array = np.array([quad[[0, 1, 2]], quad[[0, 2, 3]]])
    return answer


def _color(model: mujoco.MjModel, geom: int) -> Array:
    """Mean colour of a geom's material."""
    material = int(model.geom_matid[geom])
    if material < 0:
        return np.array(model.geom_rgba[geom, :3], dtype=float)
    color = np.array(model.mat_rgba[material, :3], dtype=float)
    texture = int(model.mat_texid[material][mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture >= 0:
        channels = int(model.tex_nchannel[texture])
        size = int(model.tex_width[texture]) * int(model.tex_height[texture]) * channels
        start = int(model.tex_adr[texture])
        pixels = model.tex_data[start : start + size].reshape(-1, channels)
        color = color * pixels[:: max(1, len(pixels) // 4096), :3].mean(axis=0) / 255.0
    return color


def _cut(corners: Array, level: float) -> Array | None:
    """The ends (2, 2) of the line in which a triangle meets a height."""
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        p, q = corners[a], corners[b]
        if (p[2] > level) != (q[2] > level):
            share = (level - p[2]) / (q[2] - p[2])
            ends.append((p + (q - p) * share)[:2])
    return np.array(ends) if len(ends) == 2 else None


def _dot(
    image: Array, x: Array, y: Array, place: tuple[float, ...], color: Array, radius: float
) -> None:
    near = (x[None, :] - place[0]) ** 2 + (y[:, None] - place[1]) ** 2 < radius**2
    image[near] = color


def _bytes(image: Array) -> Image:
    answer: Image = (np.clip(image, 0.0, 1.0) * 255.0).round().astype(np.uint8)
    return answer
