"""Colours for pictures that are cast with rays: surfaces, lights and sky of a model."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.view import Picture, Plane

BLUR_GAIN, BLUR_START = np.float32(4.0), np.float32(0.5)
"""A texture begins to blur where a pixel holds an eighth of it, and is gone at three eighths."""

_FACES = (
    # Of a cube map, in the order of the texture: axis that points out, then right and up of the
    # picture (MuJoCo: right, left, up, down, front, back, seen from inside, y up).
    ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
    ((0, 1, 0), (1, 0, 0), (0, 0, -1)),
    ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    ((0, 0, -1), (-1, 0, 0), (0, 1, 0)),
)


class Paint:
    """What everything in one model is painted with.

    Attributes:
        colors: (ngeom + 1, 3) from 0 to 1, textures by their mean; the last is for no geom.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        rgba = model.geom_rgba.copy()
        for geom in range(model.ngeom):
            material = int(model.geom_matid[geom])
            if material < 0:
                continue
            # A colour of its own goes before that of the material, as in MuJoCo.
            own = not np.array_equal(model.geom_rgba[geom], PLAIN)
            color = model.geom_rgba[geom] if own else model.mat_rgba[material]
            rgba[geom] = color
            texture = self._texture(material)
            if texture >= 0:
                rgba[geom, :3] = color[:3] * self._image(texture).mean(axis=(0, 1))[:3] / 255.0
        self.colors = np.vstack([rgba[:, :3], np.zeros(3)]).astype(np.float32)
        self._tiles = {
            geom: self._image(self._texture(int(model.geom_matid[geom])))
            for geom in range(model.ngeom)
            if self._is_floor(geom)
        }
        self._sky = self._sky_faces()

    def floors(self) -> tuple[int, ...]:
        """Geoms whose texture is worth the work: large level ones, by which one sees motion."""
        return tuple(self._tiles)

    def texels(self, geom: int, places: Plane, widths: Plane) -> Plane:
        """Colours (n, 3) of a floor: its texture, and its mean where a pixel holds too much of it.

        Args:
            geom: one of `floors`.
            places: (n, 2) m from its middle, in its own frame.
            widths: (n,) m of floor that one pixel covers.
        """
        model = self._model
        image = self._tiles[geom]
        material = int(model.geom_matid[geom])
        # MuJoCo repeats over two units, or over the two half sizes of the geom.
        repeat = model.mat_texrepeat[material] / 2.0
        size = model.geom_size[geom, :2]
        if not model.mat_texuniform[material] and (size > 0.0).all():
            repeat = repeat / size
        height, width = image.shape[:2]
        # Both axes of a texture begin at a corner of the tile whose middle is that of the geom.
        s = (places[:, 0] * repeat[0] + 0.5) % 1.0
        t = (-places[:, 1] * repeat[1] + 0.5) % 1.0
        column = np.minimum((s * width).astype(np.intp), width - 1)
        row = np.minimum((t * height).astype(np.intp), height - 1)
        color = model.mat_rgba[material, :3].astype(np.float32)
        found: Plane = image[row, column, :3].astype(np.float32) / np.float32(255.0) * color
        blur = np.clip(widths * np.float32(repeat.max()) * BLUR_GAIN - BLUR_START, 0.0, 1.0)
        found += blur[:, None] * (self.colors[geom] - found)
        return found

    def sky(self, directions: Plane) -> Plane:
        """Colours (n, 3) of the sky, from 0 to 1, in world directions (n, 3)."""
        colors = np.zeros((len(directions), 3), np.float32)
        if self._sky is None:
            return colors
        # A skybox has y for its height.
        seen = np.stack([directions[:, 0], directions[:, 2], -directions[:, 1]], axis=1)
        face = _face_of(seen)
        for number, (out, right, up) in enumerate(_FACES):
            chosen = face == number
            if not chosen.any():
                continue
            axes = np.array([out, right, up], np.float32)
            depth, across, upward = (seen[chosen] @ axes.T).T
            image = self._sky[number]
            size = image.shape[0]
            column = ((across / depth + 1.0) / 2.0 * size).astype(np.intp).clip(0, size - 1)
            row = ((1.0 - upward / depth) / 2.0 * size).astype(np.intp).clip(0, size - 1)
            colors[chosen] = image[row, column, :3].astype(np.float32) / np.float32(255.0)
        return colors

    def _texture(self, material: int) -> int:
        roles = self._model.mat_texid[material]
        texture = int(roles[mujoco.mjtTextureRole.mjTEXROLE_RGB])
        return texture if texture >= 0 else int(roles[mujoco.mjtTextureRole.mjTEXROLE_RGBA])

    def _image(self, texture: int) -> Picture:
        model = self._model
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        channels = int(model.tex_nchannel[texture])
        start = int(model.tex_adr[texture])
        image: Picture = model.tex_data[start : start + height * width * channels].reshape(
            height, width, channels
        )
        return image if channels >= 3 else np.repeat(image[..., :1], 3, axis=2)

    def _is_floor(self, geom: int) -> bool:
        model = self._model
        material = int(model.geom_matid[geom])
        if material < 0 or model.body_weldid[model.geom_bodyid[geom]] != 0:
            return False
        texture = self._texture(material)
        if texture < 0 or model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D:
            return False
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            return True
        box = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX
        return bool(box and (model.geom_size[geom, :2] > 0.5).all())

    def _sky_faces(self) -> list[Picture] | None:
        model = self._model
        for texture in range(model.ntex):
            if model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_SKYBOX:
                continue
            image = self._image(texture)
            size = image.shape[1]
            count = image.shape[0] // size
            return [image[size * min(n, count - 1) :][:size] for n in range(6)]
        return None


