"""Logs of trials made by hand: a minute of one operator, a minute of two."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from usarsim_study.instruments import nasa_tlx_weighted, sart
from usarsim_study.trial import Record

Motion = Callable[[float], tuple[float, float, float]]
"""From the time to x in m, speed in m/s and turning in rad/s."""
Views = Callable[[float], list[dict[str, Any]]]


class Log:
    """Records with their numbers; write them in any order."""

    def __init__(self) -> None:
        self._said: list[Record] = []

    def say(self, time: float, kind: str, **fields: Any) -> None:
        """A record; those of equal time keep their order."""
        self._said.append({"t_sim": time, "t_wall": time, "kind": kind, **fields})

    def drive(self, robot: str, begin: float, end: float, *, page: int = 1, by: str = "") -> None:
        """An operator drives; `by` is the source of the command that ends it."""
        self.say(begin, "input", page=page, role="operator", text={"type": "drive", "robot": robot})
        self.say(begin, "command", robot=robot, source="operator", left=0.5, right=0.5)
        self.say(end, "command", robot=robot, source=by or "operator", left=0.0, right=0.0)

    def truth(self, begin: int, end: int, robots: dict[str, Motion], views: Views) -> None:
        """Rows at 10 Hz from one time to another, both in s."""
        for tick in range(10 * begin, 10 * end + 1):
            time = tick / 10
            rows = []
            for name, motion in robots.items():
                x, speed, turn = motion(time)
                row = {"name": name, "pos": [x, 0.0, 0.2], "quat": [1.0, 0.0, 0.0, 0.0]}
                row |= {"linear": [speed, 0.0, 0.0], "angular": [0.0, 0.0, turn]}
                rows.append(row | {"battery": 1.0, "contacts": []})
            self.say(time, "truth", robots=rows, victims=[], views=views(time))

    @property
    def records(self) -> list[Record]:
        """All, numbered in order of time."""
        rows = sorted(self._said, key=lambda one: one["t_sim"])
        return [{"seq": seq, **row} for seq, row in enumerate(rows)]

    def write(self, folder: Path) -> Path:
        """A run folder."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, wanted in (("events.jsonl", False), ("truth.jsonl", True)):
            rows = [one for one in self.records if (one["kind"] == "truth") is wanted]
            (folder / name).write_text("".join(json.dumps(one) + "\n" for one in rows))
        return folder


def still(time: float) -> tuple[float, float, float]:
    """A robot that stands."""
    return 0.0, 0.0, 0.0


def _seen(robot: str, victim: str, degrees: float = 20.0, *, clear: bool = True) -> dict[str, Any]:
    angle = math.radians(degrees)
    return {"robot": robot, "victim": victim, "angle": angle, "distance": 3.0, "clear": clear}


def _views_of_minute(time: float) -> list[dict[str, Any]]:
    found = []
    if 14.0 <= time < 17.0:
        found.append(_seen("R1", "V1"))
    if 20.0 <= time < 25.0:
        found.append(_seen("R1", "V3", 31.0))
    if 34.0 <= time < 36.0 or 40.0 <= time < 43.0:
        found.append(_seen("R2", "V2", 29.0))
    if 50.0 <= time < 55.0:
        found.append(_seen("R1", "V3", clear=False))
    if 61.0 <= time < 64.0:
        found.append(_seen("R1", "V4"))
    return found


def _first_robot(time: float) -> tuple[float, float, float]:
    """0.5 m/s from 12 s to 20 s."""
    return 0.5 * min(max(time - 12.0, 0.0), 8.0), 0.5 if 12.0 <= time < 20.0 else 0.0, 0.0


def _second_robot(time: float) -> tuple[float, float, float]:
    """0.2 m/s from 30 s to 40 s, then it turns for 5 s."""
    speed = 0.2 if 30.0 <= time < 40.0 else 0.0
    turn = 0.5 if 40.0 <= time < 45.0 else 0.0
    return 0.2 * min(max(time - 30.0, 0.0), 10.0), speed, turn


TLX = {
    "mental": 70,
    "physical": 10,
    "temporal": 55,
    "performance": 40,
    "effort": 65,
    "frustration": 30,
}
"""Raw 45; weighted 59 with `pairs`."""


def pairs() -> dict[str, str]:
    """Choices that weigh the scales 5, 0, 3, 2, 4 and 1."""
    rank = ["mental", "effort", "temporal", "performance", "frustration", "physical"]
    return {
        item.name: min((name for name, _ in item.choices), key=rank.index)
        for item in nasa_tlx_weighted("tlx").items[6:]
    }


