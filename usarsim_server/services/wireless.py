"""The wireless simulation server: robots register, ask how strong they hear others, and talk to
them through ports that are open only while the radio reaches, TCP 50000 (side channels 4).

A connection whose first line is GETPOS or GETOBS is that of a wireless simulation elsewhere, which
wants to know where everybody is; it is answered as on port 7435 (side channels 1, no. 3).
"""

from __future__ import annotations

import asyncio
import contextlib
import resource
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from usarsim_server.errors import UsarsimError
from usarsim_server.logs import Log
from usarsim_server.protocol import wireless
from usarsim_server.protocol.framing import LineFramer
from usarsim_server.protocol.wireless import Reason, Request
from usarsim_server.radio.event_log import Event
from usarsim_server.radio.network import Departure, Network
from usarsim_server.services.limits import READ_COST, InputRates, input_cost
from usarsim_server.services.listener import Endpoint, Listener, ListenerLimits
from usarsim_server.services.radio_watch import RadioWatch
from usarsim_server.services.relay import Road
from usarsim_server.services.relay_port import RelayPort

__all__ = ["TruthAnswers", "WirelessLimits", "WirelessService", "raise_descriptor_limit"]

_CHUNK = 2048
DESCRIPTORS = 8192
"""Open files that a large team may need: two for each link, one for each pair that asked."""


class TruthAnswers(Protocol):
    """Answers GETPOS and GETOBS; may wait for a physics step."""

    def __call__(self, lines: Sequence[str], /) -> Sequence[str]:
        """Replies to requests that came together, without line ends."""


@dataclass(frozen=True, slots=True)
class WirelessLimits:
    """What robots may use.

    Attributes:
        max_connections: control connections at a time.
        ports: relay ports at a time; beyond it DNS fails as in a system without free ports.
        ports_per_robot: of these for one asking robot.
        poll: s of wall time between two looks at the world.
        rate: requests per wall s of one client in the long run; it is read no faster.
    """

    max_connections: int = 64
    ports: int = 2048
    ports_per_robot: int = 256
    poll: float = 0.25
    rate: float = 1000.0


@dataclass(slots=True, eq=False)
class _Member:
    """A registered robot."""

    name: str
    address: str
    ports: tuple[int, ...]
    client: socket.socket
    roads: dict[tuple[str, int], RelayPort] = field(default_factory=dict)
    """Relay ports by the robot and the port that they lead to."""
    callers: dict[int, str] = field(default_factory=dict)
    """Names of those who are connected to this robot, by the port its connections come from."""


