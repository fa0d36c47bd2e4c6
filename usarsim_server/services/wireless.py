"""The wireless simulation server: robots register, ask how strong they hear others, and talk to
them through ports that are open only while the radio reaches, TCP 50000 (side channels 4).

A connection whose first line is GETPOS or GETOBS is that of a wireless simulation elsewhere, which
wants to know where everybody is; it is answered as on port 7435 (side channels 1, no. 3), unless
nobody shall know.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.protocol import wireless
from usarsim_server.protocol.grammar import LineFramer
from usarsim_server.protocol.opening import Opening
from usarsim_server.protocol.values import name_key
from usarsim_server.protocol.wireless import Reason, Request
from usarsim_server.radio.event_log import Event
from usarsim_server.radio.network import Departure, Network
from usarsim_server.services.budget import HOP_COST, Account
from usarsim_server.services.dialogue import (
    CHUNK,
    CHUNK_BYTES,
    Desk,
    DialogueLimits,
    dialogue_bytes,
)
from usarsim_server.services.limits import input_cost
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.owners import NOBODY, Owners, same_machine
from usarsim_server.services.port import Guest, PortService, refuse
from usarsim_server.services.relay import (
    LinkOptions,
    RadioWatch,
    Traffic,
    cancel_all,
    descriptor_limit,
    raise_descriptor_limit,
)
from usarsim_server.services.relay_port import RelayPort
from usarsim_server.services.replies import PIECE, ReplyBuffer


@dataclass(frozen=True, slots=True, kw_only=True)
class WirelessLimits(DialogueLimits):
    """What robots, and those who ask for ground truth, may use."""

    ports: int = 1024
    """Relay ports at a time; beyond it DNS fails as in a system without free ports."""
    ports_per_robot: int = 128  # of these for one asking robot
    links: int = 512
    """Connections through relay ports at a time; beyond it they end as they are made. A link takes
    two descriptors, a port one; of all that the process may have ports and links get half."""
    links_per_robot: int = 64  # of these for one that dials
    poll: float = 0.25  # s of wall time between two looks at the world

    @property
    def held_bytes(self) -> int:
        """Bytes that a connection can make the server hold, without links and kernel buffers."""
        robots = wireless.MAX_LINE + CHUNK_BYTES + 2 * PIECE + _MEMBER_BYTES
        return max(robots, wireless.MAX_LINE + dialogue_bytes(self))

    def link_bytes(self, link_options: LinkOptions) -> int:
        """Bytes, those of the kernel included, that the links of one robot can hold."""
        return self.links_per_robot * (link_options.held_bytes + link_options.kernel_bytes)


_MEMBER_BYTES = 64 * 1024
"""A registered robot with its ports and all relay ports that it may have."""


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


class WirelessService(PortService[WirelessLimits]):
    """Control dialogue, relay ports, and the watch over which of them are open."""

    def __init__(
        self,
        host: str,
        port: int,
        network: Network,
        truth: Desk | None = None,
        *,
        link_options: LinkOptions | None = None,
        limits: WirelessLimits | None = None,
        required: bool = False,
        owners: Owners = NOBODY,
        strict: bool = False,
        looks_again: bool = False,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            host, port, limits, required: see `PortService`; relay ports have the same host.
            network: stations and links; used by this service alone.
            truth: answers what is asked on port 7435; None: nobody does.
            link_options: what happens to traffic.
            owners: whose the robots are.
            strict: only a robot that is in the world may be registered, once, and from the machine
                of its control connection. Otherwise a name of which there is no robot is
                everybody's until there is one.
            looks_again: a signal is told of the instant at which it is asked for, not of the last
                look: in lockstep, where answers shall not depend on the clock on the wall.
        """
        limits = limits or WirelessLimits()
        super().__init__("wireless", host, port, "--wireless-port", limits, required)
        self._network = network
        self._link_options = link_options or LinkOptions()
        self._desk = truth or Desk(self.name, _nothing, self._limits)
        self._tells_truth = truth is not None
        self._owners_now = owners
        self._owners: Mapping[str, str] = {}
        self._strict, self._looks_again = strict, looks_again
        self._traffic = Traffic(self._limits.links, self._limits.links_per_robot)
        self._most_ports = self._limits.ports
        self._members: dict[str, _Member] = {}
        self._links: set[asyncio.Task[None]] = set()
        self._sent: dict[tuple[str, str], int] = {}
        """Bytes handed on since the last look, for the record."""
        self._watch = RadioWatch(
            self.name, network, self._limits.poll, lambda: bool(self._members), self._review
        )
        self._host = host

    async def start(self) -> Endpoint:
        endpoint = await super().start()
        # Relay ports go where this one is: a host name may have several addresses.
        self._host = endpoint.host
        raise_descriptor_limit()
        ours = descriptor_limit() // 2
        self._most_ports = min(self._limits.ports, ours // 2)
        self._traffic.most = min(self._limits.links, ours // 4)
        self._watch.start()
        return endpoint

    async def stop(self) -> None:
        await self._watch.stop()
        await super().stop()
        await cancel_all(self._links)
        self._desk.close()
        self._network.log.close()

    # -- the dialogue ----------------------------------------------------------------------------

    async def _serve(self, client: socket.socket, peer: str) -> None:
        log = self._log.bind(connection=peer)
        talk = _Talk(client, client.getpeername()[0], self._desk.budget.newcomer())
        try:
            with self._guests.enter(peer) as guest:
                guest.standing = partial(self._has_standing, talk)
                await self._converse(client, talk, guest, log)
        except UsarsimError as error:
            log.warning("connection closed: the simulation has ended", reason=error)
        finally:
            if talk.member is not None:
                self._deregister(talk.member)
            log.info("client gone")

    async def _converse(self, client: socket.socket, talk: _Talk, guest: Guest, log: Log) -> None:
        loop, budget, account = asyncio.get_running_loop(), self._desk.budget, talk.account
        framer, replies = LineFramer(wireless.MAX_LINE), ReplyBuffer(client)
        allowance, opening = self._rates.newcomer(), Opening()
        while chunk := await loop.sock_recv(client, CHUNK):
            if foreign := opening.foreign(chunk):
                refuse(log, foreign)
                return
            await budget.turn(account)
            with budget.work(account):
                lines = framer.feed(chunk)
            if lines:
                if talk.truth is None:
                    asked = wireless.asks_for_ground_truth(lines[0])
                    talk.truth = self._tells_truth and asked
                    log.info("client connected", ground_truth=talk.truth)
                if talk.truth:
                    if await self._desk.answer(lines, replies, account):
                        self._guests.heard(guest)
                else:
                    await self._answer(lines, talk, replies)
                    self._guests.heard(guest)
            # Neither call yields while there is data and room.
            await asyncio.sleep(allowance.spend(input_cost(lines, len(lines))))

    async def _answer(self, lines: list[bytes], talk: _Talk, replies: ReplyBuffer) -> None:
        budget = self._desk.budget
        for number, line in enumerate(lines):
            if number:
                await budget.turn(talk.account)
            with budget.work(talk.account):
                request = wireless.parse_request(line)
            if self._looks_again and request.verb == "GETSS" and self._network.outdated:
                await self._watch.look()
            with budget.work(talk.account):
                reply = None if talk.member is None else self._reply(request, talk.member)
            if reply is None:
                reply = await self._init(request, talk)
            await replies.put(wireless.encode(reply))
        await replies.flush()

    def _reply(self, request: Request, me: _Member) -> str:
        if self._members.get(me.name) is not me:
            raise ConnectionAbortedError("dismissed")
        if request.verb in ("INIT", "") or request.verb not in _VERBS:
            return wireless.error_reply(Reason.UNKNOWN)
        if request.error is not None:
            return wireless.error_reply(request.error)
        if request.verb == "GETSS":
            return self._strength(me, request.robot)
        if request.verb == "DNS":
            return self._lookup(me, request)
        return self._reverse_lookup(me, request.port or 0)

    def _has_standing(self, talk: _Talk) -> bool:
        """Whether a client may listen in silence: its robot is in the world, or has links."""
        me = talk.member
        if me is None:
            return False
        return name_key(me.name) in self._owners or any(one.links for one in me.roads.values())

    async def _init(self, request: Request, talk: _Talk) -> str:
        if request.verb != "INIT":
            return wireless.error_reply(Reason.INIT_FIRST)
        if request.error is not None:
            return wireless.error_reply(request.error)
        name, now = request.robot, asyncio.get_running_loop().time()
        self._owners = self._owners_now()
        if not self._may_register(name, talk.address):
            self._log.warning("a name is not registered: the robot is another's", robot=name)
            return wireless.error_reply(Reason.NAME_TAKEN)
        squatter = self._members.get(name)
        if squatter is not None and self._is_foreign(squatter):
            self._dismiss(squatter, "the robot is another's")
        if not self._network.register(name, now):
            return wireless.error_reply(Reason.NAME_TAKEN)
        talk.member = _Member(name, talk.address, request.ports, talk.client)
        self._members[name] = talk.member
        ports = ";".join(map(str, request.ports))
        self._network.log.write(Event.REGISTERED, name, talk.address, ports)
        self._log.info("registered", robot=name)
        # Nobody may have looked for a long time.
        self._desk.budget.charge(talk.account, HOP_COST)
        await self._watch.look()
        self._review()
        self._watch.wake()
        return wireless.INIT_OK

    def _may_register(self, name: str, address: str) -> bool:
        owner = self._owners.get(name_key(name))
        if owner is None:
            return not self._strict
        if self._strict and name_key(name) in map(name_key, self._members):
            return False
        return same_machine(owner, address)

    def _is_foreign(self, member: _Member) -> bool:
        """Whether a robot has come since that is somebody else's."""
        owner = self._owners.get(name_key(member.name))
        return owner is not None and not same_machine(owner, member.address)

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
        road = me.roads.get((other.name, port)) or self._new_road(me, other, port)
        if road is None:
            return wireless.error_reply(Reason.NO_PORT_LEFT)
        return wireless.port_reply(other.name, road.port)

    def _reverse_lookup(self, me: _Member, port: int) -> str:
        if port in me.callers:
            return wireless.owner_reply(port, me.callers[port])
        return wireless.no_owner_reply(port)

    # -- roads -----------------------------------------------------------------------------------

    def _new_road(self, me: _Member, other: _Member, port: int) -> RelayPort | None:
        roads = sum(len(member.roads) for member in self._members.values())
        if len(me.roads) >= self._limits.ports_per_robot or roads >= self._most_ports:
            self._log.warning("no relay port left", robot=me.name, ports=roads)
            return None
        watcher = _Watcher(self, me, other, port)
        name = f"{me.name}>{other.name}:{port}"
        try:
            target = (other.address, port)
            road = RelayPort(self._host, target, self._link_options, name, watcher, self._links)
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

    # -- the watch -------------------------------------------------------------------------------

    def _review(self) -> None:
        self._owners = self._owners_now()
        for departure in self._network.review(asyncio.get_running_loop().time()):
            self._depart(departure)
        for member in tuple(self._members.values()):
            if self._is_foreign(member):
                self._dismiss(member, "the robot is another's")
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

    def _depart(self, departure: Departure) -> None:
        if departure.battery_empty:
            self._network.log.write(Event.OUT_OF_BATTERY, departure.name)
        reason = "battery empty" if departure.battery_empty else "not in the simulator"
        self._dismiss(self._members[departure.name], reason)

    def _dismiss(self, member: _Member, reason: str) -> None:
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
    account: Account
    truth: bool | None = None
    member: _Member | None = None


class _Watcher:
    """Keeps account of the links from one robot to one port of another."""

    def __init__(
        self, service: WirelessService, source: _Member, target: _Member, port: int
    ) -> None:
        self._traffic, self._sent = service._traffic, service._sent
        self._log = service._network.log
        self._source, self._target = source, target
        self._facts = (source.name, target.name, target.address, port)

    def enter(self) -> bool:
        return self._traffic.enter(self._source.name)

    def leave(self) -> None:
        self._traffic.leave(self._source.name)

    def dialled(self, port: int) -> None:
        self._target.callers[port] = self._source.name

    def established(self) -> None:
        self._log.write(Event.CON_ESTABLISHED, *self._facts)

    def passed(self, forward: bool, size: int) -> None:
        ends = (self._source.name, self._target.name)
        pair = ends if forward else ends[::-1]
        self._sent[pair] = self._sent.get(pair, 0) + size

    def ended(self, port: int, established: bool) -> None:
        self._target.callers.pop(port, None)
        if established:
            self._log.write(Event.CON_TERMINATED, *self._facts)


def _nothing(lines: list[bytes]) -> list[bytes]:
    """The replies of a desk that nobody is sent to."""
    return [b""] * len(lines)
