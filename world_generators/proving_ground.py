"""Single obstacles far apart, for measuring what a robot can do.

Every lane runs toward +x and has a start pose and a zone of the same name. Two banks of lanes
lie one behind the other; sizes follow robots reference 3.3, V14 to V22.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from usarsim_exploration.worlds import furniture
from usarsim_exploration.worlds.mjcf import Scene
from usarsim_exploration.worlds.sheet import GeneratedWorld, Start
from world_generators import terrain

LANE = 3.4
"""Distance between lanes, m."""
BANKS = (-11.0, 0.0)
"""x of the start poses of the two banks, m."""
AHEAD = 2.0
"""Distance from the start pose to the obstacle, m."""
WIDTH = 2.4
ANGLES = (15.0, 19.29, 25.0, 30.0, 35.0)
"""Inclines, degrees; 19.29 degrees are a grade of 35 %."""
PLATFORM = 0.4
"""Height of the platforms on both sides of a gap, m."""

Obstacle = Callable[[Scene, float, float], None]
"""Builds an obstacle whose near edge is at x, in the middle of the lane at y."""


def build() -> GeneratedWorld:
    """The proving ground with its facts."""
    scene = Scene("proving_ground", center=(-4.0, 0.0, 0.0), extent=24.0)
    world = GeneratedWorld(
        name="proving_ground",
        title="Proving ground",
        description=(
            "Single obstacles on an endless floor, one lane each: inclined planes, steps, gaps, "
            "step fields, stairs, a wall, a crate. Starts and zones carry the obstacle's name."
        ),
        scene=scene,
        lower=(-200.0, -200.0, -2.0),
        upper=(200.0, 200.0, 100.0),
    )
    shades = _materials(scene)
    furniture.daylight(scene)
    scene.camera("overview", (-30.0, -15.5, 17.5), (-3.3, -0.2, 0.0), 33.5)
    scene.section("floor")
    scene.floor("concrete")
    lanes = _lanes(shades)
    bank_size = (len(lanes) + 1) // 2
    for n, (name, kind, obstacle) in enumerate(lanes):
        x = BANKS[n // bank_size]
        y = LANE * ((bank_size - 1) / 2 - n % bank_size)
        scene.section(f"lane {name}")
        obstacle(scene, x + AHEAD, y)
        world.starts.append(Start(name, (x, y, PLATFORM if kind == "gap" else 0.0)))
        half = LANE / 2 - 0.2
        world.zones.append((name, kind, (x - 1.2, x + 9.0), (y - half, y + half)))
    return world


def _materials(scene: Scene) -> tuple[str, ...]:
    furniture.checkered_floor(scene, "concrete", (0.60, 0.62, 0.64), (0.66, 0.68, 0.70))
    scene.material("wood", (0.84, 0.69, 0.47))
    scene.material("wood_dark", (0.66, 0.49, 0.31))
    scene.material("wood_blue", (0.33, 0.50, 0.68))
    scene.material("wood_red", (0.72, 0.36, 0.28))
    scene.material("wood_green", (0.42, 0.58, 0.42))
    scene.material("brick", (0.70, 0.38, 0.29))
    scene.material("cardboard", (0.76, 0.58, 0.38), shine=0.0)
    scene.material("cardboard_tape", (0.86, 0.74, 0.56))
    return furniture.woods(scene, "wood_post", (0.50, 0.34, 0.20), (0.94, 0.80, 0.56), 4)


def _lanes(shades: tuple[str, ...]) -> list[tuple[str, str, Obstacle]]:
    low = [n / 100 for n in range(7)]
    cubic = [0.0, 0.05, 0.10]
    front: list[tuple[str, str, Obstacle]] = [
        ("Flat", "flat", _nothing),
        ("Crate", "crate", _crate),
        ("Step6cm", "step", _step(0.06)),
        ("Step8cm", "step", _step(0.08)),
        *(
            (f"StepField{n}", "step field", _field(f"proving ground {n}", low, shades))
            for n in (1, 2, 3, 4)
        ),
        ("CubicField", "step field", _field("proving ground cubic", cubic, shades)),
    ]
    back: list[tuple[str, str, Obstacle]] = [
        *((f"Incline{angle:.0f}", "incline", _incline(angle)) for angle in ANGLES),
        ("Stairs", "stairs", _stairs),
        ("Gap15cm", "gap", _gap(0.15)),
        ("Gap20cm", "gap", _gap(0.20)),
        ("Wall", "wall", _wall),
    ]
    return front + back


def _nothing(scene: Scene, x: float, y: float) -> None:
    """The lane stays empty."""


def _incline(angle: float) -> Obstacle:
    def build_incline(scene: Scene, x: float, y: float) -> None:
        terrain.incline(scene, "incline", (x, y, 0.0), (6.0, WIDTH), angle, "wood")
        slope = math.radians(angle)
        foot, top = x + 5.8 * math.cos(slope), 5.8 * math.sin(slope) - 0.3
        for side in (-1, 1):
            scene.box("support", (foot, y + side, top / 2), (0.12, 0.12, top), "wood_dark")

    return build_incline


def _step(height: float) -> Obstacle:
    def build_step(scene: Scene, x: float, y: float) -> None:
        upper = (x + 3.0, y + WIDTH / 2, height)
        scene.block("step", (x, y - WIDTH / 2, 0.0), upper, "wood_green", role="ground")

    return build_step


def _gap(width: float) -> Obstacle:
    def build_gap(scene: Scene, x: float, y: float) -> None:
        low, high = y - WIDTH / 2, y + WIDTH / 2
        for near, far in ((x - AHEAD - 1.0, x), (x + width, x + width + 3.0)):
            scene.block(
                "platform", (near, low, 0.0), (far, high, PLATFORM), "wood_blue", role="ground"
            )

    return build_gap


def _field(seed: str, levels: list[float], shades: tuple[str, ...]) -> Obstacle:
    def build_field(scene: Scene, x: float, y: float) -> None:
        half = terrain.POST * terrain.FIELD_POSTS / 2
        heights = terrain.symmetric_heights(seed, levels)
        terrain.step_field(scene, "post", (x, y - half), heights, shades)

    return build_field


def _stairs(scene: Scene, x: float, y: float) -> None:
    tread, rise, steps = 0.28, 0.18, 6
    terrain.stairs(scene, "stair", (x, y), steps, (tread, WIDTH, rise), "wood_dark")
    near, top = x + steps * tread, steps * rise
    upper = (near + 1.5, y + WIDTH / 2, top)
    scene.block("landing", (near, y - WIDTH / 2, 0.0), upper, "wood", role="ground")


def _wall(scene: Scene, x: float, y: float) -> None:
    scene.block("wall", (x, y - WIDTH / 2, 0.0), (x + 0.3, y + WIDTH / 2, 1.0), "brick")


def _crate(scene: Scene, x: float, y: float) -> None:
    furniture.crate(
        scene, "crate", (x, y, 0.0), (0.4, 0.4, 0.3), 2.0, "cardboard", trim="cardboard_tape"
    )
