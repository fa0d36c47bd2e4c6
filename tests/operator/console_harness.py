"""A gateway in this process, and a page that is a program: what tests of the console share."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import aiohttp

from usarsim_operator.pulse import Pulse
from usarsim_operator.roles import Role
from usarsim_operator.station import Settings, Station
from usarsim_operator.web import Web
from usarsim_report.gate import gated
from usarsim_report.serving import hosts_of
from usarsim_server.testing import PATIENCE

Message = dict[str, Any]


class Gateway:
    """A running gateway."""

    def __init__(self, station: Station, pages: Web, port: int, http: aiohttp.ClientSession):
        self.station, self.web, self.port, self.http = station, pages, port, http

    @property
    def url(self) -> str:
        """Where it serves pages."""
        return f"http://127.0.0.1:{self.port}"

    @contextlib.asynccontextmanager
    async def page(
        self, name: str = "Ada", role: Role = Role.OPERATOR, *, pings: bool = True, **hello: object
    ) -> AsyncIterator[PageProgram]:
        """A page that has said hello."""
        headers = {"Origin": self.url}
        async with self.http.ws_connect(
            f"{self.url}/socket", headers=headers, max_msg_size=0
        ) as ws:
            token = self.web.tokens[role]
            await ws.send_json({"type": "hello", "token": token, "name": name, **hello})
            page = PageProgram(ws, await ws.receive_json(timeout=PATIENCE))
            tasks = [asyncio.create_task(page.read())]
            if pings:
                tasks.append(asyncio.create_task(page.ping()))
            try:
                yield page
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)


class PageProgram:
    """Reads everything, remembers the newest state, all events and binary messages.

    Attributes:
        said: every message as it came.
    """

    def __init__(self, ws: aiohttp.ClientWebSocketResponse, welcome: Message) -> None:
        self.ws, self.welcome = ws, welcome
        self.said: list[str | bytes] = []
        self.state: Message = {}
        self.texts: list[Message] = []
        self.binary: list[bytes] = []
        self.closed = False
        self._ids = itertools.count(1)
        self._stirred = asyncio.Event()

    async def read(self) -> None:
        async for message in self.ws:
            self.said.append(message.data)
            if message.type is aiohttp.WSMsgType.BINARY:
                self.binary.append(message.data)
            elif message.type is aiohttp.WSMsgType.TEXT:
                fields = message.json()
                if fields["type"] == "state":
                    self.state = fields
                else:
                    self.texts.append(fields)
            self._stirred.set()
        self.closed = True
        self._stirred.set()

    async def ping(self) -> None:
        while True:
            await self.ws.send_json({"type": "ping", "clock": 0.0})
            await asyncio.sleep(1.0)

    async def say(self, type: str, **fields: Any) -> None:
        """Say something that wants no answer."""
        await self.ws.send_json({"type": type, **fields})

    async def ask(self, type: str, **fields: Any) -> Message:
        """Say something; its answer."""
        number = next(self._ids)
        await self.say(type, id=number, **fields)
        return await self.text(lambda one: one["type"] == "answer" and one["id"] == number)

    async def text(self, fits: Callable[[Message], bool]) -> Message:
        """The first text that fits, also one that has come already."""
        await self.until(lambda: any(map(fits, self.texts)))
        return next(filter(fits, self.texts))

    async def until(self, done: Callable[[], object], patience: float = PATIENCE) -> None:
        """Read until something is so."""
        async with asyncio.timeout(patience):
            while not done():
                self._stirred.clear()
                await self._stirred.wait()

    def row(self, robot: str) -> Message | None:
        """A robot in the newest state."""
        return next((one for one in self.state.get("robots", ()) if one["name"] == robot), None)


@contextlib.asynccontextmanager
async def gateway(
    port: int, *, latch: Path | None = None, scene: int | None = None, **more: Any
) -> AsyncIterator[Gateway]:
    """Run a gateway for a server on this machine."""
    where = None if scene is None else ("127.0.0.1", scene)
    station = Station(Settings("127.0.0.1", port, scene=where, latch=latch, **more))
    async with contextlib.AsyncExitStack() as stack:
        stack.push_async_callback(station.close)
        await station.open()
        pages = Web(station)
        found = await stack.enter_async_context(gated(pages.app(), "127.0.0.1", 0))
        pages.hosts = hosts_of("127.0.0.1", found)
        pulse = asyncio.create_task(Pulse(station).run())
        try:
            async with aiohttp.ClientSession() as http:
                yield Gateway(station, pages, found, http)
            assert not pulse.done(), pulse
        finally:
            pulse.cancel()
            await asyncio.gather(pulse, return_exceptions=True)
