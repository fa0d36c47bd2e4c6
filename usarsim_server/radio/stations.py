"""The stations of a world are its robots; whoever walks or controls the world is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from usarsim_server.radio.station import Station, StationSource
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.simulation.snapshot import Snapshot

__all__ = ["stations_of"]


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
