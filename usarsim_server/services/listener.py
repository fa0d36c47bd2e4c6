"""Binding, accepting and ending: the part that all TCP services have in common.

A service gives the listener a handler, a coroutine that owns one accepted socket while it runs.
The listener closes the socket afterwards whatever happened, keeps one client's failure away from
all others, holds the number of connections, and survives a process that runs out of descriptors.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import ipaddress
import math
import os
import select
import socket
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from usarsim_server.base.addresses import format_address
from usarsim_server.base.errors import ServiceError
from usarsim_server.base.logs import Log
from usarsim_server.base.processes import port_taker
from usarsim_server.base.token_bucket import TokenBucket
from usarsim_server.services.limits import AddressBuckets
from usarsim_server.services.silence import PATIENCE, ends_when_gone

Handler = Callable[[socket.socket, str], Awaitable[None]]
"""Serves one client: a non-blocking socket for the `loop.sock_*` calls, and the peer `host:port`.

It returns when the conversation is over and may be cancelled at any await. `OSError` means that
the client went away; any other exception is a defect and is logged with its traceback.
"""

OUT_OF_RESOURCES = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOBUFS})
# accept(2): errors of the arriving connection itself that Linux passes on; simply take the next.
_LOST_ON_ARRIVAL = frozenset(
    {
        errno.ECONNABORTED,
        errno.EPERM,
        errno.EPROTO,
        errno.ENOPROTOOPT,
        errno.EOPNOTSUPP,
        errno.ENETDOWN,
        errno.ENETUNREACH,
        errno.EHOSTDOWN,
        errno.EHOSTUNREACH,
        errno.ENONET,
        errno.ETIMEDOUT,
    }
)
RESOURCE_PAUSE = 0.1
"""Seconds to wait for descriptors to come free; the value trio's `serve_listeners` uses."""
_FAILURE_PAUSE = 1.0
"""Seconds to wait after an accept error that nobody foresaw."""
_REFUSAL_PAUSE = 0.002
"""Seconds between refusing one client and looking for the next: somebody who does nothing but knock
keeps the loop busy for a small part of its time."""
_QUEUE_POLL = 0.05
"""Seconds between looks whether a client that waits for its turn is still there."""
_STOP_TIMEOUT = 2.0
"""Seconds that handlers get to end after their cancellation; the process has three in all."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where a service listens, as the READY line shows it."""

    name: str
    host: str
    port: int

    @property
    def address(self) -> str:
        """`HOST:PORT`, with brackets around an IPv6 host."""
        return format_address(self.host, self.port)

    @property
    def loopback(self) -> bool:
        """Whether only programs on this machine can reach it."""
        address = ipaddress.ip_address(self.host.partition("%")[0])
        return (getattr(address, "ipv4_mapped", None) or address).is_loopback

    def __str__(self) -> str:
        return f"{self.name}={self.address}"


@dataclass(frozen=True, slots=True)
class ListenerLimits:
    """What the clients of one service may use."""

    max_connections: int = 64  # further clients are accepted and closed at once, with a log line
    per_address: int | None = None  # the same for the clients of one address; None: no other limit
    arrival_rate: float = math.inf
    """Clients of one address that are served per second in the long run. Others wait for their turn
    before they are greeted."""
    arrival_burst: int = 128  # clients of one address that may come at once
    queue: int = 128  # connections the kernel may hold until they are accepted
    receive_buffer: int | None = None
    """Bytes of kernel buffer asked for per client, None for the system's automatic size, which
    reaches several MiB."""
    send_buffer: int | None = None
    """The same for output. A small one bounds how old the data are that a slow client reads."""
    silence: float = PATIENCE
    """s of wall time after which a client's machine counts as gone, if what it was sent stays
    unacknowledged and it sends nothing; see `silence`."""

    @property
    def kernel_bytes(self) -> int:
        """Bytes that a connection can make the kernel hold, which doubles what it is asked for."""
        return 2 * ((self.receive_buffer or 0) + (self.send_buffer or 0))


