"""How a trial is run, and what differs from what its mission says: the condition of a study."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from usarsim_client.scene import TruthRow
from usarsim_mission.errors import MissionError
from usarsim_mission.records import Record
from usarsim_mission.scenario.staging import Robot, Staged
from usarsim_operator.allowance import Allowance
from usarsim_operator.serving import Serving

PAGES = Serving("127.0.0.1", 0)
"""Pages of a team of people, on this machine only."""

Watcher = Callable[[Record], None]
"""Takes each record as it is logged."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """How a trial is run.

    Attributes:
        folder: of the run. speed: simulated s per s, or `max`.
        console: how the pages of a team of people are served; each operator has a token, and
            `Serving.told` takes the addresses.
        watch: is told each record.
        meanwhile: is awaited after each row of the truth while the trial runs. Robots of the
            gateway go in lockstep, so their world stands still until it returns: a probe freezes
            it, a scripted operator acts at this simulated instant.
        operators: how many people drive; None: as the team says.
        device: `any`, or the only one that drives: `keyboard`, `gamepad`.
        tells_device: the files of the run say it, and `unattended`; not in a blind study, whose
            files must not.
        split: whose robot it is, by its name: 1 for the first operator; robots that are not named
            are everybody's (`usarsim_operator.allowance.halves` deals them out).
        robots: only the first so many of the mission; None: all.
        unattended: what robots do that nobody drives; None: as the mission says.
        impair: file with what the links to pages are like; None: as the mission says.
        pages: the trial begins once so many operators are ready: their pages are open, show the
            first picture, and the pad of whoever needs one has answered; until then the
            world stands still.
        facts: what the record `session` tells beside its own, such as who takes part.
    """

    folder: Path
    speed: str = "1"
    console: Serving = PAGES
    watch: Watcher = lambda record: None
    meanwhile: Callable[[TruthRow], Awaitable[None]] | None = None
    operators: int | None = None
    device: str = "any"
    tells_device: bool = True
    split: Mapping[str, int] | None = None
    robots: int | None = None
    unattended: str | None = None
    impair: Path | None = None
    pages: int = 0
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def allowance(self) -> Allowance:
        """What operators may do."""
        return Allowance(self.device, self.split or {}, fixed=True)

    def applied(self, staged: Staged) -> Staged:
        """The mission with the robots of these conditions, as it is run and logged.

        Raises:
            MissionError: it has not so many robots, one that is to patrol has no route, or these
                conditions make no sense.
        """
        try:
            _ = self.allowance
        except ValueError as error:
            raise MissionError(str(error)) from None
        found = self._fleet(staged)
        names = [one.entry.name for one in found.robots]
        strange = [name for name in self.split or {} if name not in names]
        if strange:
            known = ", ".join(names)
            raise MissionError(f"split: no robot is called {strange[0]} (there are: {known})")
        return found

    def _fleet(self, staged: Staged) -> Staged:
        """The mission with as many robots as these conditions want, and their policies."""
        if self.robots is None and self.unattended is None:
            return staged
        count = len(staged.robots) if self.robots is None else self.robots
        if not 0 < count <= len(staged.robots):
            name, there = staged.scenario.name, len(staged.robots)
            raise MissionError(f"{name} has {there} robots, not {count} (name a smaller number)")
        told = self.unattended is not None and self.tells_device
        more = {"unattended": self.unattended} if told else {}
        members = tuple(self._told(one) for one in staged.robots[:count])
        content = {**(staged.scenario.content or {})}
        content["robot"] = [{**one, **more} for one in content.get("robot", [])[:count]]
        scenario = replace(
            staged.scenario, robots=tuple(one.entry for one in members), content=content
        )
        return replace(staged, scenario=scenario, robots=members)

    def _told(self, robot: Robot) -> Robot:
        """A robot with the policy of these conditions."""
        entry = robot.entry
        if self.unattended is None:
            return robot
        if self.unattended == "patrol" and not entry.route:
            raise MissionError(
                f"{entry.name} is to patrol and has no route (add it to the mission)"
            )
        return replace(robot, entry=replace(entry, unattended=self.unattended))
