"""The image service: requests and replies, pushes, shared work, bound views, the port."""

from __future__ import annotations

import asyncio
import io
import socket
import threading
import time

import numpy as np
import pytest
from images_harness import (
    BIG,
    GRID,
    TILE,
    TILE_REQUEST,
    FakeSource,
    ImageClient,
    rectangle,
)
from numpy.typing import NDArray
from PIL import Image
from services_harness import eventually

from usarsim_server.base.errors import ServiceError
from usarsim_server.cameras.encoding import Encoder, encode_jpeg
from usarsim_server.cameras.view import Frame, Grid, Region
from usarsim_server.protocol.images import NORMAL, RAW, ImageType
from usarsim_server.services.images import ImageLimits, ImageService
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.port import run_services
from usarsim_server.services.watch_list import Repeats
from usarsim_server.testing import PATIENCE

TILE_SIZE = (TILE.width, TILE.height)


def replies_to(client: ImageClient, data: bytes, count: int) -> list[tuple[int, bytes]]:
    """Exactly so many replies, then silence."""
    client.send(data)
    found = [client.reply() for _ in range(count)]
    assert client.silent_for(0.1)
    return found


# Requests and replies


@pytest.mark.parametrize(
    ("data", "count"),
    [
        pytest.param(b"OK", 1, id="side channels 3"),
        pytest.param(b"OK\r\n", 1, id="side channels 4"),
        pytest.param(b"\r\nOK", 1, id="side channels 5"),
        pytest.param(b"ok", 0, id="side channels 6"),
        pytest.param(b"OOK", 0, id="side channels 7"),
        pytest.param(b"OOKOK", 1, id="side channels 7"),
        pytest.param(b"OK" * 5, 5, id="side channels 9"),
        pytest.param(b"\0\0\0" + TILE_REQUEST, 1, id="side channels 22"),
        pytest.param(rectangle(0x4F4B4F4B, 0x55555555, 0x4F4B, 1), 1, id="side channels 24"),
        pytest.param(TILE_REQUEST + b"OK", 2, id="side channels 26"),
    ],
)
def test_each_request_has_exactly_one_reply(images, data: bytes, count: int) -> None:
    """Side channels 3 to 9, 22, 24, 26: n requests give n replies; everything else gives
    nothing."""
    client = images().connect()
    replies_to(client, data, count)
    replies_to(client, b"OK", 1)


@pytest.mark.parametrize("request_bytes", [b"OK", TILE_REQUEST])
def test_request_byte_by_byte_has_one_reply(images, request_bytes: bytes) -> None:
    """Side channels 8 and 23: pauses inside a request do not matter."""
    client = images().connect()
    for byte in request_bytes[:-1]:
        client.send(bytes([byte]))
        time.sleep(0.01)
    assert client.silent_for(0.2)
    replies_to(client, request_bytes[-1:], 1)


@pytest.mark.parametrize("number", [0, 1, 3, 5, 259])
def test_type_is_the_same_for_both_kinds_of_request(images, number: int) -> None:
    """Side channels 11 and 12: the configured type; JPEGs decode to the size asked for."""
    client = images(FakeSource(), ImageType(number)).connect()
    replies = replies_to(client, b"OK" + TILE_REQUEST, 2)
    assert [kind for kind, _ in replies] == [number % 256] * 2
    if number:
        sizes = [Image.open(io.BytesIO(payload)).size for _, payload in replies]
        assert sizes == [(GRID.width, GRID.height), TILE_SIZE]


def test_rectangle_of_the_frame_is_the_frame(images) -> None:
    """Side channels 20."""
    client = images().connect()
    full, cut = replies_to(client, b"OK" + rectangle(0, 0, GRID.width, GRID.height), 2)
    assert full == cut


