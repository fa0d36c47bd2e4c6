"""The client at our server, over sockets: both dialects, worlds, pictures, side channels."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import pairwise

import pytest
from held_ports import held_port

from usarsim_client import (
    NoAnswerError,
    RadioError,
    Retry,
    Robot,
    SpawnError,
    connect,
    connect_blocking,
    decode,
    readings,
    reports,
)
from usarsim_client.readings import Unknown
from usarsim_client.server import _CLASSES
from usarsim_server.protocol.values import Dialect
from usarsim_server.testing import PATIENCE, Rehearsal, eventually, running_server

Ports = dict[str, int]


@pytest.fixture(scope="module")
def ports() -> Iterator[Ports]:
    """Ports of a server with everything."""
    sides = ("image_port", "truth_port", "groundtruth_port", "wireless_port")
    with running_server(world="arena", **dict.fromkeys(sides, 0)) as (_, endpoints):
        yield {name: endpoint.port for name, endpoint in endpoints.items()}


async def _driven(robot: Robot) -> list[readings.Odometry]:
    """Where a robot is by its wheels, until it has gone a decimetre."""
    await robot.drive(left=1.0, right=1.0)
    found = []
    async for odometry in robot.odometry():
        found.append(odometry)
        if odometry.x > 0.1:
            break
    await robot.stop()
    return found


@pytest.mark.parametrize(
    ("class_name", "dialect", "start"),
    [("P2AT", Dialect.UT2004, "RobotStart1"), ("P3AT", Dialect.UDK, "RobotStart2")],
)
def test_robot_of_a_dialect(ports: Ports, class_name: str, dialect: Dialect, start: str) -> None:
    """Equal programs, equal values, whatever the server speaks."""

    async def play() -> None:
        async with connect(port=ports["control"], timeout=PATIENCE) as server:
            assert server.greeting == reports.Greeting("BotDeathMatch", "arena", 20)
            poses = {pose.tag: pose for pose in await server.start_poses()}
            async with await server.spawn(class_name, f"Test{class_name}", start=start) as robot:
                driven = await _driven(robot)
                assert driven[-1].time > driven[0].time
                assert abs(driven[-1].y) < 0.05
                truth = await anext(robot.truth())
                assert math.dist(truth.location, poses[start].location) < 1.0
                assert robot.dialect is dialect
                scan = await anext(robot.scans())
                assert (scan.ranges.shape, scan.points.shape) == ((181,), (181, 2))
                assert scan.fov == pytest.approx(math.pi, abs=1e-3)
                status = await anext(robot.statuses())
                assert (status.type, status.light) == ("GroundVehicle", False)
                await robot.light(True)
                async for status in robot.statuses():
                    if status.light:
                        break
                vehicle, size = await robot.vehicle(), await robot.dimensions()
                assert (vehicle.class_name, vehicle.steering) == (class_name, "SkidSteered")
                assert 0.05 < size.wheel_radius < size.wheel_separation < 1.0
                (conf,) = (await robot.configuration("RangeScanner")).items
                (geo,) = (await robot.geometry("RangeScanner")).items
                assert conf.name == geo.name == scan.name
                assert conf.number("MaxRange") >= scan.ranges.max()
                assert geo.location[2] < 0.0  # above the middle of the robot
                assert 0.3 < (await robot.camera()).min_fov < 0.4
                with pytest.raises(NoAnswerError, match="Sonra"):
                    await robot.configuration("Sonra")
                assert server.robots == (robot,)
            assert server.robots == ()

    asyncio.run(play())


def test_refused(ports: Ports) -> None:
    """A robot and a start pose that do not exist."""
    with connect_blocking(port=ports["control"], timeout=PATIENCE) as server:
        with pytest.raises(SpawnError, match=r"no P3TA came into the world.*did you mean `P3AT`\?"):
            server.spawn("P3TA")
        with pytest.raises(SpawnError, match=r"RobotStrat1; did you mean RobotStart1\?"):
            server.spawn("P3AT", start="RobotStrat1")


def test_blocking_calls_pictures_and_side_channels(ports: Ports) -> None:
    """The same without an event loop: pictures of the robot's tile, truth, radio, lockstep."""
    with connect_blocking(
        port=ports["control"], image_port=ports["images"], timeout=PATIENCE
    ) as server:
        robot = server.spawn("P3AT", "Seer", start="RobotStart3")
        assert next(robot.scans()).ranges.size == 181
        tile = robot.camera().tile
        assert tile is not None
        for picture, _ in zip(robot.pictures(rate=50.0), range(3), strict=False):
            assert picture.size == tile[2:]
            assert picture.pixels.shape == (tile[3], tile[2], 3)
        with (
            server.truth(ports["truth"]) as truth,
            server.ground_truth(ports["groundtruth"]) as ground,
        ):
            (actor,) = truth.actors("USARBot.P3AT")
            (position,) = [one for one in ground.positions() if one.name == "Seer"]
            assert math.dist(position.location, actor.location) < 0.1
            assert ground.obstacles(position.location, position.location) == 0
        other = server.spawn("P2AT", "Other", start="RobotStart4")
        with (
            server.radio("Seer", (3333,), ports["wireless"]) as radio,
            server.radio("Other", (3334,), ports["wireless"]) as there,
        ):
            assert -100.0 < radio.strength("Other") < 0.0
            assert there.road("Seer") > 0
            with pytest.raises(RadioError):
                radio.strength("Nobody")
        other.close()
        assert robot.connected
        assert not other.connected


