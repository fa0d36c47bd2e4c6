"""The stations of a world: its robots; whoever walks or controls the world is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from usarsim_server.protocol.values import Vector


@dataclass(frozen=True, slots=True)
class Station:
    """A robot or a ComStation at one instant."""

    name: str  # label from INIT, in its own spelling
    position: Vector  # of its reference point, simulation frame, m
    battery_empty: bool = False  # whether it has run out of power


StationSource = Callable[[], Sequence[Station]]
"""All stations of this moment in the order of spawning; may block for a physics step."""


class ObstacleCounter(Protocol):
    """Counts what stands between two points."""

    def count(self, start: Vector, end: Vector) -> int:
        """Obstacles between two points (simulation frame, m) by the rule of side channels 3.3."""
