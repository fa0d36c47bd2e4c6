"""From a part of a frame to the bytes that answer a request (side channels reference 2.3, 2.4).

An `Encoder` may be used by several threads at once. While it works it lets other Python threads
run: the physics must not wait for a JPEG.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.view import Frame, Region
from usarsim_server.protocol.images import ImageType, raw_header, raw_row_length, reply_header

JpegCodec = Callable[[NDArray[np.uint8], int, bytes], memoryview]
"""Makes a JPEG: pixels (height, width, 3) uint8 red green blue, quality 0 to 100, head.

Returns the head and behind it a complete JPEG file with 4:2:0 chroma.
"""

GREY = 128
"""Value of all channels of a picture that stands for one that did not come."""

LONGEST_SIDE = 65500
"""Pixels along a side of a JPEG that libjpeg makes."""

CACHE_BYTES = 32 * 1024 * 1024
"""Encoded pictures that are kept; eight raw frames of 1280 x 960."""


class Encoder:
    """Encodes regions of frames, each but once while it is the newest of its region."""

    def __init__(
        self,
        image_type: ImageType,
        jpeg: JpegCodec | None = None,
        cache_bytes: int = CACHE_BYTES,
    ) -> None:
        """Make an encoder of pictures of one type, with an empty cache of so many bytes."""
        self._type = image_type
        self._jpeg = jpeg or encode_jpeg
        self._budget = cache_bytes
        self._lock = threading.Lock()
        # The newest of each region with the number of its frame; the one used last at the end.
        self._kept: dict[Region, tuple[int, memoryview]] = {}
        self._bytes = 0

    @property
    def image_type(self) -> ImageType:
        """Of all pictures."""
        return self._type

    @property
    def kept_bytes(self) -> int:
        """Size of the pictures that are kept."""
        return self._bytes

    def found(self, frame: Frame, region: Region) -> memoryview | None:
        """The encoded region if it is at hand; returns at once."""
        with self._lock:
            number, message = self._kept.get(region, (None, None))
            if message is None or number != frame.number:
                return None
            self._kept[region] = self._kept.pop(region)
            return message

    def encode(self, frame: Frame, region: Region) -> memoryview:
        """The whole reply, header and payload, for a region inside the frame; read-only.

        Takes milliseconds if it is not at hand.

        Raises:
            ValueError: if the region is not inside the frame, or too large for its encoding.
        """
        message = self.found(frame, region)
        if message is None:
            message = self._encode(frame.cut(region))
            self._keep(frame.number, region, message)
        return message

    def grey(self, region: Region) -> memoryview:
        """The whole reply with a grey picture of a region's size."""
        shape = (region.height, region.width, 3)
        return self._encode(np.full(shape, GREY, dtype=np.uint8))

    def _encode(self, pixels: NDArray[np.uint8]) -> memoryview:
        if self._type.quality is None:
            return _raw(pixels, self._type)
        # The length is known only when the payload is there; the place for it is not copied later.
        head = reply_header(self._type, 0)
        message = self._jpeg(pixels, self._type.quality, head)
        message[: len(head)] = reply_header(self._type, len(message) - len(head))
        return message.toreadonly()

    def _keep(self, number: int, region: Region, message: memoryview) -> None:
        with self._lock:
            kept, old = self._kept.get(region, (-1, memoryview(b"")))
            if number <= kept or len(message) > self._budget:
                return
            self._kept.pop(region, None)
            self._bytes -= len(old)
            while self._bytes + len(message) > self._budget:
                _, oldest = self._kept.pop(next(iter(self._kept)))
                self._bytes -= len(oldest)
            self._kept[region] = number, message
            self._bytes += len(message)


def encode_jpeg(pixels: NDArray[np.uint8], quality: int, head: bytes) -> memoryview:
    """A `JpegCodec`: OpenCV, which is libjpeg-turbo, and lets other threads run meanwhile.

    Raises:
        ValueError: if a side is longer than a JPEG may have.
    """
    height, width = pixels.shape[:2]
    if max(height, width) > LONGEST_SIDE:
        raise ValueError(f"cannot encode {width} x {height} pixels: a side has {LONGEST_SIDE}")
    import cv2  # 16 MiB, for servers whose pictures somebody takes

    settings = [cv2.IMWRITE_JPEG_QUALITY, quality]
    settings += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
    _, payload = cv2.imencode(".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), settings)
    message = bytearray(head)
    message += payload.tobytes()
    return memoryview(message)


def encode_png(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """A PNG file of a picture.

    Args:
        pixels: (height, width, 3), red first, or (height, width) of grey values with 8 or 16 bits.
    """
    import cv2

    if pixels.ndim == 3:
        pixels = pixels[..., ::-1]
    _, content = cv2.imencode(".png", pixels)
    return content.tobytes()


def _raw(pixels: NDArray[np.uint8], image_type: ImageType) -> memoryview:
    """Header, size, and rows of blue, green, red, each filled up to a multiple of four bytes."""
    height, width = pixels.shape[:2]
    row = raw_row_length(width)
    size = raw_header(width, height)
    head = reply_header(image_type, len(size) + height * row) + size
    message = bytearray(len(head) + height * row)
    message[: len(head)] = head
    rows = np.frombuffer(message, np.uint8, offset=len(head)).reshape(height, row)
    filled = rows[:, : 3 * width].reshape(height, width, 3)
    for channel in range(3):  # four times as fast as one copy with the channels reversed
        filled[:, :, channel] = pixels[:, :, 2 - channel]
    return memoryview(message).toreadonly()
