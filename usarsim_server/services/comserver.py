"""The older wireless simulation inside the simulator, TCP 5874 (side channels reference 5).

Robots register an address and listen on ports of their own. To open a link the server dials both
robots and hands the payload of each to the other while the radio reaches.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from dataclasses import dataclass, field

from usarsim_server.errors import UsarsimError
from usarsim_server.logs import Log
from usarsim_server.protocol import comserver
from usarsim_server.protocol.comserver import (
    GetStrength,
    LinkReader,
    Listen,
    MessageFramer,
    Open,
    Register,
)
from usarsim_server.radio.event_log import Event
from usarsim_server.radio.network import Network
from usarsim_server.services.limits import READ_COST, InputRates
from usarsim_server.services.listener import Endpoint, Listener, ListenerLimits
from usarsim_server.services.radio_watch import RadioWatch
from usarsim_server.services.relay import dial

__all__ = ["ComServerLimits", "ComServerService"]

_CHUNK = 2048
_BLOCK = 64 * 1024


@dataclass(frozen=True, slots=True)
class ComServerLimits:
    """What robots may use; names stay registered for the server's lifetime (5.1).

    Attributes:
        max_connections: control connections at a time.
        robots: names that may be registered.
        ports: that one robot may listen on at a time.
        links: open at a time.
        poll: s of wall time between two looks at the world.
        rate: messages per wall s of one client in the long run; it is read no faster.
    """

    max_connections: int = 64
    robots: int = 256
    ports: int = 256
    links: int = 512
    poll: float = 0.25
    rate: float = 1000.0


@dataclass(slots=True, eq=False)
class _Robot:
    name: str
    address: str
    listening: list[str] = field(default_factory=list)


class ComServerService:
    """Control messages and data links."""

    name = "comserver"

    def __init__(
        self,
        host: str,
        port: int,
        network: Network,
        *,
        limits: ComServerLimits | None = None,
        required: bool = False,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            host: address to listen on.
            port: 0 takes any free one.
            network: strengths and links; used by this service alone.
            limits: see there.
            required: whether the server shall not run without it.
        """
        self.required = required
        self._network = network
        self._limits = limits or ComServerLimits()
        self._rates = InputRates(self._limits.rate)
        self._log = Log(self.name)
        self._robots: dict[str, _Robot] = {}
        self._links: set[asyncio.Task[None]] = set()
        self._watch = RadioWatch(
            self.name, network, self._limits.poll, lambda: bool(self._robots), self._review
        )
        self._listener = Listener(
            self.name,
            host,
            port,
            self._serve,
            option="--comserver-port",
            limits=ListenerLimits(max_connections=self._limits.max_connections),
        )

    async def start(self) -> Endpoint:
        """Open the port.

        Raises:
            ServiceError: if it cannot be opened.
        """
        endpoint = await self._listener.start()
        self._watch.start()
        return endpoint

    async def stop(self) -> None:
        """Close the port, all connections and all links."""
        await self._watch.stop()
        await self._listener.stop()
        for link in self._links:
            link.cancel()
        await asyncio.gather(*self._links, return_exceptions=True)

    # -- control ---------------------------------------------------------------------------------

    async def _serve(self, client: socket.socket, peer: str) -> None:
        self._log.info("client connected", connection=peer)
        loop = asyncio.get_running_loop()
        address = client.getpeername()[0]
        framer, allowance = MessageFramer(), self._rates.newcomer()
        while chunk := await loop.sock_recv(client, _CHUNK):
            messages = framer.feed(chunk)
            for message in messages:
                request = comserver.parse_message(message)
                if not isinstance(request, bytes):
                    request = await self._answer(request, address)
                await loop.sock_sendall(client, request)
            # Neither call yields while there is data and room.
            await asyncio.sleep(self._rates.charge(allowance, READ_COST + len(messages)))
        self._log.info("client gone", connection=peer)

    async def _answer(self, request: comserver.Request, address: str) -> bytes:
        match request:
            case Register():
                return await self._register(request)
            case Listen():
                return self._listen(request)
            case Open():
                return self._open(request)
            case GetStrength():
                return self._strength(request, address)

    async def _register(self, request: Register) -> bytes:
        known = self._robots.get(request.name)
        if known is not None:
            same = known.address == request.address
            return comserver.OK if same else comserver.already_registered(request.name)
        if len(self._robots) >= self._limits.robots:
            self._log.warning("too many robots registered", limit=self._limits.robots)
            return comserver.INCORRECT
        self._robots[request.name] = _Robot(request.name, request.address)
        self._network.register(request.name, asyncio.get_running_loop().time())
        self._network.log.write(Event.REGISTERED, request.name, request.address, "")
        if not self._network.knows(request.name):
            with contextlib.suppress(UsarsimError):
                await self._watch.look()
        self._watch.wake()
        return comserver.OK

    def _listen(self, request: Listen) -> bytes:
        robot = self._robots.get(request.name)
        if robot is None:
            return comserver.not_registered(request.name)
        # As in the original only the first entry is compared (5.2).
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
        if me is None or None in ends or len(self._links) >= self._limits.links:
            return comserver.NO_LINK
        other.listening.remove(request.other_port)
        link = asyncio.create_task(self._link(me, other, [port or 0 for port in ends]))
        self._links.add(link)
        link.add_done_callback(self._links.discard)
        return comserver.OK

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
                await self._carry(sockets, me.name, other.name)
                self._network.log.write(Event.CON_TERMINATED, *facts)
        except Exception as error:  # a defect in one link must not end the others
            self._log.exception("link closed by a server error", error, link=facts)
        finally:
            for one in sockets:
                one.close()

    async def _carry(self, sockets: list[socket.socket], one: str, other: str) -> None:
        """Until CLOSE, the end of either side, or the end of the radio's reach (5.4)."""
        there, back = sockets
        ways = [
            asyncio.create_task(self._one_way(there, back, one, other)),
            asyncio.create_task(self._one_way(back, there, other, one)),
        ]
        try:
            done, _ = await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            for way in done:
                if not isinstance(error := way.exception(), OSError | None):
                    raise error
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)

    async def _one_way(
        self, source: socket.socket, target: socket.socket, sender: str, receiver: str
    ) -> None:
        loop = asyncio.get_running_loop()
        reader = LinkReader()
        sent = 0
        try:
            while not reader.closed and (data := await loop.sock_recv(source, _BLOCK)):
                payload = reader.feed(data)
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
        # Nobody is dismissed: names outlive their robots here (5.1).
        self._network.review(asyncio.get_running_loop().time())
        self._network.log.flush()


def _port(text: str) -> int | None:
    """A port that can be dialled."""
    return int(text) if text.isascii() and text.isdigit() and 0 < int(text[:6]) < 65536 else None
