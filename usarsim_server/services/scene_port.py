"""The scene port: the live world for those who may see it (docs/scene-port.md).

A client says hello, subscribes to channels by it, and may ask requests afterwards. A channel makes
a subscription for each client, which hands over one frame at a time when the client is ready for
it, so nothing piles up behind who reads slowly; who reads nothing is cut off. Frames of the world
come from a `SceneFeed`, made once for everybody, and only while somebody subscribes.

Further channels and requests are entries of the two tables that the service is made with.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import socket
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from usarsim_server.protocol.scene import (
    LONGEST,
    VERSION,
    FrameReader,
    SceneError,
    message,
    read_hello,
    read_rate,
)
from usarsim_server.scene.channels import (
    Board,
    Channel,
    Poses,
    Request,
    Scene,
    SceneSource,
    Subscriber,
    Subscription,
)
from usarsim_server.services.limits import READ_COST
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.port import Guest, PortLimits, PortService
from usarsim_server.services.relay import both_ways

CHUNK = 4096
"""Bytes read at a time."""
PIECE = 64 * 1024
"""Bytes handed to the kernel at a time; each has to be taken within the patience."""
FAREWELL = 1.0
"""s of wall time for which a client that was refused may go on sending before it is cut off."""
FAREWELL_BYTES = 2 << 20
"""What it may send meanwhile."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneLimits(PortLimits):
    """What the clients of the scene port may use."""

    subscribers: int = 16  # clients that have said hello
    max_connections: int = 64  # they and those that have not
    receive_buffer: int | None = 8 * 1024
    send_buffer: int | None = 64 * 1024
    rate: float = 100.0
    hello: float = 10.0  # s of wall time within which a client has to say hello
    patience: float = 10.0  # s of wall time in which it has to take 64 KiB, or what there is

    @property
    def held_bytes(self) -> int:
        """Memory of a client's own, without the kernel's buffers: a message that is not whole yet,
        with what it is copied into, and one reply. Frames of the world belong to all."""
        return 3 * LONGEST + 2 * CHUNK


