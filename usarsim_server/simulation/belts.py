"""Conveyor belts: geoms of the scene whose surface moves, at a speed that can be changed.

In the scene a belt is a geom with a `surfacevel`. A belt answers to its geom's name; several
belts that are to obey together are called `<tag>:1`, `<tag>:2` and so on.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["MARK", "Belts"]

MARK = 1e-9
"""m/s, rad/s: what a geom must have at compile time whose surface is moved later; no belt."""


class Belts:
    """The belts of a world and how fast they run, for all model generations."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the belts of a scene; a MuJoCo without moving surfaces has none."""
        velocity = getattr(model, "geom_surfacevel", np.zeros((0, 6)))
        self._speeds: dict[str, NDArray[np.float64]] = {
            model.geom(geom).name: velocity[geom].copy()
            for geom in np.flatnonzero((np.abs(velocity) > MARK).any(axis=1))
        }
        self._factors: dict[str, float] = {}

    def run(self, tag: str, factor: float) -> int:
        """Note how many times their speed in the scene the belts of a tag run; how many obey."""
        wanted = tag.lower()
        found = [
            name for name in self._speeds if name and name.lower().partition(":")[0] == wanted
        ] or [name for name in self._speeds if name.lower() == wanted]
        for name in found:
            self._factors[name] = factor
        return len(found)

    def apply(self, model: mujoco.MjModel) -> None:
        """Let the belts of a model generation run as they were told."""
        for name, factor in self._factors.items():
            model.geom_surfacevel[model.geom(name).id] = factor * self._speeds[name]
