"""Pictures of a robot's camera, handed on as they come: JPEG in, JPEG out, newest wins."""

from __future__ import annotations

import asyncio
import contextlib
import io
from collections.abc import Callable

from usarsim_client import Picture, ProtocolError, Robot
from usarsim_client.cameras import Pictures, Tile
from usarsim_client.reports import Status

FULL_RATE = 10.0
"""Pictures a second of a robot that a page is about."""
SLOW_RATE = 5.0
"""Pictures a second of the others."""
HASTY_RATE = 1.0
"""Pictures a second of each while a world goes as fast as it can: programs look on."""
_PAUSE = 1.0  # s before a lost camera is tried again


def jpeg(picture: Picture) -> bytes:
    """A picture as JPEG; those that come as JPEG stay as they are.

    Raises:
        ProtocolError: if it is no picture, or has more pixels than pages should have to decode.
    """
    picture.size  # noqa: B018 (looks)
    if not picture.raw:
        return picture.payload
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(picture.pixels).save(out, "JPEG", quality=80)
    return out.getvalue()


class CameraFeed:
    """Asks for pictures while somebody looks.

    Attributes:
        last: s of the gateway's clock of the newest; -inf before. rate: pictures a second.
        count: pictures so far.
    """

    def __init__(self, look: Callable[[], Pictures], show: Callable[[bytes, int], None]) -> None:
        """Begin to look when `rate` is set.

        Args:
            look: begins to look at the image port. show: takes a JPEG and its number.
        """
        self.last, self.rate, self.count = float("-inf"), 0.0, 0
        self._look, self._show = look, show
        self._wanted, self._hurry = asyncio.Event(), asyncio.Event()
        self._task = asyncio.create_task(self._run())

    def want(self, rate: float) -> None:
        """Pictures a second from now on; 0: nobody looks. The next one comes at once if it is more
        than before."""
        if rate > self.rate:
            self._hurry.set()
        self.rate = rate
        (self._wanted.set if rate > 0.0 else self._wanted.clear)()

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await self._wanted.wait()
            try:
                async with self._look() as pictures:
                    async for picture in pictures:
                        began = loop.time()
                        if not picture.empty:
                            self.count += 1
                            self.last = began
                            self._show(jpeg(picture), self.count)
                        self._hurry.clear()
                        with contextlib.suppress(TimeoutError):
                            async with asyncio.timeout(1.0 / max(self.rate, 0.5)):
                                await self._hurry.wait()
                        if not self.rate:
                            break
            except (OSError, ProtocolError, TimeoutError):
                await asyncio.sleep(_PAUSE)

    async def close(self) -> None:
        """Stop looking."""
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)


Grid = tuple[int, int]
"""Columns and rows of the pictures of cameras in the picture of the image port."""


def look_at(robot: Robot, camera: str, grid: Grid | None, full: Callable[[], Pictures]) -> Pictures:
    """Look through a camera: at the tile that its CONF tells, or that its STA numbers.

    Args:
        robot: whose camera. camera: its name.
        grid: of servers that tell no tile (`ut2004`); None: they are shown as they are.
        full: looks at the whole picture, to learn how large it is.
    """

    async def find() -> Tile | None:
        told = (await robot.camera(camera)).tile
        if told is not None or grid is None:
            return told
        status = robot.newest(Status)
        if status is None:
            raise TimeoutError(f"{robot.name} has not told its tile yet")
        if status.view < 0:
            return None
        async with full() as pictures:
            width, height = (await anext(pictures)).size
        (columns, rows), view = grid, status.view
        wide, high = width // columns, height // rows
        return view % columns * wide, view // columns % rows * high, wide, high

    return robot.through(find)
