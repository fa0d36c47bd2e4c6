"""A scene port with a feed that a test makes, and what waits at it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any

import numpy as np

from usarsim_client.scene import LiveScene, connect_scene
from usarsim_server.protocol.scene import Instant, message, pose_frame
from usarsim_server.services.scene_port import ScenePort
from usarsim_server.testing import PATIENCE

HELLO: dict[str, object] = {"hello": 1}
PORTS: dict[ScenePort, int] = {}
LARGE = 4_000_000
"""Bytes of a scene that no kernel buffer holds."""


def instant(generation: int = 0, time: float = 1.0, size: int = 0, *kinds: str) -> Instant:
    """Something to be told: a scene of a mesh, and kinds that share one."""
    mesh = message({"type": "mesh", "id": "m:1", "pad": "x" * size})
    scene = message({"type": "scene", "world": "yard", "still": [], "bodies": []})
    present = message(
        {"type": "present", "generation": generation, "time": time, "count": 1, "things": []}
    )
    looks = {one: (("m:1", mesh), (one, message({"type": "kind", "id": one}))) for one in kinds}
    poses = pose_frame(time, generation, np.full((1, 7), generation, np.float32))
    return Instant((("m:1", mesh), ("", scene)), looks, kinds, generation, present, poses)


class FakeFeed:
    """A feed whose instants a test makes."""

    def __init__(self) -> None:
        self.starts, self.stops, self.rates = 0, 0, list[float]()
        self._on_news: Callable[[Instant], None] | None = None
        self.end: Callable[[], None] = lambda: None

    def start(self, on_news: Callable[[Instant], None], on_end: Callable[[], None]) -> None:
        """Somebody looks."""
        self.starts += 1
        self.end = on_end
        self._on_news = on_news

    def stop(self) -> None:
        """Nobody looks."""
        if self._on_news is not None:
            self.stops += 1
        self._on_news = None

    def set_rate(self, rate: float) -> None:
        """Remember it."""
        self.rates.append(rate)

    def tell(self, one: Instant) -> None:
        """Publish."""
        assert self._on_news is not None
        self._on_news(one)

    @property
    def looking(self) -> bool:
        """Whether there is work to do."""
        return self._on_news is not None


@contextlib.asynccontextmanager
async def serving(
    feed: FakeFeed, **options: Any
) -> AsyncIterator[tuple[ScenePort, Callable[..., Coroutine[Any, Any, LiveScene]]]]:
    """A port and what connects to it."""
    port = ScenePort("127.0.0.1", 0, feed, "yard", **options)
    endpoint = await port.start()
    PORTS[port] = endpoint.port

    async def connect(**about: Any) -> LiveScene:
        return await connect_scene("127.0.0.1", endpoint.port, **about)

    try:
        yield port, connect
    finally:
        await port.stop()


async def until(condition: Callable[[], bool]) -> None:
    """Let the loop run until something is so."""
    async with asyncio.timeout(PATIENCE):
        while True:
            if condition():
                return
            await asyncio.sleep(0.002)


async def everything(live: LiveScene) -> None:
    """Read until the connection breaks."""
    while True:
        await live.next()


def run(test: Coroutine[Any, Any, None]) -> None:
    """A test that ends."""

    async def limited() -> None:
        async with asyncio.timeout(PATIENCE):
            await test

    asyncio.run(limited())
