"""What an instructor does to time, in a real browser: pause, step, reset, and what is shown."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import Stage, becomes, staged

from usarsim_operator.roles import Role
from usarsim_server.services import scene_supervision
from usarsim_server.testing import PATIENCE

STATE = "window.usarsim.store.state"


@pytest.fixture(scope="module")
def stage(page_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    latch = tmp_path_factory.mktemp("latch") / "estop.json"
    yield from staged(page_folder, latch, scene_port=0, supervise="on")


async def pause(page: Any) -> None:
    """Let the world stand still by the button."""
    await page.click("[data-do=pause]")
    await page.wait_for_selector("[data-world=paused]")


async def test_steps_of_a_paused_world_raise_no_alarm(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CON-17: after each step the world stands again at once, and nothing of it is stale or lost.

    The clock's own telling comes too late here to help.
    """
    monkeypatch.setattr(scene_supervision, "TICK", 100.0 * PATIENCE)
    async with stage.page(Role.INSTRUCTOR, name="Ina") as page:
        await pause(page)
        station = stage.gateway.station
        for _ in range(8):
            before = station.time
            await page.click("[data-do=step]")
            await becomes(page, f"{STATE}.time > {before + 0.05} && {STATE}.paused")
        assert station.time < before + 0.2
        went = station.world.time
        await becomes(page, f"{STATE}.gateway_clock > {station.wall + 2.0}")
        assert station.world.time == went, "ages grow in a world that stands"
        assert await page.locator("[data-alarm]").count() == 0
        assert await page.inner_text("[data-alarms-hidden]") == "none"
        ages = await page.evaluate(
            f"{STATE}.robots.flatMap((r) => [r.pose_age, ...r.sensors.map((one) => one.age)])"
        )
        assert min(ages) >= 0.0
        assert max(ages) < 100.0
        await page.click("[data-do=pause]")
        await page.wait_for_selector("[data-world=runs]")
