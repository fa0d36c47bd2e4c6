"""What an instructor does to time, in a real browser: pause, step, reset, and what is shown."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import Stage, becomes, staged

from usarsim_operator.observers import MissionRow
from usarsim_operator.roles import Role
from usarsim_server.scene import supervision_channels
from usarsim_server.testing import PATIENCE

pytestmark = pytest.mark.slow

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
    monkeypatch.setattr(supervision_channels, "TICK", 100.0 * PATIENCE)
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


async def test_reset_says_what_it_resets_and_does_it(stage: Stage) -> None:
    """O-26: robots go home, clock, marks, alarms and ways begin anew, simulated time goes on."""
    station = stage.gateway.station
    async with (
        stage.page(Role.INSTRUCTOR, name="Ina") as ina,
        stage.page(name="Ada") as ada,
    ):
        await becomes(ada, f"{STATE}.robots.every((one) => one.path > 0) && {STATE}.time > 3")
        home = await ada.evaluate(f"{STATE}.robots[0].pose")
        await ada.click("[data-do=take]")
        await becomes(ada, "window.usarsim.store.mine")
        await ada.keyboard.down("w")
        await becomes(ada, f"Math.hypot({STATE}.robots[0].pose[0] - {home[0]}, "
                      f"{STATE}.robots[0].pose[1] - {home[1]}) > 0.4")  # fmt: skip
        await ada.keyboard.up("w")
        text = "{type: 'mark', robot: 'R1', place: [1, 2, 0]}"
        await ada.evaluate(f"window.usarsim.input.link.request({text})")
        station.alarms.see("R2", "battery", True, "battery below 20 %", station.time)
        for page in (ina, ada):
            await page.wait_for_selector("[data-alarm]")
            await page.wait_for_selector("[data-mark]")
        before = station.time

        await ina.click("[data-do=reset]")
        told = await ina.inner_text("[data-dialog]")
        for word in ("robot", "doors", "victims", "clock", "marks", "alarms", "simulated time"):
            assert word in told, told
        await ina.click("[data-do=cancel]")
        assert await ina.locator("[data-mark]").count() == 1
        await ina.click("[data-do=reset]")
        await ina.click("[data-do=accept]")
        for page in (ina, ada):
            await page.wait_for_selector("[data-notices] p:text-is('Ina has reset the world')")
            await becomes(page, f"{STATE}.marks.length + {STATE}.alarms.length === 0")
            assert await page.locator("[data-mark], [data-alarm]").count() == 0
            clock = "document.querySelector('[data-clock]').innerText"
            begun = f"{STATE}.time - {STATE}.began"
            await becomes(page, f"{begun} > 0 && {clock} === "
                          f"'00:' + String(Math.floor({begun})).padStart(2, '0')")  # fmt: skip
        assert station.began >= before, "simulated time goes on"
        await becomes(ada, f"Math.hypot({STATE}.robots[0].pose[0] - {home[0]}, "
                      f"{STATE}.robots[0].pose[1] - {home[1]}) < 0.05")  # fmt: skip
        assert len(station.robots["R1"].telemetry.path) < 5


async def test_a_mission_that_is_run_is_not_reset(stage: Stage) -> None:
    """Its referee counts from its own beginning; the page says why."""
    station = stage.gateway.station
    async with stage.page(Role.INSTRUCTOR, name="Ina") as ina:
        station.mission = MissionRow({"name": "M", "remaining": 60.0}, {})
        try:
            await ina.click("[data-do=reset]")
            await ina.click("[data-do=accept]")
            await ina.wait_for_selector("[data-notices] p:has-text('a mission is run here')")
        finally:
            station.mission = None
