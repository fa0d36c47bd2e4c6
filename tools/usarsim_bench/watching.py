"""Clients that look at cameras again and again, each in a thread of its own."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event
from zlib import crc32

from usarsim_bench.figures import BenchError
from usarsim_client import FULL_FRAME, BlockingConnection, pictures

_PATIENCE = 60.0
"""s of wall time for a picture: to open a renderer takes long on a machine that does much else."""


@dataclass(frozen=True, slots=True)
class View:
    """One answered request."""

    asked: float  # wall time just before the request was sent
    come: float  # wall time at which its last byte was there
    octets: int  # of header and payload
    content: int  # checksum of the payload, by which repeats are known


@contextmanager
def watching(
    port: int, tiles: Sequence[tuple[int, int, int, int] | None], rate: float | None = None
) -> Iterator[list[list[View]]]:
    """Have a client look at each tile while inside; yields what each has got, which grows, once
    each has got something.

    Args:
        port: of the images.
        tiles: x, y, width and height, pixels; None for the full frame.
        rate: requests per second of each client; None to ask again as soon as a picture is there.

    Raises:
        BenchError: at the end, if the server failed a client at any time.
    """
    stop, period = Event(), 0.0 if rate is None else 1.0 / rate
    found: list[list[View]] = [[] for _ in tiles]

    def watch(tile: tuple[int, int, int, int] | None, views: list[View]) -> None:
        request = FULL_FRAME if tile is None else pictures.rectangle(*tile)
        with BlockingConnection(port, patience=_PATIENCE) as connection:
            due = time.perf_counter()
            while not stop.wait(max(0.0, due - time.perf_counter())):
                asked = time.perf_counter()
                connection.send(request)
                payload = connection.picture().payload
                octets = pictures.HEADER.size + len(payload)
                views.append(View(asked, time.perf_counter(), octets, crc32(payload)))
                # A client that was held up does not ask in bursts.
                due = max(due + period, time.perf_counter())

    with ThreadPoolExecutor(len(tiles)) as pool:
        clients = [pool.submit(watch, *one) for one in zip(tiles, found, strict=True)]
        try:
            while not all(found) and not any(one.done() for one in clients):
                time.sleep(0.01)
            yield found
        finally:
            stop.set()
    for error in (one.exception() for one in clients):
        if error is not None:
            raise BenchError(f"a client of images was failed: {error}")


def waits(views: Sequence[View], start: float, stop: float) -> list[float]:
    """How long each picture took that was on its way at any time of a span of wall time, s.

    One that came only after the span counts too: a server that sends nothing is not left out.

    Raises:
        BenchError: if no picture was asked for.
    """
    found = [one.come - one.asked for one in views if one.asked <= stop and one.come >= start]
    if not found:
        raise BenchError(f"no picture was asked for in {stop - start:.1f} s")
    return found
