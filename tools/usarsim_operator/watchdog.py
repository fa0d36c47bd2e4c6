"""Stops robots whose driver falls silent; reads no clock, all times are s of the gateway's."""

from __future__ import annotations

from dataclasses import dataclass

DRIVE_TIME = 0.45
"""s without `drive` after which a moving robot must stop. The demand is 0.5 s; the rest is for the
gateway's own pulse and the way to the server."""

PAGE_TIME = 3.0
"""s after which a silent page counts as gone."""


@dataclass(slots=True)
class _Moving:
    page: int
    last: float


class Watchdog:
    """Remembers which robots move by whose hand, and when each page was last heard."""

    def __init__(self) -> None:
        self._moving: dict[str, _Moving] = {}
        self._heard: dict[int, float] = {}

    def drove(self, robot: str, page: int, neutral: bool, now: float) -> None:
        """A drive of a page was sent to a robot; neutral needs no watching."""
        if neutral:
            self._moving.pop(robot, None)
        else:
            self._moving[robot] = _Moving(page, now)

    def heard(self, page: int, now: float) -> None:
        """A page said something."""
        self._heard[page] = now

    def restart(self, now: float) -> None:
        """Another clock counts from now on."""
        for one in self._moving.values():
            one.last = now
        self._heard = dict.fromkeys(self._heard, now)

    def stopped(self, robot: str) -> None:
        """A robot was stopped by somebody else, or has left."""
        self._moving.pop(robot, None)

    def gone(self, page: int) -> list[str]:
        """A page has gone; the robots that it was moving."""
        self._heard.pop(page, None)
        found = [robot for robot, one in self._moving.items() if one.page == page]
        for robot in found:
            del self._moving[robot]
        return found

    def overdue(self, now: float) -> list[str]:
        """Robots that must stop now; each is told once."""
        found = [robot for robot, one in self._moving.items() if now - one.last >= DRIVE_TIME]
        for robot in found:
            del self._moving[robot]
        return found

    def silent(self, now: float) -> list[int]:
        """Pages that count as gone."""
        return [page for page, last in self._heard.items() if now - last >= PAGE_TIME]
