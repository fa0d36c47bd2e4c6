"""Pictures of an imported world, made with rays: they need no graphics card.

A view from above, a slice at the height of a laser, and four views from the corners. What lies
above people's heads, or above a ceiling that is lower, is cut off; where that goes through
something solid, the cut is dark: convex sections at one height.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from usarsim_maps.scene import Array, Mask
from usarsim_maps.terminal import quiet
from usarsim_server.files import write_bytes
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.triangles import TriangleScene, triangles_of_all
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
CUT = np.array([0.20, 0.23, 0.27])
"""Colour of what is cut through."""

PLAN_CUT, VIEW_CUT = 2.0, 2.2
"""m above the floor: what is higher is left out of plans and views."""

BELOW_CEILING = 0.02
"""m below a ceiling that is lower than that."""

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

DOWN = np.array([[0.0, 0.0, -1.0]])

PLANE = 200.0
"""m: half of what is drawn of an endless floor."""

PROBES = 64
"""Along each side of a map."""

ABOVE, NEAR = 0.05, 0.2
"""m above the floor whence ceilings are looked for, and below which a floor is this one."""

LEAST = 20
"""Probes that have to stand on the floor."""

FELT = 3
"""Group of the pieces that only collide."""

CONVEX = {int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)}
"""Kinds of pieces; terrain, which is neither, is not cut."""

NARROW = 1e-9
"""m: sections with less between their corners are none."""


class Preview:
    """The visible triangles of a world with their colours."""

    def __init__(self, world: WorldDescription) -> None:
        self._world = world
        self._model = model = build_scene(world).compile()
        self._data = data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        shown = np.flatnonzero(model.geom_group <= 2)
        found, owners = triangles_of_all(model, shown.tolist(), data.geom_xpos, data.geom_xmat)
        ends = np.flatnonzero(np.diff(owners, append=-1)) + 1
        parts = list(zip(owners[ends - 1].tolist(), np.split(found, ends), strict=False))
        for n in shown[model.geom_type[shown] == mujoco.mjtGeom.mjGEOM_PLANE].tolist():
            parts.append((n, _plane(data.geom_xpos[n], data.geom_xmat[n].reshape(3, 3))))
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

        for section in sections(self._model, self._data, level):
            window = _window(*pixels(section), image.shape)
            image[window][covered(x[window], y[window], section)] = CUT
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

        for section in sections(self._model, self._data, level):
            window = _window(*pixels(section), image.shape)
            image[window][covered(x[window], y[window], section)] = CUT
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
        heights = [start.pose.position[2] for start in self._world.starts]
        start = self._world.starts[int(np.argmin(heights))].pose.position
        way = self._scene.cast(np.array([start]), DOWN).distances[0]
        return start[2] - (float(way) if way < 5.0 else 0.25)

    def _cut(self, usual: float) -> float:
        """m above the floor at which a picture is cut, so that one looks below low ceilings."""
        low = _ceiling(self._scene, self._floor(), self.lower, self.upper) - BELOW_CEILING
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


def _ceiling(scene: TriangleScene, floor: float, lower: Array, upper: Array) -> float:
    """m from a floor, at a height, up to what half of it lies below; inf if that is nothing.

    The corners (3,) are those of the map.
    """
    parts = (np.arange(PROBES) + 0.37) / PROBES  # between the lines of a builder's grid
    x, y = np.meshgrid(*(lower[:2] + parts[:, None] * (upper - lower)[:2]).T)
    start = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, floor + ABOVE)])
    below, above = (
        scene.cast(start, np.tile(way, (len(start), 1))).distances for way in (DOWN, -DOWN)
    )
    heights = above[below < NEAR]
    return ABOVE + float(np.median(heights)) if len(heights) >= LEAST else np.inf


def sections(model: mujoco.MjModel, data: mujoco.MjData, level: float) -> Iterator[Array]:
    """Corners (k, 2), in order around it, of the cut through every fixed convex piece."""
    chosen = (model.body_weldid[model.geom_bodyid] == 0) & (model.geom_group == FELT)
    chosen &= np.isin(model.geom_type, list(CONVEX))
    chosen &= np.abs(data.geom_xpos[:, 2] - level) <= model.geom_rbound
    faces, owners = triangles_of_all(
        model, np.flatnonzero(chosen).tolist(), data.geom_xpos, data.geom_xmat
    )
    ends, cut = cut_lines(faces, level)
    owners = np.repeat(owners[cut], 2)
    corners = ends.reshape(-1, 2)
    order = np.argsort(owners, kind="stable")
    owners, corners = owners[order], corners[order]
    starts = np.flatnonzero(np.diff(owners, prepend=-1))
    if not len(starts):
        return
    middles = np.minimum.reduceat(corners, starts) + np.maximum.reduceat(corners, starts)
    away = corners - np.repeat(middles / 2.0, np.diff(starts, append=len(owners)), axis=0)
    around = np.lexsort((np.arctan2(away[:, 1], away[:, 0]), owners))
    yield from (part for part in np.split(corners[around], starts[1:]) if len(part) >= 6)


def cut_lines(triangles: Array, level: float) -> tuple[Array, NDArray[np.intp]]:
    """The lines in which triangles (n, 3, 3) meet a height: ends (k, 2, 2), and whose they are."""
    above = triangles[:, :, 2] > level
    cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    start, end = triangles[cut], np.roll(triangles[cut], -1, axis=1)
    crossed = above[cut] != np.roll(above[cut], -1, axis=1)  # two edges of each
    p, q = start[crossed], end[crossed]
    share = (level - p[:, 2]) / (q[:, 2] - p[:, 2])
    places = p[:, :2] + (q - p)[:, :2] * share[:, None]
    return places.reshape(-1, 2, 2), cut


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


def _plane(position: Array, turn: Array) -> Array:
    quad = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * PLANE @ turn.T + position
    return np.asarray(np.array([quad[[0, 1, 2]], quad[[0, 2, 3]]]))


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
