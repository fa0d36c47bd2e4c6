"""Image clients and the renderer: waiting for frames, what is looked at for how long, and clients
that are slow, stall, flood and vanish: nobody else notices.
"""

from __future__ import annotations

import asyncio
import gc
import random
import struct
import threading
import time

import numpy as np
import psutil
from images_harness import (
    BIG,
    GRID,
    TILE,
    TILE_REQUEST,
    FakeSource,
    ImageClient,
    RunningImages,
    rectangle,
)
from services_harness import eventually

from usarsim_server.cameras.view import Region
from usarsim_server.services import listener
from usarsim_server.services.images import ImageLimits
from usarsim_server.services.watch_list import FrameSignal
from usarsim_server.testing import PATIENCE

TILE_SIZE = (TILE.width, TILE.height)
QUICK = ImageLimits(patience=0.2, first_patience=0.2, linger=0.2)


# Waiting for the renderer


def test_request_waits_for_the_first_frame(images) -> None:
    """Nothing rendered yet: the client gets the first real picture, no placeholder, though the
    renderer has to be opened; later ones are waited for less long."""
    source = FakeSource(value=None)
    client = images(source, limits=ImageLimits(patience=0.01)).connect()
    client.send(b"OK")
    assert eventually(lambda: source.looked_at == {GRID.frame})
    assert client.silent_for(0.1)
    source.show(42)
    assert client.value() == 42
    source.fresh = False
    client.send(b"OK")
    assert client.value() == 128


def test_frame_that_is_not_yet_up_to_date_is_waited_over(images) -> None:
    """Frames in which the tile is still old do not count."""
    source = FakeSource(value=None)
    client = images(source).connect()
    client.send(TILE_REQUEST)
    assert eventually(lambda: source.looked_at == {TILE})
    source.show(1, fresh=False)
    assert client.silent_for(0.1)
    source.show(2)
    assert client.value(TILE_SIZE) == 2


def test_renderer_that_is_too_late_is_replaced_by_grey(images, caplog) -> None:
    """Never silent: after a while a grey picture of the right size, and one warning."""
    source = FakeSource(value=None)
    client = images(source, limits=QUICK).connect()
    client.send(b"OK" + TILE_REQUEST)
    assert client.value() == 128
    assert client.value(TILE_SIZE) == 128
    late = [record for record in caplog.messages if "renderer is late" in record]
    assert len(late) == 1
    source.show(3)
    client.send(b"OK")
    assert client.value() == 3


def test_slow_renderer_gives_what_it_has(images) -> None:
    """Frames that came while the client waited are better than grey."""
    source = FakeSource(value=None)
    client = images(source, limits=QUICK).connect()
    client.send(b"OK")
    assert eventually(lambda: bool(source.watches))
    source.show(77, fresh=False)
    assert client.value() == 77


async def test_word_of_many_frames_reaches_the_loop_once() -> None:
    """A renderer that is faster than the loop does not fill it with calls; the last frame wins."""
    signal, source = FrameSignal(), FakeSource()
    watch = source.watch(GRID.frame, signal.ring)
    news = signal.next()
    calls = 0
    soon = asyncio.get_running_loop().call_soon_threadsafe

    def counted(*arguments):  # type: ignore[no-untyped-def]
        nonlocal calls
        calls += 1
        return soon(*arguments)

    signal._loop.call_soon_threadsafe = counted  # type: ignore[method-assign]
    for value in range(50):
        source.show(value)
    assert int((await news).pixels[0, 0, 0]) == 49
    assert calls == 1
    watch.close()


# Attention


def test_region_is_watched_while_it_is_asked_for(images) -> None:
    """Rendering goes on for a while after a request, and stops when nobody asks again."""
    running = images(limits=ImageLimits(linger=1.0), stopped_clock=True)
    client = running.connect()
    for _ in range(5):
        client.send(TILE_REQUEST)
        client.value(TILE_SIZE)
        assert running.source.looked_at == {TILE}
        running.turn(0.9)
    assert running.source.most_watches == 1
    running.turn(0.2)
    assert eventually(lambda: running.source.looked_at == set())