class Listener:
    """One listening socket and the connections that came through it. Used on one event loop."""

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        handler: Handler,
        *,
        option: str = "--port",
        limits: ListenerLimits | None = None,
        make_room: Callable[[], bool] | None = None,
    ) -> None:
        """Describe a listener; nothing is opened before `start`.

        Args:
            name: of the service, for the READY line and the log.
            host: numeric address or host name to listen on.
            port: 0 takes any free one.
            handler: see `Handler`.
            option: command line option that sets the port, for the advice when it is busy.
            limits: see `ListenerLimits`.
            make_room: asked when all places are taken; whether somebody is about to leave. None:
                nobody leaves for a newcomer.
        """
        self._name = name
        self._host = host
        self._port = port
        self._handler = handler
        self._option = option
        self._limits = limits or ListenerLimits()
        self._make_room = make_room
        self._log = Log(name)
        self._connections = 0
        self._by_address: Counter[str] = Counter()
        self._arrivals = AddressBuckets(self._arrival_bucket)
        self._task: asyncio.Task[None] | None = None

    @property
    def connections(self) -> int:
        """Number of clients being served."""
        return self._connections

    async def start(self) -> Endpoint:
        """Open the port and begin to accept.

        Returns:
            The address really bound.

        Raises:
            ServiceError: if the port is taken or not allowed or the host is not of this machine.
        """
        if self._task is not None:
            raise RuntimeError(f"{self._name} listens already")
        listening = _early.pop((self._option, self._host, self._port), None)
        if listening is None:
            listening = await asyncio.to_thread(
                _open, self._name, self._host, self._port, self._option
            )
        # Accepted sockets inherit these; set later they could not shrink the TCP window.
        set_buffers(listening, self._limits.receive_buffer, self._limits.send_buffer)
        listening.listen(self._limits.queue)
        host, port = listening.getsockname()[:2]
        self._task = asyncio.create_task(self._run(listening), name=f"{self._name}-listener")
        self._log.info("listening", address=format_address(host, port))
        return Endpoint(self._name, host, port)

    async def stop(self) -> None:
        """Close the port and end all connections; returns once they are gone.

        A handler that does not end within two seconds of its cancellation is abandoned with a
        log line. Does nothing if the listener was not started.
        """
        task, self._task = self._task, None
        if task is None:
            return
        task.cancel()
        _, late = await asyncio.wait({task}, timeout=_STOP_TIMEOUT)
        if late:
            self._log.error("connections did not end in time", connections=self._connections)

    async def _run(self, listening: socket.socket) -> None:
        with listening:
            async with asyncio.TaskGroup() as clients:
                await self._accept_forever(listening, clients)

    async def _accept_forever(self, listening: socket.socket, clients: asyncio.TaskGroup) -> None:
        loop = asyncio.get_running_loop()
        short_of: int | None = None
        while True:
            try:
                client, address = await loop.sock_accept(listening)
            except OSError as error:
                if error.errno in _LOST_ON_ARRIVAL:
                    continue
                if error.errno != short_of:
                    self._report_accept_error(error)
                short_of = error.errno
                scarce = error.errno in OUT_OF_RESOURCES
                await asyncio.sleep(RESOURCE_PAUSE if scarce else _FAILURE_PAUSE)
                continue
            if short_of is not None:
                short_of = None
                self._log.info("accepting connections again")
            admitted = self._admit(client, address[:2], clients)
            # `sock_accept` does not yield while somebody waits at the door.
            await asyncio.sleep(0 if admitted else _REFUSAL_PAUSE)

    def _report_accept_error(self, error: OSError) -> None:
        reason = os.strerror(error.errno or 0)
        if error.errno in OUT_OF_RESOURCES:
            self._log.warning(
                "new clients wait until resources come free (raise `ulimit -n`?)", reason=reason
            )
        else:
            self._log.error("cannot accept connections, trying again every second", reason=reason)

    def _admit(
        self, client: socket.socket, address: tuple[str, int], clients: asyncio.TaskGroup
    ) -> bool:
        """Serve a client, or close its connection; whether it is served."""
        host, peer = address[0], format_address(*address)
        if refusal := self._refusal(host):
            reason, limit = refusal
            self._log.warning(f"connection refused: {reason}", connection=peer, limit=limit)
            client.close()
            return False
        delay = self._arrivals[host].spend()
        if delay and hung_up(client):  # one that only knocks takes nobody's place
            client.close()
            return False
        self._connections += 1
        self._by_address[host] += 1
        task = clients.create_task(self._serve(client, peer, delay), name=f"{self._name}-{peer}")
        # Not a `finally` in the coroutine: one that is cancelled before its first step runs none.
        task.add_done_callback(lambda _: self._release(client, host))
        return True

    def _refusal(self, host: str) -> tuple[str, int] | None:
        """Why a client of this address cannot be served, and the limit; None if it can."""
        limits = self._limits
        if self._connections >= limits.max_connections and not (
            self._make_room is not None and self._make_room()
        ):
            return "too many clients", limits.max_connections
        if limits.per_address is not None and self._by_address[host] >= limits.per_address:
            return "too many clients of one address", limits.per_address
        return None

    def _arrival_bucket(self) -> TokenBucket:
        limits = self._limits
        # Somebody who only knocks does not make those behind wait longer and longer.
        deepest = float(limits.arrival_burst)
        return TokenBucket(limits.arrival_rate, limits.arrival_burst, deepest=deepest)

    async def _serve(self, client: socket.socket, peer: str, delay: float) -> None:
        try:
            with contextlib.suppress(OSError):
                tune(client)
                # Clients that came before the services had the listening socket inherit nothing.
                set_buffers(client, self._limits.receive_buffer, self._limits.send_buffer)
            if delay:
                self._log.warning(
                    "client has to wait: too many new ones of its address",
                    connection=peer,
                    rate=self._limits.arrival_rate,
                )
                if not await _stays(client, delay):
                    return
            with ends_when_gone(client, self._log, self._limits.silence, connection=peer):
                await self._handler(client, peer)
        except OSError as error:
            self._log.debug("connection lost", connection=peer, reason=error)
        except Exception as error:  # a defect in one conversation must not end the others
            self._log.exception("connection closed by a server error", error, connection=peer)

    def _release(self, client: socket.socket, host: str) -> None:
        self._connections -= 1
        self._by_address[host] -= 1
        if not self._by_address[host]:
            del self._by_address[host]
        client.close()


