"""Alarms of all robots: each cause is told once, the worst first, and few of them on a screen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

SHOWN = 5
"""Alarms that a page is told at a time."""
KEPT = 500
"""Alarms that wait to be acknowledged; older and milder ones are only in the log."""
CALM = 2.0
"""Simulated s without its cause after which an alarm may come again."""

STUCK_SPEED = 0.1
"""Part of full power beyond which a robot ought to move."""
STUCK_WAY = 0.02
"""m within `STUCK_TIME` that count as not moved."""
STUCK_TIME = 3.0
"""Simulated s."""

SEVERITY = {"tipped": 3, "link": 3, "stuck": 2, "battery": 2, "collision": 2, "stale": 1}
"""3 is the worst."""


@dataclass(slots=True)
class Alarm:
    """Something to look after.

    Attributes:
        id: never used again. robot: its name. kind: key of `SEVERITY`. text: for the operator.
        since: simulated s at its beginning. last: simulated s when its cause was seen last.
        active: whether its cause is there. count: how often it has come back.
    """

    id: int
    robot: str
    kind: str
    text: str
    since: float
    last: float
    active: bool = True
    acknowledged: bool = False
    count: int = 1

    @property
    def severity(self) -> int:
        """1 to 3, 3 is the worst."""
        return SEVERITY[self.kind]


class Alarms:
    """All alarms; reads no clock."""

    def __init__(self, log: Callable[[str, dict[str, object]], None]) -> None:
        self._log = log
        self._alarms: dict[tuple[str, str], Alarm] = {}
        self._count = 0

    def see(self, robot: str, kind: str, on: bool, text: str, time: float) -> None:
        """Say whether the cause of an alarm is there.

        Args:
            robot: its name. kind: of the alarm.
            on: whether the cause is there.
            text: for the operator.
            time: simulated s.
        """
        alarm = self._alarms.get((robot, kind))
        if not on:
            if alarm is not None and time - alarm.last >= CALM:
                alarm.active = False
                if alarm.acknowledged:
                    del self._alarms[robot, kind]
            return
        if alarm is None:
            self._raise(robot, kind, text, time)
        elif not alarm.active:
            alarm.active, alarm.acknowledged, alarm.since = True, False, time
            alarm.count += 1
            alarm.text = text
            self._log("alarm again", {"robot": robot, "kind": kind, "alarm": alarm.id})
        if alarm is not None:
            alarm.last = time

    def _raise(self, robot: str, kind: str, text: str, time: float) -> None:
        self._count += 1
        if len(self._alarms) >= KEPT:
            mildest = min(self._alarms.values(), key=lambda one: (one.severity, one.id))
            del self._alarms[mildest.robot, mildest.kind]
        self._alarms[robot, kind] = Alarm(self._count, robot, kind, text, time, time)
        self._log("alarm", {"robot": robot, "kind": kind, "alarm": self._count, "text": text})

    def acknowledge(self, id: int) -> bool:
        """An operator has seen an alarm; one whose cause is gone vanishes. False without it."""
        for key, alarm in self._alarms.items():
            if alarm.id == id:
                alarm.acknowledged = True
                robot, kind = key
                self._log("acknowledged", {"robot": robot, "kind": kind, "alarm": id})
                if not alarm.active:
                    del self._alarms[key]
                return True
        return False

    def forget(self, robot: str) -> None:
        """A robot has left."""
        for key in [one for one in self._alarms if one[0] == robot]:
            del self._alarms[key]

    def clear(self) -> None:
        """The world has begun anew: what is still so is told as new."""
        self._alarms.clear()

    def shown(self) -> tuple[list[dict[str, object]], int]:
        """The worst as `state` tells them, and how many more there are."""
        order = sorted(
            self._alarms.values(), key=lambda one: (one.acknowledged, -one.severity, -one.id)
        )
        rows: list[dict[str, object]] = [
            {
                "id": one.id,
                "robot": one.robot,
                "kind": one.kind,
                "severity": one.severity,
                "text": one.text,
                "since": one.since,
                "acknowledged": one.acknowledged,
                "count": one.count,
            }
            for one in order[:SHOWN]
        ]
        return rows, len(order) - len(rows)


class StuckWatch:
    """Tells whether a robot of a foreign server that ought to move does not; times are simulated s.

    Our own server tells it itself (`stuck` of the scene port), and knows more of its robots.
    """

    def __init__(self) -> None:
        self._from: tuple[float, float, float] | None = None

    def stuck(self, power: float, place: tuple[float, float], time: float) -> bool:
        """Whether it has hardly moved for `STUCK_TIME` at a power (0 to 1) beyond the limit."""
        x, y = place
        if power <= STUCK_SPEED:
            self._from = None
            return False
        begun = self._from
        if begun is None or abs(x - begun[0]) + abs(y - begun[1]) >= STUCK_WAY:
            self._from = x, y, time
            return False
        return time - begun[2] >= STUCK_TIME
