"""Who is found, and who of them is credited: by a mark, a robot near, or a robot's view.

Something speaks for a victim: a valid mark, a robot that is near, a robot that has looked for long
enough. The first of them finds it, and then it is decided whether the find is credited. With
`sticky` that stays; without, a victim for which nothing speaks any more is not found any more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from usarsim_mission import records
from usarsim_mission.model import Victim
from usarsim_mission.records import Record
from usarsim_mission.scoring import Rules
from usarsim_mission.visits import Robot, Visits
from usarsim_mission.zones import ZoneMap

Place = tuple[float, float, float]

_SAME_TIME = 1e-6
"""s: times are sums of 0.1."""


@dataclass(slots=True)
class Case:
    """What is known of one victim.

    Attributes:
        voices: what speaks for it: (how, robot or mark).
        found: whether it is. credited: how much, by the factor of its zone; 0 if not.
        time: of the find, s.
    """

    name: str
    place: Place
    voices: set[tuple[str, int | str]] = field(default_factory=set)
    found: bool = False
    credited: float = 0.0
    why: str = ""
    robot: str = ""
    mark: int | str | None = None
    time: float | None = None


class Credits:
    """All victims.

    Attributes:
        cases: by name.
    """

    def __init__(
        self, victims: tuple[Victim, ...], rules: Rules, zones: ZoneMap, visits: Visits
    ) -> None:
        self.cases = {one.name: Case(one.name, one.pos) for one in victims}
        self._rules, self._zones, self._visits = rules, zones, visits
        self._views: dict[tuple[str, str], float] = {}

    def places(self) -> dict[str, Place]:
        """Where the victims are now, m."""
        return {name: case.place for name, case in self.cases.items()}

    def moved(self, row: Mapping[str, Any]) -> None:
        """A victim is somewhere."""
        case = self.cases.get(records.text(row, "name"))
        pos = records.place(row, "pos")
        if case is not None and pos is not None:
            case.place = pos

    def marked(self, victim: str, mark: int | str, robot: str, time: float) -> Iterator[Record]:
        """A valid mark tells of a victim."""
        if self._rules.victims.credit == "mark":
            yield from self._speaks(self.cases[victim], ("mark", mark), robot, time, mark)

    def unmarked(self, victim: str, mark: int | str, time: float) -> Iterator[Record]:
        """That mark stands no more."""
        if self._rules.victims.credit == "mark":
            yield from self._silent(self.cases[victim], ("mark", mark), time)

    def near(self, time: float) -> Iterator[Record]:
        """Compare the places of all robots and victims, where that is what counts."""
        rule = self._rules.victims
        if rule.credit != "proximity":
            return
        if rule.pairs:
            yield from self._paired(time)
            return
        for case in self.cases.values():
            if case.found and rule.sticky:
                continue
            x, y, z = case.place
            for robot in self._visits.robots.values():
                voice, pos = ("proximity", robot.name), robot.pos
                near = (
                    pos is not None
                    and robot.seen >= time
                    and math.hypot(pos[0] - x, pos[1] - y) <= rule.radius
                    and abs(pos[2] - z) <= rule.height
                )
                if near:
                    yield from self._speaks(case, voice, robot.name, time)
                elif voice in case.voices:
                    yield from self._silent(case, voice, time)

    def _paired(self, time: float) -> Iterator[Record]:
        """Each robot in turn has the nearest victim that no robot before it has."""
        rule = self._rules.victims
        free = dict(self.cases)
        pairs: list[tuple[Case, Robot]] = []
        for robot in self._visits.robots.values():
            if robot.pos is None or robot.seen < time or not free:
                continue
            x, y, z = robot.pos
            gaps = {
                name: math.hypot(case.place[0] - x, case.place[1] - y)
                for name, case in free.items()
            }
            name = min(gaps, key=gaps.__getitem__)
            case = free.pop(name)
            if gaps[name] <= rule.radius and abs(case.place[2] - z) <= rule.height:
                pairs.append((case, robot))
        voices = {(case.name, robot.name) for case, robot in pairs}
        for case, robot in pairs:
            yield from self._speaks(case, ("proximity", robot.name), robot.name, time)
        for case in self.cases.values():
            for how, who in [one for one in case.voices if (case.name, one[1]) not in voices]:
                yield from self._silent(case, (how, who), time)

    def seen(self, rows: Iterator[Mapping[str, Any]], time: float) -> Iterator[Record]:
        """All victims that cameras have before them; those absent are out of view."""
        rule = self._rules.victims
        widest = math.radians(rule.half_angle)
        now: dict[tuple[str, str], None] = {}
        for row in rows:
            pair = records.text(row, "robot"), records.text(row, "victim")
            clear = bool(row.get("clear")) or not rule.line_of_sight
            if clear and pair[1] in self.cases and records.number(row, "angle") <= widest:
                now[pair] = None
        for pair in [pair for pair in self._views if pair not in now]:
            begun = self._views.pop(pair)
            yield _sight("victim_visible_end", pair, time, seconds=round(time - begun, 6))
            if rule.credit == "view":
                yield from self._silent(self.cases[pair[1]], ("view", pair[0]), time)
        for pair in now:
            if pair not in self._views:
                self._views[pair] = time
                yield _sight("victim_visible_begin", pair, time)
            lasted = time - self._views[pair] + _SAME_TIME
            if rule.credit == "view" and lasted >= rule.dwell:
                robot, victim = pair
                yield from self._speaks(self.cases[victim], ("view", robot), robot, time)

    def _speaks(
        self,
        case: Case,
        voice: tuple[str, int | str],
        robot: str,
        time: float,
        mark: int | str | None = None,
    ) -> Iterator[Record]:
        case.voices.add(voice)
        if case.found:
            return
        case.found, case.time, case.robot, case.mark = True, time, robot, mark
        case.credited, case.why = self._judged(case, robot)
        yield {
            "kind": "found",
            "t_sim": time,
            "victim": case.name,
            "robot": robot or None,
            "how": voice[0],
            "mark": mark,
        }
        yield _credit(case, time)

    def _silent(self, case: Case, voice: tuple[str, int | str], time: float) -> Iterator[Record]:
        case.voices.discard(voice)
        if case.voices or not case.found or self._rules.victims.sticky:
            return
        case.found, case.credited, case.time = False, 0.0, None
        case.why = "the mark was taken back" if voice[0] == "mark" else "the robot is gone"
        yield _credit(case, time)

    def _judged(self, case: Case, name: str) -> tuple[float, str]:
        """How much a find is credited, and why."""
        zone = self._zones.zone(case.place[0], case.place[1])
        rule = self._rules.zones.of(None if zone is None else zone.colour)
        robot = self._visits.robots.get(name) or self._nearest(case.place)
        where = "outside of all zones" if zone is None else f"{zone.colour} zone {zone.name}"
        if rule.open:
            return rule.factor, where
        modes = " or ".join(rule.modes)
        if robot is None or not self._visits.allows(zone, robot):
            return 0.0, f"{where} is for {modes} robots only"
        return rule.factor, f"{modes} in {where}"

    def _nearest(self, place: Place) -> Robot | None:
        """The robot nearest to a place: who answers for a mark that names none."""
        known = [one for one in self._visits.robots.values() if one.pos is not None]
        return min(known, key=lambda one: math.dist(one.pos or place, place), default=None)


def _credit(case: Case, time: float) -> Record:
    return {
        "kind": "credit",
        "t_sim": time,
        "victim": case.name,
        "robot": case.robot or None,
        "credited": case.found and case.credited > 0.0,
        "why": case.why,
    }


def _sight(kind: str, pair: tuple[str, str], time: float, **more: Any) -> Record:
    return {"kind": kind, "t_sim": time, "robot": pair[0], "victim": pair[1], **more}
