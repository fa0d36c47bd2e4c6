"""The dialogue of the scoring tools: queries, listings, framing (side channels reference 6).

Tools match listings with positional patterns, so order and blanks are fixed. They also depend on
being answered whatever they say: everything that is no query asks for all pawns.

The ground truth dialogue of wireless simulation: requests, replies (side channels 3.2 to 3.4).

The program that asks cuts replies with a strict splitter that stops at the first surprise, so
every blank here is load-bearing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from usarsim_server.protocol.grammar import Command, LineFramer, parse_line
from usarsim_server.protocol.numbers import boolean, read_vector, single
from usarsim_server.protocol.values import Vector

END = "{End}"
"""The last line of every listing."""

MAX_LISTING = 512 * 1024
"""Longest listing in bytes: some 4500 actors, more than a world holds by default."""


@dataclass(frozen=True, slots=True)
class Query:
    """What is asked for."""

    class_name: str = ""  # class as sent, with or without package; empty for all pawns
    name: str = ""  # of the only actor wanted, in exactly this case; empty for any

    @property
    def bare_class(self) -> str:
        """The class without its package, in lower case: the original's names have no case."""
        return self.class_name.rpartition(".")[2].lower()


@dataclass(frozen=True, slots=True)
class Actor:
    """One line of a listing."""

    name: str  # of the actor
    class_name: str  # without package
    location: Vector  # wire frame, m
    rotation: Vector  # roll, pitch, yaw, rad


def read_query(line: str) -> Query:
    """Read a line without its end; keys in any case, the first of equals counts; never raises."""
    commands = parse_line(line.encode("latin-1", "replace"))
    if not commands:
        return Query()
    return Query(commands[0].get("class") or "", commands[0].get("name") or "")


def listing(actors: Iterable[Actor], time: float) -> str:
    """A whole listing, line ends and end marker included, at most `MAX_LISTING` long.

    Args:
        actors: in the order of the lines; those for whom there is no room are left out.
        time: simulated s.
    """
    lines: list[str] = []
    room = MAX_LISTING - len(END) - 2
    for actor in actors:
        line = _line(actor, time) + "\r\n"
        room -= len(line)
        if room < 0:
            break
        lines.append(line)
    return "".join([*lines, END, "\r\n"])


def _line(actor: Actor, time: float) -> str:
    return (
        f"{{Name {actor.name}}} {{Class {actor.class_name}}} {{Time {_rounded(time, 4)}}} "
        f"{{Location {_vector(actor.location)}}} {{Rotation {_vector(actor.rotation)}}}"
    )


def _vector(values: Vector) -> str:
    return ",".join([_rounded(value, 2) for value in values])


def _rounded(value: float, digits: int) -> str:
    """As the engine prints: rounded, and a small negative number keeps its sign."""
    if not math.isfinite(value):
        value = 0.0
    return f"{value + 0.0:.{digits}f}"  # adding zero: a negative zero has no sign to keep


class QueryFramer(LineFramer):
    """Cuts bytes into queries: LF ends one, CR before it is dropped, empty lines are queries too.

    A line that is too long is thrown away whole.
    """

    __slots__ = ()

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes and return the lines they complete, without line ends."""
        lines: list[bytes] = []
        first, *others = data.split(b"\n")
        self._hold(first)
        for part in others:
            if not self._draining:
                lines.append(bytes(self._held).removesuffix(b"\r"))
            self._held.clear()
            self._draining = False
            self._hold(part)
        return lines


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


GroundTruthQuery = Positions | BetweenRobots | BetweenPoints | Incomplete


@dataclass(frozen=True, slots=True)
class Position:
    """One robot in the answer to GETPOS."""

    name: str  # label, as it was given
    location: Vector  # wire frame, m
    battery_empty: bool = False  # whether it has run out of power


def read_ground_truth_query(line: str) -> GroundTruthQuery | None:
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


def _between(command: Command) -> GroundTruthQuery:
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
