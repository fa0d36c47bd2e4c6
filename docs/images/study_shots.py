"""Makes the pictures of a study's session for docs/studies.md, out of a real one.

Needs the console's extra, playwright, Chromium and Pillow: ``python docs/images/study_shots.py``.
A desk leads a participant of the shipped study `rsarsim`, without its training, through a trial of
40 s; a browser drives, marks, answers a probe and fills in the form, another one is the
experimenter's.
"""

import asyncio
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

from console_shots import DESKTOP, FLAGS, HERE, save, until
from playwright.async_api import async_playwright

PROBE = '[[probe]]\nat = 20\nquestion = "nearest_to_last_mark"\n'
ANSWERS = {"mental": 65, "physical": 20, "temporal": 50, "performance": 30, "effort": 60}


def study() -> str:
    """The shipped study, without training, and with a probe."""
    text = (files("usarsim_study") / "studies" / "rsarsim.toml").read_text(encoding="utf-8")
    return re.sub(r"\[training\]\n(?:.+\n)*", "", text) + "\n" + PROBE


@contextmanager
def led(folder: Path) -> Iterator[dict[str, str]]:
    """A desk with a session; the address of each seat."""
    (folder / "study.toml").write_text(study(), encoding="utf-8")
    usarsim = [sys.executable, "-m", "usarsim_server"]
    asked = ["study", "run", str(folder / "study.toml"), "--out", str(folder / "out")]
    asked += ["--port", "0", "--trial-seconds", "40"]
    desk: Any = subprocess.Popen([*usarsim, *asked], stdout=subprocess.PIPE, text=True)
    try:
        found = re.findall(r"DESK (\S+) (.+)", until(desk, "SESSION"))
        yield {seat: url for url, seat in found}
    finally:
        desk.terminate()
        desk.wait(60)


async def becomes(page: Any, expression: str) -> None:
    """Wait until something is so in a page, whose policy forbids playwright's own way to."""
    while not await page.evaluate(expression):  # noqa: ASYNC110
        await asyncio.sleep(0.1)


async def answered(page: Any) -> None:
    """Answer all that a form asks with what lies in the middle, and hand it in."""
    for item in await page.query_selector_all("[data-item]"):
        options = await item.query_selector_all("[data-value]")
        await options[len(options) // 2].click()
    await page.click("[data-do=next]")


async def to_trial(page: Any) -> Any:
    """Through consent and forms to the panel, which is returned once it shows pictures."""
    while (kind := await page.evaluate("window.study?.step?.kind")) != "panel":
        if kind == "text":
            await page.click("[data-do=next]")
        elif kind == "form":
            await answered(page)
        await asyncio.sleep(0.3)
    await page.wait_for_selector("iframe")
    await page.frames[1].wait_for_selector("[data-tile][data-camera=on][data-stale=false]")
    return page.frames[1]


async def drive(page: Any, frame: Any) -> None:
    """Drive three robots and mark somebody, until shortly before the probe."""
    for robot, keys in (("1", "w"), ("1", "d"), ("3", "wa")):
        await page.keyboard.press(robot)
        for key in keys:
            await page.keyboard.down(key)
        await asyncio.sleep(1.5)
        for key in keys:
            await page.keyboard.up(key)
        if keys == "d":
            await page.keyboard.press("m")
            await frame.wait_for_selector("dialog[open]")
            await page.keyboard.press("Tab")
            await page.keyboard.type("at the wall")
            await page.keyboard.press("Enter")
    await page.keyboard.press("2")
    await page.keyboard.down("w")
    await becomes(frame, "usarsim.store.state.mission.remaining < 24")


async def fail(leader: Any, robot: str) -> None:
    """Let a robot fail."""
    await leader.select_option("[data-field=whom]", robot)
    await leader.fill("[data-field=lasts]", "60")
    await leader.click("[data-do=inject]")


async def shoot() -> None:
    """Make all pictures."""
    with tempfile.TemporaryDirectory() as place, led(Path(place)) as urls:
        async with async_playwright() as tools:
            browser = await tools.chromium.launch(
                executable_path="/usr/bin/chromium",
                args=FLAGS,
                env={**os.environ, "LIBGL_ALWAYS_SOFTWARE": "1"},
            )
            light = await browser.new_context(viewport=DESKTOP, color_scheme="light")
            page, leader = await light.new_page(), await light.new_page()
            await leader.goto(urls["experimenter"])
            await page.bring_to_front()
            await page.goto(urls["operator 1"])
            frame = await to_trial(page)
            await fail(leader, "R4")
            await drive(page, frame)
            save(await page.screenshot(), HERE / "study-panel.png")
            await page.keyboard.up("w")
            await becomes(page, "window.study?.step?.kind === 'form'")
            save(await leader.screenshot(), HERE / "study-experimenter.png")
            await answered(page)
            await page.wait_for_selector("[data-form=workload]", timeout=120_000)
            for name, value in ANSWERS.items():
                await page.click(f"[data-item={name}] [data-value='{value}']")
            await page.click("[data-do=next]")
            save(await page.screenshot(), HERE / "study-workload.png")
            await browser.close()


if __name__ == "__main__":
    asyncio.run(shoot())
