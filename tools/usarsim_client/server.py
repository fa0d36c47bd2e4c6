"""A server: robots come into its world from here."""

from __future__ import annotations

import asyncio
import difflib
from typing import Self, TypeVar

from usarsim_client import commands, readings, reports
from usarsim_client.commands import say
from usarsim_client.connection import AsyncClosing
from usarsim_client.decoder import Value
from usarsim_client.inbox import HangupError, ProtocolError
from usarsim_client.link import (
    FENCE,
    GRACE,
    STARTS,
    Address,
    Link,
    NameTakenError,
    Retry,
    SpawnError,
    only,
)
from usarsim_client.participant import Participant
from usarsim_client.robot import Robot
from usarsim_client.side_channels import GroundTruthPort, Radio, TruthPort
from usarsim_client.world import Avatar, WorldController
from usarsim_server.protocol.values import Vector, clean_name, name_key, taken

Someone = TypeVar("Someone", bound=Participant)

_PRESENT = (
    readings.Reading,
    reports.Status,
    reports.AvatarStatus,
    reports.MissionState,
    reports.EffectorState,
    reports.VehicleConfiguration,
    reports.ObjectList,
    reports.Tick,
)
"""What only those are told of who are in the world."""

_EXACT = "exactnames"
"""What a server says that knows the segment ExactName of INIT, in lower case."""

_CLASSES = (
    *("P2AT", "P2DX", "P3AT", "P3DX", "ATRVJr", "Zerg", "Talon", "Telemax", "Kenaf", "Tarantula"),
    *("Hummer", "Sedan", "Nomad", "Kurt2D", "Kurt3D", "Lisa", "AirRobot", "ARDrone", "Submarine"),
    *("Soryu", "Rugbot", "Matilda", "Nao", "QRIO", "ERS", "KR60", "Kiva4Wheel", "ComStation"),
    *("BasicSkidRobot", "BasicAckermanRobot", "quadrotor", "turtlebot", "youBot"),
)
"""Well-known robots, to guess what somebody meant; a server may know others."""


