"""CON-15: the emergency stop is not held up by pages that flood the gateway or read nothing."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import Wire, until
from console_harness import gateway

from benchmarks.console.programs import RawPage, driving, hostile_page
from usarsim_operator.pages import Page
from usarsim_operator.requests import Desk
from usarsim_operator.roles import Role
from usarsim_record.proxy import Proxy
from usarsim_record.recording import Link
from usarsim_server.testing import running_server

ROBOTS = 16
ROUNDS = 8
BLOCKS = 10
"""Texts of 10 kB of the hostile page: what it sends in 100 ms at 1 MB/s."""


@contextlib.asynccontextmanager
async def stalled(rig: Any) -> AsyncIterator[None]:
    """An instructor's page that beats, but reads nothing."""
    page = await asyncio.to_thread(RawPage, rig, "instructor")
    beats = asyncio.create_task(page.run(0.0))
    try:
        yield
    finally:
        beats.cancel()
        page.close()


async def test_a_stop_passes_hostile_and_stalled_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    """CON-15: before the gateway has read 100 kB more of a page that sends 1 MB/s of nonsense, zero
    DRIVE of 16 robots is on the wire, although an instructor's page reads nothing at all."""
    flooded = 0
    plain = Desk.admits

    def admits(desk: Desk, page: Page, text: str) -> bool:
        nonlocal flooded
        flooded += text.startswith("{{")
        return plain(desk, page, text)

    monkeypatch.setattr(Desk, "admits", admits)
    wire = Wire()
    with running_server(world="arena", scene_port=0) as (_, endpoints):
        proxy = Proxy([Link(0, "127.0.0.1", endpoints["control"].port)], wire)  # type: ignore[arg-type]
        tap = (await proxy.start())[0]
        async with gateway(tap, scene=endpoints["scene"].port) as console:
            names = [f"R{one}" for one in range(1, ROBOTS + 1)]
            for place, name in enumerate(names):
                await console.station.spawn("P3AT", name, f"RobotStart{place + 1}")
            tokens = {role.value: console.web.tokens[role] for role in Role}
            rig: Any = SimpleNamespace(port=console.port, url=console.url, tokens=tokens, robots=[])
            async with (
                console.page() as page,
                driving(rig, names),
                stalled(rig),
                hostile_page(rig),
            ):
                for _ in range(ROUNDS):
                    marks = {name: len(wire.drives(name)) for name in names}
                    before = flooded
                    await until(lambda b=before: flooded > b + 2)
                    await until(
                        lambda m=marks: all(any(map(any, wire.drives(n)[m[n] :])) for n in names)
                    )
                    marks, before = {name: len(wire.drives(name)) for name in names}, flooded
                    await page.say("estop")
                    await until(
                        lambda m=marks: all((0.0, 0.0) in wire.drives(n)[m[n] :] for n in names)
                    )
                    assert flooded - before <= BLOCKS
                    await page.until(lambda: page.state.get("estop"))
                    assert all(wire.drives(name)[-1] == (0.0, 0.0) for name in names)
                    assert (await page.ask("estop_reset"))["ok"]
                late = max(
                    console.station.pages.values(), key=lambda one: sum(one.dropped.values())
                )
                assert late.dropped.get("poses", 0) > 10
        await proxy.stop()
