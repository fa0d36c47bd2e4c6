"""A small image server: a synthetic frame with sky above and ground below."""

from __future__ import annotations

import asyncio
import io
import struct

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from usarsim_conformance.mutants.side_world import MiniWorld

_ROWS, _COLUMNS = 6, 2
"""Tiles for more robots than have a place."""
_WIDTH, _HEIGHT = 64 * _COLUMNS, 48 * _ROWS


def _scene() -> NDArray[np.uint8]:
    """A view for each tile, with blue sky over grey ground; red first."""
    view = np.full((48, 64, 3), 110, np.uint8)
    view[:24] = (120, 160, 220)
    view[30:34, 20:40] = (40, 40, 40)
    return np.tile(view, (_ROWS, _COLUMNS, 1))


class MiniImages:
    """Serves image clients.

    Attributes:
        kind: the type byte: 0 for raw pixels, another one for JPEG.
    """

    def __init__(self, world: MiniWorld, kind: int = 0) -> None:
        self._has = world.has
        self.kind = kind
        self._pixels = _scene()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client."""
        if self._has("image-banner"):
            writer.write(b"WELCOME\r\n")
        if self._has("image-line-based"):
            while line := await reader.readline():
                if line.upper().startswith(b"OK"):
                    writer.write(self._reply(None))
            return
        held = b""
        while data := await reader.read(65536):
            sent = b""
            requests, held = self._cut(data if self._has("image-no-buffer") else held + data)
            for request in requests:
                sent = self._reply(request)
                if not self._has("image-coalesced"):
                    writer.write(sent)
            if self._has("image-coalesced"):
                writer.write(sent)
            if held == b"close":
                return
            await writer.drain()

    def _cut(self, data: bytes) -> tuple[list[tuple[int, ...] | None], bytes]:
        """Requests, None for the full frame, and what is left for the next time."""
        found: list[tuple[int, ...] | None] = []
        while data:
            two = data[:2].upper() if self._has("image-any-case") else data[:2]
            if two[:1] == b"O":
                if len(data) < 2:
                    return found, data
                if two == b"OK":
                    found.append(None)
                step = 1 if self._has("image-ook") and two != b"OK" else 2
                data = data[step:]
            elif data[:1] == b"U":
                if len(data) < 17:
                    return found, data
                found.append(struct.unpack(">4I", data[1:17]))
                data = data[1:] if self._has("image-reads-arguments") else data[17:]
            else:
                if self._has("image-strict"):
                    return found, b"close"
                if self._has("image-answers-newline") and data[:1] == b"\n":
                    found.append(None)
                data = data[1:]
        return found, b""

    def _reply(self, request: tuple[int, ...] | None) -> bytes:
        x, y, width, height = request or (0, 0, _WIDTH, _HEIGHT)
        kind = 3 if request and self._has("image-two-types") else self.kind
        inside = x + width <= _WIDTH and y + height <= _HEIGHT and width and height
        if not inside and self._has("image-silent-outside"):
            return b""
        payload = (
            self._payload(kind, self._pixels[y : y + height, x : x + width]) if inside else b""
        )
        if not inside and not kind:
            payload = bytes(4)
        if self._has("image-length-of-all"):
            return struct.pack(">BI", kind, len(payload) + 5) + payload
        order = "<" if self._has("image-little-endian") else ">"
        return struct.pack(f"{order}BI", kind, len(payload)) + payload

    def _payload(self, kind: int, pixels: NDArray[np.uint8]) -> bytes:
        if self._has("image-upside-down"):
            pixels = pixels[::-1]
        if kind:
            file = io.BytesIO()
            Image.fromarray(np.ascontiguousarray(pixels)).save(file, "JPEG", quality=50)
            return file.getvalue()[: -2 if self._has("image-cut-jpeg") else None]
        height, width = pixels.shape[:2]
        order = pixels if self._has("image-rgb") else pixels[:, :, ::-1]
        rows = order.reshape(height, 3 * width)
        if not self._has("image-no-padding"):
            rows = np.pad(rows, ((0, 0), (0, -3 * width % 4)))
        return struct.pack(">2H", width, height) + rows.tobytes()
