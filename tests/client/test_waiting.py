"""The calls that wait: nothing is missing, and each is the one that it runs."""

from __future__ import annotations

import asyncio
import threading

import pytest
from fake_server import FakeServer, until

from usarsim_client import (
    Avatar,
    GroundTruthPort,
    HangupError,
    Radio,
    Robot,
    Server,
    TruthPort,
    WorldController,
    connect_blocking,
    readings,
    waiting,
)
from usarsim_server.testing import PATIENCE

NOT_FOR_THREADS = {
    *("link", "state", "address", "robots"),
    *("stand_still", "release", "next_tick"),  # `sync` has all three
    *("dial", "register"),  # streams of an event loop; `Server.radio` registers
    "through",  # finds its tile by a coroutine
}


@pytest.mark.parametrize(
    ("inner", "outer"),
    [
        (Robot, waiting.BlockingRobot),
        (Avatar, waiting.BlockingAvatar),
        (WorldController, waiting.BlockingWorldController),
        (Server, waiting.BlockingServer),
        (Radio, waiting.BlockingRadio),
        (GroundTruthPort, waiting.BlockingGroundTruth),
        (TruthPort, waiting.BlockingTruth),
    ],
)
def test_nothing_is_missing(inner: type, outer: type) -> None:
    """Every public name of the asynchronous class is there, with its documentation."""
    names = {name for name in dir(inner) if not name.startswith("_")} - NOT_FOR_THREADS
    assert {name for name in names if not hasattr(outer, name)} == set()
    for name in names:
        assert getattr(outer, name).__doc__, name


class Served:
    """A fake server in a thread of its own."""

    def __enter__(self) -> FakeServer:
        self.fake = FakeServer(lambda line: ["STA {Time 0.1}"] if line.startswith("INIT") else [])
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever)
        self.thread.start()
        self.run(self.fake.__aenter__())
        return self.fake

    def run(self, work: object) -> None:
        """In that thread."""
        asyncio.run_coroutine_threadsafe(work, self.loop).result(PATIENCE)  # type: ignore[arg-type]

    def __exit__(self, *_: object) -> None:
        self.run(self.fake.__aexit__())
        self.run(self.loop.shutdown_default_executor())
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()


def test_streams_errors_and_the_end() -> None:
    """Values come by `for`; errors are those of the asynchronous calls; the thread ends."""
    served = Served()
    with served as fake:
        before = set(threading.enumerate())
        with connect_blocking(port=fake.port, timeout=PATIENCE) as server:
            with server.spawn("Rover", location=(0.0, 0.0, 0.0)) as gone:
                pass
            assert not gone.connected
            with pytest.raises(HangupError):
                gone.stop()
            robot = server.spawn("Rover", location=(0.0, 0.0, 0.0))
            poses = robot.odometry(keep=2)
            lines = [f"SEN {{Type Odometry}} {{Name O}} {{Pose {x},0,0}}" for x in range(4)]
            served.loop.call_soon_threadsafe(fake.say, *lines)
            served.run(until(lambda: robot.inner.state.lines >= 6))
            assert [next(poses).x, next(poses).x] == [2.0, 3.0]
            assert poses.dropped == 2
            assert robot.newest(readings.Odometry) is not None
            served.loop.call_soon_threadsafe(fake.hang_up)
            with pytest.raises(HangupError, match="closed the connection"):
                next(poses)
            with pytest.raises(ValueError, match="left and right"):
                robot.drive()
        with pytest.raises(RuntimeError, match="was closed"):
            robot.stop()
        assert set(threading.enumerate()) <= before


def test_failed_connections_leave_no_thread() -> None:
    with Served() as fake:
        port = fake.port
    before = set(threading.enumerate())
    with pytest.raises(ConnectionError, match=f"no server at 127.0.0.1:{port}"):
        connect_blocking(port=port, timeout=PATIENCE)
    assert set(threading.enumerate()) <= before