class Server(AsyncClosing):
    """The way to a server and the world that it runs: `async with connect(host, port) as server`.

    Attributes:
        greeting: what it said first; None if that was something else.
        robots: in the world by this program, in the order in which they came; closed ones leave.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 3000,
        *,
        timeout: float = 10.0,
        retry: Retry | None = None,
        image_port: int = 5003,
        groundtruth_port: int = 7435,
    ) -> None:
        """Say where a server is; `async with` connects.

        Args:
            host: its address.
            port: of robot control.
            timeout: s of wall time that a connection, a send or an answer may take.
            retry: how robots come back after a lost connection; None: not at all.
            image_port: where it gives pictures.
            groundtruth_port: where it tells the positions of all robots, and so their names.
        """
        self.address = Address(host, port, timeout)
        self.greeting: reports.Greeting | None = None
        self._retry = retry
        self._images = Address(host, image_port, timeout)
        self._lobby: Link | None = None
        self._participants: list[Participant] = []
        self._groundtruth_port = groundtruth_port
        self._exact: bool | None = None  # whether it refuses names that are taken; None: unasked
        self._tells_names = True  # as long as it is no waste of time to ask

    async def __aenter__(self) -> Self:
        """Connect, and see that it is a server of this protocol that answers.

        Raises:
            ConnectionError: if nobody accepts.
            ProtocolError: if whoever accepts does not greet.
        """
        self._lobby = await self._open()
        return self

    async def close(self) -> None:
        """Hang up; all robots leave the world."""
        closings = [one.close() for one in self._participants]
        if self._lobby is not None:
            closings.append(self._lobby.close())
        self._participants, self._lobby = [], None
        await asyncio.gather(*closings)

    @property
    def robots(self) -> tuple[Robot, ...]:
        """Robots of this program, in the order in which they came."""
        return tuple(one for one in self._present() if isinstance(one, Robot))

    def _present(self) -> list[Participant]:
        self._participants = [one for one in self._participants if not one.link.closed]
        return self._participants

    # -- the world ----------------------------------------------------------------------------

    async def start_poses(self) -> tuple[reports.StartPose, ...]:
        """Where robots can start; m, rad, frame of the wire."""
        link = await self._anyone()
        return (await link.ask(FENCE, only(reports.StartPoses), fence=False)).poses

    async def path_nodes(self) -> tuple[reports.StartPose, ...]:
        """The nodes that avatars walk along; `NoAnswerError` by servers that know none."""
        link = await self._anyone()
        return (await link.ask(say("GETPATHNODES"), only(reports.PathNodes))).nodes

    async def closest_path_node(self, location: Vector) -> reports.ClosestNode:
        """The node next to a place (m)."""
        question = say("GETCLOSESTPATHNODE", Location=location)
        return await (await self._anyone()).ask(question, only(reports.ClosestNode))

    # -- who comes into it --------------------------------------------------------------------

    async def spawn(
        self,
        /,
        class_name: str,
        name: str | None = None,
        *,
        start: str | None = None,
        location: Vector | None = None,
        rotation: Vector | None = None,
        **more: object,
    ) -> Robot:
        """Put a robot into the world and wait until it is there.

        With `connect(..., retry=Retry())` it comes back under its name after a lost connection; it
        tries until nobody else has it, such as its own forerunner behind a half-open connection.

        Args:
            class_name: as P3AT; `USARBot.` is put before it.
            name: cleaned, see `clean_name`; the invented one of the server without.
            start: tag of a start pose; without one location and rotation count.
            location: m. rotation: roll, pitch, yaw, rad; the origin without any.
            more: further segments of INIT: `Battery=600.0`, `Dialect="udk"`, `Team=1`.

        Raises:
            NameTakenError: if somebody in the world has the name. Servers that alter such names
                without a word are asked for all names before, where they tell them.
            SpawnError: if the server refuses otherwise, with its reason if it told one.
            HangupError: if it hangs up.
            TimeoutError: if it answers nothing.
        """
        link, name = await self._new_link(), clean_name(name or "")
        try:
            if start is not None:
                await self._check_start(link, start)
            init = commands.init(class_name, name or None, start, location, rotation, more)
            robot = Robot(link, name, class_name, self._images, self._retry)
            return await self._enter(robot, init + say("GETCONF", Type="Robot"), class_name)
        except BaseException:
            await link.close()
            raise

    async def avatar(
        self,
        class_name: str,
        name: str | None = None,
        *,
        start: str | None = None,
        location: Vector | None = None,
        rotation: Vector | None = None,
    ) -> Avatar:
        """Put a person into the world; as `spawn`, classes are of `USARAvatar.`."""
        qualified = class_name if "." in class_name else f"USARAvatar.{class_name}"
        name = clean_name(name or "")
        init = commands.init(qualified, name or None, start, location, rotation, {})
        return await self._enter(Avatar(await self._new_link(), name), init, class_name)

    async def world_controller(
        self, name: str = "WorldController", class_name: str = "USARBot.WorldController"
    ) -> WorldController:
        """Become somebody who changes the world; UDK calls it `USARBotAPI.WorldController`."""
        init = commands.init(class_name, name, None, None, None, {})
        controller = WorldController(await self._new_link(), name)
        return await self._enter(controller, init + say("CONTROL", Type="GetSTA"), class_name)

    async def _enter(self, someone: Someone, init: bytes, class_name: str) -> Someone:
        def accept(value: Value) -> str | None:
            if isinstance(value, reports.Event) and value.reason:
                return value.reason
            return "" if isinstance(value, _PRESENT) else None

        async def claim() -> None:
            if isinstance(someone, Robot) and someone.name:
                await self._claim(someone.link, someone.name)

        try:
            await someone.link.enter(init, accept, claim)
        except SpawnError as error:
            await someone.close()
            near = difflib.get_close_matches(class_name.rpartition(".")[2], _CLASSES, n=1)
            helps = near and near[0] not in class_name and "did you mean" not in str(error)
            hint = f"; did you mean {near[0]}?" if helps else ""
            kind = NameTakenError if str(error) == taken(someone.name) else SpawnError
            raise kind(f"no {class_name} came into the world: {error}{hint}") from None
        except BaseException:
            await someone.close()
            raise
        self._participants.append(someone)
        return someone

    async def _check_start(self, link: Link, start: str) -> None:
        """Refuse a start pose that the world does not have: servers use another one silently."""
        poses = await self._get_to_know(link)
        if poses is None:
            try:
                poses = (await link.ask(FENCE, only(reports.StartPoses), fence=False)).poses
            except TimeoutError:
                return  # a server that lists none may still know the name
        tags = {pose.tag.lower(): pose.tag for pose in poses}
        if tags and start.lower() not in tags:
            near = difflib.get_close_matches(start.lower(), tags, n=1)
            hint = (
                f"did you mean {tags[near[0]]}?" if near else f"it has {', '.join(tags.values())}"
            )
            raise SpawnError(f"the world has no start pose {start}; {hint}")

    async def _get_to_know(self, link: Link) -> tuple[reports.StartPose, ...] | None:
        """Ask for start poses in a way that shows whether the server refuses names that are taken;
        None if it answers nothing."""
        exact = False

        def accept(value: Value) -> reports.StartPoses | None:
            nonlocal exact
            exact = exact or (isinstance(value, reports.Event) and value.event.lower() == _EXACT)
            return value if isinstance(value, reports.StartPoses) else None

        wait = min(GRACE, self.address.timeout)
        try:
            found = await link.ask(say(STARTS, ExactName=True), accept, fence=False, wait=wait)
        except TimeoutError:
            self._exact = False
            return None
        self._exact = exact
        return found.poses

    async def _claim(self, link: Link, name: str) -> None:
        """See whether a name is free, at a server that would alter it otherwise."""
        if self._exact is None:
            await self._get_to_know(link)
        if not self._exact and name_key(name) in await self._names():
            raise NameTakenError(taken(name))

    async def _names(self) -> set[str]:
        """Keys of the names of all robots; empty if the server does not tell."""
        if not self._tells_names:
            return set()
        port = self.ground_truth()
        try:
            async with asyncio.timeout(min(GRACE, self.address.timeout)):
                return {name_key(one.name) for one in await port.positions()}
        except TimeoutError:
            self._tells_names = False
            return set()
        except (ProtocolError, OSError):
            return set()
        finally:
            await port.close()

    # -- time ---------------------------------------------------------------------------------

    async def sync(self, ticks: int = 1) -> float:
        """Let a world in lockstep go on for all robots and avatars of this program.

        Args:
            ticks: how many pass until they are asked again.

        Returns:
            Simulated s of the tick that they have been told of since.

        Raises:
            TimeoutError: if no tick comes: the server is not in lockstep, or waits for others.
            ValueError: if nobody is in the world; time stands still then.
        """
        present = [one for one in self._present() if not isinstance(one, WorldController)]
        if not present:
            raise ValueError("a world in lockstep stands still while nobody is in it")
        await asyncio.gather(*(one.stand_still() for one in present))
        await asyncio.gather(*(one.release(ticks) for one in present))
        return max(await asyncio.gather(*(one.next_tick() for one in present)))

    # -- other ports --------------------------------------------------------------------------

    async def radio(self, name: str, ports: tuple[int, ...], port: int = 50000) -> Radio:
        """Register a robot at the wireless simulation.

        Args:
            name: of the robot, as spawned.
            ports: where this program listens for others.
            port: of the wireless simulation.

        Raises:
            RadioError: if it refuses.
        """
        radio = Radio(self._at(port), name)
        try:
            await radio.register(ports)
        except BaseException:
            await radio.close()
            raise
        return radio

    def ground_truth(self, port: int | None = None) -> GroundTruthPort:
        """Positions of all robots, and obstacles between them; connects when asked.

        Args:
            port: None for the one that was given to `connect`.
        """
        return GroundTruthPort(self._at(self._groundtruth_port if port is None else port))

    def truth(self, port: int = 3989) -> TruthPort:
        """True poses of everybody; connects when asked."""
        return TruthPort(self._at(port))

    def _at(self, port: int) -> Address:
        return Address(self.address.host, port, self.address.timeout)

    # -- connections --------------------------------------------------------------------------

    async def _open(self) -> Link:
        """A connection that was greeted."""
        link = Link(self.address, self._retry)
        lines = link.lines()
        await link.open()
        try:
            async with self.address.patience("connected, but nobody greets"):
                await lines.get()
        except (TimeoutError, HangupError) as error:
            await link.close()
            raise ProtocolError(f"no USARSim server at {self.address}: {error}") from None
        except BaseException:
            await link.close()
            raise
        self.greeting = link.state.newest(reports.Greeting) or self.greeting
        return link

    async def _new_link(self) -> Link:
        """A connection of somebody's own: the first one that was made, or another."""
        link, self._lobby = self._lobby, None
        if link is not None and link.connected:
            return link
        if link is not None:
            await link.close()
        return await self._open()

    async def _anyone(self) -> Link:
        """A connection to ask about the world."""
        if self._lobby is None or not self._lobby.connected:
            present = [one.link for one in self._present() if one.connected]
            if present:
                return present[0]
            self._lobby = await self._open()
        return self._lobby


connect = Server
"""Connect to a server, with `async with`."""
