"""Things that stand around: crates, desks, chairs, shelves, rubble; and materials, named by the
substance they stand for: what cameras see and radio counts.
"""

from __future__ import annotations

import random

from usarsim_exploration.worlds.mjcf import Movable, Scene, Vector, turned


def daylight(scene: Scene) -> None:
    """Sky and two suns: one that casts shadows, one that lightens them."""
    scene.sky((0.55, 0.67, 0.80), (0.93, 0.95, 0.96))
    scene.section("light")
    scene.sun((0.34, 0.52, -0.78), 0.56, shadow=True)
    scene.sun((-0.50, -0.66, -0.56), 0.20, shadow=False)


def floor_tiles(
    scene: Scene, name: str, color: Vector, joint: Vector, *, per_metre: float = 1.0
) -> str:
    """Material for level floors: tiles with joints."""
    scene.texture(
        f"{name}_tiles",
        type="2d",
        builtin="flat",
        rgb1=color,
        mark="edge",
        markrgb=joint,
        width=192,
        height=192,
    )
    return scene.material(
        name,
        (1.0, 1.0, 1.0),
        texture=f"{name}_tiles",
        repeat=(per_metre, per_metre),
        uniform=True,
        shine=0.05,
    )


def checkered_floor(scene: Scene, name: str, dark: Vector, light: Vector) -> str:
    """Material for wide floors: squares of 1 m in two shades, by which speed can be seen."""
    scene.texture(
        f"{name}_squares",
        type="2d",
        builtin="checker",
        rgb1=dark,
        rgb2=light,
        width=256,
        height=256,
    )
    white = (1.0, 1.0, 1.0)
    texture = f"{name}_squares"
    return scene.material(name, white, texture=texture, repeat=(0.5, 0.5), uniform=True, shine=0.05)


def woods(scene: Scene, name: str, dark: Vector, light: Vector, count: int) -> tuple[str, ...]:
    """Shades of wood from dark to light, for relief that can be read from above."""
    names = []
    for shade in range(count):
        t = shade / max(1, count - 1)
        color = tuple(a + (b - a) * t for a, b in zip(dark, light, strict=True))
        names.append(scene.material(f"{name}_{shade + 1}", color))
    return tuple(names)


class _Placed:
    """Turns positions of a piece of furniture, given in its own frame, into the room's."""

    def __init__(self, at: tuple[float, float], yaw: float) -> None:
        self._at = at
        self.quat = turned(yaw=yaw)
        w, _, _, z = self.quat
        self._cos, self._sin = w * w - z * z, 2 * w * z

    def __call__(self, x: float, y: float, z: float) -> Vector:
        return (
            self._at[0] + self._cos * x - self._sin * y,
            self._at[1] + self._sin * x + self._cos * y,
            z,
        )


def crate(
    scene: Scene,
    name: str,
    at: Vector,
    size: Vector,
    mass: float,
    material: str,
    *,
    trim: str | None = None,
    yaw: float = 0.0,
) -> None:
    """A movable box that stands on the point `at`; `trim` adds a lid band of that material."""
    x, y, z = at
    body = Movable(name, (x, y, z + size[2] / 2), turned(yaw=yaw))
    if trim is None:
        body.box((0.0, 0.0, 0.0), size, material, mass)
    else:
        band = 0.18 * size[2]
        body.box((0.0, 0.0, -band / 2), (size[0], size[1], size[2] - band), material, 0.8 * mass)
        top = (0.0, 0.0, size[2] / 2 - band / 2)
        body.box(top, (size[0], size[1], band), trim, 0.2 * mass)
    scene.movable(body)


def pallet(scene: Scene, at: tuple[float, float], yaw: float, material: str) -> None:
    """A wooden transport pallet, 1.2 x 0.8 x 0.144 m, fixed to the ground."""
    put = _Placed(at, yaw)
    for y in (-0.36, 0.0, 0.36):
        scene.box(
            "pallet", put(0, y, 0.05), (1.2, 0.1, 0.1), material, quat=put.quat, role="ground"
        )
    for x in (-0.54, -0.27, 0.0, 0.27, 0.54):
        top = put(x, 0, 0.122)
        scene.box("pallet", top, (0.12, 0.8, 0.044), material, quat=put.quat, role="ground")


def open_box(
    scene: Scene, prefix: str, at: tuple[float, float], yaw: float, size: Vector, material: str
) -> None:
    """A big box, open toward its own +x side, for somebody to lie in; size is the outside."""
    put, (length, width, height), wall = _Placed(at, yaw), size, 0.03
    parts = (
        ((0.0, (width - wall) / 2, height / 2), (length, wall, height)),
        ((0.0, -(width - wall) / 2, height / 2), (length, wall, height)),
        ((-(length - wall) / 2, 0.0, height / 2), (wall, width - 2 * wall, height)),
        ((0.0, 0.0, height + wall / 2), (length, width, wall)),
    )
    for center, extents in parts:
        scene.box(prefix, put(*center), extents, material, quat=put.quat)


def desk(
    scene: Scene, at: tuple[float, float], yaw: float, *, top: str, frame: str, screen: str
) -> None:
    """An office desk, 1.6 x 0.8 m, with a screen; the person sits on its own -y side."""
    put = _Placed(at, yaw)
    scene.box("desk", put(0, 0, 0.735), (1.6, 0.8, 0.03), top, quat=put.quat)
    for x in (-0.76, 0.76):
        scene.box("desk", put(x, 0, 0.36), (0.04, 0.7, 0.72), frame, quat=put.quat)
    scene.box("desk", put(0, 0.33, 0.5), (1.48, 0.02, 0.4), frame, quat=put.quat)
    scene.box("screen", put(0, 0.18, 0.80), (0.16, 0.12, 0.1), screen, quat=put.quat)
    scene.box("screen", put(0, 0.18, 1.02), (0.56, 0.03, 0.34), screen, quat=put.quat)


