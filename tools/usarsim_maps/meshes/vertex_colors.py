"""Colours of vertices, corners and faces as materials of few plain colours.

A material of the scene has one colour, and each is a mesh of its own in the world. So triangles get
the mean of their corners, and of many colours only `MOST` stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from usarsim_maps.scene import Array, Integers, Material

MOST = 64
"""Different colours of one mesh; more are rounded to fewer steps per channel."""

STEPS = (256, 128, 64, 32, 16, 8, 4, 3, 2)
"""Steps per channel that are tried until there are at most `MOST` colours."""

WHITE = Material("color", (1.0, 1.0, 1.0, 1.0))
"""What vertex colours multiply where there is no other material."""


def shaded(
    colors: Array, base: Material = WHITE, finest: int = STEPS[0]
) -> tuple[list[Material], Integers]:
    """A material in the colours of triangles.

    Args:
        colors: (t, 3) or (t, 4) colour of each triangle as screens show it, with opacity if there
            is a fourth column, each from 0 to 1; other values are clipped, NaN is 0.
        base: material whose colour they multiply; it keeps its picture.
        finest: steps per channel, one of `STEPS`, that are tried first.

    Returns:
        The materials, at most `MOST`, named after their colours; and the number in this list of
        each triangle, (t,).
    """
    with np.errstate(invalid="ignore"):
        bytes_ = np.rint(np.nan_to_num(np.clip(colors, 0.0, 1.0)) * 255.0).astype(np.int64)
    if bytes_.shape[1] == 3:
        bytes_ = np.column_stack([bytes_, np.full(len(bytes_), 255)])
    exact, slots = _different(bytes_)
    found, of_exact = exact, np.arange(len(exact))
    for steps in STEPS[STEPS.index(finest) :]:
        found, of_exact = _different(_rounded(exact, steps))
        if len(found) <= MOST:
            break
    materials = [_tinted(base, color) for color in found.tolist()]
    return materials, of_exact[slots]


def shaded_slots(
    colors: Array, names: Sequence[str], slots: Integers, materials: dict[str, Material]
) -> tuple[list[str], Integers]:
    """Materials of a mesh in the colours of its triangles.

    Args:
        colors: (t, 3) or (t, 4) of each triangle, see `shaded`.
        names: of the mesh's materials.
        slots: (t,) number among the names of each triangle.
        materials: of the scene by name; shades are added. A name that is not there is white.

    Returns:
        The same as `names` and `slots` for the shades.
    """
    found: list[str] = []
    answer = np.zeros(len(slots), dtype=np.int64)
    for slot, name in enumerate(names):
        chosen = slots == slot
        shades, numbers = shaded(colors[chosen], materials.get(name, WHITE))
        answer[chosen] = numbers + len(found)
        materials |= {shade.name: shade for shade in shades}
        found += [shade.name for shade in shades]
    return found, answer


def _different(colors: Integers) -> tuple[Integers, Integers]:
    """Different rows of (n, 4) numbers of 0 to 255, sorted, and the number of each row in them."""
    packed = colors @ np.array([1 << 24, 1 << 16, 1 << 8, 1])
    _, first, number = np.unique(packed, return_index=True, return_inverse=True)
    return colors[first], number.reshape(-1)


def _rounded(colors: Integers, steps: int) -> Integers:
    """Numbers of 0 to 255 rounded to as many steps; what is not wholly clear does not become so."""
    levels = np.rint(colors * ((steps - 1) / 255.0))
    levels[:, 3] = np.maximum(levels[:, 3], colors[:, 3] > 0)
    return np.asarray(np.rint(levels * (255.0 / (steps - 1))).astype(np.int64))


def _tinted(base: Material, color: list[int]) -> Material:
    """A material times a colour of four numbers of 0 to 255."""
    if color == [255, 255, 255, 255] and base is not WHITE:
        return base
    shown = color if color[3] < 255 else color[:3]
    name = f"{base.name}_" + "".join(f"{value:02x}" for value in shown)
    r, g, b, a = (own * value / 255.0 for own, value in zip(base.color, color, strict=True))
    return replace(base, name=name, color=(r, g, b, a))
