"""What a measurement is asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Plan:
    """What to measure with."""

    robots: int | None = None  # size of the team; None for the measurement's own
    seconds: float | None = None
    """How long to measure; None for the measurement's own. What it means in each case is said by
    the measurement."""
    world: str = "arena"  # name or folder of the world
    seed: int = 0  # of the clients' behaviour
    say: Callable[[str], None] = lambda _: None  # told what goes on while it takes its time
    brief: bool = False
    """Only to see whether something is badly wrong: of several sizes one is enough."""
    only: tuple[str, ...] = ()  # names of the cases that a measurement is to take; none for all

    def sizes(self, usual: Sequence[int], brief: int) -> tuple[int, ...]:
        """Sizes of the teams to measure: the one asked for, else the measurement's usual ones, or
        the one of them that is enough if it is to be brief."""
        if self.robots is not None:
            return (self.robots,)
        return (brief,) if self.brief else tuple(usual)
