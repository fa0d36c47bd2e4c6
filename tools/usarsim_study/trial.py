"""One trial as measures see it: spans of attention, of driving, of display, and ways.

Made of the records of a run, in order. Everything is in simulated s and in MuJoCo's frame; spans
are clipped to the trial, and what was chosen or driven when it began still holds.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

Record = dict[str, Any]
"""A line of a log: `seq`, `t_sim` (s), `t_wall` (s), `kind`, and facts."""

DISPLAY_ANGLE = math.radians(30.0)
"""rad off the camera's axis within which a victim counts as displayed."""
DISPLAY_LEAST = 2.0
"""s that a display must exceed to count."""
MOVING_SPEED = 0.05
"""m/s from which on a robot moves."""
MOVING_TURN = 0.1
"""rad/s from which on a robot moves on the spot."""
PAUSE = 3.0
"""s without a command after which an interaction has ended."""
CLOCK = 1e-9
"""s: spans that differ by less are equally long, since differences of clock times are rounded."""
JUMP = 10.0
"""m/s beyond which a robot was put elsewhere, and did not drive there."""
COMPLETE = frozenset({"time", "operator", "all_found"})
"""Ends of trials that count; others are missing data."""

_OWN = frozenset({"operator"})
_WISHES: Mapping[str, tuple[str, ...]] = {
    "drive": ("left", "right"),
    "steer": ("speed", "steer"),
    "fly": ("altitude", "linear", "lateral", "rotational"),
}
"""What an operator's page says to drive; all of it 0: keys and stick are let go."""
_ZERO = re.compile(r"[-+]?0*\.?0*(e[-+]?\d+)?", re.IGNORECASE)
_PARAMETER = re.compile(r"\{\s*\S+\s+(?P<value>[^{}]*?)\s*\}")


@dataclass(frozen=True, slots=True)
class Span:
    """From `begin` to `end`, s, of a robot.

    Attributes:
        who: the operator; empty: nobody knows, or it does not matter.
        what: the victim of a display.
        switched: a dwell that began within the trial, and not with the first choice.
    """

    robot: str
    begin: float
    end: float
    who: str = ""
    what: str = ""
    switched: bool = False

    @property
    def length(self) -> float:
        """s."""
        return self.end - self.begin


@dataclass(frozen=True, slots=True)
class Command:
    """What an operator told a robot. driven: until `end`, with wheels that turn."""

    robot: str
    who: str
    begin: float
    end: float
    driven: bool
    changed: bool


@dataclass(frozen=True, slots=True)
class Row:
    """A robot at a time; it holds until `end`. moving: it drives or turns."""

    time: float
    end: float
    pos: Sequence[float]
    moving: bool