@pytest.mark.parametrize(("image_type", "payload"), [(RAW, bytes(4)), (NORMAL, b"")])
@pytest.mark.parametrize(
    "asked",
    [
        (128, 0, 64, 48),
        (0, 0, 0, 48),
        (0, 0, 64, 0),
        (100, 60, 64, 48),
        (0, 0, 129, 96),
        (2**32 - 1, 2**32 - 1, 2**32 - 1, 2**32 - 1),
    ],
)
def test_rectangle_outside_has_an_empty_reply(images, image_type, payload, asked) -> None:
    """Side channels 25: one empty picture, no rendering, and the connection lives on."""
    running = images(FakeSource(), image_type)
    client = running.connect()
    assert replies_to(client, rectangle(*asked), 1) == [(image_type.byte, payload)]
    assert running.source.looked_at == set()
    replies_to(client, b"OK", 1)


def test_each_request_gets_the_newest_picture(images) -> None:
    """Side channels 34: pictures follow the renderer; a repeat without news is the same picture."""
    running = images()
    client = running.connect()
    for value in (7, 9, 250):
        running.source.show(value)
        client.send(b"OK")
        assert client.value() == value
    client.send(b"OK")
    assert client.value() == 250


@pytest.mark.parametrize(
    ("data", "lengths"),
    [
        pytest.param(b"OK" + TILE_REQUEST, [9 + 128 * 96 * 3, 9 + 64 * 48 * 3], id="pictures"),
        pytest.param(b"OKOK", [9 + 128 * 96 * 3] * 2, id="a picture that is encoded already"),
        pytest.param(rectangle(500, 0, 9, 9), [9], id="a rectangle outside"),
    ],
)
def test_type_byte_leaves_by_itself(images, monkeypatch, data: bytes, lengths: list[int]) -> None:
    """The type byte is sent 0.5 ms before the rest: UT2004's client waits for it alone."""
    running = images()
    sent: list[int] = []
    times: list[float] = []
    sendall = running.loop.sock_sendall

    async def noted(client: socket.socket, part: memoryview) -> None:
        times.append(running.loop.time())
        sent.append(len(part))
        await sendall(client, part)

    monkeypatch.setattr(running.loop, "sock_sendall", noted)
    replies_to(running.connect(), data, len(lengths))
    assert sent == [part for length in lengths for part in (1, length - 1)]
    assert all(rest - led > 0.2e-3 for led, rest in zip(times[::2], times[1::2], strict=True))


def test_requests_every_ten_milliseconds_are_all_answered(images) -> None:
    """Side channels 33: repeats or not."""
    client = images().connect()
    for _ in range(30):
        client.send(b"OK\r\n")
        time.sleep(0.01)
    assert [client.value() for _ in range(30)] == [0] * 30


def test_repeats_are_paced_and_news_are_not(images) -> None:
    """A client that asks without pause gets the same picture again only after a little while."""
    limits = ImageLimits(repeat=0.05)
    client = images(FakeSource(), limits=limits).connect()
    started = time.monotonic()
    replies_to(client, b"OK" * 5, 5)
    assert time.monotonic() - started > 4 * 0.05
    started = time.monotonic()
    replies_to(client, (TILE_REQUEST + b"OK") * 4, 8)
    assert time.monotonic() - started > 3 * 0.05, "each region is paced, also in turns"
    changing = images(FakeSource(), limits=ImageLimits(repeat=10.0 * PATIENCE))
    client = changing.connect()
    for value in range(5):
        changing.source.show(value)
        client.send(TILE_REQUEST + b"OK")
        assert client.value(TILE_SIZE) == value
        assert client.value() == value


def test_copies_are_told_from_news() -> None:
    """A new number or a new region is news; what is remembered is bounded."""
    first, second = (Frame.of(number, 0.0, np.zeros((1, 1, 3), np.uint8)) for number in (1, 2))
    repeats = Repeats(1.0, 3)
    assert repeats.pause(first, TILE, 0.0) == 0.0
    repeats.note(first, TILE, 5.0)
    assert repeats.pause(first, TILE, 5.25) == 0.75
    assert repeats.pause(first, TILE, 6.5) == 0.0
    assert repeats.pause(first, GRID.frame, 5.25) == 0.0
    assert repeats.pause(second, TILE, 5.25) == 0.0
    for x in range(100):
        repeats.note(first, Region(x, 0, 1, 1), 6.0)
        assert len(repeats._got) <= 3
    assert repeats.pause(first, TILE, 5.25) == 0.0, "forgotten: served without pause"


