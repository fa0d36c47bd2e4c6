"""The image service: camera clients connect here, TCP 5003 (side channels reference 2).

Requests of one client are answered in order, each with the newest picture there is. Nothing of a
client is read while it is being answered, so what it asks for too early waits in TCP; a client
that does not read its picture is waited for, and costs the memory of that one picture. Pictures are
encoded in threads beside the event loop, each but once for however many clients ask for it. All of
it comes out of the port's share of the processor; copies of what a client has already, for which
nobody waits, out of a small part of that.

The service knows no camera and no renderer: pictures come from a `FrameSource`.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from usarsim_server.base.logs import Log
from usarsim_server.cameras.encoding import Encoder
from usarsim_server.cameras.view import Frame, FrameSource, Region
from usarsim_server.protocol.images import (
    FullFrame,
    Request,
    RequestLexer,
    empty_reply,
    raw_row_length,
)
from usarsim_server.services.budget import Account, WorkBudget, whole_share
from usarsim_server.services.idle_threads import IdleThreads
from usarsim_server.services.limits import READ_COST, InputRates
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.port import Guest, Guests, PortLimits, PortService
from usarsim_server.services.watch_list import FrameSignal, Repeats, WatchList

_CHUNK = 1024
"""Bytes read at a time: at most 512 requests of one client that wait outside the kernel."""
_REQUEST_BYTES, _REGION_BYTES = 100, 2000
"""Memory of a request that waits, and of a region that is looked at."""
SEND_COST = 0.5e-9
"""s of processor time for each byte of a picture on its way into the kernel."""
_ENCODERS = 2
"""Threads that encode; a picture of 1280 x 960 takes 3 ms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageLimits(PortLimits):
    """What the clients of the image port may use, and how long things take. Wall time.

    The original had no limit of connections; a client that stalls holds one picture. The share is
    that of encoding and sending pictures. Closed as idle is who never asked for a picture, or does
    not take the one it is sent; others may be silent, as somebody who presses a button now and
    then, and make room when the port is full.
    """

    send_buffer: int | None = 256 * 1024
    receive_buffer: int | None = 8 * 1024
    share: float = 0.2
    patience: float = 2.0
    """s that a request waits for the renderer; then it is answered with the latest frame that came
    meanwhile, or with a grey picture."""
    first_patience: float = 10.0
    """The same until there is a first picture, for which the renderer is opened."""
    linger: float = 2.0  # s for which a region is rendered on after it was asked for
    regions: int = 64
    """Regions rendered for one client at a time; as many as a grid has tiles at most."""
    repeat: float = 0.004
    """s between two copies of the same picture to the same client. One that asks again as soon as
    it can read would otherwise keep a core busy with pictures it has already."""
    type_lead: float = 0.5e-3
    """s between the type byte of a reply and the rest of it, at least.

    The original sent type, length and payload by three calls, and a client of UT2004 takes a
    receive of exactly one byte as the start of a picture; one that waits in `recv` wakes within
    0.1 ms."""
    copies_share: float = 0.05
    """s of processor time per wall s for copies of pictures that a client has."""

    def held_bytes(self, frame: Region) -> int:
        """Bytes that a connection can make the server hold, without the kernel's buffers: one
        picture, raw or of the worst JPEG, which is no longer; requests; regions it looks at."""
        picture = 16 + raw_row_length(frame.width) * frame.height
        return picture + _CHUNK + _CHUNK // 2 * _REQUEST_BYTES + self.regions * _REGION_BYTES