class Trial:
    """The records of one trial, seen in several ways.

    Attributes:
        records: all of them.
        score: what `score.json` says, if there is one.
        begin, end: of the trial, s; NaN if it did not begin or end.
        why: how it ended: time, operator, all_found, aborted, error; empty: it did not.
    """

    def __init__(self, records: Iterable[Record], score: dict[str, Any] | None = None) -> None:
        self.records = tuple(records)
        self.score = score or {}
        self.begin = self.end = math.nan
        self.why = ""
        for record in self.records:
            if record["kind"] == "trial_start":
                self.begin, self.end, self.why = float(record["t_sim"]), math.nan, ""
            elif record["kind"] == "trial_end":
                self.end, self.why = float(record["t_sim"]), str(record.get("why", "error"))

    @property
    def complete(self) -> bool:
        """Whether it ran to an end that counts; if not, all its measures are missing."""
        return self.why in COMPLETE and self.end > self.begin

    @property
    def length(self) -> float:
        """s."""
        return self.end - self.begin

    @property
    def judged(self) -> bool:
        """Whether a referee has judged it."""
        return any(self.all(kind) for kind in ("score", "found", "collision", "wrong", "zone"))

    @cached_property
    def _by_kind(self) -> dict[str, list[Record]]:
        found: dict[str, list[Record]] = defaultdict(list)
        for record in self.records:
            found[record["kind"]].append(record)
        return found

    def all(self, kind: str) -> list[Record]:
        """Records of a kind, also before and after the trial."""
        return self._by_kind.get(kind, [])

    def of(self, *kinds: str) -> list[Record]:
        """Records of kinds within the trial, in order."""
        if len(kinds) == 1:
            pool: Iterable[Record] = self.all(kinds[0])
        else:
            pool = (record for record in self.records if record["kind"] in kinds)
        return [record for record in pool if self.begin <= record["t_sim"] <= self.end]

    @cached_property
    def robots(self) -> tuple[str, ...]:
        """Names, as the session tells them, then those that only truth knows."""
        names: dict[str, None] = {}
        for record in self.all("session"):
            names.update(dict.fromkeys(one["name"] for one in record.get("robots", ())))
        for record in self.all("truth"):
            names.update(dict.fromkeys(one["name"] for one in record.get("robots", ())))
        return tuple(names)

    @cached_property
    def _names(self) -> dict[Any, str]:
        """Operators by their pages; a page that comes again under its name is the same one.

        In the trial of a study each has a seat, whatever the page is called.
        """
        connects = self.all("connect")
        seated = any("participant" in one for one in self.all("session"))
        names = {
            one["page"]: f"operator {one['seat']}"
            if seated and one.get("seat")
            else str(one.get("name") or one["page"])
            for one in sorted(connects, key=lambda one: one.get("seat") or 0 if seated else 0)
            if one.get("role") == "operator"
        }
        if not names:
            told = {one["page"] for one in connects}
            for kind in ("select", "input"):
                for one in self.all(kind):
                    page = one.get("page")
                    if page not in told and one.get("role", "operator") == "operator":
                        names.setdefault(page, str(page))
        return names

    @cached_property
    def operators(self) -> tuple[str, ...]:
        """Names of those who drive, or numbers of their pages."""
        return tuple(dict.fromkeys(self._names.values()))

    def operator(self, page: Any) -> str:
        """Who is at a page; empty: no operator."""
        return self._names.get(page, "")

    @cached_property
    def selections(self) -> tuple[Record, ...]:
        """Choices of another robot within the trial."""
        current: dict[str, Any] = {}
        found = []
        for record in self.all("select"):
            who, robot = self.operator(record.get("page")), record.get("robot")
            if not who or current.get(who) == robot:
                continue
            current[who] = robot
            if robot and self.begin <= record["t_sim"] <= self.end:
                found.append(record)
        return tuple(found)

    @cached_property
    def dwells(self) -> tuple[Span, ...]:
        """Spans in which an operator has chosen a robot."""
        open_: dict[str, tuple[str, float, bool]] = {}
        found = []

        def close(who: str, time: float) -> None:
            robot, begin, switched = open_.pop(who, ("", 0.0, False))
            begin, end = max(begin, self.begin), min(time, self.end)
            if robot and end > begin:
                found.append(Span(robot, begin, end, who, switched=switched))

        chosen: set[str] = set()
        for record in self.all("select"):
            who, robot = self.operator(record.get("page")), record.get("robot")
            if not who or open_.get(who, ("",))[0] == robot:
                continue
            close(who, record["t_sim"])
            if robot:
                switched = who in chosen and self.begin <= record["t_sim"] < self.end
                open_[who] = str(robot), float(record["t_sim"]), switched
                chosen.add(who)
        for who in list(open_):
            close(who, self.end)
        return tuple(sorted(found, key=lambda one: (one.begin, one.who)))

    @cached_property
    def _told(self) -> dict[str, list[tuple[Record, str]]]:
        """Commands by robot, each with the operator.

        Logs of earlier versions have no command when an operator lets go, only what the page said:
        the command is inferred from that, a record `command` that is `inferred`.
        """
        selected: dict[str, Any] = {}
        driver: dict[Any, str] = {}
        told: dict[str, list[tuple[Record, str]]] = defaultdict(list)
        for record in self.records:
            match record["kind"]:
                case "select":
                    selected[self.operator(record.get("page"))] = record.get("robot")
                case "input":
                    who = self.operator(record.get("page"))
                    text = record.get("text")
                    named = text.get("robot") if isinstance(text, dict) else None
                    if who:
                        robot = str(named or selected.get(who))
                        driver[robot] = who
                        rows = told.get(robot)
                        if rows and _lets_go(text) and _driven_by(rows[-1], who):
                            stop = {"kind": "command", "robot": robot, "source": "operator"}
                            rows.append(({**stop, "t_sim": record["t_sim"], "inferred": True}, who))
                case "command":
                    robot = str(record["robot"])
                    who = self.operator(record.get("page")) or driver.get(robot, "")
                    who = who or next((one for one, it in selected.items() if it == robot), "")
                    rows = told[robot]
                    if rows and rows[-1][0].get("inferred") and _same_time(rows[-1][0], record):
                        rows.pop()  # the log has the command itself
                    rows.append((record, who))
        return told

    @property
    def inferred_stops(self) -> int:
        """How often within the trial an operator let go and the log has no command of it."""
        return sum(
            bool(record.get("inferred")) and self.begin <= record["t_sim"] <= self.end
            for rows in self._told.values()
            for record, _ in rows
        )

    @cached_property
    def commands(self) -> tuple[Command, ...]:
        """What operators told robots; each command holds until the robot's next one."""
        found = []
        for robot, rows in self._told.items():
            last: object = None
            for place, (record, who) in enumerate(rows):
                following = rows[place + 1][0]["t_sim"] if place + 1 < len(rows) else math.inf
                content = tuple(record.get(key) for key in ("left", "right", "text"))
                changed, last = content != last, content
                begin, end = max(record["t_sim"], self.begin), min(following, self.end)
                if record.get("source") in _OWN and begin <= end:
                    inside = record["t_sim"] >= self.begin
                    driven = _drives(record)
                    if inside or driven:
                        found.append(Command(robot, who, begin, end, driven, changed and inside))
        return tuple(sorted(found, key=lambda one: one.begin))

    @cached_property
    def interactions(self) -> tuple[Span, ...]:
        """Spans in which an operator deals with a robot: commands with pauses of at most `PAUSE`.

        The first of a dwell begins with the choice of the robot: looking and planning belong to it.
        """
        found = []
        pairs = dict.fromkeys((one.who, one.robot) for one in self.commands)
        for who, robot in pairs:
            acts = [one for one in self.commands if (one.who, one.robot) == (who, robot)]
            dwells = [one for one in self.dwells if (one.who, one.robot) == (who, robot)]
            groups: list[tuple[float, float, int]] = []
            for one in acts:
                end = one.end if one.driven else one.begin
                home = _dwell_at(dwells, one.begin)
                if groups and one.begin - groups[-1][1] <= PAUSE + CLOCK and groups[-1][2] == home:
                    groups[-1] = groups[-1][0], max(groups[-1][1], end), home
                else:
                    groups.append((one.begin, end, home))
            used: set[int] = set()
            for begin, end, home in groups:
                first = home >= 0 and home not in used
                used.add(home)
                found.append(Span(robot, dwells[home].begin if first else begin, end, who))
        return tuple(sorted(found, key=lambda one: (one.begin, one.robot)))

    @cached_property
    def displays(self) -> tuple[Span, ...]:
        """Spans in which a robot's camera shows a victim: within 30 degrees of its axis, not
        hidden, for more than 2 s."""
        open_: dict[tuple[str, str], float] = {}
        found = []
        for record in self.of("truth"):
            time = float(record["t_sim"])
            seen = {
                (str(one["robot"]), str(one["victim"]))
                for one in record.get("views", ())
                if one.get("clear") and abs(one.get("angle", math.inf)) <= DISPLAY_ANGLE
            }
            for pair in [one for one in open_ if one not in seen]:
                found.append(Span(pair[0], open_.pop(pair), time, what=pair[1]))
            for pair in seen:
                open_.setdefault(pair, time)
        found += [Span(robot, begin, self.end, what=it) for (robot, it), begin in open_.items()]
        lasting = (one for one in found if one.length > DISPLAY_LEAST + CLOCK)
        return tuple(sorted(lasting, key=lambda one: (one.begin, one.robot, one.what)))

    @cached_property
    def tracks(self) -> dict[str, list[Row]]:
        """Where each robot was, and whether it moved, row by row."""
        raw: dict[str, list[tuple[float, Sequence[float], bool]]] = defaultdict(list)
        for record in self.of("truth"):
            for one in record.get("robots", ()):
                turn = math.hypot(*one.get("angular", (0.0,)))
                moving = math.hypot(*one.get("linear", (0.0,))) >= MOVING_SPEED
                raw[one["name"]].append(
                    (float(record["t_sim"]), one["pos"], moving or turn >= MOVING_TURN)
                )
        return {
            name: [
                Row(time, rows[place + 1][0] if place + 1 < len(rows) else self.end, pos, moving)
                for place, (time, pos, moving) in enumerate(rows)
            ]
            for name, rows in raw.items()
        }