def minute(why: str = "time") -> Log:
    """One operator, two robots, five victims, from 10 s to 70 s."""
    log = Log()
    robots = [{"name": name, "class": "P3AT"} for name in ("R1", "R2")]
    log.say(0.0, "session", mission="hand", seed=1, robots=robots, operators=1)
    log.say(0.0, "connect", page=1, role="operator", name="Ada", on=True)
    log.say(0.0, "connect", page=9, role="instructor", name="Bob", on=True)
    log.say(1.0, "page_clock", page=1, offset=100.0, rtt=0.001)
    log.say(5.0, "select", page=1, robot="R1")
    log.say(10.0, "trial_start", limit=60.0)
    log.say(11.0, "select", page=9, robot="R2")  # an instructor looks
    log.drive("R1", 12.0, 20.0)
    log.drive("R1", 21.0, 25.0)
    log.say(26.0, "alarm", robot="R2", cause="tipped", on=True, text="")
    log.say(30.0, "select", page=1, robot="R2")
    log.drive("R2", 33.0, 39.0, by="watchdog")
    log.say(40.0, "alarm", robot="R2", cause="stuck", on=True, text="")
    log.say(42.5, "acknowledge", page=1, robot="R2", cause="stuck")
    log.say(50.0, "select", page=1, robot="R1")
    log.drive("R1", 51.0, 54.0)
    log.say(55.0, "command", robot="R2", source="autonomy", left=0.2, right=0.2)
    log.say(58.0, "alarm", robot="R1", cause="collision", on=True, text="")
    log.drive("R1", 60.0, 62.0)
    log.say(65.0, "select", page=1, robot="R1")  # chosen already
    log.say(66.0, "alarm", robot="R2", cause="battery", on=True, text="")
    log.say(67.0, "alarm", robot="R2", cause="battery", on=False, text="")
    log.truth(10, 70, {"R1": _first_robot, "R2": _second_robot}, _views_of_minute)
    _marks_of_minute(log)
    for time, robot, other in (
        (15.0, "R1", "world"),
        (35.0, "R2", "world"),
        (52.0, "R1", "world"),
        (53.0, "R1", "victim"),
        (61.0, "R1", "robot"),
        (61.0, "R2", "robot"),
    ):
        log.say(time, "collision", robot=robot, **{"with": other, "name": ""})
    for time, age in ((20.0, 0.1), (30.0, 0.4), (40.0, 0.3), (50.0, 0.2)):
        log.say(time, "frame_age", page=1, robot="R1", age=age)
    for time, right in ((22.0, True), (44.0, False), (63.0, True), (64.0, None)):
        log.say(time, "probe", question="where_is", correct=right)
    log.say(30.0, "score", total=1.0, values={})
    log.say(70.0, "score", total=46.5, values={})
    log.say(70.0, "trial_end", why=why, text="")
    _forms_of_minute(log)
    return log


def _marks_of_minute(log: Log) -> None:
    for mark, time, robot in (
        (1, 18.0, "R1"),
        (2, 45.0, "R2"),
        (3, 48.0, "R2"),
        (4, 52.0, "R1"),
        (5, 56.0, "R1"),
    ):
        log.say(time, "mark_set", mark=mark, robot=robot, place=[0, 0, 0], by="Ada", page=1)
    for victim, mark, time, robot in (
        ("V1", 1, 18.0, "R1"),
        ("V2", 2, 45.0, "R2"),
        ("V3", 3, 48.0, "R2"),
        ("V5", None, 59.0, "R1"),
    ):
        log.say(time, "found", victim=victim, robot=robot, how="mark", mark=mark)
        log.say(time, "credit", victim=victim, robot=robot, credited=victim != "V2", why="")
    log.say(52.0, "wrong", mark=4)
    log.say(56.0, "duplicate", mark=5, victim="V1")
    log.say(57.0, "mark_delete", mark=4, by="Ada")


def _forms_of_minute(log: Log) -> None:
    half = {"mental": 100}
    log.say(71.0, "form", form="tlx", form_kind="nasa-tlx-weighted", answers=half, done=False)
    answers = {**TLX, **pairs()}
    log.say(72.0, "form", form="tlx", form_kind="nasa-tlx-weighted", answers=answers, done=True)
    threes = {f"sus_{n}": 3 for n in range(1, 11)}
    log.say(73.0, "form", form="sus", form_kind="sus", answers=threes, done=True)
    names = [item.name for item in sart("sart").items]
    rated = dict(zip(names, (3, 4, 5, 6, 5, 4, 3, 5, 6, 7), strict=True))
    log.say(74.0, "form", form="sart", form_kind="sart", answers=rated, done=True)