class ImageService(PortService[ImageLimits]):
    """Accepts image clients on one port."""

    def __init__(
        self,
        host: str,
        port: int,
        source: FrameSource,
        encoder: Encoder,
        *,
        legacy: bool = False,
        silent_push: float = 2.0,
        bound: Callable[[str], Region | None] | None = None,
        required: bool = False,
        limits: ImageLimits | None = None,
        pace: Callable[[], float] = whole_share,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            host, port, required, limits: see `PortService`.
            source: where pictures come from.
            encoder: makes replies of them.
            legacy: send every client a picture when it connects (side channels reference 2.8).
            silent_push: s after which a client that has sent nothing gets one picture; 0 for
                never. Clients of the original ImageSrv speak only after a picture, others only
                before (side channels reference 2.12).
            bound: the part of the frame that is the whole for a client, by its address without
                port; None for those who see all (side channels reference 2.11).
            pace: which part of its shares the service may use now.
        """
        super().__init__("images", host, port, "--image-port", limits or ImageLimits(), required)
        self._source = source
        self._encoder = encoder
        self._legacy = legacy
        self._silent_push = silent_push
        self._bound = bound or _sees_all
        self._pace = pace
        self._cache: _PictureCache | None = None

    async def start(self) -> Endpoint:
        self._cache = _PictureCache(
            self._source, self._encoder, self._limits, self._pace, self._guests, self._log
        )
        return await super().start()

    async def stop(self) -> None:
        await super().stop()
        if self._cache is not None:
            self._cache.close()

    async def _serve(self, client: socket.socket, peer: str) -> None:
        assert self._cache is not None, "clients come after start only"
        log = self._log.bind(connection=peer)
        host = client.getpeername()[0]
        log.info("client connected")
        with self._guests.enter(peer) as guest:
            conversation = _Conversation(
                client, self._cache, self._limits, self._rates, lambda: self._bound(host), guest
            )
            try:
                await conversation.run(self._legacy, self._silent_push)
            finally:
                conversation.watch_list.close()
                log.info("client left", pictures=conversation.sent)


class _PictureCache:
    """Hands out encoded pictures; all clients share it.

    Attributes:
        budget: for all pictures.
        copies: for pictures that a client has already; they need both.
        heard: told when a client was sent what it asked for.
    """

    def __init__(
        self,
        source: FrameSource,
        encoder: Encoder,
        limits: ImageLimits,
        pace: Callable[[], float],
        guests: Guests,
        log: Log,
    ) -> None:
        self.source = source
        self.signal = FrameSignal()
        self.budget = WorkBudget(limits.share, pace=pace)
        self.copies = WorkBudget(limits.copies_share, pace=pace)
        self.heard = guests.heard
        self._encoder = encoder
        self._patience, self._first_patience = limits.patience, limits.first_patience
        self._drawn = False  # whether the renderer has shown anything
        self._log = log
        self._loop = asyncio.get_running_loop()
        self._threads = IdleThreads("image-encoder", _ENCODERS)
        self._under_way: dict[tuple[int, Region], asyncio.Future[tuple[memoryview, float]]] = {}
        self._complained = False

    def close(self) -> None:
        """Let the threads end; nobody may ask any more."""
        self._threads.close()

    def empty(self) -> bytes:
        """The answer to a rectangle outside the frame."""
        return empty_reply(self._encoder.image_type)

    @property
    def type_byte(self) -> bytes:
        """The first byte of all replies."""
        return bytes([self._encoder.image_type.byte])

    async def frame(self, region: Region) -> Frame | None:
        """The newest frame in which a region is up to date.

        If it takes too long: the latest frame that came meanwhile, None if none did.
        """
        patience = self._patience if self._drawn else self._first_patience
        deadline = self._loop.time() + patience
        latest: Frame | None = None
        while True:
            news = self.signal.next()
            frame = self.source.newest(region)
            if frame is not None:
                self._complained = False
                self._drawn |= frame.number > 0
                return frame
            done, _ = await asyncio.wait({news}, timeout=deadline - self._loop.time())
            if not done:
                self._complain()
                return latest
            latest = news.result()

    async def picture(self, frame: Frame | None, region: Region, account: Account) -> memoryview:
        """The reply for a region of a frame; a grey one for None. Who asks first pays for it."""
        if frame is None:
            grey = partial(self._encoder.grey, region)
            message, cost = await self._threads.run(_timed, grey)
            self.budget.charge(account, cost)
            return message
        found = self._encoder.found(frame, region)
        if found is not None:
            return found
        key = frame.number, region
        work = self._under_way.get(key)
        if work is None:
            encode = partial(self._encoder.encode, frame, region)
            work = self._threads.run(_timed, encode)
            self._under_way[key] = work
            work.add_done_callback(lambda done: self._finished(key, done, account))
        # Others may wait for the same picture when this client goes.
        made, _ = await asyncio.shield(work)
        return made

    def _finished(
        self,
        key: tuple[int, Region],
        work: asyncio.Future[tuple[memoryview, float]],
        account: Account,
    ) -> None:
        self._under_way.pop(key, None)
        # A failure has been seen even if no client is left to see it.
        if not work.cancelled() and work.exception() is None:
            self.budget.charge(account, work.result()[1])

    def _complain(self) -> None:
        if not self._complained:
            self._log.warning("the renderer is late: a client got an old or grey picture")
        self._complained = True


class _Conversation:
    """One client: its requests and what it looks at.

    Attributes:
        watch_list: what the client looks at.
        sent: number of pictures it got.
    """

    def __init__(
        self,
        client: socket.socket,
        cache: _PictureCache,
        limits: ImageLimits,
        rates: InputRates,
        bound: Callable[[], Region | None],
        guest: Guest,
    ) -> None:
        self._guest = guest
        self._account = cache.budget.newcomer()
        self._copies = cache.copies.newcomer()
        self._client = client
        self._cache = cache
        self._limits = limits
        self._rates = rates
        self._bound = bound
        self._loop = asyncio.get_running_loop()
        self.watch_list = WatchList(cache.source, cache.signal, limits.linger, limits.regions)
        self.sent = 0
        self._repeats = Repeats(limits.repeat, limits.regions)

    async def run(self, legacy: bool, silent_push: float) -> None:
        """Answer requests until the client closes; `OSError` if it is lost."""
        lexer, allowance = RequestLexer(), self._rates.newcomer()
        if legacy:
            await self._answer(FullFrame())
        data = await (self._receive() if legacy else self._first(silent_push))
        while data:
            requests = lexer.feed(data)
            for request in requests:
                await self._answer(request)
                # A person may press a button once an hour; the original knew no idle clients.
                self._guest.patient = True
                self._cache.heard(self._guest)
            # `sock_recv` does not yield while there is data: let other clients have a turn.
            await asyncio.sleep(allowance.spend(READ_COST + len(requests)))
            data = await self._receive()

    async def _receive(self) -> bytes:
        return await self._loop.sock_recv(self._client, _CHUNK)

    async def _first(self, silent_push: float) -> bytes:
        """The first bytes; a client that takes its time gets a picture meanwhile."""
        # Not a timeout on the reading itself, which could lose bytes that come that moment.
        reading = asyncio.ensure_future(self._receive())
        try:
            if silent_push > 0.0:
                done, _ = await asyncio.wait({reading}, timeout=silent_push)
                if not done:
                    await self._answer(FullFrame())
            return await reading
        finally:
            reading.cancel()

    async def _answer(self, request: Request) -> None:
        await self._cache.budget.turn(self._account)
        region = self._region(request)
        if region is None:
            empty = memoryview(self._cache.empty())
            await self._send(empty, await self._lead())
            return
        self.watch_list.turn_to(region)
        frame = await self._cache.frame(region)
        if frame is not None and self._repeats.has(frame, region):
            await self._cache.copies.turn(self._copies)
            await asyncio.sleep(self._repeats.pause(frame, region, self._loop.time()))
            frame = await self._cache.frame(region)
        copy = frame is not None and self._repeats.has(frame, region)
        if frame is not None:
            self._repeats.note(frame, region, self._loop.time())
        led = await self._lead()
        # From here on the frame itself is not needed: a client that stalls holds one picture.
        message = await self._cache.picture(frame, region, self._account)
        del frame
        self._cache.budget.charge(self._account, len(message) * SEND_COST)
        if copy:
            self._cache.copies.charge(self._copies, len(message) * SEND_COST)
        await self._send(message, led)

    def _region(self, request: Request) -> Region | None:
        """The part of the full frame that is meant; None if there is no such part."""
        view = self._bound() or self._cache.source.grid.frame
        if isinstance(request, FullFrame):
            return view
        part = Region(request.x, request.y, request.width, request.height)
        if not part.inside(view.width, view.height):
            return None
        return Region(view.x + part.x, view.y + part.y, part.width, part.height)

    async def _lead(self) -> float:
        """Send the type byte by a call of its own; returns the loop's time after that."""
        await self._put(self._cache.type_byte)
        return self._loop.time()

    async def _send(self, message: memoryview, led: float) -> None:
        """Send what follows the type byte of a reply, `type_lead` after it at the earliest.

        Args:
            message: the whole reply.
            led: when the type byte was sent, see `_lead`.
        """
        await asyncio.sleep(led + self._limits.type_lead - self._loop.time())
        await self._put(message[1:])
        self.sent += 1

    async def _put(self, data: memoryview | bytes) -> None:
        """Send bytes; returns when the kernel has all of them.

        Raises:
            ConnectionAbortedError: the client does not read.
        """
        try:
            async with asyncio.timeout(self._limits.idle or None):
                await self._loop.sock_sendall(self._client, data)
        except TimeoutError:
            raise ConnectionAbortedError("the client does not take its picture") from None


def _timed(make: Callable[[], memoryview]) -> tuple[memoryview, float]:
    """What is made, and s of processor time that it took; on an encoder's thread."""
    begun = time.thread_time()
    made = make()
    return made, time.thread_time() - begun


def _sees_all(address: str) -> Region | None:
    """Nobody's view is bound."""
    return None
