"""The dialogue of the scoring tools: queries, listings, framing (side channels reference 6).

Tools match listings with positional patterns, so order and blanks are fixed. They also depend on
being answered whatever they say: everything that is no query asks for all pawns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from usarsim_server.protocol.framing import LineFramer
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.values import Vector

__all__ = ["END", "MAX_LISTING", "Actor", "Query", "QueryFramer", "listing", "read_query"]

END = "{End}"
"""The last line of every listing."""

MAX_LISTING = 512 * 1024
"""Longest listing in bytes: some 4500 actors, more than a world holds by default."""


@dataclass(frozen=True, slots=True)
class Query:
    """What is asked for.

    Attributes:
        class_name: class as sent, with or without package; empty for all pawns.
        name: of the only actor wanted, in exactly this case; empty for any.
    """

    class_name: str = ""
    name: str = ""

    @property
    def bare_class(self) -> str:
        """The class without its package, in lower case: the original's names have no case."""
        return self.class_name.rpartition(".")[2].lower()


@dataclass(frozen=True, slots=True)
class Actor:
    """One line of a listing.

    Attributes:
        name: of the actor. class_name: without package.
        location: wire frame, m. rotation: roll, pitch, yaw, rad.
    """

    name: str
    class_name: str
    location: Vector
    rotation: Vector


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
