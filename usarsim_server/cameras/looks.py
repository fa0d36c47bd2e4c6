"""What pictures get after geometry and light of the world are in: headlights, smoke, haze.

All of it works on colours and depths, so it looks the same whoever rendered them, and costs
nothing where there is none. Arithmetic is in single precision on whole pictures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from usarsim_server.cameras.view import Eye, Picture, Plane, Rays
from usarsim_server.simulation.frames import Array, Pose
from usarsim_server.worlds.description import Smoke, SmokeVolume
from usarsim_server.worlds.smoke import SmokeField

BEAM_INNER, BEAM_OUTER = math.radians(18.0), math.radians(34.0)
"""Half angles of a headlight's cone: full brightness inside, none outside."""
BEAM_GAIN = 0.8
"""Brightness that a headlight adds to a white surface right before it."""
BEAM_HALF = 5.0
"""m at which half of that is left."""
BEAM_REACH = 25.0
"""m beyond which a headlight is not seen any more."""

FAR_AWAY = np.float32(1e6)
"""m: stands for the distance of the sky."""

SMOKE_GREY = (0.66, 0.66, 0.67)
"""Colour of smoke in a world as bright as white paper; light is scattered, not swallowed."""
SKY_DEPTH = 500.0
"""m of air before the sky."""
PARTICLE_DENSITY = 9.0
"""1/m through particles of local smoke: 90 % of the light stops in one of 0.128 m radius."""
MOST_PARTICLES = 1000
"""Particles drawn of one view, the nearest ones; behind so many nothing is seen anyway."""


def reaching(lamps: Sequence[Pose], eye: Eye) -> tuple[Pose, ...]:
    """Those headlights (see `Stage.lamps`) that may shine on anything an eye sees."""
    back = eye.pose.inverse()
    return tuple(lamp for lamp in lamps if (back @ lamp).position[0] > -BEAM_REACH)


def shine(
    colors: Picture, albedo: Picture, depth: Plane, eye: Eye, lamps: Sequence[Pose]
) -> Picture:
    """A picture with the light of headlights added.

    A surface gets the cosine of the angle at which the light meets it, the lamp's brightness in
    that direction and what distance leaves of it; headlights throw no shadows.

    Args:
        colors: (h, w, 3). albedo: (h, w, 3), the same in white light. depth: (h, w) m.
        eye: that sees it.
        lamps: that may shine on it.
    """
    rays = eye.rays()
    sky = ~np.isfinite(depth)
    finite = np.where(sky, FAR_AWAY, depth)
    normals = _normals(finite, rays)
    light = np.zeros(depth.shape, np.float32)
    for lamp in lamps:
        light += _light_of(lamp, eye, rays, finite, normals)
    light[sky] = 0.0
    sum_ = albedo * light[..., None] + colors
    shone: Picture = np.minimum(sum_, 255.0).astype(np.uint8)
    return shone


def _normals(depth: Plane, rays: Rays) -> tuple[Plane, Plane, Plane]:
    """Vectors (not of unit length) into the surfaces, in the frame of the eye.

    On a plane n . P = c with P = d (1, y, z) the inverse depth is n . (1, y, z) / c, so the normal
    follows from its slopes over the picture.
    """
    inverse = 1.0 / depth
    by_left = np.gradient(inverse, axis=1) / np.float32(_step(rays.left[0]))
    by_up = np.gradient(inverse, axis=0) / np.float32(_step(rays.up[:, 0]))
    forward = inverse - rays.left * by_left - rays.up * by_up
    return forward, by_left, by_up


def _step(values: Plane) -> float:
    return float(values[1] - values[0]) if len(values) > 1 else 1.0


def _light_of(
    lamp: Pose, eye: Eye, rays: Rays, depth: Plane, normals: tuple[Plane, Plane, Plane]
) -> Plane:
    """Irradiance (h, w) from one lamp, 1 being white light at full strength."""
    place = eye.pose.inverse() @ lamp
    lx, ly, lz = place.position
    ahead = place.rotate((1.0, 0.0, 0.0))
    # From the lamp to the surfaces, in the frame of the eye.
    x, y, z = depth - np.float32(lx), depth * rays.left - np.float32(ly), depth * rays.up - lz
    square = x * x + y * y + z * z + np.float32(1e-6)
    distance = np.sqrt(square)
    along = (x * ahead[0] + y * ahead[1] + z * ahead[2]) / distance
    inner, outer = math.cos(BEAM_INNER), math.cos(BEAM_OUTER)
    cone = np.clip((along - outer) / (inner - outer), 0.0, 1.0)
    nx, ny, nz = normals
    facing = (x * nx + y * ny + z * nz) / (distance * np.sqrt(nx * nx + ny * ny + nz * nz))
    light = BEAM_GAIN * cone * np.clip(facing, 0.0, 1.0) / (1.0 + square / BEAM_HALF**2)
    light *= np.clip((BEAM_REACH - distance) / (0.2 * BEAM_REACH), 0.0, 1.0)
    lit: Plane = light.astype(np.float32)
    return lit