class ScenePort(PortService[SceneLimits]):
    """Shows the world on one port.

    Attributes:
        feed: what makes the frames.
    """

    def __init__(
        self,
        host: str,
        port: int,
        feed: SceneSource,
        world: str,
        token: str | None = None,
        *,
        channels: Mapping[str, Channel] | None = None,
        requests: Mapping[str, Request] | None = None,
        limits: SceneLimits | None = None,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            host: address or host name to listen on.
            port: 0 takes any free one.
            feed: makes the frames of the world.
            world: its name.
            token: what everybody has to know; None: nothing.
            channels, requests: further ones by name.
            limits: see there.
        """
        super().__init__("scene", host, port, "--scene-port", limits or SceneLimits(), True)
        self.feed, self._world, self._token = feed, world, token
        own: dict[str, Channel] = {
            "scene": lambda one: Scene(self._board, one),
            "poses": lambda one: Poses(self._board, one),
        }
        self._channels = {**own, **(channels or {})}
        self._requests: dict[str, Request] = {"rate": self._change_rate, **(requests or {})}
        self._board = Board(feed)

    async def start(self) -> Endpoint:
        """See `PortService.start`."""
        endpoint = await super().start()
        if self._token is None and not endpoint.loopback:
            self._log.warning("whoever reaches the scene port sees the true world (--scene-token)")
        return endpoint

    async def stop(self) -> None:
        """See `PortService.stop`."""
        await super().stop()
        self._board.close()

    async def _serve(self, client: socket.socket, peer: str) -> None:
        with self._guests.enter(peer) as guest:
            guest.unknown = True
            talk = _Conversation(client, peer, guest, self)
            try:
                await talk.run()
            except SceneError as error:
                self._log.info("refused", connection=peer, reason=error)
                await talk.part(str(error))

    def greet(self, fields: Mapping[str, object], peer: str) -> tuple[Subscriber, bytes]:
        """A new subscriber and what it is told.

        Raises:
            SceneError: if it has to go.
        """
        hello = read_hello(fields, self._channels)
        given = hello.token.encode("utf-8", "surrogatepass")
        if self._token is not None and not hmac.compare_digest(given, self._token.encode()):
            raise SceneError("the token is wrong")
        if self._guests.known >= self._limits.subscribers:
            raise SceneError(f"too many clients (at most {self._limits.subscribers})")
        welcome = {
            "type": "welcome",
            "version": VERSION,
            "world": self._world,
            "channels": hello.channels,
            "rate_hz": hello.rate_hz,
            "requests": sorted(self._requests),
        }
        return Subscriber(peer, hello), message(welcome)

    def subscribe(self, subscriber: Subscriber) -> Iterator[Subscription]:
        """What it asked for, in the order of the table: a pose comes after who it is of."""
        wanted = subscriber.hello.channels
        return (make(subscriber) for name, make in self._channels.items() if name in wanted)

    async def answer(self, subscriber: Subscriber, fields: Mapping[str, object]) -> bytes:
        """The reply to a request."""
        name, number = fields.get("request"), fields.get("id")
        head = {"type": "reply", "id": number if isinstance(number, int | str) else None}
        handler = self._requests.get(name) if isinstance(name, str) else None
        try:
            if handler is None:
                known = ", ".join(sorted(self._requests))
                raise SceneError(f'there is no request "{str(name)[:40]}" (known: {known})')
            return message({**head, "ok": True, **await handler(subscriber, fields)})
        except SceneError as error:
            return message({**head, "ok": False, "why": str(error)})

    async def _change_rate(
        self, subscriber: Subscriber, fields: Mapping[str, object]
    ) -> Mapping[str, object]:
        subscriber.rate_hz = read_rate(fields)
        self._board.set_rate()
        return {"rate_hz": subscriber.rate_hz}


class _Conversation:
    """One client."""

    def __init__(self, client: socket.socket, peer: str, guest: Guest, port: ScenePort) -> None:
        self._client, self._peer, self._guest, self._port = client, peer, guest, port
        self._loop = asyncio.get_running_loop()
        self._reader = FrameReader()
        self._messages: deque[dict[str, object]] = deque()
        self._allowance = port._rates.newcomer()
        self._limits = port._limits
        self._sending = asyncio.Lock()
        self._sent = True  # whole frames only

    async def run(self) -> None:
        """Talk until the client goes.

        Raises:
            SceneError: if it has to go.
            OSError: if it is lost.
        """
        try:
            async with asyncio.timeout(self._limits.hello):
                fields = await self._next()
        except TimeoutError:
            raise SceneError("no hello came in time") from None
        if fields is None:
            return
        subscriber, welcome = self._port.greet(fields, self._peer)
        # It may be silent from now on, and keeps its place.
        self._guest.standing, self._guest.unknown = lambda: True, False
        subscriptions = []
        with subscriber.leaving as stack:
            await self._send(welcome)
            for one in self._port.subscribe(subscriber):
                stack.callback(one.close)
                subscriptions.append(one)
            await both_ways(
                self._listen(subscriber),
                self._tell(subscriber, subscriptions),
                until=asyncio.FIRST_COMPLETED,
            )

    async def part(self, why: str) -> None:
        """Say why it has to go, unless within a frame, and see that it can read it."""
        if self._sent:
            await self._send(message({"type": "refused", "why": why}))
        # What is not read when a socket closes takes back what was sent.
        self._client.shutdown(socket.SHUT_WR)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(FAREWELL):
                left = FAREWELL_BYTES
                while left > 0:
                    data = await self._loop.sock_recv(self._client, PIECE)
                    if not data:
                        break
                    left -= len(data)
                    await asyncio.sleep(self._allowance.spend(READ_COST))

    async def _next(self) -> dict[str, object] | None:
        """The next message; None at the end."""
        while not self._messages:
            data = await self._loop.sock_recv(self._client, CHUNK)
            if not data:
                return None
            self._messages.extend(self._reader.feed(data))
            # `sock_recv` does not yield while there is data: let other clients have a turn.
            await asyncio.sleep(self._allowance.spend(READ_COST + len(self._messages)))
        return self._messages.popleft()

    async def _listen(self, subscriber: Subscriber) -> None:
        """Answer requests, one after the other: the next is read when the reply has been sent."""
        while (fields := await self._next()) is not None:
            await self._send(await self._port.answer(subscriber, fields))

    async def _tell(self, subscriber: Subscriber, subscriptions: list[Subscription]) -> None:
        while True:
            frame = next(filter(None, (one.take() for one in subscriptions)), None)
            if frame is None:
                await subscriber.news()
            else:
                await self._send(frame)

    async def _send(self, frame: bytes) -> None:
        """Hand a frame to the kernel; replies do not come between its pieces."""
        async with self._sending:
            self._sent = False
            for start in range(0, len(frame), PIECE):
                piece = memoryview(frame)[start : start + PIECE]
                try:
                    async with asyncio.timeout(self._limits.patience):
                        await self._loop.sock_sendall(self._client, piece)
                except TimeoutError:
                    raise ConnectionAbortedError("the client does not read") from None
                await asyncio.sleep(0)
            self._sent = True
