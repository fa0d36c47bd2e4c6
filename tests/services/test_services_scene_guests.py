"""The scene port over sockets: who is refused, cut off, or costs nothing however it behaves."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import socket
import struct
from collections.abc import Mapping

import pytest
from scene_harness import LARGE, PORTS, FakeFeed, everything, instant, run, serving, until

from usarsim_client import HangupError
from usarsim_client.scene import Poses
from usarsim_server.protocol.scene import Instant, message
from usarsim_server.scene.channels import Subscriber
from usarsim_server.services.scene_port import SceneLimits


def test_who_does_not_read_costs_one_frame_and_is_cut_off() -> None:
    """CON-22: a thousand instants go by; another client gets its own meanwhile; then it is out."""

    async def test() -> None:
        feed = FakeFeed()
        limits = SceneLimits(patience=1.0, send_buffer=4096)
        async with serving(feed, limits=limits) as (port, connect):
            deaf, good = await connect(), await connect()
            await until(lambda: feed.looking)
            feed.tell(instant(0, 0.0, LARGE))
            news = await good.next()
            while not isinstance(news, Poses):
                news = await good.next()
            for number in range(1, 1000):
                feed.tell(instant(0, float(number)))
                await asyncio.sleep(0)
            gc.collect()
            assert sum(isinstance(one, Instant) for one in gc.get_objects()) < 10
            while news.time < 999.0:
                feed.tell(instant(0, 999.0))
                following = await good.next()
                news = following if isinstance(following, Poses) else news
            await until(lambda: port.connections == 1)
            with pytest.raises((HangupError, OSError)):
                await everything(deaf)
            await good.close()

    run(test())


def test_rubbish_in_the_middle() -> None:
    """After the welcome, too: refused between frames, cut off within one, never a broken frame."""

    async def test() -> None:
        feed = FakeFeed()
        async with serving(feed, limits=SceneLimits(send_buffer=4096)) as (port, connect):
            for size in (0, LARGE):
                live = await connect()
                await until(lambda: feed.looking)
                feed.tell(instant(0, 0.0, size))
                if size == 0:
                    while not isinstance(await live.next(), Poses):
                        pass
                live._writer.write(b"rubbish" * 3)
                with pytest.raises(HangupError, match="closed" if size else "refuses"):
                    await everything(live)
                await until(lambda: port.connections == 0)

    run(test())


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (message({"hello": 1, "token": "wrong"}), "token"),
        (message({"hello": 1}), "token"),
        (message({"hello": 1, "token": "\ud800"}), "token"),
        (message({"hello": 9, "token": "open sesame"}), "hello"),
        (struct.pack(">IB", 1 << 20, ord("J")) + b" " * (1 << 20), "65536"),
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", "no message"),
        (message({"hello": 1, "token": "open sesame"})[:9], "in time"),
        (b"", "in time"),
    ],
)
def test_who_is_refused_is_told_why(data: bytes, why: str) -> None:
    """CON-28: wrong and missing tokens, a hello of 1 MB, half a hello, none, another protocol; the
    reason arrives although the client goes on sending; others are served."""

    async def test() -> None:
        limits = SceneLimits(hello=0.3)
        async with serving(FakeFeed(), token="open sesame", limits=limits) as (port, connect):
            address = ("127.0.0.1", PORTS[port])
            reader, writer = await asyncio.open_connection(*address)
            writer.write(data)
            answer = await reader.read()
            assert answer[4:5] == b"J"
            told = json.loads(answer[5:])
            assert told["type"] == "refused"
            assert why in told["why"]
            assert "sesame" not in told["why"]
            writer.close()
            live = await connect(token="open sesame")
            await live.close()
            await until(lambda: port.connections == 0)

    run(test())


def test_fifty_come_and_go() -> None:
    """CON-23: no task, no connection and no subscription is left, however they end."""

    async def test() -> None:
        feed = FakeFeed()
        async with serving(feed, limits=SceneLimits(max_connections=64)) as (port, connect):
            tasks = len(asyncio.all_tasks())
            for number in range(50):
                live = await connect()
                if number % 3 == 0:
                    await until(lambda: feed.looking)
                    feed.tell(instant(number, 1.0, 100_000))
                if number % 2:
                    sock = live._writer.get_extra_info("socket")
                    linger = struct.pack("ii", 1, 0)
                    sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
                await live.close()
            await until(lambda: port.connections == 0 and not feed.looking)
            await until(lambda: len(asyncio.all_tasks()) == tasks)

    run(test())


def test_a_full_port() -> None:
    """Who looks keeps its place; a newcomer is turned away and served when there is room."""

    async def test() -> None:
        async with serving(FakeFeed(), limits=SceneLimits(subscribers=2)) as (port, connect):
            one, other = await connect(), await connect()
            with pytest.raises((HangupError, OSError)):
                await connect()
            await one.close()
            await until(lambda: port.connections == 1)
            await (await connect()).close()
            await other.close()

    run(test())


def test_who_has_not_said_hello_makes_room_at_once() -> None:
    async def test() -> None:
        async with serving(FakeFeed(), limits=SceneLimits(max_connections=2)) as (port, connect):
            with contextlib.ExitStack() as stack:
                for _ in range(2):
                    address = ("127.0.0.1", PORTS[port])
                    stack.enter_context(socket.create_connection(address))
                await until(lambda: port.connections == 2)
                await (await asyncio.wait_for(connect(), 2.0)).close()

    run(test())


def test_two_hundred_who_say_nothing_hold_no_place() -> None:
    """A client that says hello gets in beside them, at once or when it tries again."""

    async def test() -> None:
        limits = SceneLimits(hello=0.5)
        async with serving(FakeFeed(), limits=limits) as (port, connect):
            silent = []
            for _ in range(200):
                client = socket.socket()
                client.setblocking(False)
                client.connect_ex(("127.0.0.1", PORTS[port]))
                silent.append(client)
            while True:
                try:
                    live = await connect()
                    break
                except (HangupError, OSError):
                    await asyncio.sleep(0.05)
            await until(lambda: port.connections <= limits.max_connections)
            await live.close()
            for client in silent:
                client.close()
            await until(lambda: port.connections == 0)

    run(test())


def test_nothing_is_done_without_the_token() -> None:
    """Requests that come with a wrong token are not carried out, however many, and a client that
    goes on sending for ever is cut off."""
    asked: list[object] = []

    async def drive(one: Subscriber, fields: Mapping[str, object]) -> Mapping[str, object]:
        asked.append(fields)
        return {}

    async def test() -> None:
        options = {"token": "open sesame", "requests": {"drive": drive}}
        async with serving(FakeFeed(), **options) as (port, connect):
            _, writer = await asyncio.open_connection("127.0.0.1", PORTS[port])
            order = message({"request": "drive", "robot": "R", "line": "DRIVE {Left 9}"})
            writer.write(message({"hello": 1, "token": "sesame"}) + 50 * order)
            taken = 0
            with contextlib.suppress(OSError):
                while taken < 1000:  # 64 MiB
                    writer.write(order * (65536 // len(order)))
                    await writer.drain()
                    taken += 1
            assert taken < 900
            await until(lambda: port.connections == 0)
            assert not asked
            live = await connect(token="open sesame")
            await live.request("drive", robot="R")
            await live.next()
            assert len(asked) == 1
            await live.close()

    run(test())


def test_a_flood_of_requests_waits_its_turn() -> None:
    """Who asks without end, and reads nothing, is answered no further; others are meanwhile."""
    asked: list[str] = []

    async def look(one: Subscriber, fields: Mapping[str, object]) -> Mapping[str, object]:
        asked.append(one.peer)
        return {"pad": "x" * 4000}

    async def test() -> None:
        async with serving(FakeFeed(), requests={"look": look}) as (_, connect):
            flood, good = await connect(channels=[]), await connect(channels=[])
            order = message({"request": "look"})
            flood._writer.write(order * 20_000)
            for _ in range(5):
                await good.request("look")
                reply = await good.next()
                assert isinstance(reply, dict)
                assert reply["ok"]
            await until(lambda: len(set(asked)) == 2)
            await asyncio.sleep(0.2)
            assert len(asked) < 2_000
            await good.close()
            await flood.close()

    run(test())