def brightness(model: mujoco.MjModel) -> float:
    """How bright a world is by its lights, from 0 to 1: what its smoke scatters."""
    lights = model.nlight
    ambient = float(np.mean(model.vis.headlight.ambient)) if model.vis.headlight.active else 0.0
    active = model.light_active[:lights].astype(bool)
    ambient += float(model.light_ambient[:lights][active].mean(axis=1).sum()) if lights else 0.0
    diffuse = float(model.light_diffuse[:lights][active].mean(axis=1).sum()) if lights else 0.0
    return min(1.0, ambient + 0.7 * diffuse)


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """One picture's rays in the world."""

    eye: Eye
    rays: Rays
    rotation: Array
    lengths: Plane
    depth: Plane

    def along(self, direction: Array) -> Plane:
        """Component of the rays along a world direction (or any linear form of them), (h, w)."""
        forward, left, up = (direction @ self.rotation).astype(np.float32).tolist()
        ahead = np.float32(forward) + np.float32(left) * self.rays.left
        return ahead + np.float32(up) * self.rays.up


Particles = Callable[[float], tuple[Array, Array]]
"""Centres (k, 3) and radii (k,) of opaque balls, m, at a simulated time, s."""


class Air:
    """The smoke and haze of a world, as they look; immutable, for any thread."""

    def __init__(self, smoke: Smoke, particles: Particles | None = None) -> None:
        """particles: what tells where opaque ones are; None: the clouds of the smoke do."""
        self._volumes = smoke.volumes
        self._haze, self._top = smoke.haze, smoke.haze_top
        self._radii: Particles = particles or SmokeField(smoke).particles
        self._puffs = bool(smoke.puffs) or particles is not None
        self.clear = smoke.clear and particles is None

    def veil(self, colors: Picture, depth: Plane, eye: Eye, time: float, light: float) -> Picture:
        """A picture as it looks through the smoke.

        Args:
            colors: (h, w, 3). depth: (h, w) m along the viewing axis, infinity for the sky.
            eye, time: that sees it, and when (simulated s), for the particles.
            light: brightness of the world (see `brightness`).
        """
        thickness = self.thickness(depth, eye, time)
        if not thickness.any():
            return colors
        left = np.exp(-thickness)[..., None]
        grey = np.array(SMOKE_GREY, np.float32) * np.float32(255.0 * light)
        veiled: Picture = (grey + (colors - grey) * left + np.float32(0.5)).astype(np.uint8)
        return veiled

    def thickness(self, depth: Plane, eye: Eye, time: float) -> Plane:
        """Optical depth (h, w) of the air before every pixel."""
        rays = eye.rays()
        lengths = rays.lengths()
        ends = np.where(np.isfinite(depth), depth, SKY_DEPTH / lengths).astype(np.float32)
        sight = _Sight(eye, rays, eye.pose.matrix(), lengths, ends)
        total = np.zeros(depth.shape, np.float32)
        for volume in self._volumes:
            if _in_view(volume, eye):
                total += np.float32(volume.density) * _way_through(volume, sight)
        if self._haze:
            total += np.float32(self._haze) * _way_below(self._top, sight)
        if self._puffs:
            _add_particles(total, *self._radii(time), sight)
        return total


def _in_view(volume: SmokeVolume, eye: Eye) -> bool:
    radius = float(np.linalg.norm(volume.size)) / 2.0
    x, y, z = (eye.pose.inverse() @ volume.pose).position
    if x < -radius:
        return False
    slope = eye.slope
    sideways = (abs(y) - slope * x) / math.hypot(1.0, slope)
    slope *= eye.height / eye.width
    upwards = (abs(z) - slope * x) / math.hypot(1.0, slope)
    return sideways < radius and upwards < radius


