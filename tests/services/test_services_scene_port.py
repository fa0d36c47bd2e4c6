"""The scene port over sockets, with a feed that a test makes: what a client gets, and when."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Mapping

import pytest
from scene_harness import LARGE, FakeFeed, instant, run, serving, until

from usarsim_client import HangupError
from usarsim_client.scene import Poses, Present, Scene
from usarsim_server.protocol.scene import Hello, SceneError, message
from usarsim_server.scene import channels
from usarsim_server.scene.channels import Board, Subscriber, Subscription
from usarsim_server.services.scene_port import SceneLimits


def test_scene_first_then_who_is_there_then_poses() -> None:
    """What a message refers to comes before it, once; a pose comes after who it is of."""

    async def test() -> None:
        feed = FakeFeed()
        async with serving(feed) as (_, connect), await connect() as live:
            assert live.welcome["world"] == "yard"
            await until(lambda: feed.looking)
            feed.tell(instant(4, 1.0, 0, "A"))
            first = [await live.next() for _ in range(5)]
            types = [one["type"] if isinstance(one, dict) else type(one) for one in first]
            assert types == ["mesh", Scene, "kind", Present, Poses]
            feed.tell(instant(5, 2.0, 0, "A", "B"))
            again = [await live.next() for _ in range(3)]
            assert isinstance(again[0], dict)
            assert (again[0]["type"], again[0]["id"]) == ("kind", "B")
            assert isinstance(again[1], Present)
            assert isinstance(again[2], Poses)
            assert (again[1].generation, again[2].generation, again[2].time) == (5, 5, 2.0)

    run(test())


def test_nothing_is_made_while_nobody_looks() -> None:
    """The feed starts with the first who looks and stops with the last; several share it."""

    async def test() -> None:
        feed = FakeFeed()
        async with serving(feed) as (port, connect):
            threads = threading.active_count()
            for _ in range(2):
                one, other = await connect(rate_hz=5.0), await connect(rate_hz=20.0)
                await until(lambda: feed.looking and max(feed.rates) == 20.0)
                await one.close()
                await other.close()
                await until(lambda: port.connections == 0)
                assert not feed.looking
            assert (feed.starts, feed.stops) == (2, 2)
            assert threading.active_count() == threads
            silent = await connect(channels=[])
            assert not feed.looking
            await silent.close()

    run(test())


def test_a_slow_reader_gets_the_newest() -> None:
    """Between two reads of a client instants are left out, and none is out of order."""

    async def test() -> None:
        feed = FakeFeed()
        async with serving(feed, limits=SceneLimits(send_buffer=4096)) as (_, connect):
            live = await connect()
            await until(lambda: feed.looking)
            feed.tell(instant(0, 0.0, LARGE))
            await asyncio.sleep(0.05)
            for number in range(1, 500):
                feed.tell(instant(number // 10, float(number)))
            times, generations = list[float](), list[int]()
            while not times or times[-1] < 499.0:
                news = await live.next()
                if isinstance(news, Poses):
                    times.append(news.time)
                    assert generations[-1] == news.generation
                elif isinstance(news, Present):
                    generations.append(news.generation)
            assert len(times) < 20
            assert times == sorted(times)
            await live.close()

    run(test())


def test_the_last_of_a_burst_comes_without_another() -> None:
    """CON-22: poses that come too early for the rate of a client are told when that is over."""

    async def test() -> None:
        feed = FakeFeed()
        async with serving(feed) as (_, connect):
            live = await connect(rate_hz=20.0)
            await until(lambda: feed.looking)
            for number in range(3):
                feed.tell(instant(0, float(number)))
                await asyncio.sleep(0.01)
            times = list[float]()
            while times[-1:] != [2.0]:
                news = await live.next()
                times += [news.time] if isinstance(news, Poses) else []
            await live.close()

    run(test())


def test_a_higher_rate_holds_at_once() -> None:
    """CON-22: who looked every 10 s and wants 30 a second does not wait for the 10 s to pass."""

    async def test() -> None:
        subscriber, clock = Subscriber("peer", Hello("", ("poses",), 0.1)), [100.0]
        board = Board(FakeFeed())
        poses = channels.Poses(board, subscriber)
        poses._clock = lambda: clock[0]
        told = (0.0, 0.1, True), (5.0, 0.1, True), (1.0, 0.1, False), (0.1, 30.0, True)
        for wait, rate, due in told:
            clock[0] += wait
            subscriber.rate_hz = rate
            board._publish(instant(0, clock[0]))
            assert (poses.take() is not None) is due, (wait, rate)

    run(test())


def test_requests() -> None:
    """`rate` takes effect; what is unknown or wrong is answered, and the connection lives on."""

    async def test() -> None:
        feed = FakeFeed()
        async with serving(feed) as (_, connect), await connect() as live:
            await until(lambda: feed.looking)
            for fields, ok in (
                ({"request": "rate", "id": 1, "rate_hz": 5}, True),
                ({"request": "jump", "id": "x"}, False),
                ({"request": "rate", "id": 3, "rate_hz": []}, False),
                ({"request": ["rate"], "id": {}}, False),
                ({}, False),
            ):
                await live.send(fields)
                reply = await live.next()
                assert isinstance(reply, dict)
                assert reply["type"] == "reply"
                assert reply["ok"] is ok
                named = fields.get("id")
                assert reply["id"] == (named if isinstance(named, int | str) else None)
                assert ok or reply["why"]
            assert feed.rates[-1] == 5.0

    run(test())


def test_further_channels_and_requests() -> None:
    """Both tables can be added to; a handler may refuse; a defect ends one connection only."""

    class Ticks:
        closed = 0

        def __init__(self, subscriber: Subscriber) -> None:
            self.left = 2
            subscriber.wake_soon()

        def take(self) -> bytes | None:
            self.left -= 1
            return message({"type": "tick"}) if self.left >= 0 else None

        def close(self) -> None:
            Ticks.closed += 1

    async def double(subscriber: Subscriber, fields: Mapping[str, object]) -> Mapping[str, object]:
        value = fields.get("value")
        if not isinstance(value, int):
            raise SceneError("no number")
        if value == 13:
            raise RuntimeError("a defect")
        return {"twice": 2 * value, "peer": subscriber.peer}

    def make(subscriber: Subscriber) -> Subscription:
        return Ticks(subscriber)

    async def test() -> None:
        options = {"channels": {"ticks": make}, "requests": {"double": double}}
        async with serving(FakeFeed(), **options) as (port, connect):
            live = await connect(channels=["ticks"])
            assert live.welcome["requests"] == ["double", "rate"]
            assert [await live.next() for _ in range(2)] == [{"type": "tick"}] * 2
            await live.request("double", value=21)
            reply = await live.next()
            assert isinstance(reply, dict)
            assert reply["twice"] == 42
            await live.request("double", value="a")
            assert (await live.next())["why"] == "no number"  # type: ignore[index]
            await live.request("double", value=13)
            with pytest.raises(HangupError):
                await live.next()
            await until(lambda: port.connections == 0)
            assert Ticks.closed == 1
            await (await connect()).close()

    run(test())


def test_a_feed_that_fails_lets_everybody_go() -> None:
    """Nobody is left with a picture of the past; who comes again starts it anew."""

    async def test() -> None:
        feed = FakeFeed()
        async with serving(feed) as (port, connect):
            live = await connect()
            await until(lambda: feed.looking)
            feed.tell(instant())
            while not isinstance(await live.next(), Poses):
                pass
            feed.end()
            with pytest.raises(HangupError):
                await live.next()
            await until(lambda: port.connections == 0)
            again = await connect()
            await until(lambda: feed.looking)
            feed.tell(instant())
            assert isinstance(await again.next(), dict)
            await again.close()

    run(test())
