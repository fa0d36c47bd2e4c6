"""Materials, named by the substance they stand for: what cameras see and radio counts."""

from __future__ import annotations

from usarsim_worldgen.mjcf import Scene, Vector


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
