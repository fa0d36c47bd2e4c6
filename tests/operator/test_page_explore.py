"""The page of explorations in a real browser."""

from __future__ import annotations

import asyncio
import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("aiohttp")

from console_browser import NO_GL, becomes, browsing
from test_console_input_access import AUDIT, AXE

from usarsim_exploration.running import Run
from usarsim_exploration.scenario import merge, read
from usarsim_exploration.showing.overlays import DEFAULT
from usarsim_exploration.showing.page import Page, served
from usarsim_exploration.showing.picture import draw
from usarsim_exploration.showing.tape import Tape
from usarsim_server.testing import PATIENCE

PIXELS = """() => {
  const image = document.querySelector("img");
  if (!image.naturalWidth) return [0, 0, ""];
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
  const context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  const data = context.getImageData(0, 0, canvas.width, canvas.height).data;
  return [canvas.height, canvas.width, btoa(String.fromCharCode(...data.slice(0, 90000)))];
}"""
SEEK = """(step) => {
  const slider = document.querySelector("input[name=step]");
  slider.valueAsNumber = step;
  slider.dispatchEvent(new Event("input"));
}"""
OPTIONS = (
    "environment.generator=office", "environment.columns=100", "environment.rows=100",
    "end.steps=40", "end.base=off", "end.home=false", "team.robots=2",
)  # fmt: skip


async def shown(page: Any, step: int) -> None:
    """Wait until a step is drawn."""
    await becomes(page, f"document.querySelector('img').dataset.step === '{step}'")


async def same(page: Any, tape: Tape, step: int, overlays: set[str], robot: int | None) -> None:
    """Wait until the browser's pixels are those of the picture."""
    await shown(page, step)
    wanted = draw(tape.scene(step), overlays, robot)
    async with asyncio.timeout(PATIENCE):
        while True:
            rows, columns, data = await page.evaluate(PIXELS)
            if not rows:  # the next picture is on its way
                await asyncio.sleep(0.01)
                continue
            assert (rows, columns) == wanted.shape[:2]
            found = np.frombuffer(base64.b64decode(data), np.uint8).reshape(-1, 4)[:, :3]
            if (found == wanted.reshape(-1, 3)[: len(found)]).all():
                return


def test_the_page_of_a_run(page_folder: Path) -> None:
    """E-77, E-78, EXP-19: steps, toggles and robots; each picture is that of files."""
    tape = Tape(Run(read(merge({}, OPTIONS))))

    async def look() -> None:
        async with (
            served(Page(tape, page_folder)) as address,
            browsing(*NO_GL) as browser,
        ):
            page = await browser.new_page(viewport={"width": 1366, "height": 768})
            wrong: list[str] = []
            page.on("pageerror", lambda error: wrong.append(str(error)))
            page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
            await page.goto(address)
            await page.wait_for_selector("html[data-ready]")
            await shown(page, 0)
            while tape.advance():
                pass
            await same(page, tape, 40, set(DEFAULT), None)  # follows the run
            await page.evaluate(SEEK, 7)
            await same(page, tape, 7, set(DEFAULT), None)
            await page.click("[data-do=forward]")
            await page.click("input[name=safe]")
            await page.select_option("select", "R2")
            await same(page, tape, 8, DEFAULT | {"safe"}, 2)
            assert "step 8 of 40" in await page.inner_text("header")
            asked: list[str] = []
            page.on("request", lambda request: asked.append(request.url))
            await page.click("[data-do=restart]")
            await shown(page, 0)
            # EXP-19 is about 0.2 s a jump: that of one picture, whatever lies between.
            assert sum("/picture?" in url for url in asked) == 1
            await page.click("[data-do=play]")
            await becomes(page, "document.querySelector('input[name=step]').value > 0")
            await page.click("[data-do=play]")
            assert await page.inner_text("[data-do=play]") == "Play"
            await page.evaluate(AXE.read_text(encoding="utf-8"))
            assert await page.evaluate(AUDIT) == []
            await page.set_viewport_size({"width": 390, "height": 844})
            assert await page.evaluate("document.documentElement.scrollWidth") <= 390
            assert wrong == []

    asyncio.run(look())
