"""Endless level floor: the quickest world, and the one without excuses."""

from __future__ import annotations

from usarsim_worldgen import furniture as substances
from usarsim_worldgen.mjcf import Scene
from usarsim_worldgen.sheet import GeneratedWorld


def build() -> GeneratedWorld:
    """The empty world with its facts."""
    scene = Scene("empty", center=(0.0, 0.0, 0.0), extent=12.0)
    world = GeneratedWorld(
        name="empty",
        title="Empty floor",
        description="An endless level floor with tiles of 1 m. Nothing to hit, nobody to find.",
        scene=scene,
        lower=(-1000.0, -1000.0, -2.0),
        upper=(1000.0, 1000.0, 200.0),
    )
    substances.checkered_floor(scene, "concrete", (0.62, 0.64, 0.66), (0.68, 0.70, 0.72))
    substances.daylight(scene)
    scene.camera("overview", (-11.0, -7.5, 4.2), (0.0, 0.3, 0.2), 36.0)
    scene.section("floor")
    scene.floor("concrete")
    places = [-3.0, -1.0, 1.0, 3.0]
    world.start_grid(xs=places, ys=places)
    world.zones.append(("floor", "flat", (-1000.0, 1000.0), (-1000.0, 1000.0)))
    return world
