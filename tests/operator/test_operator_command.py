"""`usarsim console` as its users start it."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

import aiohttp
from console_rig import Console

from usarsim_client import connect_scene
from usarsim_server.assembly import Assembly
from usarsim_server.testing import PATIENCE, ScriptedClient, eventually, running_server

COMMAND = [sys.executable, "-m", "usarsim_server", "console", "--no-browser", "--console-port=0"]


async def _see(port: int, name: str, present: bool) -> None:
    """Wait until a robot is in the world, or no longer."""
    async with asyncio.timeout(PATIENCE), await connect_scene("127.0.0.1", port) as world:
        async for _ in world:
            if world.reader.present is not None and (world.find(name) is not None) == present:
                return


def test_console_says_where_it_is_and_its_death_stops_robots() -> None:
    """CON-16: SIGKILL of the gateway hangs up, and who hangs up leaves the world."""
    with running_server(world="empty", scene_port=0) as (_, endpoints):
        port, scene = endpoints["control"].port, endpoints["scene"].port
        command = [*COMMAND, f"--connect=127.0.0.1:{port}", "--robot=P3AT=Mine"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            lines = [process.stdout.readline() for _ in range(3)]
            first, *others = (
                re.fullmatch(r"CONSOLE (http://\S+/)#\S+ \w+\n", line) for line in lines
            )
            assert first is not None
            assert all(others)
            with urllib.request.urlopen(first[1] + "health") as answer:
                assert answer.read() == b"ok"
            asyncio.run(_see(scene, "Mine", True))
            process.send_signal(signal.SIGKILL)
            process.wait(PATIENCE)
            asyncio.run(_see(scene, "Mine", False))
        finally:
            process.kill()
            process.wait()
            if process.stdout is not None:
                process.stdout.close()


Moment = tuple[float, float, float]
"""Simulated time, s, and a place, m."""


def _place(assembly: Assembly) -> Moment:
    look = assembly.robots.vehicles[0].body.look()
    assert look is not None
    return look.time, look.pose.position[0], look.pose.position[1]


def _speed(before: Moment, after: Moment) -> float:
    return math.dist(before[1:], after[1:]) / (after[0] - before[0])


def _goes(assembly: Assembly, wanted: Callable[[float], bool]) -> float:
    """Wait until its mean speed over 0.1 s is as wanted; the simulated time at which it began."""
    before = _place(assembly)
    end = before[0] + 20.0
    while before[0] < end:
        due = before[0] + 0.1
        assert eventually(lambda due=due: assembly.simulation.now >= due)
        after = _place(assembly)
        if wanted(_speed(before, after)):
            return before[0]
        before = after
    raise AssertionError("it never went at the speed that was wanted")


async def _take_and_drive(console: Console, robot: str, death: Callable[[], None]) -> None:
    """Take a robot by a page, drive it at full power until `death`, which is not waited for."""
    base, _, token = console.urls["operator"].partition("#")
    base = base.rstrip("/")
    async with (
        asyncio.timeout(PATIENCE),
        aiohttp.ClientSession() as http,
        http.ws_connect(f"{base}/socket", headers={"Origin": base}, max_msg_size=0) as page,
    ):
        await page.send_json({"type": "hello", "token": token, "name": "Ada"})
        for number in itertools.count(1):  # until the gateway has heard of it
            await page.send_json({"type": "take", "robot": robot, "id": number})
            while (answer := await page.receive_json()).get("id") != number:
                pass
            if answer["ok"]:
                break
        dying = asyncio.create_task(asyncio.to_thread(death))
        with contextlib.suppress(aiohttp.ClientConnectionResetError):  # it is dead
            while not dying.done():
                await page.send_json({"type": "drive", "robot": robot, "left": 1.0, "right": 1.0})
                await asyncio.sleep(0.05)
        await dying


def test_death_of_the_gateway_frees_a_robot_taken_over(tmp_path: Path) -> None:
    """CON-16: SIGKILL of the gateway in the middle of a drive: the robot stands within 1 s of
    simulated time, and then its controller drives it again."""
    with (
        running_server(world="empty", scene_port=0, supervise="on") as (assembly, endpoints),
        ScriptedClient(endpoints["control"].port) as legacy,
        Console(
            endpoints["control"].port,
            f"--scene-port={endpoints['scene'].port}",
            folder=tmp_path,
        ) as console,
    ):
        legacy.send("INIT {ClassName USARBot.P3AT} {Name Theirs} {Location 0,0,-0.3}")
        legacy.wait_for("SEN")
        killed = math.inf

        def die() -> None:
            nonlocal killed
            _goes(assembly, lambda speed: speed > 0.1)
            console.process.kill()
            console.process.wait(PATIENCE)
            killed = assembly.simulation.now

        asyncio.run(_take_and_drive(console, "Theirs", die))
        assert _goes(assembly, lambda speed: speed < 0.02) <= killed + 1.0
        assert eventually(lambda: all(one.tap is None for one in assembly.sessions))
        legacy.fence()
        legacy.send("DRIVE {Left 2} {Right 2}")
        _goes(assembly, lambda speed: speed > 0.1)


def test_console_without_server_is_one_line() -> None:
    """Nobody at --connect: exit code 2 and what to look at."""
    done = subprocess.run([*COMMAND, "--connect=127.0.0.1:1"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "127.0.0.1:1" in done.stderr
    assert "Traceback" not in done.stderr
