"""The image service and the renderer: waiting for frames, and what is looked at for how long."""

from __future__ import annotations

import asyncio

from images_harness import (
    GRID,
    TILE,
    TILE_REQUEST,
    FakeSource,
    rectangle,
)
from services_harness import eventually

from usarsim_server.cameras.view import Region
from usarsim_server.services.attention import Bell
from usarsim_server.services.images import ImageLimits

TILE_SIZE = (TILE.width, TILE.height)
QUICK = ImageLimits(patience=0.2, linger=0.2)


# Waiting for the renderer


def test_request_waits_for_the_first_frame(images) -> None:
    """Nothing rendered yet: the client gets the first real picture, no placeholder."""
    source = FakeSource(value=None)
    client = images(source).connect()
    client.send(b"OK")
    assert eventually(lambda: source.looked_at == {GRID.frame})
    assert client.silent_for(0.1)
    source.show(42)
    assert client.value() == 42


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


def test_word_of_many_frames_reaches_the_loop_once() -> None:
    """A renderer that is faster than the loop does not fill it with calls; the last frame wins."""

    async def scenario() -> None:
        bell, source = Bell(), FakeSource()
        watch = source.watch(GRID.frame, bell.ring)
        news = bell.next()
        calls = 0
        soon = asyncio.get_running_loop().call_soon_threadsafe

        def counted(*arguments):  # type: ignore[no-untyped-def]
            nonlocal calls
            calls += 1
            return soon(*arguments)

        bell._loop.call_soon_threadsafe = counted  # type: ignore[method-assign]
        for value in range(50):
            source.show(value)
        assert int((await news).pixels[0, 0, 0]) == 49
        assert calls == 1
        watch.close()

    asyncio.run(scenario())


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
