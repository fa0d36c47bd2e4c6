"""The referee: told all that happens in a run, it says who is found and what that is worth.

No clock, no sockets, no files: records in, records out. The same records in the same order give the
same verdicts, live and from the logs, so a run can be scored again. Only what happens between
`trial_start` and the end of the trial counts; of the time before only where everybody is, and after
it the bonus, the final map and what is handed in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from usarsim_mission import records
from usarsim_mission.area import Area
from usarsim_mission.credit import Credits
from usarsim_mission.errors import RunLogError
from usarsim_mission.grid import Grid
from usarsim_mission.map_quality import MapQuality, judge
from usarsim_mission.marks import DUPLICATE, VALID, Mark, Marks
from usarsim_mission.mishaps import Contacts, Losses
from usarsim_mission.model import Mission, World
from usarsim_mission.records import Record
from usarsim_mission.scoring import Rules
from usarsim_mission.visits import Visits
from usarsim_mission.zones import ZoneMap

_SAME_TIME = 1e-6
"""s: times are sums of steps."""
_AFTER = ("bonus", "map")
"""What counts after the end, too."""


class Referee:
    """Judges one run.

    Attributes:
        score: the newest: total and values of all variables, see `scoring.VARIABLES`.
        began: when the trial did, s of simulated time; None before.
        ends_at: when its time is over; None before it began.
        over: why the trial is over (`time`, `all_found`, or what `trial_end` told); None before.
        over_at: when that was, s of simulated time.
    """

    def __init__(self, mission: Mission, rules: Rules, world: World) -> None:
        """Begin.

        Raises:
            ScoringError: the rules have no value for so many victims.
        """
        rules.check(len(world.victims))
        self._mission, self._rules, self._world = mission, rules, world
        zones = ZoneMap(world, rules.zones, mission.band)
        self.visits = Visits(zones, rules.zones)
        self.credits = Credits(world.victims, rules, zones, self.visits)
        self.marks = Marks(world.victims, rules.victims.mark_tolerance)
        self.contacts = Contacts(rules.penalties.bump_window)
        self.losses = Losses(world)
        self.area = Area(world)
        self.map = MapQuality(math.inf, 0.0)
        self.began: float | None = None
        self.ends_at: float | None = None
        self.over: str | None = None
        self.over_at: float | None = None
        self._limit = mission.time_limit or rules.time_limit
        self._operators = mission.operators or rules.operators.count
        self._bonus = 0.0
        self._second, self._now = 0, 0.0
        self._counts_map = bool(rules.map.points_full) or "M" in rules.expression.names
        self.score: dict[str, Any] = {}
        self._kinds: dict[str, Callable[[Record, float], Iterator[Record]]] = {
            "session": self._session,
            "trial_start": self._trial_start,
            "trial_end": self._trial_end,
            "truth": self._truth,
            "command": self._told,
            "mode": self._told,
            "estop": self._told,
            "enable": self._told,
            "link": self._told,
            "mark_set": self._mark_set,
            "mark_edit": self._mark_edit,
            "mark_delete": self._mark_delete,
            "hand_in": self._hand_in,
            "bonus": self._give_bonus,
            "map": self._map,
        }
        self._count(0.0)

    @property
    def running(self) -> bool:
        """Whether the trial has begun and is not over."""
        return self.began is not None and self.over is None

    def feed(self, record: Mapping[str, Any]) -> list[Record]:
        """Take the next record.

        Args:
            record: with `kind`, `t_sim` and its facts; unknown kinds and derived ones are ignored.

        Returns:
            What follows from it, each with `kind` and `t_sim`, in order.

        Raises:
            RunLogError: it is not what its kind has to be.
        """
        handle = self._kinds.get(record.get("kind", ""))
        if handle is None:
            return []
        try:
            time = records.number(record, "t_sim")
            found = list(self._clock(time))
            self._now = max(self._now, time)
            found += handle(dict(record), time)
        except (TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
            what = f"record {record.get('seq', '?')} ({record['kind']})"
            raise RunLogError(f"{what}: {error} (mend the line)") from error
        return found

    # -- time ---------------------------------------------------------------------------------

    def _clock(self, time: float) -> Iterator[Record]:
        """A score for each second that is over, and the end when all of them are."""
        if not self.running:
            return
        assert self.began is not None
        assert self.ends_at is not None
        while self.running:
            due = min(self.began + self._second + 1, self.ends_at)
            if time <= due + _SAME_TIME:
                return
            self._second += 1
            if due >= self.ends_at:
                yield from self._end("time", self.ends_at)
            else:
                yield self._scored(due)

    def _end(self, why: str, time: float) -> Iterator[Record]:
        self.over, self.over_at = why, time
        yield self._scored(time)

    def _session(self, record: Record, time: float) -> Iterator[Record]:
        if isinstance(record.get("operators"), int) and record["operators"] >= 1:
            self._operators = min(record["operators"], 1000)
        self.area.enrol(records.rows(record, "robots"))
        yield from ()

    def _trial_start(self, record: Record, time: float) -> Iterator[Record]:
        if self.began is not None:
            return
        if record.get("limit") is not None:
            self._limit = records.number(record, "limit")
        self.began, self.ends_at = time, time + self._limit
        yield from self.visits.begin(time)

    def _trial_end(self, record: Record, time: float) -> Iterator[Record]:
        if self.running:
            yield from self._end(records.text(record, "why") or "operator", time)

    # -- what is true -------------------------------------------------------------------------

    def _truth(self, record: Record, time: float) -> Iterator[Record]:
        if self.over is not None:
            return
        crossings: list[Record] = []
        rows = list(records.rows(record, "robots"))
        for row in rows:
            crossings += self.visits.row(row, time)
        for row in records.rows(record, "victims"):
            self.credits.moved(row)
        if not self.running:
            return
        yield from crossings
        for row in rows:
            name = records.text(row, "name")
            yield from self.contacts.row(name, records.rows(row, "contacts"), time)
        robots = self.visits.robots.values()
        yield from self.losses.row(iter(robots), time)
        self.area.look(robots, time)
        yield from self.credits.seen(records.rows(record, "views"), time)
        yield from self.credits.near(time)
        yield from self._perhaps_all(time)
        if self.running and self.ends_at is not None and time >= self.ends_at - _SAME_TIME:
            yield from self._end("time", self.ends_at)

    def _told(self, record: Record, time: float) -> Iterator[Record]:
        """Who moves a robot, and whether its link holds."""
        match record["kind"]:
            case "command":
                self.visits.command(record)
            case "mode":
                self.visits.mode(record)
            case "link":
                self.visits.link(record)
            case "estop" if record.get("on"):
                self.visits.stop()
            case "enable" if not record.get("on"):
                self.visits.stop(records.text(record, "robot"))
        yield from ()

    # -- what operators say -------------------------------------------------------------------

    def _mark_set(self, record: Record, time: float) -> Iterator[Record]:
        if self.running:
            yield from self._judged(self.marks.set(record, self.credits.places()), time)

    def _mark_edit(self, record: Record, time: float) -> Iterator[Record]:
        if not self.running:
            return
        of_whom = {mark.number: mark.victim for mark in self.marks.valid()}
        mark = self.marks.edit(record, self.credits.places())
        if mark is None:
            return
        if mark.number in of_whom and (mark.verdict, mark.victim) != (VALID, of_whom[mark.number]):
            yield from self._taken_back(of_whom[mark.number], mark.number, time)
        yield from self._judged(mark, time)

    def _mark_delete(self, record: Record, time: float) -> Iterator[Record]:
        mark = self.marks.delete(record) if self.running else None
        if mark is not None and mark.verdict == VALID:
            yield from self._taken_back(mark.victim, mark.number, time)

    def _hand_in(self, record: Record, time: float) -> Iterator[Record]:
        """Victims that a team reports when all is over: marks that are set at the end."""
        if self.over_at is None:
            return
        for row in records.rows(record, "victims"):
            mark = self.marks.set(
                {**row, "mark": f"hand-in {row['number']}"}, self.credits.places()
            )
            yield from self._judged(mark, self.over_at)
        yield from self._late(time)

    def _taken_back(self, victim: str, number: int | str, time: float) -> Iterator[Record]:
        """A mark tells of a victim no more; the oldest duplicate does now, if there is one."""
        heir = self.marks.heir(victim)
        if heir is not None:
            yield from self.credits.marked(victim, heir.number, heir.robot, time)
        yield from self.credits.unmarked(victim, number, time)

    def _judged(self, mark: Mark, time: float) -> Iterator[Record]:
        if mark.verdict == VALID:
            yield from self.credits.marked(mark.victim, mark.number, mark.robot, time)
            yield from self._perhaps_all(time)
        elif mark.verdict == DUPLICATE:
            yield {
                "kind": "duplicate",
                "t_sim": time,
                "mark": mark.number,
                "victim": mark.victim,
            }
        else:
            yield {"kind": "wrong", "t_sim": time, "mark": mark.number}

    def _perhaps_all(self, time: float) -> Iterator[Record]:
        """The end, if that is agreed and the last victim is credited."""
        cases = self.credits.cases.values()
        agreed = self._mission.ends_when_all_credited and self.running and bool(cases)
        if agreed and all(case.found and case.credited > 0.0 for case in cases):
            yield from self._end("all_found", time)

    def _give_bonus(self, record: Record, time: float) -> Iterator[Record]:
        self._bonus += records.number(record, "points")
        yield from self._late(time)

    def _map(self, record: Record, time: float) -> Iterator[Record]:
        """The map as it is by now; judged only if it counts or is final: that takes a while."""
        if (self._counts_map or self.over is not None) and self._world.floor is not None:
            self.map = judge(Grid.unpacked(record), self._world.floor)
        yield from self._late(time)

    def _late(self, time: float) -> Iterator[Record]:
        if self.over is not None:
            yield self._scored(self.over_at if self.over_at is not None else time)

    # -- the score ----------------------------------------------------------------------------

    def _scored(self, time: float) -> Record:
        self._count(time)
        return {"kind": "score", "t_sim": time, **self.score}

    def _count(self, time: float) -> None:
        found = [case for case in self.credits.cases.values() if case.found]
        names = {case.name for case in found}
        marks = [mark for mark in self.marks.valid() if mark.victim in names]
        left = 1.0 if self.began is None else (self.began + self._limit - time) / self._limit
        values = {
            "V": len(self.credits.cases),
            "VF": len(found),
            "VC": round(math.fsum(case.credited for case in found), 9),
            "ID": sum(map(self.marks.names, marks)),
            "ST": sum(map(self.marks.tells_status, marks)),
            "LO": len(marks),
            "FM": self.marks.wrong(),
            "A": round(self.area.share(self._rules.area.source), 9),
            "M": round(self.map.points(self._rules.map), 9),
            "T": round(min(max(left, 0.0), 1.0), 9),
            "C": self.contacts.victims,
            "K": self.contacts.others,
            "L": len(self.losses.lost),
            "B": min(max(self._bonus, -1e9), 1e9),
            "N": self._operators,
        }
        self.score = {"total": self._rules.score(values), "values": values}

    def result(self) -> dict[str, Any]:
        """All that `score.json` tells, as JSON has it; of a run that is not over, by now."""
        if self.over is None:
            self._count(self._now)
        return {
            "schema": "usar-result/1",
            "mission": self._mission.name,
            "rules": self._rules.name,
            "seed": self._mission.seed,
            **self.score,
            "ended": {"why": self.over, "t_sim": self.over_at, "began": self.began},
            "time_limit": self._limit,
            "area": {
                "team": round(self.area.share("team"), 9),
                "base": round(self.area.share("base"), 9),
            },
            "map": {
                "error": round(self.map.error, 6) if math.isfinite(self.map.error) else None,
                "share": round(self.map.share, 6),
            },
            "victims": [
                {
                    "name": case.name,
                    "found": case.found,
                    "credited": case.credited,
                    "why": case.why,
                    "robot": case.robot or None,
                    "mark": case.mark,
                    "t_sim": case.time,
                }
                for case in self.credits.cases.values()
            ],
            "lost": dict(self.losses.lost),
        }
