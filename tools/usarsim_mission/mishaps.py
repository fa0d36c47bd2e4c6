"""What goes wrong: contacts, and robots that are lost.

Who touches the same again within the window of the scoring file has touched it once: a window
begins with a contact that counts. A robot is lost, once and for all, when

* it has lain on its side or back (leaning by more than 60 degrees) for 10 s,
* it is more than 1 m outside the bounds of the world,
* its link has been lost for 60 s without a break, or
* it is gone from the world for 1 s although the trial goes on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from usarsim_mission import records
from usarsim_mission.model import World
from usarsim_mission.records import Record
from usarsim_mission.visits import Robot

LEANS = 0.5
"""Cosine of 60 degrees."""
TIPPED, UNLINKED, GONE = 10.0, 60.0, 1.0
"""s."""
OUTSIDE = 1.0
"""m."""
_SAME_TIME = 1e-6


class Contacts:
    """All that robots touched. What is touched without a pause of the window counts once.

    Attributes:
        victims: contacts with victims that count. others: those with the world and of robots.
    """

    def __init__(self, window: float) -> None:
        self.victims, self.others = 0, 0
        self._window = window
        self._touched: dict[tuple[str, ...], float] = {}

    def row(self, robot: str, rows: Iterator[Mapping[str, Any]], time: float) -> Iterator[Record]:
        """What a robot has touched since the last row; yields what counts."""
        for row in rows:
            what, name = records.text(row, "with"), records.text(row, "name")
            at = records.number(row, "time") if "time" in row else time
            key = {
                "robot": ("robot", *sorted((robot, name))),  # both of them tell of it
                "victim": (what, robot, name),
            }.get(what, ("world", robot))
            last = self._touched.get(key)
            self._touched[key] = at
            if last is not None and at < last + self._window - _SAME_TIME:
                continue  # it is still touched, or was just now
            if what == "victim":
                self.victims += 1
            else:
                self.others += 1
            yield {"kind": "collision", "t_sim": time, "robot": robot, "with": what, "name": name}


class Losses:
    """Robots that are lost.

    Attributes:
        lost: why, by name.
    """

    def __init__(self, world: World) -> None:
        self.lost: dict[str, str] = {}
        self._low, self._high = world.low, world.high
        self._since: dict[tuple[str, str], float] = {}

    def row(self, robots: Iterator[Robot], time: float) -> Iterator[Record]:
        """Look at all robots; yields those that are lost by now."""
        for robot in robots:
            if robot.name in self.lost or robot.pos is None:
                continue
            why = self._why(robot, time)
            if why:
                self.lost[robot.name] = why
                yield {"kind": "lost", "t_sim": time, "robot": robot.name, "why": why}

    def _why(self, robot: Robot, time: float) -> str:
        assert robot.pos is not None
        if self._for(robot, "tipped", robot.upright < LEANS, time) >= TIPPED:
            return "tipped over"
        limits = zip(robot.pos, self._low, self._high, strict=True)
        if any(not low - OUTSIDE <= value <= high + OUTSIDE for value, low, high in limits):
            return "out of bounds"
        if self._for(robot, "unlinked", not robot.linked, time) >= UNLINKED:
            return "link lost"
        return "left the world" if time - robot.seen >= GONE - _SAME_TIME else ""

    def _for(self, robot: Robot, what: str, true: bool, time: float) -> float:
        """How long something has been true, s."""
        if not true:
            self._since.pop((robot.name, what), None)
            return -1.0
        return time - self._since.setdefault((robot.name, what), time) + _SAME_TIME
