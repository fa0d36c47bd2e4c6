"""Robots have the names that the client tells: what a server would alter is refused."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest
from fake_server import FakeServer, until

from usarsim_client import NameTakenError, Retry, SpawnError, connect, connect_blocking
from usarsim_server.testing import PATIENCE, running_server

Ports = dict[str, int]

POSES = "NFO {StartPoses 1}{RobotStart1 1,2,3 0,0,0}"
STATUS = "STA {Time 0.3021} {Battery 99999}"


@pytest.fixture(scope="module")
def ports() -> Iterator[Ports]:
    """Ports of a server of ours, and of its ground truth."""
    with running_server(world="empty", groundtruth_port=0) as (_, endpoints):
        yield {name: endpoint.port for name, endpoint in endpoints.items()}


class TestAtOurServer:
    def test_a_name_that_is_taken(self, ports: Ports) -> None:
        """In whatever spelling; the other robot keeps it, and nobody comes in as R1_2."""
        with connect_blocking(
            port=ports["control"], timeout=PATIENCE, groundtruth_port=ports["groundtruth"]
        ) as server:
            robot = server.spawn("P3AT", "R1")
            for name in ("R1", "r1", " R1 "):
                with pytest.raises(
                    NameTakenError, match=r"(?i)no P3AT came .*: the name R1 is taken$"
                ):
                    server.spawn("P3AT", name, location=(3.0, 0.0, 0.0))
            assert [one.name for one in server.ground_truth().positions()] == ["R1"]
            robot.close()
            assert server.spawn("P3AT", "R1").name == "R1"

    def test_the_name_is_that_of_the_server(self, ports: Ports) -> None:
        """Blanks and braces are in no name; radio and ground truth know the one that is told."""
        with connect_blocking(
            port=ports["control"], timeout=PATIENCE, groundtruth_port=ports["groundtruth"]
        ) as server:
            robot = server.spawn("P3AT", "My {first} robot")
            assert robot.name == "My_first_robot"
            assert robot.name in [one.name for one in server.ground_truth().positions()]
            assert server.spawn("P3AT", location=(3.0, 0.0, 0.0)).name == "", "the server's own"

    def test_reasons_are_told_at_once(self, ports: Ports) -> None:
        """Of whatever fails, with one hint, not two."""
        with connect_blocking(port=ports["control"], timeout=PATIENCE) as server:
            for name in ("R1", None):
                with pytest.raises(SpawnError, match=r"unknown class; did you mean `P3AT`\?$"):
                    server.spawn("P3TA", name)
            with pytest.raises(SpawnError, match="the name has 65 characters, 64 are possible"):
                server.spawn("P3AT", "x" * 65)

    def test_people(self, ports: Ports) -> None:
        """Their names are as exact, and are no robots'."""
        with connect_blocking(port=ports["control"], timeout=PATIENCE) as server:
            server.spawn("P3AT", "Ann", location=(0.0, 3.0, 0.0))
            server.avatar("USARAvatarNewMale", "Ann")
            with pytest.raises(NameTakenError, match="the name Ann is taken"):
                server.avatar("USARAvatarNewMale", "Ann", location=(3.0, 0.0, 0.0))

    def test_another_server_on_this_machine_has_no_say(self, ports: Ports) -> None:
        """Whoever listens on the port of ground truth may have robots of the same names."""

        async def play() -> None:
            async with (
                FakeServer(lambda _: [positions("R7")], greeting="") as truth,
                connect(
                    port=ports["control"], timeout=PATIENCE, groundtruth_port=truth.port
                ) as server,
            ):
                assert (await server.spawn("P3AT", "R7")).name == "R7"
                assert truth.connections == 0

        asyncio.run(play())

    def test_a_robot_waits_for_its_ghost(self, ports: Ports) -> None:
        """Behind a half-open connection the old one drives on; afterwards it comes back."""

        async def play() -> None:
            retry = Retry(first=0.01, most=0.05)
            async with (
                HalfOpen(ports["control"]) as way,
                connect(port=way.port, retry=retry, timeout=PATIENCE) as server,
            ):
                robot = await server.spawn("P3AT", "Ghost", location=(0.0, -3.0, 0.0))
                scans = robot.scans()
                tries = way.connections
                way.cut()
                await until(lambda: way.connections > tries + 3)
                assert robot.link.spawns == 1
                assert not robot.link.closed
                way.notice()
                await until(lambda: robot.link.spawns == 2)
                assert robot.connected
                assert (await anext(scans)).ranges.size == 181
                truth = server.ground_truth(ports["groundtruth"])
                assert [one.name for one in await truth.positions()].count("Ghost") == 1
                await truth.close()

        asyncio.run(asyncio.wait_for(play(), PATIENCE))


