"""The page of a shared run in a real browser, without any network."""

from __future__ import annotations

import asyncio
import gzip
import json
import math
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import FLAGS, browsing
from test_console_input_access import AUDIT, AXE

from usarsim_mission.live import LiveRun
from usarsim_mission.model import Mission, Victim, World
from usarsim_mission.referee import Referee
from usarsim_mission.runlog import RunWriter
from usarsim_mission.scoring import find_rules
from usarsim_mission.sharing.file import LIMIT, share

BOX = {"shape": "box", "size": [0.25, 0.2, 0.1], "material": 0}
SCENE: dict[str, Any] = {
    "time": 0.0,
    "scene": {
        "lower": [-5, -5, 0],
        "upper": [5, 5, 3],
        "materials": [{"rgba": [0.5, 0.5, 0.5, 1]}],
        "still": [{"geoms": [{"shape": "plane", "size": [5, 5], "material": 0}]}],
        "bodies": [{"what": "victim", "name": "Anna", "geoms": [BOX]}],
    },
    "kinds": {
        "P3AT": {
            "materials": [{"rgba": [0.8, 0.1, 0.1, 1]}],
            "bodies": [{"geoms": [BOX]}, {"geoms": [{**BOX, "pos": [0, 0, 0.2]}]}],
        }
    },
    "meshes": {},
    "textures": {},
    "things": [{"what": "robot", "name": "R1", "kind": "P3AT", "first": 1, "lit": False}],
    "poses": [0, 2, 0.5, 1, 0, 0, 0, 3, 0, 0.2, 1, 0, 0, 0, 3.2, 0, 0.3, 1, 0, 0, 0],
}
"""A floor, a person, and a robot of two bodies, the second 0.2 m before and 0.1 m above."""


def place(time: float) -> tuple[float, float, float]:
    """Where R1 is: on a circle of 3 m, once round in 10 s."""
    return 3 * math.cos(0.2 * math.pi * time), 3 * math.sin(0.2 * math.pi * time), 0.2


def write_run(folder: Path) -> None:
    """R1 goes round, R2 stands, Anna walks along x and is marked after 4 s."""
    rules, mission = find_rules("usar-mj-1")[1], Mission("round", 1, 10.0)
    world = World("Round and round", victims=(Victim("Anna", (0.0, 2.0, 0.1)),))
    log = RunWriter(folder, "", mission, rules, world)
    run = LiveRun(log, Referee(mission, rules, world))
    robots = [{"name": name, "class": "P3AT"} for name in ("R1", "R2")]
    run.tell("session", 0.0, robots=robots, operators=1)
    run.tell("trial_start", 0.0, limit=10.0)
    run.tell("select", 0.0, page=1, robot="R1")
    for step in range(101):
        time = step / 10
        if step == 40:
            run.tell("mark_set", time, mark=1, robot="R1", place=(0.4, 2.0, 0.1), page=1)
        if step == 20:
            run.tell("command", time, robot="R1", source="operator", left=0.2, right=0.6)
        turn = 0.1 * math.pi * (time + 2.5)
        quats = [math.cos(turn), 0.0, 0.0, math.sin(turn)], [1.0, 0.0, 0.0, 0.0]
        rows = [
            {"name": name, "pos": pos, "quat": quat, "contacts": []}
            for name, pos, quat in zip(
                ("R1", "R2"), (place(time), (-4.0, -4.0, 0.2)), quats, strict=True
            )
        ]
        victims = [{"name": "Anna", "pos": (time / 10, 2.0, 0.1)}]
        run.tell("truth", time, robots=rows, victims=victims, views=[])
    run.close()
    (folder / "scene.json.gz").write_bytes(gzip.compress(json.dumps(SCENE).encode()))


PLACES = """(time) => { share.seek(time); return [0, 1].map((n) => share.stage.placeOf(n)); }"""
BODIES = """[0, 2].map((n) => [...share.stage.world.poses.slice(7 * n, 7 * n + 3)])"""
PICTURES = """[...document.querySelectorAll("[data-panel=plan] canvas, [data-panel=lanes] canvas")]
    .map((canvas) => canvas.toDataURL())"""


