"""Clients of the side channels that talk in lines and messages: ground truth, wireless simulation,
ComServer, USARTruth."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import dataclass
from typing import Self

from usarsim_client.connection import Connection
from usarsim_client.inbox import ProtocolError
from usarsim_client.side_channels import road
from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import Robot
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Failed, Inconclusive, NotApplicable
from usarsim_conformance.wire import Hangup, Wire

STATION = "ComStation"
"""Class of the static communication station (side channels reference 4.4)."""

WITHIN = 10.0
"""s of simulated time for a line."""
CARRIES = 30.0
"""s of simulated time for what a relay has to carry."""
LEAVES = 6.0
"""s of simulated time until a hangup, or a robot that left, must be known everywhere; the original
looks once per second (side channels reference 4.6)."""
_ANSWERS = 40
"""Answers of a wireless simulation during which it must have looked."""
_CALM = 0.25  # s of wall time before each of these questions


async def dropped(wire: Wire, witness: LineClient) -> bool:
    """Whether the wireless simulation hangs up on who is not in the simulator.

    It is a program of its own that looks by the clock on the wall, and simulated seconds may pass
    in an instant. So it counts as blind only when it has answered a registered witness again and
    again, as it does in the same loop as it looks, and simulated time has passed besides: one that
    is held up answers late, too.
    """
    for _ in range(_ANSWERS):
        if await wire.hung_up(0.0):
            return True
        await asyncio.sleep(_CALM)
        await witness.ask("GETSS {Robot Nobody?}")
    return await wire.hung_up(LEAVES)


def split_reply(line: str) -> tuple[str, list[dict[str, str]]]:
    """Type and groups of a reply, as the splitter of the wireless program finds them.

    One blank and a brace behind the type; exactly one character between groups; words inside a
    group parted by single blanks, taken in pairs. Whatever stands behind the first surprise is
    lost (side channels reference 3.4).
    """
    kind, blank, rest = line.partition(" ")
    groups: list[dict[str, str]] = []
    while blank and rest.startswith("{"):
        inner, brace, rest = rest[1:].partition("}")
        words = inner.split(" ")
        if not brace or len(words) % 2:
            break
        groups.append(dict(zip(words[0::2], words[1::2], strict=True)))
        rest = rest[1:]
    return kind, groups


class LineClient:
    """A connection on which lines end with CR LF.

    Attributes:
        wire: the connection.
    """

    def __init__(self, wire: Wire) -> None:
        self.wire = wire

    @classmethod
    async def open(cls, case: Case, service: str, label: str = "") -> LineClient:
        """Connect to a service."""
        return cls(await case.open(service, label))

    async def send(self, text: str, end: str = "\r\n") -> None:
        """Send a line."""
        await self.wire.send((text + end).encode("latin-1"))

    async def line(self, within: float | None = None) -> str:
        """The next line without its CR LF.

        Raises:
            Failed: if none comes in time, or it ends otherwise.
            Hangup: if the server hung up.
        """
        data = await self.wire.read_until(b"\r\n", WITHIN if within is None else within)
        text = data[:-2].decode("latin-1")
        if "\n" in text or "\r" in text:
            raise Failed(
                f"a line has a bare CR or LF within, not only CR LF at its end: {text[:120]!r}"
            )
        return text

    async def ask(self, text: str, within: float | None = None) -> str:
        """Send a line and read one."""
        await self.send(text)
        return await self.line(within)

    async def expect(self, text: str, wanted: str) -> None:
        """Fail unless a line is answered by exactly another."""
        answer = await self.ask(text)
        if answer != wanted:
            raise Failed(f"{text!r} was answered by {answer!r}, not by {wanted!r}")

    async def silent(self, seconds: float, after: str) -> None:
        """Fail if anything comes within a time, or the server hangs up."""
        data = await self.wire.silence(seconds)
        if data:
            raise Failed(f"{data[:120]!r} came after {after}, not nothing")


async def static_station(case: Case, location: tuple[float, ...] | None = None) -> Robot:
    """A communication station, at a free place or at coordinates beside one.

    Raises:
        NotApplicable: if the server has none.
    """
    try:
        if location is None:
            return await case.spawn(class_name=STATION)
        place = await case.place()
        text = ",".join(f"{value:.6f}" for value in location)
        name = case.new_name()
        client = await case.connect()
        await client.send(
            f"INIT {{ClassName USARBot.{STATION}}} {{Name {name}}} {{Location {text}}}"
        )
        first = await client.maybe("STA", PATIENCE)
    except Inconclusive:
        first = None
    if first is None:
        raise NotApplicable(f"no {STATION} can be spawned")
    return Robot(client, name, STATION, place, first)


@dataclass
class Guest:
    """A connection that the wireless simulation made to a robot."""

    wire: Wire

    async def read(self, count: int) -> bytes:
        """So many bytes, or fewer at the end of the stream or of the time."""
        data, moment = b"", self.wire.clock.after(CARRIES)
        with contextlib.suppress(Hangup):
            while len(data) < count and (part := await self.wire.read_by(moment)):
                data += part
        return data

    async def hung_up(self) -> bool:
        """Whether the connection ends in time."""
        return await self.wire.hung_up(LEAVES)


class Peer:
    """A robot in the simulator that listens for connections which the server makes.

    Attributes:
        robot: in the simulator.
        name: of it.
        wire: its connection to the service.
        port: that it listens on.
        guests: connections that the server has made.
    """

    def __init__(self, case: Case, robot: Robot, wire: Wire, server: asyncio.Server) -> None:
        self._case = case
        self.robot = robot
        self.name = robot.name
        self.wire = wire
        self._server = server
        self.port = int(server.sockets[0].getsockname()[1])
        self.guests: asyncio.Queue[Guest] = asyncio.Queue()
        self._open: list[Connection] = []

    @classmethod
    async def arrive(cls, case: Case, service: str, place: Place | None = None) -> Self:
        """Connect to a service, spawn a robot, listen; `close` it, or use it in `async with`.

        Args:
            case: the check.
            service: to connect to.
            place: of the robot; a free one by default.
        """
        wire = await case.open(service)
        robot = await case.spawn(place=place)
        made: list[Self] = []

        async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            made[0]._open.append(connection := Connection(reader, writer))
            guest = Wire(connection, case.transcript, "guest", case.clock)
            made[0].guests.put_nowait(Guest(guest))

        server = await asyncio.start_server(take, wire.local_address, 0)
        made.append(cls(case, robot, wire, server))
        return made[0]

    async def guest(self) -> Guest:
        """The next connection that the server makes.

        Raises:
            Failed: if none comes in time.
        """
        coming = asyncio.create_task(self.guests.get())
        clock = self._case.clock
        if await clock.wait(coming, clock.after(WITHIN)):
            return coming.result()
        coming.cancel()
        raise Failed(f"the server did not connect to port {self.port} of {self.name}")

    def deaf(self) -> None:
        """Stop listening."""
        self._server.close()

    def close(self) -> None:
        """Hang up everything."""
        self._server.close()
        for connection in self._open:
            connection.close()
        self.wire.close()

    async def __aenter__(self) -> Self:
        """Use as a context manager."""
        return self

    async def __aexit__(self, *ignored: object) -> None:
        self.close()


class Radio(Peer):
    """A robot in the simulator that is registered with the wireless simulation.

    Attributes:
        client: its connection to the wireless simulation.
    """

    def __init__(self, case: Case, robot: Robot, wire: Wire, server: asyncio.Server) -> None:
        super().__init__(case, robot, wire, server)
        self.client = LineClient(wire)
        self._calls: list[Wire] = []

    @classmethod
    async def make(cls, case: Case, *, register: bool = True, place: Place | None = None) -> Radio:
        """Spawn a robot, at a free place by default, listen, and register."""
        radio = await cls.arrive(case, "wireless", place)
        if register:
            await radio.register()
        return radio

    async def register(self) -> None:
        """Send INIT.

        Raises:
            Failed: if it is refused.
        """
        await self.client.expect(
            f"INIT {{Robot {self.name}}} {{Port {self.port}}}", "INITREPLY {Status OK}"
        )

    async def road(self, other: Radio, extra: str = "") -> int:
        """Port of the wireless simulation that leads to another robot.

        Raises:
            Failed: if none is told.
        """
        answer = await self.client.ask(f"DNS {{Robot {other.name}}}{extra}")
        try:
            port = road(answer, other.name)
        except ProtocolError as error:
            raise Failed(str(error)) from None
        if port <= 0:
            raise Inconclusive(f"the robots are out of reach of each other: {answer!r}")
        return port

    async def call(self, other: Radio) -> tuple[Wire, Guest]:
        """Connect to another robot: the ends of both.

        Raises:
            Failed: if the other end gets no connection.
        """
        port = await self.road(other)
        return await self.dial(port), await other.guest()

    async def dial(self, port: int) -> Wire:
        """Connect to a port of the wireless simulation.

        Raises:
            Failed: if nobody accepts.
        """
        case = self._case
        wire = await Wire.open(case.target.host, port, case.transcript, "relay", case.clock)
        self._calls.append(wire)
        return wire

    def close(self) -> None:
        """Hang up everything."""
        super().close()
        for wire in (*self._calls, self.client.wire):
            wire.close()


class MessageClient(LineClient):
    """A control connection, on which messages end with a semicolon."""

    @classmethod
    async def open(cls, case: Case, service: str = "comserver", label: str = "") -> MessageClient:
        """Connect."""
        return cls(await case.open(service, label))

    async def send(self, text: str, end: str = ";") -> None:
        """Send a message."""
        await super().send(text, end)

    async def line(self, within: float | None = None) -> str:
        """The next answer without its semicolon, line ends in it included.

        Raises:
            Failed: if none comes in time.
            Hangup: if the server hung up.
        """
        data = await self.wire.read_until(b";", WITHIN if within is None else within)
        return data[:-1].decode("latin-1")


class Member(Peer):
    """A robot in the simulator that is registered with ComServer.

    Attributes:
        client: its control connection.
    """

    @property
    def client(self) -> MessageClient:
        """Its control connection."""
        return MessageClient(self.wire)

    @classmethod
    async def make(cls, case: Case, *, listen: bool = False) -> Member:
        """Spawn a robot and register it.

        Args:
            case: the check.
            listen: whether it accepts a link.

        Raises:
            Failed: if it is refused.
        """
        member = await cls.arrive(case, "comserver")
        await member.client.expect(member.registration, "OK")
        if listen:
            await member.listen()
        return member

    @property
    def registration(self) -> str:
        """The message that registers it."""
        return f"REGISTER {self.name} {self.wire.local_address}"

    async def listen(self) -> None:
        """Accept a link on its port.

        Raises:
            Failed: if it is refused.
        """
        await self.client.expect(f"LISTEN {self.name} {self.port}", "OK")

    async def link(self, other: Member) -> tuple[Guest, Guest]:
        """A data link with another one that listens: the ends of both.

        Raises:
            Failed: if it is refused, or the server does not dial both.
            Inconclusive: if they are out of reach of each other.
        """
        answer = await self.client.ask(f"OPEN {self.name} {self.port} {other.name} {other.port}")
        if answer.startswith("Fail: Cannot connect"):
            raise Inconclusive(f"the robots are out of reach of each other: {answer!r}")
        if answer != "OK":
            raise Failed(f"OPEN was answered by {answer!r}, not by 'OK'")
        return await self.guest(), await other.guest()
