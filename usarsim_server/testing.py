"""Helpers for tests and experiments, ours and yours.

* `Rehearsal` runs a world without sockets and without a clock: commands go in as text, lines come
  out as text, time moves when told to. Equal scripts give equal lines.
* `ScriptedClient` speaks the protocol over a socket, line by line.
* `running_server` runs a whole server inside this process; `ServerProcess` runs `usarsim serve`.

Verdicts count simulated time, as lines tell it, or what comes before a fence: a question whose
answer proves that all that was sent earlier has been dealt with. `PATIENCE` only ends what hangs.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence

from usarsim_server.app import assemble
from usarsim_server.assembly import Assembly
from usarsim_server.base.closing import Closing
from usarsim_server.base.launch import OwnServer
from usarsim_server.options import OPTIONS
from usarsim_server.protocol.grammar import LineFramer, parse_line
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.port import run_services
from usarsim_server.sessions.outbox import Outbox
from usarsim_server.sessions.robots import Vehicle, robot_model
from usarsim_server.sessions.session import Session
from usarsim_server.settings import Settings
from usarsim_server.simulation.snapshot import RobotBody

__all__ = [
    "PATIENCE",
    "Closing",
    "Rehearsal",
    "RehearsedClient",
    "ScriptedClient",
    "ServerProcess",
    "Session",
    "Vehicle",
    "eventually",
    "robot_model",
    "running_server",
    "time_of",
]

PATIENCE = 90.0
"""s of wall time after which something hangs, on however busy a machine."""

POLL = 0.005
"""s of wall time between two looks at what shall come true."""

SIDE_PORTS = tuple(one.key for one in OPTIONS if one.port and one.key != "port")
"""Settings of all ports but that of robot control."""

SETTLE_POLL = 0.0002
"""s of wall time between two looks at a session that is busy."""


_TIME = re.compile(r"\{Time (\d+\.\d+)\}")


def eventually(condition: Callable[[], bool]) -> bool:
    """Wait until a condition comes true; False if it does not, for as long as `PATIENCE`."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(POLL)
    return True


def time_of(line: str) -> float | None:
    """Simulated time that a line of the server tells, s; None if it tells none."""
    found = _TIME.search(line)
    return None if found is None else float(found.group(1))


class RehearsedClient:
    """One connection of a `Rehearsal`; whatever it is sent it reads at once.

    Attributes:
        lines: everything the server has said so far, without line ends.
        session: the session that executes the commands.
    """

    def __init__(self, rehearsal: Rehearsal, peer: str) -> None:
        self.lines: list[str] = []
        self._rehearsal = rehearsal
        self._framer = LineFramer()
        self._outbox = Outbox(self._read)
        self.session: Session = rehearsal.assembly.make_session(peer, self._outbox, _nothing)
        rehearsal.await_client(self)

    def _read(self) -> None:
        while (lines := self._outbox.take()) is not None:
            for line in lines.removesuffix(b"\r\n").split(b"\r\n"):
                self.hear(line + b"\r\n")

    def hear(self, line: bytes) -> None:
        """Take a line (called by the thread that says it)."""
        self.lines.append(line.decode("latin-1").removesuffix("\r\n"))

    def send(self, *texts: str) -> None:
        """Send command lines and wait until they have been executed; time stands still."""
        for text in texts:
            for line in self._framer.feed(text.encode("latin-1") + b"\r\n"):
                self.session.submit(parse_line(line))
        self._rehearsal.settle()

    def take(self, head: str = "") -> list[str]:
        """Lines received since the last call that begin with a text; all are forgotten."""
        taken, self.lines = self.lines, []
        return [line for line in taken if line.startswith(head)]

    def close(self) -> None:
        """Hang up; the robot leaves the world."""
        self.session.close()


class Rehearsal(Closing):
    """A world that is played by hand, in lockstep, in this thread."""

    def __init__(self, **settings: object) -> None:
        """Load a world.

        Args:
            settings: fields of `Settings`; speed and ports do not matter.
        """
        values = {**settings, "speed": float("inf")}
        self.assembly: Assembly = assemble(Settings(**values))  # type: ignore[arg-type]
        self._clients: list[RehearsedClient] = []

    def connect(self) -> RehearsedClient:
        """A new connection."""
        return RehearsedClient(self, f"rehearsed:{len(self._clients)}")

    def await_client(self, client: RehearsedClient) -> None:
        """Let `settle` wait for a client, too; clients see to that themselves."""
        self._clients.append(client)

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return self.assembly.simulation.look().time

    def settle(self) -> None:
        """Wait until everything that was sent has been executed; time stands still."""
        simulation = self.assembly.simulation
        while True:
            # The simulation waits for sessions that have a robot; one that has just been sent its
            # first INIT is unknown there.
            idle = all(client.session.idle() for client in self._clients)
            simulation.settle()
            if idle:
                return
            time.sleep(SETTLE_POLL)

    def robot_state(self, robot: str | int = 0) -> RobotBody:
        """The present state of a robot: its name, or its number in the order of spawning.

        Raises:
            LookupError: if there is none.
        """
        robots = self.assembly.robots
        vehicle = robots.find(robot) if isinstance(robot, str) else robots.vehicles[robot]
        state = None if vehicle is None else vehicle.body.look()
        if state is None:
            raise LookupError(f"no robot {robot}")
        return state

    def run(self, seconds: float) -> None:
        """Let simulated time pass, and all be told; a robot that is gone hears of its end, too."""
        self.assembly.simulation.run_until(self.time + seconds)
        self.settle()

    def close(self) -> None:
        """End all connections."""
        self.assembly.stop()


