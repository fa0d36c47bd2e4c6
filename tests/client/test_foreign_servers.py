"""The client at servers that say little, say it otherwise, or go away."""

from __future__ import annotations

import asyncio
import re
import socket
from collections.abc import Callable, Coroutine
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from fake_server import FakeServer, until

from usarsim_client import (
    HangupError,
    NoAnswerError,
    ProtocolError,
    Retry,
    SpawnError,
    connect,
    readings,
    reports,
)
from usarsim_client.commands import drive, say
from usarsim_server.testing import PATIENCE

POSES = "NFO {StartPoses 1}{RobotStart1 1,2,3 0,0,0}"
STATUS = "STA {Time 0.3021} {Battery 99999}"


def silent(line: str) -> list[str]:
    """Streams to who is in the world, and answers no question at all."""
    return [STATUS] if line.startswith("INIT") else []


class Original:
    """Answers what it knows, and only P3AT of the robots."""

    def __init__(self) -> None:
        self.spawned = False

    def __call__(self, line: str) -> list[str]:
        if line.split()[0] == "GETSTARTPOSES":  # segments that it does not know are nothing to it
            return [POSES]
        if line.startswith("INIT {ClassName USARBot.P3AT}"):
            self.spawned = True
            return [STATUS]
        return ["CONF {Name P3AT}"] if line == "GETCONF {Type Robot}" and self.spawned else []


def free_port() -> int:
    """A port where nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as one:
        port: int = one.getsockname()[1]
        return port


def at(answer: Callable[[str], list[str]], **more: Any) -> Callable[..., None]:
    """Runs a test against a fake server."""

    def decorate(test: Callable[[FakeServer], Coroutine[Any, Any, None]]) -> Callable[..., None]:
        def run() -> None:
            async def play() -> None:
                async with FakeServer(answer, **more) as server, asyncio.timeout(PATIENCE):
                    await test(server)

            asyncio.run(play())

        run.__name__, run.__doc__ = test.__name__, test.__doc__
        return run

    return decorate


@at(silent)
async def test_server_that_answers_no_question(fake: FakeServer) -> None:
    """A robot is in the world when anything streams; questions end by themselves."""
    async with connect(port=fake.port, timeout=PATIENCE, groundtruth_port=fake.port) as server:
        with patch("usarsim_client.server.GRACE", 0.05):
            robot = await server.spawn("Rover", "R", location=(1.0, 2.0, 3.0))
        await robot.drive(left=0.5, right=-0.5)
        assert robot.newest(reports.Status) is not None
        stream = robot.odometry()
        fake.say("SEN {Time 0.5} {Type Odometry} {Name O} {Pose 1,2,3}")
        assert (await anext(stream)).x == 1.0
    assert next(line for line in fake.heard if line.startswith("INIT")) == (
        "INIT {ClassName USARBot.Rover} {Name R} {Location 1.000000,2.000000,3.000000} "
        "{ExactName true}"
    )
    assert "DRIVE {Left 0.500000} {Right -0.500000} {Normalized false}" in fake.heard


@at(silent)
async def test_no_answer_in_time(fake: FakeServer) -> None:
    """The error names the question."""
    async with connect(port=fake.port, timeout=0.5) as server:
        robot = await server.spawn("Rover", start="Anywhere")  # nobody says that there is none
        with pytest.raises(TimeoutError, match=r"no answer to GETGEO \{Type Sonar\} within 0.5 s"):
            await robot.geometry("Sonar")


@at(Original(), greeting=POSES, end="\n")
async def test_another_greeting_and_line_end(fake: FakeServer) -> None:
    """The Gazebo generation greets with start poses; refusals are noticed without a timeout."""
    async with connect(port=fake.port, timeout=PATIENCE) as server:
        assert server.greeting is None
        assert [pose.tag for pose in await server.start_poses()] == ["RobotStart1"]
        robot = await server.spawn("P3AT", start="robotstart1")
        assert (await robot.vehicle()).class_name == "P3AT"
        with pytest.raises(NoAnswerError, match=r"GETCONF \{Type RFID\}"):
            await robot.configuration("RFID")
        with pytest.raises(SpawnError, match="no start pose RobotStrat1; did you mean RobotStart1"):
            await server.spawn("P3AT", start="RobotStrat1")


@at(Original())
async def test_refused_without_a_word(fake: FakeServer) -> None:
    """Who is refused may try again with the same program; the guess is the client's own."""
    with patch("usarsim_client.link.GRACE", 0.05):
        await _refused(fake)


async def _refused(fake: FakeServer) -> None:
    async with connect(port=fake.port, timeout=PATIENCE) as server:
        with pytest.raises(SpawnError, match=r"no P3TA came into the world.*did you mean P3AT\?"):
            await server.spawn("P3TA")
        assert (await server.spawn("P3AT")).connected


@at(lambda line: ["NFO {Status Refused} {Reason no class P3TA; did you mean P3AT?}"])
async def test_refused_with_a_reason(fake: FakeServer) -> None:
    async with connect(port=fake.port, timeout=PATIENCE) as server:
        with pytest.raises(SpawnError, match="no class P3TA; did you mean P3AT"):
            await server.spawn("P3TA")


