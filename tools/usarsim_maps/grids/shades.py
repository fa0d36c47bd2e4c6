"""Brightness of the pixels of a map's picture, and what they mean.

The one place where pictures of maps are read: for `usarsim import`, `usarsim serve` and
`usarsim explore`. Arrays are (rows, columns) with the top row first. Brightness goes from 0, black,
to 1, white.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.files import open_picture

Mask: TypeAlias = NDArray[np.bool_]
Levels: TypeAlias = NDArray[np.float64]

Mode: TypeAlias = Literal["trinary", "scale", "raw"]
MODES: tuple[Mode, ...] = get_args(Mode)
"""Ways of map servers to read a picture."""

MAX_CELLS = 64 << 20
"""Pixels of the largest picture of a map."""

UNSEEN = 205
"""Grey, of 255, of unknown cells in pictures that map servers save."""

HALF = 0.5
"""Walls are darker in a picture of one brightness."""

CONTRAST = 0.08
"""Smallest difference of brightness between walls and floor; less is noise."""

SURE = 100
"""So many cells lighter than unknown ones, and those of the grey of unknown ones are doubtful."""

NEAR = 0.25
"""Two groups of brightness are one if they differ by less than this part of the whole range."""


@dataclass(frozen=True, eq=False)
class Shades:
    """The pixels of a picture.

    Attributes:
        brightness: mean of red, green and blue.
        alpha: from 0, transparent, to 1, opaque; None for a picture without transparency.
    """

    brightness: Levels
    alpha: Levels | None = None

    @cached_property
    def levels(self) -> NDArray[np.int16]:
        """Brightness as whole numbers from 0 to 255."""
        return np.asarray(np.round(self.brightness * 255.0), dtype=np.int16)


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """What the pixels of a picture mean.

    Attributes:
        walls: occupied cells.
        free: cells that are known to be free; some cells may be neither.
        doubtful: free cells that have the grey of unknown ones, in a picture with lighter cells.
        notes: what a user should know of the choice.
    """

    walls: Mask
    free: Mask
    doubtful: Mask
    notes: tuple[str, ...] = ()


def read_shades(path: Path) -> Shades:
    """The pixels of a picture file of any mode.

    Raises:
        MapImportError: the file is no picture, is damaged, or has too many pixels.
    """
    with open_picture(path, str(path), MAX_CELLS) as image:
        if image.mode.startswith("I") or image.mode == "F":
            return Shades(_deep(np.array(image, dtype=np.float64)))
        clear = image.mode in ("LA", "La", "PA", "RGBA", "RGBa") or "transparency" in image.info
        # Only some modes can be turned into RGBA directly.
        plain = image if image.mode in ("1", "L", "LA", "P", "PA", "RGB", "RGBA") else None
        pixels = np.array((plain or image.convert("RGB")).convert("RGBA"), dtype=np.uint8)
    brightness = np.asarray(pixels[:, :, :3].mean(axis=2) / 255.0)
    return Shades(brightness, pixels[:, :, 3] / 255.0 if clear else None)


def _deep(samples: Levels) -> Levels:
    """Brightness of samples of 16 bits, of whole numbers up to 255, or of floats up to 1."""
    samples = np.clip(np.nan_to_num(samples), 0.0, None)
    largest = float(samples.max(initial=0.0))
    whole = bool((samples == np.floor(samples)).all())
    white = 1.0 if largest <= 1.0 and not whole else 255.0 if largest <= 255.0 else 65535.0
    return np.asarray(np.minimum(samples / white, 1.0))


def map_server_cells(
    shades: Shades, mode: Mode, negate: bool, occupied: float, free: float
) -> Cells:
    """Cells by the formulas of map servers (ROS 2's `nav2_map_server`).

    Dark is occupied; `negate` turns that round. In mode `trinary` alpha counts as one more channel
    of the mean; in `scale` cells that are not wholly opaque are unknown; in `raw` brightness times
    255 is the percentage, above 100 unknown.

    Args:
        shades: of the picture.
        mode: how to read it.
        negate: whether bright is occupied; without effect in mode `raw`.
        occupied: probability above which a cell is a wall.
        free: probability below which a cell is free.
    """
    brightness = shades.brightness
    known = np.ones(brightness.shape, dtype=bool)
    if mode == "raw":
        percent = np.round(brightness * 255.0)
        known = np.asarray(percent <= 100.0)
        chance = percent / 100.0
    else:
        if mode == "scale" and shades.alpha is not None:
            known = np.asarray(shades.alpha >= 1.0)
        elif shades.alpha is not None:
            brightness = (3.0 * brightness + shades.alpha) / 4.0
        chance = brightness if negate else 1.0 - brightness
    walls = np.asarray(known & (chance > occupied))
    open_ = np.asarray(known & (chance < max(free, 1e-6)) & ~walls)
    doubtful = np.zeros(walls.shape, dtype=bool)
    if mode != "raw":
        darkness = shades.levels if negate else 255 - shades.levels
        lighter = open_ & (darkness < 255 - UNSEEN)
        if int(lighter.sum()) >= SURE:
            doubtful = np.asarray(open_ & (darkness == 255 - UNSEEN))
    notes = []
    if doubtful.any():
        notes.append(
            f"{int(doubtful.sum())} cells of the grey of unknown ones are free by free_thresh, "
            f"{free:g}; nothing starts there"
        )
    return Cells(walls, open_, doubtful, tuple(notes))


def picture_cells(shades: Shades) -> Cells:
    """Cells of a picture that comes without a word about what its pixels mean.

    Walls are dark, and what is wholly transparent is unknown. How dark, the picture itself says:
    its brightness falls into up to three groups (`_groups`), and walls are the darkest, or the two
    that lie close together. Of three distinct groups the middle one belongs to the walls if it, not
    the darkest, bounds the light cells, as walls of grey under black letters do. The grey 205 of
    map servers is unknown where it is a group of its own beside lighter cells.
    """
    levels = shades.levels
    known = np.ones(levels.shape, dtype=bool)
    if shades.alpha is not None:
        known = np.asarray(shades.alpha > 0.0)
    darkness, between = _walls_below(levels, known)
    walls = np.asarray(known & (shades.brightness < darkness))
    open_ = known & ~walls
    clear = not open_.any()
    if clear:  # walls alone are drawn
        open_ = ~known
    unseen = open_ & (levels == UNSEEN)
    beside = open_ & (np.abs(levels - UNSEEN) <= 4) & ~unseen
    if 4 * int(beside.sum()) < int(unseen.sum()) and (open_ & (levels > UNSEEN + 4)).any():
        # Map servers call nothing free that is as dark as their unknown.
        open_ = np.asarray(open_ & (levels > UNSEEN))
    doubtful = np.zeros_like(walls) if between is None else np.asarray(open_ & between)
    text = f"walls are the {int(walls.sum())} cells darker than {darkness:.2f} of white"
    if doubtful.any():
        text += f"; {int(doubtful.sum())} cells of a grey between walls and floor count as free, "
        text += "but nothing starts there"
    if clear and open_.any():
        text += "; transparent ones are free"
    plain = not clear and not (known & (levels >= 25) & (levels <= 230)).any()
    return Cells(walls, open_, doubtful, () if plain else (text,))


def _walls_below(levels: NDArray[np.int16], known: Mask) -> tuple[float, Mask | None]:
    """The brightness below which cells are walls; cells of a distinct grey above it, or None."""
    counts = np.bincount(levels[known], minlength=256)
    present = np.flatnonzero(counts)
    if not len(present) or present[-1] - present[0] < CONTRAST * 255.0:
        return HALF, None
    low, high = _groups(counts)
    dark, light = _gap(counts, low), _gap(counts, high)
    means = [_mean(counts, *ends) for ends in ((0, low), (low, high), (high, 256))]
    if np.isnan(means[1]):
        return dark, None
    span = means[2] - means[0]
    if means[1] - means[0] < NEAR * span:
        return light, None
    if means[2] - means[1] < NEAR * span:
        return dark, None
    black = known & (levels < low)
    middle = known & (levels >= low) & (levels < high)
    white = known & (levels >= high)
    if 2 * int((middle & _touching(black)).sum()) >= int(middle.sum()):
        # A transition from dark to light, as at the edges of smooth drawings.
        return (means[0] + means[2]) / 2.0 / 255.0, None
    if 4 * int((white & _touching(black)).sum()) >= int((white & _touching(middle)).sum()):
        return dark, middle
    return light, None


def _groups(counts: NDArray[np.int64]) -> tuple[int, int]:
    """First levels of the second and third group of brightness.

    Otsu's method with two thresholds ("A threshold selection method from gray-level histograms",
    IEEE Transactions on Systems, Man, and Cybernetics 9(1), 1979), on square roots of the counts:
    walls are few beside the floor.
    """
    weights = np.sqrt(counts.astype(np.float64))
    mass = np.concatenate([[0.0], np.cumsum(weights)])
    moment = np.concatenate([[0.0], np.cumsum(weights * np.arange(256))])

    def between(first: NDArray[np.int64], end: NDArray[np.int64]) -> Levels:
        amount = mass[end] - mass[first]
        return np.asarray((moment[end] - moment[first]) ** 2 / np.maximum(amount, 1e-12))

    low, high = np.triu_indices(256, k=1)
    zero, last = np.zeros_like(low), np.full_like(low, 256)
    score = between(zero, low) + between(low, high) + between(high, last)
    score[(low == 0) | (mass[low] == 0.0) | (mass[256] - mass[high] == 0.0)] = -np.inf
    best = int(np.argmax(np.round(score, 6)))
    return int(low[best]), int(high[best])


def _gap(counts: NDArray[np.int64], level: int) -> float:
    """The brightness in the middle of the levels that no pixel has, below a group that begins."""
    below, above = np.flatnonzero(counts[:level]), np.flatnonzero(counts[level:])
    return float(below[-1] + level + above[0]) / 2.0 / 255.0


def _mean(counts: NDArray[np.int64], first: int, end: int) -> float:
    """Mean level of the pixels of some levels; nan if there are none."""
    part = counts[first:end]
    return float(np.average(np.arange(first, end), weights=part)) if part.any() else float("nan")


def _touching(cells: Mask) -> Mask:
    """Cells with one of the eight neighbours in a set, the set's own included."""
    grown = cells.copy()
    grown[1:] |= cells[:-1]
    grown[:-1] |= cells[1:]
    wide = grown.copy()
    wide[:, 1:] |= grown[:, :-1]
    wide[:, :-1] |= grown[:, 1:]
    return wide
