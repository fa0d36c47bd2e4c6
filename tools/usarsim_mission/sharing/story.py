"""What happened in a run, gathered from its records: motion, driving, marks, points, events.

Times are simulated seconds as logged; places are in MuJoCo's frame, m. Names of people, what they
answered, and notes of theirs are left out: the file is made to be passed on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_mission.grid import Grid
from usarsim_mission.records import Record, number, place, rows

SOURCES = ("", "operator", "timed_move", "autonomy", "controller", "watchdog")
"""Who told a robot to move; a number of the list is packed."""
LATEST = 0.5
"""s between two other commands of a robot that are kept, at least."""
_UNTOLD = frozenset({None, "drive", "fly", "steer", "hello", "shown", "ping", "lines"})
"""Texts of pages that are no events: what drives is shown as such, the others are no doing."""
_WHEELS = re.compile(r"\{\s*(Left|Right)\s+([-+.\deE]+)\s*\}", re.IGNORECASE)

Row = tuple[int, tuple[float, ...]]
"""Number of a row of the truth, and a robot's x, y, z (m), w, x, y, z in it."""


@dataclass
class Robot:
    """A robot's part."""

    kind: str = ""
    poses: list[Row] = field(default_factory=list)
    driven: list[tuple[float, float, float, int]] = field(default_factory=list)
    """Time, power of the left and right wheels, and who says it, whenever that changes."""
    told: list[tuple[float, str]] = field(default_factory=list)
    """Time and text of commands that are not about wheels."""
    modes: list[tuple[float, str]] = field(default_factory=list)


@dataclass
class Mark:
    """A mark while it stands at a place: from `begin` to `end`, s."""

    name: str
    begin: float
    x: float
    y: float
    robot: str
    verdict: str = ""
    end: float | None = None


@dataclass
class Story:
    """All of it; `take` each record in order."""

    session: Record = field(default_factory=dict)
    times: list[float] = field(default_factory=list)
    robots: dict[str, Robot] = field(default_factory=dict)
    victims: dict[str, list[Row]] = field(default_factory=dict)
    marks: list[Mark] = field(default_factory=list)
    scores: list[tuple[float, float]] = field(default_factory=list)
    maps: list[tuple[float, Grid]] = field(default_factory=list)
    selected: list[tuple[float, int, str]] = field(default_factory=list)
    events: list[tuple[float, str, str, str]] = field(default_factory=list)
    """Time, kind, robot and words."""
    looks: int = 0
    """Times that a victim was in a camera's view, which no event tells."""

    def take(self, record: Record) -> None:
        """The next record."""
        kind = str(record["kind"])
        time = number(record, "t_sim") if record.get("t_sim") is not None else 0.0
        match kind:
            case "truth":
                self._truth(time, record)
            case "command":
                self._command(time, record)
            case "session":
                self.session |= record
                for one in record.get("robots") or ():
                    self.robot(str(one["name"])).kind = str(one.get("class", ""))
            case "score":
                self.scores.append((time, number(record, "total")))
            case "map":
                self.maps.append((time, Grid.unpacked(record)))
            case "victim_visible_begin":
                self.looks += 1
            case "select":
                self.selected.append((time, int(record["page"]), str(record["robot"])))
            case "connect" if record.get("on") is False:
                self.selected.append((time, int(record["page"]), ""))
            case "mode":
                self.robot(str(record["robot"])).modes.append((time, str(record["mode"])))
            case "mark_set" | "mark_edit" | "mark_delete":
                self._mark(time, record)
            case "duplicate" | "wrong" | "found":
                for mark in self.marks:
                    if record.get("mark") is not None and mark.name == str(record["mark"]):
                        mark.verdict = kind
        words = WORDS.get(kind)
        if words is not None and (told := words(_Facts(record))):
            self.events.append((time, kind, str(record.get("robot") or ""), told))

    def robot(self, name: str) -> Robot:
        """A robot's part, made when it is first heard of."""
        return self.robots.setdefault(name, Robot())

    def _truth(self, time: float, record: Record) -> None:
        row = len(self.times)
        self.times.append(time)
        for one in rows(record, "robots"):
            pose = _finite_all((*one["pos"], *one["quat"]))
            if len(pose) == 7:
                self.robot(str(one["name"])).poses.append((row, pose))
        for one in rows(record, "victims"):
            walk = self.victims.setdefault(str(one["name"]), [])
            pos = _finite_all(one["pos"])
            if len(pos) == 3 and (not walk or walk[-1][1] != pos):
                walk.append((row, pos))

    def _command(self, time: float, record: Record) -> None:
        robot = self.robot(str(record["robot"]))
        source = str(record.get("source", ""))
        who = SOURCES.index(source) if source in SOURCES else 0
        text = str(record.get("text") or "")
        wheels = {name.lower(): value for name, value in _WHEELS.findall(text)}
        left = _finite(record.get("left", wheels.get("left")))
        right = _finite(record.get("right", wheels.get("right")))
        if left is not None and right is not None:
            if not robot.driven or robot.driven[-1][1:] != (left, right, who):
                robot.driven.append((time, left, right, who))
        elif not robot.told or (robot.told[-1][1] != text and time - robot.told[-1][0] >= LATEST):
            robot.told.append((time, text[:120]))

    def _mark(self, time: float, record: Record) -> None:
        name = str(record["mark"])
        before = next((one for one in reversed(self.marks) if one.name == name), None)
        there = place(record, "place") or ((before.x, before.y, 0.0) if before else None)
        if before is not None and before.end is None:
            stays = there is not None and (before.x, before.y) == there[:2]
            if record["kind"] == "mark_edit" and stays:
                return
            before.end = time
        if record["kind"] != "mark_delete" and there is not None:
            robot = str(record.get("robot") or (before.robot if before else ""))
            self.marks.append(Mark(name, time, there[0], there[1], robot))


