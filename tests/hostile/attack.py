"""What an attack is, and what is promised in spite of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from hostile.links import Link, Site

MIB = 2.0**20

HOLD_WAIT = 10.0
"""s after which a new client must have got a place at a port that idle connections hold."""
HOLD_LEAST = 14.0

Answers = Mapping[str, bytes]
"""The latest answer to a newcomer on each port, see `newcomers.QUESTIONS`; under `team` the names
of the streams that the robots get."""


Links = Callable[[Site], Sequence[Link]]
"""Makes the connections of attackers; may prepare something, with calls that block."""


@dataclass(frozen=True, slots=True)
class Attack:
    """One way to mean a server no good."""

    name: str  # as in `--attack NAME`
    what: str  # what the attackers do, for people
    links: Links
    ports: tuple[str, ...] = ()
    """Where a new client must get its answer meanwhile, beside robot control."""
    growth: float = 64 * MIB  # bytes that the server's memory may grow by
    options: tuple[str, ...] = ()  # of the server
    faults: Callable[[Answers], Sequence[str]] = lambda _: ()
    """Of the answers that new clients got meanwhile; none if they are as promised."""
    descriptors: int = 512  # that the server may hold more than before
    wait: float = 2.0  # s that a new client may have to wait for its answer
    least: float = 0.0  # s that the attack must last to show anything
    web: bool = False  # the console and the desk of a study stand beside the server
    busy_loops: int = 0
    """Programs that only need a processor. With them, or with a speed that the machine cannot keep,
    only what is lost counts, not how fast it went."""

    @property
    def overload(self) -> bool:
        """Whether the machine cannot keep pace, whatever the server does."""
        return self.busy_loops > 0 or "--speed" in self.options


def holding(name: str, port: str, first: bytes = b"") -> Attack:
    """More idle connections than a port has places for; each says something first."""

    def links(site: Site) -> Sequence[Link]:
        # They read, so that they notice when they are thrown out, and come back.
        return [Link(site.ports[port], first, reads=True) for _ in range(80)]

    said = "after one request" if first else "that say nothing"
    return Attack(
        name, f"80 connections {said} hold a port", links, (port,), wait=HOLD_WAIT, least=HOLD_LEAST
    )
