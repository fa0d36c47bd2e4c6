"""Who keeps what happens at a station: a recorder of the session, the scribe of a mission.

A mission in turn tells the station how it goes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from usarsim_operator.pages import Page


@dataclass(frozen=True, slots=True)
class MissionRow:
    """How a mission goes, as `state` tells it.

    Attributes:
        shown: to operators. whole: to those who see the truth.
    """

    shown: Mapping[str, object]
    whole: Mapping[str, object]


class Observer(Protocol):
    """Is told everything, in order, and answers nothing."""

    def input(self, page: Page, text: str, heard: float) -> None:
        """Something that a page said counts now; what made no sense or was not allowed never comes
        here.

        Args:
            page: which. text: as it was sent.
            heard: s of the gateway's clock when it came; in lockstep it waits for the next tick.
        """

    def note(self, kind: str, facts: Mapping[str, object]) -> None:
        """Something happened that pages are not told: a `note` of the rules, an `intervention`,
        a `command` to a robot, a `page_clock`, a `frame_age`."""

    def event(self, fields: Mapping[str, object]) -> None:
        """Something happened that all pages are told, as they are."""


class Observers:
    """All of them, addressed as one."""

    def __init__(self) -> None:
        self._all: list[Observer] = []

    def __bool__(self) -> bool:
        return bool(self._all)

    def add(self, one: Observer) -> None:
        """Tell somebody from now on."""
        self._all.append(one)

    def input(self, page: Page, text: str, heard: float) -> None:
        """Something that a page said counts now."""
        for one in self._all:
            one.input(page, text, heard)

    def note(self, kind: str, facts: Mapping[str, object]) -> None:
        """Something happened."""
        for one in self._all:
            one.note(kind, facts)

    def event(self, fields: Mapping[str, object]) -> None:
        """Something happened that pages are told."""
        for one in self._all:
            one.event(fields)

    def command(self, robot: str, source: str, data: bytes) -> None:
        """A robot is told how to move.

        Args:
            robot: which. data: lines of the protocol.
            source: who is behind it: operator, timed_move, autonomy, watchdog.
        """
        if self._all:
            text = data.decode("latin-1").strip()
            self.note("command", {"robot": robot, "source": source, "text": text})
