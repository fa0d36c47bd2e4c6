"""The ground truth dialogue of wireless simulation: requests, replies (side channels 3.2 to 3.4).

The program that asks cuts replies with a strict splitter that stops at the first surprise, so
every blank here is load-bearing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from usarsim_server.protocol.grammar import Command, parse_line
from usarsim_server.protocol.numbers import boolean, read_vector, single
from usarsim_server.protocol.values import Vector

__all__ = [
    "UNKNOWN_COUNT",
    "BetweenPoints",
    "BetweenRobots",
    "Incomplete",
    "Position",
    "Positions",
    "Query",
    "obstacles",
    "positions",
    "read_query",
]

UNKNOWN_COUNT = -1
"""Count between robots of which one does not exist."""

_POSITION_DIGITS = 4
_BREAKS = re.compile(r"[\r\n]+")


@dataclass(frozen=True, slots=True)
class Positions:
    """GETPOS: where is everybody?"""


@dataclass(frozen=True, slots=True)
class BetweenRobots:
    """GETOBS between two robots, names as sent."""

    start: str
    end: str


@dataclass(frozen=True, slots=True)
class BetweenPoints:
    """GETOBS between two points: their texts as sent, and what they mean (wire frame, m)."""

    start: str
    end: str
    start_point: Vector
    end_point: Vector


@dataclass(frozen=True, slots=True)
class Incomplete:
    """GETOBS without a complete pair of anything; answered by an empty line."""


Query = Positions | BetweenRobots | BetweenPoints | Incomplete


@dataclass(frozen=True, slots=True)
class Position:
    """One robot in the answer to GETPOS.

    Attributes:
        name: label, as it was given.
        location: wire frame, m.
        battery_empty: whether it has run out of power.
    """

    name: str
    location: Vector
    battery_empty: bool = False


def read_query(line: str) -> Query | None:
    """Read one request without its line end; None if it is no request of this dialogue.

    The command word and the keys may be in any case, the first group of a key wins, values are
    trimmed. Never raises.
    """
    commands = parse_line(_BREAKS.sub(" ", line).encode("latin-1", "replace"))
    match commands[0].word if commands else "":
        case "GETPOS":
            return Positions()
        case "GETOBS":
            return _between(commands[0])
        case _:
            return None


def positions(robots: Iterable[Position]) -> str:
    """The answer to GETPOS, without line end; robots in the order given."""
    groups = [_position(robot) for robot in robots]
    return " ".join([f"POSITIONS {{Robots {len(groups)}}}", *groups])


def obstacles(query: BetweenRobots | BetweenPoints, count: int) -> str:
    """The answer to a complete GETOBS, without line end; names and points go back as they came."""
    start, end = ("From", "To") if isinstance(query, BetweenRobots) else ("Start", "End")
    # The engine prints a float; the reader takes what stands before the point.
    return f"NUMOBS {{{start} {query.start}}} {{{end} {query.end}}} {{ObstCount {count}.0000}}"


def _position(robot: Position) -> str:
    """One robot; its three pairs share one group (side channels 3.4)."""
    location = ",".join([single(value, _POSITION_DIGITS) for value in robot.location])
    empty = boolean(robot.battery_empty)
    return f"{{Name {robot.name} Location {location} BatteryEmpty {empty}}}"


def _between(command: Command) -> Query:
    start, end = command.get("From"), command.get("To")
    if start and end:
        return BetweenRobots(start, end)
    start, end = command.get("Start"), command.get("End")
    if start and end:
        return BetweenPoints(start, end, _point(start), _point(end))
    return Incomplete()


def _point(text: str) -> Vector:
    x, y, z = read_vector(text)
    return x, y, z
