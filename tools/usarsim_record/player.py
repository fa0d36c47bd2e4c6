"""Plays the controllers' side of a recording against a server."""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from usarsim_client.connection import Connection
from usarsim_record.digest import Digest, Row, Tolerance, compare
from usarsim_record.recording import (
    DATA,
    END,
    OPEN,
    REFUSED,
    RESET,
    SERVER,
    Cue,
    Event,
    Link,
    RecordError,
    Recording,
    SessionClock,
    cues,
)
from usarsim_server.base.addresses import format_address

_HANGS = 60.0
"""s of wall time without a byte after which the server counts as hanging."""
_LOOKS = 1.0
"""s of wall time between two looks at a server that says nothing."""
_EXACT = 1e-6
"""s; printed times are rounded, and so are their differences."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a replay."""

    rows: tuple[Row, ...]  # verdicts, connection by connection
    late: float  # s of wall time by which it took longer than the recording

    @property
    def passed(self) -> bool:
        """Whether the server said the same."""
        return all(row.passed for row in self.rows)


@dataclass
class _Line:
    """One connection, then and now."""

    then: Digest = field(default_factory=Digest)
    now: Digest = field(default_factory=Digest)
    connection: Connection | None = None
    reading: asyncio.Task[None] | None = None
    client_ended: bool = False
    missed: Counter[str] = field(default_factory=Counter)


async def play(
    recording: Recording,
    links: Mapping[int, Link] | None = None,
    *,
    speed: float = 1.0,
    patience: float = 20.0,
    tolerance: Tolerance | None = None,
) -> Outcome:
    """Play a recording.

    What the controllers sent goes out in its pieces and in its order over all connections, each
    when the server has told the simulated time that it had told then, since the first one. Before
    each piece the replies that the controller had by then must have come, and the first line of
    every stream. Only where nobody told a time, pauses of wall time are those of the recording.

    Args:
        recording: the session.
        links: where to connect, by index of the link; by default where the recording was made.
        speed: times as fast as then, for pauses in which no simulated time was told.
        patience: s of simulated time to wait for replies that the controller had; of wall time
            while none is told.
        tolerance: of the comparison.

    Raises:
        RecordError: if the server cannot be reached.
    """
    player = _Player(recording, dict(links or {}), speed, patience)
    try:
        for event, cue in zip(recording.events, cues(recording.events), strict=True):
            await player.take(event, cue)
        await player.settle()
    finally:
        await player.stop()
    tolerance = tolerance or Tolerance()
    rows = [
        row
        for number, line in player.lines.items()
        for row in compare(number, line.then, line.now, tolerance)
    ]
    return Outcome(tuple(rows), player.late)


class _Player:
    def __init__(
        self, recording: Recording, links: dict[int, Link], speed: float, patience: float
    ) -> None:
        self._links = [links.get(index, link) for index, link in enumerate(recording.links)]
        self._seconds = recording.seconds
        self._speed = speed
        self._patience = patience
        self._loop = asyncio.get_running_loop()
        self._begun = self._loop.time()
        self._clock = SessionClock()
        self._then = SessionClock()
        self._news = asyncio.Event()
        self._hanging = False
        self.lines: dict[int, _Line] = {}

    @property
    def late(self) -> float:
        """s of wall time more than then."""
        return max(0.0, self._loop.time() - self._begun - self._seconds)

    async def take(self, event: Event, cue: Cue) -> None:
        """Note what the server did then, do what the controller did."""
        if event.kind == OPEN:
            await self._moment(cue)
            await self._connect(event)
            return
        line = self.lines[event.connection]
        if event.side == SERVER:
            if event.kind == DATA:
                line.then.feed(event.data)
                self._then.hear(event.connection, event.data)
            elif event.kind in (END, RESET, REFUSED):
                self._then.end(event.connection)
                line.then.ended = line.then.ended or not line.client_ended
            return
        await self._wait(line)
        await self._moment(cue)
        if event.kind == DATA:
            await self._send(line, event.data)
        elif event.kind in (END, RESET):
            line.client_ended = True
            self._then.end(event.connection)
            if line.connection is not None and event.kind == RESET:
                line.connection.abort()
            elif line.connection is not None:
                line.connection.half_close()

    async def settle(self) -> None:
        """Wait for the end of the recording, and for the last replies."""
        if any(not line.client_ended for line in self.lines.values()):
            await self._moment(Cue(self._then.elapsed, 0.0))
        for line in self.lines.values():
            await self._wait(line)

    async def stop(self) -> None:
        """Hang up everywhere."""
        tasks = [line.reading for line in self.lines.values() if line.reading is not None]
        for line in self.lines.values():
            line.client_ended = True
            if line.connection is not None:
                line.connection.close()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _moment(self, cue: Cue) -> None:
        """Wait until it is as late as it was when the controller did something."""
        await asyncio.sleep(cue.pause / self._speed)
        wanted = cue.elapsed
        if wanted is None:
            return

        def reached() -> bool:
            told = self._clock.elapsed
            # Nobody tells it any more: the last of them left a report earlier than then.
            return told is not None and (told >= wanted - _EXACT or not self._clock.telling)

        await self._until(reached)

    async def _wait(self, line: _Line) -> None:
        """Wait for what the controller had received by now, as long as patience lasts."""
        needed = line.then.needed() - line.missed
        begun, told = self._loop.time(), self._clock.elapsed or 0.0

        def done() -> bool:
            waited = (self._clock.elapsed or 0.0) - told
            if not self._clock.telling:
                waited = max(waited, self._loop.time() - begun)
            return not needed - line.now.heads or line.now.ended or waited > self._patience

        await self._until(done)
        line.missed += needed - line.now.heads  # waited for once only

    async def _until(self, done: Callable[[], bool]) -> None:
        """Wait for something that bytes of the server bring about, unless it says nothing more."""
        silent = 0.0
        while not done() and not self._hanging:
            self._news.clear()
            try:
                async with asyncio.timeout(_LOOKS):
                    await self._news.wait()
                silent = 0.0
            except TimeoutError:
                silent += _LOOKS
                self._hanging = silent >= _HANGS

    async def _connect(self, event: Event) -> None:
        link = self._links[event.link]
        line = self.lines[event.connection] = _Line()
        try:
            async with asyncio.timeout(_HANGS):
                line.connection = await Connection.open(link.host, link.port)
        except (OSError, TimeoutError) as error:
            raise RecordError(
                f"no connection to {format_address(link.host, link.port)}: {error or 'no answer'} "
                "(start the server, or name its port with --port)"
            ) from None
        line.reading = asyncio.create_task(self._read(event.connection, line.connection))

    async def _read(self, number: int, connection: Connection) -> None:
        line = self.lines[number]
        with contextlib.suppress(OSError):
            while data := await connection.receive():
                line.now.feed(data)
                self._clock.hear(number, data)
                self._news.set()
        line.now.ended = not line.client_ended
        self._clock.end(number)
        self._news.set()

    async def _send(self, line: _Line, data: bytes) -> None:
        if line.connection is None:
            return
        with contextlib.suppress(OSError, TimeoutError):
            async with asyncio.timeout(_HANGS):
                await line.connection.send(data)