def table(
    scene: Scene,
    at: tuple[float, float],
    yaw: float,
    size: tuple[float, float],
    top: str,
    legs: str,
) -> None:
    """A table 0.74 m high with four legs."""
    put = _Placed(at, yaw)
    scene.box("table", put(0, 0, 0.72), (size[0], size[1], 0.04), top, quat=put.quat)
    x, y = size[0] / 2 - 0.08, size[1] / 2 - 0.08
    for corner in ((x, y), (x, -y), (-x, y), (-x, -y)):
        leg = put(*corner, 0.35)
        scene.box("table", leg, (0.06, 0.06, 0.7), legs, quat=put.quat)


def chair(scene: Scene, at: tuple[float, float], yaw: float, *, seat: str, frame: str) -> None:
    """A fixed chair that faces its own +x."""
    put = _Placed(at, yaw)
    scene.box("chair", put(0, 0, 0.45), (0.42, 0.42, 0.05), seat, quat=put.quat)
    scene.box("chair", put(-0.2, 0, 0.72), (0.04, 0.42, 0.4), seat, quat=put.quat)
    for y in (-0.19, 0.19):
        scene.box("chair", put(0, y, 0.21), (0.38, 0.03, 0.42), frame, quat=put.quat)


def swivel_chair(
    scene: Scene, name: str, at: tuple[float, float], yaw: float, *, seat: str, frame: str
) -> None:
    """A movable office chair of about 7 kg that faces its own +x."""
    body = Movable(name, (*at, 0.0), turned(yaw=yaw))
    body.box((0.0, 0.0, 0.03), (0.56, 0.08, 0.06), frame, 1.6)
    body.box((0.0, 0.0, 0.03), (0.08, 0.56, 0.06), frame, 1.6)
    body.cylinder((0.0, 0.0, 0.25), 0.03, 0.38, frame, 0.8)
    body.box((0.0, 0.0, 0.47), (0.46, 0.46, 0.06), seat, 2.0)
    body.box((-0.21, 0.0, 0.76), (0.05, 0.42, 0.46), seat, 1.0)
    scene.movable(body)


def waste_bin(scene: Scene, name: str, at: tuple[float, float], material: str) -> None:
    """A movable bin of 1.2 kg."""
    body = Movable(name, (*at, 0.18))
    body.cylinder((0.0, 0.0, 0.0), 0.14, 0.36, material, 1.2)
    scene.movable(body)


def cabinet(
    scene: Scene, at: tuple[float, float], yaw: float, size: Vector, body: str, front: str
) -> None:
    """A closed cabinet whose doors are on its own +x side."""
    put, (depth, width, height) = _Placed(at, yaw), size
    scene.box("cabinet", put(0, 0, height / 2), size, body, quat=put.quat)
    for side in (-1, 1):
        door = put(depth / 2 + 0.01, side * width / 4, height / 2)
        scene.box("cabinet", door, (0.02, width / 2 - 0.02, height - 0.06), front, quat=put.quat)


def shelf(
    scene: Scene,
    at: tuple[float, float],
    yaw: float,
    size: Vector,
    board: str,
    contents: tuple[str, ...],
    seed: str,
) -> None:
    """A shelf of four boards with a few boxes on it, open on its own +x and -x sides."""
    put, (depth, width, height), draw = _Placed(at, yaw), size, random.Random(seed)
    for side in (-1, 1):
        post = put(0, side * (width / 2 - 0.02), height / 2)
        scene.box("shelf", post, (depth, 0.04, height), board, quat=put.quat)
    levels = 4
    for level in range(levels):
        z = 0.1 + level * (height - 0.12) / (levels - 1)
        plank = put(0, 0, z)
        scene.box("shelf", plank, (depth, width - 0.08, 0.03), board, quat=put.quat)
        if level == levels - 1:
            break
        length = (0.35 + 0.45 * draw.random()) * (width - 0.16)
        tall = 0.22 + 0.16 * draw.random()
        shift = (draw.random() - 0.5) * (width - 0.16 - length)
        thing = contents[int(draw.random() * len(contents))]
        box = put(0, shift, z + 0.015 + tall / 2)
        scene.box("goods", box, (0.8 * depth, length, tall), thing, quat=put.quat)


def sofa(scene: Scene, at: tuple[float, float], yaw: float, material: str) -> None:
    """A sofa, 1.9 m wide, that faces its own +x."""
    put = _Placed(at, yaw)
    scene.box("sofa", put(0.05, 0, 0.22), (0.75, 1.9, 0.4), material, quat=put.quat)
    scene.box("sofa", put(-0.36, 0, 0.42), (0.18, 1.9, 0.8), material, quat=put.quat)
    for side in (-1, 1):
        arm = put(0.02, side * 0.88, 0.3)
        scene.box("sofa", arm, (0.8, 0.18, 0.58), material, quat=put.quat)


def rubble(
    scene: Scene,
    x: tuple[float, float],
    y: tuple[float, float],
    count: int,
    materials: tuple[str, ...],
    seed: str,
) -> None:
    """Scatter fixed broken blocks, tilted at random and half sunk, over a rectangle."""
    draw = random.Random(seed)

    def between(low: float, high: float) -> float:
        return low + (high - low) * draw.random()

    for _ in range(count):
        size = (between(0.15, 0.5), between(0.12, 0.35), between(0.06, 0.18))
        center = (between(*x), between(*y), between(0.0, 0.09))
        quat = turned(between(-22, 22), between(-22, 22), between(0, 180))
        material = materials[int(draw.random() * len(materials))]
        scene.box("rubble", center, size, material, quat=quat, role="ground")