class HalfOpen:
    """A way to a server on which one end can be lost without the other one's knowing.

    Attributes:
        port: where it begins.
        connections: how many came.
    """

    def __init__(self, target: int) -> None:
        self.port, self.connections = 0, 0
        self._target = target
        self._near: list[asyncio.StreamWriter] = []
        self._far: list[asyncio.StreamWriter] = []
        self._lost: list[asyncio.StreamWriter] = []

    async def __aenter__(self) -> HalfOpen:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()
        for one in (*self._near, *self._far, *self._lost):
            one.close()

    def cut(self) -> None:
        """The client loses its connections; the server does not hear of it."""
        self._lost, self._far = self._far, []
        for one in self._near:
            one.close()
        self._near = []

    def notice(self) -> None:
        """The server hears of it."""
        for one in self._lost:
            one.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        back, there = await asyncio.open_connection("127.0.0.1", self._target)
        self._near.append(writer)
        self._far.append(there)

        async def carry(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
            while data := await source.read(65536):
                if not target.is_closing():
                    target.write(data)

        answers = asyncio.create_task(carry(back, writer))
        await carry(reader, there)
        if there in self._far:
            there.close()
        await answers
        writer.close()


def positions(*names: str) -> str:
    """The answer to GETPOS."""
    robots = "".join(f" {{Name {one} Location 1,2,3 BatteryEmpty False}}" for one in names)
    return f"POSITIONS {{Robots {len(names)}}}{robots}"


class Foreign(FakeServer):
    """A server of old: it gives each robot a name of its own choice, and tells nothing of it."""

    def __init__(self) -> None:
        super().__init__(self._say)
        self.names: list[str] = []
        """Of robots in its world, as it tells them."""
        self.truth = FakeServer(lambda _: [positions(*self.names)], greeting="")

    def _say(self, line: str) -> list[str]:
        return {"INIT": [STATUS], "GETSTARTPOSES": [POSES]}.get(line.split()[0], [])

    @property
    def inits(self) -> list[str]:
        """What it was asked for."""
        return [line for line in self.heard if line.startswith("INIT")]


class TestAtOtherServers:
    async def test_positions_are_asked_first(self) -> None:
        """Nobody comes into the world who would get another name."""
        async with (
            Foreign() as fake,
            fake.truth as truth,
            connect(port=fake.port, groundtruth_port=truth.port, timeout=PATIENCE) as server,
        ):
            fake.names = ["Base", "r1"]
            with pytest.raises(NameTakenError, match="no P3AT came into the world: the name R1 is"):
                await server.spawn("P3AT", "R1")
            assert fake.inits == []
            assert (await server.spawn("P3AT", "R2")).name == "R2"
            assert (await server.spawn("P3AT")).name == ""
            assert len(fake.inits) == 2
            assert truth.connections == 2

    async def test_a_robot_waits_for_its_ghost(self) -> None:
        """With `Retry` it is asked again until the name is free."""
        retry = Retry(first=0.001, most=0.01)
        async with (
            Foreign() as fake,
            fake.truth as truth,
            connect(
                port=fake.port, groundtruth_port=truth.port, timeout=PATIENCE, retry=retry
            ) as server,
        ):
            robot = await server.spawn("P3AT", "R1")
            fake.names = ["R1"]
            fake.hang_up()
            asked = truth.connections
            await until(lambda: truth.connections > asked + 3)
            assert robot.link.spawns == 1
            fake.names = []
            await until(lambda: robot.link.spawns == 2)
            assert len(fake.inits) == 2

    async def test_servers_that_tell_no_names(self) -> None:
        """Robots come in as ever; who takes the question and says nothing is asked only once."""
        async with (
            Foreign() as fake,
            FakeServer(lambda _: [], greeting="") as mute,
            connect(port=fake.port, groundtruth_port=mute.port, timeout=0.2) as server,
        ):
            assert (await server.spawn("P3AT", "R1")).name == "R1"
            assert (await server.spawn("P3AT", "R2")).name == "R2"
            assert mute.connections == 1
        async with (
            Foreign() as fake,
            FakeServer(lambda _: ["what?"], greeting="") as garbage,
            connect(port=fake.port, groundtruth_port=garbage.port, timeout=PATIENCE) as server,
        ):
            assert (await server.spawn("P3AT", "R1")).name == "R1"
            await garbage.__aexit__()
            assert (await server.spawn("P3AT", "R2")).name == "R2", "nobody listens there"