class ScriptedClient(Closing):
    """A legacy controller in slow motion: sends text, reads whole lines."""

    def __init__(self, port: int, host: str = "127.0.0.1", timeout: float = PATIENCE) -> None:
        self.socket = socket.create_connection((host, port), timeout=timeout)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._timeout = timeout
        self._buffer = b""

    def send(self, text: str, end: str = "\r\n") -> None:
        """Send one command line."""
        self.socket.sendall((text + end).encode("latin-1"))

    def send_bytes(self, data: bytes) -> None:
        """Send bytes as they are."""
        self.socket.sendall(data)

    def read_line(self, timeout: float | None = None) -> str:
        """The next line without its CR LF.

        Raises:
            TimeoutError: if none comes in time.
            ConnectionError: if the server closed the connection.
        """
        deadline = time.monotonic() + (self._timeout if timeout is None else timeout)
        while b"\r\n" not in self._buffer:
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise TimeoutError(f"no line within the time; so far: {self._buffer[:200]!r}")
            self.socket.settimeout(left)
            data = self.socket.recv(65536)
            if not data:
                raise ConnectionError("the server closed the connection")
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\r\n")
        return line.decode("latin-1")

    def wait_for(self, wanted: str | Callable[[str], bool], timeout: float | None = None) -> str:
        """The next line that begins with a text, or that a function accepts; skips others."""
        accept = wanted if callable(wanted) else lambda line: line.startswith(wanted)
        deadline = time.monotonic() + (self._timeout if timeout is None else timeout)
        while True:
            line = self.read_line(max(0.0, deadline - time.monotonic()))
            if accept(line):
                return line

    def read_for(self, seconds: float) -> list[str]:
        """All lines that arrive within a wall time, for what must stay silent."""
        lines = []
        deadline = time.monotonic() + seconds
        with contextlib.suppress(TimeoutError):
            while (left := deadline - time.monotonic()) > 0.0:
                lines.append(self.read_line(left))
        return lines

    def fence(self) -> list[str]:
        """All lines up to the answer to a harmless question: all that was sent is dealt with.

        The answer itself, that of GETSTARTPOSES, is not among them.
        """
        self.send("GETSTARTPOSES")
        return self._until(lambda line: line.startswith("NFO {StartPoses"))[:-1]

    def listen(self, seconds: float) -> list[str]:
        """All lines until so much simulated time has passed since all that was sent was dealt with.

        Args:
            seconds: counted by the `{Time t}` of the lines, so something has to stream here.
        """
        lines = self.fence()
        lines += self._until(lambda line: time_of(line) is not None)
        begun = time_of(lines[-1])
        assert begun is not None
        end = begun + seconds - 1e-6
        return lines + self._until(lambda line: (time_of(line) or 0.0) >= end)

    def _until(self, last: Callable[[str], bool]) -> list[str]:
        """All lines up to one that is the last."""
        lines = [self.read_line()]
        while not last(lines[-1]):
            lines.append(self.read_line())
        return lines

    def close(self) -> None:
        """Hang up."""
        self.socket.close()


@contextlib.contextmanager
def running_server(**settings: object) -> Iterator[tuple[Assembly, dict[str, Endpoint]]]:
    """Run a whole server in this process while inside; yields it and its endpoints by name.

    Args:
        settings: fields of `Settings`; the control port defaults to any free one, those of the
            side channels to none.
    """
    ports = {**dict.fromkeys(SIDE_PORTS), "port": 0}
    assembly = assemble(Settings(**{**ports, **settings}))  # type: ignore[arg-type]
    ready = threading.Event()
    endpoints: dict[str, Endpoint] = {}
    loops: list[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = []

    def announce(found: Sequence[Endpoint]) -> None:
        endpoints.update({endpoint.name: endpoint for endpoint in found})
        ready.set()

    async def serve() -> None:
        stop = asyncio.Event()
        loops.append((asyncio.get_running_loop(), stop))
        await run_services(assembly.services, announce, stop)

    assembly.simulation.start()
    thread = threading.Thread(target=asyncio.run, args=(serve(),), daemon=True)
    thread.start()
    try:
        if not ready.wait(PATIENCE):
            raise TimeoutError("the server did not become ready")
        yield assembly, endpoints
    finally:
        for loop, stop in loops:
            loop.call_soon_threadsafe(stop.set)
        thread.join(PATIENCE)
        assembly.stop()


class ServerProcess(OwnServer):
    """`usarsim serve` in a process of its own, with clients that tests need.

    The control port defaults to any free one, those of the side channels to none.
    """

    def client(self) -> ScriptedClient:
        """A new connection to the control port."""
        return ScriptedClient(self.ports["control"])

    def close(self) -> None:
        """Kill it if it still runs; `end` asks it to end."""
        self.end(signal.SIGKILL)


def _nothing() -> None:
    """A callback that nobody needs."""