# Pushes


def test_nothing_is_sent_unasked(images) -> None:
    """Side channels 2: without legacy mode a silent client gets nothing."""
    running = images()
    assert running.connect().silent_for(0.5)
    assert running.source.looked_at == set(), "nobody looks, nothing is rendered"


def test_legacy_mode_pushes_one_picture(images) -> None:
    """Side channels 27: one picture on connect, then request and reply as always."""
    client = images(legacy=True, silent_push=0.05).connect()
    replies_to(client, b"", 1)
    replies_to(client, b"OK", 1)


def test_legacy_mode_and_an_immediate_request_are_two_pictures(images) -> None:
    """Side channels 28."""
    replies_to(images(legacy=True).connect(), b"OK", 2)


def test_silent_client_gets_one_picture(images) -> None:
    """Side channels reference 2.12: one push, never a second one."""
    running = images(silent_push=1.0, stopped_clock=True)
    client = running.connect()
    assert eventually(lambda: running.service.connections == 1)
    running.turn(0.9)
    assert client.silent_for(0.1)
    running.turn(0.2)
    replies_to(client, b"", 1)
    running.turn(10.0)
    assert client.silent_for(0.1)
    replies_to(client, b"OK", 1)


@pytest.mark.parametrize("word", [b"OK", b"O", b"\0"])
def test_client_that_speaks_in_time_gets_no_push(images, monkeypatch, word: bytes) -> None:
    """Side channels 29: whatever it says first, only what it asked for is sent."""
    running = images(silent_push=1.0, stopped_clock=True)
    heard: list[bytes] = []
    sock_recv = running.loop.sock_recv

    async def receive(client: socket.socket, size: int) -> bytes:
        heard.append(await sock_recv(client, size))
        return heard[-1]

    monkeypatch.setattr(running.loop, "sock_recv", receive)
    client = running.connect()
    client.send(word)
    if word == b"OK":
        client.value()
    assert eventually(lambda: bool(heard))
    running.turn(2.0)
    assert client.silent_for(0.2)


def test_request_during_the_push_is_answered_too(images) -> None:
    """Bytes that come while the picture is on its way are not lost."""
    source = FakeSource(value=None)
    running = images(source, silent_push=0.05, limits=ImageLimits(patience=PATIENCE))
    client = running.connect()
    assert eventually(lambda: bool(source.watches)), "the push waits for the renderer"
    client.send(b"OK")
    source.show(5)
    assert [client.value(), client.value()] == [5, 5]
    assert client.silent_for(0.1)


# Work that is shared


