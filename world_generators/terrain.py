"""Mobility obstacles after the standard test methods for response robots, in metres.

Names and angles follow ASTM E2803 (inclined planes), E2804 (stairs and landings), E2826 and E2827
(continuous and crossing pitch/roll ramps) and E2828 (symmetric step fields), as far as robots
reference 3.3 quotes them. Every function places one obstacle on level ground.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

from usarsim_exploration.worlds.mjcf import Scene, Vector, turned

POST = 0.1
"""Edge of a step field post, m (E2828)."""
FIELD_POSTS = 12
"""Posts along an edge of a step field (robots reference 3.3 V19)."""
RAMP_ANGLE = 15.0
"""Slope of pitch/roll ramps, degrees (E2826, E2827)."""

Heights = tuple[tuple[float, ...], ...]


def ramp_rise(length: float, angle: float = RAMP_ANGLE) -> float:
    """Height that a slope of this horizontal length gains, m; angle in degrees."""
    return length * math.tan(math.radians(angle))


def symmetric_heights(seed: str, levels: Sequence[float], size: int = FIELD_POSTS) -> Heights:
    """Draw a field of post heights that looks the same from both ends.

    Rows of the result run along x. A half turn maps the field onto itself, so a robot meets the
    same terrain in both directions.
    """
    draw = random.Random(seed)
    flat = [levels[int(draw.random() * len(levels))] for _ in range((size * size + 1) // 2)]
    flat += reversed(flat[: size * size - len(flat)])
    return tuple(tuple(flat[row * size : (row + 1) * size]) for row in range(size))


def step_field(
    scene: Scene, prefix: str, corner: tuple[float, float], heights: Heights, woods: Sequence[str]
) -> None:
    """Set up posts from the corner with the smallest x and y; height 0 leaves bare floor.

    `woods` are materials for rising heights, so that the relief can be read from above.
    """
    highest = max(max(row) for row in heights)
    for i, row in enumerate(heights):
        for j, height in enumerate(row):
            if height <= 0.0:
                continue
            center = (corner[0] + (i + 0.5) * POST, corner[1] + (j + 0.5) * POST, height / 2)
            wood = woods[min(len(woods) - 1, int(len(woods) * (height - 1e-9) / highest))]
            scene.box(prefix, center, (POST, POST, height), wood, role="ground")


def crossing_ramps(
    scene: Scene,
    prefix: str,
    corner: tuple[float, float],
    cells: tuple[int, int],
    materials: tuple[str, str],
    cell: tuple[float, float] = (1.2, 0.6),
) -> None:
    """Fill a rectangle with ramps of which neighbours rise in opposite directions (E2827)."""
    length, width = cell
    rise = ramp_rise(length)
    for i in range(cells[0]):
        for j in range(cells[1]):
            up = (i + j) % 2 == 0
            x = corner[0] + (i if up else i + 1) * length
            y = corner[1] + (j + 0.5) * width
            yaw = 0.0 if up else 180.0
            scene.ramp(prefix, (x, y), cell, rise, materials[(i + j) % 2], yaw=yaw)


def continuous_ramps(
    scene: Scene,
    prefix: str,
    corner: tuple[float, float],
    ridges: int,
    width: float,
    materials: tuple[str, str],
    *,
    half: float = 1.2,
) -> None:
    """Lay ridges across the way, one behind the other along x, without steps (E2826).

    Every ridge is two ramps of horizontal length `half`, `width` wide.
    """
    rise = ramp_rise(half)
    y = corner[1] + width / 2
    for ridge in range(ridges):
        for foot, yaw, material in ((0, 0.0, materials[0]), (2, 180.0, materials[1])):
            x = corner[0] + (2 * ridge + foot) * half
            scene.ramp(prefix, (x, y), (half, width), rise, material, yaw=yaw)


def valley(
    scene: Scene,
    prefix: str,
    corner: tuple[float, float],
    length: float,
    materials: tuple[str, str],
    *,
    half: float = 1.2,
) -> None:
    """Lay a valley along x whose sides rise to the left and right, so that robots roll (E2826)."""
    low = (corner[0] + length / 2, corner[1] + half)
    for yaw, material in ((90.0, materials[0]), (-90.0, materials[1])):
        scene.ramp(prefix, low, (half, length), ramp_rise(half), material, yaw=yaw)


def stairs(
    scene: Scene,
    prefix: str,
    foot: tuple[float, float],
    steps: int,
    size: tuple[float, float, float],
    material: str,
    *,
    climb: float = 1.0,
) -> None:
    """Build solid steps of (tread, width, rise), from the middle of the lower edge.

    `climb` is +1 for stairs that climb toward +x and -1 for the other direction.
    """
    tread, width, rise = size
    for step in range(steps):
        near, far = (foot[0] + climb * tread * n for n in (step, step + 1))
        lower = (near, foot[1] - width / 2, 0.0)
        upper = (far, foot[1] + width / 2, rise * (step + 1))
        scene.block(prefix, lower, upper, material, role="ground")


def incline(
    scene: Scene, prefix: str, foot: Vector, size: tuple[float, float], angle: float, material: str
) -> None:
    """Lean a thick board against nothing: an inclined plane that climbs toward +x.

    Args:
        scene: receives the board.
        prefix: start of the name.
        foot: middle of the line where the slope leaves the ground.
        size: length along the slope and width, m.
        angle: degrees.
        material: of the board.
    """
    thickness, buried = 0.3, 0.4
    slope = math.radians(angle)
    length = size[0] + buried
    forward = (math.cos(slope), math.sin(slope))
    middle = length / 2 - buried
    x = foot[0] + middle * forward[0] + thickness / 2 * forward[1]
    z = foot[2] + middle * forward[1] - thickness / 2 * forward[0]
    scene.box(
        prefix,
        (x, foot[1], z),
        (length, size[1], thickness),
        material,
        quat=turned(pitch=-angle),
        role="ground",
    )