def _dwell_at(dwells: Sequence[Span], time: float) -> int:
    for place, one in enumerate(dwells):
        if one.begin <= time <= one.end:
            return place
    return -1


def _lets_go(text: object) -> bool:
    """Whether a page says that nothing drives any more."""
    if not isinstance(text, dict):
        return False
    said = [text[key] for key in _WISHES.get(str(text.get("type")), ()) if key in text]
    return bool(said) and not any(said)


def _driven_by(told: tuple[Record, str], who: str) -> bool:
    """Whether a command is one of this operator that moves something."""
    record, driver = told
    return driver == who and record.get("source") in _OWN and _drives(record)


def _same_time(one: Record, other: Record) -> bool:
    return abs(float(one["t_sim"]) - float(other["t_sim"])) <= CLOCK


def _drives(record: Record) -> bool:
    """Whether a command moves something."""
    wheels = (record.get("left"), record.get("right"))
    if any(one is not None for one in wheels):
        return any(one for one in wheels)
    values = _PARAMETER.findall(str(record.get("text") or ""))
    return any(
        not _ZERO.fullmatch(part) and part.lower() not in ("true", "false")
        for value in values
        for part in value.split(",")
    )


def without(
    spans: Iterable[tuple[float, float]], holes: Iterable[Span]
) -> list[tuple[float, float]]:
    """Spans less other spans, joined where they touch, in order."""
    joined: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        if joined and begin <= joined[-1][1] + CLOCK:
            joined[-1] = joined[-1][0], max(end, joined[-1][1])
        else:
            joined.append((begin, end))
    for hole in holes:
        parts = []
        for begin, end in joined:
            if hole.end <= begin or hole.begin >= end:
                parts.append((begin, end))
                continue
            if hole.begin > begin:
                parts.append((begin, hole.begin))
            if hole.end < end:
                parts.append((hole.end, end))
        joined = parts
    return joined
