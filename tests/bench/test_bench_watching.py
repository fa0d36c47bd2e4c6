"""Image clients of the benchmark: what they ask, count and time."""

from __future__ import annotations

import contextlib
import itertools
import socket
import threading
import time

import pytest

from usarsim_bench.figures import BenchError
from usarsim_bench.watching import watching
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


def test_the_full_frame_is_asked_for_and_repeats_are_known() -> None:
    """Each answer is one picture of its true size; every second one is news."""
    with FakeImages() as server, watching(server.port, [None]) as [views]:
        assert eventually(lambda: len(views) >= 20)
    assert set(server.requests) == {b"OK"}
    assert len(server.requests) == len(views) >= 20
    assert {one.octets for one in views} == {1005}
    changes = [a.content != b.content for a, b in itertools.pairwise(views)]
    assert changes[:6] == [False, True, False, True, False, True]


def test_a_rectangle_is_asked_for() -> None:
    """`U` and four big-endian integers; there is a picture as soon as one is inside."""
    tile = (320, 0, 320, 240)
    with FakeImages(request_length=17) as server, watching(server.port, [tile]) as [views]:
        assert views
    assert server.requests[0] == bytes.fromhex("55 00000140 00000000 00000140 000000F0")


def test_a_client_keeps_its_rate() -> None:
    """It asks no more often than told, and not in bursts after it was held up."""
    with FakeImages(pause=0.05) as server, watching(server.port, [None], 10.0) as [views]:
        assert eventually(lambda: len(views) >= 5)
    gaps = [b.asked - a.asked for a, b in itertools.pairwise(views)]
    assert min(gaps) > 0.05 - 0.001
    assert views[4].asked - views[0].asked > 0.39
    assert all(one.come - one.asked >= 0.05 for one in views)


def test_server_that_hangs_up_is_an_error() -> None:
    """A measurement without pictures is none."""

    def look(port: int) -> None:
        with watching(port, [None]) as [views]:
            assert eventually(lambda: len(views) == 3)

    with FakeImages(limit=3) as server, pytest.raises(BenchError, match="hung up"):
        look(server.port)


def test_what_went_wrong_before_is_told() -> None:
    """A client that was failed says less than what made the measurement end."""
    with (
        FakeImages(limit=3) as server,
        pytest.raises(ZeroDivisionError),
        watching(server.port, [None]),
    ):
        raise ZeroDivisionError


def test_nobody_there_is_an_error() -> None:
    """A server without images cannot be measured."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(BenchError, match="refused"), watching(port, [None]):
        pass
