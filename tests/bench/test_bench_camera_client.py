"""Image clients of the benchmark: what they ask, count and time."""

from __future__ import annotations

import contextlib
import itertools
import socket
import threading
import time

import pytest

from usarsim_bench.camera_client import Picture, Viewer, summed_up
from usarsim_bench.server import BenchError
from usarsim_client import Closing
from usarsim_server.testing import eventually


class FakeImages(Closing):
    """Answers each request after a while with 1000 bytes that change with every second answer."""

    def __init__(self, request_length: int = 2, pause: float = 0.0, limit: int = 10**9) -> None:
        self.requests: list[bytes] = []
        self._length, self._pause, self._limit = request_length, pause, limit
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            client, _ = self._listening.accept()
            with client:
                for number in itertools.count():
                    request = client.recv(self._length, socket.MSG_WAITALL)
                    if not request or number == self._limit:
                        return
                    self.requests.append(request)
                    time.sleep(self._pause)
                    payload = bytes([number // 2 % 256]) * 1000
                    client.sendall(b"\3" + len(payload).to_bytes(4) + payload)

    def close(self) -> None:
        """Hear nobody any more."""
        self._listening.close()


def wait_for(viewer: Viewer, count: int) -> None:
    """Until a viewer has so many pictures."""
    assert eventually(lambda: len(viewer.pictures) >= count)


def test_viewer_asks_for_the_full_frame_and_knows_repeats() -> None:
    """Each answer is one picture of its true size; every second one is news."""
    with FakeImages() as server, Viewer(server.port) as viewer:
        wait_for(viewer, 20)
    assert set(server.requests) == {b"OK"}
    assert len(server.requests) == len(viewer.pictures) >= 20
    assert {one.octets for one in viewer.pictures} == {1005}
    changes = [a.content != b.content for a, b in itertools.pairwise(viewer.pictures)]
    assert changes[:6] == [False, True, False, True, False, True]


def test_viewer_asks_for_a_rectangle() -> None:
    """`U` and four big-endian integers."""
    tile = (320, 0, 320, 240)
    with FakeImages(request_length=17) as server, Viewer(server.port, tile) as viewer:
        wait_for(viewer, 1)
    assert server.requests[0] == bytes.fromhex("55 00000140 00000000 00000140 000000F0")


def test_viewer_keeps_its_rate() -> None:
    """It asks no more often than told, and not in bursts after it was held up."""
    with FakeImages(pause=0.05) as server, Viewer(server.port, rate=10.0) as viewer:
        wait_for(viewer, 5)
    gaps = [b.asked - a.asked for a, b in itertools.pairwise(viewer.pictures)]
    assert min(gaps) > 0.05 - 0.001
    assert viewer.pictures[4].asked - viewer.pictures[0].asked > 0.39
    assert all(one.come - one.asked >= 0.05 for one in viewer.pictures)


def test_server_that_hangs_up_is_an_error() -> None:
    """A measurement without pictures is none."""
    with FakeImages(limit=3) as server:
        viewer = Viewer(server.port)
        assert eventually(lambda: not viewer._thread.is_alive())
        assert len(viewer.pictures) == 3
        with pytest.raises(BenchError, match="hung up"):
            viewer.close()


def test_nobody_there_is_an_error() -> None:
    """A server without images cannot be measured."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(BenchError, match="nobody listens"):
        Viewer(port)


def test_span_is_summed_up() -> None:
    """Rates count what came within the span; times to answer are those of these pictures."""
    pictures = [Picture(n * 0.1, n * 0.1 + 0.01 + 0.001 * n, 1000, n // 2) for n in range(100)]
    trial = summed_up(pictures, 1.0, 5.0)
    assert trial.pictures == pytest.approx(10.0, abs=0.3)
    assert trial.news == pytest.approx(5.0, abs=0.3)
    assert trial.octets == pytest.approx(10_000, rel=0.03)
    assert 0.020 <= trial.median <= trial.tail <= trial.longest <= 0.060


def test_no_picture_is_an_error() -> None:
    """One in two seconds is half a picture a second; of none there is nothing to tell."""
    assert summed_up([Picture(0.0, 0.1, 1, 1)], 0.0, 2.0).pictures == 0.5
    with pytest.raises(BenchError, match=r"no picture came in 1\.0 s"):
        summed_up([Picture(0.0, 1.1, 1, 1)], 0.0, 1.0)
