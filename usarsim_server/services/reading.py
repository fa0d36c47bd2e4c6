"""From a socket: chunk after chunk, of which the event loop is told once.

The loop's own `sock_recv` has the kernel watch the socket and not watch it any more for every chunk
that is waited for, which costs more than to read one. Here it is watched until something comes that
nobody waits for.
"""

from __future__ import annotations

import asyncio
import socket


class ChunkReader:
    """Reads from one socket that does not block, for one task of the running event loop."""

    def __init__(self, client: socket.socket) -> None:
        """Watch nothing yet."""
        self._client = client
        self._loop = asyncio.get_running_loop()
        self._watched = False
        self._size = 0
        self._awaited: asyncio.Future[bytes] | None = None

    async def receive(self, size: int) -> bytes:
        """What came next, at most so many bytes; nothing once the other side has closed. Does not
        yield if it is there already.

        Raises:
            OSError: if the connection is lost.
        """
        try:
            return self._client.recv(size)
        except (BlockingIOError, InterruptedError):
            pass
        self._size, self._awaited = size, self._loop.create_future()
        if not self._watched:
            self._loop.add_reader(self._client, self._read)
            self._watched = True
        return await self._awaited

    def close(self) -> None:
        """Watch the socket no more, which must not be closed before; a second call does nothing."""
        if self._watched:
            self._loop.remove_reader(self._client)
            self._watched = False

    def _read(self) -> None:
        awaited = self._awaited
        if awaited is None or awaited.done():  # nobody waits for it: TCP pushes back
            self.close()
            return
        try:
            awaited.set_result(self._client.recv(self._size))
        except (BlockingIOError, InterruptedError):
            pass
        except OSError as error:
            awaited.set_exception(error)
