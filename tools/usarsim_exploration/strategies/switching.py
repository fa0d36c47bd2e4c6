"""Robots that take over each other's role, meeting and goal, where that shortens the longer way.

All who hear each other decide on the same letters, so both of a pair change at once, and the others
of the group note it (exploration reference 12.5). Numbers of robots never change. Who was out of
reach hears later who belongs to it now: each letter says since when it holds. Over links that lose
letters two robots may disagree, so switching is for links that do not.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from usarsim_exploration.strategies.frontier import FrontierStrategy
from usarsim_exploration.strategy import Letter, View
from usarsim_server.base.fields import field

EVERY, FIRST = 10, 5
"""Steps between two checks; the first is `EVERY` after step `FIRST`."""
LOCKOUT = 4
"""Steps after a switch in which a robot does not switch again."""
BUSY = ("initial", "give-parent-info", "get-info-from-child", "wait-for-parent", "wait-for-child")
"""States in which nobody switches."""


@dataclass
class Switching(FrontierStrategy):
    """Frontier-based, with a part that two robots may swap.

    Attributes:
        switched: step of the last switch. bond: since when parent and child hold.
    """

    switch: bool = field(
        default=False, help="robots swap roles where that shortens the longer of their ways"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.switched = -LOCKOUT
        self.bond = 0
        self._told: Letter = {}

    @abstractmethod
    def part(self, view: View) -> dict[str, Any]:
        """All that this robot is by its role, in plain values; `state`, `parent`, `child` too."""

    @abstractmethod
    def play(self, view: View, part: Mapping[str, Any]) -> None:
        """Be that from now on."""

    def letter(self, view: View) -> Letter:
        """At a check, the part, and how far it is to the goals of all that were heard."""
        told: dict[str, Any] = {**super().letter(view), "bond": self.bond}
        if self.switch and view.step > FIRST and (view.step - FIRST) % EVERY == 0:
            field_ = view.planner.field(view.cell)
            ways = {
                number: field_.distance(mate.goal)
                for number, mate in view.teammates.items()
                if mate.goal is not None and mate.role != "base"
            }
            goal = self.part(view)["goal"]
            if goal is not None:
                ways[view.number] = field_.distance((goal[0], goal[1]))
            told |= {"part": self.part(view), "ways": ways, "switched": self.switched}
        self._told = told
        return told

    def hear(self, view: View) -> None:
        """Switch if a pair of the group should; and learn who belongs to whom."""
        super().hear(view)
        if not self.switch:
            return
        letters = {number: view.teammates[number].letter for number in sorted(view.linked)}
        letters[view.number] = self._told
        letters = {number: one for number, one in sorted(letters.items()) if "part" in one}
        if view.step > FIRST and (view.step - FIRST) % EVERY == 0:
            pair = choose_pair(letters, view.step)
            if pair is not None:
                self.swap(view, *pair, letters)
        self._rebind(view)

    def swap(self, view: View, one: int, other: int, letters: Mapping[int, Letter]) -> None:
        """Two robots swap; who is neither notes whom it belongs to now."""
        change = {one: other, other: one}
        mates = view.teammates
        if view.number in change:
            partner = change[view.number]
            ours, part = self.part(view), dict(letters[partner]["part"])
            for key in ("parent", "child"):
                part[key] = change.get(part[key], part[key])
            self.play(view, part)
            self.switched = self.bond = view.step
            mates[partner] = replace(mates[partner], role=ours["role"])
            return
        role = mates[other].role
        mates[other] = replace(mates[other], role=mates[one].role)
        mates[one] = replace(mates[one], role=role)
        if view.parent in change or view.child in change:
            view.parent = change.get(view.parent or 0, view.parent)
            view.child = change.get(view.child or 0, view.child)
            self.bond = view.step

    def _rebind(self, view: View) -> None:
        """Whoever says that it is this robot's child or parent, since later than what is known."""
        role = {"explorer": "child", "relay": "parent"}.get(view.role, "")
        for number in sorted(view.teammates):
            letter = view.teammates[number].letter
            if letter.get("bond", 0) > self.bond and letter.get(role) == view.number:
                self.bond = int(letter["bond"])
                if role == "child":
                    view.parent = number
                else:
                    view.child = number


def choose_pair(letters: Mapping[int, Letter], step: int) -> tuple[int, int] | None:
    """The first pair, by number, whose longer way to its goals gets shorter; None: no pair's does.

    Args:
        letters: of those that hear each other. step: now.
    """
    able = [
        number
        for number, one in letters.items()
        if one["part"]["state"] not in BUSY
        and not one["part"]["complete"]
        and step - one["switched"] >= LOCKOUT
        and number in one["ways"]
    ]
    for one in able:
        for other in able:
            ours, theirs = letters[one]["ways"], letters[other]["ways"]
            if one < other and other in ours and one in theirs:
                now = max(ours[one], theirs[other])
                if max(ours[other], theirs[one]) < now:
                    return one, other
    return None
