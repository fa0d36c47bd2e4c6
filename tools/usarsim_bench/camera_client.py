"""Image clients for measurements: each asks for pictures at its own pace, in its own thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from zlib import crc32

import numpy as np

from usarsim_bench.server import BenchError, CarefulClosing
from usarsim_client import FULL_FRAME, BlockingConnection, ProtocolError, pictures

_ANSWER_TIMEOUT = 10.0
_STOP_TIMEOUT = 15.0


@dataclass(frozen=True, slots=True)
class Picture:
    """One answered request."""

    asked: float  # wall time just before the request was sent
    come: float  # wall time at which its last byte was there
    octets: int  # of header and payload
    content: int  # checksum of the payload, by which repeats are known


class Viewer(CarefulClosing):
    """Looks at the cameras of a server while it is open as a context manager.

    Attributes:
        pictures: those that have come so far; read it after `close`, or bear that it grows.
    """

    def __init__(
        self,
        port: int,
        rectangle: tuple[int, int, int, int] | None = None,
        rate: float | None = None,
    ) -> None:
        """Connect and begin to ask.

        Args:
            port: of the images.
            rectangle: x, y, width and height to ask for, pixels; None for the full frame.
            rate: requests per second; None to ask again as soon as a picture is there.

        Raises:
            BenchError: if nobody listens.
        """
        self.pictures: list[Picture] = []
        self._failure: str | None = None
        self._stop = threading.Event()
        self._period = 0.0 if rate is None else 1.0 / rate
        self._request = FULL_FRAME if rectangle is None else pictures.rectangle(*rectangle)
        try:
            self._connection = BlockingConnection(port, patience=_ANSWER_TIMEOUT)
        except OSError as error:
            raise BenchError(f"nobody listens for image clients: {error.strerror}") from None
        self._thread = threading.Thread(target=self._look, name="viewer", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop asking and hang up, once the last picture is there.

        Raises:
            BenchError: if the server failed this client at any time.
        """
        self._stop.set()
        self._thread.join(_STOP_TIMEOUT)
        self._connection.close()
        if self._failure is not None:
            raise BenchError(f"an image client was failed: {self._failure}")

    def _look(self) -> None:
        due = time.perf_counter()
        try:
            while not self._stop.wait(max(0.0, due - time.perf_counter())):
                self.pictures.append(self._ask())
                # A client that was held up does not ask in bursts.
                due = max(due + self._period, time.perf_counter())
        except (OSError, ProtocolError) as error:
            self._failure = str(error)

    def _ask(self) -> Picture:
        asked = time.perf_counter()
        self._connection.send(self._request)
        payload = self._connection.picture().payload
        come = time.perf_counter()
        return Picture(asked, come, pictures.HEADER.size + len(payload), crc32(payload))


@dataclass(frozen=True, slots=True)
class ViewerTrial:
    """What one viewer got over a span of time."""

    pictures: float  # received per second
    news: float  # pictures per second that differed from the one before
    median: float  # s from asking to the last byte; median and 99th percentile
    tail: float
    longest: float  # s, the longest of them
    octets: float  # received per second


def summed_up(pictures: Sequence[Picture], start: float, stop: float) -> ViewerTrial:
    """What came within a span of wall time.

    Raises:
        BenchError: if no picture came.
    """
    seen = [one for one in pictures if start <= one.come <= stop]
    if not seen:
        raise BenchError(f"no picture came in {stop - start:.1f} s")
    waits = [one.come - one.asked for one in seen]
    news = sum(one.content != before.content for before, one in pairwise(seen))
    return ViewerTrial(
        pictures=len(seen) / (stop - start),
        news=news / (stop - start),
        median=float(np.percentile(waits, 50.0)),
        tail=float(np.percentile(waits, 99.0)),
        longest=max(waits),
        octets=sum(one.octets for one in seen) / (stop - start),
    )
