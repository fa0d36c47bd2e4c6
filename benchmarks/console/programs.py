"""Pages that are programs: one that reads everything, drivers, a slow one, a hostile one."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import os
import random
import socket
import struct
import time
import zlib
from collections import Counter
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Any

import aiohttp

from benchmarks.console.arithmetic import Arrival
from benchmarks.console.gateway import Rig
from usarsim_bench.figures import BenchError
from usarsim_server.protocol.json_text import parse_json

PICTURE, POSES = 1, 4
"""Kinds of binary messages (docs/console-protocol.md)."""
PATIENCE = 30.0
DRIVE_EVERY = 0.25
"""s between two drives of a robot by a program; the gateway's watchdog stops it after 0.45 s."""
SLOW_RATE = 20_000
"""Bytes/s that a slow page reads."""
HOSTILE_RATE = 1_000_000
"""Bytes/s that a hostile page sends."""

Text = dict[str, Any]


def said(type: str, **fields: object) -> str:
    """A text as the page of the console writes it."""
    return json.dumps({"type": type, **fields}, separators=(",", ":"))


class PageProgram:
    """A page that reads all that comes.

    Attributes:
        id: of the page. state: the newest. counts: messages by kind, 0 for `state`, -1 for other
            texts. arrivals: of pictures. largest: bytes of the largest picture.
        generation: of the scene that poses are of; None before the first.
    """

    def __init__(self, ws: aiohttp.ClientWebSocketResponse, welcome: Text) -> None:
        self.id: int = welcome["page"]
        self.ws = ws
        self.state: Text = {}
        self.counts: Counter[int] = Counter()
        self.arrivals: list[Arrival] = []
        self.largest = 0
        self.generation: int | None = None
        self._answers: dict[int, asyncio.Future[Text]] = {}
        self._ids = itertools.count(1)
        self._stirred = asyncio.Event()

    async def read(self) -> None:
        """Take what comes until the gateway hangs up."""
        async for message in self.ws:
            if message.type is aiohttp.WSMsgType.BINARY:
                data = message.data
                self.counts[data[0]] += 1
                if data[0] == PICTURE:
                    sequence = struct.unpack_from("<I", data, 4)[0]
                    self.arrivals.append(Arrival(time.perf_counter(), data[1], sequence))
                    self.largest = max(self.largest, len(data))
                elif data[0] == POSES:
                    self.generation = struct.unpack_from("<I", data, 16)[0]
            elif message.type is aiohttp.WSMsgType.TEXT:
                self._hear(parse_json(message.data))

    def _hear(self, text: Text) -> None:
        self.counts[0 if text["type"] == "state" else -1] += 1
        if text["type"] == "state":
            self.state = text
            self._stirred.set()
        elif text["type"] == "answer" and (asked := self._answers.pop(text["id"], None)):
            asked.set_result(text)

    async def ping(self) -> None:
        """Beat as a page does."""
        while True:
            await self.say("ping", clock=0.0)
            await asyncio.sleep(1.0)

    async def say(self, type: str, **fields: object) -> None:
        """Say something that wants no answer."""
        await self.ws.send_str(said(type, **fields))

    async def ask(self, type: str, **fields: object) -> None:
        """Say something.

        Raises:
            BenchError: if the gateway refuses, or does not answer.
        """
        number = next(self._ids)
        future = self._answers[number] = asyncio.get_running_loop().create_future()
        await self.say(type, id=number, **fields)
        try:
            async with asyncio.timeout(PATIENCE):
                answer = await future
        except TimeoutError:
            raise BenchError(f"the gateway did not answer to {type}") from None
        if not answer["ok"]:
            raise BenchError(f"the gateway refused {type}: {answer['why']}")

    async def until(self, fits: Callable[[Text], object], what: str) -> None:
        """Read until a state fits.

        Raises:
            BenchError: if none does.
        """
        try:
            async with asyncio.timeout(PATIENCE):
                while not (self.state and fits(self.state)):
                    self._stirred.clear()
                    await self._stirred.wait()
        except TimeoutError:
            raise BenchError(f"the gateway never showed {what}") from None


@contextlib.asynccontextmanager
async def page(
    rig: Rig, role: str = "operator", *, pictures: bool = True, scans: bool = True
) -> AsyncIterator[PageProgram]:
    """A page that has said hello; without pictures and scans it has declined them."""
    tasks: list[asyncio.Task[None]] = []
    async with (
        aiohttp.ClientSession() as http,
        http.ws_connect(f"{rig.url}/socket", headers={"Origin": rig.url}, max_msg_size=0) as ws,
    ):
        await ws.send_str(said("hello", token=rig.tokens[role], name="program", clock=0.0))
        welcome = await ws.receive_json(timeout=PATIENCE)
        program = PageProgram(ws, welcome)
        tasks += [asyncio.create_task(program.read()), asyncio.create_task(program.ping())]
        try:
            for robot in rig.robots:
                if not pictures:
                    await program.say("camera", robot=robot, on=False)
                if not scans:
                    await program.say("laser", robot=robot, on=False)
                await asyncio.sleep(0.02)  # a page may say 200 texts a second
            yield program
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


