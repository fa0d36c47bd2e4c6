"""Simulated time of a small server."""

from __future__ import annotations

import asyncio

_ROUNDS = 8
"""Rounds of the event loop in a tick: a client in the same loop answers within one or two ticks,
however long a round takes."""


class Ticks:
    """Time that goes on in ticks, more slowly if the machine is busy; nobody misses one.

    Attributes:
        seconds: of simulated time in a tick.
        count: ticks so far.
    """

    def __init__(self, seconds: float, speed: float) -> None:
        """Time stands still until `run`.

        Args:
            seconds: of simulated time in a tick.
            speed: simulated s per s, at most.
        """
        self.seconds = seconds
        self.count = 0
        self._pause = seconds / speed
        self._next: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    @property
    def time(self) -> float:
        """Simulated s."""
        return self.count * self.seconds

    async def run(self) -> None:
        """Tick for ever."""
        while True:
            await asyncio.sleep(self._pause)
            for _ in range(_ROUNDS):
                await asyncio.sleep(0)
            self.count += 1
            passed, self._next = self._next, asyncio.get_running_loop().create_future()
            passed.set_result(None)

    async def next(self) -> None:
        """Wait for the next tick."""
        await asyncio.shield(self._next)

    async def sleep(self, seconds: float) -> None:
        """Wait for simulated time to pass."""
        for _ in range(max(1, round(seconds / self.seconds))):
            await self.next()
