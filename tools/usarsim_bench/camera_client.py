"""Clients that ask a service again and again, each in a thread of its own; those of pictures."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from zlib import crc32

from usarsim_bench.figures import p99
from usarsim_bench.server import BenchError, CarefulClosing
from usarsim_client import FULL_FRAME, BlockingConnection, ProtocolError, pictures

_PATIENCE = 30.0
"""s of wall time for the first picture."""


_ANSWER_TIMEOUT = 60.0
"""s of wall time: to open a renderer takes long on a machine that does much else."""


class Asking(CarefulClosing):
    """Asks a service again and again, on a thread of its own, while it is open.

    A subclass says by `ask` what it asks for; it is asked at once, so what that needs has to be
    there before `__init__` of this class is called.
    """

    def __init__(self, port: int, service: str, period: float) -> None:
        """Connect to a service, named for people; a round that takes more s than the period from
        one to the next is followed at once.

        Raises:
            BenchError: if nobody listens.
        """
        self._service, self._period = service, period
        self._failure: Exception | None = None
        self._stop = threading.Event()
        try:
            self._connection = BlockingConnection(port, patience=_ANSWER_TIMEOUT)
        except OSError as error:
            raise BenchError(f"nobody listens for {service}: {error.strerror}") from None
        self._thread = threading.Thread(target=self._run, name="asking", daemon=True)
        self._thread.start()

    def ask(self) -> None:
        """Do one round; `OSError`, `ValueError` or `ProtocolError` if the answer is none."""
        raise NotImplementedError

    def _run(self) -> None:
        due = time.perf_counter()
        try:
            while not self._stop.wait(max(0.0, due - time.perf_counter())):
                self.ask()
                # A client that was held up does not ask in bursts.
                due = max(due + self._period, time.perf_counter())
        except (OSError, ValueError, ProtocolError) as error:
            self._failure = error

    def close(self) -> None:
        """Stop asking and hang up, once the last answer is there; a second call does nothing.

        Raises:
            BenchError: if the server failed this client at any time.
        """
        self._stop.set()
        self._thread.join(_ANSWER_TIMEOUT)
        self._connection.close()
        if self._failure is not None:
            raise BenchError(f"a client of {self._service} was failed: {self._failure}")


@dataclass(frozen=True, slots=True)
class Picture:
    """One answered request."""

    asked: float  # wall time just before the request was sent
    come: float  # wall time at which its last byte was there
    octets: int  # of header and payload
    content: int  # checksum of the payload, by which repeats are known


class Viewer(Asking):
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
        self._first = threading.Event()
        self._request = FULL_FRAME if rectangle is None else pictures.rectangle(*rectangle)
        super().__init__(port, "images", 0.0 if rate is None else 1.0 / rate)

    def ask(self) -> None:
        """Take one picture."""
        asked = time.perf_counter()
        self._connection.send(self._request)
        payload = self._connection.picture().payload
        come = time.perf_counter()
        octets = pictures.HEADER.size + len(payload)
        self.pictures.append(Picture(asked, come, octets, crc32(payload)))
        self._first.set()

    def wait(self) -> None:
        """Wait for the first picture, for which a server opens its renderer; `close` tells why if
        none comes."""
        self._first.wait(_PATIENCE)


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
        median=median(waits),
        tail=p99(waits),
        longest=max(waits),
        octets=sum(one.octets for one in seen) / (stop - start),
    )
