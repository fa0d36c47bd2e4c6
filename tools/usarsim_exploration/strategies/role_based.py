"""Role-based: explorers find new space, relays carry it to the base, and pairs of them meet.

De Hoog, Cameron and Visser, "Role-based autonomous multi-robot exploration" (exploration reference
12.4). A state machine with the transitions of `TRANSITIONS`; an explorer and its relay agree on
where to meet next while they hear each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from usarsim_exploration.bidding import Aim
from usarsim_exploration.environment import Cell
from usarsim_exploration.errors import scipy
from usarsim_exploration.exploring import way_to
from usarsim_exploration.rendezvous import PATIENCE, Meeting, multi_point, single_point
from usarsim_exploration.strategies.switching import Switching
from usarsim_exploration.strategy import (
    BASE,
    Formation,
    Letter,
    Plan,
    Teammate,
    View,
    register,
    straight,
)
from usarsim_server.base.fields import field

State = Literal[
    "initial", "explore", "give-parent-info", "return-to-parent", "wait-for-parent",
    "go-to-child", "get-info-from-child", "wait-for-child",
]  # fmt: skip

TRANSITIONS: dict[State, tuple[State, ...]] = {
    "initial": ("explore", "go-to-child"),
    "explore": ("give-parent-info", "return-to-parent", "get-info-from-child", "go-to-child"),
    "return-to-parent": ("give-parent-info", "wait-for-parent"),
    "wait-for-parent": ("give-parent-info", "explore"),
    "give-parent-info": ("explore", "go-to-child"),
    "go-to-child": ("get-info-from-child", "wait-for-child"),
    "wait-for-child": ("get-info-from-child", "go-to-child", "explore"),
    "get-info-from-child": ("return-to-parent",),
}
"""Where each state may lead. A relay that waited for its child in vain, at the backup point too,
explores from then on, which the reference's never does."""

START = 3
LEAST_TIME = 15
"""Steps before the first plan; and between two exchanges, or that make a detour worth while."""
REFRESH = 8
"""Steps after which a way is planned again."""
ARRIVED = 2.0
"""Cells from a place that count as there."""


