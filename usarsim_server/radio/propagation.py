"""Propagation models: how strong a signal arrives, and whether that is enough for a link.

A model is a class with `register("name")` in a file of `radio/`; outside packages announce
theirs in the entry point group `usarsim_server.propagation`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import usarsim_server.radio as package
from usarsim_server.errors import RobotDescriptionError, SettingsError, at
from usarsim_server.plugins import PluginTypes
from usarsim_server.radio.parameters import RadioParameters

GROUP = "usarsim_server.propagation"
"""Entry point group for models of other packages."""

NOTHING = -200.0
"""dBm of a signal that does not arrive; clients of the field count an unknown one as this, too
(side channels reference 4.7)."""


class Propagation(ABC):
    """One propagation model; holds no state, so that it may be asked by any thread.

    Attributes:
        counts_obstacles: whether it wants to know what stands between two stations.
        needs_positions: whether it wants to know where stations are; one that does not never
            drops a station that the simulator does not know (side channels reference 4.4).
        trusting: whether a station whose place is unknown yet may connect (ibidem).
        cutoff: dBm, the weakest signal that makes a link.
    """

    counts_obstacles: bool = False
    needs_positions: bool = True
    trusting: bool = False

    def __init__(self, parameters: RadioParameters) -> None:
        """Read the keys of the model.

        Raises:
            SettingsError: if one cannot be used.
        """
        self.cutoff = parameters.number("cutoff", -93.0, low=-300.0, high=0.0)

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


@dataclass(frozen=True, slots=True)
class LogDistance:
    """The log-distance law P - 10 N log10(d / d0) (side channels reference 4.5).

    Attributes:
        power: P, dBm received at the reference distance.
        exponent: N, the path loss exponent.
        distance: d0, the reference distance, m.
    """

    power: float = -49.67
    exponent: float = 1.0
    distance: float = 2.0

    @classmethod
    def read(cls, parameters: RadioParameters, default: LogDistance | None = None) -> LogDistance:
        """Read the keys `reference_power`, `path_loss_exponent` and `reference_distance`."""
        base = default or cls()
        return cls(
            parameters.number("reference_power", base.power, low=-300.0, high=100.0),
            parameters.number("path_loss_exponent", base.exponent, low=0.0, high=20.0),
            parameters.number("reference_distance", base.distance, above=0.0, high=1e6),
        )

    def at(self, distance: float) -> float:
        """dBm at a distance (m); infinite at none."""
        if distance <= 0.0:
            return math.inf
        return self.power - 10.0 * self.exponent * math.log10(distance / self.distance)

    def range(self, cutoff: float) -> float:
        """Distance (m) at which the signal falls to a strength (dBm)."""
        if self.exponent == 0.0:
            return math.inf if self.power >= cutoff else 0.0
        decades = (self.power - cutoff) / (10.0 * self.exponent)
        return math.inf if decades > 300.0 else float(self.distance * 10.0**decades)


TYPES: PluginTypes[Propagation] = PluginTypes("propagation", Propagation, (package,), GROUP)

register = TYPES.register
"""Class decorator: make a model available under these names."""

model_names = TYPES.names
"""All names a user may write, sorted, those of the original included."""


def create_model(name: str, parameters: RadioParameters, place: str) -> Propagation:
    """The model of a name.

    Args:
        name: in any case.
        parameters: the table to read its keys from; the caller finishes it.
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
    return cls(parameters)
