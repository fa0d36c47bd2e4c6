"""Between a healthy server and the kit: a proxy that makes one fault out of what passes through it.

A fault that shows in the bytes of a connection needs no server of its own. `Link` passes on what
both sides say; what overrides it says a line otherwise, drops a command, or hangs up. A proxy
stands before each service that the fault concerns, and before ports that are told on the way.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from functools import partial
from typing import Any

_CHUNK = 65536
_HEADER = 5
"""Bytes before the payload of a picture: its type and a big-endian length."""
_BETWEEN = 0.02
"""s of wall time between two pieces of what should come in one."""


class Link:
    """One connection of the kit, passed on unchanged; faults override what they change.

    Attributes:
        service: that it goes to; empty for a port that was told on the way.
        memory: what all connections of the fault share.
        proxy: that it belongs to.
        asked: whether the kit has sent something.
        hangs_up: set to end the connection.
    """

    most: int | None = None
    """Connections served at a time; further ones are hung up."""
    keeps_server: bool = False
    """Whether the server does not get to know that the kit has hung up."""
    keeps_kit: bool = False
    """Whether the kit does not get to know that the server has hung up."""
    ignores_eof: bool = False
    """Whether the server does not get to know that the kit has ended its half."""
    minds_eof: bool = False
    """Whether end of file from the kit ends the connection at once."""

    def __init__(self, service: str, proxy: Proxy) -> None:
        self.service = service
        self.memory = proxy.memory
        self.proxy = proxy
        self.asked = False
        self.hangs_up = False
        self._writers: tuple[asyncio.StreamWriter, asyncio.StreamWriter] | None = None

    def begin(self) -> None:
        """The connection is there."""

    def said(self, unit: bytes) -> bytes:
        """What the kit gets in the place of a line of the server, a message, a picture."""
        return unit

    def heard(self, data: bytes) -> bytes:
        """What the server gets in the place of what the kit has sent in one piece."""
        return data

    def pieces(self, data: bytes) -> list[bytes]:
        """What the kit gets, in pieces a moment apart."""
        return [data]

    def ended(self, reset: bool) -> None:
        """The kit has hung up, or reset the connection."""

    def say(self, data: bytes, after: float = 0.0) -> None:
        """Tell the kit something that the server has not said.

        Args:
            data: what is said.
            after: s of wall time; nothing is said to who has asked for something by then.
        """
        self._later(after, lambda kit, _: None if after and self.asked else kit.write(data))

    def ask(self, data: bytes) -> None:
        """Ask the server something that the kit has not said."""
        self._later(0.0, lambda kit, server: server.write(data))

    def leave(self, after: float) -> None:
        """Hang up on the kit after some s of wall time."""
        self._later(after, lambda kit, server: kit.close())

    def die(self) -> None:
        """End the whole server: all connections, for good."""
        self.memory["dead"] = True

    def bind(self, kit: asyncio.StreamWriter, server: asyncio.StreamWriter) -> None:
        """Take the ways to both ends."""
        self._writers = kit, server

    def _later(
        self, after: float, act: Callable[[asyncio.StreamWriter, asyncio.StreamWriter], None]
    ) -> None:
        assert self._writers is not None
        if after:
            asyncio.get_running_loop().call_later(after, act, *self._writers)
        else:
            act(*self._writers)


LinkKind = Callable[[str, "Proxy"], Link]
"""Makes the link of a connection out of its service and its proxy."""


@contextlib.asynccontextmanager
async def proxied(
    kind: LinkKind, ports: Mapping[str, int], services: tuple[str, ...]
) -> AsyncIterator[dict[str, int]]:
    """Ports of a faulty server while inside: those of a healthy one, some behind a proxy.

    Args:
        kind: makes the link of a connection.
        ports: of the healthy server, by service.
        services: that get a proxy.
    """
    proxy = Proxy()
    try:
        yield {**ports, **{name: proxy.road(ports[name], kind, name) for name in services}}
    finally:
        await proxy.close()


class Proxy:
    """All connections of one fault.

    Attributes:
        memory: what they share.
    """

    def __init__(self) -> None:
        self.memory: dict[str, Any] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._open: list[asyncio.StreamWriter] = []
        self._kept: list[asyncio.StreamWriter] = []
        self._served: dict[str, int] = {}
        self._roads: dict[int, int] = {}

    def road(self, port: int, kind: LinkKind, service: str = "") -> int:
        """A port that leads to another one by links; the same for the same port.

        Args:
            port: where it leads.
            kind: makes the link of a connection.
            service: that listens there; by default bytes are passed on as they come.
        """
        if port not in self._roads:
            sock = socket.create_server(("127.0.0.1", 0))
            self._roads[port] = sock.getsockname()[1]
            self._keep(asyncio.create_task(self._listen(kind, service, port, sock)))
        return self._roads[port]

    def _keep(self, task: asyncio.Task[None]) -> None:
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _listen(self, kind: LinkKind, service: str, port: int, sock: socket.socket) -> None:
        server = await asyncio.start_server(partial(self._serve, kind, service, port), sock=sock)
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            server.close()

    async def close(self) -> None:
        """Hang up everywhere."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for writer in (*self._open, *self._kept):
            writer.close()

    async def _serve(
        self,
        kind: LinkKind,
        service: str,
        port: int,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._keep(task)
        self._open.append(writer)
        link = kind(service, self)
        served = self._served.setdefault(service, 0)
        if self.memory.get("dead") or (link.most is not None and served >= link.most):
            writer.close()
            return
        self._served[service] += 1
        with contextlib.suppress(OSError, asyncio.CancelledError):
            await self._pass_on(link, port, reader, writer)
        self._served[service] -= 1
        if self.memory.get("dead"):
            for one in self._open:
                one.close()

    async def _pass_on(
        self, link: Link, port: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        try:
            there, back = await asyncio.open_connection("127.0.0.1", port)
        except OSError:
            writer.close()
            return
        (self._kept if link.keeps_server else self._open).append(back)
        link.bind(writer, back)
        link.begin()
        answers = asyncio.create_task(self._answers(link, there, writer))
        try:
            await self._requests(link, reader, back)
            if link.minds_eof or link.hangs_up or self.memory.get("dead"):
                writer.close()
            elif not link.keeps_server:
                if not link.ignores_eof:
                    back.write_eof()
                await answers
        finally:
            answers.cancel()
            if not link.keeps_server:
                back.close()
            writer.close()

    async def _requests(
        self, link: Link, reader: asyncio.StreamReader, back: asyncio.StreamWriter
    ) -> None:
        reset = False
        try:
            while not link.hangs_up and (data := await reader.read(_CHUNK)):
                link.asked = True
                data = link.heard(data)
                if self.memory.get("dead"):
                    return
                back.write(data)
                await back.drain()
        except ConnectionError:
            reset = True
        link.ended(reset)

    async def _answers(
        self, link: Link, there: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        held = b""
        with contextlib.suppress(OSError):
            while data := await there.read(_CHUNK):
                units, held = _units(held + data, link.service)
                first, *others = link.pieces(b"".join(map(link.said, units)))
                writer.write(first)
                for piece in others:
                    await asyncio.sleep(_BETWEEN)
                    writer.write(piece)
                await writer.drain()
                if link.hangs_up:
                    break
        if not link.keeps_kit:
            writer.close()


def _units(data: bytes, service: str) -> tuple[list[bytes], bytes]:
    """Whole lines, messages or pictures, and the rest; what comes on a road is passed on."""
    if not service:
        return [data], b""
    if service != "images":
        end = b";" if service == "comserver" else b"\n"
        *parts, rest = data.split(end)
        return [part + end for part in parts], rest
    found = []
    while len(data) >= _HEADER:
        length = _HEADER + int.from_bytes(data[1:_HEADER])
        if len(data) < length:
            break
        found.append(data[:length])
        data = data[length:]
    return found, data