class _Facts(dict[str, Any]):
    """A record of which nothing is missing: other programs may write less."""

    def __missing__(self, key: str) -> str:
        return "?"


def _finite_all(values: Sequence[object]) -> tuple[float, ...]:
    """Numbers; none of them if one is none."""
    found = [one for value in values if (one := _finite(value)) is not None]
    return tuple(found) if len(found) == len(values) else ()


def _finite(value: object) -> float | None:
    try:
        found = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None


def _said(record: Mapping[str, Any]) -> str:
    """What an operator did at a page; driving is shown elsewhere, texts of people are not."""
    said = record.get("text")
    if not isinstance(said, Mapping) or said.get("type") in _UNTOLD:
        return ""
    words = [str(said["type"]).replace("_", " ")]
    words += [str(said[key]) for key in ("robot", "policy", "mode") if said.get(key)]
    if isinstance(said.get("on"), bool):
        words.append("on" if said["on"] else "off")
    return f"operator {record.get('page')}: {' '.join(words)}"


def _on(record: Mapping[str, Any], yes: str, no: str) -> str:
    return yes if record.get("on") else no


WORDS: dict[str, Callable[[Record], str]] = {
    "trial_start": lambda _: "the trial begins",
    "trial_end": lambda one: f"the trial ends: {one.get('why')}",
    "found": lambda one: f"{one['victim']} found by {one['robot']} ({one.get('how', '')})",
    "credit": lambda one: (
        f"{one['victim']} {'credited' if one.get('credited') else 'not credited'}: {one.get('why')}"
    ),
    "duplicate": lambda one: f"mark {one['mark']} tells of {one.get('victim')} again",
    "wrong": lambda one: f"mark {one['mark']} is wrong",
    "lost": lambda one: f"{one['robot']} is lost: {one.get('why')}",
    "collision": lambda one: (
        f"{one['robot']} touches {one.get('name') or 'the world'}"
        + (", a victim" if one.get("with") == "victim" else "")
    ),
    "zone": lambda one: (
        f"{one['robot']} {'enters' if one.get('enter') else 'leaves'} {one['zone']}"
        f" ({one['colour']})"
    ),
    "mode": lambda one: f"{one['robot']} is {one['mode']}",
    "estop": lambda one: _on(one, "emergency stop", "the emergency stop is over"),
    "enable": lambda one: f"{one['robot']} {_on(one, 'works', 'has failed')}",
    "link": lambda one: f"link of {one['robot']}: {one['state']}",
    "alarm": lambda one: f"alarm of {one['robot']}: {one.get('cause')}" if one.get("on") else "",
    "acknowledge": lambda one: f"alarm of {one.get('robot')} acknowledged",
    "inject": lambda one: f"{str(one['do']).replace('_', ' ')} ({one.get('name')})",
    "bonus": lambda one: f"bonus of {one['points']} points",
    "mark_set": lambda one: f"mark {one['mark']} set, {one.get('robot') or 'by hand'}",
    "mark_edit": lambda one: f"mark {one['mark']} changed",
    "mark_delete": lambda one: f"mark {one['mark']} deleted",
    "connect": lambda one: f"operator {one.get('page')} {_on(one, 'comes', 'goes')}",
    "probe": lambda _: "questions about the situation",
    "error": lambda one: f"error: {one.get('text')}",
    "input": _said,
}
"""Kinds that are told as events, and how."""


def sampled(known: list[Row], numbers: NDArray[np.int64], width: int) -> NDArray[np.float64]:
    """The rows that hold at some row numbers, the first one before it begins.

    Args:
        known: rows in order of their numbers; not empty. numbers: of rows, rising. width: of a row.

    Returns:
        (len(numbers), width).
    """
    begins = np.array([begin for begin, _ in known])
    values = np.array([row for _, row in known], np.float64).reshape(len(known), width)
    last = np.maximum(np.searchsorted(begins, numbers, "right") - 1, 0)
    found: NDArray[np.float64] = values[last]
    return found
