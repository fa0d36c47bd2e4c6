"""The file of a recorded console session; no socket, no clock.

It is a sequence of frames, each written whole at once and appended to those before it:

    u32 n (big-endian)  u8 kind  f64 gateway clock, s (little-endian)  n - 9 bytes of contents

Kind `T` is a JSON text, `Z` the same compressed (zlib), `B` a binary message as pages get them
(docs/console-protocol.md). The first frame is the header. So what was recorded survives the end of
everybody involved: a last frame that is cut off is passed over by the reader.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import threading
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from usarsim_operator import packets
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.private import private
from usarsim_server.protocol.json_text import parse_json
from usarsim_server.protocol.scene import SceneError, frames

FORMAT = 1
LONGEST = 64 * 1024 * 1024
"""Bytes of a frame that is believed."""
_TEXT, _PACKED, _BINARY = b"T", b"Z", b"B"
_FRAME = struct.Struct(">Ic")
_CLOCK = struct.Struct("<d")
_COMPRESSED = 400  # bytes of a text from which on it is compressed
_CHUNK = 1 << 18

Fields = Mapping[str, Any]


class RecordingError(UsarsimError):
    """A recording cannot be written or read."""


@dataclass(frozen=True, slots=True)
class Text:
    """A JSON text. clock: s of the gateway's clock."""

    clock: float
    fields: Fields


@dataclass(frozen=True, slots=True)
class Packet:
    """A binary message for pages. time: simulated s. robot: its index in the newest `state`."""

    clock: float
    kind: int  # one of `packets`
    robot: int
    time: float
    contents: bytes


class Writer:
    """Appends frames to a new file; any thread may use it.

    Attributes:
        size: bytes so far.
    """

    def __init__(self, path: Path, about: Fields) -> None:
        """Begin a file; `about` goes into the header.

        Raises:
            RecordingError: if the file is there already or cannot be written.
        """
        self.path, self.size = path, 0
        self._lock = threading.Lock()
        try:
            descriptor = private(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
            self._file: BinaryIO = os.fdopen(descriptor, "wb", buffering=0)
        except FileExistsError:
            cure = "name another file, or remove this one"
            raise RecordingError(at(path, "exists already", cure)) from None
        except OSError as error:
            cure = "name a file in a folder that exists"
            problem = f"cannot be written: {error.strerror}"
            raise RecordingError(at(path, problem, cure)) from None
        header = {"type": "recording", "usarsim_console_recording": FORMAT, **about}
        self.text(0.0, json.dumps(header))

    def text(self, clock: float, text: str) -> None:
        """Append a JSON text.

        Raises:
            OSError: if the disk is full, for example; the file then ends with the last whole frame.
        """
        data = text.encode("utf-8", "replace")
        if len(data) < _COMPRESSED:
            self._write(_TEXT, clock, data)
        else:
            self._write(_PACKED, clock, zlib.compress(data, 1))

    def binary(self, clock: float, data: bytes) -> None:
        """Append a binary message; errors as of `text`."""
        self._write(_BINARY, clock, data)

    def _write(self, kind: bytes, clock: float, data: bytes) -> None:
        length = 1 + _CLOCK.size + len(data)
        whole = memoryview(_FRAME.pack(length, kind) + _CLOCK.pack(clock) + data)
        written = 0
        with self._lock:
            if self._file.closed:
                return
            try:
                while written < len(whole):
                    written += self._file.write(whole[written:])
            except OSError:
                with contextlib.suppress(OSError):
                    self._file.truncate(self.size)
                raise
            self.size += written

    def close(self) -> None:
        """End the file; what comes later is dropped."""
        with self._lock:
            if not self._file.closed:
                with contextlib.suppress(OSError):
                    os.fsync(self._file.fileno())
                self._file.close()


class Recording:
    """A recorded session, read from the file whenever it is asked for.

    Attributes:
        header: what was told about the session.
    """

    def __init__(self, path: Path) -> None:
        """Look at the beginning of a file.

        Raises:
            RecordingError: if it cannot be read or is no recording of a console.
        """
        self._path = path
        first = next(self._read(), None)
        version = None if first is None else _header(first)
        if first is None or version is None:
            cure = "name a file that `usarsim console --record` wrote"
            raise RecordingError(at(path, "is no recording of a console", cure))
        if version != FORMAT:
            cure = "use the version of usarsim that recorded it"
            problem = f"has format {version!r}, this program reads {FORMAT}"
            raise RecordingError(at(path, problem, cure))
        assert isinstance(first, Text)
        self.header = first.fields

    def __iter__(self) -> Iterator[Text | Packet]:
        """Everything after the header, in its order.

        Raises:
            RecordingError: if the file is damaged; names the place.
        """
        entries = self._read()
        next(entries, None)
        yield from entries

    def _read(self) -> Iterator[Text | Packet]:
        held, done = bytearray(), 0
        try:
            with self._path.open("rb") as file:
                while data := file.read(_CHUNK):
                    held += data
                    for kind, payload in frames(held, LONGEST):
                        entry = _entry(kind, payload)
                        if entry is not None:
                            yield entry
                        done += _FRAME.size + len(payload)
        except OSError as error:
            cure = "name a file that can be read"
            raise RecordingError(
                at(self._path, f"cannot be read: {error.strerror}", cure)
            ) from None
        except (SceneError, ValueError, struct.error, zlib.error) as error:
            if not done:
                cure = "name a file that `usarsim console --record` wrote"
                raise RecordingError(
                    at(self._path, "is no recording of a console", cure)
                ) from error
            cure = "cut it off there, for example by head -c"
            raise RecordingError(
                at(self._path, "is damaged", cure, where=f"byte {done}")
            ) from error


def _header(first: Text | Packet) -> object:
    return first.fields.get("usarsim_console_recording") if isinstance(first, Text) else None


def _entry(kind: bytes, payload: bytes) -> Text | Packet | None:
    """What a frame says; None for kinds that later versions add."""
    if kind not in (_TEXT, _PACKED, _BINARY):
        return None
    (clock,) = _CLOCK.unpack_from(payload)
    data = payload[_CLOCK.size :]
    if kind == _BINARY:
        what, robot, _, _, time = packets.read_head(data)
        return Packet(clock, what, robot, time, data[packets.HEAD :])
    if kind == _PACKED:
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(data, LONGEST)
        if not unpacker.eof:
            raise ValueError("a text is not whole")
    fields = parse_json(data)
    if not isinstance(fields, dict):
        raise ValueError("a text is no object")
    return Text(clock, fields)
