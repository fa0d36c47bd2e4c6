"""What an instructor does to operators in the page: scenarios, failures; what a trial allows."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import Stage, becomes, looks_at_pads, staged, until
from console_harness import gateway
from PIL import Image

from usarsim_operator import packets
from usarsim_operator.allowance import Allowance
from usarsim_operator.roles import Role

BAR = ".ready-bar:not([hidden])"

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
            await notice(ada, "only the gamepad drives here")
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


async def test_a_page_is_ready_when_its_pad_answers_and_it_sees(stage: Stage) -> None:
    """A gamepad trial waits for a button of the pad, every trial for the first picture; the page
    says what for. A pad that goes takes it back, and so does a page that leaves."""
    jpeg = io.BytesIO()
    Image.new("RGB", (32, 24)).save(jpeg, "JPEG")
    async with gateway(stage.tap, allowance=Allowance("gamepad", {})) as console:
        station = console.station
        await station.spawn("P3AT", "P1", "RobotStart7")
        station.waits = True
        async with stage.page(gateway=console) as page:
            await page.wait_for_selector(f"{BAR}[data-wants=pad]:has-text('Press any button')")
            await page.evaluate("plug('Pad')")
            await looks_at_pads(page)
            assert await page.locator(f"{BAR}[data-wants=pad]").count() == 1, "it did not answer"
            await page.evaluate("hold(16)")
            await page.wait_for_selector(
                f"{BAR}[data-wants=picture]:has-text('first picture of P1')"
            )
            await page.evaluate("hold()")
            assert not station.ready
            (one,) = station.pages.values()
            head = packets.head(packets.PICTURE, station.robots["P1"].index, 1, station.time)
            one.show("picture", "P1", head + jpeg.getvalue())
            await page.wait_for_selector(f"{BAR}[data-wants=nothing]:has-text('Ready')")
            await until(lambda: station.ready == {one.id: 1})
            await page.evaluate("unplug()")
            await page.wait_for_selector(f"{BAR}[data-wants=pad]")
            await until(lambda: not station.ready)
            await page.evaluate("plug('Pad'); hold(0)")
            await until(lambda: station.ready)
            station.waits = False
            await becomes(page, "document.querySelector('.ready-bar').hidden")
        await until(lambda: not station.ready)
