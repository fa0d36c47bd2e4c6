"""The scene port of a server: the live true world, as shapes and poses (docs/scene-port.md).

    async with await connect_scene("127.0.0.1", 4000) as world:
        async for news in world:
            if isinstance(news, Poses):
                print(news.time, news.of(world.find("R1")))

`SceneReader` makes values of bytes and knows no socket. Everything is in the frame of the feed:
x forward, y left, z up; metres, seconds of simulated time, quaternions w, x, y, z.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from usarsim_client.inbox import HangupError, ProtocolError
from usarsim_client.truth import TruthRow as TruthRow  # part of what this module hands out
from usarsim_client.truth import truth_row
from usarsim_server.base.addresses import bare_host
from usarsim_server.protocol.json_text import parse_json
from usarsim_server.protocol.scene import POSES, VERSION, frames, message

LONGEST = 64 * 1024 * 1024
"""Bytes of a frame that is believed."""
_CHUNK = 65536

Message = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Thing:
    """A robot, an object or an avatar that is present."""

    id: int  # never used again
    what: str  # robot, object or avatar
    name: str
    class_name: str
    kind: str  # id of its looks
    first: int  # number of the pose of its first body
    lit: bool = False  # its headlight is on
    stuck: bool = False  # it is told to move and does not


@dataclass(frozen=True, slots=True)
class Present:
    """Who is there beside the scene."""

    generation: int  # of the poses that belong to it
    time: float  # simulated s
    count: int  # of poses
    things: tuple[Thing, ...]

    def find(self, name: str) -> Thing | None:
        """The thing of a name, whatever its case."""
        wanted = name.lower()
        return next((one for one in self.things if one.name.lower() == wanted), None)


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Where everything is at one instant."""

    time: float  # simulated s
    generation: int  # of the `Present` that tells whose they are
    rows: NDArray[np.float32]  # (n, 7): x, y, z (m), w, x, y, z

    def of(self, thing: Thing | None) -> NDArray[np.float32] | None:
        """Pose (7,) of the reference point of a thing; None for None."""
        return None if thing is None else self.rows[thing.first]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The scenery as the server describes it, see the page of the format.

    Attributes:
        message: the whole `scene` message.
    """

    message: Message

    @property
    def world(self) -> str:
        """Name of the world."""
        return str(self.message["world"])

    @property
    def bodies(self) -> Sequence[Message]:
        """What moves, in the order of the poses."""
        bodies: Sequence[Message] = self.message["bodies"]
        return bodies

    @property
    def still(self) -> Sequence[Message]:
        """What never moves; the scenery first."""
        still: Sequence[Message] = self.message["still"]
        return still


News = Scene | Present | Poses | TruthRow | Message
"""What comes: other messages (`mesh`, `texture`, `kind`, `reply`, ...) stay as they are."""


@dataclass(slots=True)
class SceneReader:
    """Makes values of the bytes that a server sends, and keeps what they refer to.

    Attributes:
        scene, present: the newest; None before the first.
        kinds, meshes, textures: messages by id.
    """

    scene: Scene | None = None
    present: Present | None = None
    kinds: dict[str, Message] = field(default_factory=dict)
    meshes: dict[str, Message] = field(default_factory=dict)
    textures: dict[str, Message] = field(default_factory=dict)
    _held: bytearray = field(default_factory=bytearray)

    def feed(self, data: bytes) -> list[News]:
        """Take the next bytes; what they complete, in order.

        Raises:
            ProtocolError: if they are no frames of this format.
        """
        self._held += data
        found: list[News] = []
        try:
            for kind, payload in frames(self._held, LONGEST):
                if kind == b"J":
                    found.append(self._message(parse_json(payload)))
                elif kind == b"P":
                    found.append(_poses(payload))
        except (ValueError, KeyError, TypeError, struct.error) as error:
            raise ProtocolError(f"this is no scene port: {error}") from error
        return found

    def _message(self, fields: Message) -> News:
        kind = fields["type"]
        tables = {"mesh": self.meshes, "texture": self.textures, "kind": self.kinds}
        if kind == "scene":
            self.scene = Scene(fields)
            return self.scene
        if kind == "present":
            self.present = _present(fields)
            return self.present
        if kind == "truth":
            return truth_row(fields)
        if kind in tables:
            tables[kind][fields["id"]] = fields
        return fields


def _present(fields: Message) -> Present:
    things = tuple(
        Thing(
            one["id"],
            one["what"],
            one["name"],
            one["class"],
            one["kind"],
            one["first"],
            bool(one.get("lit")),
            bool(one.get("stuck")),
        )
        for one in fields["things"]
    )
    return Present(fields["generation"], fields["time"], fields["count"], things)


def _poses(payload: bytes) -> Poses:
    time, generation, count = POSES.unpack_from(payload)
    rows = np.frombuffer(payload, "<f4", count * 7, POSES.size).reshape(count, 7)
    return Poses(time, generation, rows)


class LiveScene:
    """A connection to a scene port; iterate over it for the news.

    Attributes:
        reader: what has come so far.
        welcome: the server's answer to the hello.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = SceneReader()
        self.welcome: Message = {}
        self._reader, self._writer = reader, writer
        self._waiting: list[News] = []
        self._asked = 0

    def find(self, name: str) -> Thing | None:
        """The thing of a name that is present now, whatever its case."""
        return None if self.reader.present is None else self.reader.present.find(name)

    async def send(self, fields: Mapping[str, object]) -> None:
        """Send a message; `OSError` if the connection is gone."""
        self._writer.write(message(fields))
        await self._writer.drain()

    async def request(self, request: str, **fields: object) -> int:
        """Ask for something; the `reply` with this `id` comes among the news."""
        self._asked += 1
        await self.send({"request": request, "id": self._asked, **fields})
        return self._asked

    async def next(self) -> News:
        """What comes next.

        Raises:
            HangupError: if the server has ended the connection; with its reason if it said one.
            ProtocolError: if it speaks something else.
        """
        while not self._waiting:
            data = await self._reader.read(_CHUNK)
            if not data:
                raise HangupError("the server closed the scene port's connection")
            self._waiting += self.reader.feed(data)
        news = self._waiting.pop(0)
        if isinstance(news, dict) and news["type"] == "refused":
            raise HangupError(f"the scene port refuses: {news.get('why')}")
        return news

    async def poses(self) -> Poses:
        """The next poses whose owners are known; what comes before them is skipped."""
        while True:
            news = await self.next()
            present = self.reader.present
            if isinstance(news, Poses) and present and present.generation == news.generation:
                return news

    async def truth(self) -> TruthRow:
        """The next row of the channel `truth`; what comes before it is skipped."""
        while True:
            news = await self.next()
            if isinstance(news, TruthRow):
                return news

    async def __aiter__(self) -> AsyncIterator[News]:
        """All news until the server ends the connection."""
        while True:
            try:
                yield await self.next()
            except HangupError:
                return

    async def close(self) -> None:
        """Hang up."""
        self._writer.close()

    async def __aenter__(self) -> Self:
        """Use as a context manager."""
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self.close()


async def connect_scene(
    host: str,
    port: int,
    *,
    token: str = "",
    channels: Sequence[str] = ("scene", "poses"),
    rate_hz: float = 30.0,
    streams: bool = True,
) -> LiveScene:
    """Connect to a scene port and say hello; time limits are the caller's.

    Args:
        host: address of the server. port: its scene port.
        token: what the server was given as `--scene-token`.
        channels: what is wanted.
        rate_hz: poses per s of wall time, at most.
        streams: whether `lines` shall show what robots report again and again.

    Raises:
        OSError: if nobody accepts.
        HangupError: if the server refuses, with the reason.
        ProtocolError: if it speaks something else.
    """
    live = LiveScene(*await asyncio.open_connection(bare_host(host), port))
    hello: Message = {"hello": VERSION, "token": token, "channels": list(channels)}
    hello |= {"rate_hz": rate_hz, "streams": streams}
    try:
        await live.send(hello)
        news = await live.next()
        if not isinstance(news, dict) or news["type"] != "welcome":
            raise ProtocolError("no welcome came first: is this a scene port?")
        live.welcome = news
    except BaseException:
        await live.close()
        raise
    return live
