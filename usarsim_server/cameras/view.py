"""Values that the camera room hands around: the grid of tiles, frames, views and pinhole eyes.

Pixels are counted from the upper left corner of the full frame, x to the right, y down.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Pose, Vector, quaternion_from_rpy

Plane = NDArray[np.float32]
Picture = NDArray[np.uint8]
Mode = Literal["rgb", "depth", "segmentation"]

MODES: tuple[Mode, ...] = ("rgb", "depth", "segmentation")
MAX_PIXELS = 4096
"""Longest edge of a picture."""
MIN_FOV, MAX_FOV = math.radians(1.0), math.radians(170.0)


@dataclass(frozen=True, slots=True)
class Region:
    """A rectangle of pixels of the full frame."""

    x: int
    y: int
    width: int
    height: int

    @property
    def empty(self) -> bool:
        """Whether it has no pixels."""
        return self.width <= 0 or self.height <= 0

    def inside(self, width: int, height: int) -> bool:
        """Whether it has pixels and all of them lie in a picture of this size."""
        fits_x = self.x >= 0 and self.x + self.width <= width
        return not self.empty and fits_x and self.y >= 0 and self.y + self.height <= height

    def meets(self, other: Region) -> bool:
        """Whether the two have pixels in common."""
        apart_x = self.x + self.width <= other.x or other.x + other.width <= self.x
        apart_y = self.y + self.height <= other.y or other.y + other.height <= self.y
        return not (self.empty or other.empty or apart_x or apart_y)


@dataclass(frozen=True, slots=True)
class Grid:
    """How the full frame is divided into tiles, filled row by row (side channels 2.10)."""

    columns: int = 4  # number of tiles
    rows: int = 4
    tile_width: int = 320  # of one tile, pixels
    tile_height: int = 240

    @property
    def width(self) -> int:
        """Of the full frame, pixels."""
        return self.columns * self.tile_width

    @property
    def height(self) -> int:
        """Of the full frame, pixels."""
        return self.rows * self.tile_height

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows

    @property
    def frame(self) -> Region:
        """The full frame."""
        return Region(0, 0, self.width, self.height)

    def region(self, tile: int, size: tuple[int, int] | None = None) -> Region:
        """Where a tile lies, or a picture of a size (pixels) in its corner, cut down to it."""
        row, column = divmod(tile, self.columns)
        x, y = column * self.tile_width, row * self.tile_height
        width, height = size or (self.tile_width, self.tile_height)
        return Region(x, y, min(width, self.tile_width), min(height, self.tile_height))


@dataclass(frozen=True, slots=True)
class CameraView:
    """One live camera as the renderer needs to know it."""

    key: int  # number of the camera, never used again
    name: str  # item name on the wire
    owner: str  # label of the robot; empty for a spectator
    robot: int | None  # number of the robot in the simulation; None if it stands still in the world
    link: str | None  # link that carries it; None for the chassis
    pose: Pose  # relative to the link, chassis or world; it looks along x, y is left, z is up
    fov: float  # horizontal field of view, rad
    tile: int | None  # number of its tile; None if there was none left
    rate: float | None = None  # pictures per second of simulated time; None: as the server is set
    size: tuple[int, int] | None = None
    """Width and height of its pictures, pixels; None: those of the tile."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A picture of all tiles at one time; frames share the tiles that are the same in both.

    Pixels are (height, width, 3) uint8, red green blue, top row first, and read-only.
    """

    number: int  # grows with every frame
    time: float  # simulated time of its newest tile, s
    grid: Grid
    tiles: tuple[NDArray[np.uint8], ...]  # the pixels of every tile of the grid

    @classmethod
    def of(cls, number: int, time: float, pixels: NDArray[np.uint8]) -> Frame:
        """A frame of a single tile."""
        return cls(number, time, Grid(1, 1, pixels.shape[1], pixels.shape[0]), (pixels,))

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """All of it, put together."""
        return self.cut(self.grid.frame)

    def cut(self, region: Region) -> NDArray[np.uint8]:
        """The pixels of a region; copied only if it lies in several tiles.

        Raises:
            ValueError: if it is not inside the frame.
        """
        grid = self.grid
        if not region.inside(grid.width, grid.height):
            raise ValueError(f"{region} is not inside {grid.width} x {grid.height} pixels")
        row, top = divmod(region.y, grid.tile_height)
        column, left = divmod(region.x, grid.tile_width)
        below, right = top + region.height, left + region.width
        if below <= grid.tile_height and right <= grid.tile_width:
            return self.tiles[row * grid.columns + column][top:below, left:right]
        whole = np.empty((region.height, region.width, 3), np.uint8)
        for tile, pixels in enumerate(self.tiles):
            part = grid.region(tile)
            if part.meets(region):
                x, y = part.x - region.x, part.y - region.y
                target = whole[max(y, 0) : y + part.height, max(x, 0) : x + part.width]
                source = pixels[max(-y, 0) :, max(-x, 0) :]
                target[:] = source[: target.shape[0], : target.shape[1]]
        whole.flags.writeable = False
        return whole


class Watch(Protocol):
    """Somebody looks; tiles that nobody looks at are not rendered."""

    def look_at(self, region: Region) -> None:
        """Change what is looked at."""

    def close(self) -> None:
        """Look away; a second call does nothing."""


class FrameSource(Protocol):
    """Where pictures come from; every method returns at once and may be called by any thread."""

    @property
    def grid(self) -> Grid:
        """Geometry of the full frame."""

    def newest(self, region: Region) -> Frame | None:
        """The newest frame, if all tiles in the region that have a camera are up to date in it.

        None means: watch the region and a frame will come soon.
        """

    def watch(self, region: Region, on_frame: Callable[[Frame], None]) -> Watch:
        """Have a region rendered from now on.

        `on_frame` is told of every new frame, by the rendering thread; it must return at once.
        """


@dataclass(frozen=True, slots=True)
class View:
    """A picture that somebody wants of the world, from anywhere.

    Attributes:
        pose: of the camera in the world; it looks along x, y is left, z is up.
        fov: horizontal field of view, rad.
        width, height: pixels.
        cut: m; from above this height what is higher is not drawn, and what is solid there is dark.
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
    cut: float = math.inf

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
    pitch = -math.asin(max(-1.0, min(1.0, z)))
    return Pose(position, quaternion_from_rpy(0.0, pitch, yaw))


@dataclass(frozen=True, slots=True)
class Eye:
    """A pinhole camera with square pixels."""

    pose: Pose  # as in `View`
    fov: float  # horizontal field of view, rad
    width: int  # pixels
    height: int
    cut: float = math.inf  # as in `View`

    @property
    def cuts(self) -> bool:
        """Whether it is above its cut, so that it sees what is below only."""
        return self.pose.position[2] > self.cut

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
    """

    left: Plane  # (1, width) slope to the left of the viewing axis
    up: Plane  # (height, 1) slope upwards

    def lengths(self) -> Plane:
        """Metres of ray per metre of depth, (height, width)."""
        lengths: Plane = np.sqrt(1.0 + self.left**2 + self.up**2)
        return lengths

    def directions(self, rotation: Array) -> Plane:
        """(height, width, 3) world directions whose component along the viewing axis is 1."""
        forward, left, up = rotation.T.astype(np.float32)
        directions: Plane = forward + self.left[..., None] * left + self.up[..., None] * up
        return directions
