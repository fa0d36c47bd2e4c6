"""Legacy image clients in miniature: each keeps the reading rules of one program.

They are deliberately as narrow as the originals (side channels reference 2.12): what breaks the
original breaks these. None shares a parser with another.
"""

from __future__ import annotations

import io
import socket
import struct
import time

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from usarsim_server.testing import PATIENCE, Closing

Pixels = NDArray[np.uint8]
"""(height, width, 3), red green blue."""


def decoded(file: bytes) -> Pixels:
    """Pixels of an image file, to its last byte."""
    assert file.startswith(b"\xff\xd8")
    assert file.endswith(b"\xff\xd9")
    return np.asarray(Image.open(io.BytesIO(file)).convert("RGB"))


class ImageProgram(Closing):
    """A connection; reading is the business of the programs."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """Hang up."""
        self.socket.close()

    def _exactly(self, count: int) -> bytes:
        """The next bytes. `MSG_WAITALL` would end early: a socket with a time-out never blocks."""
        data = b""
        while len(data) < count:
            chunk = self.socket.recv(count - len(data))
            assert chunk, "the server closed the connection"
            data += chunk
        return data


class SampleClient(ImageProgram):
    """The ROS image node: looks whether what it has is exactly one JPEG reply; asks again then."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self._buffer = b""
        self.socket.sendall(b"OK\r\n")

    def views(self) -> list[Pixels]:
        """The four views of the top row, of the next picture."""
        while True:
            data = self.socket.recv(4096)
            assert data, "the server closed the connection"
            self._buffer += data
            if len(self._buffer) < 5:
                continue
            wanted = 5 + int.from_bytes(self._buffer[1:5])
            assert len(self._buffer) <= wanted, "more than one picture: it would wait for ever"
            if len(self._buffer) == wanted:
                break
        assert self._buffer[0] != 0, "raw pictures are not decoded: it would repeat the last one"
        picture = decoded(self._buffer[5:])
        self._buffer = b""
        self.socket.sendall(b"OK\r\n")
        return [picture[0:240, x : x + 320] for x in (0, 320, 640, 960)]


class LcmProxy(ImageProgram):
    """The LCM proxy: either type; cuts its tile out of a grid that it takes to be square."""

    pause = 0.2

    def __init__(self, port: int, tile: int, columns: int) -> None:
        super().__init__(port)
        self._file = self.socket.makefile("rb")
        self._tile, self._columns = tile - 1, columns
        self.socket.sendall(b"OK")

    def close(self) -> None:
        """Hang up."""
        self._file.close()
        super().close()

    def view(self) -> Pixels:
        """The tile, of the next picture."""
        header = self._file.read(5)
        assert header[1] < 127, "the length would be negative"
        payload = self._file.read(int.from_bytes(header[1:5]))
        picture = decoded(payload) if header[0] else self._raw(payload)
        height, width = picture.shape[0] // self._columns, picture.shape[1] // self._columns
        row, column = divmod(self._tile, self._columns)
        time.sleep(self.pause)
        self.socket.sendall(b"OK")
        return picture[row * height : (row + 1) * height, column * width : (column + 1) * width]

    @staticmethod
    def _raw(payload: bytes) -> Pixels:
        width, height = payload[0] * 256 + payload[1], payload[2] * 256 + payload[3]
        return np.frombuffer(payload, np.uint8, offset=4).reshape(height, width, 3)[:, :, ::-1]


class ArDrone(ImageProgram):
    """The SLAM client: says nothing until a whole raw picture is in its small buffer."""

    def __init__(self, port: int, room: int = 80_000) -> None:
        super().__init__(port)
        self._room = room

    def view(self) -> Pixels:
        """The next picture, 176 x 144; asks for another one afterwards."""
        buffer = bytearray(self._room)
        have, wanted = 0, 5
        while have < wanted:
            assert wanted <= self._room, "its buffer would overflow"
            count = self.socket.recv_into(memoryview(buffer)[have:wanted])
            assert count, "the server closed the connection"
            have += count
            if have == wanted == 5:
                wanted = 5 + int.from_bytes(buffer[1:5])
        assert wanted == 5 + 4 + 176 * 144 * 3
        self.socket.sendall(b"OK")
        blue_first = np.frombuffer(buffer, np.uint8, count=176 * 144 * 3, offset=9)
        return blue_first.reshape(144, 176, 3)[:, :, ::-1]


class Poaret(ImageProgram):
    """PoAReT: asks for the tile of its robot through a stream that writes a letter as an integer.

    The grid has four columns of 320 x 240 for it.
    """

    def __init__(self, port: int, robot: int) -> None:
        super().__init__(port)
        self._place = robot * 320 % 1280, robot // 4 * 240

    def view(self) -> Pixels:
        """Ask for the tile and read it."""
        self.socket.sendall(struct.pack(">5I", ord("U"), *self._place, 320, 240))
        kind = self._exactly(1)[0]
        (length,) = struct.unpack(">i", self._exactly(4))
        payload = self._exactly(length)
        assert kind > 0, "raw pictures are not read here"
        return decoded(payload)


class ButtonClient(ImageProgram):
    """The onomasticon: reads once what has arrived a moment after its button was pressed.

    Its moment is as long here as a picture takes on this machine.
    """

    def press(self) -> Pixels:
        """Ask and show."""
        self.socket.sendall(b"OK\r\n")
        header = self._exactly(5)
        return decoded(self._exactly(int.from_bytes(header[1:5])))


class ImageTester(ImageProgram):
    """The tester of CMU: sends its string at a fixed period, whether or not pictures come."""

    def __init__(self, port: int, text: bytes, period: float = 0.02) -> None:
        super().__init__(port)
        self._text, self._period = text, period

    def lengths(self, count: int) -> list[int]:
        """Send so many requests, then read the lengths of so many pictures."""
        for _ in range(count):
            self.socket.sendall(self._text)
            time.sleep(self._period)
        return [self._skip() for _ in range(count)]

    def quiet_for(self, seconds: float) -> bool:
        """Whether nothing comes any more."""
        self.socket.settimeout(seconds)
        try:
            return not self.socket.recv(1)
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(PATIENCE)

    def _skip(self) -> int:
        header = self._exactly(5)
        left = length = struct.unpack(">xI", header)[0]
        while left:
            data = self.socket.recv(min(left, 65536))
            assert data, "the server closed the connection"
            left -= len(data)
        return int(length)


class SimpleUi(ImageProgram):
    """Clients of ImageSrv: a picture comes first, each is confirmed, then comes the next."""

    def picture(self) -> Pixels:
        """The next picture."""
        header = self._exactly(5)
        payload = b""
        while len(payload) < int.from_bytes(header[1:5]):
            payload += self.socket.recv(65536)
        assert 1 <= header[0] <= 5
        self.socket.sendall(b"OK")
        return decoded(payload)


class BytewiseClient(ImageProgram):
    """A client of UT2004: a receive of exactly one byte is the start of a picture."""

    def pictures_seen(self, count: int) -> int:
        """How many of so many pictures begin with a receive of one byte."""
        seen = 0
        for _ in range(count):
            self.socket.sendall(b"OK")
            seen += len(begun := self.socket.recv(65536)) == 1
            header = begun + self._exactly(max(0, 5 - len(begun)))
            self._exactly(5 + int.from_bytes(header[1:5]) - len(header))
        return seen
