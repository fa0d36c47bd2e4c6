"""Connections that mean a server no good, many in one thread, at the price of a remote machine.

A remote attacker costs a server what it sends and asks, not its own work. So that the same holds on
one machine, the thread that works all links stays below `SHARE` of one processor: blocks are made
beforehand and large, and it sleeps when it has used more.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from usarsim_bench.figures import BenchError

HOST = "127.0.0.1"
SHARE = 0.1
"""Part of one processor that the attackers use in all, at most."""
_TICK = 0.01
"""s between two rounds over all links."""
_REST = 0.5
"""Longest s without a round, so that an overdrawn share does not look like mercy."""
_BLOCK = 65536
_MOST_AT_ONCE = 4
"""Blocks that one link sends in one round, if they are taken."""
_RETURN_PAUSE = 0.5
"""s until a link comes back after the server has closed it."""
_TIMEOUT = 5.0

First = bytes | Callable[[int], bytes]
"""What a link says first; a function gets the number of the connection, from 0."""


@dataclass(slots=True)
class Damage:
    """What the attackers got through."""

    connections: int = 0  # made or tried
    closed: int = 0  # of these, ended by the server
    sent: int = 0  # bytes
    received: int = 0
    cpu: float = 0.0  # s of processor time that the attackers used
    seconds: float = 0.0  # of wall time that it lasted


@dataclass
class Site:
    """Where to attack."""

    ports: Mapping[str, int]  # of the server, by the names of its READY line
    ended: threading.Event = field(default_factory=threading.Event)  # set when the attack is over
    kept: list[socket.socket] = field(default_factory=list)
    """Sockets that stay open, and unread, as long as the attack lasts."""

    def dial(self, port: int) -> socket.socket:
        """A connection to some port, whose calls block for a while; `OSError` if there is none."""
        client = socket.create_connection((HOST, port), timeout=_TIMEOUT)
        self.kept.append(client)
        return client

    def ask(self, client: socket.socket, request: bytes, end: bytes = b"\r\n") -> bytes:
        """The answer to one request.

        Raises:
            BenchError: if the connection ends before it.
        """
        client.sendall(request)
        answer = b""
        while not answer.endswith(end):
            piece = client.recv(_BLOCK)
            if not piece:
                raise BenchError(f"no answer to {request[:40]!r}")
            answer += piece
        return answer

    def listen(self) -> tuple[socket.socket, int]:
        """A port where the server can dial the attackers. The kernel takes the connections."""
        listening = socket.create_server((HOST, 0), backlog=4096)
        self.kept.append(listening)
        return listening, listening.getsockname()[1]


class Link:
    """One client: what it says first and then again and again, whether it reads."""

    def __init__(
        self,
        port: int,
        first: First = b"",
        again: bytes = b"",
        *,
        every: float = 0.0,
        reads: bool = False,
        lives: float | None = None,
        half_closed: bool = False,
        client: socket.socket | None = None,
        buffer: int | None = None,
    ) -> None:
        """Describe a client; nothing is sent before `step`.

        Args:
            port: to connect to, and to come back to whenever the server hangs up.
            first: see `First`.
            again: said again and again, whole.
            every: s between two of them; 0 for as fast as they are taken.
            reads: take what the server says, all 10 ms. Otherwise never.
            lives: s after which it hangs up and comes back at once; None to stay.
            half_closed: close the sending half once the first words are out.
            client: a connection that exists; one that is lost does not come back.
            buffer: bytes that its system keeps unread; None: as many as is usual.
        """
        self._port, self._first = port, first
        self._again = again if every or not again else again * (_BLOCK // len(again) + 1)
        self._every, self._reads, self._lives = every, reads, lives
        self._half_closed = half_closed
        self._client, self._buffer = client, buffer
        self._returns = client is None
        self._count = 0
        self._due = 0.0
        self._born = 0.0
        self._next = 0.0
        self._unsent = memoryview(b"")
        if client is not None:
            client.setblocking(False)

    def step(self, now: float, damage: Damage) -> None:
        """Send what is taken, read what is there."""
        if self._client is None:
            if not self._returns or now < self._due:
                return
            self._connect(now, damage)
        try:
            self._write(now, damage)
            if self._reads:
                self._drain(damage)
        except BlockingIOError:
            pass
        except OSError:
            damage.closed += 1
            self._hang_up(now + _RETURN_PAUSE)
        if self._lives is not None and self._client and now >= self._born + self._lives:
            self._hang_up(now)

    def close(self) -> None:
        """Hang up for good."""
        self._returns = False
        self._hang_up(0.0)

    def _connect(self, now: float, damage: Damage) -> None:
        self._client = socket.socket()
        self._client.setblocking(False)
        self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._buffer is not None:
            self._client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self._buffer)
        # Still on its way when the first bytes are sent: they wait, like those of a full buffer.
        self._client.connect_ex((HOST, self._port))
        first = self._first(self._count) if callable(self._first) else self._first
        self._unsent = memoryview(first)
        self._count += 1
        self._born, self._next = now, now + self._every
        damage.connections += 1

    def _write(self, now: float, damage: Damage) -> None:
        assert self._client is not None
        for _ in range(_MOST_AT_ONCE):
            if not self._unsent:
                if self._half_closed:
                    self._client.shutdown(socket.SHUT_WR)
                    self._half_closed, self._again = False, b""
                if not self._again or now < self._next:
                    return
                self._unsent = memoryview(self._again)
                self._next = now + self._every
            try:
                sent = self._client.send(self._unsent)
            except BlockingIOError:
                return
            damage.sent += sent
            self._unsent = self._unsent[sent:]

    def _drain(self, damage: Damage) -> None:
        assert self._client is not None
        for _ in range(_MOST_AT_ONCE):
            data = self._client.recv(4 * _BLOCK)
            if not data:
                raise ConnectionResetError
            damage.received += len(data)

    def _hang_up(self, due: float) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
        self._due = due


def work(links: Sequence[Link], ended: threading.Event, damage: Damage) -> None:
    """Work all links until the event is set, then hang up; what is done is written down."""
    begun, used = time.perf_counter(), time.thread_time()
    pause = 0.0
    while not ended.wait(pause):
        for link in links:
            link.step(time.perf_counter(), damage)
        damage.seconds = time.perf_counter() - begun
        damage.cpu = time.thread_time() - used
        pause = min(_REST, max(_TICK, damage.cpu / SHARE - damage.seconds))
    for link in links:
        with contextlib.suppress(OSError):
            link.close()
