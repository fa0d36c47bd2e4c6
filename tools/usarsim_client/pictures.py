"""Requests and replies of the image stream (side channels reference 2.2 to 2.4)."""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from usarsim_client.inbox import Inbox, ProtocolError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from PIL.Image import Image as OpenPicture

FULL_FRAME = b"OK"
"""The request for the full frame."""
HEADER = struct.Struct(">BI")
"""Before each payload: type byte and length."""
_SIDES = struct.Struct(">HH")
MOST_PIXELS = 4096 * 4096
"""Of a picture; no server draws larger ones. A JPEG of some kilobytes may name billions."""
_LARGEST = 1 << 28
"""Bytes; no real frame is larger, but a length read in the wrong byte order is."""


def rectangle(x: int, y: int, width: int, height: int) -> bytes:
    """The request for a part of the frame, pixels."""
    return b"U" + struct.pack(">4I", x, y, width, height)


def row_length(width: int) -> int:
    """Bytes of a raw row: three per pixel, then up to a multiple of four."""
    return -(-3 * width // 4) * 4


@dataclass(frozen=True)
class Picture:
    """One reply; its properties raise `ProtocolError` if the payload is no picture."""

    kind: int  # the type byte
    payload: bytes  # what follows the header

    @property
    def raw(self) -> bool:
        """Whether the type byte says that pixels follow, not a JPEG picture."""
        return self.kind == 0

    @property
    def empty(self) -> bool:
        """Whether it is the answer to a rectangle that does not exist."""
        return self.payload in (b"", bytes(4))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        if self.empty:
            return 0, 0
        if not self.raw:
            with opened(self.payload) as image:
                return image.size
        if len(self.payload) < _SIDES.size:
            raise ProtocolError(
                f"a raw payload of {len(self.payload)} bytes has no width and height"
            )
        width, height = _SIDES.unpack_from(self.payload)
        if width * height > MOST_PIXELS:
            raise ProtocolError(f"a picture of {width} x {height} pixels is no real one")
        return width, height

    @cached_property
    def pixels(self) -> NDArray[np.uint8]:
        """(height, width, 3), red first, top row first."""
        import numpy as np

        if not self.raw:
            return _decoded(self.payload)
        width, height = self.size
        row = row_length(width)
        if len(self.payload) != _SIDES.size + height * row:
            raise ProtocolError(
                f"{len(self.payload)} bytes are no raw picture of {width} x {height} pixels, "
                f"which has {_SIDES.size + height * row}"
            )
        rows = np.frombuffer(self.payload, np.uint8, offset=_SIDES.size).reshape(height, row)
        return rows[:, : 3 * width].reshape(height, width, 3)[:, :, ::-1]


def picture(inbox: Inbox) -> Picture | None:
    """Take a whole reply out of an inbox; see `header`."""
    if len(inbox) < HEADER.size:
        return None
    kind, length = header(inbox.rest[: HEADER.size])
    whole = inbox.exactly(HEADER.size + length)
    return None if whole is None else Picture(kind, whole[HEADER.size :])


def header(data: bytes) -> tuple[int, int]:
    """Type byte and length of the payload, by the `HEADER.size` bytes before it.

    Raises:
        ProtocolError: if no real picture is so long.
    """
    kind, length = HEADER.unpack(data)
    if length > _LARGEST:
        raise ProtocolError(
            f"the header names {length} bytes of payload; is its length big-endian?"
        )
    return kind, length


@contextmanager
def opened(data: bytes) -> Iterator[OpenPicture]:
    """A JPEG picture while it is open, not decoded yet.

    Raises:
        ProtocolError: it is none, turns out to be damaged meanwhile, or has too many pixels.
        ModuleNotFoundError: pillow is not installed.
    """
    try:
        from PIL import Image
    except ImportError:
        text = "JPEG pictures: pillow is not installed (pip install pillow)"
        raise ModuleNotFoundError(text, name="PIL") from None

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            # Formats of others run what is in them, or take far longer.
            image = Image.open(io.BytesIO(data), formats=["JPEG"])
        with image:
            if image.width * image.height > MOST_PIXELS:
                shown = f"{image.width} x {image.height}"
                raise ProtocolError(f"a picture of {shown} pixels is no real one")
            yield image
    except Image.DecompressionBombError:
        raise ProtocolError("a picture of so many pixels is no real one") from None
    except (OSError, SyntaxError, ValueError) as error:
        raise ProtocolError(f"{len(data)} bytes of payload are no JPEG picture: {error}") from None


def _decoded(data: bytes) -> NDArray[np.uint8]:
    import numpy as np

    with opened(data) as image:
        return np.asarray(image.convert("RGB"))
