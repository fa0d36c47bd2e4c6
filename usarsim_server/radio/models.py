"""Free space: the signal falls with the logarithm of the distance.

Light-like radio: any obstacle ends it.

No propagation at all: everybody hears everybody.

The model of the original for buildings: every obstacle takes its share, without end.

Path loss with walls that count up to a number: Bahl and Padmanabhan (RADAR, INFOCOM 2000).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from usarsim_server.radio.parameters import RadioParameters
from usarsim_server.radio.propagation import NOTHING, LogDistance, Propagation, register


@register("distance", "DistanceOnly")
class DistanceOnly(Propagation):
    """S = P - 10 N log10(d / d0), walls or not (side channels reference 4.5)."""

    trusting = True

    def __init__(self, parameters: RadioParameters) -> None:
        super().__init__(parameters)
        self._law = LogDistance.read(parameters)

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law."""
        return self._law.at(distance)


@register("line-of-sight")
class LineOfSight(Propagation):
    """The log-distance law where nothing stands between, nothing elsewhere.

    `range` (m, 0 for none) also ends a link in free sight, as in the exploration reference 10.2.
    """

    counts_obstacles = True

    def __init__(self, parameters: RadioParameters) -> None:
        super().__init__(parameters)
        self._law = LogDistance.read(parameters)
        self._range = parameters.number("range", 0.0, low=0.0, high=1e6)

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law in sight and within the range, else next to nothing."""
        if obstacles or (self._range and distance > self._range):
            return NOTHING
        return self._law.at(distance)


@register("none", "Noop")
class NoPropagation(Propagation):
    """0 dBm everywhere, every link is up, and nobody has to be in the simulator (4.5)."""

    needs_positions = False
    trusting = True

    def strength(self, distance: float, obstacles: int) -> float:
        """Always 0 dBm."""
        return 0.0

    def connects(self, strength: float) -> bool:
        """Always."""
        return True


@register("obstacle")
class Obstacle(Propagation):
    """S = P - 10 N log10(d / d0) - k A with k obstacles (side channels reference 4.5).

    The original shows a greatest number of obstacles and does not use it; neither does this model.
    `path-loss` does.
    """

    counts_obstacles = True

    def __init__(self, parameters: RadioParameters) -> None:
        super().__init__(parameters)
        self._law = LogDistance.read(parameters)
        self._attenuation = parameters.number("wall_attenuation", 6.325, low=0.0, high=300.0)

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law less that of the obstacles."""
        return self._law.at(distance) - obstacles * self._attenuation


MOST_WALLS = 10**6


@dataclass(frozen=True, slots=True)
class Preset:
    """Constants of one origin: the law, dB per wall, and how many walls count at most."""

    law: LogDistance
    wall_attenuation: float
    max_walls: int


PRESETS: Mapping[str, Preset] = {
    "usarsim": Preset(LogDistance(), 6.325, 5),
    "mresim": Preset(LogDistance(-93.0, 2.5, 200.0), 3.65, 125),
    "bahl": Preset(LogDistance(-49.67, 1.5, 2.0), 3.1, 4),
}
"""By name (exploration reference 10.3): that of the simulator's settings, that of MRESim, where the
reference distance is the radio range in free space, and the fitted values of the paper with the
reference power of the first."""


@register("path-loss")
class PathLoss(Propagation):
    """S = P - 10 N log10(d / d0) - min(k, C) A (exploration reference 10.3).

    Walls beyond the C-th are free: behind them a signal has found its way through doors.
    """

    counts_obstacles = True

    def __init__(self, parameters: RadioParameters) -> None:
        super().__init__(parameters)
        name = parameters.text("preset", "usarsim")
        preset = PRESETS.get(name)
        if preset is None:
            cure = f"write one of {', '.join(PRESETS)}"
            raise parameters.error("preset", f"{name!r} is unknown", cure)
        self._law = LogDistance.read(parameters, preset.law)
        self._attenuation = parameters.number(
            "wall_attenuation", preset.wall_attenuation, low=0.0, high=300.0
        )
        self._most = parameters.count("max_walls", preset.max_walls, low=0, high=MOST_WALLS)

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law less that of the walls, up to the greatest number."""
        return self._law.at(distance) - min(obstacles, self._most) * self._attenuation