PLAIN = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
"""Colour of a geom that was given none."""


def _face_of(directions: Plane) -> NDArray[np.intp]:
    axis = np.abs(directions).argmax(axis=1)
    negative = np.take_along_axis(directions, axis[:, None], axis=1)[:, 0] < 0.0
    face: NDArray[np.intp] = 2 * axis + negative
    return face


def light_up(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    normals: Plane,
    directions: Plane,
    depths: Plane,
    origin: Plane,
) -> Plane:
    """Light (n, 3) on surfaces, 1 being white at full strength: OpenGL's formula without gloss.

    Args:
        model: whose lights. data: where they are.
        normals: (n, 3) unit vectors, towards the viewer or away.
        directions: (n, 3) of view, of any length.
        depths: (n,) in units of their lengths.
        origin: (3,) of the viewer, m.
    """
    slopes = np.einsum("ij,ij->i", normals, directions)
    sides = np.where(slopes > 0.0, np.float32(-1.0), np.float32(1.0))
    ambient = np.zeros(3, np.float32)
    shares: list[Plane] = []
    tints: list[NDArray[np.float32]] = []
    head = model.vis.headlight
    if head.active:
        ambient += np.asarray(head.ambient, np.float32)
        shares.append(np.abs(slopes) / np.sqrt(np.einsum("ij,ij->i", directions, directions)))
        tints.append(np.asarray(head.diffuse, np.float32))
    for number in np.flatnonzero(model.light_active[: model.nlight]).tolist():
        diffuse = model.light_diffuse[number].astype(np.float32)
        if model.light_type[number] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL:
            ambient += model.light_ambient[number].astype(np.float32)
            axis = data.light_xdir[number].astype(np.float32)
            shares.append(np.maximum(-(normals @ axis) * sides, 0.0))
            tints.append(diffuse)
            continue
        points = origin + depths[:, None] * directions
        strength, facing = _lamp(model, data, number, points, normals)
        shares += [strength, strength * np.maximum(facing * sides, 0.0)]
        tints += [model.light_ambient[number].astype(np.float32), diffuse]
    if not shares:
        return np.broadcast_to(ambient, normals.shape)
    return np.stack(shares, axis=1) @ np.stack(tints) + ambient


def _lamp(
    model: mujoco.MjModel, data: mujoco.MjData, number: int, points: Plane, normals: Plane
) -> tuple[Plane, Plane]:
    """What is left (n,) of a light that has a place, and the cosine (n,) at which it meets."""
    away = points - data.light_xpos[number].astype(np.float32)
    distance = np.maximum(np.linalg.norm(away, axis=1), np.float32(1e-6))
    constant, linear, square = model.light_attenuation[number].tolist()
    strength = 1.0 / np.maximum(constant + linear * distance + square * distance**2, 1e-6)
    if model.light_type[number] == mujoco.mjtLightType.mjLIGHT_SPOT:
        axis = data.light_xdir[number].astype(np.float32)
        along = (away @ axis) / distance
        inside = along > math.cos(math.radians(float(model.light_cutoff[number])))
        exponent = float(model.light_exponent[number])
        strength = strength * np.where(inside, np.maximum(along, 0.0) ** exponent, 0.0)
    facing = -np.einsum("ij,ij->i", normals, away) / distance
    return strength.astype(np.float32), facing
