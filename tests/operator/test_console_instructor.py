"""What an instructor does to operators in the page: scenarios, failures; what a trial allows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import Stage, becomes, staged, until
from console_harness import gateway

from usarsim_operator.allowance import Allowance
from usarsim_operator.roles import Role

_SCENARIO = """
schema = "usar-mission/1"
title = "Two robots"
world = "arena"
[[robot]]
name = "T1"
start = "RobotStart5"
[[robot]]
name = "T2"
start = "RobotStart6"
"""


@pytest.fixture(scope="module")
def stage(page_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    yield from staged(page_folder, tmp_path_factory.mktemp("latch") / "estop.json")


async def notice(page: Any, text: str) -> None:
    await page.wait_for_selector(f"[data-notices] p:has-text({text!r})")


async def test_an_instructor_and_what_a_trial_allows(stage: Stage, tmp_path: Path) -> None:
    """O-26, HRI-17: robots of a scenario file come and go by buttons, one fails; only the gamepad
    drives, and only robots of one's own; operators have no such buttons."""
    file = tmp_path / "two.toml"
    file.write_text(_SCENARIO)
    allowance = Allowance("gamepad", {"T2": 2})
    async with gateway(stage.tap, allowance=allowance) as console:
        await console.station.spawn("P3AT", "S1", "RobotStart8")
        async with (
            stage.page(gateway=console, name="Ada") as ada,
            stage.page(Role.INSTRUCTOR, gateway=console, name="Ina") as ina,
        ):
            await ada.click("[data-more] summary")
            assert not await ada.is_visible("[data-do=load]")
            await ina.click("[data-more] summary")
            await ina.set_input_files("[data-field=scenario]", file)
            await ada.wait_for_selector("[data-robot=T2]")
            await notice(ada, "Two robots: 2 robots have come")

            await ada.wait_for_selector("[data-only=gamepad]")
            await ada.click("[data-robot=T1]")
            await ada.keyboard.down("w")
            await notice(ada, "only the gamepad drives in this trial")
            await ada.keyboard.up("w")
            assert await ada.evaluate("drives().length") == 0
            await ada.evaluate("plug('Pad'); hold(5); tilt(0, -1, 0, 0)")
            await until(lambda: any(left > 0.9 for left, _ in stage.wire.drives("T1")))

            await ina.click("[data-robot=T1]")
            await ina.click("[data-do=robot_fails]")
            await ada.wait_for_selector("[data-field=mode]:text-is('failed')")
            assert (
                await ada.locator("[role=option] [data-f=holder]:has-text('failed')").count() == 1
            )
            await until(lambda: stage.wire.drives("T1")[-1:] == [(0.0, 0.0)])
            assert await ada.is_disabled("[data-do=enable]")
            await ina.click("[data-do=robot_recovers]")
            await becomes(ada, "window.usarsim.store.robot.enabled")

            await ada.evaluate("tilt(0, 0, 0, 0)")
            await ada.click("[data-robot=T2]")
            await ada.wait_for_selector('[data-field=holder]:text-is("operator 2\'s")')
            await ada.evaluate("tilt(0, -1, 0, 0)")
            await notice(ada, "T2 is for operator 2 to drive")
            assert await ada.is_disabled("[data-do=take]")

            await ina.click("[data-robot=T1]")
            await ina.fill("[data-field=message]", "Go home")
            await ina.click("[data-do=message]")
            await notice(ada, "Go home")
            await ina.click("[data-do=close]")
            await becomes(ada, "window.usarsim.store.robots.length === 0")
            assert not console.station.robots
            assert await ada.evaluate("[...window.usarsim.store.slots.keys()]") in ([], [255])
            assert await ada.locator("[data-tile]").count() == 0
