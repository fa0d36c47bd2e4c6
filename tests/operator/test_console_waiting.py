"""What a page says in its first seconds, in a real browser: no panel is empty without a word."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import Stage, becomes, staged, until
from console_harness import gateway
from PIL import Image

from usarsim_operator import packets
from usarsim_operator.roles import Role

LATE = 600.0
"""s that the viewer sees everything late: longer than any test."""

PANELS = ("cameras", "robots", "map", "laser", "card", "details")
WORDLESS = """() => [...document.querySelectorAll("[data-panel]")]
  .filter((panel) => panel.offsetParent !== null && panel.dataset.panel !== "lines")
  .filter((panel) => [...panel.children].filter((one) => !one.matches(".panel-head"))
    .every((one) => !/[a-z]/.test(one.innerText)))
  .map((panel) => panel.dataset.panel)"""
"""Names of panels on the screen that show no word beside their headings."""

NOTES = """() => Object.fromEntries([...document.querySelectorAll("[data-panel]")].map((panel) =>
  [panel.dataset.panel, [...panel.querySelectorAll(".empty, .tile-note")]
    .filter((one) => one.offsetParent !== null).map((one) => one.innerText).filter(Boolean)]))"""


@pytest.fixture(scope="module")
def stage(page_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    yield from staged(page_folder, tmp_path_factory.mktemp("latch") / "estop.json")


async def heard(page: Any, state: dict[str, Any]) -> None:
    """Let a page hear a state, as if the gateway had told it."""
    await page.evaluate(f"window.usarsim.store.heard({json.dumps(state)})")


async def noted(page: Any, *panels: str, text: str = "") -> None:
    """Wait until panels show one note, or none; each looks anew within 0.2 s."""
    for panel in panels:
        wanted = json.dumps([text] if text else [])
        await becomes(page, f"JSON.stringify(({NOTES})()[{panel!r}]) === {wanted!r}")


async def test_a_viewer_is_told_what_is_waited_for(stage: Stage) -> None:
    """From the first second on: the link, how late it sees all, no robot, no picture, no scan; and
    that the world is paused. What comes ends each note."""
    async with gateway(stage.tap, delay=LATE) as console:
        await console.station.spawn("P3AT", "W1", "RobotStart5")
        async with stage.page(gateway=console) as operator:
            await becomes(operator, "window.usarsim.store.robots[0].sensors.length")
            state = await operator.evaluate("window.usarsim.store.state")
        url = stage.url(Role.VIEWER, console)
        context = await stage.browser.new_context(viewport={"width": 1366, "height": 768})
        try:
            page = await context.new_page()
            held: list[Any] = []
            await page.route_web_socket(
                "**/socket", lambda one: held.append(one)
            )  # it opens, and says nothing
            await page.goto(url)
            await noted(page, *PANELS, text="connecting to the gateway")
            assert await page.evaluate(WORDLESS) == []
        finally:
            await context.close()

        context = await stage.browser.new_context(viewport={"width": 1366, "height": 768})
        try:
            page = await context.new_page()
            await page.goto(url)
            await becomes(page, "window.usarsim.store.connected")
            await becomes(page, "/first news in [45]\\d\\d s/.test(document.body.innerText)")
            for panel, notes in (await page.evaluate(NOTES)).items():
                if panel not in ("alarms", "marks", "lines"):
                    assert notes, panel
                    assert "all 600 s late" in notes[0], panel
            assert await page.evaluate(WORDLESS) == []

            await heard(page, {**state, "robots": [], "paused": True})
            await noted(page, *PANELS, text="connected, server paused, no robot has come yet")
            assert await page.evaluate(WORDLESS) == []

            row = {**state["robots"][0], "pose": None, "sensors": [], "learned": False}
            early = {**row, "camera": None, "laser": None}
            await heard(page, {**state, "robots": [early]})
            await noted(page, "cameras", text="asking what it carries")
            await noted(page, "laser", text="waiting for first scan of W1")
            await noted(page, "map", text="waiting for first scan with a place")
            await noted(page, "card", text="waiting for first report of W1")
            assert await page.evaluate(WORDLESS) == []

            camera = {"on": True, "age": 1e6, "rate_hz": 10.0, "dropped": 0, "fov": None}
            row = {**row, "learned": True, "camera": camera}
            await heard(page, {**state, "robots": [row], "paused": True})
            await noted(page, "cameras", text="server paused, waiting for first picture of W1")
            await noted(page, "laser", text="server paused, waiting for first scan of W1")

            await heard(page, state)
            await noted(page, "map", "card", "robots", "details")
        finally:
            await context.close()


async def test_the_chosen_robots_picture_is_shown_first(stage: Stage) -> None:
    """Of pictures that wait together the page draws that of the robot that it is about first."""
    jpeg = io.BytesIO()
    Image.new("RGB", (32, 24), "#406080").save(jpeg, "JPEG")
    station = stage.gateway.station
    async with stage.page() as page:
        await page.keyboard.press("3")
        number = await page.evaluate("window.usarsim.store.welcome.page")
        mine = station.pages[number]
        await until(lambda: mine.selected == "R3")
        await page.evaluate(
            "window.order = [];"
            "window.usarsim.store.on('picture', (index) => window.order.push(index))"
        )
        for robot in station.robots.values():
            head = packets.head(packets.PICTURE, robot.index, 1, station.time)
            mine.show("picture", robot.name, head + jpeg.getvalue())
        await becomes(page, "window.order.length >= 4")
        order = await page.evaluate("window.order")
        assert order[0] == station.robots["R3"].index
        assert sorted(order) == [0, 1, 2, 3]
