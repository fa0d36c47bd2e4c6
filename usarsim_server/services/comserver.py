"""The older wireless simulation inside the simulator, TCP 5874 (side channels reference 5).

Robots register an address and listen on ports of their own. To open a link the server dials both
robots and hands the payload of each to the other while the radio reaches.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from usarsim_server.base.errors import UsarsimError
from usarsim_server.protocol import comserver
from usarsim_server.protocol.comserver import (
    GetStrength,
    LinkReader,
    Listen,
    MessageFramer,
    Open,
    Register,
)
from usarsim_server.protocol.opening import Opening
from usarsim_server.protocol.values import name_key
from usarsim_server.radio.event_log import Event
from usarsim_server.radio.network import Network
from usarsim_server.services.budget import BYTE_COST, HOP_COST, Account, WorkBudget, whole_share
from usarsim_server.services.dialogue import CHUNK, CHUNK_BYTES
from usarsim_server.services.limits import READ_COST
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.owners import NOBODY, Owners
from usarsim_server.services.port import Guest, PortLimits, PortService, refuse
from usarsim_server.services.relay import (
    KERNEL_BUFFER,
    RadioWatch,
    Traffic,
    both_ways,
    cancel_all,
    descriptor_limit,
    dial,
    raise_descriptor_limit,
)
from usarsim_server.services.replies import PIECE, ReplyBuffer
from usarsim_server.services.silence import ends_when_gone

_BLOCK = 4 * 1024
"""Bytes read at a time from a link; the worst of them, messages without payload, take half a
millisecond, for which nobody else runs."""
_ROBOT_BYTES = 16 * 1024
"""A registered name with all ports that it may listen on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComServerLimits(PortLimits):
    """What robots may use; names stay registered for the server's lifetime (side channels 5.1)."""

    robots: int = 256
    """Names that may be registered; beyond it the oldest that is no robot of the world and has no
    links is forgotten."""
    ports: int = 64  # that one robot may listen on at a time
    links: int = 256  # open at a time; each takes two descriptors
    links_per_robot: int = 64  # of these for the one who opened them
    poll: float = 0.25  # s of wall time between two looks at the world
    link_share: float = 0.08  # s of processor time per wall s for all links

    @property
    def held_bytes(self) -> int:
        """Bytes that a connection can make the server hold, without links and kernel buffers: half
        a message, those of one chunk that wait, and the answers that are being sent."""
        return comserver.MAX_MESSAGE + CHUNK_BYTES + 2 * PIECE

    @property
    def names_bytes(self) -> int:
        """Bytes of all names and ports, which outlive the connections that registered them."""
        return self.robots * _ROBOT_BYTES

    @property
    def link_bytes(self) -> int:
        """Bytes, those of the kernel included, that the links of one robot can hold."""
        return self.links_per_robot * (2 * 2 * _BLOCK + 8 * KERNEL_BUFFER)


@dataclass(slots=True, eq=False)
class _Robot:
    name: str
    address: str
    listening: list[str] = field(default_factory=list)
    links: int = 0


