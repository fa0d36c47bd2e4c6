"""Services that speak only when they are asked: one request, one reply, in order.

Replies are worked out on threads of the service's own, because they may have to wait for the
physics. A client's next request is read only when its last reply has been handed to the kernel, so
nothing piles up here whatever a client sends or leaves unread, and nobody waits for anybody else.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

from usarsim_server.errors import UsarsimError
from usarsim_server.logs import Log
from usarsim_server.services.limits import InputRates, input_cost
from usarsim_server.services.listener import Endpoint, Listener, ListenerLimits

__all__ = ["DialogueLimits", "DialogueService", "Framer", "Respond"]

_CHUNK = 2048
"""Bytes read at a time: at most some hundred requests, whose replies are small."""
_WORKERS = 2
"""Threads that work out replies; so one client's hard question does not hold up the others."""


class Framer(Protocol):
    """Cuts the bytes of one connection into lines."""

    @property
    def discarded(self) -> int:
        """Number of lines thrown away because they were too long."""

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes and return the lines they complete, without terminators."""


Respond = Callable[[list[bytes]], bytes]
"""Makes the replies to lines that came together, line ends included; handed to the kernel at once.

Called on a worker thread, may block. May raise `UsarsimError` if there is nothing left to tell; the
connection ends then.
"""


@dataclass(frozen=True, slots=True)
class DialogueLimits:
    """What the clients of a dialogue may use.

    Attributes:
        max_connections: at the same time.
        kernel_buffer: bytes per client and direction, before the kernel doubles it.
        together: lines that came together may be answered together; otherwise one by one.
        pause: wall s between two replies to the same client, at the least.
        rate: requests per wall s of one client in the long run; it is read no faster.
    """

    max_connections: int = 64
    kernel_buffer: int = 256 * 1024
    together: bool = True
    pause: float = 0.0
    rate: float = 1000.0


class DialogueService:
    """Answers requests on one port."""

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        option: str,
        framer: Callable[[], Framer],
        respond: Respond,
        *,
        required: bool = False,
        limits: DialogueLimits | None = None,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            name: for the READY line and the log.
            host: address or host name to listen on.
            port: 0 takes any free one.
            option: command line option that sets the port.
            framer: makes the framer of a new connection.
            respond: see `Respond`.
            required: see `ready.Service`.
            limits: see `DialogueLimits`.
        """
        self.name = name
        self.required = required
        self._framer = framer
        self._respond = respond
        self._limits = limits or DialogueLimits()
        self._log = Log(name)
        self._rates = InputRates(self._limits.rate)
        self._executor: ThreadPoolExecutor | None = None
        self._listener = Listener(
            name,
            host,
            port,
            self._serve,
            option=option,
            limits=ListenerLimits(
                max_connections=self._limits.max_connections,
                receive_buffer=self._limits.kernel_buffer,
                send_buffer=self._limits.kernel_buffer,
            ),
        )

    @property
    def connections(self) -> int:
        """Number of clients connected."""
        return self._listener.connections

    async def start(self) -> Endpoint:
        """Open the port.

        Raises:
            ServiceError: if it cannot be opened.
        """
        endpoint = await self._listener.start()
        self._executor = ThreadPoolExecutor(_WORKERS, thread_name_prefix=self.name)
        return endpoint

    async def stop(self) -> None:
        """Close the port and every connection."""
        await self._listener.stop()
        if self._executor is not None:
            self._executor.shutdown(wait=False, cancel_futures=True)

    async def _serve(self, client: socket.socket, peer: str) -> None:
        log = self._log.bind(connection=peer)
        log.info("client connected")
        try:
            await self._converse(client, log)
        except UsarsimError as error:
            log.info(f"conversation ended: {error}")
        finally:
            log.info("client left")

    async def _converse(self, client: socket.socket, log: Log) -> None:
        loop = asyncio.get_running_loop()
        framer, discarded = self._framer(), 0
        allowance = self._rates.newcomer()
        while chunk := await loop.sock_recv(client, _CHUNK):
            lines = framer.feed(chunk)
            if framer.discarded != discarded:
                discarded = framer.discarded
                log.info("line discarded: too long")
            for batch in self._batches(lines):
                await self._reply(client, batch)
            # `sock_recv` does not yield while there is data: let other clients have a turn.
            await asyncio.sleep(self._rates.charge(allowance, input_cost(lines, len(lines))))

    def _batches(self, lines: list[bytes]) -> list[list[bytes]]:
        if self._limits.together:
            return [lines] if lines else []
        return [[line] for line in lines]

    async def _reply(self, client: socket.socket, lines: list[bytes]) -> None:
        loop = asyncio.get_running_loop()
        begun = loop.time()
        reply = await loop.run_in_executor(self._executor, self._respond, lines)
        if reply:
            await loop.sock_sendall(client, reply)
        if self._limits.pause:
            await asyncio.sleep(self._limits.pause - (loop.time() - begun))
