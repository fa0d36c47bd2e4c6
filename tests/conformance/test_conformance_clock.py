"""Simulated time as the kit takes it from a robot, and what a busy machine does to it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from usarsim_conformance.clock import SimulatedClock, Stalled
from usarsim_conformance.control import ControlClient, Robot
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Failed
from usarsim_conformance.wire import Transcript, Wire
from usarsim_server.testing import PATIENCE

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
        for count in range(50):
            waiting = asyncio.create_task(wire.read(0.1))
            await asyncio.sleep(0)
            other.write(b"late\r\n")
            robot.write(status(6.0 + count))
            assert await waiting == b"late\r\n"
            await heard(clock, 6.0 + count)

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
        for time in (2.0, 3.0, 4.0):
            await tell(clock, robot, time)
        assert await waiting == b""

    told(story)


def test_a_kit_that_was_held_up_waits_on() -> None:
    """Half a minute that is told at once is a second to whoever waits: an answer within 5 s still
    has its chance on a machine that gave the kit no time to look for it."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, other: asyncio.StreamWriter
    ) -> None:
        await tell(clock, robot, 100.0)
        waiting = asyncio.create_task(wire.read(5.0))
        await tell(clock, robot, 130.0)
        await tell(clock, robot, 131.0)
        assert not waiting.done()
        other.write(b"late\r\n")
        assert await waiting == b"late\r\n"
        waiting = asyncio.create_task(wire.read(5.0))
        for time in range(132, 139):
            await tell(clock, robot, float(time))
        assert await waiting == b""

    told(story)


def test_a_moment_after_all_that_was_read() -> None:
    """What was told before the question is answered may be old; the report behind the answer is
    not."""

    async def story(clock: SimulatedClock, robot: asyncio.StreamWriter, *_: object) -> None:
        await tell(clock, robot, 5.0)
        asking = asyncio.create_task(clock.moment())
        await tell(clock, robot, 5.2)
        assert not asking.done()
        robot.write(b"NFO {StartPoses 0}\r\n" + status(5.4) + status(5.6))
        assert await asking == 5.4

    told(story)


def test_a_command_and_its_question_are_one_write() -> None:
    """So nothing holds the kit up between them, and a robot is watched from its first motion."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, other: asyncio.StreamWriter
    ) -> None:
        driven = Robot(ControlClient(wire), "", "", Place(None), Line(status(1.0)))
        under = asyncio.create_task(driven.under("DRIVE {Left 1} {Right 1}", seconds=0.2))
        other.write(status(1.0) + b"NFO {StartPoses 0}\r\n" + status(1.2) + status(1.4))
        assert [found.time for found in await under] == [1.2, 1.4]
        (sent,) = (entry for entry in wire._transcript.entries() if " > " in entry)
        assert sent.endswith(r"DRIVE {Left 1} {Right 1}\r\nGETSTARTPOSES\r\n")

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


async def stalls(waiting: Awaitable[object]) -> None:
    """Whoever waits is told that time stands still, and long before an hour has passed."""
    async with asyncio.timeout(PATIENCE):
        with pytest.raises(Stalled):
            await waiting


def test_a_server_that_hangs_costs_one_wait() -> None:
    """Whoever waits after the first is told at once, until there is news of time again."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, *_: object
    ) -> None:
        await tell(clock, robot, 1.0)
        await stalls(clock.sleep(2.0))
        clock.hangs = 3600.0
        for _count in range(20):
            await stalls(clock.sleep(2.0))
            await stalls(wire.silence(2.0))
        await tell(clock, robot, 2.0)
        waiting = asyncio.create_task(clock.sleep(1.0))
        await asyncio.sleep(0.2)
        assert not waiting.done()
        await tell(clock, robot, 3.0)
        await tell(clock, robot, 4.0)
        await waiting

    told(story, hangs=0.5)


def test_a_robot_that_is_hung_up_on_has_a_successor() -> None:
    """When the server ends the connection of the robot that tells the time, another one does."""

    async def run() -> None:
        ends: asyncio.Queue[asyncio.StreamWriter] = asyncio.Queue()
        server = await asyncio.start_server(lambda _, end: ends.put_nowait(end), "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        clock = SimulatedClock(3600.0)
        await clock.follow(lambda: Wire.open("127.0.0.1", port, Transcript(), "x", clock))
        try:
            async with asyncio.timeout(PATIENCE):
                for time in (1.0, 50.0, 7.0):
                    robot = await ends.get()
                    await tell(clock, robot, time)
                    waiting = asyncio.create_task(clock.sleep(0.7))
                    await tell(clock, robot, time + 0.95)
                    await waiting
                    robot.close()
        finally:
            await clock.close()
            server.close()

    asyncio.run(run())


def test_the_end_of_the_clock_ends_waits() -> None:
    """Whoever still waits for time is told when nobody tells it any more."""

    async def story(clock: SimulatedClock, robot: asyncio.StreamWriter, *_: object) -> None:
        await tell(clock, robot, 1.0)
        waiting = asyncio.create_task(clock.sleep(2.0))
        await asyncio.sleep(0)
        await clock.close()
        await stalls(waiting)

    told(story, hangs=3600.0)


def test_what_nobody_waited_for_is_received() -> None:
    """A connection on which somebody has waited in vain can be read on, whatever reads it."""

    async def story(
        clock: SimulatedClock,
        robot: asyncio.StreamWriter,
        wire: Wire,
        other: asyncio.StreamWriter,
    ) -> None:
        await tell(clock, robot, 1.0)
        waiting = asyncio.create_task(wire.silence(2.0))
        await asyncio.sleep(0)
        for time in (2.0, 3.0, 4.0):
            await tell(clock, robot, time)
        assert await waiting == b""
        other.write(b"late\r\n")
        assert await wire.receive() == b"late\r\n"

    told(story)


def test_what_is_made_in_real_time_is_waited_for_in_both() -> None:
    """A minute of simulated time passes at once; what comes a moment later is still read, and what
    never comes is given up."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, other: asyncio.StreamWriter
    ) -> None:
        await tell(clock, robot, 1.0)
        reading = asyncio.create_task(wire.read_exactly(2, 60.0, least_wall=PATIENCE))
        await asyncio.sleep(0)
        for time in range(2, 72):
            await tell(clock, robot, float(time))
        assert not reading.done()
        other.write(b"OK")
        assert await reading == b"OK"
        never = asyncio.create_task(wire.read_exactly(2, 5.0, least_wall=0.01))
        await asyncio.sleep(0)
        for time in range(72, 82):
            await tell(clock, robot, float(time))
        with pytest.raises(Failed, match="2 bytes did not come"):
            await never

    told(story)


def test_what_is_built_in_real_time_is_waited_for_in_both() -> None:
    """A world controller's answer may take wall time as well; silence is told by simulated time."""

    async def story(
        clock: SimulatedClock, robot: asyncio.StreamWriter, wire: Wire, other: asyncio.StreamWriter
    ) -> None:
        await tell(clock, robot, 10.0)
        client = ControlClient(wire)
        client.least_wall = PATIENCE
        waiting = asyncio.create_task(client.wait("STA", 1.0))
        for time in range(11, 20):
            await tell(clock, robot, float(time))
        assert not waiting.done()
        other.write(status(1.0))
        assert (await waiting).time == 1.0
        silence = asyncio.create_task(client.listen(1.0))
        for time in range(20, 30):
            await tell(clock, robot, float(time))
        assert await silence == []

    told(story)