def test_each_region_has_its_own_time(images) -> None:
    """What was asked for earlier is forgotten earlier."""
    running = images(limits=ImageLimits(linger=1.0), stopped_clock=True)
    client = running.connect()
    client.send(TILE_REQUEST)
    client.value(TILE_SIZE)
    running.turn(0.5)
    client.send(b"OK")
    client.value()
    assert running.source.looked_at == {TILE, GRID.frame}
    running.turn(0.6)
    assert eventually(lambda: running.source.looked_at == {GRID.frame})
    running.turn(0.6)
    assert eventually(lambda: running.source.looked_at == set())


def test_client_that_leaves_looks_at_nothing(images) -> None:
    """The end of a connection ends its rendering at once."""
    running = images(limits=ImageLimits(linger=60.0))
    client = running.connect()
    client.send(b"OK")
    client.value()
    assert running.source.looked_at == {GRID.frame}
    client.close()
    assert eventually(lambda: running.source.looked_at == set())


def test_regions_of_one_client_are_bounded(images) -> None:
    """A client that invents rectangles makes the oldest give way."""
    running = images(limits=ImageLimits(regions=3))
    client = running.connect()
    for x in range(10):
        client.send(rectangle(x, 0, 4, 4))
        client.value((4, 4))
    assert running.source.most_watches <= 3
    assert running.source.looked_at == {Region(x, 0, 4, 4) for x in (7, 8, 9)}


BIG_SIZE = (BIG.width, BIG.height)
FRAME_BYTES = 5 + 4 + 3 * BIG.width * BIG.height


def ask_and_stall(running: RunningImages, requests: bytes = b"OK") -> ImageClient:
    """A client that asks for large pictures and reads nothing."""
    client = running.connect(receive_buffer=4096)
    client.send(requests)
    return client


def test_stalled_clients_do_not_hold_up_others(images) -> None:
    """Side channels 30: beside twenty that stall, a client that reads gets all it asks for."""
    running = images(FakeSource(BIG))
    stalled = [ask_and_stall(running, b"OK" * 50) for _ in range(20)]
    reader = running.connect()
    for value in range(1, 30):
        running.source.show(value)
        reader.send(TILE_REQUEST)
        assert reader.value((TILE.width, TILE.height)) == value
    for client in stalled:
        client.close()
    assert eventually(lambda: running.service.connections == 1)


def test_client_that_stalls_and_goes_on_has_an_intact_stream(images) -> None:
    """Side channels 31: pictures are whole, in order and one per request, however late they are
    read."""
    running = images(FakeSource(BIG))
    client = ask_and_stall(running, b"OK" * 8)
    for value in range(1, 30):
        running.source.show(value)
        time.sleep(0.01)
    values = [client.value(BIG_SIZE) for _ in range(8)]
    assert values[1:] == [29] * 7, "requests that waited are answered with the newest picture"
    assert client.silent_for(0.1)


def test_pictures_are_not_encoded_ahead(images) -> None:
    """A client that does not read makes no work: its next request waits until it has read."""
    running = images(FakeSource(BIG))
    client = ask_and_stall(running, b"OK" * 100)
    assert eventually(lambda: running.encoder.kept_bytes > 0)
    time.sleep(0.1)
    running.source.show(1)
    time.sleep(0.1)
    assert running.encoder.found(running.source.newest(BIG.frame), BIG.frame) is None
    client.close()


def test_flood_of_requests_waits_in_tcp(images) -> None:
    """A client that only asks is pushed back by TCP after a few thousand requests."""
    running = images(FakeSource(BIG))
    client = running.connect(receive_buffer=4096, send_buffer=4096)
    client.socket.setblocking(False)
    sent, last = 0, time.monotonic()
    while sent < 4_000_000 and time.monotonic() - last < 0.3:
        try:
            sent += client.socket.send(b"OK" * 4096)
            last = time.monotonic()
        except BlockingIOError:
            time.sleep(0.01)
    assert sent < 1_000_000
    client.reset()
    assert eventually(lambda: running.service.connections == 0)


