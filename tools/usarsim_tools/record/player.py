"""Plays the controllers' side of a recording against a server."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from usarsim_tools.record.compare import Row, Tolerance, compare
from usarsim_tools.record.digest import Digest
from usarsim_tools.record.recording import (
    DATA,
    END,
    OPEN,
    REFUSED,
    RESET,
    SERVER,
    Event,
    Link,
    RecordError,
    Recording,
)

__all__ = ["Outcome", "play"]

_POLL = 0.01
"""s between two looks at what a controller waits for."""
_CHUNK = 65536


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a replay.

    Attributes:
        rows: verdicts, connection by connection.
        late: s by which waiting has made it longer than the recording.
    """

    rows: tuple[Row, ...]
    late: float

    @property
    def passed(self) -> bool:
        """Whether the server said the same."""
        return all(row.passed for row in self.rows)


@dataclass
class _Line:
    """One connection, then and now."""

    then: Digest = field(default_factory=Digest)
    now: Digest = field(default_factory=Digest)
    writer: asyncio.StreamWriter | None = None
    reading: asyncio.Task[None] | None = None
    client_ended: bool = False
    missed: Counter[str] = field(default_factory=Counter)


async def play(
    recording: Recording,
    links: Mapping[int, Link] | None = None,
    *,
    speed: float = 1.0,
    patience: float = 5.0,
    tolerance: Tolerance | None = None,
) -> Outcome:
    """Play a recording.

    What the controllers sent goes out at its time, in its pieces and in its order over all
    connections; before each piece the replies that the controller had by then must have come, and
    the first line of every stream.

    Args:
        recording: the session.
        links: where to connect, by index of the link; by default where the recording was made.
        speed: times as fast as then.
        patience: s of wall time to wait for replies that the controller had.
        tolerance: of the comparison.

    Raises:
        RecordError: if the server cannot be reached.
    """
    player = _Player(recording, dict(links or {}), speed, patience)
    try:
        for event in recording.events:
            await player.take(event)
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
        self.late = 0.0
        self.lines: dict[int, _Line] = {}

    async def take(self, event: Event) -> None:
        """Note what the server did then, do what the controller did."""
        if event.kind == OPEN:
            await self._until(event.time)
            await self._connect(event)
            return
        line = self.lines[event.connection]
        if event.side == SERVER:
            if event.kind == DATA:
                line.then.feed(event.data, event.time)
            elif event.kind in (END, RESET, REFUSED):
                line.then.ended = line.then.ended or not line.client_ended
            return
        await self._until(event.time)
        if event.kind == DATA:
            await self._wait(line)
            await self._send(line, event.data)
        elif event.kind in (END, RESET):
            await self._wait(line)
            line.client_ended = True
            if line.writer is not None:
                if event.kind == RESET:
                    line.writer.transport.abort()
                else:
                    with contextlib.suppress(OSError, RuntimeError):
                        line.writer.write_eof()

    async def settle(self) -> None:
        """Wait for the end of the recording, and for the last replies."""
        await self._until(self._seconds)
        for line in self.lines.values():
            await self._wait(line)

    async def stop(self) -> None:
        """Hang up everywhere."""
        tasks = [line.reading for line in self.lines.values() if line.reading is not None]
        for line in self.lines.values():
            line.client_ended = True
            if line.writer is not None:
                line.writer.close()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _until(self, time: float) -> None:
        """Wait for a time of the recording, later by what waiting has cost so far."""
        left = self._begun + time / self._speed + self.late - self._loop.time()
        if left > 0.0:
            await asyncio.sleep(left)

    async def _wait(self, line: _Line) -> None:
        """Wait for what the controller had received by now, as long as patience lasts."""
        needed = line.then.needed() - line.missed
        begun = self._loop.time()
        while (missing := needed - line.now.heads) and not line.now.ended:
            if self._loop.time() - begun > self._patience:
                line.missed += missing  # waited for once only
                break
            await asyncio.sleep(_POLL)
        self.late += self._loop.time() - begun

    async def _connect(self, event: Event) -> None:
        link = self._links[event.link]
        line = self.lines[event.connection] = _Line()
        try:
            async with asyncio.timeout(self._patience):
                reader, writer = await asyncio.open_connection(link.host, link.port)
        except (OSError, TimeoutError) as error:
            raise RecordError(
                f"no connection to {link.host}:{link.port}: {error or 'no answer'} (start the "
                "server, or name its port with --port)"
            ) from None
        writer.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        line.writer = writer
        line.reading = asyncio.create_task(self._read(line, reader))

    async def _read(self, line: _Line, reader: asyncio.StreamReader) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(_CHUNK):
                line.now.feed(data, self._loop.time())
        line.now.ended = not line.client_ended

    async def _send(self, line: _Line, data: bytes) -> None:
        if line.writer is None:
            return
        with contextlib.suppress(OSError, TimeoutError):
            line.writer.write(data)
            async with asyncio.timeout(self._patience):
                await line.writer.drain()
