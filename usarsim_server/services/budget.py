"""The processor time that the clients of a port may use together.

All threads of a Python process share one lock, so whatever a port does takes time from the physics
and the reports, beside the event loop as much as on it. A port therefore has a share of one
processor. While it has not used it up, everybody is served at once. Beyond that clients take turns:
the one who has used least goes first (start-time fair queueing; Goyal, Vin and Cheng, SIGCOMM
1996), so that somebody who asks ten times a second waits for one turn of the others, not for all.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from usarsim_server.base.token_bucket import Clock, TokenBucket

TURN_COST = 60e-6
"""s of processor time that a turn costs beside the work in it: waking the loop, reading, sending.
Measured with one thread on an EPYC at 2.6 GHz."""
HOP_COST = 100e-6
"""The same for an answer worked out on another thread that looks at the physics."""
BYTE_COST = 1.5e-9
"""s of processor time for each byte that passes through a socket, in and out of the kernel."""
CREDIT = 0.005
"""s of processor time by which a client that asks little may be behind the others: a request of
its own comes before theirs, but what it did not use yesterday is gone."""
BURST = 0.02
"""s of processor time that a port saves up while it does nothing."""


ON_PACE = 0.97
"""Part of the speed asked for at which the world counts as on pace."""
BEHIND = 0.1
"""How far the world may fall below that before ports get the least there is."""
LEAST = 0.2
"""Part of its share that a port has in any case."""
WINDOW = 0.5
"""s of wall time over which the pace of the world is taken."""


class Pace:
    """Which part of its share a port may use: less while the world falls behind.

    Physics and reports come first. On a machine that can spare a port its share nobody notices; on
    one that cannot, the port waits and not the world. Used on one event loop.
    """

    def __init__(
        self,
        simulated: Callable[[], float],
        speed: Callable[[], float],
        clock: Clock = time.monotonic,
    ) -> None:
        """Begin with the whole share.

        Args:
            simulated: s of simulated time; returns at once.
            speed: simulated s per s of wall time asked for; finite, 0 in a pause.
            clock: wall time.
        """
        self._simulated, self._speed, self._clock = simulated, speed, clock
        self._then = clock(), simulated()
        self._part = 1.0

    def __call__(self) -> float:
        """The part at this moment, from `LEAST` to 1."""
        now = self._clock()
        passed = now - self._then[0]
        if passed >= WINDOW:
            simulated = self._simulated()
            asked = passed * self._speed()
            factor = (simulated - self._then[1]) / asked if asked else 1.0
            self._then = now, simulated
            self._part = min(1.0, max(LEAST, 1.0 - (ON_PACE - factor) / BEHIND))
        return self._part


def whole_share() -> float:
    """All of its share, whatever the world does: it goes at no pace, or is none."""
    return 1.0


@dataclass(slots=True, eq=False)
class Account:
    """What one client has used."""

    used: float = 0.0
    """s of processor time, counted from where the port stood when the client came; one who asks
    little is brought up to `CREDIT` behind the others."""


@dataclass(slots=True, order=True)
class _Waiting:
    used: float
    number: int
    account: Account = field(compare=False)
    turn: asyncio.Future[None] = field(compare=False)


class WorkBudget:
    """Shares processor time among the clients of a port. Used on one event loop."""

    def __init__(
        self,
        share: float,
        *,
        burst: float = BURST,
        pace: Callable[[], float] = whole_share,
        clock: Clock = time.monotonic,
        work_clock: Clock = time.thread_time,
        call_later: Callable[[float, Callable[[], None]], object] | None = None,
    ) -> None:
        """Start with a full purse.

        Args:
            share: s of processor time per s of wall time; infinity for as much as there is.
            burst: s of processor time that can be saved up.
            pace: which part of the share may be used now, see `Pace`.
            clock: wall time.
            work_clock: processor time of the calling thread.
            call_later: calls back after so many s; None: that of the running loop.
        """
        self._bucket = TokenBucket(share, burst, clock=clock)
        self._share, self._pace = share, pace
        self._work_clock = work_clock
        self._call_later = call_later
        self._numbers = itertools.count()
        self._queue: list[_Waiting] = []
        self._reached = 0.0
        self._timer: object | None = None

    @property
    def waiting(self) -> int:
        """Number of clients that wait for their turn."""
        return sum(not one.turn.done() for one in self._queue)

    def newcomer(self) -> Account:
        """The account of a new client: before those who ask much, behind those who ask little."""
        return Account(self._reached - CREDIT / 5)

    async def turn(self, account: Account) -> None:
        """Wait until a client may work; it is charged for the turn as such."""
        account.used = max(account.used, self._reached - CREDIT)
        if self._queue or self._tokens() < 0.0:
            turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            heapq.heappush(self._queue, _Waiting(account.used, next(self._numbers), account, turn))
            self._serve()
            await turn
        else:
            self._grant(account)

    def charge(self, account: Account, seconds: float) -> None:
        """Let a client pay for s of processor time."""
        account.used += seconds
        self._bucket.spend(seconds)

    @contextmanager
    def work(self, account: Account) -> Iterator[None]:
        """Charge a client for the processor time of what happens inside; no awaits in there."""
        begun = self._work_clock()
        try:
            yield
        finally:
            self.charge(account, self._work_clock() - begun)

    def _tokens(self) -> float:
        tokens = self._bucket.tokens
        self._bucket.rate = self._share * self._pace()
        return tokens

    def _grant(self, account: Account) -> None:
        self._reached = max(self._reached, account.used)
        self.charge(account, TURN_COST)

    def _serve(self) -> None:
        """Give turns as long as there is time; look again when there will be."""
        while self._queue and self._tokens() >= 0.0:
            one = heapq.heappop(self._queue)
            if not one.turn.done():  # else its client has gone
                self._grant(one.account)
                one.turn.set_result(None)
        if self._queue and self._timer is None:
            wait = max(-self._bucket.tokens / self._bucket.rate, 0.001)
            call_later = self._call_later or asyncio.get_running_loop().call_later
            self._timer = call_later(wait, self._again)

    def _again(self) -> None:
        self._timer = None
        self._serve()
