"""The page for everybody: by keyboard alone, on every screen, with keys and pads of one's own."""

from __future__ import annotations

import asyncio
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

from console_browser import Stage, becomes, staged, until

from usarsim_client.readings import LaserScan
from usarsim_operator.roles import Role

pytestmark = pytest.mark.slow

ROBOTS = ("R1", "R2", "R3", "R4")
AXE = (
    Path(__file__).parents[2]
    / "tools/usarsim_operator/web/node_modules"
    / "axe-core"
    / "axe.min.js"
)
AUDIT = """axe.run(document, { resultTypes: ["violations"] }).then((found) =>
    found.violations.filter((one) => one.impact === "serious" || one.impact === "critical")
        .map((one) => [one.id, one.nodes.map((node) => node.html + node.failureSummary)]))"""


@pytest.fixture(scope="module")
def stage(page_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    yield from staged(page_folder, tmp_path_factory.mktemp("latch") / "estop.json")


async def notice(page: Any, text: str) -> None:
    await page.wait_for_selector(f"[data-notices] p:has-text({text!r})")


async def test_a_mission_by_keyboard_alone(stage: Stage) -> None:
    """CON-25, O-27: connect, choose, take, drive, mark, stop, with no pointer; every stop of the
    Tab key is seen, and the focus comes round."""
    async with stage.page() as page:
        seen: list[str] = []
        for _ in range(80):
            await page.keyboard.press("Tab")
            told = await page.evaluate(
                """() => {
                    const one = document.activeElement;
                    const style = getComputedStyle(one);
                    const box = one.getBoundingClientRect();
                    return [one.dataset.do ?? one.dataset.tile ?? one.tagName, style.outlineStyle,
                        parseFloat(style.outlineWidth), box.width * box.height];
                }"""
            )
            if told[0] == "BODY":
                break
            name, style, width, area = told
            assert style != "none", told
            assert width >= 2, told
            assert area > 0, told
            seen.append(name)
        assert {"estop", "keys", "theme", "take", "enable", *ROBOTS} <= set(seen)
        # Behind the last stop is the browser itself, which would take the next keys.
        await page.bring_to_front()
        await page.evaluate("window.focus()")
        await becomes(page, "document.hasFocus()")

        await page.keyboard.press("2")
        await page.keyboard.press("l")
        await page.wait_for_selector("[data-field=holder]:text-is('you drive')")
        await stage.hold(page, "w", "R2", (0.6, 0.6))
        await page.keyboard.up("w")
        await stage.driven("R2", (0.0, 0.0))
        await becomes(page, "window.usarsim.store.slot(window.usarsim.store.robot.index).scan")
        await page.keyboard.press("m")
        await page.wait_for_selector("dialog[open]")
        await page.keyboard.press("Tab")
        await page.keyboard.type("under the table")
        await page.keyboard.press("Enter")
        await page.wait_for_selector("[data-mark]:has-text('under the table')")
        await page.keyboard.press("Space")
        await until(lambda: stage.gateway.station.arbiter.stop is not None)
        await page.wait_for_selector('[data-do=estop][aria-pressed="true"]')
        await page.focus("[data-do=release]")
        await page.keyboard.down("Enter")
        await until(lambda: stage.gateway.station.arbiter.stop is None)
        await page.keyboard.up("Enter")
        # The focus is where it was before a dialog took it.
        await page.focus("[data-do=keys]")
        await page.keyboard.press("Enter")
        await page.wait_for_selector("dialog[open]")
        await page.keyboard.press("Escape")
        await page.wait_for_selector("dialog", state="detached")
        await becomes(page, "document.activeElement.dataset.do === 'keys'")


@pytest.mark.parametrize(
    "role", slow_but({Role.OPERATOR}.__contains__, Role), ids=lambda role: role.value
)
async def test_axe_finds_nothing_grave(stage: Stage, npm: Any, role: Role) -> None:
    """CON-25: no serious or critical finding of axe-core, in both themes, for each role; for the
    operator with the dialogs for keys and marks open, too."""
    async with stage.page(role) as page:
        await page.evaluate(AXE.read_text(encoding="utf-8"))
        for _ in range(2):
            theme = await page.evaluate("document.documentElement.dataset.theme")
            assert await page.evaluate(AUDIT) == [], theme
            if role is Role.OPERATOR:
                await page.click("[data-do=keys]")
                assert await page.evaluate(AUDIT) == [], theme
                await page.keyboard.press("Escape")
            await page.click("[data-do=theme]")


@pytest.mark.parametrize(
    "role", slow_but({Role.OPERATOR}.__contains__, Role), ids=lambda role: role.value
)
async def test_nothing_is_beside_the_screen(stage: Stage, role: Role) -> None:
    """CON-25: no horizontal scrolling, for no role, on no tab of a phone, in no dialog; nor in the
    wide window that the page is shown in then."""
    phone, wide = {"width": 390, "height": 844}, {"width": 1366, "height": 768}
    async with stage.page(role, viewport=phone) as page:
        tabs = await page.locator(".tabs button").all()
        assert len(tabs) > 1
        for tab in tabs:
            await tab.click()
            await _fits(page, phone["width"])
        await page.set_viewport_size(wide)
        await becomes(page, f"innerWidth === {wide['width']}")
        await _fits(page, wide["width"])


async def _fits(page: Any, width: int) -> None:
    assert await page.evaluate("document.documentElement.scrollWidth") <= width
    hidden = await page.evaluate(
        f"""[...document.querySelectorAll("button, select, input")].filter((one) => {{
            const box = one.getBoundingClientRect();
            return box.width && (box.left < -1 || box.right > {width} + 1)
                && !one.closest(".tiles, .scrolls");
        }}).map((one) => one.outerHTML)"""
    )
    assert hidden == []


async def test_no_colour_alone_tells_robots_apart(stage: Stage) -> None:
    """O-27: with all colours taken away, names, numbers, words and signs say the same."""
    async with stage.page() as page:
        for place, name in enumerate(ROBOTS):
            row = await page.locator(f"[data-robot={name}]").inner_text()
            assert name in row
            assert str(place + 1) in row
            assert name in await page.locator(f"[data-tile={name}]").inner_text()
        for state, sign in (("good", "▮▮▮"), ("lost", "✕")):
            told = await page.locator(f'[data-robot] [data-link="{state}"]').all_inner_texts()
            assert all(sign in text for text in told)
        station = stage.gateway.station
        station.alarms.see("R3", "battery", True, "battery below 20 %", station.time)
        await page.wait_for_selector(
            "[data-alarm] .sign:has-text('△'), [data-alarm] .sign:has-text('■')"
        )


async def test_marks_from_picture_and_map(stage: Stage) -> None:
    """A double click into a picture gives the bearing, the laser the range: the mark lies where
    that beam ended. From the map: where it was clicked. Edited, deleted."""
    async with stage.page() as page:
        await page.click("[data-tile=R4]")
        await becomes(page, "window.usarsim.store.slot(window.usarsim.store.robot.index).scan")
        marks = stage.gateway.station.marks
        before = len(marks.rows())
        box = await page.locator("[data-tile=R4] canvas").bounding_box()
        column = 0.25
        x, y = box["x"] + box["width"] * (0.5 + column), box["y"] + box["height"] * 0.5
        await page.mouse.dblclick(x, y)
        await page.wait_for_selector("dialog[open]")
        await page.select_option("dialog [data-field=status]", "alive")
        await page.fill("dialog [data-field=note]", "waves")
        await page.click("dialog [data-do=accept]")
        await until(lambda: len(marks.rows()) == before + 1)
        one = marks.rows()[-1]
        assert (one["robot"], one["status"], one["note"]) == ("R4", "alive", "waves")

        driven = stage.gateway.station.robots["R4"]
        pose = driven.telemetry.pose
        scan = driven.robot.newest(LaserScan)
        bearing = math.atan(2 * column * math.tan(driven.fov / 2))
        away = [place - own for place, own in zip(one["place"], pose, strict=False)]
        (lens, _, _), _ = driven.mounts.pose(driven.camera)
        ahead = away[0] * math.cos(pose[5]) + away[1] * math.sin(pose[5])
        right = away[1] * math.cos(pose[5]) - away[0] * math.sin(pose[5])
        assert math.atan2(right, ahead - lens) == pytest.approx(bearing, abs=0.03)
        (laser, _, _), _ = driven.mounts.pose(scan.name)
        angle = math.atan2(right, ahead - laser)
        beam = min(range(len(scan.ranges)), key=lambda i: abs(scan.bearings[i] - angle))
        assert math.hypot(right, ahead - laser) == pytest.approx(scan.ranges[beam], abs=0.1)

        await page.click(f"[data-mark='{one['id']}'] [data-do=mark-edit]")
        await page.select_option("dialog [data-field=status]", "dead")
        await page.click("dialog [data-do=accept]")
        await page.wait_for_selector(f"[data-mark='{one['id']}']:has-text('dead waves')")
        assert marks.rows()[-1]["place"] == one["place"]

        canvas = page.locator("[data-panel=map] canvas")
        area = await canvas.bounding_box()
        await canvas.dblclick(position={"x": area["width"] / 2, "y": area["height"] / 2})
        await page.click("dialog [data-do=accept]")
        await until(lambda: len(marks.rows()) == before + 2)
        await page.click(f"[data-mark='{one['id']}'] [data-do=mark-delete]")
        await until(lambda: one["id"] not in [row["id"] for row in marks.rows()])
        await page.wait_for_selector(f"[data-mark='{one['id']}']", state="detached")


RING = """([x, y], wanted) => {
  const canvas = document.querySelector("[data-panel=map] canvas");
  const [column, row] = window.usarsim.map.at(x, y).map(Math.round);
  const { data } = canvas.getContext("2d").getImageData(column - 12, row - 12, 25, 25);
  let count = 0;
  for (let i = 0; i < data.length; i += 4)
    count += wanted.every((value, k) => Math.abs(data[i + k] - value) < 40) && data[i + 3] > 150;
  return count;
}"""
"""How many pixels around a place of the map have a colour."""
SPOT = """([x, y]) => {
  const canvas = document.querySelector("[data-panel=map] canvas");
  const box = canvas.getBoundingClientRect();
  const [column, row] = window.usarsim.map.at(x, y);
  const scale = box.width / canvas.width;
  return [box.left + column * scale, box.top + row * scale];
}"""
"""Where on the screen a place of the map is."""
WAYS = ("mouse", "touch", "keyboard", "picture")


@pytest.mark.parametrize("way", slow_but("picture".__eq__, WAYS))
async def test_a_mark_is_shown_before_it_is_set(stage: Stage, way: str) -> None:
    """M and Enter mark; so do one click and one tap after the button. Until then the map and the
    picture show where it goes and how far away, and keys move it."""
    marks = stage.gateway.station.marks
    before = len(marks.rows())
    touch = {"has_touch": True} if way == "touch" else {}
    async with stage.page(**touch) as page:
        await page.click("[data-tile=R4]")
        await becomes(page, "window.usarsim.store.slot(window.usarsim.store.robot.index).scan")
        driven = stage.gateway.station.robots["R4"]
        x, y, *_, yaw = driven.telemetry.pose
        if way == "keyboard":
            await page.keyboard.press("m")
        else:
            button = "[data-panel=cameras] [data-do=mark]"
            await (page.tap if way == "touch" else page.click)(button)
            assert await page.get_attribute(button, "aria-pressed") == "true"
            # 1.2 m ahead and a little to the right, on the map; or a quarter right in the picture.
            goal = [x + 1.2 * math.cos(yaw + 0.3), y + 1.2 * math.sin(yaw + 0.3)]
            box = await page.locator("[data-tile=R4] canvas").bounding_box()
            spot = [box["x"] + 0.75 * box["width"], box["y"] + 0.5 * box["height"]]
            if way != "picture":
                await page.locator("[data-panel=map] canvas").scroll_into_view_if_needed()
                spot = await page.evaluate(SPOT, goal)
            await (page.touchscreen.tap if way == "touch" else page.mouse.click)(*spot)
        await page.wait_for_selector("dialog[open]")
        told = await page.inner_text("[data-mark-where]")
        shown = await page.inner_text("[data-tile=R4] [data-aim]")
        assert re.match(r"\d+\.\d m from R4, ", told)
        assert told.startswith(shown)
        assert len(marks.rows()) == before
        place = await page.evaluate("window.usarsim.store.considered.place")
        rose = await page.evaluate(
            "getComputedStyle(document.documentElement).getPropertyValue('--mark').trim()"
        )
        wanted = [int(rose[i : i + 2], 16) for i in (1, 3, 5)]
        await becomes(page, f"({RING})({json.dumps(place)}, {wanted}) > 20")
        if way in ("mouse", "touch"):
            assert math.dist(place[:2], goal) < 0.2
            await page.fill("dialog [data-field=distance]", "1.5")
            await page.wait_for_selector("[data-tile=R4] [data-aim]:text-is('1.5 m')")
            assert (await page.inner_text("[data-mark-where]")).startswith("1.5 m from R4")
        await page.keyboard.press("Enter")
        await until(lambda: len(marks.rows()) == before + 1)
        one = marks.rows()[-1]
        away = math.dist(one["place"][:2], (x, y))
        asked = 1.5 if way in ("mouse", "touch") else float(shown[:-2])
        assert away == pytest.approx(asked, abs=0.06)
        assert not await page.is_visible("[data-tile=R4] [data-aim]")
        assert await page.evaluate("window.usarsim.store.considered") is None


async def test_keys_go_out_and_come_in_as_a_file(stage: Stage, tmp_path: Path) -> None:
    """CON-27: exported, changed, imported, obeyed after a reload; a key for two is refused by
    both names, and so is a file that says so."""
    async with stage.page() as page:
        await page.click("[data-do=keys]")
        async with page.expect_download() as download:
            await page.click("dialog [data-do=export]")
        file = tmp_path / "keys.toml"
        await (await download.value).save_as(file)
        text = file.read_text()
        assert 'forward = ["KeyW", "ArrowUp"]' in text

        await page.click("[data-do=key-back-0]")
        await page.keyboard.press("w")
        conflict = 'KeyW is both "drive forward" and "drive back"'
        await page.wait_for_selector(f"dialog [data-error]:text-is({json.dumps(conflict)})")
        file.write_text(text.replace('back = ["KeyS"', 'back = ["KeyD"'))
        await page.set_input_files("[data-do=import-file]", file)
        conflict = 'KeyD is both "drive back" and "turn right"'
        await page.wait_for_selector(f"dialog [data-error]:text-is({json.dumps(conflict)})")
        file.write_text(text.replace('forward = ["KeyW"', 'forward = ["KeyI"'))
        await page.set_input_files("[data-do=import-file]", file)
        await page.wait_for_selector("[data-do=key-forward-0]:text-is('I')")
        await page.click("dialog [data-do=accept]")
        await page.reload()
        await becomes(page, "window.usarsim?.store.robots.length")
        await page.keyboard.down("w")
        await page.keyboard.up("w")
        await stage.hold(page, "i", "R1", (0.6, 0.6))
        await page.keyboard.up("i")
        await stage.driven("R1", (0.0, 0.0))


async def test_a_strange_pad_is_set_up_once(stage: Stage) -> None:
    """O-34: a pad without the standard layout is asked for each control; the map is kept for that
    pad over a reload, with axes that count the other way round, and others are not touched."""
    strange = "plug('Strange pad', '', [0, 0, -1, 0, 0], 12)"
    async with stage.page() as page:
        await page.evaluate(strange)
        await page.wait_for_selector("dialog[data-remap='Strange pad']")

        async def answer(action: str) -> None:
            asked = await page.text_content("[data-ask]")
            await page.evaluate(action)
            await becomes(page, f"document.querySelector('[data-ask]').textContent !== {asked!r}")

        assert "forward" in await page.text_content("[data-ask]")
        await answer("tilt(0, 0, -1, 0, 1)")  # axis 4, and the other way round than usual
        await answer("tilt(0, 1, -1, 0, 0)")
        await answer("document.querySelector('[data-do=skip]').click()")
        await answer("document.querySelector('[data-do=skip]').click()")
        await page.evaluate("tilt(0, 0, -1, 0, 0)")
        assert "drive while held" in await page.text_content("[data-ask]")
        await answer("hold(7)")
        assert stage.wire.drives("R1")[-1:] != [(1.0, 1.0)]
        await page.click("dialog [data-do=accept]")
        await page.reload()
        await becomes(page, "window.usarsim?.store.robots.length")
        await page.evaluate(strange)
        await notice(page, "pad connected: Strange pad")
        assert await page.locator("dialog").count() == 0
        await page.evaluate("hold(7); tilt(0, 0, -1, 0, 1)")
        await stage.driven("R1", (1.0, 1.0))
        await page.evaluate("hold(); tilt(0, 1, -1, 0, 0)")
        await stage.driven("R1", (0.0, 0.0))
        await page.evaluate("hold(7)")
        await stage.driven("R1", (1.0, -1.0))
        await page.evaluate("unplug(); plug('Standard pad'); hold(5); tilt(0, -1, 0, 0)")
        await stage.driven("R1", (1.0, 1.0))
        await page.evaluate("unplug()")
        await stage.driven("R1", (0.0, 0.0))
        await asyncio.sleep(0)
