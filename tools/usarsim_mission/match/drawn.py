"""What of a run is drawn, collected from its records in one pass."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from usarsim_mission.grid import Grid
from usarsim_mission.match.standing import TOLD, Standing
from usarsim_mission.records import Record

_APART = 0.2  # m between two places of a path
_MOVES = 0.05  # m/s from which a robot moves
_LONGEST_GAP = 0.5  # s between two rows of the truth that belong together


@dataclass
class Span:
    """A time in which something lasts, s of simulated time; it may still last."""

    kind: str
    begins: float
    ends: float | None = None


@dataclass
class Way:
    """One robot.

    Attributes:
        kind: its class. drives: whether it can, or is built to stay where it is.
        path: places, thinned. way: m. moving: s.
        modes, cuts, chosen: times in a mode, without a link, and chosen by an operator.
        touches: times of collisions, and whether with a victim. standing: when it stood, and why.
    """

    kind: str = ""
    drives: bool = True
    path: list[tuple[float, float]] = field(default_factory=list)
    way: float = 0.0
    moving: float = 0.0
    modes: list[Span] = field(default_factory=list)
    cuts: list[Span] = field(default_factory=list)
    chosen: list[Span] = field(default_factory=list)
    touches: list[tuple[float, bool]] = field(default_factory=list)
    standing: Standing = field(default_factory=Standing)
    _last: tuple[float, float, float] | None = None

    def row(self, time: float, pos: Any, linear: Any) -> None:
        """Where it is."""
        if not pos or pos[0] is None or pos[1] is None:
            self._last = None
            return
        x, y = pos[0], pos[1]
        if self._last is not None and time - self._last[0] <= _LONGEST_GAP:
            gap = time - self._last[0]
            self.way += math.hypot(x - self._last[1], y - self._last[2])
            speed = linear and None not in linear and math.hypot(*linear)
            self.moving += gap if speed and speed > _MOVES else 0.0
        self._last = time, x, y
        if not self.path or math.dist((x, y), self.path[-1]) > _APART:
            self.path.append((x, y))

    def end(self, time: float) -> None:
        """Nothing lasts longer than the run."""
        for spans in (self.modes, self.cuts, self.chosen):
            if spans and spans[-1].ends is None:
                spans[-1].ends = time


def turn(spans: list[Span], time: float, kind: str | None) -> None:
    """Something else begins, or nothing does."""
    if spans and spans[-1].ends is None:
        if spans[-1].kind == kind:
            return
        spans[-1].ends = time
    if kind is not None:
        spans.append(Span(kind, time))


@dataclass
class Drawn:
    """What of a run is drawn.

    Attributes:
        robots: by name. scores: time and points. found: time and victim. marks: those that stand.
        wrong: marks that tell of nobody. map: the newest. last: s of simulated time.
        events: time and words, of what the mission lets happen and of trouble.
    """

    robots: dict[str, Way] = field(default_factory=dict)
    scores: list[tuple[float, float]] = field(default_factory=list)
    found: list[tuple[float, str]] = field(default_factory=list)
    marks: dict[str, tuple[float, float]] = field(default_factory=dict)
    wrong: set[str] = field(default_factory=set)
    events: list[tuple[float, str]] = field(default_factory=list)
    map: Grid | None = None
    session: Mapping[str, Any] = field(default_factory=dict)
    last: float = 0.0
    _stopped: bool = False

    def take(self, record: Record) -> None:
        """The next record."""
        time, kind, name = record["t_sim"], record["kind"], record.get("robot")
        self.last = max(self.last, time)
        if isinstance(name, str) and kind in TOLD:
            self._robot(name).standing.take(record)
        match kind:
            case "session":
                self.session = record
                for one in record.get("robots") or ():
                    robot = self._robot(one["name"])
                    robot.kind = str(one.get("class", ""))
                    robot.drives = one.get("drives") is not False
            case "truth":
                for row in record["robots"]:
                    robot = self._robot(row["name"])
                    robot.row(time, row.get("pos"), row.get("linear"))
                    if robot.drives:
                        robot.standing.row(time, row, self._stopped)
            case "estop":
                self._stopped = bool(record["on"])
            case "score":
                self.scores.append((time, record["total"]))
            case "found":
                self.found.append((time, record["victim"]))
            case "mode" if name:
                turn(self._robot(name).modes, time, record["mode"])
            case "link" if name:
                turn(self._robot(name).cuts, time, "lost" if record["state"] == "lost" else None)
            case "select" if name:
                for other, robot in self.robots.items():
                    turn(robot.chosen, time, "chosen" if other == name else None)
            case "collision" if name:
                self._robot(name).touches.append((time, record["with"] == "victim"))
            case "mark_set" | "mark_edit" if record.get("place"):
                self.marks[str(record["mark"])] = record["place"][0], record["place"][1]
                self.wrong.discard(str(record["mark"]))
            case "wrong":
                self.wrong.add(str(record["mark"]))
            case "mark_delete":
                self.marks.pop(str(record["mark"]), None)
            case "hand_in":
                for row in record["victims"]:
                    number, place = f"hand-in {row['number']}", row["place"]
                    self.marks[number] = place[0], place[1]
            case "map":
                self.map = Grid.unpacked(record)
            case "lost":
                self.events.append((time, f"{name} is lost: {record['why']}"))
            case "inject":
                self.events.append((time, str(record["name"])))
            case "error":
                self.events.append((time, str(record["text"])))

    def end(self) -> None:
        """All records were taken."""
        for robot in self.robots.values():
            robot.end(self.last)

    def _robot(self, name: str) -> Way:
        return self.robots.setdefault(name, Way())
