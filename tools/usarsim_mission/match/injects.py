"""When the events of a scenario are due, by what has happened so far; nothing is done here."""

from __future__ import annotations

import heapq
import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

from usarsim_mission.scenario.description import Event
from usarsim_operator.injects import Inject

_WHEN = {
    "found": ("found", "victim"),
    "credited": ("credit", "victim"),
    "enters": ("zone", "zone"),
    "leaves": ("zone", "zone"),
    "collision": ("collision", "robot"),
    "lost": ("lost", "robot"),
    "first_input": ("input", "page"),
}
"""Kind of the record, and its fact that `of` names."""


class Injects:
    """The events of one trial."""

    def __init__(self, events: tuple[Event, ...]) -> None:
        self._events = events
        self._left = {one.name: one.count for one in events if one.when is not None}
        self._due: list[tuple[float, int, Event]] = []
        self._order = itertools.count()

    def begin(self, time: float) -> None:
        """The trial begins at this simulated time, s."""
        for one in self._events:
            if one.at is not None:
                self._add(time + one.at, one)

    def hear(self, record: Mapping[str, Any]) -> None:
        """A record of the log; events that wait for it come nearer."""
        for one in self._events:
            if self._left.get(one.name, 0) < 1 or one.when is None:
                continue
            kind, whose = _WHEN[one.when]
            fits = record["kind"] == kind and one.of in (None, record.get(whose))
            if one.when in ("enters", "leaves"):
                fits = fits and record.get("enter") is (one.when == "enters")
            if one.when == "credited":
                fits = fits and bool(record.get("credited"))
            if fits:
                self._left[one.name] -= 1
                if self._left[one.name] == 0:
                    self._add(record["t_sim"] + one.after, one)

    def due(self, time: float) -> Iterator[Event]:
        """Events that are to happen by now."""
        while self._due and self._due[0][0] <= time + 1e-9:
            yield heapq.heappop(self._due)[2]

    def _add(self, time: float, event: Event) -> None:
        heapq.heappush(self._due, (time, next(self._order), event))


def inject_of(event: Event) -> Inject:
    """What the gateway has to do for an event; its line is what the scenario says of it."""
    said = {
        one.name: getattr(event, one.name)
        for one in fields(event)
        if getattr(event, one.name) != one.default
    }
    line = ", ".join(f"{key} = {json.dumps(value)}" for key, value in said.items())
    return Inject(
        event.do,
        event.robot or "",
        event.victim or "",
        event.text,
        event.lasts,
        event.name,
        line,
        "the mission",
    )
