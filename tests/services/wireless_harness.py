"""The wireless services on real ports, with stations that a test moves along a line.

Between two stations stands one obstacle for each 10 m: below 50 m a link is up (-88.9 dBm at 49 m),
from there on it is down (-95.3 dBm at 50 m).
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from services_harness import OnLoop

from usarsim_client import BlockingConnection, Inbox, command
from usarsim_server.protocol.values import Vector
from usarsim_server.radio.configuration import read_radio
from usarsim_server.radio.event_log import EventLog
from usarsim_server.radio.network import Network, RadioWorld, Station
from usarsim_server.services.comserver import ComServerLimits, ComServerService
from usarsim_server.services.dialogue import Desk
from usarsim_server.services.relay import LinkOptions
from usarsim_server.services.wireless import WirelessLimits, WirelessService
from usarsim_server.testing import PATIENCE

NEAR, FAR = 10.0, 80.0
"""m: places where a station at 0 is heard and is not."""
POLL = 0.02


class Line:
    """Stations on a line, by their place in metres."""

    def __init__(self, **places: float) -> None:
        self.places = places
        self.empty: set[str] = set()

    def stations(self) -> list[Station]:
        """All stations of this moment."""
        return [
            Station(name, (place, 0.0, 0.0), name in self.empty)
            for name, place in list(self.places.items())
        ]

    def count(self, start: Vector, end: Vector) -> int:
        """One obstacle each 10 m."""
        return int(abs(end[0] - start[0]) // 10)

    def counts(self, start: Vector, ends: Sequence[Vector]) -> list[int]:
        """The same to many points."""
        return [self.count(start, end) for end in ends]


class Talker(BlockingConnection):
    """A robot's control connection."""

    def __init__(self, port: int) -> None:
        super().__init__(port, patience=PATIENCE)

    def ask(self, line: str) -> str:
        """Send a line, read the answer."""
        self.send(command(line))
        return self.line()

    def line(self) -> str:
        """The next line without its end."""
        return self.until(b"\r\n").decode("latin-1")

    def until(self, end: bytes) -> bytes:
        """What comes up to an end mark, without it."""
        return self.take(partial(Inbox.until, mark=end)).removesuffix(end)

    def message(self, text: bytes) -> bytes:
        """Send a message of the ComServer, read the answer, both with semicolon."""
        self.send(text)
        return self.until(b";") + b";"

    def ended(self) -> bool:
        """Whether the server has hung up."""
        with contextlib.suppress(ConnectionResetError):
            while self.socket.recv(65536):
                pass
        return True


class Robot:
    """A controller that listens on ports of its own and is registered."""

    def __init__(self, running: Running, name: str, listeners: int = 1) -> None:
        self.name = name
        self.listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(listeners)]
        self.ports = [one.getsockname()[1] for one in self.listeners]
        self.control = running.talker()
        self._running = running
        ports = ",".join(map(str, self.ports))
        answer = self.control.ask(f"INIT {{Robot {name}}} {{Port {ports}}}")
        assert answer == "INITREPLY {Status OK}", answer
        running.clients += self.listeners

    def road_to(self, other: str, port: int | None = None) -> int:
        """The relay port that leads to another robot."""
        wanted = "" if port is None else f" {{Port {port}}}"
        answer = self.control.ask(f"DNS {{Robot {other}}}{wanted}")
        prefix = f"DNSREPLY {{Robot {other}}} {{Port "
        assert answer.startswith(prefix), answer
        return int(answer.removeprefix(prefix).rstrip("}"))

    def call(self, road: int) -> socket.socket:
        """Connect to a relay port."""
        made = socket.create_connection(("127.0.0.1", road), timeout=PATIENCE)
        self._running.clients.append(made)
        return made

    def accept(self, listener: int = 0) -> socket.socket:
        """Take a connection that the server made."""
        self.listeners[listener].settimeout(PATIENCE)
        made, _ = self.listeners[listener].accept()
        made.settimeout(PATIENCE)
        self._running.clients.append(made)
        return made

    def link(self, other: Robot) -> tuple[socket.socket, socket.socket]:
        """A link to another robot: our end and theirs."""
        mine = self.call(self.road_to(other.name))
        return mine, other.accept()


class Running(OnLoop):
    """Both services."""

    def __init__(
        self,
        line: Line,
        *,
        log: Path | None = None,
        limits: WirelessLimits | None = None,
        speed: float = 1.0,
        tells_truth: bool = True,
        strict: bool = False,
        owners: dict[str, str] | None = None,
        com_limits: ComServerLimits | None = None,
        looks_again: bool = False,
        **radio: object,
    ) -> None:
        self.line, self.time = line, 0.0
        self.owners = owners or {}
        options = read_radio({"patience": 0.1, "cache_distance": 0, **radio}, "test")
        world = RadioWorld(line.stations, line, lambda: self.time, speed)
        record = EventLog(log, world.clock)

        def network() -> Network:
            return Network(world, options.model, patience=options.patience, log=record)

        def truth(lines: list[bytes]) -> list[bytes]:
            return [b"TRUTH " + text + b"\r\n" for text in lines]

        limits = limits or WirelessLimits(poll=POLL)
        self.wireless = WirelessService(
            "127.0.0.1",
            0,
            network(),
            Desk("wireless", truth, limits) if tells_truth else None,
            link_options=LinkOptions(options.shape, speed),
            limits=limits,
            owners=lambda: self.owners,
            strict=strict,
            looks_again=looks_again,
        )
        self.comserver = ComServerService(
            "127.0.0.1",
            0,
            network(),
            limits=com_limits or ComServerLimits(poll=POLL),
            owners=lambda: self.owners,
        )
        super().__init__(self.wireless, self.comserver)
        self.port, self.com_port = (endpoint.port for endpoint in self.begin())

    def talker(self) -> Talker:
        """A new control connection of the wireless simulation."""
        made = Talker(self.port)
        self.clients.append(made.socket)
        return made

    def com_talker(self) -> Talker:
        """A new control connection of the ComServer."""
        made = Talker(self.com_port)
        self.clients.append(made.socket)
        return made

    def robot(self, name: str, listeners: int = 1) -> Robot:
        """A registered robot."""
        return Robot(self, name, listeners)


def received(end: socket.socket, size: int) -> bytes:
    """So many bytes, or what there is until the end."""
    data = b""
    while len(data) < size and (chunk := end.recv(65536)):
        data += chunk
    return data


def refuses(port: int) -> bool:
    """Whether nobody listens on a port."""
    try:
        socket.create_connection(("127.0.0.1", port), timeout=PATIENCE).close()
    except ConnectionRefusedError:
        return True
    return False


def closed(end: socket.socket) -> bool:
    """Whether the other side has hung up or is lost."""
    with contextlib.suppress(ConnectionError):
        return end.recv(65536) == b""
    return True


def stuff(end: socket.socket) -> int:
    """Send until nothing more is taken; returns how many bytes were."""
    end.settimeout(0.3)
    sent = 0
    with contextlib.suppress(TimeoutError):
        while sent < ENOUGH:
            sent += end.send(b"x" * 65536)
    return sent


ENOUGH = 32 * 1024 * 1024
