"""Towards a socket: replies of a port that only answers, and calls from other threads."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections import deque
from collections.abc import Callable

PIECE = 16 * 1024
"""Bytes of replies that are joined before they are sent."""
UNREAD = 60.0
"""Seconds that a client may leave a piece of replies unread before its connection ends."""


class ReplyBuffer:
    """The replies to one client on their way into the kernel, for one task.

    A port makes one for each connection, puts every reply into it as soon as it is worked out, and
    flushes it before it waits for further requests:

        for line in framer.feed(chunk):
            await replies.put(await self._answer(line))
        await replies.flush()

    Replies to requests that came together leave together, in pieces. Whoever works out replies
    waits in `put` while the client does not read, so that the memory of a connection is bounded by
    a piece and the longest single reply, however many requests a chunk holds. A client that reads
    nothing of a piece for `patience` is given up: `ConnectionAbortedError`, which a `Listener`
    takes for the end of the connection.
    """

    def __init__(self, client: socket.socket, patience: float = UNREAD) -> None:
        """Make an empty buffer.

        Args:
            client: a non-blocking socket.
            patience: s that a piece may wait for the client to read.
        """
        self._client = client
        self._patience = patience
        self._held = bytearray()

    @property
    def held(self) -> int:
        """Bytes that are not yet handed to the kernel."""
        return len(self._held)

    async def put(self, reply: bytes) -> None:
        """Add a whole reply, line end included; an empty one is nothing to send.

        Raises:
            OSError: if the client has gone, or does not read.
        """
        self._held += reply
        if len(self._held) >= PIECE:
            await self.flush()

    async def flush(self) -> None:
        """Hand everything to the kernel, which may mean to wait for the client.

        Raises:
            OSError: if the client has gone, or does not read.
        """
        if not self._held:
            return
        data, self._held = self._held, bytearray()
        try:
            async with asyncio.timeout(self._patience):
                await asyncio.get_running_loop().sock_sendall(self._client, data)
        except TimeoutError:
            raise ConnectionAbortedError("the client does not read its replies") from None


class LoopCalls:
    """Runs callbacks on an event loop, in the order in which they come from any thread.

    Waking the loop costs a system call and a fight for the interpreter; calls that come before it
    has woken share one.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: deque[Callable[[], None]] = deque()
        self._rung = False

    def __call__(self, callback: Callable[[], None]) -> None:
        """Have a callback run soon; dropped if the loop has ended. Any thread."""
        self._waiting.append(callback)
        if not self._rung:
            self._rung = True
            # A robot may still speak while the loop is being closed at the end of the process.
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._answer)

    def _answer(self) -> None:
        # Before the look: what comes during it rings again.
        self._rung = False
        for _ in range(len(self._waiting)):
            self._waiting.popleft()()
