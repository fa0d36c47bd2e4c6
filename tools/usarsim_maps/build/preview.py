"""Pictures of an imported world, made with rays: they need no graphics card.

A view from above, a slice at the height of a laser, and four views from the corners. What lies
above people's heads, or above a ceiling that is lower, is cut off; where that goes through
something solid, the cut is dark: convex sections at one height.
"""

from __future__ import annotations

import io
import math
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from usarsim_maps.scene import Array, Mask
from usarsim_maps.terminal import quiet
from usarsim_server.base.files import write_bytes
from usarsim_server.cameras.cutaway import (
    BELOW_CEILING,
    CUT_COLOR,
    DOWN,
    VIEW_CUT,
    ceiling,
    cut_lines,
    floor_of,
    sections,
    seen_parts,
)
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.triangles import TriangleScene
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.scene import build_scene

Image = NDArray[np.uint8]

WIDTH, HEIGHT = 800, 600
LASER = 0.3
"""m above the floor: where the slice is made."""

SKY = np.array([0.93, 0.95, 0.98])
SUN = np.array([0.35, 0.25, 0.9]) / np.linalg.norm([0.35, 0.25, 0.9])
MARK = np.array([0.05, 0.60, 0.30])
PERSON = np.array([0.85, 0.25, 0.15])
PLAN_CUT = 2.0
"""m above the floor: what is higher is left out of plans; of views what is above `VIEW_CUT`."""

DOT = 5.0
"""Pixels: radius of a mark, where 0.15 m are less."""

SPREAD = 0.55
"""Tangent of half the angle of view, sideways."""

FRAME = 0.95
"""Part of a view that the map may fill."""

PAD = 0.3
"""m around the map: as much rock as a level has that is cut out of it."""

DOTS = 1_000_000
"""Pixels of a slice that are drawn at once."""

NARROW = 1e-9
"""m: sections with less between their corners are none."""


class Preview:
    """The visible triangles of a world with their colours."""

    def __init__(self, world: WorldDescription) -> None:
        self._world = world
        self._model = model = build_scene(world).compile()
        self._data = data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        parts = seen_parts(model, data)
        self._corners = np.concatenate([np.zeros((0, 3, 3)), *(part for _, part in parts)])
        self._colors = _colors(model)
        self._scene = TriangleScene(parts)
        lower, upper = _playable(world)
        self.lower, self.upper = lower, upper

    def top(self, width: int = WIDTH, height: int = HEIGHT) -> Image:
        """From above, without roofs: what is more than 2 m above the floor is cut off."""
        x, y, scale = self._grid(width, height)
        level = self._floor() + self._cut(PLAN_CUT)
        start = np.stack([x, y, np.full(x.shape, level)], axis=-1).reshape(-1, 3)
        colors, depths = self._shade(start, np.tile(DOWN, (len(start), 1)))
        # What is higher is lighter, so that walls stand out from the floor.
        colors *= 1.0 - 0.2 * np.clip(np.nan_to_num(depths, posinf=0.0), 0.0, 2.5)[:, None]
        image = colors.reshape(height, width, 3)

        def pixels(corners: Array) -> tuple[Array, Array]:
            columns = (corners[:, 0] - x[0, 0]) * scale
            return columns, (y[0, 0] - corners[:, 1]) * scale

        for _, section in sections(self._model, self._data, level):
            window = _window(*pixels(section), image.shape)
            image[window][covered(x[window], y[window], section)] = CUT_COLOR
        radius = max(0.15, DOT / scale)
        for victim in self._world.victims:
            _dot(image, x[0], y[:, 0], victim.pose.position, PERSON, radius)
        for pose in (start.pose for start in self._world.starts):
            _dot(image, x[0], y[:, 0], pose.position, MARK, radius)
            for share in (1.0, 1.5, 2.0, 2.5):  # whither the robot looks
                ahead = (pose @ Pose((share * radius, 0.0, 0.0))).position
                _dot(image, x[0], y[:, 0], ahead, MARK, radius * 0.35)
        return _bytes(image)

    def slice(self, width: int = WIDTH, height: int = HEIGHT) -> Image:
        """What a laser at `LASER` above the floor can meet, black on white."""
        level = self._floor() + LASER
        image = np.ones((height, width, 3))
        x, y, scale = self._grid(width, height)
        ends, _ = cut_lines(self._corners, level)
        pixels = (ends - [x[0, 0], y[0, 0]]) * [scale, -scale]
        lengths = np.linalg.norm(pixels[:, 1] - pixels[:, 0], axis=1)
        steps = np.clip(2.0 * lengths, 2.0, 20_000.0).astype(int)
        for lines in np.array_split(np.arange(len(steps)), 1 + int(steps.sum()) // DOTS):
            line = np.repeat(lines, steps[lines])
            number = np.arange(len(line)) - np.repeat(
                np.cumsum(steps[lines]) - steps[lines], steps[lines]
            )
            share = (number / (steps[line] - 1))[:, None]
            dots = np.round(pixels[line, 0] * (1.0 - share) + pixels[line, 1] * share).astype(int)
            dots = dots[((dots >= 0) & (dots < [width, height])).all(axis=1)]
            image[dots[:, 1], dots[:, 0]] = 0.0
        return _bytes(image)

    def view(self, corner: int, width: int = WIDTH, height: int = HEIGHT) -> Image:
        """From above one of the four corners towards the middle; near walls are cut away."""
        floor = self._floor()
        middle = (self.lower + self.upper) / 2.0
        middle[2] = min(middle[2], floor + 1.0)
        azimuth = math.pi / 4.0 + corner * math.pi / 2.0
        ahead = -np.array([0.7 * math.cos(azimuth), 0.7 * math.sin(azimuth), 0.75])
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, ahead)
        level = floor + self._cut(VIEW_CUT)
        eye = middle - ahead * self._distance(middle, (ahead, right, up), level, height / width)
        u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(1, -1, height) * height / width)
        ways = ahead + SPREAD * (u[..., None] * right + v[..., None] * up)
        ways = (ways / np.linalg.norm(ways, axis=-1, keepdims=True)).reshape(-1, 3)
        # Begin below the ceiling, so that one looks into rooms.
        drop = np.minimum(ways[:, 2], -1e-3)
        skip = np.maximum(0.0, (level - eye[2]) / drop)
        start = eye + ways * skip[:, None]
        image = self._shade(start, ways)[0].reshape(height, width, 3)
        x, y = (start[:, axis].reshape(height, width) for axis in (0, 1))

        def pixels(corners: Array) -> tuple[Array, Array]:
            away = np.column_stack([corners, np.full(len(corners), level)]) - eye
            depth = away @ ahead * SPREAD
            if depth.min() <= 0.0:  # it goes on behind the eye
                return np.array([0.0, width]), np.array([0.0, height])
            columns = (away @ right / depth + 1.0) * (width - 1) / 2.0
            return columns, (1.0 - away @ up / depth * width / height) * (height - 1) / 2.0

        for _, section in sections(self._model, self._data, level):
            window = _window(*pixels(section), image.shape)
            image[window][covered(x[window], y[window], section)] = CUT_COLOR
        return _bytes(image)

    def _distance(
        self, middle: Array, axes: tuple[Array, Array, Array], level: float, ratio: float
    ) -> float:
        """m from which all of the map below a height is in a view along the first axis."""
        ends = np.array([self.lower, [*self.upper[:2], max(level, self.lower[2])]])
        corners = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3) - middle
        along, sideways, upwards = (corners @ axis for axis in axes)
        wanted = np.maximum(np.abs(sideways), np.abs(upwards) / ratio) / (SPREAD * FRAME)
        return max(1.0, float((wanted - along).max()))

    def _floor(self) -> float:
        """m: height of the lowest start pose's floor."""
        return floor_of(self._scene, [start.pose.position for start in self._world.starts])

    def _cut(self, usual: float) -> float:
        """m above the floor at which a picture is cut, so that one looks below low ceilings."""
        low = ceiling(self._scene, self._floor(), self.lower, self.upper) - BELOW_CEILING
        return min(usual, max(BELOW_CEILING, low))

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
        hits = self._scene.cast(start, ways, normals=True)
        assert hits.normals is not None
        towards = -np.sign(np.einsum("ij,ij->i", hits.normals, ways))[:, None]
        light = 0.45 + 0.55 * np.clip(towards * hits.normals @ SUN, 0.0, 1.0)
        colors = self._colors[hits.geoms] * light[:, None]
        colors[hits.geoms < 0] = SKY
        return colors, hits.distances


