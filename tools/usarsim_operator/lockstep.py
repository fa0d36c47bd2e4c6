"""A gateway at a server in lockstep is the pacemaker of its world (docs/lockstep.md).

Whatever comes between two ticks waits: lines of our robots, texts of pages, pages that come and go.
At a tick, when every robot of ours has been told of it, all of that is handed to the rules in a
fixed order: robots by their index, what the station does by itself, then pages in the order in
which they spoke. Then each robot is told what follows from it, and all say SYNC. The rules read no
clock but that of the tick. So what robots are told, and with it the world, is a function of what
pages said at which tick; that is in the recording, and `replay` does it again.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from usarsim_client import HangupError, ProtocolError, Robot, reports
from usarsim_client.commands import say
from usarsim_client.decoder import Value
from usarsim_client.scene import LiveScene, TruthRow, connect_scene
from usarsim_operator import messages
from usarsim_operator.messages import PageError
from usarsim_operator.watchdog import PAGE_TIME

if TYPE_CHECKING:
    from usarsim_operator.pages import Page
    from usarsim_operator.pulse import Pulse
    from usarsim_operator.requests import Desk
    from usarsim_operator.robot_link import Driven
    from usarsim_operator.station import Station

SYNC = say("SYNC")
AT_ONCE = ("ping", "shown", "ready")
"""Texts about a page and the way to it; no rule of the world hears them."""
LOOKING = ("select", "camera", "laser")
"""Texts that count before the world goes, too."""
IDLE = 0.02
"""s of wall time between two looks at what pages say while no robot of ours is there."""
WAIT = 0.05
"""s of wall time between two looks whether robots are still there while they say nothing."""
LAG = 0.5
"""s of wall time that may be caught up; what is later than that is given up."""
KEEP = 1 << 20  # values of a robot that may wait for its tick
PATIENCE = 60.0
"""s of wall time for what an input sets going, such as bringing a robot into the world."""
STATES = 4096  # states of the world that are remembered

_GONE = (OSError, ProtocolError, HangupError, TimeoutError)


@dataclass(slots=True, eq=False)
class _Voice:
    """One robot of ours: what it has said since the tick before, and whether that is all."""

    driven: Driven
    robot: Robot
    values: list[Value] = field(default_factory=list)
    told: bool = False  # of the tick at which the world stands
    time: float = 0.0  # of that, simulated s
    dead: bool = False  # it is not waited for any more
    waiting: bytes = b""  # to be sent with the next SYNC

    @property
    def ready(self) -> bool:
        """Whether it holds nobody up."""
        gone = self.dead or self.robot.link.closed
        return gone or (self.told and self.driven.learned)


@dataclass(frozen=True, slots=True)
class _Input:
    """Something that waits for the next tick."""

    page: Page
    act: Callable[[], None]
    looks: bool = True  # it may count while the world does not go yet


class Lockstep:
    """The pacemaker of one station.

    Attributes:
        tick: how many ticks we have let pass. time: simulated s of the newest.
        pace: simulated s per s of wall time; infinity for as fast as it goes.
        before: called with the tick before the inputs of pages are taken: programs that drive.
        loses: whether pages that are silent by the wall clock count as gone; in a replay they
            go when they went.
        states: digests of the whole world by simulated s, as the scene port tells them.
        watches: whether the truth is asked for here; otherwise somebody tells each row by `see`.
    """

    def __init__(self, station: Station, pace: float) -> None:
        self.tick, self.time, self.pace = 0, 0.0, pace
        self.loses = self.watches = True
        self.before: list[Callable[[int], None]] = []
        self.states: dict[float, str] = {}
        self._station = station
        self._voices: list[_Voice] = []
        self._inputs: deque[_Input] = deque()
        self._heard = {id: station.wall for id in station.pages if id}
        self._work: list[asyncio.Task[None]] = []
        self._applying = self._gathering = self._begun = False
        self._stirred = asyncio.Event()
        self._beginning = math.nan, 0.0  # of keeping the pace: wall and simulated s
        self._row = asyncio.Event()

    # -- what comes between two ticks ---------------------------------------------------------

    def hear(self, desk: Desk, page: Page, text: str) -> None:
        """A page says something: it counts at the next tick, unless it is only about the link."""
        self._heard[page.id] = heard = self._station.wall
        try:
            kind = messages.read(text).type
        except PageError:
            kind = ""
        if kind in AT_ONCE:
            desk.obey(page, text)
        else:
            act = lambda: desk.obey(page, text, heard)  # noqa: E731
            self._inputs.append(_Input(page, act, kind in LOOKING))

    def defer(self, page: Page, on: bool) -> bool:
        """A page comes or goes; whether that has to wait for the next tick."""
        if self._applying:
            self._note(page, on)
            return False
        if on:
            self._heard[page.id] = self._station.wall
            self._inputs.append(_Input(page, lambda: self._station.join(page)))
        elif self._heard.pop(page.id, None) is not None:
            self._inputs.append(_Input(page, lambda: self._station.leave(page)))
        return True

    def _note(self, page: Page, on: bool) -> None:
        facts = {"page": page.id, "role": page.role.value, "name": page.name, "seat": page.seat}
        self._station.observers.note("connect", {**facts, "on": on, "tick": self.tick})

    def silent(self) -> list[int]:
        """Pages that have said nothing for too long by the wall clock: they are asked by it."""
        wall = self._station.wall if self.loses else -math.inf
        return [page for page, last in self._heard.items() if wall - last >= PAGE_TIME]

    def collect(self, driven: Driven, value: Value) -> None:
        """A robot of ours says something."""
        for voice in self._voices:
            if voice.driven is driven:
                voice.values.append(value)
                if isinstance(value, reports.Tick):
                    voice.told, voice.time = True, value.time
                voice.dead = voice.dead or isinstance(value, reports.Death)
                self._stirred.set()

    def enrol(self, driven: Driven, robot: Robot) -> None:
        """A robot of ours has come; all it says is heard from now on, and told when we say so."""
        voice = _Voice(driven, robot)
        tick = robot.newest(reports.Tick)
        if tick is not None:
            voice.told, voice.time = True, tick.time
        self._voices.append(voice)
        driven.hold(robot, KEEP)

    def gather(self, task: asyncio.Task[None]) -> None:
        """Something is under way that an input has set going: the next tick waits for it."""
        if self._gathering:
            self._work.append(task)

    # -- from tick to tick --------------------------------------------------------------------

    async def run(self, pulse: Pulse) -> None:
        """Let time go on until cancelled."""
        while True:
            await self.round(pulse)

    async def round(self, pulse: Pulse) -> None:
        """Do all that belongs to the tick at which the world stands, and go to the next."""
        station = self._station
        await self._stand(pulse)
        if station.signals is not None:
            await station.signals.at(self.time)
        pulse.beat()
        await self._keep_pace()
        for act in self.before:
            act(self.tick)
        while self._inputs:
            await self._apply(self._inputs.popleft())
        for voice in self._present():
            await self._tell(voice)
        await self._go_on()

    async def attend(self, pulse: Pulse) -> None:
        """Let pages in and show them the world while it does not go yet: nobody drives in it."""
        await self._stand(pulse)
        waiting: list[_Input] = []
        while self._inputs:
            one = self._inputs.popleft()
            if one.looks:
                await self._apply(one)
            else:
                waiting.append(one)
        self._inputs.extend(waiting)
        pulse.restart()
        pulse.beat()

    async def _stand(self, pulse: Pulse) -> None:
        """Begin, if that was not done, and take what robots have said at this tick."""
        if not self._begun:
            self._begun = True
            pulse.restart()
            await self._begin()
        for voice in self._present():
            values, voice.values = voice.values, []
            for value in values:
                self._station.take(voice.driven, value)

    async def _tell(self, voice: _Voice) -> None:
        """Tell a robot what follows; with SYNC, and in one piece, if nobody is waited for."""
        said = voice.driven.take()
        for data in said:
            facts = {"tick": self.tick, "robot": voice.driven.name}
            self._station.observers.note("sent", {**facts, "text": data.decode("latin-1")})
        voice.waiting = b"".join(said)
        if voice.waiting and not voice.ready:
            await self._send(voice)

    async def _send(self, voice: _Voice, more: bytes = b"") -> None:
        data, voice.waiting = voice.waiting + more, b""
        with contextlib.suppress(*_GONE):
            await voice.robot.link.send(data)

    def _present(self) -> list[_Voice]:
        robots = self._station.robots
        there = [one for one in self._voices if robots.get(one.driven.name) is one.driven]
        self._voices = sorted(there, key=lambda one: one.driven.index)
        return self._voices

    async def _begin(self) -> None:
        await self._all_told()
        self.time = max((one.time for one in self._present()), default=self.time)
        robots = [
            {"name": one.driven.name, "class": one.driven.class_name} for one in self._present()
        ]
        self._station.watchdog.restart(self.time)
        self._station.observers.note("lockstep", {"tick": self.tick, "robots": robots})
        for page in self._station.pages.values():
            if page.id in self._heard:
                self._note(page, True)
        scene = self._station.settings.scene
        if scene is not None and self.watches:
            token = self._station.settings.scene_token
            with contextlib.suppress(*_GONE):
                live = await connect_scene(*scene, token=token, channels=["truth"])
                self._station.background(self._watch(live))

    async def _apply(self, one: _Input) -> None:
        """Let an input count, and wait for what it sets going."""
        self._applying = self._gathering = True
        try:
            one.act()
        finally:
            self._applying = False
        while self._work:
            tasks, self._work = self._work, []
            await asyncio.wait(tasks, timeout=PATIENCE)
        self._gathering = False

    async def _keep_pace(self) -> None:
        """Wait until this tick is due by the wall clock."""
        wall, since = self._station.wall, self._beginning
        if math.isinf(self.pace):
            await asyncio.sleep(0.0)
            return
        due = since[0] + (self.time - since[1]) / self.pace
        if math.isnan(due) or wall - due > LAG:
            self._beginning = wall, self.time
        await asyncio.sleep(due - wall if due > wall else 0.0)

    async def _go_on(self) -> None:
        """To the next tick, if there is anybody whom it would be told to."""
        await self._all_told()
        present = [one for one in self._present() if not one.dead]
        if not present:
            await asyncio.sleep(IDLE)
            return
        for one in present:
            one.told = False
        for one in present:
            await self._send(one, SYNC)
        await self._all_told()
        self.tick += 1
        self.time = max([self.time, *(one.time for one in self._present())])

    async def _all_told(self) -> None:
        """Wait until every robot of ours has been told of the tick at which the world stands."""
        while not all(one.ready for one in self._present()):
            self._stirred.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(WAIT):  # not only what is heard changes that
                    await self._stirred.wait()

    # -- the state of the world ---------------------------------------------------------------

    async def _watch(self, live: LiveScene) -> None:
        """Remember what the scene port says of the state of the world."""
        async with live:
            with contextlib.suppress(*_GONE):
                while True:
                    self.see(await live.truth())

    def see(self, row: TruthRow) -> None:
        """Remember the state of the world; note it once a second."""
        self.states[row.time] = row.state
        if len(self.states) > STATES:
            del self.states[next(iter(self.states))]
        if abs(row.time - round(row.time)) < 1e-6:
            facts = {"at": row.time, "state": row.state}
            self._station.observers.note("world", facts)
        self._row.set()

    async def state(self) -> str:
        """Digest of the whole world at this tick.

        Raises:
            TimeoutError: the scene port does not tell it.
        """
        async with asyncio.timeout(PATIENCE):
            while round(self.time, 6) not in self.states:
                self._row.clear()
                await self._row.wait()
        return self.states[round(self.time, 6)]