class WirelessService:
    """Control dialogue, relay ports, and the watch over which of them are open."""

    name = "wireless"

    def __init__(
        self,
        host: str,
        port: int,
        network: Network,
        truth: TruthAnswers,
        *,
        road: Road | None = None,
        limits: WirelessLimits | None = None,
        required: bool = False,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            host: address to listen on, for relay ports, too.
            port: 0 takes any free one.
            network: stations and links; used by this service alone.
            truth: answers what is asked on port 7435.
            road: what happens to traffic.
            limits: see there.
            required: whether the server shall not run without it.
        """
        self.required = required
        self._network = network
        self._truth = truth
        self._road = road or Road()
        self._limits = limits or WirelessLimits()
        self._rates = InputRates(self._limits.rate)
        self._log = Log(self.name)
        self._members: dict[str, _Member] = {}
        self._links: set[asyncio.Task[None]] = set()
        self._sent: dict[tuple[str, str], int] = {}
        self._watch = RadioWatch(
            self.name, network, self._limits.poll, lambda: bool(self._members), self._review
        )
        self._host = host
        self._listener = Listener(
            self.name,
            host,
            port,
            self._serve,
            option="--wireless-port",
            limits=ListenerLimits(max_connections=self._limits.max_connections),
        )

    @property
    def registered(self) -> tuple[str, ...]:
        """Names of all registered robots."""
        return tuple(self._members)

    async def start(self) -> Endpoint:
        """Open the port.

        Raises:
            ServiceError: if it cannot be opened.
        """
        endpoint = await self._listener.start()
        # Relay ports go where this one is: a host name may have several addresses.
        self._host = endpoint.host
        raise_descriptor_limit()
        self._watch.start()
        return endpoint

    async def stop(self) -> None:
        """Close the port, all connections and all links."""
        await self._watch.stop()
        await self._listener.stop()
        for link in self._links:
            link.cancel()
        await asyncio.gather(*self._links, return_exceptions=True)
        self._network.log.close()

    # -- the dialogue ----------------------------------------------------------------------------

    async def _serve(self, client: socket.socket, peer: str) -> None:
        log = self._log.bind(connection=peer)
        loop = asyncio.get_running_loop()
        framer = LineFramer(wireless.MAX_LINE)
        talk = _Talk(client, client.getpeername()[0])
        allowance = self._rates.newcomer()
        try:
            while chunk := await loop.sock_recv(client, _CHUNK):
                lines = framer.feed(chunk)
                if not lines:
                    await asyncio.sleep(self._rates.charge(allowance, READ_COST))
                    continue
                if talk.truth is None:
                    talk.truth = wireless.asks_for_ground_truth(lines[0])
                    log.info("client connected", ground_truth=talk.truth)
                if talk.truth:
                    reply = await asyncio.to_thread(self._tell_truth, lines)
                else:
                    reply = b"".join([await self._answer(line, talk) for line in lines])
                await loop.sock_sendall(client, reply)
                # Neither call yields while there is data and room.
                await asyncio.sleep(self._rates.charge(allowance, input_cost(lines, len(lines))))
        except UsarsimError as error:
            log.warning("connection closed: the simulation has ended", reason=error)
        finally:
            if talk.member is not None:
                self._deregister(talk.member)
            log.info("client gone")

    def _tell_truth(self, lines: list[bytes]) -> bytes:
        replies = self._truth([line.decode("latin-1") for line in lines])
        return b"".join(map(wireless.encode, replies))

    async def _answer(self, line: bytes, talk: _Talk) -> bytes:
        request = wireless.parse_request(line)
        me = talk.member
        if me is None:
            reply = await self._init(request, talk)
        elif self._members.get(me.name) is not me:
            raise ConnectionAbortedError("dismissed")
        elif request.verb in ("INIT", "") or request.verb not in _VERBS:
            reply = wireless.error_reply(Reason.UNKNOWN)
        elif request.error is not None:
            reply = wireless.error_reply(request.error)
        elif request.verb == "GETSS":
            reply = self._strength(me, request.robot)
        elif request.verb == "DNS":
            reply = self._lookup(me, request)
        else:
            reply = self._reverse_lookup(me, request.port or 0)
        return wireless.encode(reply)

    async def _init(self, request: Request, talk: _Talk) -> str:
        if request.verb != "INIT":
            return wireless.error_reply(Reason.INIT_FIRST)
        if request.error is not None:
            return wireless.error_reply(request.error)
        name, now = request.robot, asyncio.get_running_loop().time()
        if not self._network.register(name, now):
            return wireless.error_reply(Reason.NAME_TAKEN)
        talk.member = _Member(name, talk.address, request.ports, talk.client)
        self._members[name] = talk.member
        ports = ";".join(map(str, request.ports))
        self._network.log.write(Event.REGISTERED, name, talk.address, ports)
        self._log.info("registered", robot=name)
        # Nobody may have looked for a long time.
        await self._watch.look()
        self._review()
        self._watch.wake()
        return wireless.INIT_OK

    def _strength(self, me: _Member, other: str) -> str:
        if other == me.name:
            return wireless.strength_reply(other, 0.0, oneself=True)
        if other not in self._members:
            return wireless.unknown_robot_reply(other)
        return wireless.strength_reply(other, self._network.strength(me.name, other))

    def _lookup(self, me: _Member, request: Request) -> str:
        other = self._members.get(request.robot)
        if other is None or other is me:
            return wireless.no_port_reply(request.robot, known=False)
        port = request.port if request.port is not None else next(iter(other.ports), None)
        if port is None or port not in other.ports:
            return wireless.no_port_reply(other.name, known=True)
        road = me.roads.get((other.name, port))
        if road is None:
            road = self._new_road(me, other, port)
        if road is None:
            return wireless.error_reply(Reason.NO_PORT_LEFT)
        return wireless.port_reply(other.name, road.port)

    def _reverse_lookup(self, me: _Member, port: int) -> str:
        caller = me.callers.get(port)
        return (
            wireless.no_owner_reply(port) if caller is None else wireless.owner_reply(port, caller)
        )

    # -- roads -----------------------------------------------------------------------------------

    def _new_road(self, me: _Member, other: _Member, port: int) -> RelayPort | None:
        roads = sum(len(member.roads) for member in self._members.values())
        if len(me.roads) >= self._limits.ports_per_robot or roads >= self._limits.ports:
            self._log.warning("no relay port left", robot=me.name, ports=roads)
            return None
        watcher = _Watcher(self, me, other, port)
        name = f"{me.name}>{other.name}:{port}"
        try:
            road = RelayPort(
                self._host, (other.address, port), self._road, name, watcher, self._links
            )
        except OSError as error:
            self._log.warning("no relay port left", robot=me.name, reason=error.strerror)
            return None
        me.roads[other.name, port] = road
        if self._network.connected(me.name, other.name):
            road.open()
        return road

    def _deregister(self, member: _Member) -> None:
        """Forget a robot and close every road from and to it; a second call does nothing."""
        if self._members.get(member.name) is not member:
            return
        del self._members[member.name]
        self._network.deregister(member.name)
        for road in member.roads.values():
            road.release()
        for other in self._members.values():
            for way in [way for way in other.roads if way[0] == member.name]:
                other.roads.pop(way).release()
        self._network.log.write(Event.DEREGISTERED, member.name)

    def note_sent(self, sender: str, receiver: str, size: int) -> None:
        """Count bytes that were handed on, for the record."""
        pair = (sender, receiver)
        self._sent[pair] = self._sent.get(pair, 0) + size

    def record(self, event: Event, *fields: object) -> None:
        """Put an event on record."""
        self._network.log.write(event, *fields)

    # -- the watch -------------------------------------------------------------------------------

    def _review(self) -> None:
        for departure in self._network.review(asyncio.get_running_loop().time()):
            self._dismiss(departure)
        for me in self._members.values():
            for (other, _), road in me.roads.items():
                if self._network.connected(me.name, other):
                    road.open()
                else:
                    road.close()
        for pair, size in self._sent.items():
            self._network.log.write(Event.DATA_SENT, *pair, size)
        self._sent.clear()
        self._network.log.flush()

    def _dismiss(self, departure: Departure) -> None:
        member = self._members[departure.name]
        if departure.battery_empty:
            self._network.log.write(Event.OUT_OF_BATTERY, member.name)
        reason = "battery empty" if departure.battery_empty else "not in the simulator"
        self._log.info("robot dismissed", robot=member.name, reason=reason)
        self._deregister(member)
        with contextlib.suppress(OSError):
            member.client.shutdown(socket.SHUT_RDWR)  # wakes whoever reads or writes


_VERBS = frozenset({"GETSS", "DNS", "REVERSEDNS"})


@dataclass(slots=True, eq=False)
class _Talk:
    """The state of one control connection: whose, and of which kind once that is known."""

    client: socket.socket
    address: str
    truth: bool | None = None
    member: _Member | None = None


class _Watcher:
    """Keeps account of the links from one robot to one port of another."""

    def __init__(
        self, service: WirelessService, source: _Member, target: _Member, port: int
    ) -> None:
        self._record = partial(service.record)
        self._note = service.note_sent
        self._source, self._target = source, target
        self._facts = (source.name, target.name, target.address, port)

    def dialled(self, port: int) -> None:
        self._target.callers[port] = self._source.name

    def established(self) -> None:
        self._record(Event.CON_ESTABLISHED, *self._facts)

    def passed(self, forward: bool, size: int) -> None:
        ends = (self._source.name, self._target.name)
        self._note(*(ends if forward else ends[::-1]), size)

    def ended(self, port: int, established: bool) -> None:
        self._target.callers.pop(port, None)
        if established:
            self._record(Event.CON_TERMINATED, *self._facts)


def raise_descriptor_limit(wanted: int = DESCRIPTORS) -> None:
    """Let the process open as many files as it may, up to a number; never lowers the limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