_early: dict[tuple[str, str, int], socket.socket] = {}
"""Ports opened before their services exist, by option, host and port."""


def open_early(name: str, host: str, port: int, *, option: str) -> None:
    """Open a port before what is served there has been loaded; its `Listener` takes it over.

    Clients that come meanwhile wait in the kernel's queue.

    Args:
        name: of the service, for errors.
        host: as for `Listener`. port: likewise. option: likewise.

    Raises:
        ServiceError: see `Listener.start`.
    """
    _early[option, host, port] = _open(name, host, port, option)


def close_unused() -> None:
    """Close the ports of `open_early` that no listener has taken over."""
    while _early:
        _early.popitem()[1].close()


def _open(name: str, host: str, port: int, option: str) -> socket.socket:
    """A listening socket on one address of the host."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise ServiceError(
            f"{name}: the host {host!r} is unknown "
            "(give --host an address of this machine, or 0.0.0.0 for all of them)"
        ) from error
    # The legacy clients speak IPv4, so that comes first.
    family, _, _, _, address = min(found, key=lambda item: item[0] is not socket.AF_INET)
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setblocking(False)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        # Only a socket that listens keeps others from binding the port.
        listening.listen()
    except OSError as error:
        listening.close()
        raise ServiceError(_open_message(name, host, port, option, error)) from error
    return listening


def _open_message(name: str, host: str, port: int, option: str, error: OSError) -> str:
    where = format_address(host, port)
    if error.errno == errno.EADDRINUSE:
        return (
            f"{name}: port {port} is already in use on {host}, {port_taker(port)[0]} "
            f"(stop that program, or choose another port with {option} N; 0 takes any free one)"
        )
    if error.errno == errno.EACCES:
        return (
            f"{name}: no permission to listen on {where} (choose a port above 1023 with {option} N)"
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return (
            f"{name}: {host} is not an address of this machine "
            "(give --host one that is, or 0.0.0.0 for all of them)"
        )
    return f"{name}: cannot listen on {where}: {os.strerror(error.errno or 0)}"


async def _stays(client: socket.socket, delay: float) -> bool:
    """Wait so many seconds; False as soon as the client has gone."""
    loop = asyncio.get_running_loop()
    until = loop.time() + delay
    while (left := until - loop.time()) > 0.0:
        if hung_up(client):
            return False
        await asyncio.sleep(min(left, _QUEUE_POLL))
    return True


def hung_up(client: socket.socket) -> bool:
    """Whether the client has closed or reset, even if input from before that is still unread."""
    poll = select.poll()
    poll.register(client, select.POLLRDHUP)
    return bool(poll.poll(0))


def challenge(client: socket.socket) -> None:
    """Find out whether the client still has its socket: `hung_up` tells soon after if it has not.

    A client that has closed while more waits in its kernel than the server reads cannot say so: the
    end of a stream comes after its data. Its kernel answers whatever it is sent by a reset. What is
    sent is a byte of urgent data, which TCP keeps out of the stream: receivers do not see it unless
    they ask for it (`SO_OOBINLINE`).
    """
    with contextlib.suppress(OSError):
        client.send(b"\0", socket.MSG_OOB)


_KEEPALIVE = {"TCP_KEEPIDLE": 15, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}
"""s of silence before the kernel asks whether the other machine is there, s between two questions,
and how many stay unanswered until it is gone: `silence.PATIENCE` in all."""


def tune(client: socket.socket) -> None:
    """Never wait for a socket, send at once, notice when the other machine is gone.

    Keepalive notices it only while nothing is in flight; `ends_when_gone` sees to the rest.
    """
    client.setblocking(False)
    # Each line leaves at once and in a segment of its own (protocol reference 1.1 REQ).
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _KEEPALIVE.items():
        if hasattr(socket, name):  # not all of them on other systems
            client.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def set_buffers(one: socket.socket, receive: int | None, send: int | None) -> None:
    """Ask for kernel buffers of so many bytes; None keeps the system's."""
    for option, size in ((socket.SO_RCVBUF, receive), (socket.SO_SNDBUF, send)):
        if size is not None:
            one.setsockopt(socket.SOL_SOCKET, option, size)
