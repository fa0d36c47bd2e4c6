"""Answers GETPOS and GETOBS: who is where, and what stands between them (side channels 3)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from usarsim_server.protocol import truth as text
from usarsim_server.protocol.truth import BetweenPoints, BetweenRobots
from usarsim_server.protocol.truth import GroundTruthQuery as Query
from usarsim_server.radio.stations import ObstacleCounter, Station, StationSource
from usarsim_server.simulation.frames import flip_point


class GroundTruth:
    """Knows all stations and everything between them; may be used by any thread."""

    def __init__(self, stations: StationSource, obstacles: ObstacleCounter) -> None:
        """Know the world.

        Args:
            stations: all robots of this moment.
            obstacles: counts what stands between two points.
        """
        self._stations = stations
        self._obstacles = obstacles

    def answer(self, line: str) -> str | None:
        """The reply to one request, both without line end; None: there is no reply.

        May block for a physics step, so it is not for the event loop. An empty text is a reply,
        too: an empty line has to be sent.

        Raises:
            UsarsimError: if the simulation has ended.
        """
        return self.answers([line])[0]

    def answers(self, lines: Iterable[str]) -> list[str | None]:
        """The replies to requests that came together, one for each, about the same moment.

        Cheaper than one by one: the physics is asked once for all of them. See `answer`.
        """
        queries = [text.read_ground_truth_query(line) for line in lines]
        needed = any(isinstance(query, text.Positions | BetweenRobots) for query in queries)
        stations = self._stations() if needed else ()
        return [None if one is None else self._reply(one, stations) for one in queries]

    def _reply(self, query: Query, stations: Sequence[Station]) -> str:
        match query:
            case text.Positions():
                return text.positions(_position(one) for one in stations)
            case BetweenRobots():
                return text.obstacles(query, self._between(query, stations))
            case BetweenPoints():
                ends = flip_point(query.start_point), flip_point(query.end_point)
                return text.obstacles(query, self._obstacles.count(*ends))
            case _:
                return ""

    def _between(self, query: BetweenRobots, stations: Sequence[Station]) -> int:
        start, end = _find(stations, query.start), _find(stations, query.end)
        if start is None or end is None:
            return text.UNKNOWN_COUNT
        return self._obstacles.count(start.position, end.position)


def _position(station: Station) -> text.Position:
    return text.Position(station.name, flip_point(station.position), station.battery_empty)


def _find(stations: Sequence[Station], name: str) -> Station | None:
    """The first station of a name, whatever its case (side channels 3.3)."""
    wanted = name.lower()
    return next((one for one in stations if one.name.lower() == wanted), None)
