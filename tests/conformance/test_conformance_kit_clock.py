"""Simulated time as the kit tells it: evenly, in order, and however slow the machine is."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from usarsim_conformance.clock import SimulatedClock, Stalled
from usarsim_conformance.recordings import irregular
from usarsim_conformance.transcript import Transcript
from usarsim_conformance.wire import Wire

Story = Callable[
    [SimulatedClock, asyncio.StreamWriter, Wire, asyncio.StreamWriter], Awaitable[None]
]


def told(story: Story, hangs: float = 60.0) -> None:
    """Tell a story with a clock, the server's end of the robot that it follows, and both ends of
    another connection."""

    async def run() -> None:
        ends: asyncio.Queue[asyncio.StreamWriter] = asyncio.Queue()
        done = asyncio.Event()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            ends.put_nowait(writer)
            await done.wait()
            writer.close()

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        clock = SimulatedClock(hangs)

        async def connected() -> Wire:
            return await Wire.open("127.0.0.1", port, Transcript(), "x", clock)

        wire = await connected()
        other = await ends.get()
        await clock.follow(connected)
        robot = await ends.get()
        try:
            await story(clock, robot, wire, other)
        finally:
            await clock.close()
            wire.close()
            done.set()
            server.close()

    asyncio.run(run())


def status(time: float) -> bytes:
    """A report."""
    return f"STA {{Type GroundVehicle}} {{Time {time:.2f}}}\r\n".encode()


async def tell(clock: SimulatedClock, robot: asyncio.StreamWriter, time: float) -> None:
    """Report, and wait until the kit has read it."""
    robot.write(status(time))
    await heard(clock, time)


async def heard(clock: SimulatedClock, time: float) -> None:
    """Wait until the kit has read a report."""
    for _ in range(60_000):
        if clock.told == time:
            return
        await asyncio.sleep(0.001)
    raise AssertionError(f"the clock has not heard of {time}")


def test_time_passes_when_it_is_told() -> None:
    """A wait ends when a report tells its moment, and not before."""

    async def story(clock: SimulatedClock, robot: asyncio.StreamWriter, *_: object) -> None:
        await tell(clock, robot, 100.0)
        waiting = asyncio.create_task(clock.sleep(1.0))
        await tell(clock, robot, 100.9)
        assert not waiting.done()
        robot.write(status(101.3))
        await waiting

    told(story)


def test_what_was_sent_before_counts() -> None:
    """A line that the server sent before it told the end of a wait is not missed, even if both come
    at once."""

    async def story(
        clock: SimulatedClock,
        robot: asyncio.StreamWriter,
        wire: Wire,
        other: asyncio.StreamWriter,
    ) -> None:
        await tell(clock, robot, 5.0)
        for number in range(50):
            waiting = asyncio.create_task(wire.read(0.1))
            await asyncio.sleep(0)
            other.write(b"late\r\n")
            robot.write(status(6.0 + number))
            assert await waiting == b"late\r\n"
            await heard(clock, 6.0 + number)

    told(story)


def test_silence_is_silence() -> None:
    """Nothing that comes until time has passed is told as nothing."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, *_: object
    ) -> None:
        await tell(clock, robot, 1.0)
        waiting = asyncio.create_task(wire.silence(2.0))
        await asyncio.sleep(0.05)
        assert not waiting.done()
        robot.write(status(9.0))
        assert await waiting == b""

    told(story)


def test_a_server_that_hangs() -> None:
    """If no time is told any more, whoever waits is told."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, *_: object
    ) -> None:
        robot.write(status(1.0))
        with pytest.raises(Stalled):
            await wire.silence(2.0)

    told(story, hangs=0.5)


@pytest.mark.parametrize(
    ("times", "wrong"),
    [
        ([n * 0.2 for n in range(40)], ""),
        ([round(n * 0.05 / 0.004) * 0.004 for n in range(160)], ""),
        ([n * 0.2 for n in range(40) if n != 17], "missing"),
        ([n * 0.2 for n in range(40) if n % 4], "missing"),
        ([n * 0.2 for n in (*range(17), 16, *range(17, 40))], "too many"),
    ],
)
def test_streams_are_regular_or_not(times: list[float], wrong: str) -> None:
    """A report that is left out, or comes twice, is told; time steps that alternate are not."""
    found = irregular(sorted(times))
    assert (wrong in found) if wrong else not found
