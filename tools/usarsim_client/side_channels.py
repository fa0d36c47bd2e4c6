"""Radio (port 50000) and ground truth (ports 3989 and 7435): one question, one answer.

The answers are those of side channels reference 4 and 6.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_client.commands import say, segment
from usarsim_client.connection import AsyncClosing, Connection
from usarsim_client.inbox import Line, ProtocolError
from usarsim_client.link import Address
from usarsim_client.segments import Item, boolean, number, read, vector
from usarsim_server.base.addresses import bare_host
from usarsim_server.protocol.values import Vector

_ROAD = re.compile(r"DNSREPLY \{Robot ([^{}]*)\} \{Port (-?\d+)\}")


def road(answer: Line | str, name: str) -> int:
    """Port of the wireless simulation that leads to a robot, by the answer to DNS; 0 or less if
    there is none, or it is out of reach.

    Raises:
        ProtocolError: if it is no such answer.
    """
    found = _ROAD.match(str(answer))
    if found is None or found[1] != name:
        raise ProtocolError(f"no DNSREPLY with a port: {str(answer)!r}")
    return int(found[2])


@dataclass(frozen=True, slots=True)
class Actor:
    """A line of the truth port.

    Attributes:
        name: of the actor. class_name: of it, as told.
        time: simulated s.
        location: m. rotation: roll, pitch, yaw, rad; both in the frame of the wire.
    """

    name: str
    class_name: str
    time: float
    location: tuple[float, ...]
    rotation: tuple[float, ...]


def actor(line: Line) -> Actor | None:
    """The actor that a line of a listing tells of; None at its end."""
    if line.text == "{End}":
        return None
    return Actor(
        line.get("Name", "") or "",
        line.get("Class", "") or "",
        line.time,
        line.numbers("Location"),
        line.numbers("Rotation"),
    )


class RadioError(ProtocolError):
    """The wireless simulation refused a request; tells its reason."""


class _Asker(AsyncClosing):
    """A connection on which one question is asked at a time; made when it is needed."""

    def __init__(self, address: Address) -> None:
        self.address = address
        self._connection: Connection | None = None
        self._asking = asyncio.Lock()

    async def _ask(self, request: bytes) -> list[Line]:
        """Send a question and read its answer."""
        async with self._asking:
            if self._connection is None:
                self._connection = await self.address.open()
            try:
                async with self.address.patience("no answer"):
                    await self._connection.send(request)
                    return await self._answer(self._connection)
            except BaseException:
                self._hang_up()  # what comes late is no answer to the next question
                raise

    async def _answer(self, connection: Connection) -> list[Line]:
        return [await connection.line()]

    async def close(self) -> None:
        """Hang up."""
        self._hang_up()

    def _hang_up(self) -> None:
        if self._connection is not None:
            self._connection.abort()
        self._connection = None


class Radio(_Asker):
    """A robot's place in the wireless simulation: who hears whom, and the roads between them.

    The connection is the registration: closed, the robot is gone from the radio. A request that
    failed ends it; the next one registers the robot again. What the simulation refuses, for
    example because there is no such robot, raises `RadioError`.
    """

    def __init__(self, address: Address, name: str) -> None:
        super().__init__(address)
        self.name = name
        self._registration = b""

    async def register(self, ports: Sequence[int]) -> None:
        """Enter the radio under the name of the robot; ports: where this program listens."""
        listed = ",".join(map(str, ports))
        registration = say("INIT", Robot=self.name, Port=listed)
        await self._request(registration, "INITREPLY")
        self._registration = registration

    async def close(self) -> None:
        """Hang up; the robot is gone from the radio."""
        self._registration = b""
        await super().close()

    async def strength(self, other: str) -> float:
        """How strong another robot is heard here, dBm."""
        line = await self._request(say("GETSS", Robot=other), "SS")
        return number(line.get("Strength") or "")

    async def road(self, other: str, port: int | None = None) -> int:
        """Port of the wireless server that leads to another robot; 0 or less: out of reach."""
        return road(await self._request(say("DNS", Robot=other, Port=port), "DNSREPLY"), other)

    async def caller(self, port: int) -> str:
        """Whose connection comes from a port of the wireless server."""
        line = await self._request(say("REVERSEDNS", Port=port), "REVERSEDNSREPLY")
        return line.get("Robot") or ""

    async def dial(self, other: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Connect to another robot's program.

        Raises:
            RadioError: if it is out of reach.
            OSError: if it does not accept.
        """
        port = await self.road(other)
        if port <= 0:
            raise RadioError(f"{other} is out of reach of {self.name}")
        async with self.address.patience(f"no way to {other}"):
            return await asyncio.open_connection(bare_host(self.address.host), port)

    async def _request(self, request: bytes, head: str) -> Line:
        if self._connection is None and (registration := self._registration):
            self._registration = b""
            try:
                await self._request(registration, "INITREPLY")
            except RadioError:
                self._hang_up()  # the next request tries again
                raise
            finally:
                self._registration = registration
        (line,) = await self._ask(request)
        reason = line.get("Error") or (
            None if line.head == head else line.get("Reason") or str(line)
        )
        if reason is not None:
            asked = request.decode("latin-1").strip()
            raise RadioError(f"{reason}, in answer to {asked}")
        return line


@dataclass(frozen=True, slots=True)
class Position:
    """A robot as the ground truth port tells of it. location: m. battery_empty: it is dead."""

    name: str
    location: Vector
    battery_empty: bool


class GroundTruthPort(_Asker):
    """Port 7435: where all robots are, and what is between two places."""

    async def positions(self) -> tuple[Position, ...]:
        """All robots, in the order in which they came."""
        (line,) = await self._ask(say("GETPOS"))
        return tuple(map(_position, filter(_named, read(line.raw).items())))

    async def obstacles(self, a: str | Vector, b: str | Vector) -> int:
        """How many obstacles are between two robots, or two places (m).

        Raises:
            ProtocolError: if the server cannot say, for example because there is no such robot.
        """
        if isinstance(a, str) and isinstance(b, str):
            ends = segment("From", a), segment("To", b)
        else:
            ends = segment("Start", a), segment("End", b)
        (line,) = await self._ask(say("GETOBS", *ends))
        count = line.numbers("ObstCount")[0]
        if not count >= 0.0:
            raise ProtocolError(f"nobody knows what is between {a} and {b}")
        return int(count)


def _named(item: Item) -> bool:
    return bool(item.name)


def _position(item: Item) -> Position:
    fields = item.fields
    place = vector(fields.get("location", ""))
    return Position(item.name, place, boolean(fields.get("batteryempty", "")))


class TruthPort(_Asker):
    """Port 3989: true poses of robots, victims, objects, items, as scoring tools ask for them."""

    async def actors(self, class_name: str = "", name: str = "") -> tuple[Actor, ...]:
        """Robots, victims and avatars; with a class or a name those that it means."""
        query = []
        if class_name:
            query.append(segment("class", class_name))
        if name:
            query.append(segment("name", name))
        lines = await self._ask((" ".join(query) + "\r\n").encode("latin-1"))
        return tuple(one for one in map(actor, lines) if one is not None)

    async def _answer(self, connection: Connection) -> list[Line]:
        lines = [await connection.line()]
        while lines[-1].text != "{End}":
            lines.append(await connection.line())
        return lines
