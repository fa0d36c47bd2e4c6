"""Worlds of boxes that a measurement writes itself: as many as it likes, always equally dense.

The field grows with the number of boxes, so robots have as much to see and to bump into in a large
world as in a small one, and what is left is the cost of the number itself.
"""

from __future__ import annotations

import math
import random
from pathlib import Path

STARTS = 16
"""Start poses, in a square in the middle."""
_PITCH = 1.6
"""m between two of them."""
_CLEAR = 0.9
"""m around a start pose without boxes: a robot turns there freely."""
_AREA = 4.0
"""Square metres of the field for each box."""
_SMALLEST_FIELD = 10.0
_EDGES = (0.2, 0.5)
_HEIGHTS = (0.3, 1.2)
"""m: least and greatest edge and height of a box."""
_MOVABLE = (0.3, 2.0)
"""Edge (m) and mass (kg) of a box that can be pushed."""


def write_boxes(folder: Path, fixed: int, movable: int = 0, seed: int = 0) -> Path:
    """Write a world folder; returns it.

    Args:
        folder: where to; the world gets a folder of its own in it.
        fixed: boxes that stand for ever, beside the floor.
        movable: boxes that robots can push.
        seed: of sizes and places.
    """
    dice = random.Random(seed)
    world = folder / f"boxes_{fixed}_{movable}"
    world.mkdir(parents=True, exist_ok=True)
    half = max(_SMALLEST_FIELD, math.sqrt(_AREA * (fixed + movable))) / 2.0
    starts = _starts()
    elements = ['<geom type="plane" size="0 0 1" friction="1"/>']
    elements += [_fixed(dice, _free_place(dice, half, starts)) for _ in range(fixed)]
    elements += [
        _movable(number, dice, _free_place(dice, half, starts)) for number in range(movable)
    ]
    body = "".join(f"    {element}\n" for element in elements)
    (world / "scene.xml").write_text(
        f'<mujoco model="boxes">\n  <worldbody>\n{body}  </worldbody>\n</mujoco>\n',
        encoding="utf-8",
    )
    edge = half + 50.0
    poses = "".join(
        f'[[start]]\ntag = "Start{number}"\nposition = [{x:g}, {y:g}, 0.25]\n'
        for number, (x, y) in enumerate(starts, start=1)
    )
    (world / "world.toml").write_text(
        f'title = "{fixed} boxes that stand, {movable} that can be pushed"\n[bounds]\n'
        f"lower = [{-edge:g}, {-edge:g}, -2.0]\nupper = [{edge:g}, {edge:g}, 30.0]\n{poses}",
        encoding="utf-8",
    )
    return world


def _starts() -> list[tuple[float, float]]:
    side = math.isqrt(STARTS)
    middle = (side - 1) / 2.0
    return [
        (_PITCH * (row - middle), _PITCH * (column - middle))
        for row in range(side)
        for column in range(side)
    ]


def _free_place(
    dice: random.Random, half: float, starts: list[tuple[float, float]]
) -> tuple[float, float]:
    """Anywhere in the field but on a start pose."""
    while True:
        place = dice.uniform(-half, half), dice.uniform(-half, half)
        if all(math.dist(place, start) >= _CLEAR for start in starts):
            return place


def _fixed(dice: random.Random, place: tuple[float, float]) -> str:
    x, y = place
    a, b = dice.uniform(*_EDGES) / 2.0, dice.uniform(*_EDGES) / 2.0
    c = dice.uniform(*_HEIGHTS) / 2.0
    return (
        f'<geom type="box" pos="{x:.4f} {y:.4f} {c:.4f}" size="{a:.4f} {b:.4f} {c:.4f}" '
        f'euler="0 0 {dice.uniform(0.0, 90.0):.3f}"/>'
    )


def _movable(number: int, dice: random.Random, place: tuple[float, float]) -> str:
    x, y = place
    edge, mass = _MOVABLE
    half = edge / 2.0
    return (
        f'<body name="crate{number}" pos="{x:.4f} {y:.4f} {half + 0.001:.4f}" '
        f'euler="0 0 {dice.uniform(0.0, 90.0):.3f}">'
        f'<freejoint/><geom type="box" size="{half:g} {half:g} {half:g}" mass="{mass:g}" '
        'friction="0.5"/></body>'
    )
