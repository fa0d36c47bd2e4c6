"""What robots, avatars and world controllers have in common: a connection and what it says."""

from __future__ import annotations

from typing import TypeVar

from usarsim_client.commands import say
from usarsim_client.connection import AsyncClosing
from usarsim_client.inbox import Line, command
from usarsim_client.link import Link
from usarsim_client.reports import Tick
from usarsim_client.state import RobotState
from usarsim_client.streams import Stream

Kind = TypeVar("Kind")


class Participant(AsyncClosing):
    """Whoever is in the world by a connection of its own: a robot, an avatar, a world controller.

    Attributes:
        name: as asked for; empty if the server invents one.
        link: its connection.
    """

    def __init__(self, link: Link, name: str) -> None:
        self.link = link
        self.name = name
        self._ticks = link.stream(Tick, keep=64)
        self._met = 0  # the coming into the world whose first tick was seen

    @property
    def state(self) -> RobotState:
        """What it was told so far; a new one after each reconnection."""
        return self.link.state

    @property
    def time(self) -> float:
        """Newest simulated s that it was told; NaN before its first report."""
        return self.link.state.time

    @property
    def connected(self) -> bool:
        """Whether it is in the world, as far as we know."""
        return self.link.connected

    def newest(self, kind: type[Kind], name: str = "") -> Kind | None:
        """What came last of a kind, as `newest(LaserScan)`; None before. Never waits."""
        return self.link.state.newest(kind, name)

    def stream(self, kind: type[Kind], name: str = "", keep: int = 0) -> Stream[Kind]:
        """All values of a kind from now on.

        Args:
            kind: class of the values; of a base class, as `Reading`, all that derive from it;
                `Line` for the lines themselves.
            name: of the item, in any case; empty: all items.
            keep: 0: the newest value of each item waits for you, older ones are dropped;
                otherwise up to so many values wait, and then the oldest are dropped.
        """
        return self.link.stream(kind, name, keep)

    def lines(self, keep: int = 1000) -> Stream[Line]:
        """The lines of the server themselves."""
        return self.link.lines(keep)

    async def send(self, text: str) -> None:
        """Send a command as it is, without its line end; for what has no method here."""
        await self.link.send(command(text))

    async def sync(self, ticks: int = 1) -> float:
        """Let a world in lockstep go on; returns the simulated s of the next tick.

        With other robots of this program in the world use `Server.sync`: the world waits for all.

        Args:
            ticks: how many pass before this robot is asked again.

        Raises:
            TimeoutError: if no tick comes, for example because the server is not in lockstep.
        """
        await self.stand_still()
        await self.release(ticks)
        return await self.next_tick()

    async def stand_still(self) -> None:
        """Wait for the tick that a newcomer is told of; before any `release`."""
        if self._met != self.link.spawns:
            await self.next_tick()
            self._met = self.link.spawns

    async def release(self, ticks: int = 1) -> None:
        """Say that the world may go on as far as this robot is concerned."""
        await self.link.send(say("SYNC", Ticks=ticks))

    async def next_tick(self) -> float:
        """Wait for the next tick; returns its simulated s."""
        async with self.link.address.patience("no tick; is the server in lockstep?"):
            return (await self._ticks.get()).time

    async def close(self) -> None:
        """Hang up; it leaves the world."""
        await self.link.close()
