"""CON-22: what waits for a page that reads slowly waits where the newest wins."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace
from typing import Any

from console_harness import gateway

from benchmarks.console.programs import SLOW_RATE, RawPage
from usarsim_operator.roles import Role
from usarsim_server.testing import PATIENCE, running_server

MOST = 24 * 1024
"""Bytes of the past that a page may find when it reads again: a map may be among them."""


async def test_little_of_the_past_waits_for_a_slow_page() -> None:
    """CON-22: a page that reads 20 kB/s, and then nothing for a while, finds the state of now
    behind a few kB: what is just being sent, and not what a buffer of the kernel holds."""
    with running_server(world="arena", image_port=0, scene_port=0) as (_, endpoints):
        ports = {name: one.port for name, one in endpoints.items()}
        async with (
            gateway(ports["control"], image_port=ports["images"], scene=ports["scene"]) as console,
            console.page() as other,
        ):
            answer = await other.ask("spawn", **{"class": "P3AT"}, name="Seen", start="RobotStart1")
            assert answer["ok"], answer
            tokens = {"instructor": console.web.tokens[Role.INSTRUCTOR]}
            rig: Any = SimpleNamespace(port=console.port, url=console.url, tokens=tokens)
            slow = await asyncio.to_thread(RawPage, rig, "instructor")
            try:
                await other.until(lambda: len(console.station.pages) == 2)
                late = max(console.station.pages.values(), key=lambda one: one.id)
                reading = asyncio.create_task(slow.run(SLOW_RATE))
                await other.until(lambda: late.uptake.room is not None)
                room = late.uptake.room
                assert room is not None
                assert room < SLOW_RATE
                known = len(slow.states)  # what was sent before that was known is read meanwhile
                await other.until(lambda: len(slow.states) >= known + 5)
                reading.cancel()
                beats = asyncio.create_task(slow.run(0.0))
                await other.until(
                    lambda: late.dropped.get("poses", 0) > 10 and late.dropped.get("state", 0) > 2
                )
                beats.cancel()
                resumed, before = time.perf_counter(), slow.received
                reading = asyncio.create_task(slow.run(1e9))
                async with asyncio.timeout(PATIENCE):
                    while not any(now - age >= resumed for now, age in slow.states):  # noqa: ASYNC110
                        await asyncio.sleep(0.005)
                assert slow.received - before < MOST
                reading.cancel()
            finally:
                slow.close()
