"""Test scenes, and robots that differ from a shipped one in a few keys, written to a folder.

Friction of a contact is the larger of the two bodies' friction, unless one of them has priority.
Wheels have 1.0, so ground that shall be more slippery is given priority: then its own friction
counts for everything that touches it. Casters have priority too and would lose their freedom from
friction on such ground; nothing with a caster is tested there.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy

PLATFORM = 0.4
"""Height of the platforms on both sides of a gap, m."""
FIELD_START = 1.0
"""x of the near edge of steps, gaps, fields, walls, m."""
POST = 0.1
"""Edge of the posts of a step field, m (ASTM E2828)."""
POSTS = 12
"""Posts along an edge of a step field (robots reference 3.3 V19)."""
HALF_WIDTH = 2.0
STEPS, STEP_RISE, STEP_RUN = 6, 0.18, 0.28
"""Of stairs; m."""
LANDING = 30.0
"""m behind the last stair."""

Heights = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class Scene:
    """A world in the making: its name and the elements of its world body."""

    name: str
    elements: tuple[str, ...]


def _box(name: str, lower: Vector, upper: Vector) -> str:
    middle = " ".join(f"{(a + b) / 2:.6g}" for a, b in zip(lower, upper, strict=True))
    half = " ".join(f"{(b - a) / 2:.6g}" for a, b in zip(lower, upper, strict=True))
    return f'<geom name="{name}" type="box" pos="{middle}" size="{half}" friction="1.0"/>'


def _floor(friction: float = 1.0, degrees: float = 0.0) -> str:
    turned = f' euler="0 {-degrees} 0"' if degrees else ""
    priority = "" if friction >= 1.0 else ' priority="1"'
    surface = f'friction="{friction}"{priority}'
    return f'<geom name="floor" type="plane" size="0 0 1"{turned} {surface}/>'


def flat(friction: float = 1.0) -> Scene:
    """An endless level floor."""
    return Scene(f"flat_mu{friction:g}", (_floor(friction),))


def slope(degrees: float, friction: float) -> Scene:
    """An endless plane that climbs toward +x through the origin."""
    return Scene(f"slope_{degrees:g}_mu{friction:g}", (_floor(friction, degrees),))


def on_slope(degrees: float, rest_height: float) -> Pose:
    """The pose of a robot that stands on such a plane at the origin, looking uphill."""
    angle = math.radians(degrees)
    position = (-rest_height * math.sin(angle), 0.0, rest_height * math.cos(angle))
    return Pose(position, quaternion_from_rpy(0.0, -angle, 0.0))


def step(height: float) -> Scene:
    """A level step up, square to the way."""
    lower, upper = (FIELD_START, -HALF_WIDTH, 0.0), (FIELD_START + 6.0, HALF_WIDTH, height)
    return Scene(f"step_{height:g}", (_floor(), _box("step", lower, upper)))


def gap(width: float) -> Scene:
    """Two platforms with a gap between them that begins at `FIELD_START`."""
    spans = ((-2.0, FIELD_START), (FIELD_START + width, FIELD_START + width + 6.0))
    boxes = [
        _box(f"platform{n}", (a, -HALF_WIDTH, 0.0), (b, HALF_WIDTH, PLATFORM))
        for n, (a, b) in enumerate(spans)
    ]
    return Scene(f"gap_{width:g}", (_floor(), *boxes))


def stairs(half_width: float = HALF_WIDTH) -> Scene:
    """Stairs that begin at `FIELD_START` and lead up to a landing (robots reference 3.3 V21)."""
    boxes = []
    for n in range(STEPS):
        lower = (FIELD_START + n * STEP_RUN, -half_width, 0.0)
        upper = (FIELD_START + STEPS * STEP_RUN + LANDING, half_width, (n + 1) * STEP_RISE)
        boxes.append(_box(f"stair{n}", lower, upper))
    return Scene(f"stairs_w{half_width:g}", (_floor(), *boxes))


def symmetric_heights(seed: int, levels: Sequence[float]) -> Heights:
    """Post heights of a step field that a half turn maps onto itself (ASTM E2828)."""
    draw = random.Random(seed)
    flat_list = [draw.choice(levels) for _ in range(POSTS * POSTS // 2)]
    flat_list += reversed(flat_list)
    return tuple(tuple(flat_list[row * POSTS : (row + 1) * POSTS]) for row in range(POSTS))


def step_field(name: str, heights: Heights) -> Scene:
    """Posts from `FIELD_START` on, centred on the way; height 0 leaves bare floor."""
    boxes = []
    for i, row in enumerate(heights):
        for j, height in enumerate(row):
            if height > 0.0:
                x, y = FIELD_START + i * POST, (j - POSTS / 2) * POST
                upper = (x + POST, y + POST, height)
                boxes.append(_box(f"post{i}_{j}", (x, y, 0.0), upper))
    return Scene(f"field_{name}", (_floor(), *boxes))


def wall(half_width: float = HALF_WIDTH) -> Scene:
    """A wall across the way."""
    lower, upper = (FIELD_START, -half_width, 0.0), (FIELD_START + 0.3, half_width, 1.0)
    return Scene(f"wall_w{half_width:g}", (_floor(), _box("wall", lower, upper)))


def crate(mass: float) -> Scene:
    """A crate of 0.4 x 0.4 x 0.3 m on the way."""
    body = (
        f'<body name="crate" pos="{FIELD_START} 0 0.15"><freejoint name="crate"/>'
        f'<geom name="crate" type="box" size="0.2 0.2 0.15" mass="{mass:g}" friction="0.5"/></body>'
    )
    return Scene(f"crate_{mass:g}kg", (_floor(), body))


def sliding_block(friction: float) -> Scene:
    """A flat block of 2 kg that rests on the floor."""
    body = (
        '<body name="block" pos="0 0 0.05"><freejoint name="block"/>'
        '<geom name="block" type="box" size="0.15 0.1 0.05" mass="2" friction="0.1"/></body>'
    )
    return Scene(f"block_mu{friction:g}", (_floor(friction), body))


def write_world(folder: Path, scene: Scene) -> Path:
    """Write a world folder; returns it."""
    world = folder / scene.name
    world.mkdir(parents=True, exist_ok=True)
    body = "\n".join(f"    {element}" for element in scene.elements)
    (world / "scene.xml").write_text(
        f'<mujoco model="{scene.name}">\n  <worldbody>\n{body}\n  </worldbody>\n</mujoco>\n'
    )
    (world / "world.toml").write_text(
        f'title = "{scene.name}"\n'
        "[bounds]\nlower = [-500.0, -500.0, -300.0]\nupper = [500.0, 500.0, 300.0]\n"
        '[[start]]\ntag = "Start"\nposition = [0.0, 0.0, 1.0]\n'
    )
    return world


def write_robot(
    folder: Path, name: str, parent: str, keys: Mapping[str, float | bool], table: str = "drive"
) -> None:
    """Write the file of a robot that differs from its parent in keys of one table."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = "".join(f"{key} = {_toml(value)}\n" for key, value in keys.items())
    (folder / f"{name}.toml").write_text(f'extends = "{parent}"\n[{table}]\n{lines}')


def _toml(value: float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else str(float(value))
