"""The proxy between controllers and a server, which writes down what it passes on."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial

from usarsim_client.connection import Connection
from usarsim_record.recording import (
    CLIENT,
    DATA,
    END,
    OPEN,
    REFUSED,
    RESET,
    SERVER,
    Link,
    RecordError,
    Writer,
)

_CONNECTS = 60.0
"""s of wall time until a server that neither accepts nor refuses counts as absent."""


class Proxy:
    """Listens on one port per link; every connection gets one of its own to the server.

    What one side sends is written down and passed on unchanged before more is read from it, so a
    side that does not read slows the other one down, as it would without the proxy. End of file
    and resets are passed on as well.

    Attributes:
        failed: set to the error if the recording could not be written any further.
    """

    def __init__(self, links: Sequence[Link], writer: Writer, host: str = "127.0.0.1") -> None:
        self._links = tuple(links)
        self._writer = writer
        self._host = host
        self._servers: list[asyncio.Server] = []
        self._busy: set[asyncio.Task[None]] = set()
        self._count = 0
        self.failed: asyncio.Future[OSError] = asyncio.get_running_loop().create_future()

    async def start(self) -> list[int]:
        """Listen; returns the ports, which differ from the links' where those are 0.

        Raises:
            RecordError: if a port is taken.
        """
        for index, link in enumerate(self._links):
            try:
                server = await asyncio.start_server(
                    partial(self._serve, index), self._host, link.listen
                )
            except OSError as error:
                await self.stop()
                raise RecordError(
                    f"cannot listen on {self._host}:{link.listen}: {error.strerror or error} "
                    "(name a free port)"
                ) from None
            self._servers.append(server)
        return [int(server.sockets[0].getsockname()[1]) for server in self._servers]

    async def stop(self) -> None:
        """Stop listening and end all connections."""
        for server in self._servers:
            server.close()
        for task in tuple(self._busy):
            task.cancel()
        await asyncio.gather(*self._busy, return_exceptions=True)

    async def _serve(
        self, index: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._busy.add(task)
        task.add_done_callback(self._busy.discard)
        self._count += 1
        number = self._count
        try:
            self._note(number, OPEN, link=index)
            await self._connect(number, self._links[index], Connection(reader, writer))
        except asyncio.CancelledError:
            pass  # the proxy stops
        finally:
            writer.close()

    async def _connect(self, number: int, link: Link, client: Connection) -> None:
        try:
            async with asyncio.timeout(_CONNECTS):
                server = await Connection.open(link.host, link.port)
        except (OSError, TimeoutError):
            self._note(number, REFUSED, SERVER)
            return
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._pump(number, CLIENT, client, server))
                group.create_task(self._pump(number, SERVER, server, client))
        finally:
            server.close()

    async def _pump(self, number: int, side: str, one: Connection, other: Connection) -> None:
        """Pass on what one side sends, until it ends, or until nobody is there to read it."""
        while True:
            try:
                data = await one.receive()
            except OSError:
                self._note(number, RESET, side)
                other.abort()
                return
            if not data:
                break
            self._note(number, DATA, side, data)
            try:
                await other.send(data)
            except OSError:
                # The other side is gone, which its own pump notes; this one has to learn of it.
                one.abort()
                return
        self._note(number, END, side)
        other.half_close()

    def _note(
        self, number: int, kind: str, side: str = CLIENT, data: bytes = b"", link: int = 0
    ) -> None:
        if self.failed.done():
            return
        try:
            self._writer.add(number, kind, side, data, link)
        except OSError as error:
            self.failed.set_result(error)
