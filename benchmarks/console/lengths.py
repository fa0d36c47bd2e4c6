"""How long the measurements of the console last."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Iterator

from benchmarks.plan import Plan

_TOLD = 20.0
"""s between two lines that say how it goes."""


def seconds(plan: Plan, usual: float, brief: float) -> float:
    """s of one measurement: as asked for, else its own."""
    return plan.seconds or (brief if plan.brief else usual)


def count(plan: Plan, usual: int, brief: int, each: float) -> int:
    """How often something is done; for a length that was asked for as often as it allows, at least
    three times. each: s that one takes, about."""
    if plan.seconds is not None:
        return max(3, int(plan.seconds / each))
    return brief if plan.brief else usual


class Course:
    """Says how far a measurement has come."""

    def __init__(self, plan: Plan, unit: str, whole: float) -> None:
        self._plan, self._unit, self._whole = plan, unit, whole
        self._told = time.perf_counter()

    def at(self, done: float) -> None:
        """So much is done; said now and then."""
        if time.perf_counter() >= self._told + _TOLD:
            self._told = time.perf_counter()
            self._plan.say(f"{done:.0f} of {self._whole:g} {self._unit}")


@contextlib.contextmanager
def until_interrupted() -> Iterator[None]:
    """What an interrupt ends inside goes on behind it, with what there is."""
    try:
        yield
    except asyncio.CancelledError:
        if (task := asyncio.current_task()) is not None:
            task.uncancel()


async def stay(plan: Plan, length: float) -> None:
    """Wait so many s, and say how it goes."""
    course, begun = Course(plan, "s", length), time.perf_counter()
    while (gone := time.perf_counter() - begun) < length:
        course.at(gone)
        await asyncio.sleep(min(1.0, length - gone))