def test_world_controller_and_avatar(ports: Ports) -> None:
    """Objects are made, moved, listed and removed; a person stands in the world."""

    async def play() -> None:
        async with connect(port=ports["control"], timeout=PATIENCE) as server:
            world = await server.world_controller()
            await world.create("Box", "B1", (3.1, 0.2, -0.15), memory="red one")
            await world.create("Box", "B2", (5.1, 0.2, -0.15), (0.0, 0.0, 0.5))
            first, second = await world.objects()
            assert (first.name, first.memory, second.memory) == ("B1", "red one", "")
            assert second.rotation == pytest.approx((0.0, 0.0, 0.5), abs=1e-3)
            await world.move("B1", (0.0, 0.5, 0.0), relative=True)
            (moved,) = await world.objects("B1")
            assert moved.location == pytest.approx((3.1, 0.7, -0.15), abs=1e-3)
            await world.follow("B2", [(5.1, 1.2, -0.15)], speed=2.0)
            while (await world.objects("B2"))[0].location[1] < 1.0:
                pass
            await world.kill("B1")
            assert len(await world.objects()) == 1
            await world.kill_all()
            assert await world.objects() == ()
            person = await server.avatar("USARAvatarNewMale", "W", location=(0.0, 0.0, -1.0))
            status = await anext(person.statuses())
            assert (status.name, status.walking) == ("W", False)

    asyncio.run(play())


def test_lockstep() -> None:
    """One robot goes from tick to tick; two go on together."""

    async def play(port: int) -> None:
        async with connect(port=port, timeout=PATIENCE) as server:
            one = await server.spawn("P3AT", "A", location=(0.0, 0.0, -0.3))
            await one.drive(left=1.0, right=1.0)
            times = [await one.sync() for _ in range(8)]
            assert {round(after - before, 6) for before, after in pairwise(times)} == {0.1}
            odometry = one.newest(readings.Odometry)
            assert odometry is not None
            assert odometry.x > 0.05
            assert await one.sync(ticks=5) == pytest.approx(times[-1] + 0.5)
            two = await server.spawn("P2AT", "B", location=(0.0, 3.0, -0.3))
            begun = await server.sync()
            for ticks in range(1, 5):
                assert await server.sync() == pytest.approx(begun + 0.1 * ticks)
                assert one.time == pytest.approx(two.time)
            await two.close()
            assert await one.sync() > begun

    with running_server(world="empty", lockstep=True) as (_, endpoints):
        asyncio.run(play(endpoints["control"].port))


def test_robot_comes_back_to_a_server_that_was_restarted() -> None:
    """Under its name, with its old streams."""
    with ExitStack() as client:
        port = client.enter_context(held_port())
        with running_server(world="empty", port=port):
            retry = Retry(first=0.02, most=0.1)
            server = client.enter_context(
                connect_blocking(port=port, timeout=PATIENCE, retry=retry)
            )
            robot = server.spawn("P3AT", "Phoenix")
            scans = robot.scans()
            assert next(scans).time > 0.0
        with running_server(world="empty", port=port) as (assembly, _):
            assert eventually(lambda: robot.inner.link.spawns == 2)
            assert next(scans).ranges.size == 181
            assert assembly.robots.find("Phoenix") is not None


def test_not_in_lockstep(ports: Ports) -> None:
    with connect_blocking(port=ports["control"], timeout=4.0) as server:
        robot = server.spawn("P3AT", start="RobotStart1")
        with pytest.raises(TimeoutError, match="is the server in lockstep"):
            robot.sync()


def test_all_robots_are_understood() -> None:
    """Whatever the robots of the roster say has a type of its own, in both dialects."""
    said: set[bytes] = set()
    for dialect in ("ut2004", "udk"):
        with Rehearsal(world="empty", dialect=dialect) as stage:
            clients = []
            for place, name in enumerate(("RescueP2AT", "Kenaf", "AirRobot", "Nao", "P3AT_arm")):
                client = stage.connect()
                client.send(f"INIT {{ClassName USARBot.{name}}} {{Location 0,{3 * place},-1}}")
                clients.append(client)
            stage.run(1.5)
            for client in clients:
                for kind in ("Robot", "RangeScanner", "MisPkg", "Actuator", "Camera", "Sonar"):
                    client.send(f"GETCONF {{Type {kind}}}", f"GETGEO {{Type {kind}}}")
                said |= {line.encode("latin-1") for line in client.lines}
    kinds = set()
    for line in said:
        for value in decode(line):
            assert not isinstance(value, Unknown | reports.Other), line
            kinds.add(type(value))
    assert kinds >= {readings.Sonar, readings.Victims, readings.Encoder, reports.MissionState}
    assert kinds >= {reports.VehicleConfiguration, reports.Geometry, reports.Configuration}


def test_guesses_are_of_the_roster() -> None:
    """What the client takes for well-known robots does exist."""
    with Rehearsal(world="empty") as stage:
        robots = stage.assembly.robots
        assert [name for name in _CLASSES if robots.describe(name) is None] == []
