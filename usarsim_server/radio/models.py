"""Propagation models: how strong a signal arrives, and whether that is enough for a link.

A model is a frozen dataclass with `register("name")` in a file of `radio/`; its declared fields are
its keys in the `[wireless]` table. Outside packages announce theirs in the entry point group
`usarsim_server.propagation`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

from usarsim_server.base.errors import RobotDescriptionError, SettingsError, at
from usarsim_server.base.fields import field
from usarsim_server.base.plugins import PluginTypes
from usarsim_server.base.tables import Table

GROUP = "usarsim_server.propagation"
"""Entry point group for models of other packages."""

NOTHING = -200.0
"""dBm of a signal that does not arrive; clients of the field count an unknown one as this, too
(side channels reference 4.7)."""


@dataclass(frozen=True)
class Propagation(ABC):
    """One propagation model; holds no state, so that it may be asked by any thread."""

    counts_obstacles: ClassVar[bool] = False
    """Whether it wants to know what stands between two stations."""
    needs_positions: ClassVar[bool] = True
    """Whether it wants to know where stations are; one that does not never drops a station that
    the simulator does not know (side channels reference 4.4)."""
    trusting: ClassVar[bool] = False
    """Whether a station whose place is unknown yet may connect (ibidem)."""

    cutoff: float = field(
        default=-93.0, unit="dBm", low=-300.0, high=0.0, help="weakest signal that makes a link"
    )

    @classmethod
    def read(cls, table: Table) -> Self:
        """The model with the keys of a table; the caller finishes it.

        Raises:
            SettingsError: if one cannot be used.
        """
        return table.read(cls)

    @abstractmethod
    def strength(self, distance: float, obstacles: int) -> float:
        """Signal strength in dBm.

        Args:
            distance: m between the stations, not negative; 0 may give infinity.
            obstacles: how many stand between them (side channels reference 3.3); 0 for a model
                that does not count them.
        """

    def connects(self, strength: float) -> bool:
        """Whether a signal of this strength makes a link; one that is not a number does not."""
        return strength >= self.cutoff


TYPES: PluginTypes[Propagation] = PluginTypes(
    "propagation", Propagation, ("usarsim_server.radio",), GROUP
)

register = TYPES.register
"""Class decorator: make a model available under these names."""

model_names = TYPES.names
"""All names a user may write, sorted, those of the original included."""


def create_model(name: str, table: Table, place: str) -> Propagation:
    """The model of a name.

    Args:
        name: in any case.
        table: to read its keys from; the caller finishes it.
        place: where the name stands, for the error.

    Raises:
        SettingsError: there is no such model, or one of its keys cannot be used.
    """
    if name.strip().lower() not in (known.lower() for known in model_names()):
        cure = f"known models: {', '.join(model_names())}"
        raise SettingsError(at(place, f"unknown propagation model {name!r}", cure))
    try:
        cls = TYPES.find(name, place)
    except RobotDescriptionError as error:
        raise SettingsError(str(error)) from error
    return cls.read(table)


@register("none", "Noop")
class NoPropagation(Propagation):
    """0 dBm everywhere, every link is up, and nobody has to be in the simulator
    (side channels 4.5)."""

    needs_positions = False
    trusting = True

    def strength(self, distance: float, obstacles: int) -> float:
        """Always 0 dBm."""
        return 0.0

    def connects(self, strength: float) -> bool:
        """Always."""
        return True


@dataclass(frozen=True)
class LogDistance(Propagation):
    """The log-distance law P - 10 N log10(d / d0) (side channels reference 4.5)."""

    reference_power: float = field(
        default=-49.67, unit="dBm", low=-300.0, high=100.0, help="P, at the reference distance"
    )
    path_loss_exponent: float = field(default=1.0, low=0.0, high=20.0, help="N")
    reference_distance: float = field(default=2.0, unit="m", above=0.0, high=1e6, help="d0")

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the law, walls or not; infinite at no distance."""
        if distance <= 0.0:
            return math.inf
        decades = math.log10(distance / self.reference_distance)
        return self.reference_power - 10.0 * self.path_loss_exponent * decades


@register("distance", "DistanceOnly")
class DistanceOnly(LogDistance):
    """Free space: S = P - 10 N log10(d / d0) (side channels reference 4.5)."""

    trusting = True


@register("line-of-sight")
@dataclass(frozen=True)
class LineOfSight(LogDistance):
    """The log-distance law where nothing stands between, nothing elsewhere.

    A range also ends a link in free sight, as in the exploration reference 10.2.
    """

    counts_obstacles = True
    range: float = field(default=0.0, unit="m", low=0.0, high=1e6, help="end of a link; 0: none")

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law in sight and within the range, else next to nothing."""
        if obstacles or (self.range and distance > self.range):
            return NOTHING
        return super().strength(distance, obstacles)


@register("obstacle")
@dataclass(frozen=True)
class Obstacle(LogDistance):
    """S = P - 10 N log10(d / d0) - k A with k obstacles (side channels reference 4.5).

    The original shows a greatest number of obstacles and does not use it; neither does this model.
    `path-loss` does.
    """

    counts_obstacles = True
    wall_attenuation: float = field(default=6.325, unit="dB", low=0.0, high=300.0, help="A")

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law less that of the obstacles."""
        return super().strength(distance, 0) - obstacles * self.wall_attenuation


@register("path-loss")
@dataclass(frozen=True)
class PathLoss(Obstacle):
    """S = P - 10 N log10(d / d0) - min(k, C) A (exploration reference 10.3).

    Path loss with walls that count up to a number: Bahl and Padmanabhan (RADAR, INFOCOM 2000).
    Walls beyond the C-th are free: behind them a signal has found its way through doors.
    """

    max_walls: int = field(default=5, low=0, high=10**6, help="C")

    @classmethod
    def read(cls, table: Table) -> Self:
        """The model with the constants of its `preset`, unless the table says otherwise."""
        preset = PRESETS[table.choice("preset", tuple(PRESETS), "usarsim")]
        return table.read(cls, cls(**vars(preset)))

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law less that of the walls, up to the greatest number."""
        return super().strength(distance, min(obstacles, self.max_walls))


PRESETS: Mapping[str, PathLoss] = {
    "usarsim": PathLoss(),
    "mresim": PathLoss(
        reference_power=-93.0,
        path_loss_exponent=2.5,
        reference_distance=200.0,
        wall_attenuation=3.65,
        max_walls=125,
    ),
    "bahl": PathLoss(path_loss_exponent=1.5, wall_attenuation=3.1, max_walls=4),
}
"""Constants by origin (exploration reference 10.3): the simulator's settings; MRESim, where the
reference distance is the radio range in free space; the fitted values of the paper with the
reference power of the first."""
