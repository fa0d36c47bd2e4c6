"""Pictures of the image port, as fast as somebody looks at them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from typing import Self

from usarsim_client.connection import AsyncClosing, Connection
from usarsim_client.inbox import HangupError, ProtocolError
from usarsim_client.link import Address, Retry
from usarsim_client.pictures import FULL_FRAME, Picture, rectangle

Tile = tuple[int, int, int, int]
"""x, y, width, height of a part of the full picture, pixels."""


class Pictures(AsyncClosing):
    """`async for picture in robot.pictures()`: asks for a picture when one is wanted.

    So each is the newest that the server has, and none waits anywhere. It connects when the first
    is asked for; `close`, the end of `async with`, or the end of its life hang up.
    """

    def __init__(
        self,
        address: Address,
        tile: Callable[[], Awaitable[Tile | None]],
        rate: float,
        retry: Retry | None = None,
    ) -> None:
        """Look at a server.

        Args:
            address: of its image port.
            tile: finds the part of the picture, or None for all of it; asked at each connection.
            rate: pictures per s of wall time at most; 0: as fast as they come.
            retry: how a lost connection is made again; None: not at all.
        """
        self._address = address
        self._tile = tile
        self._request = FULL_FRAME
        self._period = 1.0 / rate if rate > 0.0 else 0.0
        self._due = 0.0
        self._retry = retry
        self._connection: Connection | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closed = False

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Picture:
        """The newest picture; empty if the server has none of this part.

        Raises:
            HangupError: if the server hangs up.
            TimeoutError: if it does not answer.
            ProtocolError: if it answers with what is no picture.
        """
        await self._wait()
        tries = 0
        while not self._closed:
            try:
                return await self._look()
            except (OSError, ProtocolError) as error:
                self._hang_up()  # what comes late is no answer to the next request
                if self._closed:
                    break
                lost = isinstance(error, OSError | HangupError)
                if not lost or self._retry is None or not await self._retry.pause(tries):
                    raise
                tries += 1
        raise StopAsyncIteration

    async def _look(self) -> Picture:
        if self._connection is None:
            tile = await self._tile()
            self._request = FULL_FRAME if tile is None else rectangle(*tile)
            self._loop = asyncio.get_running_loop()
            self._connection = await self._address.open()
        async with self._address.patience("no picture"):
            await self._connection.send(self._request)
            return await self._connection.picture()

    async def _wait(self) -> None:
        """Until the next picture may be asked for."""
        if self._period:
            now = asyncio.get_running_loop().time()
            await asyncio.sleep(max(self._due - now, 0.0))
            self._due = max(self._due, now) + self._period

    async def close(self) -> None:
        """Hang up; who waits for a picture is told that there will be none."""
        self._closed = True
        self._hang_up()

    def _hang_up(self) -> None:
        if self._connection is not None:
            self._connection.abort()
        self._connection = None

    def __del__(self) -> None:
        if self._connection is not None and self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop may be closed, with all in it
                self._loop.call_soon_threadsafe(self._connection.abort)