def test_nobody_there() -> None:
    """No server, and one that says nothing."""

    async def look() -> None:
        async with FakeServer(silent, greeting="") as fake:
            with pytest.raises(ProtocolError, match="no USARSim server at 127"):
                await connect(port=fake.port, timeout=0.05).__aenter__()
            port = fake.port
        with pytest.raises(ConnectionError, match=f"no server at 127.0.0.1:{port}"):
            await connect(port=port, timeout=PATIENCE).__aenter__()

    asyncio.run(look())


@at(silent)
async def test_hangup_ends_streams_and_questions(fake: FakeServer) -> None:
    """What was said before is given out first."""
    async with connect(port=fake.port, timeout=PATIENCE) as server:
        robot = await server.spawn("Rover")
        stream, question = robot.odometry(), asyncio.create_task(robot.geometry("Sonar"))
        await until(lambda: "GETGEO {Type Sonar}" in fake.heard)
        fake.say("SEN {Type Odometry} {Name O} {Pose 1,2,3}")
        fake.hang_up()
        with pytest.raises(HangupError, match="closed the connection"):
            await question
        assert [value.x async for value in _until_hangup(stream)] == [1.0]
        with pytest.raises(HangupError):
            await robot.drive(left=1.0, right=1.0)
        assert server.robots == ()


async def _until_hangup(stream: Any) -> Any:
    try:
        async for value in stream:
            yield value
    except HangupError:
        return


@at(silent)
async def test_robot_comes_back(fake: FakeServer) -> None:
    """With a `Retry` the robot is spawned again under its name, and its streams go on."""
    retry = Retry(first=0.001, most=0.01)
    async with connect(
        port=fake.port, timeout=PATIENCE, retry=retry, groundtruth_port=free_port()
    ) as server:
        with patch("usarsim_client.server.GRACE", 0.05):
            robot = await server.spawn("Rover", "R", location=(1.0, 0.0, 0.0))
        odometry = robot.odometry()
        for spawns in (2, 3):
            fake.hang_up()
            await until(lambda count=spawns: robot.link.spawns == count)  # type: ignore[misc]
        await robot.stop()
        fake.say("SEN {Type Odometry} {Name O} {Pose 1,2,3}")
        assert (await anext(odometry)).y == 2.0
    inits = [line for line in fake.heard if line.startswith("INIT")]
    assert len(inits) == 3
    assert len(set(inits)) == 1


@at(silent)
async def test_retries_end(fake: FakeServer) -> None:
    """After so many tries the robot is gone for good."""
    retry = Retry(first=0.001, most=0.001, tries=2)
    async with connect(port=fake.port, timeout=PATIENCE, retry=retry) as server:
        robot = await server.spawn("Rover")
        stream = robot.odometry()
        await fake.__aexit__()
        with pytest.raises(HangupError):
            await anext(stream)
        assert robot.link.closed


@at(silent)
async def test_slow_readers_bloat_nobody(fake: FakeServer) -> None:
    """The newest of each item waits, older ones are counted; a queue keeps its length."""
    async with connect(port=fake.port, timeout=PATIENCE) as server:
        robot = await server.spawn("Rover")
        newest, queue, whole = robot.stream(readings.Sonar), robot.sensors(keep=3), robot.lines()
        one = robot.stream(readings.Sonar, "B")
        for number in range(50):
            fake.say(f"SEN {{Type Sonar}} {{Name A Range {number}}} {{Name B Range {number}}}")
        fake.say("SEN {Type Odometry} {Name O} {Pose 1,2,3}")
        await until(lambda: robot.newest(readings.Odometry) is not None)
        assert [(await anext(newest)).range for _ in range(2)] == [49.0, 49.0]
        assert newest.dropped == 98
        assert (await anext(one)).name == "B"
        assert [(await anext(queue)).name for _ in range(3)] == ["A", "B", "O"]
        assert queue.dropped == 98
        assert re.match(r"SEN \{Type Sonar\} \{Name A Range 0\}", (await anext(whole)).text)


def test_commands_that_cannot_be_said() -> None:
    """Nothing that would become another command."""
    for value in ("a}b", "a{b", "a\r\nINIT", float("nan"), float("inf"), "\u20ac"):
        with pytest.raises(ValueError, match=r"segment|finite|codec"):
            say("SET", Type=value)
    assert say("SET", Type="RFID", Params=None, On=True) == b"SET {Type RFID} {On true}\r\n"
    none: tuple[float | None, ...] = (None,) * 5
    for members in ((1.0, *none[1:]), none, (1.0, 1.0, 1.0, None, None), (*none[:3], 0.1, None)):
        with pytest.raises(ValueError, match="drive with"):
            drive(*members, False)  # type: ignore[arg-type]
    assert say("X", A=np.float32(0.5), B=np.int64(3), C=np.array([1.0, 2.0])) == (
        b"X {A 0.500000} {B 3} {C 1.000000,2.000000}\r\n"
    )
    assert drive(0.5, -1.0, None, None, None, True) == (
        b"DRIVE {Left 50.000000} {Right -100.000000} {Normalized true}\r\n"
    )