def test_a_run_is_looked_at_offline(page_folder: Path, npm: Any, tmp_path: Path) -> None:
    """One file below 5 MB from file://, no request but for itself; the time line moves robots,
    people, map, lanes and lists to where they were; by keys alone; no serious finding of axe in
    either theme; nothing beside the screen of a phone."""
    write_run(tmp_path / "run")
    file = tmp_path / "run.html"
    assert share(tmp_path / "run", file, page_folder)[0] < LIMIT

    async def look() -> None:
        async with browsing(*FLAGS) as browser:
            context = await browser.new_context(viewport={"width": 1366, "height": 768})
            await context.set_offline(True)
            page = await context.new_page()
            asked: list[str] = []
            wrong: list[str] = []
            page.on("request", lambda request: asked.append(request.url))
            page.on("pageerror", lambda error: wrong.append(str(error)))
            page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
            await page.goto(file.as_uri())
            await page.wait_for_selector("html[data-ready]")
            await moved(page)
            await by_keys(page)
            await page.evaluate(AXE.read_text(encoding="utf-8"))
            for _ in range(2):
                assert await page.evaluate(AUDIT) == []
                await page.click("[data-do=theme]")
            await page.set_viewport_size({"width": 390, "height": 844})
            assert await page.evaluate("document.documentElement.scrollWidth") <= 390
            assert wrong == []
            assert asked == [file.as_uri()]

    asyncio.run(look())


async def moved(page: Any) -> None:
    """Known places at known times, between rows too, forth and back."""
    has_gl = await page.get_attribute("[data-panel=share3d]", "data-webgl")
    assert has_gl == "true"
    for time in (0.0, 7.3, 2.5, 10.0):
        first, second = await page.evaluate(PLACES, time)
        assert math.dist(first, place(time)) < 2e-3
        assert math.dist(second, (-4, -4, 0.2)) < 2e-3
        anna, wheel = await page.evaluate(BODIES)
        assert math.dist(anna, (time / 10, 2.0, 0.5)) < 2e-3
        x, y, _ = place(time)
        ahead = 0.2 * math.pi * time + 0.5 * math.pi
        assert math.dist(wheel, (x + 0.2 * math.cos(ahead), y + 0.2 * math.sin(ahead), 0.3)) < 2e-3
    halfway = (await page.evaluate(PLACES, 3.05))[0]
    middle = [(a + b) / 2 for a, b in zip(place(3.0), place(3.1), strict=True)]
    assert math.dist(halfway, middle) < 2e-3
    before = await page.evaluate(PICTURES)
    await page.evaluate("share.seek(6)")
    assert all(a != b for a, b in zip(before, await page.evaluate(PICTURES), strict=True))


async def by_keys(page: Any) -> None:
    """Home, arrows, a row at a time, play and pause, the line itself, and what lists say."""
    for key in ("Home", "ArrowRight", "ArrowRight", "Shift+ArrowRight", "ArrowLeft", "."):
        await page.keyboard.press(key)
    assert await page.evaluate("share.time") == pytest.approx(9.1)
    await page.focus("input[type=range]")
    await page.keyboard.press("Home")
    assert await page.get_attribute("input[type=range]", "aria-valuetext") == "0:00.0 of 0:10.0"
    await page.evaluate("document.activeElement.blur()")
    await page.keyboard.press(" ")
    for _ in range(400):  # the page's policy keeps playwright's own wait from evaluating text
        if await page.evaluate("share.time") > 0.3:
            break
        await asyncio.sleep(0.02)
    await page.keyboard.press(" ")
    stopped = await page.evaluate("share.time")
    assert 0.3 < stopped < 9.0
    await page.wait_for_timeout(100)
    assert await page.evaluate("share.time") == stopped
    await page.keyboard.press("End")
    wheels = "[data-robot=R1] .fill"
    widths = f"[...document.querySelectorAll('{wheels}')].map((one) => one.style.width)"
    assert await page.evaluate(widths) == ["10%", "30%"]
    await page.click("[data-do=choose-victims]")
    state = page.locator("[data-victim=Anna] .state")
    assert await state.inner_text() == "credited"
    await page.click("[data-victim=Anna] [data-do=seek]")
    assert await page.evaluate("share.time") == pytest.approx(4.0)
    await page.keyboard.press("ArrowLeft")
    assert await state.inner_text() == "not found"
    await page.click("[data-do=choose-events]")
    past = page.locator(".events li[data-past=true]")
    assert await past.count() == 1  # the trial has begun
