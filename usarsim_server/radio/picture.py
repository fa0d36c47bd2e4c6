"""Pictures of coverage: cells coloured by signal strength, walls, source and a scale."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from usarsim_server.radio.coverage import Coverage, Walls

__all__ = ["color_of", "draw_coverage", "pixels_per_cell"]

Pixels = NDArray[np.uint8]

WIDTH = 960
"""Pixels that the longer side is to have, about."""
FOOT = 46
"""Pixels below the map, for the scale."""
WALL = (20, 20, 20)
SOURCE = (215, 30, 30)
SILENCE = (190, 190, 190)
"""Where no link is up."""
_INK, _PAPER = (0, 0, 0), (255, 255, 255)

# From the cutoff to the strongest: the anchors of viridis (matplotlib, CC0), evenly spaced.
_SCALE = np.array(
    [(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], np.float64
)


def color_of(strengths: NDArray[np.float64], low: float, high: float) -> Pixels:
    """Colours (..., 3) of strengths (dBm) on a scale from `low` to `high`; grey below it."""
    known = np.nan_to_num(strengths, nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    part = np.clip((known - low) / max(high - low, 1e-9), 0.0, 1.0) * (len(_SCALE) - 1)
    below = np.minimum(part.astype(np.intp), len(_SCALE) - 2)
    mix = (part - below)[..., None]
    colors = _SCALE[below] * (1.0 - mix) + _SCALE[below + 1] * mix
    colors[known < low] = SILENCE
    rounded: Pixels = colors.round().astype(np.uint8)
    return rounded


def pixels_per_cell(coverage: Coverage) -> int:
    """Edge of a cell in pixels."""
    return max(1, WIDTH // max(coverage.grid.columns, coverage.grid.rows))


def draw_coverage(coverage: Coverage, walls: Walls, title: str) -> Image.Image:
    """Draw a map as seen from above, x of the wire to the right, y of the wire downwards.

    Args:
        coverage: strengths of the cells.
        walls: between them.
        title: stands below the map.
    """
    size = pixels_per_cell(coverage)
    finite = coverage.strengths[np.isfinite(coverage.strengths)]
    high = float(finite.max()) if finite.size else coverage.cutoff
    high = max(high, coverage.cutoff + 1.0)
    # Rows grow with y to the left of x, so the last one is on top.
    cells = color_of(coverage.strengths, coverage.cutoff, high)[::-1]
    field = np.repeat(np.repeat(cells, size, axis=0), size, axis=1)
    height, width = field.shape[:2]
    image = Image.new("RGB", (max(width, 320), height + FOOT), _PAPER)
    image.paste(Image.fromarray(field), (0, 0))
    draw = ImageDraw.Draw(image)
    _draw_walls(draw, walls, size, coverage.grid.rows)
    _draw_source(draw, coverage, size)
    _draw_foot(image, height, coverage.cutoff, high, title)
    return image


def _draw_walls(draw: ImageDraw.ImageDraw, walls: Walls, size: int, rows: int) -> None:
    thick = max(1, size // 3)
    for row, column in np.argwhere(walls.along_x).tolist():
        x, y = (column + 1) * size, (rows - 1 - row) * size
        draw.line([(x, y), (x, y + size)], WALL, thick)
    for row, column in np.argwhere(walls.along_y).tolist():
        x, y = column * size, (rows - 1 - row) * size
        draw.line([(x, y), (x + size, y)], WALL, thick)


def _draw_source(draw: ImageDraw.ImageDraw, coverage: Coverage, size: int) -> None:
    grid = coverage.grid
    x = ((coverage.source[0] - grid.x) / grid.cell + 0.5) * size
    y = (grid.rows - ((coverage.source[1] - grid.y) / grid.cell + 0.5)) * size
    draw.ellipse([x - 6, y - 6, x + 6, y + 6], SOURCE, _PAPER, 2)


def _draw_foot(image: Image.Image, top: int, low: float, high: float, title: str) -> None:
    draw, font = ImageDraw.Draw(image), ImageFont.load_default()
    bar = color_of(np.linspace(low, high, 180), low, high)
    image.paste(Image.fromarray(np.repeat(bar[None], 12, axis=0)), (70, top + 8))
    draw.rectangle([8, top + 8, 22, top + 19], SILENCE, _INK)
    draw.text((28, top + 8), "none", _INK, font)
    draw.text((70, top + 24), f"{low:.4g} dBm", _INK, font)
    draw.text((215, top + 24), f"{high:.4g}", _INK, font)
    draw.text((270, top + 8), title, _INK, font)
