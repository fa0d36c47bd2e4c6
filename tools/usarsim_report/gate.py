"""Bounds what connections to a web server of this project may cost before they are trusted.

A connection is a newcomer's until its page has said by a token who it is (`admit`). Newcomers have
so many places; the next one takes the place of another, of the address that holds most, so that
one machine alone cannot keep others out. They must say what they want within some seconds and take
what they are answered within a minute, and all their requests together get a share of one
processor. Pages that have been admitted are bounded by `PagePlaces`.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import ipaddress
import logging
import socket
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.typedefs import Handler, Middleware

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.base.token_bucket import TokenBucket

try:
    import resource
except ImportError:  # not on Windows, where descriptors are no matter
    resource = None  # type: ignore[assignment]

_SCARCE = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOBUFS})
_SCARCE_PAUSE = 0.1
_LOST_PAUSE = 0.01
LOG_RATE = 1.0
"""Lines of the log a second about newcomers, at most."""
_HEAD_END = b"\r\n\r\n"
LONGEST_HEAD = 16 * 1024
"""Bytes of the head of a first request."""
_CHEAPEST = 0.0005  # s of processor time that a request takes at least, with all that aiohttp does


@dataclass(frozen=True, slots=True)
class GateLimits:
    """What newcomers may cost, all times in s of wall time.

    Attributes:
        newcomers: connections at a time; a quarter of the process's descriptors if that is less.
        per_address: the same of one address (of IPv6: of one /64).
        head: until a request has come whole, or a page has said hello; again after each answer.
        answer: until an answer has been taken.
        arrivals: connections a second that are accepted; others wait in the kernel.
        share: of one processor that answers get, all together.
        queue: connections that the kernel holds until they are accepted.
        receive_buffer, send_buffer: bytes asked of the kernel for each; it doubles them.
        held_bytes: what one can make this process hold: a head, and the part of an answer that the
            kernel does not take.
    """

    newcomers: int = 128
    per_address: int = 96
    head: float = 10.0
    answer: float = 60.0
    arrivals: float = 2000.0
    share: float = 0.25
    queue: int = 4096
    receive_buffer: int = 64 * 1024
    send_buffer: int = 256 * 1024
    held_bytes: int = 800 * 1024

    @property
    def kernel_bytes(self) -> int:
        """Bytes that a connection can make the kernel hold."""
        return 2 * (self.receive_buffer + self.send_buffer)

    @property
    def places(self) -> int:
        """Newcomers at a time, with the descriptors that this process may have."""
        if resource is None:
            return self.newcomers
        few, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return self.newcomers if few < 0 else max(4, min(self.newcomers, few // 4))


class _Budget:
    """A token bucket that is spent in the order of coming; who spends more than is left is let
    through, and the next one waits."""

    def __init__(self, rate: float, most: float) -> None:
        self._bucket = TokenBucket(rate, most)
        self._line = asyncio.Lock()

    async def wait(self, given_up: Callable[[], bool] = lambda: False) -> None:
        """Return when there is something left, or when it has been given up."""
        async with self._line:
            while not given_up():
                left = self._bucket.tokens
                if left > 0.0:
                    return
                await asyncio.sleep(min(0.1, 0.001 - left / self._bucket.rate))

    def spend(self, units: float) -> None:
        """Use some up."""
        self._bucket.spend(units)


class _Guest(asyncio.Protocol):
    """One connection, between its transport and aiohttp's protocol, which does all the talking once
    a head has come whole: what never gets so far costs little.

    Attributes:
        inner: aiohttp's, once there is one. address: who shares its bounds. since: when it last got
            on, s of the loop. answered: an answer is under way.
    """

    def __init__(self, gate: Gate, address: str) -> None:
        self.inner: asyncio.Protocol | None = None
        self.address, self.since = address, gate.loop.time()
        self.answered = False
        self._head = bytearray()
        self._gate, self._ended = gate, False
        self._transport: asyncio.Transport | None = None
        self._timer: asyncio.TimerHandle | None = None

    def expect(self, seconds: float | None) -> None:
        """It must get on within so many seconds from now; None: whenever it likes."""
        self.since = self._gate.loop.time()
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        if seconds is not None and not self._ended:
            self._timer = self._gate.loop.call_later(seconds, self._late)

    def _late(self) -> None:
        transport = self._transport
        if transport is None or self.answered or transport.is_closing():
            self.abort()
        else:
            transport.close()  # what the kernel has taken for it still arrives
            self.expect(self._gate.limits.head)

    def abort(self) -> None:
        """End it at once."""
        self._ended = True
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if self._ended:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        if self.inner is not None:
            self.inner.data_received(data)
            return
        seen = max(0, len(self._head) - len(_HEAD_END) + 1)
        self._head += data
        if self._head.find(_HEAD_END, seen) >= 0:
            assert self._transport is not None
            self.inner = self._gate.begin(self)
            self.inner.connection_made(self._transport)
            self.inner.data_received(bytes(self._head))
            self._head.clear()
        elif len(self._head) > LONGEST_HEAD:
            self.abort()

    def eof_received(self) -> bool | None:
        return None if self.inner is None else self.inner.eof_received()

    def pause_writing(self) -> None:
        if self.inner is not None:
            self.inner.pause_writing()

    def resume_writing(self) -> None:
        if self.inner is not None:
            self.inner.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        self._ended = True
        self.expect(None)
        self._gate.left(self)
        if self.inner is not None:
            self.inner.connection_lost(exc)


class Gate:
    """Lets connections in to one application.

    Attributes:
        limits: of newcomers. loop: on which all of it runs. server: makes aiohttp's protocols.
    """

    def __init__(self, limits: GateLimits) -> None:
        self.limits, self.loop = limits, asyncio.get_running_loop()
        self.server: Callable[[], Any] | None = None
        self._guests: set[_Guest] = set()
        self._by_protocol: dict[object, _Guest] = {}
        self._newcomers: set[_Guest] = set()
        self._by_address: Counter[str] = Counter()
        self._making: set[asyncio.Task[None]] = set()
        self._arrivals = _Budget(limits.arrivals, limits.arrivals / 4.0)
        self._answers = _Budget(limits.share, limits.share)
        self._untold: Counter[str] = Counter()
        self._tells = float("-inf")
        self._log = Log("web")
        self.logger = logging.Logger("aiohttp")
        self.logger.addFilter(self._complained)

    # -- coming and going ---------------------------------------------------------------------

    async def accept(self, listening: socket.socket) -> None:
        """Let connections in that come at a socket, until cancelled."""
        while True:
            await self._arrivals.wait()
            try:
                client, address = await self.loop.sock_accept(listening)
            except OSError as error:
                if error.errno in _SCARCE:
                    self.tell("descriptors are used up, connections wait (raise `ulimit -n`?)")
                    self._give_way()
                    await asyncio.sleep(_SCARCE_PAUSE)
                else:
                    await asyncio.sleep(_LOST_PAUSE)
                continue
            self._arrivals.spend(1.0)
            self._let_in(client, _shared(address[0]))
            await asyncio.sleep(0)  # `sock_accept` does not yield while somebody waits

    def _let_in(self, client: socket.socket, address: str) -> None:
        if self._by_address[address] >= self.limits.per_address:
            self.tell("newcomers gave way to others of their address")
            self._give_way(address)
        elif len(self._newcomers) >= self.limits.places:
            self.tell("newcomers gave way to others")
            self._give_way()
        client.setblocking(False)
        guest = _Guest(self, address)
        self._guests.add(guest)
        self._newcomers.add(guest)
        self._by_address[address] += 1
        guest.expect(self.limits.head)
        made = asyncio.create_task(self._make(client, guest))
        self._making.add(made)
        made.add_done_callback(self._making.discard)

    async def _make(self, client: socket.socket, guest: _Guest) -> None:
        try:
            await self.loop.connect_accepted_socket(lambda: guest, client)
        except OSError:
            client.close()
            self.left(guest)

    def _give_way(self, address: str = "") -> None:
        """End the newcomer that has got on longest ago, of an address or of that which holds most;
        those whose answer is under way last."""
        if not self._newcomers:
            return
        address = address or self._by_address.most_common(1)[0][0]
        crowd = [one for one in self._newcomers if one.address == address]
        guest = min(crowd, key=lambda one: (one.answered, one.since))
        guest.abort()
        self._no_newcomer(guest)

    def _no_newcomer(self, guest: _Guest) -> None:
        if guest in self._newcomers:
            self._newcomers.remove(guest)
            self._by_address[guest.address] -= 1
            if not self._by_address[guest.address]:
                del self._by_address[guest.address]

    def left(self, guest: _Guest) -> None:
        """A connection has ended."""
        self._no_newcomer(guest)
        self._guests.discard(guest)
        self._by_protocol.pop(guest.inner, None)

    def begin(self, guest: _Guest) -> asyncio.Protocol:
        """A connection has sent its first head; aiohttp's protocol for it."""
        assert self.server is not None
        inner: asyncio.Protocol = self.server()
        self._by_protocol[inner] = guest
        return inner

    def admit(self, protocol: object) -> None:
        """A page has said who it is: its connection, by aiohttp's protocol, is no newcomer's."""
        if (guest := self._by_protocol.get(protocol)) is not None:
            guest.expect(None)
            self._no_newcomer(guest)

    async def close(self) -> None:
        """End everybody to whom aiohttp does not talk; it closes the other connections."""
        for made in self._making:
            made.cancel()
        await asyncio.gather(*self._making, return_exceptions=True)
        for guest in list(self._guests):
            guest.expect(None)
            if guest.inner is None:
                guest.abort()

    # -- answers ------------------------------------------------------------------------------

    @property
    def middleware(self) -> Middleware:
        """To be the outermost one of the application."""

        @web.middleware
        async def gate(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._answer(request, handler)

        return gate

    async def _answer(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        guest = self._by_protocol.get(request.protocol)
        upgrade = request.headers.get("Upgrade") is not None
        if guest is not None:
            guest.answered = not upgrade
            guest.expect(self.limits.head if upgrade else self.limits.answer)
        try:
            await self._answers.wait(lambda: request.transport is None)
            if request.transport is None:
                raise ConnectionResetError("it has gone meanwhile")
            begun = time.thread_time()
            response = await self._response(request, handler)
            # A socket's time is that of all others meanwhile.
            spent = 0.0 if upgrade else time.thread_time() - begun
            self._answers.spend(max(_CHEAPEST, spent))
            if not isinstance(response, web.WebSocketResponse):
                await response.prepare(request)
                await response.write_eof()
            return response
        finally:
            if guest is not None:
                guest.answered = False
                guest.expect(self.limits.head)

    async def _response(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            return await handler(request)
        except web.HTTPException as error:
            return web.Response(status=error.status, text=error.reason)
        except ConnectionError:
            raise
        except Exception as error:
            self.tell("a request failed", error)
            return web.Response(status=500, text="the request failed")

    # -- the log ------------------------------------------------------------------------------

    def tell(self, what: str, error: BaseException | None = None) -> None:
        """Tell the log that something happened, one line a second at most; others are counted."""
        self._untold[what] += 1
        now = self.loop.time()
        if now < self._tells:
            return
        self._tells = now + 1.0 / LOG_RATE
        counts, self._untold = self._untold, Counter()
        message = "; ".join(f"{kind}, {count} times" for kind, count in counts.items())
        if error is None:
            self._log.warning(message)
        else:
            self._log.exception(message, error)

    def _complained(self, record: logging.LogRecord) -> bool:
        """Aiohttp has something to complain of; False, since nothing of it is written as it is."""
        error = record.exc_info[1] if record.exc_info else None
        if error is not None and not isinstance(error, HttpProcessingError | ConnectionError):
            self.tell("a request failed", error)
        return False


_GATE = web.AppKey("gate", Gate)


def admit(request: web.Request) -> None:
    """The page behind a request has said who it is: it is no newcomer any more."""
    if (gate := request.app.get(_GATE)) is not None:
        gate.admit(request.protocol)


@contextlib.asynccontextmanager
async def gated(
    app: web.Application,
    host: str,
    port: int,
    *,
    option: str = "--port",
    limits: GateLimits | None = None,
) -> AsyncIterator[int]:
    """Serve an application while inside; yields its port.

    Args:
        app: whose pages call `admit`. host: numeric address or name. port: 0 is any free one.
        option: of the command line that sets the port, for the advice where it cannot be had.
        limits: of newcomers.

    Raises:
        UsarsimError: the port cannot be had.
    """
    gate = app[_GATE] = Gate(limits or GateLimits())
    app.middlewares.insert(0, gate.middleware)
    async with contextlib.AsyncExitStack() as stack:
        sockets = await _listening(host, port, option, gate.limits)
        for one in sockets:
            stack.callback(one.close)
        # No access log: it would hold addresses and user agents.
        runner = web.AppRunner(
            app, access_log=None, shutdown_timeout=1.0, lingering_time=0.0, logger=gate.logger
        )
        await runner.setup()
        stack.push_async_callback(runner.cleanup)
        stack.push_async_callback(gate.close)
        gate.server = runner.server
        accepting = [asyncio.create_task(gate.accept(one)) for one in sockets]
        try:
            yield int(sockets[0].getsockname()[1])
        finally:
            for task in accepting:
                task.cancel()
            await asyncio.gather(*accepting, return_exceptions=True)


async def _listening(host: str, port: int, option: str, limits: GateLimits) -> list[socket.socket]:
    """Sockets that listen at one port of all addresses of a host."""
    opened: list[socket.socket] = []
    try:
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, kind, protocol, _, address in dict.fromkeys(found):
            one = socket.socket(family, kind, protocol)
            opened.append(one)
            one.setblocking(False)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            # Those that are accepted inherit them; set later they could not shrink the window.
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, limits.receive_buffer)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, limits.send_buffer)
            if family is socket.AF_INET6:
                one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            bound = opened[0].getsockname()[1]
            try:
                one.bind((address[0], port or bound, *address[2:]))
                one.listen(limits.queue)
            except OSError as error:
                if len(opened) == 1 or error.errno != errno.EADDRNOTAVAIL:
                    raise
                opened.pop().close()  # `localhost` may name an address that the machine has not
    except (OSError, UnicodeError) as error:
        for one in opened:
            one.close()
        why = getattr(error, "strerror", None) or str(error)
        cure = "choose another, or 0 for any free one"
        raise UsarsimError(f"{option}: {host}:{port} cannot be had: {why} ({cure})") from None
    return opened


def _shared(host: str) -> str:
    """The part of an address that one machine has for itself: of IPv6 its /64, else all of it."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if address.version == 4:
        return host
    if (mapped := address.ipv4_mapped) is not None:
        return str(mapped)
    return str(ipaddress.ip_network((int(address), 64), strict=False).network_address)
