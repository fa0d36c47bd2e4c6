"""The smoke of a recorded scene, as the scene port tells of it (docs/scene-port.md)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.looks import Air
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import Smoke, SmokeVolume

_TURN = 2.39996323  # rad between two rounds of a ball that rises
_FOOT = 0.25  # width of a cloud that rises at its foot, of that at its top


def air_of(told: dict[str, Any]) -> Air:
    """What is in the air by `smoke` of a scene: haze, volumes, and the balls of clouds."""
    haze, clouds = told.get("haze", {}), told.get("clouds", ())
    volumes = [
        SmokeVolume(
            one["name"],
            one["shape"],
            Pose(tuple(one.get("pos", (0, 0, 0))), tuple(one.get("quat", (1, 0, 0, 0)))),
            tuple(one["size"]),
            one["density"],
        )
        for one in told.get("volumes", ())
    ]
    smoke = Smoke(tuple(volumes), (), haze.get("density", 0.0), haze.get("top", math.inf))
    return Air(smoke, Balls(clouds) if clouds else None)


class Balls:
    """Where the balls of all clouds are."""

    def __init__(self, clouds: Sequence[dict[str, Any]]) -> None:
        """clouds: as they are told."""
        self._clouds = clouds
        radii = [np.full(len(_centres(one, 0.0)), one["radius"]) for one in clouds]
        self._radii = np.concatenate(radii)

    def __call__(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Centres (n, 3) and radii (n,) in m at a simulated time in s."""
        return np.concatenate([_centres(one, time) for one in self._clouds]), self._radii


def _centres(cloud: dict[str, Any], time: float) -> NDArray[np.float64]:
    if "places" in cloud:
        return np.array(cloud["places"], float).reshape(-1, 3)
    angle, aside = np.array(cloud["angle"]), np.array(cloud["aside"])
    turns = np.arange(len(angle)) / len(angle) + time / cloud["lifetime"]
    age = turns - np.floor(turns)
    turned = angle + _TURN * np.floor(turns)
    away = aside * (_FOOT + (1.0 - _FOOT) * age)
    parts = np.stack((away * np.cos(turned), away * np.sin(turned), 2.0 * age - 1.0), axis=1)
    place: NDArray[np.float64] = np.array(cloud["pos"]) + parts * np.array(cloud["size"]) / 2.0
    return place
