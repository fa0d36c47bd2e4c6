"""What an attack is, and what is promised in spite of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from usarsim_tools.bench.hostile.links import Link, Site

__all__ = ["KIB", "MIB", "Answers", "Attack"]

KIB, MIB = 2.0**10, 2.0**20

Answers = Mapping[str, bytes]
"""The latest answer to a newcomer on each port, see `newcomers.QUESTIONS`."""


@dataclass(frozen=True, slots=True)
class Attack:
    """One way to mean a server no good.

    Attributes:
        name: as in `--attack NAME`.
        what: what the attackers do, for people.
        links: makes their connections; may prepare something, with calls that block.
        ports: where a new client must get its answer meanwhile, beside robot control.
        growth: bytes that the server's memory may grow by.
        options: of the server.
        faults: of the answers that new clients got meanwhile; none if they are as promised.
        descriptors: that the server may hold more than before.
        busy_loops: programs that only need a processor. With them, or with a speed that the
            machine cannot keep, only what is lost counts, not how fast it went.
    """

    name: str
    what: str
    links: Callable[[Site], Sequence[Link]]
    ports: tuple[str, ...] = ()
    growth: float = 64 * MIB
    options: tuple[str, ...] = ()
    faults: Callable[[Answers], Sequence[str]] = lambda _: ()
    descriptors: int = 512
    busy_loops: int = 0

    @property
    def overload(self) -> bool:
        """Whether the machine cannot keep pace, whatever the server does."""
        return self.busy_loops > 0 or "--speed" in self.options
