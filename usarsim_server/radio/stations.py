"""Small values that the radio room hands around.

The stations of a world are its robots; whoever walks or controls the world is none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from usarsim_server.protocol.values import Vector
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.simulation.snapshot import Snapshot


@dataclass(frozen=True, slots=True)
class Station:
    """A robot or a ComStation at one instant.

    Attributes:
        name: label from INIT, in its own spelling.
        position: of its reference point, simulation frame, m.
        battery_empty: whether it has run out of power.
    """

    name: str
    position: Vector
    battery_empty: bool = False


StationSource = Callable[[], Sequence[Station]]
"""All stations of this moment in the order of spawning; may block for a physics step."""


class ObstacleCounter(Protocol):
    """Counts what stands between two points."""

    def count(self, start: Vector, end: Vector) -> int:
        """Obstacles between two points (simulation frame, m) by the rule of side channels 3.3."""


def stations_of(
    vehicles: Callable[[], Sequence[Vehicle]], look: Callable[[], Snapshot]
) -> StationSource:
    """Make the source of all stations (side channels reference 3.2).

    A robot is one from the moment it is spawned until its connection closes. Its place is that of
    its reference point, at the very moment of asking; its battery counts as empty from its last
    whole second on.

    Args:
        vehicles: all robots in the order of spawning, as `Fleet.vehicles` has them.
        look: a picture of this moment, as `Simulation.look` takes it; may block.
    """

    def stations() -> list[Station]:
        # In this order: a robot that is counted is in the picture, unless it has just left.
        present = vehicles()
        snapshot = look()
        found = ((one, one.state(snapshot)) for one in present)
        return [
            Station(one.name, state.pose.position, one.gauge.empty(snapshot.time))
            for one, state in found
            if state is not None
        ]

    return stations
