"""The channel `truth` of the scene port, with a feed that a test makes: time waits for who reads,
and not for long for who does not."""

from __future__ import annotations

import asyncio
from typing import cast

import pytest
from scene_harness import everything, until

from usarsim_client import HangupError
from usarsim_client.scene import TruthRow, connect_scene
from usarsim_server.protocol.scene import message
from usarsim_server.scene.channels import SceneSource
from usarsim_server.scene.truth_channel import TruthChannel
from usarsim_server.scene.truth_feed import Reader, TruthFeed
from usarsim_server.services.scene_port import SceneLimits, ScenePort
from usarsim_server.testing import PATIENCE


class FakeFeed:
    """Rows that a test makes; stands for both feeds."""

    def __init__(self) -> None:
        self.reader: Reader | None = None
        self.starts = 0

    def start(self, reader: Reader) -> None:
        """Somebody wants rows."""
        self.reader, self.starts = reader, self.starts + 1

    def stop(self) -> None:
        """Nobody does."""
        self.reader = None

    def tell(self, number: int, size: int = 0) -> None:
        """A row."""
        assert self.reader is not None
        row = {"type": "truth", "time": number / 10, "robots": [], "victims": [], "views": []}
        self.reader.take(message({**row, "pad": "x" * size}))


async def serving(feed: FakeFeed, limits: SceneLimits) -> tuple[ScenePort, int]:
    """A port with this channel."""
    channel = TruthChannel(cast(TruthFeed, feed))
    source = cast(SceneSource, feed)
    port = ScenePort("127.0.0.1", 0, source, "yard", channels={"truth": channel}, limits=limits)
    return port, (await port.start()).port


async def test_time_waits_for_readers_and_not_for_ever_for_the_deaf() -> None:
    """A reader who takes its time gets every row. One who takes none fills half an outbox: time
    waits for a second, then goes on, and the first row without room ends the connection."""
    feed = FakeFeed()
    limits = SceneLimits(patience=3.0, send_buffer=4096)
    port, number = await serving(feed, limits)
    async with asyncio.timeout(PATIENCE):
        assert feed.starts == 0
        good = await connect_scene("127.0.0.1", number, channels=["truth"])
        deaf = await connect_scene("127.0.0.1", number, channels=["truth"])
        deaf._reader._transport.pause_reading()  # type: ignore[attr-defined]
        await until(lambda: port.connections == 2 and feed.reader is not None)
        assert feed.reader is not None
        waited = rows = 0
        while port.connections == 2:
            if feed.reader.crowded():
                waited += 1
                await asyncio.sleep(0.01)
                continue
            feed.tell(rows, 4000)
            row = await good.truth()
            assert isinstance(row, TruthRow)
            assert row.time == rows / 10
            rows += 1
        assert waited > 20
        assert rows > 30
        assert not feed.reader.crowded()
        deaf._reader._transport.resume_reading()  # type: ignore[attr-defined]
        with pytest.raises((HangupError, OSError)):
            await everything(deaf)
        await good.close()
        await until(lambda: feed.reader is None)
        assert feed.starts == 1
    await port.stop()


async def test_the_end_of_the_feed_ends_connections() -> None:
    """Nobody waits for rows that will never come."""
    feed = FakeFeed()
    port, number = await serving(feed, SceneLimits())
    async with asyncio.timeout(PATIENCE):
        live = await connect_scene("127.0.0.1", number, channels=["truth"])
        await until(lambda: feed.reader is not None)
        assert feed.reader is not None
        feed.reader.end()
        with pytest.raises((HangupError, OSError)):
            await live.truth()
    await port.stop()