@register("role-based", "role-based-single-point")
@dataclass
class RoleBased(Switching):
    """Pairs of explorer and relay that meet at one place."""

    formation: ClassVar[Formation] = "pairs"

    relay_explores: bool = field(
        default=True, help="a relay explores while it has time; else it waits at the meeting point"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.state: State = "initial"
        self.meeting: Meeting | None = None
        self.complete = False
        self._entered = self._exchanged = self._checked = self._driven = 0
        self._agreed_at = self._told_at = -(10**9)
        self._judged = -1

    # -- states -------------------------------------------------------------------------------

    def decide(self, view: View) -> Plan | None:
        """One transition at most, then drive as the state wants it."""
        state = self._next(view)
        if state is not None:
            self._enter(state, view)
        if view.rules.mresim and self.state == "initial" and view.role == "explorer":
            return replace(self._stroll(view), state=self.state)
        return self._explore(view) if self.state == "explore" else self._drive(view)

    def _enter(self, state: State, view: View) -> None:
        self._planned = self._version = self._driven = -(10**9)
        self.state, self._entered, self._checked = state, view.step, 0
        if state in ("give-parent-info", "get-info-from-child"):
            self._exchanged = view.step
        if state == "give-parent-info" and self._meets(view):
            self._agree(view)

    def _next(self, view: View) -> State | None:
        """The state to change to; None: go on."""
        if self.state == "initial":
            if view.step < START:
                return None
            return "go-to-child" if view.role == "relay" else "explore"
        since = view.step - self._entered
        return self._next_of_relay(view, since) if view.role == "relay" else self._step(view, since)

    def _step(self, view: View, since: int) -> State | None:
        """The same for an explorer."""
        if self.state == "give-parent-info":
            return "explore" if since >= 1 and not self._is_complete(view) else None
        if self.complete:  # the base is the parent now, and the meeting point
            if self.state == "return-to-parent":
                return "give-parent-info" if view.cell == view.base else None
            return "return-to-parent" if self.state == "explore" else "give-parent-info"
        parent = self._meets(view) and view.parent in view.linked
        if self.state == "explore":
            if parent and (since > LEAST_TIME or not self._agreed(view)):
                return "give-parent-info"
            late = self._meets(view) and self._spare(view) <= 0
            return "return-to-parent" if late else None
        if parent:
            return "give-parent-info"
        if self.state == "return-to-parent":
            return "wait-for-parent" if self._there(view) else None
        if not self._gives_up(view):
            return None
        if self.meeting is None:
            view.parent = BASE
        return "explore"

    def _next_of_relay(self, view: View, since: int) -> State | None:
        if self.state == "give-parent-info":
            if since < 1:
                return None
            may = self.relay_explores or not view.rules.relays
            return "explore" if may and self._spare(view) > LEAST_TIME else "go-to-child"
        if self.state == "get-info-from-child":
            return "return-to-parent" if since >= 1 else None
        if self.state == "return-to-parent":
            there = BASE in view.linked or view.cell == view.base
            return "give-parent-info" if there else None
        if view.child in view.linked and self._news(view):
            return "get-info-from-child"
        if self.state == "explore":
            return "go-to-child" if self._spare(view) <= 0 else None
        if self.state == "go-to-child":
            return "wait-for-child" if self._there(view) else None
        if self._child_is_complete(view) or not self._gives_up(view):
            return None
        if self.meeting is not None:
            return "go-to-child"
        view.role, view.parent, view.child = "explorer", BASE, None
        return "explore"

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """By MRESim's rules, one of those from which the meeting is reached in time, if any is."""
        if view.rules.mresim and self.meeting is not None:
            back = view.planner.field(self._place(view))
            left = self.meeting.time - view.step
            early = [
                aim for aim in aims
                if int((aim.distance + back.distance(aim.cell)) / view.speed) <= left
            ]  # fmt: skip
            aims = early if early or view.role == "relay" else aims
        return super().choose(view, aims)

    # -- what transitions ask -----------------------------------------------------------------

    def _meets(self, view: View) -> bool:
        """Whether this is an explorer with a relay."""
        return view.role == "explorer" and view.parent not in (BASE, None)

    def _place(self, view: View) -> Cell:
        """Where this robot drives to, exploring apart."""
        home = self.state == "return-to-parent" and view.role == "relay"
        if home or self.complete or self._child_is_complete(view):
            return view.base
        if self.meeting is not None:
            meeting = self.meeting
            return meeting.relay_place if view.role == "relay" else meeting.place
        if view.role == "relay" and view.child is not None:
            return view.teammates[view.child].cell
        return view.base

    def _there(self, view: View) -> bool:
        return straight(view.cell, self._place(view)) <= ARRIVED

    def _spare(self, view: View) -> float:
        """Steps until this robot has to leave for its meeting; at most 0: now.

        Each step takes two of them at most, one that passes and one for a longer way, so the way is
        measured again when half of them are over.
        """
        if self.meeting is None:
            return 0.0 if view.role == "relay" else math.inf
        if view.step < self._checked:
            return math.inf
        way = view.planner.field(view.cell).distance(self._place(view)) / view.speed
        spare = self.meeting.time - view.step - (way if math.isfinite(way) else 0.0)
        self._checked = view.step + max(int(spare / 2), 2)
        return spare

    def _gives_up(self, view: View) -> bool:
        """Whether it has waited too long; then the backup point is the meeting point."""
        time = self._entered if self.meeting is None else max(self.meeting.time, self._entered)
        if view.step <= time + PATIENCE:
            return False
        self.meeting = self.meeting.missed() if self.meeting is not None else None
        return True

    def _agreed(self, view: View) -> bool:
        """Whether the relay has said that it knows the meeting."""
        relay = view.teammates[view.parent or BASE]
        return self.meeting is not None and Meeting.heard(relay.letter) == self.meeting

    def _news(self, view: View) -> bool:
        """Whether the child has said more since it was heard out."""
        return not self._child_is_complete(view) and (
            view.step - self._exchanged > LEAST_TIME or self._exchanged < self._told_at
        )

    def _child_is_complete(self, view: View) -> bool:
        if view.role != "relay" or view.child is None:
            return False
        return bool(view.teammates[view.child].letter.get("complete"))

    def _is_complete(self, view: View) -> bool:
        """Whether there is still nothing to find; asked when the map has changed."""
        if self.complete and view.known.version != self._judged:
            self._judged = view.known.version
            self.complete = not self.aims(view)
        return self.complete

    # -- what states do -----------------------------------------------------------------------

    def _agree(self, view: View) -> None:
        """Fix the next meeting, unless one was fixed just now that the relay has not heard yet."""
        if view.step - self._agreed_at <= LEAST_TIME or self.complete:
            return
        aim = self.pick(view, self.frontiers(view))
        if aim is None:
            return
        relay = view.teammates[view.parent or BASE]
        self.aim = aim.cell
        self.meeting = self.arrange(view, relay, aim.cell)
        self._agreed_at = view.step

    def arrange(self, view: View, relay: Teammate, goal: Cell) -> Meeting:
        """Where and when to meet next, after a visit to a frontier."""
        return single_point(view, relay, goal)

    def _explore(self, view: View) -> Plan:
        """Go to a frontier; without one, an explorer has completed its mission."""
        plan = super().decide(view)
        if plan is not None and plan.home:
            if view.role == "relay":
                self._enter("go-to-child", view)
            else:
                self.complete, self._judged = True, view.known.version
            return self._drive(view)
        return Plan(view.path if plan is None else plan.path, self.state, self.aim)

    def _drive(self, view: View) -> Plan:
        """To the meeting, the base or the child; who waits or tells stands."""
        place = self._place(view)
        home = self.complete or self._child_is_complete(view)
        if self.state not in ("return-to-parent", "go-to-child") and not home:
            return Plan([], self.state, place)
        path = [] if view.cell == place else list(view.path)
        stale = not path or view.blocked or view.step - self._driven >= REFRESH
        if view.cell != place and stale:
            path, self._driven = way_to(view, place), view.step
        return Plan(path, self.state, place, home)

    # -- what two robots may swap -------------------------------------------------------------

    def part(self, view: View) -> dict[str, Any]:
        """Role, state, to whom it belongs, the goal, the meeting, and when what happened."""
        return {
            "role": view.role, "parent": view.parent, "child": view.child, "state": self.state,
            "goal": self.aim if self.state == "explore" else self._place(view),
            "aim": self.aim, "complete": self.complete,
            "meeting": self.meeting.told() if self.meeting is not None else None,
            "times": (self._entered, self._exchanged, self._agreed_at, self._told_at),
        }  # fmt: skip

    def play(self, view: View, part: Mapping[str, Any]) -> None:
        """Take over what `part` tells."""
        view.role, view.parent, view.child = part["role"], part["parent"], part["child"]
        self.state, self.aim = part["state"], part["aim"]
        self.meeting = Meeting.heard(part)
        self._entered, self._exchanged, self._agreed_at, self._told_at = part["times"]
        self._planned = self._version = self._driven = -(10**9)
        self._checked = 0
        view.path.clear()

    # -- radio --------------------------------------------------------------------------------

    def letter(self, view: View) -> Letter:
        """The meeting, to whom this robot belongs, whether it has completed its mission."""
        told = self.meeting.told() if self.meeting is not None else None
        about = {"meeting": told, "parent": view.parent, "child": view.child}
        return {**super().letter(view), **about, "complete": self.complete}

    def hear(self, view: View) -> None:
        """A relay keeps the meetings that its child fixes."""
        super().hear(view)
        if view.role != "relay" or view.child not in view.linked:
            return
        meeting = Meeting.heard(view.teammates[view.child].letter)
        if meeting is not None and meeting != self.meeting:
            self.meeting, self._told_at = meeting, view.step


@register("role-based-multi-point")
@dataclass
class RoleBasedMultiPoint(RoleBased):
    """Explorer and relay hear each other from two places, so that neither drives all the way."""

    density: float = field(
        default=400.0, low=16.0, high=1e6, unit="cells",
        help="free cells for each one that is considered for the relay",
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        scipy("stats")  # now: it takes longer than any step

    def arrange(self, view: View, relay: Teammate, goal: Cell) -> Meeting:
        """Two places with a link between them."""
        return multi_point(view, relay, goal, self.density)
