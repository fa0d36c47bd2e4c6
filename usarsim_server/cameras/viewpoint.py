"""Where pictures are taken from: cameras of spectators, and pinhole eyes as renderers see them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Pose, Vector

__all__ = ["MAX_PIXELS", "MODES", "Eye", "Mode", "Rays", "View", "looking"]

Array = NDArray[np.float64]
Plane = NDArray[np.float32]

Mode = Literal["rgb", "depth", "segmentation"]
MODES: tuple[Mode, ...] = ("rgb", "depth", "segmentation")

MAX_PIXELS = 4096
"""Longest edge of a picture."""
MIN_FOV, MAX_FOV = math.radians(1.0), math.radians(170.0)


@dataclass(frozen=True, slots=True)
class View:
    """A picture that somebody wants of the world, from anywhere.

    Attributes:
        pose: of the camera in the world; it looks along x, y is left, z is up.
        fov: horizontal field of view, rad.
        width, height: pixels.
        mode: `rgb` gives (height, width, 3) uint8; `depth` gives (height, width) float32, metres
            along the viewing axis, infinity where there is nothing; `segmentation` gives
            (height, width) int32, numbers of geoms in the compiled model, -1 where there is none.

    Raises:
        ValueError: if the size or the field of view is impossible.
    """

    pose: Pose
    fov: float = math.radians(80.0)
    width: int = 640
    height: int = 480
    mode: Mode = "rgb"

    def __post_init__(self) -> None:
        if not (1 <= self.width <= MAX_PIXELS and 1 <= self.height <= MAX_PIXELS):
            raise ValueError(
                f"a picture of {self.width} x {self.height} pixels (1 to {MAX_PIXELS} each way)"
            )
        if not MIN_FOV <= self.fov <= MAX_FOV:
            raise ValueError(f"a field of view of {math.degrees(self.fov):g} degrees (1 to 170)")
        if self.mode not in MODES:
            raise ValueError(f"mode {self.mode!r} (one of {', '.join(MODES)})")


def looking(position: Vector, target: Vector) -> Pose:
    """Pose of an upright camera at a position (m) that looks at a target (m).

    Looking straight up or down, the upper edge of the picture is where x points.

    Raises:
        ValueError: if the two are the same place or not finite.
    """
    away = np.subtract(target, position)
    length = float(np.linalg.norm(away))
    if not math.isfinite(length) or length < 1e-9:
        raise ValueError("position and target of a view must be two places")
    x, y, z = (away / length).tolist()
    yaw = math.atan2(y, x) if math.hypot(x, y) > 1e-9 else 0.0
    half_yaw, half_pitch = yaw / 2.0, -math.asin(max(-1.0, min(1.0, z))) / 2.0
    cy, sy, cp, sp = *_cos_sin(half_yaw), *_cos_sin(half_pitch)
    return Pose(position, (cy * cp, -sy * sp, cy * sp, sy * cp))


def _cos_sin(angle: float) -> tuple[float, float]:
    return math.cos(angle), math.sin(angle)


@dataclass(frozen=True, slots=True)
class Eye:
    """A pinhole camera with square pixels.

    Attributes:
        pose: as in `View`.
        fov: horizontal field of view, rad.
        width, height: pixels.
    """

    pose: Pose
    fov: float
    width: int
    height: int

    @property
    def slope(self) -> float:
        """Tangent of half the horizontal field of view."""
        return math.tan(self.fov / 2.0)

    def rays(self) -> Rays:
        """Directions through the middles of all pixels."""
        step = 2.0 * self.slope / self.width
        across = (self.width / 2.0 - 0.5 - np.arange(self.width)) * step
        upward = (self.height / 2.0 - 0.5 - np.arange(self.height)) * step
        return Rays(across.astype(np.float32)[None, :], upward.astype(np.float32)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """The bundle of rays of an eye, in its own frame: pixel (v, u) looks along (1, left, up).

    A point at depth d (metres along the viewing axis) is d times that away.

    Attributes:
        left: (1, width) slope to the left of the viewing axis.
        up: (height, 1) slope upwards.
    """

    left: Plane
    up: Plane

    def lengths(self) -> Plane:
        """Metres of ray per metre of depth, (height, width)."""
        lengths: Plane = np.sqrt(1.0 + self.left**2 + self.up**2)
        return lengths

    def directions(self, rotation: Array) -> Plane:
        """(height, width, 3) world directions whose component along the viewing axis is 1."""
        forward, left, up = rotation.T.astype(np.float32)
        directions: Plane = forward + self.left[..., None] * left + self.up[..., None] * up
        return directions