@contextlib.asynccontextmanager
async def driving(rig: Rig, robots: Sequence[str], seed: int = 0) -> AsyncIterator[None]:
    """Drives robots around while it is open, by pages that look at nothing."""
    async with contextlib.AsyncExitStack() as stack:
        tasks = []
        # A page may drive 60 times a second.
        for first in range(0, len(robots), 8):
            driver = await stack.enter_async_context(page(rig, pictures=False, scans=False))
            mine = robots[first : first + 8]
            for robot in mine:
                await driver.ask("take", robot=robot)
            tasks.append(asyncio.create_task(_drive(driver, mine, random.Random(seed + first))))
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


async def _drive(driver: PageProgram, robots: Sequence[str], dice: random.Random) -> None:
    wishes = dict.fromkeys(robots, (0.5, 0.5))
    while True:
        for robot in robots:
            if dice.random() < 0.15:
                wishes[robot] = dice.uniform(-1.0, 1.0), dice.uniform(0.2, 1.0)
            left, right = wishes[robot]
            fields = {"left": round(left, 2), "right": round(right, 2), "device": "program"}
            await driver.say("drive", robot=robot, **fields)
            await asyncio.sleep(DRIVE_EVERY / len(robots))


@contextlib.asynccontextmanager
async def hostile_page(rig: Rig) -> AsyncIterator[None]:
    """Sends 1 MB/s of texts that make no sense, and comes back whenever it is shut out."""

    async def flood() -> None:
        block = "{" * 10_000
        while True:
            with contextlib.suppress(aiohttp.ClientError, OSError, BenchError):
                async with page(rig, pictures=False, scans=False) as program:
                    while not program.ws.closed:
                        await program.ws.send_str(block)
                        await asyncio.sleep(len(block) / HOSTILE_RATE)
            await asyncio.sleep(0.05)

    task = asyncio.create_task(flood())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class RawPage:
    """A page that reads as fast as it is told to: no library reads ahead.

    Attributes:
        states: moment at which each `state` was there, and its age then, s.
        received: bytes.
    """

    def __init__(self, rig: Rig, role: str) -> None:
        """Connect and say hello.

        Raises:
            OSError: if the gateway does not accept.
        """
        self.states: list[tuple[float, float]] = []
        self.received = 0
        self._held = bytearray()
        self._socket = socket.socket()
        # A small window: what the kernel holds, the page has not got.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self._socket.connect(("127.0.0.1", rig.port))
        self._socket.settimeout(PATIENCE)
        request = (
            f"GET /socket HTTP/1.1\r\nHost: 127.0.0.1:{rig.port}\r\nOrigin: {rig.url}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            # As browsers do; without memory between frames, which a program is spared.
            "Sec-WebSocket-Extensions: permessage-deflate; server_no_context_takeover\r\n\r\n"
        )
        self._socket.sendall(request.encode())
        while b"\r\n\r\n" not in self._held:
            if not (data := self._socket.recv(4096)):
                raise OSError("the gateway does not accept a page")
            self._held += data
        del self._held[: self._held.index(b"\r\n\r\n") + 4]
        self._socket.setblocking(False)
        self.say(said("hello", token=rig.tokens[role], name="slow", clock=0.0))

    def say(self, text: str) -> None:
        """Send a text of at most 125 bytes or a longer one, masked as pages do."""
        data, mask = text.encode(), os.urandom(4)
        head = (
            struct.pack("!BB", 0x81, 0x80 | len(data))
            if len(data) < 126
            else struct.pack("!BBH", 0x81, 0x80 | 126, len(data))
        )
        masked = bytes(byte ^ mask[place % 4] for place, byte in enumerate(data))
        self._socket.send(head + mask + masked)

    async def run(self, rate: float) -> None:
        """Read so many bytes/s, 0: nothing at all, and beat as a page does, until cancelled."""
        began = beat = time.perf_counter()
        taken = 0
        try:
            while True:
                now = time.perf_counter()
                if now >= beat:
                    beat = now + 1.0
                    self.say(said("ping", clock=0.0))
                due = int(rate * (now - began)) - taken
                if due > 0:
                    with contextlib.suppress(BlockingIOError):
                        data = self._socket.recv(min(due, 4096))
                        if not data:
                            return
                        taken += len(data)
                        self._take(data)
                await asyncio.sleep(0.02)
        except OSError:
            return  # shut out, which is the gateway's right

    def _take(self, data: bytes) -> None:
        self.received += len(data)
        self._held += data
        for payload in frames(self._held):
            if payload.startswith(b'{"type":"state"'):
                now = time.perf_counter()
                # The gateway's clock and ours are the same.
                self.states.append((now, now - float(parse_json(payload)["gateway_clock"])))

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def frames(held: bytearray) -> list[bytes]:
    """Take the payloads of whole frames of a server out of what has come."""
    found = []
    while len(held) >= 2:
        length, head = held[1] & 0x7F, 2
        if length >= 126:
            head = 4 if length == 126 else 10
            if len(held) < head:
                break
            length = int.from_bytes(held[2:head], "big")
        if len(held) < head + length:
            break
        payload = bytes(held[head : head + length])
        found.append(_inflated(payload) if held[0] & 0x40 else payload)
        del held[: head + length]
    return found


def _inflated(payload: bytes) -> bytes:
    return zlib.decompressobj(-15).decompress(payload + b"\x00\x00\xff\xff")


@contextlib.asynccontextmanager
async def raw_page(rig: Rig, role: str, rate: float) -> AsyncIterator[RawPage]:
    """A page that reads so many bytes/s; 0: a stalled one."""
    slow = RawPage(rig, role)
    task = asyncio.create_task(slow.run(rate))
    try:
        yield slow
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        slow.close()