def test_client_that_leaves_in_the_middle_of_a_picture_disturbs_nobody(images, caplog) -> None:
    """Side channels 32: reset, close and half-close after half a picture."""
    running = images(FakeSource(BIG))
    witness = running.connect()
    for end in ("reset", "close", "half"):
        client = ask_and_stall(running)
        client.exactly(1000)
        if end == "half":
            client.socket.shutdown(1)
            client.exactly(FRAME_BYTES - 1000)  # what was asked for before is still delivered
            assert client.ended()
        else:
            getattr(client, end)()
        assert eventually(lambda: running.service.connections == 1)
        witness.send(TILE_REQUEST)
        witness.value((TILE.width, TILE.height))
    assert not [record for record in caplog.records if record.levelname in ("WARNING", "ERROR")]


def test_client_that_leaves_while_it_waits_is_forgotten(images) -> None:
    """Nothing was rendered yet when it went: its attention ends with it."""
    source = FakeSource(value=None)
    running = images(source, limits=QUICK)
    client = running.connect()
    client.send(b"OK")
    assert eventually(lambda: bool(source.watches))
    client.reset()
    assert eventually(lambda: running.service.connections == 0)
    assert source.watches == []


def test_stop_does_not_wait_for_clients(images, caplog, monkeypatch) -> None:
    """The server ends although clients stall, wait for the renderer, or are silent."""
    monkeypatch.setattr(listener, "_STOP_TIMEOUT", PATIENCE)
    running = images(FakeSource(BIG), silent_push=10.0 * PATIENCE)
    ask_and_stall(running, b"OK" * 10)
    running.connect()
    running.source.fresh = False
    ask_and_stall(running)
    assert eventually(lambda: running.service.connections == 3)
    clients = list(running.clients)
    running.call(running.service.stop())
    assert "connections did not end in time" not in caplog.messages
    assert running.source.watches == []
    assert all(client.ended() for client in clients)


def test_stalled_client_costs_one_picture(images) -> None:
    """Twelve clients that stall in twelve different pictures hold twelve pictures, no more."""
    running = images(FakeSource(BIG))
    gc.collect()
    before = psutil.Process().memory_info().rss
    for value in range(12):
        running.source.show(value)
        client = ask_and_stall(running, b"OK" * 200)
        client.socket.recv(100)
    grown = psutil.Process().memory_info().rss - before
    # The newest frame, the picture in the cache and the encoder's work come on top.
    assert grown < (12 + 6) * FRAME_BYTES


class Guest:
    """A client with a will of its own: asks, reads a little, stalls, vanishes."""

    def __init__(self, running: RunningImages, chance: random.Random) -> None:
        self._client = running.connect(receive_buffer=4096)
        self._chance = chance
        words = [b"OK", b"OK\r\n" * 20, TILE_REQUEST, b"U" + struct.pack(">4I", 9, 9, 9**9, 1)]
        words += [b"\0\xff" * 200, b"U\0\0", b"O"]
        self._client.send(b"".join(chance.choices(words, k=3)))

    def end(self) -> None:
        """Read something or nothing, and go in one way or another."""
        self._client.socket.settimeout(0.01)
        try:
            for _ in range(self._chance.randrange(4)):
                self._client.socket.recv(self._chance.choice((1, 1000, 1 << 20)))
        except (TimeoutError, ConnectionError):
            pass
        self._chance.choice((self._client.reset, self._client.close))()


def test_clients_come_and_go_for_a_while(images) -> None:
    """200 visits beside a running renderer leave no connection, watch, thread or memory."""
    chance = random.Random(5)
    running = images(FakeSource(BIG), silent_push=0.05)
    witness = running.connect()
    guests: list[Guest] = []
    used: list[int] = []
    for visit in range(200):
        guests.append(Guest(running, chance))
        if len(guests) > 8:
            guests.pop(chance.randrange(len(guests))).end()
        if visit % 10 == 9:
            running.source.show(visit)
            witness.send(TILE_REQUEST)
            assert witness.value((TILE.width, TILE.height)) == visit
            used.append(psutil.Process().memory_info().rss)
    for guest in guests:
        guest.end()
    assert eventually(lambda: running.service.connections == 1)
    witness.close()
    assert eventually(lambda: running.service.connections == 0)
    assert running.source.watches == []
    encoders = [one for one in threading.enumerate() if one.name.startswith("image-encoder")]
    assert len(encoders) <= 2
    # Eight guests hold up to eight pictures at any time, from the start.
    assert np.median(used[-5:]) - np.median(used[2:7]) < 8 * FRAME_BYTES
