"""Makes things happen to robots, links, victims and operators that an instructor or a script wants.

What has failed stays so until it recovers: nobody can switch it on. A robot of another controller
is held back by the server meanwhile. What is to last for a while ends in simulated time.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from usarsim_client import HangupError, ProtocolError

if TYPE_CHECKING:
    from usarsim_operator.robot_link import Driven
    from usarsim_operator.station import Station

WHOM: Mapping[str, str] = MappingProxyType(
    {
        "robot_fails": "robot",
        "robot_recovers": "robot",
        "link_drops": "robot",
        "link_returns": "robot",
        "victim_calls": "victim",
        "message": "text",
    }
)
"""What can be made to happen, and which fact says to whom."""
_ENDS = {"robot_fails": "robot_recovers", "link_drops": "link_returns"}


@dataclass(frozen=True, slots=True)
class Inject:
    """Something to happen now.

    Attributes:
        do: of `WHOM`. robot, victim: to whom. text: what operators are told.
        lasts: simulated s until it ends by itself; None: it does not.
        name: what the log calls it. line: of the script that wants it, as it stands there.
        by: who wants it.
    """

    do: str
    robot: str = ""
    victim: str = ""
    text: str = ""
    lasts: float | None = None
    name: str = ""
    line: str = ""
    by: str = ""


class Injects:
    """Carries out injects at one station."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._ends: list[tuple[float, int, Inject]] = []
        self._order = itertools.count()

    async def do(self, inject: Inject) -> str:
        """Make something happen; why it did not, or nothing. Either is noted.

        At the return it holds; of a world in lockstep this is the tick at which it stands.
        """
        try:
            if inject.do == "victim_calls":
                await self._call(inject)
            else:
                await self._hold_back(inject)
                self._act(inject)
            why = ""
        except (ValueError, ProtocolError, HangupError, OSError) as error:
            why = str(error)
        self._note(inject, why)
        return why

    def beat(self) -> None:
        """End what has lasted long enough."""
        while self._ends and self._ends[0][0] <= self._station.time + 1e-9:
            inject = heapq.heappop(self._ends)[2]
            driven = self._station.robots.get(inject.robot)
            if driven is not None and not driven.own:
                self._station.background(self._end(inject))
                continue
            try:
                self._act(inject)
                why = ""
            except ValueError as error:
                why = str(error)
            self._note(inject, why)

    async def _end(self, inject: Inject) -> None:
        await self.do(inject)

    def _note(self, inject: Inject, why: str) -> None:
        whom = {key: getattr(inject, key) or None for key in ("robot", "victim", "text")}
        about = {"name": inject.name or inject.do, "do": inject.do, **whom, "lasts": inject.lasts}
        more = {"line": inject.line, "by": inject.by, "done": not why, "why": why}
        self._station.observers.note("inject", {**about, **more})

    def _act(self, inject: Inject) -> None:
        station = self._station
        if inject.do == "message":
            station.event("", "message", inject.text)
            return
        faults = inject.do in ("robot_fails", "robot_recovers")
        driven = self._robot(inject.robot, others=faults)
        on = inject.do in ("robot_recovers", "link_returns")
        if faults:
            before = driven.name in station.arbiter.disabled
            station.arbiter.fail(driven.name, not on)
            if not on:
                station.stop(driven, "it has failed")
            if before == on:
                station.event(driven.name, "enabled", on)
        else:
            # Also as it returns: what its policy said meanwhile did not arrive.
            station.stop(driven, "its link is back" if on else "its link has dropped")
            driven.cut = not on
            station.look()
            station.event(driven.name, "link", "good" if on else "lost", signal_dbm=None)
        if inject.lasts is not None and inject.do in _ENDS:
            end = Inject(
                _ENDS[inject.do],
                robot=inject.robot,
                name=inject.name or inject.do,
                line=inject.line,
                by=inject.by,
            )
            heapq.heappush(self._ends, (station.time + inject.lasts, next(self._order), end))

    def _robot(self, name: str, *, others: bool) -> Driven:
        """others: also one of another controller."""
        driven = self._station.robots.get(name)
        if driven is None or not (driven.own or others):
            raise ValueError(f"{name} is no robot of the console")
        return driven

    async def _hold_back(self, inject: Inject) -> None:
        """Take a robot that fails away from its controller, and give it back."""
        if inject.do not in ("robot_fails", "robot_recovers"):
            return
        driven, scene = self._robot(inject.robot, others=True), self._station.scene
        if driven.own or driven.name in self._station.arbiter.holders:
            return
        if scene is None or not scene.features["takeover"]:
            raise ValueError(f"{driven.name} is driven by its own controller")
        if inject.do == "robot_fails":
            await scene.request("take", robot=driven.name, by="a fault")
        else:
            await scene.request("hand_back", robot=driven.name, resume=True)

    async def _call(self, inject: Inject) -> None:
        scene = self._station.scene
        if scene is None or not scene.features.get("calls"):
            raise ValueError("this server lets nobody call")
        lasts = {} if inject.lasts is None else {"seconds": inject.lasts}
        await scene.request("call", victim=inject.victim, **lasts)
        if inject.text:
            self._station.event("", "message", inject.text)
