"""Rendezvous by schedule: all explore, and meet at a place and time that they fixed before.

At a meeting maps are merged, the next place and time are fixed, and one robot is sent to the base
with the map, if the base does not hear them from there (Roy & Dudek, "Collaborative robot
exploration and rendezvous", Autonomous Robots 2001). Who misses a meeting goes to the base for the
next one, where it hears of the newest schedule.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from usarsim_exploration.environment import Cell
from usarsim_exploration.exploring import way_to
from usarsim_exploration.rendezvous import ranked
from usarsim_exploration.strategies.frontier import FrontierStrategy
from usarsim_exploration.strategy import BASE, Letter, Plan, View, register, straight
from usarsim_server.base.fields import field

State = Literal["explore", "go-to-meeting", "wait-at-meeting", "deliver", "return"]

ARRIVED = 2.0
REFRESH = 8
"""Cells from a place that count as there; steps after which a way is planned again."""


@dataclass(frozen=True, slots=True)
class Appointment:
    """The next meeting.

    Attributes:
        made: step in which it was fixed. leader: by whom. place: where. time: step.
        courier: who tells the base before; None: nobody needs to.
        over: there is nothing left to find.
    """

    made: int
    leader: int
    place: Cell
    time: int
    courier: int | None = None
    over: bool = False


@register("schedule")
@dataclass
class Schedule(FrontierStrategy):
    """Meets the whole team now and then."""

    interval: int = field(
        default=120,
        low=10,
        high=10**6,
        unit="steps",
        help="between two meetings, beside those of the ways to frontiers and back",
    )
    patience: int = field(
        default=25, low=0, high=50, unit="steps", help="for which robots that are late are waited"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.state: State = "explore"
        self.next: Appointment | None = None
        self._checked = 0
        self._driven = -REFRESH

    def decide(self, view: View) -> Plan | None:
        """Explore, be at the meeting in time, fix the next one, or tell the base."""
        if self.next is None:  # all know without a word
            self.next = Appointment(0, BASE, view.base, self.interval)
        if self.state == "deliver" and (BASE in view.linked or view.cell == view.base):
            self._enter("explore")
        if self.state == "explore":
            if view.step >= self._checked and self._spare(view, self.next) > 0:
                self._checked = view.step + max(int(self._spare(view, self.next) / 2), 2)
            elif view.step >= self._checked:
                self._enter("go-to-meeting")
        if self.state == "go-to-meeting" and straight(view.cell, self.next.place) <= ARRIVED:
            self._enter("wait-at-meeting")
        if self.state in ("go-to-meeting", "wait-at-meeting") and self._leads(view, self.next):
            self._follow(view, self._appoint(view))
        if self.state == "explore":
            plan = super().decide(view)
            if plan is None or not plan.home:
                return plan
            self._enter("go-to-meeting")
        return self._drive(view, self.next)

    def _enter(self, state: State) -> None:
        self.state, self._checked = state, 0
        self._planned = self._version = self._driven = -(10**9)

    def _spare(self, view: View, meeting: Appointment) -> float:
        """Steps until this robot has to leave for a meeting."""
        way = view.planner.field(view.cell).distance(meeting.place) / view.speed
        return meeting.time - view.step - (way if math.isfinite(way) else 0.0)

    def _leads(self, view: View, meeting: Appointment) -> bool:
        """Whether this robot fixes the next meeting now.

        All are here, or were waited for; and it has the lowest number of those who hear each other
        and are on their way here or have come.
        """
        mates = view.explorers(10**9)
        here = [one for one in mates if one.number in view.linked and one.state != "explore"]
        if any(one.number < view.number for one in here):
            return False
        late = view.step >= meeting.time + self.patience and self.state == "wait-at-meeting"
        return late or (len(here) == len(mates) and self.state == "wait-at-meeting")

    def _appoint(self, view: View) -> Appointment:
        """Near the next frontier if all are here, else at the base."""
        mates = view.explorers(10**9)
        here = sorted({view.number, *(one.number for one in mates if one.number in view.linked)})
        aim = self.choose(view, self.aims(view))
        courier = None if BASE in view.linked else here[view.step % len(here)]
        if aim is None:
            return Appointment(view.step, view.number, view.base, view.step, None, over=True)
        places = ranked(view, aim.cell) if len(here) == len(mates) + 1 > 1 else []
        place = places[0] if places else view.base
        base = view.planner.field(view.base)
        way = (base.distance(view.cell) + base.distance(place)) / view.speed
        trip = math.ceil(way) if courier is not None and math.isfinite(way) else 0
        time = max(self.interval + self._trip(view, place), trip)
        return Appointment(view.step, view.number, place, view.step + time, courier)

    def _trip(self, view: View, place: Cell) -> int:
        """Steps to a frontier and on to a place, the mean over frontiers: else nobody got there."""
        cells = np.array([aim.cell for aim in self.aims(view)])
        there, back = (view.planner.field(end).distances(cells) for end in (view.cell, place))
        ways = (there + back)[np.isfinite(there + back)]
        return math.ceil(ways.mean() / view.speed) if len(ways) else 0

    def _follow(self, view: View, meeting: Appointment) -> None:
        self.next = meeting
        if meeting.over:
            self._enter("return")
        else:
            self._enter("deliver" if meeting.courier == view.number else "explore")

    def _drive(self, view: View, meeting: Appointment) -> Plan:
        place = meeting.place if self.state in ("go-to-meeting", "wait-at-meeting") else view.base
        path = [] if view.cell == place else list(view.path)
        stale = not path or view.blocked or view.step - self._driven >= REFRESH
        if self.state == "wait-at-meeting":
            path = []
        elif view.cell != place and stale:
            path, self._driven = way_to(view, place), view.step
        return Plan(path, self.state, place, home=self.state == "return")

    def letter(self, view: View) -> Letter:
        """The next meeting."""
        told = asdict(self.next) if self.next is not None else None
        return {**super().letter(view), "next": told}

    def hear(self, view: View) -> None:
        """The meeting that was fixed last holds; who delivers or returns goes on with that."""
        super().hear(view)
        for number in sorted(view.teammates):
            told = view.teammates[number].letter.get("next")
            if not told:
                continue
            heard = Appointment(**told)
            ours = self.next
            newer = ours is None or (heard.made, -heard.leader) > (ours.made, -ours.leader)
            if newer and self.state not in ("deliver", "return"):
                self._follow(view, heard)
            elif newer and not heard.over:
                self.next = heard
