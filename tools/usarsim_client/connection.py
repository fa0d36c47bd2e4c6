"""One TCP connection to any service of a server, in an event loop."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
from functools import partial
from typing import Self

from usarsim_client.inbox import HangupError, Inbox, Line, Read, Take, Wanted
from usarsim_client.pictures import Picture, picture
from usarsim_server.base.addresses import bare_host

CHUNK = 65536
"""Bytes taken from the socket at once, at most; a read of so many was cut here, not by the
server."""
LITTLE = 4096
"""Bytes that a connection buffers that shall stop a server which it does not read."""


class AsyncClosing:
    """Something that is closed at the end of an `async with` block."""

    async def close(self) -> None:
        """End it."""
        raise NotImplementedError

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


class Connection:
    """A connection; time limits are the caller's, by `asyncio.timeout`.

    Attributes:
        inbox: what has come and was not read yet.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.inbox = Inbox()
        self._reader = reader
        self._writer = writer
        no_delay(writer)

    @classmethod
    async def open(cls, host: str, port: int, *, little: bool = False) -> Self:
        """Connect.

        Args:
            host: address of the server.
            port: of one of its services.
            little: take little in advance, so that a client that does not read stops the server.

        Raises:
            OSError: if nobody accepts.
        """
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(bare_host(host), port, type=socket.SOCK_STREAM)
        kind, *_, address = found[0]
        sock = socket.socket(kind, socket.SOCK_STREAM)
        try:
            sock.setblocking(False)
            if little:  # the buffer can be made smaller only before it connects
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, LITTLE)
            await loop.sock_connect(sock, address)
            return cls(*await asyncio.open_connection(sock=sock, limit=LITTLE if little else CHUNK))
        except BaseException:
            sock.close()
            raise

    @property
    def address(self) -> tuple[str, int]:
        """Our end: address, where the server can reach it, and port."""
        host, port, *_ = self._writer.get_extra_info("sockname")
        return host, port

    @property
    def peer_port(self) -> int:
        """Port of the other end."""
        return int(self._writer.get_extra_info("peername")[1])

    async def send(self, data: bytes) -> None:
        """Send bytes; `OSError` if the connection is gone."""
        self._writer.write(data)
        await self._writer.drain()

    async def receive(self) -> bytes:
        """Whatever comes next, past the inbox; nothing at the end; `OSError` after a reset."""
        return await self._reader.read(CHUNK)

    async def take(self, take: Take[Read]) -> Read:
        """What a method of `Inbox` takes, as soon as it is there.

        Raises:
            HangupError: if the connection ends before.
        """
        while (found := take(self.inbox)) is None:
            data = await self.receive()
            if not data:
                raise HangupError("the server closed the connection")
            self.inbox.feed(data)
        return found

    async def line(self, wanted: Wanted = "") -> Line:
        """The next line that is wanted; others are passed over."""
        while not (line := await self.take(Inbox.line)).fits(wanted):
            pass
        return line

    async def ask(self, request: bytes, wanted: Wanted = "") -> Line:
        """Send bytes and read the next line that is wanted."""
        await self.send(request)
        return await self.line(wanted)

    async def exactly(self, count: int) -> bytes:
        """So many bytes."""
        return await self.take(partial(Inbox.exactly, count=count))

    async def picture(self) -> Picture:
        """The next reply of the image stream."""
        return await self.take(picture)

    def half_close(self) -> None:
        """Send end of file and go on reading."""
        with contextlib.suppress(OSError, RuntimeError):
            self._writer.write_eof()

    def reset(self) -> None:
        """Break the connection with a reset."""
        sock = self._writer.get_extra_info("socket")
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.abort()

    def abort(self) -> None:
        """Hang up at once, whatever was not sent yet."""
        self._writer.transport.abort()

    @property
    def closing(self) -> bool:
        """Whether this end has hung up."""
        return self._writer.is_closing()

    def close(self) -> None:
        """Hang up."""
        self._writer.close()


def no_delay(writer: asyncio.StreamWriter) -> None:
    """Send what is written at once."""
    sock = writer.get_extra_info("socket")
    if sock is not None:
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
