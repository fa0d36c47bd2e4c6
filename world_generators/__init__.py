"""Generators of the shipped worlds. What they write is committed; a test compares the two.

Each world has a module with a function `build`, but for the empty one. Everything is drawn from
fixed seeds, so a world comes out the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from usarsim_exploration.worlds import furniture
from usarsim_exploration.worlds.mjcf import Scene
from usarsim_exploration.worlds.sheet import GeneratedWorld
from world_generators import arena, office, plant, proving_ground, smoke_corridor

__all__ = ["GENERATORS", "differences", "files"]


def _empty() -> GeneratedWorld:
    """Endless level floor: the quickest world, and the one without excuses."""
    scene = Scene("empty", center=(0.0, 0.0, 0.0), extent=12.0)
    world = GeneratedWorld(
        name="empty",
        title="Empty floor",
        description="An endless level floor with tiles of 1 m. Nothing to hit, nobody to find.",
        scene=scene,
        lower=(-1000.0, -1000.0, -2.0),
        upper=(1000.0, 1000.0, 200.0),
    )
    furniture.checkered_floor(scene, "concrete", (0.62, 0.64, 0.66), (0.68, 0.70, 0.72))
    furniture.daylight(scene)
    scene.camera("overview", (-11.0, -7.5, 4.2), (0.0, 0.3, 0.2), 36.0)
    scene.section("floor")
    scene.floor("concrete")
    places = [-3.0, -1.0, 1.0, 3.0]
    world.start_grid(xs=places, ys=places)
    world.zones.append(("floor", "flat", (-1000.0, 1000.0), (-1000.0, 1000.0)))
    return world


GENERATORS: Mapping[str, Callable[[], GeneratedWorld]] = {
    "arena": arena.build,
    "empty": _empty,
    "office": office.build,
    "plant": plant.build,
    "proving_ground": proving_ground.build,
    "smoke_corridor": smoke_corridor.build,
}


def files(name: str) -> dict[str, str]:
    """File names and texts of a world."""
    world = GENERATORS[name]()
    return {"scene.xml": world.scene.xml(), "world.toml": world.toml()}


def differences(name: str, directory: Path) -> list[Path]:
    """Files of a world that are missing or not what the generator makes."""
    expected = {directory / name / file_name: text for file_name, text in files(name).items()}
    return [
        path
        for path, text in expected.items()
        if not path.is_file() or path.read_text(encoding="utf-8") != text
    ]
