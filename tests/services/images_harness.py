"""An image service on a real port, with a renderer that a test plays by hand."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from services_harness import Client, LoopClock, OnLoop

from usarsim_server.cameras.encoding import Encoder, JpegCodec
from usarsim_server.cameras.view import Frame, Grid, Region
from usarsim_server.protocol.images import RAW, ImageType
from usarsim_server.services.images import ImageLimits, ImageService

GRID = Grid(columns=2, rows=2, tile_width=64, tile_height=48)
BIG = Grid()
TILE = Region(64, 48, 64, 48)


def rectangle(x: int, y: int, width: int, height: int) -> bytes:
    """A request for a part of the frame."""
    return b"U" + struct.pack(">4I", x, y, width, height)


TILE_REQUEST = rectangle(TILE.x, TILE.y, TILE.width, TILE.height)


class FakeWatch:
    """One look at a fake source."""

    def __init__(
        self, source: FakeSource, region: Region, on_frame: Callable[[Frame], None]
    ) -> None:
        self.region = region
        self.on_frame = on_frame
        self._source = source

    def look_at(self, region: Region) -> None:
        """Change what is looked at."""
        self.region = region

    def close(self) -> None:
        """Look away."""
        if self in self._source.watches:
            self._source.watches.remove(self)


class FakeSource:
    """A renderer: frames are even pictures whose value the test chooses.

    Attributes:
        fresh: whether the last frame counts as up to date.
        watches: those that are open.
        most_watches: how many were open at the same time.
    """

    def __init__(self, grid: Grid = GRID, value: int | None = 0) -> None:
        self.grid = grid
        self.fresh = value is not None
        self.watches: list[FakeWatch] = []
        self.most_watches = 0
        self.failure: Exception | None = None
        self._frame: Frame | None = None
        if value is not None:
            self.show(value)

    def show(self, value: int, *, fresh: bool = True) -> None:
        """Render a frame of this value and tell everybody who looks."""
        number = self._frame.number + 1 if self._frame else 1
        pixels = np.full((self.grid.height, self.grid.width, 3), value, dtype=np.uint8)
        self._frame, self.fresh = Frame.of(number, 0.1 * number, pixels), fresh
        for watch in tuple(self.watches):
            watch.on_frame(self._frame)

    def newest(self, region: Region) -> Frame | None:
        """The last frame if it is up to date."""
        if self.failure is not None:
            raise self.failure
        return self._frame if self.fresh else None

    def watch(self, region: Region, on_frame: Callable[[Frame], None]) -> FakeWatch:
        """Remember who looks."""
        watch = FakeWatch(self, region, on_frame)
        self.watches.append(watch)
        self.most_watches = max(self.most_watches, len(self.watches))
        return watch

    @property
    def looked_at(self) -> set[Region]:
        """Regions that somebody looks at."""
        return {watch.region for watch in self.watches}


class ImageClient(Client):
    """An image client that reads whole replies."""

    def reply(self) -> tuple[int, bytes]:
        """Type byte and payload of the next reply."""
        header = self.exactly(5)
        return header[0], self.exactly(int.from_bytes(header[1:]))

    def value(self, size: tuple[int, int] = (GRID.width, GRID.height)) -> int:
        """The one value of all pixels of the next reply, which must be raw and of this size."""
        kind, payload = self.reply()
        assert kind == 0
        assert struct.unpack(">2H", payload[:4]) == size
        assert len(payload) == 4 + 3 * size[0] * size[1]
        values = set(payload[4:])
        assert len(values) == 1, "a picture of two frames, or out of step"
        return values.pop()

    def exactly(self, count: int) -> bytes:
        """The next bytes."""
        data = bytearray()
        while len(data) < count:
            chunk = self.socket.recv(min(count - len(data), 1 << 16))
            if not chunk:
                raise ConnectionError("the server closed the connection")
            data += chunk
        return bytes(data)


class RunningImages(OnLoop):
    """An image service."""

    def __init__(
        self,
        source: FakeSource,
        image_type: ImageType = RAW,
        codec: JpegCodec | None = None,
        limits: ImageLimits | None = None,
        legacy: bool = False,
        silent_push: float = 0.0,
        bound: Callable[[str], Region | None] | None = None,
        stopped_clock: bool = False,
    ) -> None:
        if stopped_clock:
            limits = replace(limits or ImageLimits(), type_lead=0.0)
        self.source = source
        self.encoder = Encoder(image_type, codec)
        self.service = ImageService(
            "127.0.0.1",
            0,
            source,
            self.encoder,
            legacy=legacy,
            silent_push=silent_push,
            bound=bound,
            limits=limits,
        )
        super().__init__(self.service)
        self.clock = LoopClock(self.loop) if stopped_clock else None
        [self.endpoint] = self.begin()

    def turn(self, seconds: float) -> None:
        """Let the time of a service with a stopped clock pass."""
        assert self.clock is not None
        self.clock.turn(seconds)

    def connect(self, **buffers: int) -> ImageClient:
        """A new client; buffers as for `Client`."""
        client = ImageClient((self.endpoint.host, self.endpoint.port), **buffers)
        self.clients.append(client)
        return client