class ComServerService(PortService[ComServerLimits]):
    """Control messages and data links."""

    def __init__(
        self,
        host: str,
        port: int,
        network: Network,
        *,
        limits: ComServerLimits | None = None,
        required: bool = False,
        owners: Owners = NOBODY,
        pace: Callable[[], float] = whole_share,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            host, port, limits, required: see `PortService`.
            network: strengths and links; used by this service alone.
            owners: whose the robots are.
            pace: which part of its shares the service may use now.
        """
        limits = limits or ComServerLimits()
        super().__init__("comserver", host, port, "--comserver-port", limits, required)
        self._network = network
        self._owners = owners
        self._budget = WorkBudget(self._limits.share, pace=pace)
        self._link_budget = WorkBudget(self._limits.link_share, pace=pace)
        self._traffic = Traffic(self._limits.links, self._limits.links_per_robot)
        self._robots: dict[str, _Robot] = {}
        self._links: set[asyncio.Task[None]] = set()
        self._watch = RadioWatch(
            self.name, network, self._limits.poll, lambda: bool(self._robots), self._review
        )

    async def start(self) -> Endpoint:
        endpoint = await super().start()
        raise_descriptor_limit()
        self._traffic.most = min(self._limits.links, descriptor_limit() // 8)
        self._watch.start()
        return endpoint

    async def stop(self) -> None:
        await self._watch.stop()
        await super().stop()
        await cancel_all(self._links)

    # -- control ---------------------------------------------------------------------------------

    async def _serve(self, client: socket.socket, peer: str) -> None:
        self._log.info("client connected", connection=peer)
        with self._guests.enter(peer) as guest:
            await self._converse(client, guest)
        self._log.info("client gone", connection=peer)

    async def _converse(self, client: socket.socket, guest: Guest) -> None:
        loop, budget, account = asyncio.get_running_loop(), self._budget, self._budget.newcomer()
        address = client.getpeername()[0]
        framer, replies, allowance = MessageFramer(), ReplyBuffer(client), self._rates.newcomer()
        introduced: set[str] = set()
        opening = Opening()
        guest.standing = lambda: not introduced.isdisjoint(self._owners())
        while chunk := await loop.sock_recv(client, CHUNK):
            if foreign := opening.foreign(chunk):
                refuse(self._log, foreign)
                return
            await budget.turn(account)
            with budget.work(account):
                messages = framer.feed(chunk)
            for number, message in enumerate(messages):
                if number:
                    await budget.turn(account)
                with budget.work(account):
                    request = comserver.parse_message(message)
                    reply = self._answer(request, address)
                if isinstance(request, Register) and reply == comserver.OK:
                    introduced.add(name_key(request.name))
                    budget.charge(account, HOP_COST)
                    await self._look_for(request.name)
                await replies.put(reply)
            await replies.flush()
            if messages:
                self._guests.heard(guest)
            # Neither call yields while there is data and room.
            await asyncio.sleep(allowance.spend(READ_COST + len(messages)))

    def _answer(self, request: comserver.Request | bytes, address: str) -> bytes:
        match request:
            case Register():
                return self._register(request)
            case Listen():
                return self._listen(request)
            case Open():
                return self._open(request)
            case GetStrength():
                return self._strength(request, address)
            case refusal:
                return refusal

    def _register(self, request: Register) -> bytes:
        known = self._robots.get(request.name)
        if known is not None:
            same = known.address == request.address
            return comserver.OK if same else comserver.already_registered(request.name)
        if len(self._robots) >= self._limits.robots and not self._forget_one():
            self._log.warning("too many robots registered", limit=self._limits.robots)
            return comserver.INCORRECT
        self._robots[request.name] = _Robot(request.name, request.address)
        self._network.register(request.name, asyncio.get_running_loop().time())
        self._network.log.write(Event.REGISTERED, request.name, request.address, "")
        return comserver.OK

    async def _look_for(self, name: str) -> None:
        """Find a robot that may have come since the last look."""
        if not self._network.knows(name):
            with contextlib.suppress(UsarsimError):
                await self._watch.look()
        self._watch.wake()

    def _forget_one(self) -> bool:
        """Forget the oldest name that nobody needs; False if all are needed."""
        owners = self._owners()
        for name, robot in self._robots.items():
            if name_key(name) not in owners and not robot.links:
                del self._robots[name]
                self._network.deregister(name)
                return True
        return False

    def _listen(self, request: Listen) -> bytes:
        robot = self._robots.get(request.name)
        if robot is None:
            return comserver.not_registered(request.name)
        # As in the original only the first entry is compared (side channels 5.2).
        if robot.listening[:1] == [request.port]:
            return comserver.already_listening(request.name, request.port)
        if len(robot.listening) >= self._limits.ports:
            return comserver.INCORRECT
        robot.listening.append(request.port)
        return comserver.OK

    def _open(self, request: Open) -> bytes:
        other = self._robots.get(request.other)
        if other is None or request.other_port not in other.listening:
            return comserver.not_listening(request.other, request.other_port)
        if not self._network.connected(request.name, request.other):
            return comserver.cannot_connect(request.other)
        me = self._robots.get(request.name)
        ends = [_port(text) for text in (request.port, request.other_port)]
        if me is None or None in ends or not self._traffic.enter(me.name):
            return comserver.NO_LINK
        other.listening.remove(request.other_port)
        link = asyncio.create_task(self._link(me, other, [port or 0 for port in ends]))
        self._links.add(link)
        me.links, other.links = me.links + 1, other.links + 1
        link.add_done_callback(partial(self._unlink, me, other))
        return comserver.OK

    def _unlink(self, me: _Robot, other: _Robot, link: asyncio.Task[None]) -> None:
        self._links.discard(link)
        self._traffic.leave(me.name)
        me.links, other.links = me.links - 1, other.links - 1

    def _strength(self, request: GetStrength, address: str) -> bytes:
        robots = [self._robots.get(name) for name in (request.one, request.other)]
        if not any(robot is not None and robot.address == address for robot in robots):
            return comserver.THIRD_PARTY
        return comserver.strength_reply(self._network.strength(request.one, request.other))

    # -- links -----------------------------------------------------------------------------------

    async def _link(self, me: _Robot, other: _Robot, ports: list[int]) -> None:
        """Dial both robots and carry payload between them until either has enough."""
        facts = (me.name, other.name, other.address, ports[1])
        dials = [dial(robot.address, port) for robot, port in zip((me, other), ports, strict=True)]
        # No dial is left alone when the other fails, so that both sockets end up here.
        answers = await asyncio.gather(*dials, return_exceptions=True)
        sockets = [one for one in answers if isinstance(one, socket.socket)]
        try:
            for robot, answer in zip((me, other), answers, strict=True):
                if isinstance(answer, BaseException):
                    self._log.info("a robot does not answer", robot=robot.name, reason=answer)
            if len(sockets) == 2:
                self._network.log.write(Event.CON_ESTABLISHED, *facts)
                try:
                    await self._carry(sockets, me.name, other.name)
                finally:
                    self._network.log.write(Event.CON_TERMINATED, *facts)
        except Exception as error:  # a defect in one link must not end the others
            self._log.exception("link closed by a server error", error, link=facts)
        finally:
            for one in sockets:
                one.close()

    async def _carry(self, sockets: list[socket.socket], one: str, other: str) -> None:
        """Until CLOSE, the end of either side, or the end of the radio's reach
        (side channels 5.4)."""
        there, back = sockets
        account = self._link_budget.newcomer()
        seconds = self._limits.silence
        with (
            ends_when_gone(there, self._log, seconds, link=f"{one} {other}", robot=one),
            ends_when_gone(back, self._log, seconds, link=f"{one} {other}", robot=other),
        ):
            await both_ways(
                self._one_way(there, back, one, other, account),
                self._one_way(back, there, other, one, account),
                until=asyncio.FIRST_COMPLETED,
            )

    async def _one_way(
        self,
        source: socket.socket,
        target: socket.socket,
        sender: str,
        receiver: str,
        account: Account,
    ) -> None:
        loop, budget = asyncio.get_running_loop(), self._link_budget
        reader = LinkReader()
        sent = 0
        try:
            while not reader.closed and (data := await loop.sock_recv(source, _BLOCK)):
                await budget.turn(account)
                with budget.work(account):
                    payload = reader.feed(data)
                budget.charge(account, len(data) * BYTE_COST)
                if payload:
                    if not self._network.connected(sender, receiver):
                        self._log.info("out of reach", sender=sender, receiver=receiver)
                        break
                    await loop.sock_sendall(target, payload)
                    sent += len(payload)
                await asyncio.sleep(0)
        finally:
            if sent:
                self._network.log.write(Event.DATA_SENT, sender, receiver, sent)

    # -- the watch -------------------------------------------------------------------------------

    def _review(self) -> None:
        # Nobody is dismissed: names outlive their robots here (side channels 5.1).
        self._network.review(asyncio.get_running_loop().time())
        self._network.log.flush()


def _port(text: str) -> int | None:
    """A port that can be dialled."""
    return int(text) if text.isascii() and text.isdigit() and 0 < int(text[:6]) < 65536 else None