def _way_through(volume: SmokeVolume, sight: _Sight) -> Plane:
    """Metres (h, w) of every ray inside a volume and before what the ray meets."""
    # In its own frame the volume reaches from -1 to 1 along each axis.
    to_unit = volume.pose.matrix().T / (np.array(volume.size)[:, None] / 2.0)
    start = to_unit @ np.subtract(sight.eye.pose.position, volume.pose.position)
    ways = [sight.along(to_unit[axis]) for axis in range(3)]
    enter, leave = (_cube if volume.shape == "box" else _ball)(start, ways)
    inside = np.minimum(leave, sight.depth) - np.maximum(enter, 0.0)
    metres: Plane = np.maximum(inside, 0.0) * sight.lengths
    return metres


def _cube(start: Array, ways: Sequence[Plane]) -> tuple[Plane, Plane]:
    """Depths (h, w) at which rays enter and leave the cube from -1 to 1."""
    enter: Plane = np.full(ways[0].shape, -np.inf, np.float32)
    leave: Plane = np.full(ways[0].shape, np.inf, np.float32)
    for place, way in zip(start, ways, strict=True):
        way[np.abs(way) < 1e-9] = 1e-9
        one, other = np.float32(-1.0 - place) / way, np.float32(1.0 - place) / way
        np.maximum(enter, np.minimum(one, other), out=enter)
        np.minimum(leave, np.maximum(one, other), out=leave)
    return enter, leave


def _ball(start: Array, ways: Sequence[Plane]) -> tuple[Plane, Plane]:
    """The same for the ball of radius 1; where a ray passes it, it enters where it leaves."""
    square, middle = np.zeros_like(ways[0]), np.zeros_like(ways[0])
    for place, way in zip(start, ways, strict=True):
        square += way * way
        middle -= np.float32(place) * way
    middle /= square
    half = middle * middle - np.float32(start @ start - 1.0) / square
    half = np.sqrt(np.maximum(half, np.float32(0.0)))
    return middle - half, middle + half


def _way_below(top: float, sight: _Sight) -> Plane:
    """Metres (h, w) of every ray below a height and before what the ray meets."""
    if math.isinf(top):
        return sight.depth * sight.lengths
    climb = sight.along(np.array([0.0, 0.0, 1.0]))
    climb[np.abs(climb) < 1e-9] = 1e-9
    crossing = np.float32(top - sight.eye.pose.position[2]) / climb
    rising = climb > 0.0
    enter = np.where(rising, 0.0, np.maximum(crossing, 0.0))
    leave = np.where(rising, np.minimum(crossing, sight.depth), sight.depth)
    below: Plane = np.maximum(leave - enter, 0.0) * sight.lengths
    return below.astype(np.float32)


def _add_particles(total: Plane, centres: Array, radii: Array, sight: _Sight) -> None:
    """Add the optical depth of particles to a picture, each where its disc appears."""
    places = (centres - sight.eye.pose.position) @ sight.rotation
    near = np.argsort(places[:, 0], kind="stable")
    near = near[places[near, 0] > 0.5 * radii[near]][:MOST_PARTICLES]
    left, up = sight.rays.left[0], sight.rays.up[:, 0]
    for (x, y, z), radius in zip(places[near].tolist(), radii[near].tolist(), strict=True):
        reach = radius / x
        columns, rows = _span(left, y / x, reach), _span(up, z / x, reach)
        if columns.start >= columns.stop or rows.start >= rows.stop:
            continue
        aside = ((left[columns] - np.float32(y / x)) / np.float32(reach)) ** 2
        above = ((up[rows] - np.float32(z / x)) / np.float32(reach)) ** 2
        chord = 1.0 - (above[:, None] + aside[None, :])
        # Half hidden where it stands half in a wall.
        free = (sight.depth[rows, columns] - np.float32(x - radius)) / np.float32(2.0 * radius)
        peak = np.float32(2.0 * radius * PARTICLE_DENSITY)
        total[rows, columns] += peak * np.maximum(chord, 0.0) * np.clip(free, 0.0, 1.0)


def _span(slopes: Plane, middle: float, reach: float) -> slice:
    """Indices of falling, evenly spaced slopes that are within reach of a middle."""
    step = _step(slopes)
    first = math.ceil((middle + reach - float(slopes[0])) / step)
    last = math.floor((middle - reach - float(slopes[0])) / step)
    return slice(max(0, first), max(0, min(len(slopes), last + 1)))
