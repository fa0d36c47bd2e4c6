"""A page's socket, and one behind an impaired link."""

from __future__ import annotations

import asyncio
import struct
import zlib
from collections import deque
from collections.abc import Callable
from typing import Protocol

from usarsim_operator.impairment import Conditions, Way

_SEQUENCE = struct.Struct("<I")
_STATE = '{"type":"state"'


Data = str | bytes


class Socket(Protocol):
    """What a page needs of a WebSocket."""

    async def send_str(self, data: str, compress: int | None = None) -> None:
        """Send a text, compressed with so many window bits; returns when the next may be sent."""

    async def send_bytes(self, data: bytes, compress: int | None = None) -> None:
        """Send bytes; returns when the next ones may be sent."""


class ImpairedLink:
    """Takes what a `Page` sends, and what its page says, and lets them arrive later or never.

    What was sent and waits on its way is bounded by the delay; a page that takes nothing holds up
    who sends, as without this. Frames get a number of their own for each stream of this page, so
    that a page sees gaps exactly where something was lost.

    Attributes:
        out, back: the two directions.
    """

    def __init__(self, socket: Socket, conditions: Conditions, name: str) -> None:
        self.out, self.back = Way(conditions, f"{name}/out"), Way(conditions, f"{name}/back")
        self._socket = socket
        self._flight: deque[tuple[float, Data, int | None]] = deque()
        self._numbers: dict[tuple[int, int], int] = {}
        self._stirred, self._moved = asyncio.Event(), asyncio.Event()

    async def send_str(self, data: str, compress: int | None = None) -> None:
        """Send a text; `state` may be lost."""
        await self._send(data, "state" if data.startswith(_STATE) else "", compress)

    async def send_bytes(self, data: bytes, compress: int | None = None) -> None:
        """Send a frame, which may be lost."""
        key = data[0], data[1]
        number = self._numbers[key] = self._numbers.get(key, 0) + 1
        numbered = data[:4] + _SEQUENCE.pack(number & 0xFFFFFFFF) + data[8:]
        await self._send(numbered, f"{key[0]}/{key[1]}", compress)

    async def _send(self, data: Data, stream: str, compress: int | None) -> None:
        loop = asyncio.get_running_loop()
        size = len(data)
        if compress and self.out.limited:
            size = len(zlib.compress(data.encode() if isinstance(data, str) else data, 1))
        arrival = self.out.send(size, loop.time(), stream)
        if arrival is not None:
            self._flight.append((arrival, data, compress))
            self._stirred.set()
        await asyncio.sleep(max(0.0, self.out.free - loop.time()))
        while self._flight and self._flight[0][0] < loop.time() - 0.05:  # the page is behind
            self._moved.clear()
            await self._moved.wait()

    async def run(self) -> None:
        """Let things arrive, until the socket fails."""
        loop = asyncio.get_running_loop()
        while True:
            if not self._flight:
                self._stirred.clear()
                await self._stirred.wait()
            arrival, data, compress = self._flight[0]
            await asyncio.sleep(max(0.0, arrival - loop.time()))
            if isinstance(data, str):
                await self._socket.send_str(data, compress)
            else:
                await self._socket.send_bytes(data, compress)
            self._flight.popleft()
            self._moved.set()

    def hear(self, text: str, take: Callable[[str], None]) -> None:
        """Hand on a text of the page when it has arrived."""
        loop = asyncio.get_running_loop()
        arrival = self.back.send(len(text), loop.time())
        assert arrival is not None  # texts are never lost
        loop.call_at(arrival, take, text)