@quiet()
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
        file = io.BytesIO()
        Picture.fromarray(image).save(file, "PNG")
        write_bytes(path, file.getvalue())
        paths.append(path)
    return paths


def covered(x: Array, y: Array, section: Array) -> Mask:
    """Which of some places (any shape, m) lie in a convex section."""
    inside = np.ones(x.shape, dtype=bool)
    for (px, py), (qx, qy) in zip(section, np.roll(section, -1, axis=0), strict=True):
        if abs(qx - px) + abs(qy - py) > NARROW:
            inside &= (qx - px) * (y - py) - (qy - py) * (x - px) >= 0.0
    return inside


def _playable(world: WorldDescription) -> tuple[Array, Array]:
    """The bounds without the room around and above that robots have."""
    lower, upper = np.array(world.lower), np.array(world.upper)
    margin = np.minimum(20.0, (upper - lower)[:2] * 0.495)
    return lower + np.array([*margin, 10.0]) - PAD, upper - np.array([*margin, 100.0]) + PAD


def _colors(model: mujoco.MjModel) -> Array:
    """(ngeom, 3) mean colours of the geoms' materials."""
    colors = np.array(model.geom_rgba[:, :3], dtype=float)
    painted = model.geom_matid >= 0
    if painted.any():
        materials = np.array([_color(model, material) for material in range(model.nmat)])
        colors[painted] = materials[model.geom_matid[painted]]
    return colors


def _color(model: mujoco.MjModel, material: int) -> Array:
    """Mean colour of a material."""
    color = np.array(model.mat_rgba[material, :3], dtype=float)
    texture = int(model.mat_texid[material][mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture >= 0:
        channels = int(model.tex_nchannel[texture])
        size = int(model.tex_width[texture]) * int(model.tex_height[texture]) * channels
        start = int(model.tex_adr[texture])
        pixels = model.tex_data[start : start + size].reshape(-1, channels)
        color = color * pixels[:: max(1, len(pixels) // 4096), :3].mean(axis=0) / 255.0
    return color


def _window(columns: Array, rows: Array, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The part of a picture in which something with these corners, in pixels, can be."""
    return (
        slice(max(0, math.floor(rows.min())), min(shape[0], math.ceil(rows.max()) + 1)),
        slice(max(0, math.floor(columns.min())), min(shape[1], math.ceil(columns.max()) + 1)),
    )


def _dot(
    image: Array, x: Array, y: Array, place: tuple[float, ...], color: Array, radius: float
) -> None:
    near = (x[None, :] - place[0]) ** 2 + (y[:, None] - place[1]) ** 2 < radius**2
    image[near] = color


def _bytes(image: Array) -> Image:
    return np.asarray((np.clip(image, 0.0, 1.0) * 255.0).round().astype(np.uint8))
