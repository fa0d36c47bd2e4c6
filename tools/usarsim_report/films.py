"""Frames become a file: MP4 by OpenCV, GIF by Pillow; whole or not at all."""

from __future__ import annotations

import os
import secrets
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from usarsim_server.base.errors import UsarsimError, at

Frame = NDArray[np.uint8]
"""(height, width, 3), blue green red, as OpenCV has it."""
KINDS = (".mp4", ".gif")
_TOLD = 5.0
"""s of wall time between two lines of progress."""
_COLOURS = 128
"""Of a GIF."""


def write_film(
    out: Path,
    frames: Iterable[Frame],
    count: int,
    fps: float,
    size: tuple[int, int],
    stopped: list[bool],
) -> int:
    """Write frames until they end or somebody stops; how many.

    Args:
        out: a file of one of `KINDS`. frames: of one size. count: how many are expected.
        fps: a second. size: width and height, pixels. stopped: holds something when it is enough.

    Raises:
        UsarsimError: the file cannot be written.
    """
    fresh = out.with_name(f".new-{secrets.token_hex(8)}{out.suffix.lower()}")
    try:
        fresh.touch()
    except OSError as error:
        cure = "name a file in a folder that exists"
        raise UsarsimError(at(out, f"cannot be written: {error.strerror}", cure)) from None
    told = _Told(count)
    wanted = told.each(frames, stopped)
    try:
        if fresh.suffix == ".gif":
            _write_gif(fresh, wanted, fps)
        else:
            _write_mp4(fresh, out, wanted, fps, size)
        if not told.drawn or not fresh.stat().st_size:
            raise UsarsimError(at(out, "cannot be written: no space is left", "make room"))
        os.replace(fresh, out)
    except OSError as error:
        cure = "name a file in a folder that can be written"
        raise UsarsimError(at(out, f"cannot be written: {error.strerror}", cure)) from None
    finally:
        fresh.unlink(missing_ok=True)
    return told.drawn


def _write_mp4(
    path: Path, out: Path, frames: Iterator[Frame], fps: float, size: tuple[int, int]
) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
    if not writer.isOpened():
        raise UsarsimError(f"{out}: OpenCV cannot write MP4 of {size[0]}x{size[1]} here")
    try:
        for frame in frames:
            writer.write(frame)
    finally:
        writer.release()


def _write_gif(path: Path, frames: Iterator[Frame], fps: float) -> None:
    """For ever round; players know hundredths of a second, and at least two of them."""
    images = (Image.fromarray(frame[..., ::-1]).quantize(_COLOURS) for frame in frames)
    first = next(images, None)
    if first is not None:
        pause = max(round(100 / fps), 2) * 10
        first.save(path, save_all=True, append_images=images, duration=pause, loop=0)


class _Told:
    """Counts frames, and tells how far they are.

    Attributes:
        drawn: how many there were.
    """

    def __init__(self, count: int) -> None:
        self.drawn, self._count, self._last = 0, count, time.monotonic()

    def each(self, frames: Iterable[Frame], stopped: list[bool]) -> Iterator[Frame]:
        """The same frames, until somebody stops; the first one in any case."""
        for frame in frames:
            self.drawn += 1
            yield frame
            if stopped:
                return
            now = time.monotonic()
            if now - self._last >= _TOLD:
                self._last = now
                share = 100 * self.drawn // self._count
                print(f"{self.drawn} of {self._count} frames ({share} %)", file=sys.stderr)
