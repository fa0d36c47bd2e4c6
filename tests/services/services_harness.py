"""A control service on a real port, with sessions that a test can hold, release and inspect."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections import deque
from collections.abc import Callable, Coroutine
from typing import Any, Self, TypeVar

from usarsim_server.protocol.grammar import Command
from usarsim_server.services.control import ControlLimits, ControlService
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.port import PortService
from usarsim_server.sessions.outbox import Outbox
from usarsim_server.testing import PATIENCE, eventually

T = TypeVar("T")

GREETING = b"NFO {Gametype BotDeathMatch} {Level arena} {TimeLimit 20}\r\n"


def words(session: FakeAgent) -> list[str]:
    """Command words that a session has executed."""
    return [command.word for command in session.commands]


def fill(session: FakeAgent, count: int = 3000, length: int = 400) -> list[bytes]:
    """Stream so many numbered lines that no buffer can hold them all; returns the lines."""
    lines = [f"SEN {{Time {n}}} {{Data {'x' * length}}}\r\n".encode() for n in range(count)]
    for line in lines:
        session.outbox.put_stream(line)
    return lines


class FakeAgent:
    """Remembers its commands; answers `GETCONF {Name x}` with `CONF {Name x}`."""

    def __init__(
        self, peer: str, outbox: Outbox, on_backlog_low: Callable[[], None], hold: bool
    ) -> None:
        self.peer = peer
        self.outbox = outbox
        self.on_backlog_low = on_backlog_low
        self.hold = hold
        self.commands: list[Command] = []
        self.waiting: deque[Command] = deque()
        self.most_waiting = 0
        self.closes = 0
        self.work = self.cost = 0.0
        """s of processor time used so far, and by each command."""
        self.has_role = False
        self.submit_thread: int | None = None

    def submit(self, commands: list[Command]) -> None:
        """Execute at once, or keep waiting while held."""
        self.submit_thread = threading.get_ident()
        if any(command.word == "KILL" for command in commands):
            raise RuntimeError("a defect in a session")
        if self.hold:
            self.waiting.extend(commands)
            self.most_waiting = max(self.most_waiting, len(self.waiting))
        else:
            self._execute(commands)

    @property
    def backlog(self) -> int:
        """Commands kept waiting."""
        return sum(command.weight for command in tuple(self.waiting))

    def close(self) -> None:
        """Count the calls."""
        self.closes += 1

    def release(self, count: int | None = None, *, tell: bool = True) -> None:
        """Execute some or all of what waits and, unless told not to, say so."""
        for _ in range(len(self.waiting) if count is None else count):
            self._execute([self.waiting.popleft()])
        if tell:
            self.on_backlog_low()

    def _execute(self, commands: list[Command]) -> None:
        for command in commands:
            self.commands.append(command)
            self.work += self.cost
            self.has_role = self.has_role or (command.word == "INIT" and not command.has("Fail"))
            if command.word == "GETCONF":
                self.outbox.put_reply(f"CONF {{Name {command.get('Name')}}}\r\n".encode())


class LoopClock:
    """The time of an event loop, which passes only when the test says so."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._now = loop.time()
        loop.time = lambda: self._now  # type: ignore[method-assign]

    def turn(self, seconds: float) -> None:
        """Let time pass, and the loop notice."""
        self._now += seconds
        self._loop.call_soon_threadsafe(lambda: None)


class Client:
    """A controller that speaks over a real socket."""

    def __init__(
        self,
        address: tuple[str, int],
        receive_buffer: int | None = None,
        send_buffer: int | None = None,
    ) -> None:
        self.socket = socket.socket()
        if send_buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, send_buffer)
        if receive_buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(PATIENCE)
        self.socket.connect(address)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._rest = b""

    @property
    def peer(self) -> str:
        """How the server names this client."""
        host, port = self.socket.getsockname()
        return f"{host}:{port}"

    def send(self, data: bytes) -> None:
        """Send everything."""
        self.socket.sendall(data)

    def line(self) -> bytes:
        """The next line, with its end; what there is of it if the server closes."""
        while b"\n" not in self._rest:
            chunk = self.socket.recv(65536)
            if not chunk:
                rest, self._rest = self._rest, b""
                return rest
            self._rest += chunk
        line, end, self._rest = self._rest.partition(b"\n")
        return line + end

    def silent_for(self, seconds: float) -> bool:
        """Whether nothing arrives in this time, not even the end of the connection."""
        if self._rest:
            return False
        self.socket.settimeout(seconds)
        try:
            self.socket.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(PATIENCE)
        return False

    def ended(self) -> bool:
        """Whether the server closes, after whatever it still had to say."""
        try:
            while self.socket.recv(65536):
                pass
        except ConnectionResetError:
            pass
        return True

    def reset(self) -> None:
        """Close with a TCP reset."""
        self.socket.setsockopt(
            socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00"
        )
        self.socket.close()

    def close(self) -> None:
        """Close."""
        self.socket.close()


class OnLoop:
    """Services on an event loop of a thread of its own, until `stop`."""

    def __init__(self, *services: PortService[Any]) -> None:
        self.clients: list[Any] = []
        """What is to be closed at the end."""
        self.services = services
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()

    def begin(self) -> list[Endpoint]:
        """Start the services."""
        return [self.call(one.start()) for one in self.services]

    def call(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Have something done on the loop, and wait for it."""
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result(PATIENCE)

    def stop_service(self) -> None:
        """Stop the services only."""
        for one in self.services:
            self.call(one.stop())

    def stop(self) -> None:
        """Stop everything; a second call does nothing."""
        if self.loop.is_closed():
            return
        self.stop_service()
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(PATIENCE)
        self.loop.close()
        for client in self.clients:
            client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()


class Running(OnLoop):
    """A control service."""

    def __init__(self, limits: ControlLimits, hold: bool = False, host: str = "127.0.0.1") -> None:
        self.sessions: list[FakeAgent] = []
        self.hold = hold
        self.refuse: Exception | None = None
        self.service = ControlService(host, 0, GREETING, self._session, limits)
        super().__init__(self.service)
        [self.endpoint] = self.begin()

    def _session(self, peer: str, outbox: Outbox, on_backlog_low: Callable[[], None]) -> FakeAgent:
        if self.refuse is not None:
            raise self.refuse
        session = FakeAgent(peer, outbox, on_backlog_low, self.hold)
        self.sessions.append(session)
        return session

    def connect(self, *, greet: bool = True, **buffers: int) -> Client:
        """A new client that has read its greeting; buffers as for `Client`."""
        client = Client((self.endpoint.host, self.endpoint.port), **buffers)
        self.clients.append(client)
        if greet:
            assert client.line() == GREETING
        return client

    def session_of(self, client: Client) -> FakeAgent:
        """The session of a connected client."""
        assert eventually(lambda: any(session.peer == client.peer for session in self.sessions))
        return next(session for session in self.sessions if session.peer == client.peer)

    def pair(self, **buffers: int) -> tuple[Client, FakeAgent]:
        """A new client and its session."""
        client = self.connect(**buffers)
        return client, self.session_of(client)