def two_operators() -> Log:
    """Ada (pages 1, later 3) has R1 and R2, Bob (page 2) R3; from 0 s to 60 s."""
    log = Log()
    robots = [{"name": name, "class": "P3AT"} for name in ("R1", "R2", "R3")]
    log.say(0.0, "session", mission="hand", seed=1, robots=robots, operators=2)
    log.say(0.0, "connect", page=1, role="operator", name="Ada", on=True)
    log.say(0.0, "connect", page=2, role="operator", name="Bob", on=True)
    log.say(0.0, "trial_start", limit=60.0)
    log.say(1.0, "select", page=1, robot="R1")
    log.say(2.0, "select", page=2, robot="R3")
    log.drive("R1", 3.0, 13.0)
    log.drive("R3", 4.0, 24.0, page=2)
    log.say(15.0, "connect", page=1, role="operator", name="Ada", on=False)
    log.say(15.0, "connect", page=3, role="operator", name="Ada", on=True)  # a reload
    log.say(20.0, "select", page=3, robot="R2")
    log.drive("R2", 21.0, 27.0, page=3)
    for mark, time, page, by in ((1, 10.0, 1, "Ada"), (2, 23.0, 2, "Bob"), (3, 26.0, 3, "Ada")):
        log.say(time, "mark_set", mark=mark, robot="R1", place=[0, 0, 0], by=by, page=page)
    for mark, time in ((1, 10.0), (2, 23.0), (3, 26.0)):
        log.say(time, "found", victim=f"V{mark}", robot="R1", how="mark", mark=mark)
        log.say(time, "credit", victim=f"V{mark}", robot="R1", credited=True, why="")
    log.say(40.0, "collision", robot="R3", **{"with": "world", "name": ""})
    log.truth(0, 60, dict.fromkeys(("R1", "R2", "R3"), still), lambda time: [])
    log.say(60.0, "trial_end", why="time", text="")
    return log


def pooled_operators() -> Log:
    """Ada and Bob (seats 1 and 2) share R1 and R2, from 0 s to 60 s: each drives both of them, Bob
    tells of a victim that Ada has told of, and takes back a wrong mark of hers."""
    log = Log()
    robots = [{"name": name, "class": "P3AT"} for name in ("R1", "R2")]
    log.say(0.0, "session", mission="hand", seed=1, robots=robots, operators=2)
    for page, name in ((1, "Ada"), (2, "Bob")):
        log.say(0.0, "connect", page=page, role="operator", name=name, seat=page, on=True)
    log.say(0.0, "trial_start", limit=60.0)
    for time, page, robot in ((1.0, 1, "R1"), (2.0, 2, "R2"), (30.0, 1, "R2"), (31.0, 2, "R1")):
        log.say(time, "select", page=page, robot=robot)
    log.drive("R1", 3.0, 13.0)
    log.drive("R2", 4.0, 9.0, page=2)
    log.drive("R1", 32.0, 36.0, page=2)
    log.drive("R2", 40.0, 47.0)
    marks = (1, 10.0, 1, "Ada"), (2, 33.0, 2, "Bob"), (3, 41.0, 1, "Ada"), (4, 42.0, 2, "Bob")
    for mark, time, page, by in marks:
        log.say(time, "mark_set", mark=mark, robot="R1", place=[0, 0, 0], by=by, page=page)
    for mark, time in ((1, 10.0), (4, 42.0)):
        log.say(time, "found", victim=f"V{mark}", robot="R1", how="mark", mark=mark)
        log.say(time, "credit", victim=f"V{mark}", robot="R1", credited=mark == 1, why="")
    log.say(33.0, "duplicate", mark=2, victim="V1")
    log.say(41.0, "wrong", mark=3)
    log.say(43.0, "mark_delete", mark=3, page=2, by="Bob")
    log.truth(0, 60, dict.fromkeys(("R1", "R2"), still), lambda time: [])
    log.say(60.0, "trial_end", why="time", text="")
    return log


def with_latencies(log: Log) -> Log:
    """The same, with clocks in three inputs: 15, 30 and 60 ms from event to wire."""
    clocks = {12.0: (0.010, 0.005), 33.0: (0.020, 0.010), 51.0: (0.010, 0.050)}
    for record in log._said:
        way, rest = clocks.get(record["t_sim"], (None, 0.0))
        if record["kind"] == "input" and way is not None:
            record["clock"] = record["t_sim"]
            record["gateway_clock"] = record["t_sim"] + 100.0 + way
        if record["kind"] == "command" and record["source"] == "operator":
            record["t_wall"] += rest
    return log
