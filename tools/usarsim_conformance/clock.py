"""Simulated time as the server tells it: the clock by which everything is judged."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from usarsim_conformance.registry import Failed, Inconclusive
from usarsim_conformance.wire import Hangup, Wire

HANGS = 60.0
"""s of wall time without any news of simulated time after which a server counts as hanging."""

_GRAIN = 0.2
"""s of simulated time between two reports: what was told last may be so old."""
_LEAP = 1.0
"""s of time that pass at most between two looks at what has come: the kit was held up for the rest,
and so was whatever waits in it."""
_ROUNDS = 4
"""Rounds of the event loop in which bytes that are there reach who waits for them."""
_QUESTION = b"GETSTARTPOSES\r\n"
_ANSWER = re.compile(rb"NFO\b.*?\{StartPoses")
_TIME = re.compile(rb"(?:STA|SEN)\b.*?\{Time (\d+\.?\d*)\}")
_LEAVES = 1.0
"""s in which a robot leaves with its connection."""
_BEAT = 0.05
"""s of wall time between two questions."""
_REPLIES = 10.0
"""s of simulated time after which an answer is given up."""
_ANSWERS = 1.0
"""s of wall time after which a question is given up."""


STANDS_STILL = "simulated time has not gone on"
"""How a `Stalled` begins."""


class Stalled(Inconclusive):
    """Simulated time does not go on."""


class SimulatedClock:
    """Tells how much simulated time has passed, by the reports of a robot that stands aside.

    A wait ends when its moment has been told. What the server had sent elsewhere before it told
    the moment reaches its reader first, so "nothing came by then" does not depend on how busy the
    machine is. When the kit comes to look only after much time has passed, a second of it counts:
    what is waited for has had no chance before. While no robot tells the time, seconds are those of
    the wall, or longer: until the server has answered one question more. A robot whose connection
    the server ends gets a successor.

    A server that hangs costs one long wait: from then on whoever waits is told at once, until there
    is news of time again.

    Attributes:
        now: s of time that has passed since the kit began, as far as it was told.
        told: simulated time told last, as the server counts it.
        hangs: s of wall time without news after which the server hangs.
    """

    def __init__(self, hangs: float = HANGS) -> None:
        self.now = 0.0
        self.told = 0.0
        self.hangs = hangs
        self._bells: list[tuple[float, asyncio.Future[None]]] = []
        self._teller: asyncio.Task[None] = asyncio.create_task(self._by_answers())
        self._questions: Wire | None = None
        self._wire: Wire | None = None
        self._succession: asyncio.Task[None] | None = None
        self._stalled = self._closed = False
        self._again: Callable[[], Awaitable[Wire | None]] | None = None
        self._asked: deque[asyncio.Future[float]] = deque()

    @property
    def followed(self) -> bool:
        """Whether a robot tells the time."""
        return self._wire is not None

    def after(self, seconds: float) -> float:
        """The told moment at which this much simulated time has certainly passed."""
        return self.now + seconds + _GRAIN

    async def sleep(self, seconds: float) -> None:
        """Wait for simulated time to pass.

        Raises:
            Stalled: if it does not.
        """
        until = self.after(seconds)
        while self.now < until:
            await self._wait_on(self._bell(until))

    async def wait(
        self, awaited: asyncio.Future[Any], until: float, least_wall: float = 0.0
    ) -> bool:
        """Wait for something until a moment; returns whether it is there.

        Args:
            awaited: what is waited for.
            until: the moment, see `after`.
            least_wall: s of wall time that have to pass as well before it is given up.

        Raises:
            Stalled: if simulated time does not go on.
        """
        loop = asyncio.get_running_loop()
        least = loop.time() + least_wall
        while not awaited.done() and self.now < until:
            await self._wait_on(self._bell(until), awaited)
        if not awaited.done() and loop.time() < least:
            await asyncio.wait({awaited}, timeout=least - loop.time())
        for _ in range(_ROUNDS):
            if awaited.done():
                break
            await asyncio.sleep(0)
        return awaited.done()

    async def moment(self) -> float:
        """A simulated time by which everything that has been read was sent, however late it was
        read: what the robot that tells the time reports after it has answered a question.

        Raises:
            Inconclusive: if no robot tells the time, or it does not answer.
            Stalled: if simulated time does not go on.
        """
        if self._wire is None:
            raise Inconclusive("no robot tells the time")
        answer: asyncio.Future[float] = asyncio.get_running_loop().create_future()
        self._asked.append(answer)  # the server answers in order
        await self._wire.send(_QUESTION)
        if not await self.wait(answer, self.after(_REPLIES)):
            raise Inconclusive("the robot that tells the time does not answer")
        return answer.result()

    def ask_on(self, wire: Wire) -> None:
        """Ask the server on a connection while no robot tells the time."""
        self._questions = wire

    async def follow(self, spawn: Callable[[], Awaitable[Wire | None]]) -> None:
        """Take the time from a robot from now on.

        Args:
            spawn: brings the robot into the world: its connection, None if there can be none.
        """
        self._again = spawn
        wire = await spawn()
        if wire is None:
            return
        await self._dismiss()
        self._asked.clear()
        self._wire = wire
        self._teller = asyncio.create_task(self._by_a_robot(wire))

    @contextlib.asynccontextmanager
    async def alone(self) -> AsyncIterator[None]:
        """While inside, the robot that tells the time is not in the world."""
        followed = self.followed or self._succession is not None
        await self._dismiss()
        self._teller = asyncio.create_task(self._by_answers())
        await self.sleep(_LEAVES if followed else 0.0)
        try:
            yield
        finally:
            if followed and self._again is not None:
                await self.follow(self._again)

    async def close(self) -> None:
        """Stop; whoever waits is told that time has ended."""
        self._closed = True
        await self._dismiss()
        if self._questions is not None:
            self._questions.close()
        for _, bell in self._bells:
            bell.cancel()

    async def _dismiss(self) -> None:
        succession, self._succession = self._succession, None
        tasks = [self._teller]
        if succession is not None and succession is not asyncio.current_task():
            tasks.append(succession)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if self._wire is not None:
            self._wire.close()
            self._wire = None

    def _bell(self, until: float) -> asyncio.Future[None]:
        bell = asyncio.get_running_loop().create_future()
        self._bells.append((until, bell))
        return bell

    async def _wait_on(self, bell: asyncio.Future[None], *others: asyncio.Future[Any]) -> None:
        seen = self.now
        try:
            if self._closed:
                raise Stalled("nobody tells the time any more")
            done, _ = await asyncio.wait(
                {bell, *others},
                timeout=_BEAT if self._stalled else self.hangs,
                return_when=asyncio.FIRST_COMPLETED,
            )
        finally:
            bell.cancel()
        if not done and self.now == seen:
            self._stalled = True
            raise Stalled(f"{STANDS_STILL} for {self.hangs:g} s")

    def _tell(self, now: float) -> None:
        self._stalled = self._stalled and now <= self.now
        self.now = max(self.now, now)
        left = []
        for until, bell in self._bells:
            if bell.done():
                continue
            if until <= self.now:
                bell.set_result(None)
            else:
                left.append((until, bell))
        self._bells = left

    async def _by_answers(self) -> None:
        while True:
            await asyncio.sleep(_BEAT)
            try:
                async with asyncio.timeout(_ANSWERS):
                    await self._answer()
            except TimeoutError:
                pass  # a server that does not answer, which checks will say
            except Failed:
                self._questions = None
            self._tell(self.now + _BEAT)

    async def _answer(self) -> None:
        if self._questions is not None:
            await self._questions.send(_QUESTION)
            while not (await self._questions.receive()).endswith(b"\n"):
                pass

    async def _by_a_robot(self, wire: Wire) -> None:
        rest, before = b"", math.nan
        answered: list[asyncio.Future[float]] = []  # questions whose answer a report has to follow
        while True:
            try:
                rest += await wire.receive()
            except Hangup:
                wire.close()
                self._wire = None
                self._teller = asyncio.create_task(self._by_answers())
                self._succession = asyncio.create_task(self._succeed())
                return
            lines, _, rest = rest.rpartition(b"\n")
            times = []
            for line in lines.splitlines():
                if _ANSWER.match(line) and self._asked:
                    answered.append(self._asked.popleft())
                elif found := _TIME.match(line):
                    times.append(float(found[1]))
                    for answer in answered:
                        if not answer.done():
                            answer.set_result(times[-1])
                    answered.clear()
            if times:
                for _ in range(_ROUNDS):
                    await asyncio.sleep(0)
                self.told = max(times)
                passed = 0.0 if math.isnan(before) else self.told - before
                before = self.told
                self._tell(self.now + min(passed, _LEAP))

    async def _succeed(self) -> None:
        """Bring robots into the world until one tells the time."""
        assert self._again is not None
        while True:
            with contextlib.suppress(Failed, Inconclusive):
                await self.follow(self._again)
            if self.followed:
                return
            await asyncio.sleep(_ANSWERS)
