"""Pictures as they are wanted: which part is asked for, and what loss, nonsense and closing do."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

import pytest

from usarsim_client import HangupError, NoAnswerError, ProtocolError, Retry
from usarsim_client.cameras import Pictures, Tile
from usarsim_client.link import Address
from usarsim_server.testing import PATIENCE

PIXEL = b"\0\0\0\0\x08" + struct.pack(">HH", 1, 1) + bytes((3, 2, 1, 0))
"""A raw picture of one pixel, blue first."""


class Images:
    """An image server. requests: in order. reply: to each; None hangs up."""

    def __init__(self, reply: Callable[[int], bytes | None]) -> None:
        self.requests: list[bytes] = []
        self.reply = reply

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[Address]:
        """Where it listens."""
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        async with asyncio.timeout(PATIENCE):
            yield Address("127.0.0.1", server.sockets[0].getsockname()[1], PATIENCE)
        server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while first := await reader.read(1):
            self.requests.append(first + await reader.readexactly(1 if first == b"O" else 16))
            answer = self.reply(len(self.requests))
            if answer is None:
                break
            writer.write(answer)
        writer.close()


def tiled(tile: Tile | None) -> Callable[[], Awaitable[Tile | None]]:
    """Finds a tile."""

    async def find() -> Tile | None:
        return tile

    return find


def look(
    reply: Callable[[int], bytes | None],
    tile: Tile | None = None,
    retry: Retry | None = None,
    count: int = 3,
) -> tuple[list[bytes], list[list[int]]]:
    """What was asked for, and the first pixel of each of so many pictures."""

    async def play() -> tuple[list[bytes], list[list[int]]]:
        images, pixels = Images(reply), list[list[int]]()
        async with (
            images.serving() as address,
            Pictures(address, tiled(tile), 0.0, retry) as pictures,
        ):
            async for picture in pictures:
                pixels.append(picture.pixels[0, 0].tolist())
                if len(pixels) == count:
                    break
        return images.requests, pixels

    return asyncio.run(play())


def test_one_request_for_each_picture() -> None:
    """The whole frame, or the tile of a camera; red comes first."""
    assert look(lambda _: PIXEL) == ([b"OK"] * 3, [[1, 2, 3]] * 3)
    requests, _ = look(lambda _: PIXEL, tile=(320, 0, 320, 240))
    assert requests == [b"U" + struct.pack(">4I", 320, 0, 320, 240)] * 3


def test_lost_connections_are_made_again_if_wanted() -> None:
    """Every second request hangs up; without a `Retry` that is the end."""
    every_second: Callable[[int], bytes | None] = lambda count: PIXEL if count % 2 else None  # noqa: E731
    requests, pixels = look(every_second, retry=Retry(first=0.001))
    assert (len(requests), len(pixels)) == (5, 3)
    with pytest.raises(HangupError):
        look(every_second)
    with pytest.raises(HangupError):
        look(lambda _: None, retry=Retry(first=0.001, tries=2))


def test_nonsense_is_no_reason_to_try_again() -> None:
    with pytest.raises(ProtocolError, match="big-endian"):
        look(lambda _: b"\3\xff\xff\xff\xff", retry=Retry(first=0.001))


def test_closing_ends_the_wait() -> None:
    """Somebody waits for a picture that never comes, and the robot has gone."""

    async def play() -> None:
        images = Images(lambda _: b"\0")
        async with images.serving() as address:
            pictures = Pictures(address, tiled(None), 0.0, Retry())
            waiting = asyncio.ensure_future(anext(pictures))
            while not images.requests:  # noqa: ASYNC110
                await asyncio.sleep(0.001)
            await pictures.close()
            with pytest.raises(StopAsyncIteration):
                await waiting

    asyncio.run(play())


def test_robot_without_camera() -> None:
    """What finds the tile may say that there is none."""

    async def none() -> Tile | None:
        raise NoAnswerError("the server has no answer")

    async def play() -> None:
        with pytest.raises(NoAnswerError):
            await anext(Pictures(Address("127.0.0.1", 1, 1.0), none, 0.0, Retry()))

    asyncio.run(play())