class SlowCodec:
    """Counts calls; slow enough for several clients to ask meanwhile."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, pixels: NDArray[np.uint8], quality: int, head: bytes) -> memoryview:
        self.calls += 1
        time.sleep(0.1)
        return encode_jpeg(pixels, quality, head)


def test_clients_share_one_encoding(images) -> None:
    """Ten clients that ask for the same picture at the same time pay once."""
    codec = SlowCodec()
    running = images(FakeSource(), NORMAL, codec)
    clients = [running.connect() for _ in range(10)]
    for client in clients:
        client.send(b"OK")
    clients.pop().reset()
    assert len({client.reply() for client in clients}) == 1
    assert codec.calls == 1


def test_loop_does_not_wait_for_the_encoder(images) -> None:
    """While a picture is encoded the event loop serves others."""
    go_on = threading.Event()

    def held(pixels: NDArray[np.uint8], quality: int, head: bytes) -> memoryview:
        go_on.wait(PATIENCE)
        return encode_jpeg(pixels, quality, head)

    running = images(FakeSource(), NORMAL, held)
    waiting, outside = running.connect(), running.connect()
    waiting.send(b"OK")
    assert waiting.exactly(1) == b"\3"
    for _ in range(20):
        outside.send(rectangle(999, 0, 1, 1))
        assert outside.reply() == (3, b"")
    assert waiting.silent_for(0.01)
    go_on.set()
    waiting.exactly(int.from_bytes(waiting.exactly(4)))


def test_defect_in_the_encoder_ends_one_client_only(images, caplog) -> None:
    """An exception closes the connection that met it, with a log line; others live on."""

    def broken(pixels: NDArray[np.uint8], quality: int, head: bytes) -> memoryview:
        if pixels.shape == (48, 64, 3):
            raise ValueError("cannot encode")
        return encode_jpeg(pixels, quality, head)

    running = images(FakeSource(), NORMAL, broken)
    victim, other = running.connect(), running.connect()
    victim.send(TILE_REQUEST)
    assert victim.ended()
    assert "connection closed by a server error" in caplog.messages
    replies_to(other, b"OK", 1)


# Bound views


def test_bound_client_sees_its_part_as_the_whole(images) -> None:
    """SET Camera Client (side channels 2.11): OK gives the tile, rectangles are cut out of it."""
    asked: list[str] = []
    views: list[Region | None] = [TILE]

    def bound(address: str) -> Region | None:
        asked.append(address)
        return views[0]

    running = images(bound=bound)
    client = running.connect()
    client.send(b"OK" + rectangle(60, 40, 4, 8) + rectangle(0, 0, 65, 48))
    assert client.value(TILE_SIZE) == 0
    assert client.value((4, 8)) == 0
    assert client.reply() == (0, bytes(4)), "outside of its part"
    assert running.source.looked_at == {TILE, Region(124, 88, 4, 8)}
    assert set(asked) == {"127.0.0.1"}
    views[0] = None
    client.send(b"OK")
    assert client.value() == 0


# The port


def test_connection_beyond_the_limit_is_closed(images) -> None:
    """A place that comes free is given to the next."""
    running = images(limits=ImageLimits(max_connections=2))
    first, second = running.connect(), running.connect()
    replies_to(first, b"OK", 1)
    replies_to(second, b"OK", 1)
    assert running.connect().ended()
    first.close()
    assert eventually(lambda: running.service.connections == 1)
    replies_to(running.connect(), b"OK", 1)


class Always:
    """A service that always starts."""

    name = "always"
    required = True

    async def start(self) -> Endpoint:
        """Pretend."""
        return Endpoint("always", "127.0.0.1", 1)

    async def stop(self) -> None:
        """Pretend."""


def run_with_taken_port(required: bool) -> list[Endpoint]:
    """Endpoints of a server whose image port is taken."""
    found: list[Endpoint] = []

    async def scenario(port: int) -> None:
        images = ImageService("127.0.0.1", port, FakeSource(), Encoder(RAW), required=required)
        stop = asyncio.Event()

        def ready(endpoints) -> None:  # type: ignore[no-untyped-def]
            found.extend(endpoints)
            stop.set()

        await run_services([Always(), images], ready, stop)

    with socket.create_server(("127.0.0.1", 0)) as taken:
        asyncio.run(scenario(taken.getsockname()[1]))
    return found


def test_taken_port_is_a_warning(caplog) -> None:
    """Side channels reference 2.7: the image service alone fails, the server goes on."""
    assert [endpoint.name for endpoint in run_with_taken_port(required=False)] == ["always"]
    assert any("--image-port" in message for message in caplog.messages)


def test_taken_port_that_was_asked_for_is_an_error() -> None:
    """Somebody who names a port wants it."""
    with pytest.raises(ServiceError, match="--image-port"):
        run_with_taken_port(required=True)


def test_other_grids_have_their_own_frame(images) -> None:
    """The frame is the grid exactly (side channels reference 10, no. 2)."""
    client = images(FakeSource(Grid(4, 1, 32, 24))).connect()
    client.send(b"OK")
    assert client.value((128, 24)) == 0
    assert (BIG.width, BIG.height) == (1280, 960)
